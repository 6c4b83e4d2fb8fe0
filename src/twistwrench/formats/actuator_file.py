"""The file for what URDF cannot say: motors, gears, rotors, elastic joints, friction laws. YAML, every number with its unit."""

from __future__ import annotations

import os
import reprlib
import warnings
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..core.files import is_stream, read_text
from ..core.foreign_errors import foreign_errors
from ..errors import ModelError, ModelWarning, NotFoundError, UnknownNameError, ValueRangeError
from ..model.actuation import with_actuators, with_friction, with_link_friction
from ..model.actuator import Actuator, Motor, Rotor
from ..model.edit import with_armature
from ..model.model import Model
from .units import in_si

Source = str | os.PathLike[str] | Mapping[str, Any]

_MOTOR = {
    "torque_constant": "torque constant", "resistance": "resistance", "inductance": "inductance", "voltage": "voltage",
    "current_continuous": "current", "current_peak": "current", "speed": "rotor speed",
}  # fmt: skip
_ACTUATOR = ("ratio", "efficiency", "motor", "rotor", "reflected_inertia", "stiffness", "friction", "link_friction")
_ROTOR = ("inertia", "extra", "mass", "link", "axis", "place")
_FRICTION = {"viscous": "viscous", "coulomb": "torque", "static": "torque", "stribeck": "speed", "load": ""}
_SLIDING = {
    "viscous": "viscous, sliding", "torque": "force", "speed": "speed, sliding", "stiffness": "stiffness, sliding",
    "inertia": "mass",
}  # fmt: skip


_MOST_BYTES = 2**18
"""Larger files are refused: YAML is read slowly, and a robot of a hundred motors takes 40 kB."""
_MOST_LEVELS = 50
"""Deeper nesting is refused; an actuator file needs five levels, and YAML takes quadratic time for more."""


def add_actuators(model: Model, source: Source, *, stiff: bool = False) -> Model:
    """The model with the actuators of a YAML file, of YAML text, or of such a mapping; ``stiff`` leaves elasticity out.

    Raises :class:`~twistwrench.NotFoundError`, and :class:`~twistwrench.ModelError` naming the file and the entry.
    """
    content, origin = _read(source)
    try:
        return _added(model, _Section(content, ""), stiff)
    except (ModelError, UnknownNameError, ValueRangeError) as error:
        raise type(error)(f"{origin}: {error}") from None


def actuator_content(source: Source) -> dict[str, Any]:
    """What an actuator file says, as text in mappings. Raises NotFoundError, and ModelError for what is no YAML."""
    content, origin = _read(source)
    if not isinstance(content, Mapping):
        raise ModelError(f"{origin} is {_shown(content)}, expected entries 'name: value'.")
    return dict(content)


def _read(source: Source) -> tuple[object, str]:
    if isinstance(source, Mapping):
        return source, "the actuators given"
    if not isinstance(source, str | os.PathLike):
        raise ModelError(f"actuators come from a path, YAML text or a mapping, not from {type(source).__name__}.")
    text, origin = str(source), "the text given"
    if "\n" not in text and ":" not in Path(text).name:
        path = Path(source)
        try:
            found = path.is_file() or is_stream(path)
        except (OSError, ValueError):
            found = False
        if not found:
            raise NotFoundError(
                f"no actuator file {text[:200]!r}. It is YAML with an entry 'actuators:', and the joints below it."
            )
        origin = str(path)
        with foreign_errors(lambda reason: ModelError(f"cannot read {origin!r}: {reason}.")):
            text = read_text(path, _MOST_BYTES)
    return _parsed(text, origin), origin


def _parsed(text: str, origin: str) -> object:
    """The text's mappings, lists and strings: YAML itself would read 101:1 as a number to the base of sixty."""
    import yaml

    def no_deeper(levels: int) -> None:
        if levels > _MOST_LEVELS:
            raise ModelError(
                f"{origin} nests its entries more than {_MOST_LEVELS} deep. An actuator file needs five levels."
            )

    class Loader(yaml.BaseLoader):
        def fetch_flow_collection_start(self, TokenClass: Any) -> None:
            no_deeper(self.flow_level)
            super().fetch_flow_collection_start(TokenClass)

        def add_indent(self, column: int) -> bool:
            no_deeper(len(self.indents))
            return bool(super().add_indent(column))

        def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
            keys = Counter(key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode))
            if twice := sorted(key for key, count in keys.items() if count > 1):
                line = node.start_mark.line + 1
                raise ModelError(f"{origin}, line {line}: {', '.join(twice)} given twice. Keep one of them.")
            return super().construct_mapping(node, deep)

    with foreign_errors(lambda reason: ModelError(f"{origin} is no YAML: {reason}.")):
        return yaml.load(text, Loader)  # a BaseLoader makes nothing but text


def _shown(value: object) -> str:
    """What stands there, shortened: with aliases a short file may mean a value of endless length."""
    short = reprlib.Repr()
    short.maxlevel, short.maxstring, short.maxother = 2, 60, 60
    return short.repr(value)


@dataclass(frozen=True)
class _Section:
    """A mapping of the file, and the path of keys that leads to it."""

    content: Any
    path: str
    taken: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        if not isinstance(self.content, Mapping):
            raise ModelError(f"{self.path or 'the file'} is {_shown(self.content)}, expected entries 'name: value'.")

    def where(self, key: str) -> str:
        return f"{self.path} → {key}" if self.path else key

    def only(self, *allowed: str) -> None:
        for key in self.content:
            if key not in allowed:
                raise UnknownNameError.of(f"entry of {self.path or 'an actuator file'}", key, allowed)

    def section(self, key: str) -> _Section:
        return _Section(self.content[key], self.where(key))

    def number(self, key: str, kind: str) -> float:
        """A number with a unit; with no unit at all where ``kind`` is empty."""
        value = self.content[key]
        if kind:
            return in_si(value, kind, self.where(key))
        return _plain(value, f"{self.where(key)} is {_shown(value)}, expected a plain number.")

    def vector(self, key: str, kind: str) -> Any:
        values = self.content[key]
        if isinstance(values, str | Mapping) or np.ndim(np.asarray(values, object)) != 1 or len(values) != 3:
            raise ModelError(f"{self.where(key)} is {_shown(values)}, expected three entries in brackets.")
        items = _Section({str(k): v for k, v in zip("xyz", values, strict=True)}, self.where(key))
        return np.array([items.number(k, kind) for k in "xyz"])

    def optional(self, key: str, get: Callable[..., Any], *args: Any) -> dict[str, Any]:
        return {key: get(key, *args)} if key in self.content else {}


def _added(model: Model, file: _Section, stiff: bool) -> Model:
    _check_whole(model, file)
    motors = _motors(file.section("motors")) if "motors" in file.content else {}
    if "actuators" not in file.content:
        raise ModelError("it has no entry 'actuators:' with the joints below it.")
    joints = file.section("actuators")
    sliding = {b.joint.name for b in model.leaders if b.joint.nv == 1 and not b.joint.turning[0]}
    actuators: list[Actuator] = []
    armature: dict[str, float] = {}
    laws: dict[str, dict[str, float]] = {}
    of_links: dict[str, dict[str, float]] = {}
    for name in joints.content:
        entry = joints.section(name)
        entry.only(*_ACTUATOR)
        kinds = _SLIDING if name in sliding else {}
        actuators.append(_actuator(name, entry, motors, kinds))
        if "reflected_inertia" in entry.content:
            armature[name] = entry.number("reflected_inertia", kinds.get("inertia", "inertia"))
        for key, found in (("friction", laws), ("link_friction", of_links)):
            if key in entry.content:
                found[name] = _law(entry.section(key), kinds)
        if name in of_links:
            laws.setdefault(name, {})  # either entry replaces all that the robot file says
    if stiff and (elastic := [a.joint for a in actuators if np.isfinite(a.stiffness)]):
        warnings.warn(f"the elastic gears of {', '.join(elastic)} are taken to be stiff.", ModelWarning, stacklevel=2)
        actuators = [replace(actuator, stiffness=np.inf) for actuator in actuators]
    model = with_armature(with_friction(model, laws), armature)
    return with_link_friction(with_actuators(model, actuators), of_links)


def _check_whole(model: Model, file: _Section) -> None:
    file.only("robot", "motors", "actuators", "log")
    if file.content.get("robot", model.name) != model.name:
        raise ModelError(f"it is for robot {_shown(file.content['robot'])}, and this one is {model.name!r}.")


@dataclass(frozen=True)
class LogSide:
    """What an actuator file says of the columns of logs, by joint."""

    of_motors: bool
    """Whether positions and torques are those of the motors, before their gears."""
    ratios: Mapping[str, float]
    coupled: Mapping[str, Mapping[str, float]]
    """Turns of a joint's motor per turn of other joints."""
    zero: Mapping[str, float]
    """Position of the joint where the log says 0 [rad or m]."""
    sign: Mapping[str, float]
    gain: Mapping[str, float]
    """N m (or N) of the motor, or of the joint, per unit of the column."""


def read_log_side(model: Model, source: Source) -> LogSide:
    """The entry ``log:`` of an actuator file, and the ratios of its actuators; nothing special where there is no entry.

    Raises :class:`~twistwrench.NotFoundError`, and :class:`~twistwrench.ModelError` naming the file and the entry.
    """
    content, origin = _read(source)
    try:
        return _log_side(model, _Section(content, ""))
    except (ModelError, UnknownNameError, ValueRangeError) as error:
        raise type(error)(f"{origin}: {error}") from None


def _log_side(model: Model, file: _Section) -> LogSide:
    _check_whole(model, file)
    names = model.velocity_names
    sliding = {b.joint.name for b in model.leaders if b.joint.nv == 1 and not b.joint.turning[0]}
    actuators = file.section("actuators").content if "actuators" in file.content else {}
    ratios = {
        name: _ratio(entry["ratio"], f"actuators → {name} → ratio", sliding=name in sliding)
        for name, entry in actuators.items()
        if isinstance(entry, Mapping) and "ratio" in entry
    }
    log = file.section("log") if "log" in file.content else _Section({}, "log")
    log.only("side", "joints")
    side = log.content.get("side", "joint")
    if side not in ("joint", "motor"):
        raise ModelError(f"log → side is {_shown(side)}, expected joint or motor.")
    joints = log.section("joints") if "joints" in log.content else _Section({}, "log → joints")
    given: dict[str, dict[str, Any]] = {"coupled": {}, "zero": {}, "sign": {}, "gain": {}}
    for name in joints.content:
        if name not in names:
            raise UnknownNameError.of("joint", name, names)
        entry = joints.section(name)
        entry.only(*given)
        if "coupled" in entry.content:
            others = entry.section("coupled")
            for other in others.content:
                if other not in names or other == name:
                    raise UnknownNameError.of("other joint", other, [n for n in names if n != name])
            given["coupled"][name] = {
                o: _ratio(others.content[o], others.where(o), sliding=o in sliding) for o in others.content
            }
        given["zero"] |= (
            {name: entry.number("zero", "length" if name in sliding else "angle")} if "zero" in entry.content else {}
        )
        given["gain"] |= {name: entry.number("gain", "torque constant")} if "gain" in entry.content else {}
        if "sign" in entry.content:
            sign = entry.number("sign", "")
            if abs(sign) != 1.0:
                raise ModelError(f"{entry.where('sign')} is {sign:g}, expected 1 or -1.")
            given["sign"][name] = sign
    return LogSide(side == "motor", ratios, given["coupled"], given["zero"], given["sign"], given["gain"])


def _law(section: _Section, kinds: Mapping[str, str]) -> dict[str, float]:
    section.only(*_FRICTION)
    return {
        key: section.number(key, kinds.get(kind, kind)) for key, kind in _FRICTION.items() if key in section.content
    }


def _actuator(joint: str, entry: _Section, motors: Mapping[str, Motor], kinds: Mapping[str, str]) -> Actuator:
    given: dict[str, Any] = {}
    if "ratio" in entry.content:
        given["ratio"] = _ratio(entry.content["ratio"], entry.where("ratio"), sliding=bool(kinds))
    if "efficiency" in entry.content:
        given["efficiency"] = _share(entry.content["efficiency"], entry.where("efficiency"))
    given |= entry.optional("stiffness", entry.number, kinds.get("stiffness", "stiffness"))
    motor = entry.content.get("motor")
    if isinstance(motor, str):
        if motor not in motors:
            raise UnknownNameError.of(f"motor (below 'motors:', wanted by {entry.path})", motor, motors)
        given["motor"] = motors[motor]
    elif motor is not None:
        given["motor"] = _motor(entry.section("motor"))
    if "rotor" in entry.content:
        given["rotor"] = _rotor(entry.section("rotor"))
    return Actuator(joint, **given)


def _motors(section: _Section) -> dict[str, Motor]:
    return {name: _motor(section.section(name)) for name in section.content}


def _motor(section: _Section) -> Motor:
    section.only(*_MOTOR)
    if "torque_constant" not in section.content:
        raise ModelError(f"{section.path} has no torque_constant, without which no current follows from a torque.")
    return Motor(**{key: section.number(key, _MOTOR[key]) for key in section.content})


def _rotor(section: _Section) -> Rotor:
    section.only(*_ROTOR)
    if "inertia" not in section.content:
        raise ModelError(f"{section.path} has no inertia, which is all there is to a rotor.")
    said = section.content.get("extra", False)
    if not isinstance(said, str | bool) or str(said).lower() not in ("true", "false"):
        raise ModelError(f"{section.where('extra')} is {_shown(said)}, expected true or false.")
    extra = str(said).lower() == "true"
    if "mass" in section.content and not extra:
        raise ModelError(
            f"{section.where('mass')} is of no use unless the rotor is extra: the link has weighed it already."
        )
    link = section.content.get("link")
    if link is not None and not isinstance(link, str):
        raise ModelError(f"{section.where('link')} is {_shown(link)}, expected the name of a link.")
    return Rotor(
        inertia=section.number("inertia", "inertia"),
        extra=extra,
        link=link,
        **section.optional("mass", section.number, "mass"),
        **section.optional("axis", section.vector, ""),
        **section.optional("place", section.vector, "length"),
    )


def _share(value: object, where: str) -> float:
    """A plain number, or a percentage."""
    problem = f"{where} is {_shown(value)}, expected a number such as 0.75, or 75 %."
    if isinstance(value, str) and value.rstrip().endswith("%"):
        return _plain(value.rstrip()[:-1], problem) / 100
    return _plain(value, problem)


_LEADS: dict[str, Callable[[float], float]] = {
    "rad/m": lambda x: x,
    "mm/turn": lambda x: 2e3 * np.pi / x,
    "m/turn": lambda x: 2 * np.pi / x,
}
"""Rotor radians per metre, from what a spindle or a rack is described by."""


def _ratio(value: object, where: str, *, sliding: bool) -> float:
    """A plain number, or ``101:1``; at a sliding joint a plain number of rad/m, or with one of the units of leads."""
    if sliding and isinstance(value, str):
        for unit, per_metre in _LEADS.items():
            if value.rstrip().endswith(unit):
                problem = f"{where} is {_shown(value)}, expected a number before {unit}."
                number = _plain(value.rstrip()[: -len(unit)], problem)
                if number == 0:
                    raise ModelError(problem)
                return float(per_metre(number))
    units = f", or with one of {', '.join(_LEADS)}" if sliding else ", or 101:1"
    problem = f"{where} is {_shown(value)}, expected a number such as 101{units}."
    turns, colon, per = value.partition(":") if isinstance(value, str) else (value, "", "")
    divisor = _plain(per, problem) if colon else 1.0
    if divisor == 0:
        raise ModelError(problem)
    return _plain(turns, problem) / divisor


def _plain(value: object, problem: str) -> float:
    """A number that is finite, or text of one; booleans and Python's 1_0 are none."""
    try:
        if isinstance(value, bool) or (isinstance(value, str) and "_" in value):
            raise ValueError  # noqa: TRY301  one sentence answers all of it
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        raise ModelError(problem) from None
    if not np.isfinite(number):
        raise ModelError(problem)
    return number
