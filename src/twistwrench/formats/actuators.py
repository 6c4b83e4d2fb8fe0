"""Actuator files: motors, gears, rotors, elastic joints and friction laws in YAML, every number with its unit."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..core.errors import ModelError, ModelWarning, UnknownNameError, ValueRangeError
from ..core.numbers import printed
from ..mechanics.model.actuation import with_actuators, with_friction, with_link_friction
from ..mechanics.model.actuators import RATINGS, Actuator, Motor, Rotor, Thermal
from ..mechanics.model.couplings import Coupling, with_couplings, without_couplings
from ..mechanics.model.edit import with_armature
from ..mechanics.model.limits import BEARING_UNITS, BEARINGS
from ..mechanics.model.model import Model
from .yaml import Section, Source, plain_number, read_yaml, short_text

_RAD_PER_METRE: dict[str, Callable[[float], float]] = {
    "rad/m": lambda angle_per_metre: angle_per_metre,
    "mm/turn": lambda millimetres_per_turn: 2e3 * np.pi / millimetres_per_turn,  # 2 π rad, and 1e3 mm in a metre
    "m/turn": lambda metres_per_turn: 2 * np.pi / metres_per_turn,
}
"""Rotor angle per metre [rad/m] from a number in each unit of a spindle or a rack."""


def gear_ratio(value: object, where: str, *, sliding: bool) -> float:
    """Gear ratio from a plain number or ``101:1``; for sliding joints in rad/m, or as a lead with its unit.

    ``where`` names the entry in error messages.
    """
    if sliding and isinstance(value, str):
        text = value.rstrip()
        for unit, rad_per_metre in _RAD_PER_METRE.items():
            if text.endswith(unit):
                problem = f"{where} is {short_text(value)}, expected a number before {unit}."
                number = plain_number(text.removesuffix(unit), problem)
                if number == 0:
                    raise ModelError(problem)
                return float(rad_per_metre(number))
    other_form = f", or with one of {', '.join(_RAD_PER_METRE)}" if sliding else ", or 101:1"
    problem = f"{where} is {short_text(value)}, expected a number such as 101{other_form}."
    if not isinstance(value, str):
        return plain_number(value, problem)
    rotor_turns, colon, joint_turns = value.partition(":")
    divisor = plain_number(joint_turns, problem) if colon else 1.0
    if divisor == 0:
        raise ModelError(problem)
    return plain_number(rotor_turns, problem) / divisor


# Entries that each section may have. ``…_KEYS`` are names of entries. ``…_KINDS`` give the kind of unit of each entry, too; an
# empty kind is a plain number.
_THERMAL_KINDS = {
    "winding_housing": "thermal resistance", "housing_ambient": "thermal resistance", "winding_time": "time",
    "housing_time": "time", "maximum": "temperature", "coefficient": "", "reference": "temperature",
}  # fmt: skip
_ACTUATOR_KEYS = (
    "ratio", "efficiency", "no_load_torque", "motor", "rotor", "reflected_inertia", "stiffness", "friction", "link_friction",
)  # fmt: skip
_COUPLED_MOTOR_KEYS = (
    "ratio",
    "efficiency",
    "no_load_torque",
    "motor",
    "rotor",
    "reflected_inertia",
    "friction",
    "effort",
)
_COUPLING_KEYS = ("motors", "joints", "motor_per_joint", "joint_per_motor")
_ROTOR_KEYS = ("inertia", "extra", "mass", "link", "axis", "place")
_FRICTION_KINDS = {"viscous": "viscous", "coulomb": "torque", "static": "torque", "stribeck": "speed", "load": ""}
_SLIDING_KINDS = {
    "viscous": "viscous, sliding", "torque": "force", "speed": "speed, sliding", "stiffness": "stiffness, sliding",
    "inertia": "mass",
}  # fmt: skip
"""Kinds of unit at a sliding joint, by the kind at a turning joint."""


@dataclass(frozen=True, eq=False)
class ActuatorFile:
    """Entries of an actuator file, read once, and the name of the file for messages.

    Its couplings, actuators and log columns are checked against a model by :func:`add_actuators` and :func:`read_log_side`.
    """

    content: Any
    """Content of the file: dictionaries, lists, texts and numbers."""
    origin: str
    """Name of the file in messages."""

    @classmethod
    def from_source(cls, source: Source | ActuatorFile) -> ActuatorFile:
        """Read a path, YAML text or mapping. Raises NotFoundError, and ModelError for invalid YAML."""
        if isinstance(source, ActuatorFile):
            return source
        content, origin = read_yaml(source)
        return cls(content, origin)

    def __str__(self) -> str:
        return self.origin

    @contextmanager
    def section(self) -> Iterator[Section]:
        """Entries with their paths; errors about them include the file's name."""
        try:
            yield Section(self.content, "")
        except (ModelError, UnknownNameError, ValueRangeError) as error:
            raise type(error)(f"{self.origin}: {error}") from None

    @property
    def entries(self) -> dict[str, Any]:
        """Entries as mappings of text. Raises ModelError if the file is a list or a number."""
        if not isinstance(self.content, Mapping):
            raise ModelError(f"{self.origin} is {short_text(self.content)}, expected entries 'name: value'.")
        return dict(self.content)


def add_actuators(model: Model, source: Source | ActuatorFile, *, stiff: bool = False) -> Model:
    """Add the actuators of a YAML file, YAML text or mapping to a model; ``stiff`` ignores elasticity.

    Raises :class:`~twistwrench.NotFoundError`, and :class:`~twistwrench.ModelError` with the file and the entry.
    """
    with ActuatorFile.from_source(source).section() as file:
        return _add_from_section(model, file, stiff)


def _sliding_joints(model: Model) -> set[str]:
    """Names of the joints of one degree that slide."""
    joints = [body.joint for body in model.leaders]
    return {joint.name for joint in joints if joint.nv == 1 and not joint.turning[0]}


def _section_or_empty(parent: Section, key: str) -> Section:
    """Section of an optional entry; an empty section if the entry is missing."""
    if key in parent.content:
        return parent.section(key)
    return Section({}, key)


def _positive_number(entry: Section, key: str, kind: str, unit: str) -> float:
    """Limit of an actuator in ``unit``. Raises ModelError unless it is above 0."""
    limit = entry.number(key, kind)
    if not limit > 0:
        raise ModelError(f"{entry.where(key)} is {printed(limit)} {unit}; it must be above 0.")
    return limit


def _add_from_section(model: Model, file: Section, stiff: bool) -> Model:
    """Model with the actuators, limits, friction and rotor inertias of a file."""
    check_entries(model, file)
    motors = _read_motors(file)
    model = with_couplings(model, read_couplings(model, file))
    if "actuators" not in file.content:
        raise ModelError("it has no entry 'actuators:' with the joints below it.")
    joints = file.section("actuators")
    sliding = _sliding_joints(model)
    actuators: list[Actuator] = []
    armature: dict[str, float] = {}
    effort = model.limits.effort.copy()
    bearings = {kind: getattr(model.limits, kind).copy() for kind in BEARINGS}
    joint_friction: dict[str, dict[str, float]] = {}
    link_friction: dict[str, dict[str, float]] = {}
    for name in joints.content:
        entry = joints.section(name)
        k = model.drive_index(name)
        is_coupled_motor = name in model.drive_names and name not in model.velocity_names
        if is_coupled_motor:
            entry.only(*_COUPLED_MOTOR_KEYS)
            if "effort" in entry.content:
                effort[k] = _positive_number(entry, "effort", "torque", "N m")
        else:
            entry.only(*_ACTUATOR_KEYS, *BEARINGS)
            for kind in BEARINGS:
                if kind in entry.content:
                    unit_kind = "torque" if kind == "tilting" else "force"
                    bearings[kind][k] = _positive_number(entry, kind, unit_kind, BEARING_UNITS[kind])
        kinds = _SLIDING_KINDS if name in sliding else {}
        actuators.append(_read_actuator(name, entry, motors, kinds))
        if "reflected_inertia" in entry.content:
            armature[name] = entry.number("reflected_inertia", kinds.get("inertia", "inertia"))
        if "friction" in entry.content:
            joint_friction[name] = _read_friction_law(entry.section("friction"), kinds)
        if "link_friction" in entry.content:
            link_friction[name] = _read_friction_law(entry.section("link_friction"), kinds)
            joint_friction.setdefault(name, {})  # either entry replaces the friction of the robot file
    elastic_joints = [actuator.joint for actuator in actuators if np.isfinite(actuator.stiffness)]
    if stiff and elastic_joints:
        names = ", ".join(elastic_joints)
        warnings.warn(f"the elastic gears of {names} are taken to be stiff.", ModelWarning, stacklevel=2)
        actuators = [replace(actuator, stiffness=np.inf) for actuator in actuators]
    model = replace(model, limits=replace(model.limits, effort=effort, **bearings))
    model = with_friction(model, joint_friction)
    model = with_armature(model, armature)
    model = with_actuators(model, actuators)
    return with_link_friction(model, link_friction)


def check_entries(model: Model, file: Section) -> None:
    """Raise ModelError for unknown entries, or if the file is for another robot."""
    file.only("robot", "motors", "couplings", "actuators", "log")
    if file.content.get("robot", model.name) != model.name:
        raise ModelError(f"it is for robot {short_text(file.content['robot'])}, and this one is {model.name!r}.")


def read_couplings(model: Model, file: Section) -> list[Coupling]:
    """Couplings in a file. Raises ModelError for a matrix that is not square, is singular or is malformed."""
    sliding = _sliding_joints(model)
    section = _section_or_empty(file, "couplings")
    return [_read_coupling(str(name), section.section(name), sliding) for name in section.content]


def _read_coupling(name: str, entry: Section, sliding: set[str]) -> Coupling:
    """Coupling of motors and joints from its entry."""
    entry.only(*_COUPLING_KEYS)
    motors = _read_names(entry, "motors")
    joints = _read_names(entry, "joints")
    matrix_keys = [key for key in ("motor_per_joint", "joint_per_motor") if key in entry.content]
    if len(matrix_keys) != 1:
        beginning = "both motor_per_joint and" if matrix_keys else "neither motor_per_joint nor"
        raise ModelError(f"{entry.path} has {beginning} joint_per_motor. Give one of them: q̇_m = motor_per_joint q̇_j.")
    (key,) = matrix_keys
    rows = entry.content[key]
    where = entry.where(key)
    if not isinstance(rows, list | tuple) or not all(isinstance(row, list | tuple) for row in rows):
        raise ModelError(f"{where} is {short_text(rows)}, expected rows of numbers such as [[1, 1], [1, -1]].")
    row_lengths = [len(row) for row in rows]
    if len(set(row_lengths)) > 1:
        lengths_text = ", ".join(map(str, row_lengths))
        raise ModelError(f"{where} has rows of {lengths_text} numbers. Give equally many.")
    has_gear_ratios = key == "motor_per_joint"  # its columns are joints, and its entries may have units
    matrix = []
    for row in rows:
        numbers = []
        for k, value in enumerate(row):
            if has_gear_ratios and k < len(joints):
                numbers.append(gear_ratio(value, where, sliding=joints[k] in sliding))
            else:
                numbers.append(plain_number(value, f"{where} has {short_text(value)}, expected a plain number."))
        matrix.append(numbers)
    return Coupling(name, motors, joints, np.array(matrix), inverted=not has_gear_ratios)


def _read_names(entry: Section, key: str) -> tuple[str, ...]:
    """List of names under a key."""
    names = entry.content.get(key)
    if not isinstance(names, list | tuple) or not names or not all(isinstance(name, str) for name in names):
        raise ModelError(f"{entry.where(key)} is {short_text(names)}, expected names in brackets such as [m5, m6].")
    return tuple(names)


def _read_friction_law(section: Section, kinds: Mapping[str, str]) -> dict[str, float]:
    """Friction coefficients of a joint; ``kinds`` replace kinds of units and are empty for turning joints."""
    section.only(*_FRICTION_KINDS)
    coefficients = {}
    for key, kind in _FRICTION_KINDS.items():
        if key in section.content:
            coefficients[key] = section.number(key, kinds.get(kind, kind))
    return coefficients


def _read_actuator(joint: str, entry: Section, motors: Mapping[str, Motor], kinds: Mapping[str, str]) -> Actuator:
    """Actuator of a joint; ``kinds`` replace kinds of units, and are empty for turning joints."""
    properties: dict[str, Any] = {}
    properties |= _ratio(entry, sliding=bool(kinds))
    if "efficiency" in entry.content:
        properties["efficiency"] = plain_share(entry.content["efficiency"], entry.where("efficiency"))
    properties |= entry.optional("no_load_torque", entry.number, "torque")
    properties |= entry.optional("stiffness", entry.number, kinds.get("stiffness", "stiffness"))
    motor = _motor_of(entry, motors)
    if motor is not None:
        properties["motor"] = motor
    if "rotor" in entry.content:
        properties["rotor"] = _read_rotor(entry.section("rotor"))
    return Actuator(joint, **properties)


def _ratio(entry: Section, *, sliding: bool) -> dict[str, float]:
    """Gear ratio of an actuator as ``{"ratio": value}``; empty if it is not given."""

    def read_ratio(key: str) -> float:
        return gear_ratio(entry.content[key], entry.where(key), sliding=sliding)

    return entry.optional("ratio", read_ratio)


def _read_motors(file: Section) -> dict[str, Motor]:
    """Motors that a file describes by name."""
    section = _section_or_empty(file, "motors")
    return {name: read_motor(section.section(name)) for name in section.content}


def _motor_of(entry: Section, motors: Mapping[str, Motor]) -> Motor | None:
    """Motor of an actuator, by name or by an inline description; None without a motor."""
    motor = entry.content.get("motor")
    if motor is None:
        return None
    if not isinstance(motor, str):
        return read_motor(entry.section("motor"))
    if motor not in motors:
        raise UnknownNameError.from_choices(f"motor (below 'motors:', wanted by {entry.path})", motor, motors)
    return motors[motor]


def read_motor(section: Section, *others: str) -> Motor:
    """Motor of a section; ``others`` are additional allowed entries."""
    section.only(*RATINGS, "thermal", *others)
    if "torque_constant" not in section.content:
        raise ModelError(f"{section.path} has no torque_constant, without which no current follows from a torque.")
    thermal = None
    if "thermal" in section.content:
        thermal = _read_thermal(section.section("thermal"))
    ratings = {key: section.number(key, rating.kind) for key, rating in RATINGS.items() if key in section.content}
    return Motor(**ratings, thermal=thermal)


def _read_thermal(section: Section) -> Thermal:
    """Thermal resistances, time constants and temperatures of a motor."""
    section.only(*_THERMAL_KINDS)
    for key in ("housing_ambient", "housing_time"):
        if key not in section.content:
            raise ModelError(f"{section.path} has no {key}, without which no temperature follows.")
    return Thermal(**{key: section.number(key, _THERMAL_KINDS[key]) for key in section.content})


def _read_rotor(section: Section) -> Rotor:
    """Rotor of an actuator; an ``extra`` rotor has a mass that its link does not contain."""
    section.only(*_ROTOR_KEYS)
    if "inertia" not in section.content:
        raise ModelError(f"{section.path} has no inertia, which is all there is to a rotor.")
    extra_entry = section.content.get("extra", False)
    extra_text = str(extra_entry).lower()  # a boolean, or a text if it is quoted
    if not isinstance(extra_entry, str | bool) or extra_text not in ("true", "false"):
        raise ModelError(f"{section.where('extra')} is {short_text(extra_entry)}, expected true or false.")
    is_extra = extra_text == "true"
    if "mass" in section.content and not is_extra:
        raise ModelError(
            f"{section.where('mass')} is of no use unless the rotor is extra: the link has weighed it already."
        )
    link = section.content.get("link")
    if link is not None and not isinstance(link, str):
        raise ModelError(f"{section.where('link')} is {short_text(link)}, expected the name of a link.")
    placement = section.optional("axis", section.vector, "")
    placement |= section.optional("place", section.vector, "length")
    mass = section.optional("mass", section.number, "mass")
    return Rotor(inertia=section.number("inertia", "inertia"), extra=is_extra, link=link, **mass, **placement)


def plain_share(value: object, where: str) -> float:
    """Share from a plain number or a percentage; ``where`` names the entry in error messages."""
    problem = f"{where} is {short_text(value)}, expected a number such as 0.75, or 75 %."
    if isinstance(value, str) and value.rstrip().endswith("%"):
        percentage = value.rstrip().removesuffix("%")
        return plain_number(percentage, problem) / 100
    return plain_number(value, problem)


@dataclass(frozen=True)
class LogSide:
    """Properties of log columns in an actuator file, by joint."""

    of_motors: bool
    """True if the log has positions and torques of the motors, before the gears."""
    ratios: Mapping[str, float]
    """Gear ratios, motor per joint."""
    coupled: Mapping[str, Mapping[str, float]]
    """Rotation of a joint's motor per rotation of other joints, by names of the joint and of the other joint."""
    zero: Mapping[str, float]
    """Joint position where the log has zero [rad or m]."""
    sign: Mapping[str, float]
    """1, or -1 if the column counts in the opposite sense."""
    gain: Mapping[str, float]
    """Torque or force per unit of the column [N m or N], of the motor or of the joint."""
    of_currents: Mapping[str, float]
    """Torque per ampere of current columns [N m/A]: :attr:`gain` if given, otherwise the torque constant.

    For logs of the joints' side, the torque constant is multiplied by the gear ratio.
    """
    couplings: tuple[Coupling, ...] = ()
    """Couplings of motors. For their motors, ratios, signs and gains have motor names, and zeros have joint names."""


def read_log_side(model: Model, source: Source | ActuatorFile) -> LogSide:
    """Read the entry ``log:`` of an actuator file and the gear ratios; defaults if the file has no such entry.

    Raises :class:`~twistwrench.NotFoundError`, and :class:`~twistwrench.ModelError` with the file and the entry.
    """
    with ActuatorFile.from_source(source).section() as file:
        return _log_side(model, file)


def _log_side(model: Model, file: Section) -> LogSide:
    """Properties of log columns in the sections of a file."""
    check_entries(model, file)
    couplings = tuple(read_couplings(model, file))
    with_couplings(without_couplings(model), couplings)  # raises an error for missing joints
    sliding = _sliding_joints(model)
    ratios, torque_constants = _ratios_and_torque_constants(file, sliding)
    log = _section_or_empty(file, "log")
    log.only("side", "joints")
    side = log.content.get("side", "joint")
    if side not in ("joint", "motor"):
        raise ModelError(f"log → side is {short_text(side)}, expected joint or motor.")
    joints = Section({}, "log → joints")
    if "joints" in log.content:
        joints = log.section("joints")
    columns = _LogColumns(side, sliding, couplings, model.velocity_names)
    for name in joints.content:
        columns.read(name, joints)
    torque_per_ampere = {}
    for name, torque_constant in torque_constants.items():
        ratio = 1.0 if side == "motor" else ratios.get(name, 1.0)
        torque_per_ampere[name] = torque_constant * ratio
    return LogSide(
        side == "motor", ratios, columns.coupled, columns.zero, columns.sign, columns.gain,
        of_currents=torque_per_ampere | columns.gain, couplings=couplings,
    )  # fmt: skip


def _ratios_and_torque_constants(file: Section, sliding: set[str]) -> tuple[dict[str, float], dict[str, float]]:
    """Gear ratios, and torque constants of motors [N m/A], by joint; only joints that have one."""
    motors = _read_motors(file)
    actuators = _section_or_empty(file, "actuators")
    entries: dict[str, Section] = {}
    for name, content in actuators.content.items():
        if isinstance(content, Mapping):
            entries[name] = actuators.section(name)
    ratios = {}
    for name, entry in entries.items():
        if "ratio" in entry.content:
            ratios[name] = gear_ratio(entry.content["ratio"], entry.where("ratio"), sliding=name in sliding)
    torque_constants = {}
    for name, entry in entries.items():
        motor = _motor_of(entry, motors)
        if motor is not None:
            torque_constants[name] = motor.torque_constant
    return ratios, torque_constants


class _LogColumns:
    """Reader of the entries below ``log: joints:``; the attributes hold them by joint or coupled motor."""

    def __init__(self, side: str, sliding: set[str], couplings: Sequence[Coupling], joints: Sequence[str]) -> None:
        self.side = side
        self.sliding = sliding
        self.coupled_motors = {motor for coupling in couplings for motor in coupling.motors}
        self.coupled_joints = {joint for coupling in couplings for joint in coupling.joints}
        self.names = (*joints, *sorted(self.coupled_motors))
        self.coupled: dict[str, dict[str, float]] = {}
        self.zero: dict[str, float] = {}
        self.sign: dict[str, float] = {}
        self.gain: dict[str, float] = {}

    def read(self, name: str, joints: Section) -> None:
        """Read the entry of one joint or coupled motor. Raises UnknownNameError and ModelError."""
        if name not in self.names:
            raise UnknownNameError.from_choices("joint", name, self.names)
        entry = joints.section(name)
        entry.only(*self._keys(name))
        if name in self.coupled_motors and self.side == "joint":
            raise ModelError(
                f"{entry.path} is a coupled motor, and the log has the side of the joints. Say side: motor."
            )
        if "coupled" in entry.content:
            self.coupled[name] = self._ratios_to_others(name, entry.section("coupled"))
        if "zero" in entry.content:
            self.zero[name] = entry.number("zero", "length" if name in self.sliding else "angle")
        if "gain" in entry.content:
            self.gain[name] = entry.number("gain", "torque constant")
        if "sign" in entry.content:
            sign = entry.number("sign", "")
            if abs(sign) != 1.0:
                raise ModelError(f"{entry.where('sign')} is {printed(sign)}, expected 1 or -1.")
            self.sign[name] = sign

    def _keys(self, name: str) -> tuple[str, ...]:
        """Entries that a joint or motor may have."""
        if name in self.coupled_motors:
            return ("sign", "gain")
        if name in self.coupled_joints:
            return ("zero",)
        return ("coupled", "zero", "sign", "gain")

    def _ratios_to_others(self, name: str, others: Section) -> dict[str, float]:
        """Rotation of a joint's motor per rotation of other joints."""
        choices = [choice for choice in self.names if choice != name]
        for other in others.content:
            if other not in choices:
                raise UnknownNameError.from_choices("other joint", other, choices)
        ratios = {}
        for other, value in others.content.items():
            ratios[other] = gear_ratio(value, others.where(other), sliding=other in self.sliding)
        return ratios
