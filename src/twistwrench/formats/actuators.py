"""Actuator files: motors, gears, rotors, elastic joints and friction laws in YAML, every number with its unit."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping
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
from .yaml import Section, Source, plain_number, read_yaml, shown

_PER_METRE: dict[str, Callable[[float], float]] = {
    "rad/m": lambda x: x,
    "mm/turn": lambda x: 2e3 * np.pi / x,
    "m/turn": lambda x: 2 * np.pi / x,
}
"""Rotor angle per metre [rad/m], by the unit of a spindle or a rack."""


def gear_ratio(value: object, where: str, *, sliding: bool) -> float:
    """Gear ratio from a plain number or ``101:1``; for sliding joints in rad/m, or as a lead with its unit."""
    if sliding and isinstance(value, str):
        for unit, per_metre in _PER_METRE.items():
            if value.rstrip().endswith(unit):
                problem = f"{where} is {shown(value)}, expected a number before {unit}."
                number = plain_number(value.rstrip()[: -len(unit)], problem)
                if number == 0:
                    raise ModelError(problem)
                return float(per_metre(number))
    units = f", or with one of {', '.join(_PER_METRE)}" if sliding else ", or 101:1"
    problem = f"{where} is {shown(value)}, expected a number such as 101{units}."
    turns, colon, per = value.partition(":") if isinstance(value, str) else (value, "", "")
    divisor = plain_number(per, problem) if colon else 1.0
    if divisor == 0:
        raise ModelError(problem)
    return plain_number(turns, problem) / divisor


# ── Reader of actuator files: motors, gears, rotors, elastic joints, friction laws

_THERMAL = {
    "winding_housing": "thermal resistance", "housing_ambient": "thermal resistance", "winding_time": "time",
    "housing_time": "time", "maximum": "temperature", "coefficient": "", "reference": "temperature",
}  # fmt: skip
_ACTUATOR = (
    "ratio", "efficiency", "no_load_torque", "motor", "rotor", "reflected_inertia", "stiffness", "friction", "link_friction",
)  # fmt: skip
_COUPLED = ("ratio", "efficiency", "no_load_torque", "motor", "rotor", "reflected_inertia", "friction", "effort")
_COUPLING = ("motors", "joints", "motor_per_joint", "joint_per_motor")
_ROTOR = ("inertia", "extra", "mass", "link", "axis", "place")
_FRICTION = {"viscous": "viscous", "coulomb": "torque", "static": "torque", "stribeck": "speed", "load": ""}
_SLIDING = {
    "viscous": "viscous, sliding", "torque": "force", "speed": "speed, sliding", "stiffness": "stiffness, sliding",
    "inertia": "mass",
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class ActuatorFile:
    """Entries of an actuator file, read once, and the name of the file for messages.

    Its couplings, actuators and log columns are checked against a model by :func:`add_actuators` and :func:`read_log_side`.
    """

    content: Any
    origin: str

    @classmethod
    def from_source(cls, source: Source | ActuatorFile) -> ActuatorFile:
        """Read a path, YAML text or mapping. Raises NotFoundError, and ModelError for invalid YAML."""
        return source if isinstance(source, ActuatorFile) else cls(*read_yaml(source))

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
            raise ModelError(f"{self.origin} is {shown(self.content)}, expected entries 'name: value'.")
        return dict(self.content)


def add_actuators(model: Model, source: Source | ActuatorFile, *, stiff: bool = False) -> Model:
    """Add the actuators of a YAML file, YAML text or mapping to a model; ``stiff`` ignores elasticity.

    Raises :class:`~twistwrench.NotFoundError`, and :class:`~twistwrench.ModelError` with the file and the entry.
    """
    with ActuatorFile.from_source(source).section() as file:
        return _added(model, file, stiff)


def _added(model: Model, file: Section, stiff: bool) -> Model:
    check_entries(model, file)
    motors = _motors(file)
    model = with_couplings(model, read_couplings(model, file))
    if "actuators" not in file.content:
        raise ModelError("it has no entry 'actuators:' with the joints below it.")
    joints = file.section("actuators")
    sliding = {b.joint.name for b in model.leaders if b.joint.nv == 1 and not b.joint.turning[0]}
    actuators: list[Actuator] = []
    armature: dict[str, float] = {}
    effort = model.limits.effort.copy()
    bearings = {kind: getattr(model.limits, kind).copy() for kind in BEARINGS}
    laws: dict[str, dict[str, float]] = {}
    of_links: dict[str, dict[str, float]] = {}
    for name in joints.content:
        entry, k = joints.section(name), model.drive_index(name)
        if name in model.drive_names and name not in model.velocity_names:
            entry.only(*_COUPLED)
            if "effort" in entry.content:
                effort[k] = most = entry.number("effort", "torque")
                if not most > 0:
                    raise ModelError(f"{entry.where('effort')} is {printed(most)} N m; it must be above 0.")
        else:
            entry.only(*_ACTUATOR, *BEARINGS)
            for kind in set(BEARINGS) & set(entry.content):
                bearings[kind][k] = most = entry.number(kind, "torque" if kind == "tilting" else "force")
                if not most > 0:
                    raise ModelError(
                        f"{entry.where(kind)} is {printed(most)} {BEARING_UNITS[kind]}; it must be above 0."
                    )
        kinds = _SLIDING if name in sliding else {}
        actuators.append(_actuator(name, entry, motors, kinds))
        if "reflected_inertia" in entry.content:
            armature[name] = entry.number("reflected_inertia", kinds.get("inertia", "inertia"))
        for key, found in (("friction", laws), ("link_friction", of_links)):
            if key in entry.content:
                found[name] = _law(entry.section(key), kinds)
        if name in of_links:
            laws.setdefault(name, {})  # either entry replaces the friction of the robot file
    if stiff and (elastic := [a.joint for a in actuators if np.isfinite(a.stiffness)]):
        warnings.warn(f"the elastic gears of {', '.join(elastic)} are taken to be stiff.", ModelWarning, stacklevel=2)
        actuators = [replace(actuator, stiffness=np.inf) for actuator in actuators]
    model = replace(model, limits=replace(model.limits, effort=effort, **bearings))
    model = with_armature(with_friction(model, laws), armature)
    return with_link_friction(with_actuators(model, actuators), of_links)


def check_entries(model: Model, file: Section) -> None:
    """Raise ModelError for unknown entries, or if the file is for another robot."""
    file.only("robot", "motors", "couplings", "actuators", "log")
    if file.content.get("robot", model.name) != model.name:
        raise ModelError(f"it is for robot {shown(file.content['robot'])}, and this one is {model.name!r}.")


def read_couplings(model: Model, file: Section) -> list[Coupling]:
    """Couplings in a file. Raises ModelError for a matrix that is not square, is singular or is malformed."""
    found, sliding = [], {b.joint.name for b in model.leaders if b.joint.nv == 1 and not b.joint.turning[0]}
    listed = file.section("couplings") if "couplings" in file.content else Section({}, "couplings")
    for name in listed.content:
        entry = listed.section(name)
        entry.only(*_COUPLING)
        motors, joints = (_names(entry, key) for key in ("motors", "joints"))
        given = [key for key in _COUPLING[2:] if key in entry.content]
        if len(given) != 1:
            raise ModelError(
                f"{entry.path} has {'both motor_per_joint and' if given else 'neither motor_per_joint nor'} joint_per_motor. "
                "Give one of them: q̇_m = motor_per_joint q̇_j."
            )
        rows = entry.content[given[0]]
        where = entry.where(given[0])
        if not isinstance(rows, list | tuple) or not all(isinstance(row, list | tuple) for row in rows):
            raise ModelError(f"{where} is {shown(rows)}, expected rows of numbers such as [[1, 1], [1, -1]].")
        if len({*map(len, rows)}) > 1:
            raise ModelError(
                f"{where} has rows of {', '.join(str(len(row)) for row in rows)} numbers. Give equally many."
            )
        direct = given[0] == "motor_per_joint"
        A = np.array(
            [
                [
                    gear_ratio(x, where, sliding=joints[k] in sliding)
                    if direct and k < len(joints)
                    else plain_number(x, f"{where} has {shown(x)}, expected a plain number.")
                    for k, x in enumerate(row)
                ]
                for row in rows
            ]
        )
        found.append(Coupling(str(name), motors, joints, A, inverted=not direct))
    return found


def _names(entry: Section, key: str) -> tuple[str, ...]:
    """List of names under a key."""
    names = entry.content.get(key)
    if not isinstance(names, list | tuple) or not names or not all(isinstance(name, str) for name in names):
        raise ModelError(f"{entry.where(key)} is {shown(names)}, expected names in brackets such as [m5, m6].")
    return tuple(names)


def _law(section: Section, kinds: Mapping[str, str]) -> dict[str, float]:
    section.only(*_FRICTION)
    return {
        key: section.number(key, kinds.get(kind, kind)) for key, kind in _FRICTION.items() if key in section.content
    }


def _actuator(joint: str, entry: Section, motors: Mapping[str, Motor], kinds: Mapping[str, str]) -> Actuator:
    given: dict[str, Any] = {}
    given |= _ratio(entry, sliding=bool(kinds))
    if "efficiency" in entry.content:
        given["efficiency"] = plain_share(entry.content["efficiency"], entry.where("efficiency"))
    given |= entry.optional("no_load_torque", entry.number, "torque")
    given |= entry.optional("stiffness", entry.number, kinds.get("stiffness", "stiffness"))
    if (motor := _motor_of(entry, motors)) is not None:
        given["motor"] = motor
    if "rotor" in entry.content:
        given["rotor"] = _rotor(entry.section("rotor"))
    return Actuator(joint, **given)


def _ratio(entry: Section, *, sliding: bool) -> dict[str, float]:
    """Gear ratio of an actuator, if it is given."""
    return entry.optional("ratio", lambda key: gear_ratio(entry.content[key], entry.where(key), sliding=sliding))


def _motors(file: Section) -> dict[str, Motor]:
    listed = file.section("motors") if "motors" in file.content else Section({}, "motors")
    return {name: read_motor(listed.section(name)) for name in listed.content}


def _motor_of(entry: Section, motors: Mapping[str, Motor]) -> Motor | None:
    """Motor of an actuator, by name or by an inline description; None without a motor."""
    motor = entry.content.get("motor")
    if isinstance(motor, str) and motor not in motors:
        raise UnknownNameError.from_choices(f"motor (below 'motors:', wanted by {entry.path})", motor, motors)
    return None if motor is None else motors[motor] if isinstance(motor, str) else read_motor(entry.section("motor"))


def read_motor(section: Section, *others: str) -> Motor:
    """Motor of a section; ``others`` are additional allowed entries."""
    section.only(*RATINGS, "thermal", *others)
    if "torque_constant" not in section.content:
        raise ModelError(f"{section.path} has no torque_constant, without which no current follows from a torque.")
    thermal = _thermal(section.section("thermal")) if "thermal" in section.content else None
    given = {key: section.number(key, row.kind) for key, row in RATINGS.items() if key in section.content}
    return Motor(**given, thermal=thermal)


def _thermal(section: Section) -> Thermal:
    section.only(*_THERMAL)
    if lacking := [key for key in ("housing_ambient", "housing_time") if key not in section.content]:
        raise ModelError(f"{section.path} has no {lacking[0]}, without which no temperature follows.")
    return Thermal(**{key: section.number(key, _THERMAL[key]) for key in section.content})


def _rotor(section: Section) -> Rotor:
    section.only(*_ROTOR)
    if "inertia" not in section.content:
        raise ModelError(f"{section.path} has no inertia, which is all there is to a rotor.")
    said = section.content.get("extra", False)
    if not isinstance(said, str | bool) or str(said).lower() not in ("true", "false"):
        raise ModelError(f"{section.where('extra')} is {shown(said)}, expected true or false.")
    extra = str(said).lower() == "true"
    if "mass" in section.content and not extra:
        raise ModelError(
            f"{section.where('mass')} is of no use unless the rotor is extra: the link has weighed it already."
        )
    link = section.content.get("link")
    if link is not None and not isinstance(link, str):
        raise ModelError(f"{section.where('link')} is {shown(link)}, expected the name of a link.")
    more = section.optional("axis", section.vector, "") | section.optional("place", section.vector, "length")
    mass = section.optional("mass", section.number, "mass")
    return Rotor(inertia=section.number("inertia", "inertia"), extra=extra, link=link, **mass, **more)


def plain_share(value: object, where: str) -> float:
    """Parse a plain number or a percentage."""
    problem = f"{where} is {shown(value)}, expected a number such as 0.75, or 75 %."
    if isinstance(value, str) and value.rstrip().endswith("%"):
        return plain_number(value.rstrip()[:-1], problem) / 100
    return plain_number(value, problem)


# ── Log columns of an actuator file


@dataclass(frozen=True)
class LogSide:
    """Properties of log columns in an actuator file, by joint."""

    of_motors: bool
    """True if positions and torques are those of the motors, before the gears."""
    ratios: Mapping[str, float]
    coupled: Mapping[str, Mapping[str, float]]
    """Rotation of a joint's motor per rotation of other joints."""
    zero: Mapping[str, float]
    """Joint position at zero of the log [rad or m]."""
    sign: Mapping[str, float]
    gain: Mapping[str, float]
    """Torque or force of the motor, or of the joint, per unit of the column [N m or N]."""
    of_currents: Mapping[str, float]
    """Torque per ampere of current columns [N m/A]: :attr:`gain` or torque constant; times ratio, on the joint side."""
    couplings: tuple[Coupling, ...] = ()
    """Coupled motors; ratios, signs and gains use motor names, zeros use joint names."""


def read_log_side(model: Model, source: Source | ActuatorFile) -> LogSide:
    """Read the entry ``log:`` of an actuator file and the gear ratios; defaults without that entry.

    Raises :class:`~twistwrench.NotFoundError`, and :class:`~twistwrench.ModelError` with the file and the entry.
    """
    with ActuatorFile.from_source(source).section() as file:
        return _log_side(model, file)


def _log_side(model: Model, file: Section) -> LogSide:
    check_entries(model, file)
    couplings = tuple(read_couplings(model, file))
    together = {motor for c in couplings for motor in c.motors}
    coupled = {joint for c in couplings for joint in c.joints}
    with_couplings(without_couplings(model), couplings)  # raises an error for missing joints
    names = (*model.velocity_names, *sorted(together))
    sliding = {b.joint.name for b in model.leaders if b.joint.nv == 1 and not b.joint.turning[0]}
    listed, motors = (
        file.section("actuators") if "actuators" in file.content else Section({}, "actuators"),
        _motors(file),
    )
    entries = {name: listed.section(name) for name, entry in listed.content.items() if isinstance(entry, Mapping)}
    given_ratios = {name: _ratio(entry, sliding=name in sliding) for name, entry in entries.items()}
    ratios = {name: found["ratio"] for name, found in given_ratios.items() if found}
    constants = {name: motor.torque_constant for name, entry in entries.items() if (motor := _motor_of(entry, motors))}
    log = file.section("log") if "log" in file.content else Section({}, "log")
    log.only("side", "joints")
    side = log.content.get("side", "joint")
    if side not in ("joint", "motor"):
        raise ModelError(f"log → side is {shown(side)}, expected joint or motor.")
    joints = log.section("joints") if "joints" in log.content else Section({}, "log → joints")
    given: dict[str, dict[str, Any]] = {"coupled": {}, "zero": {}, "sign": {}, "gain": {}}
    for name in joints.content:
        if name not in names:
            raise UnknownNameError.from_choices("joint", name, names)
        entry = joints.section(name)
        entry.only(*(("sign", "gain") if name in together else ("zero",) if name in coupled else given))
        if name in together and side == "joint":
            raise ModelError(
                f"{entry.path} is a coupled motor, and the log has the side of the joints. Say side: motor."
            )
        if "coupled" in entry.content:
            others = entry.section("coupled")
            for other in others.content:
                if other not in names or other == name:
                    raise UnknownNameError.from_choices("other joint", other, [n for n in names if n != name])
            given["coupled"][name] = {
                o: gear_ratio(others.content[o], others.where(o), sliding=o in sliding) for o in others.content
            }
        kinds = {"zero": "length" if name in sliding else "angle", "gain": "torque constant", "sign": ""}
        for key, kind in kinds.items():
            given[key] |= {name: entry.number(key, kind)} if key in entry.content else {}
        if abs(sign := given["sign"].get(name, 1.0)) != 1.0:
            raise ModelError(f"{entry.where('sign')} is {printed(sign)}, expected 1 or -1.")
    geared = {name: k * (1.0 if side == "motor" else ratios.get(name, 1.0)) for name, k in constants.items()}
    return LogSide(side == "motor", ratios, **given, of_currents=geared | given["gain"], couplings=couplings)
