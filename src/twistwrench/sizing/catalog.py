"""Catalogues of motors and gears: YAML with the units of actuator files, and a table of servos."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import product
from typing import Any

from ..core.errors import ModelError, UnknownNameError, ValueRangeError
from ..core.numbers import printed
from ..formats.actuators import gear_ratio, plain_share, read_motor
from ..formats.yaml import Section, Source, read_yaml, short_text
from ..mechanics.model.actuators import Actuator, Motor, check_actuator
from ..mechanics.model.limits import BEARINGS
from .drives import CatalogMotor
from .gear import KINDS, Gear

Pair = tuple[str, str]
"""Names of a motor and its gear. A servo has the gear ``DIRECT``, since its data apply to its output."""

DIRECT = "none"
"""Name of the identity gear, for direct drives."""

_GEAR_UNITS = {  # kind of quantity of each number, for its unit; "" for numbers without unit
    "no_load_torque": "torque", "mass": "mass", "price": "", "rated_torque": "torque", "rated_speed": "rotor speed",
    "average_torque": "torque", "repeated_peak": "torque", "momentary_peak": "torque", "average_speed": "rotor speed",
    "maximum_speed": "rotor speed", "life": "life", "mean_exponent": "", "axial": "force", "radial": "force",
    "tilting": "torque",
}  # fmt: skip
_COSTS_OF_GEAR = ("efficiency", "no_load_torque", "mass", "mean_exponent")
"""Numbers without which a gear looks better than it is; reports name them as missing."""
_MAY_BE_ZERO = ("no_load_torque", "mass", "price")
"""Numbers of a gear that may be zero; the others must be above zero."""
_SERVO_UNITS = {
    "stall_torque": "torque",
    "stall_current": "current",
    "no_load_speed": "rotor speed",
    "voltage": "voltage",
}
"""Kind of quantity of each number of a servo, for its unit."""

SERVOS: Mapping[str, Mapping[str, str]] = {
    "XM540-W150": {"stall_torque": "7.3 N m", "stall_current": "4.4 A", "no_load_speed": "53 rpm", "voltage": "12 V"},
    "XM540-W270": {"stall_torque": "10.6 N m", "stall_current": "4.4 A", "no_load_speed": "30 rpm", "voltage": "12 V"},
    "XH540-V150": {"stall_torque": "6.4 N m", "stall_current": "2.4 A", "no_load_speed": "60 rpm", "voltage": "24 V"},
    "XC330-M181": {"stall_torque": "0.60 N m", "stall_current": "1.8 A", "no_load_speed": "129 rpm", "voltage": "5 V"},
    "AX-12A": {"stall_torque": "1.5 N m", "stall_current": "1.5 A", "no_load_speed": "59 rpm", "voltage": "12 V"},
    "STS3215": {"stall_torque": "30 kgf cm", "no_load_speed": "45 rpm", "voltage": "12 V"},
}
"""Data of servos from their makers, at the given voltage: ROBOTIS e-Manual; Feetech.

A servo cannot hold its stall torque for long: an STS3215 held 15 kgf cm for an hour at 48 °C, and was overloaded at 20 kgf cm
(TheRobotStudio/SO-ARM100#134)."""


@dataclass(frozen=True)
class Catalog:
    """Motors, gears and allowed pairs.

    Examples
    --------
    >>> servos = read_catalog("servos")
    >>> len(servos.pairs), round(servos.motors["STS3215"].motor.torque_constant, 3)
    (6, 2.546)
    """

    motors: Mapping[str, CatalogMotor]
    gears: Mapping[str, Gear]
    pairs: tuple[Pair, ...]
    drives: Mapping[str, Pair] = field(default_factory=dict)
    """Pairs of joints that already have a drive."""

    @property
    def bears(self) -> bool:
        """True if a gear has limits of its bearing."""
        return any(math.isfinite(getattr(gear, kind)) for gear in self.gears.values() for kind in BEARINGS)

    def pair(self, names: Pair) -> tuple[CatalogMotor, Gear]:
        """Motor and gear with the given names."""
        motor_name, gear_name = names
        return self.motors[motor_name], self.gears[gear_name]

    def size(self, names: Pair) -> tuple[float, float, float]:
        """Sort key of a pair for the choice of the smallest: mass, price, rated torque."""
        motor, gear = self.pair(names)
        torque = gear.repeated_peak
        if not math.isfinite(torque):  # without a rating: torque at the gear's output for 1 A
            torque = motor.motor.torque_constant * gear.ratio
        return motor.mass + gear.mass, motor.price + gear.price, torque


def read_catalog(source: Source | Catalog) -> Catalog:
    """Catalogue from a file, YAML text, a mapping, or ``"servos"``, the bundled table.

    Raises
    ------
    NotFoundError, ModelError, UnknownNameError, ValueRangeError
        The message names the file and the entry.
    """
    if isinstance(source, Catalog):
        return source
    content: object = {"motors": SERVOS}
    origin = "the table of servos"
    if source != "servos":
        content, origin = read_yaml(source, "catalogue", "motors")
    try:
        return _catalog(Section(content, ""))
    except (ModelError, UnknownNameError, ValueRangeError) as error:
        raise type(error)(f"{origin}: {error}") from None


def _catalog(file: Section) -> Catalog:
    """Catalogue from the top level of a file."""
    file.only("robot", "motors", "gears", "pairs", "actuators")
    if not file.content.get("motors"):
        raise ModelError("it has no entry 'motors:' with the motors of the catalogue below it.")
    motors_section = file.section("motors")
    motors = {str(name): _motor(str(name), motors_section.section(name)) for name in motors_section.content}
    gears = {DIRECT: Gear(DIRECT, "direct")}
    if "gears" in file.content:
        gears_section = file.section("gears")
        gears |= {str(name): _gear(str(name), gears_section.section(name)) for name in gears_section.content}
    pairs: list[Pair] = []
    if "pairs" in file.content:
        pairs += _pairs(file, motors, gears)
    if not pairs:  # each servo without a gear, and each motor with each gear
        for motor_name, gear_name in product(motors, gears):
            is_servo = motors[motor_name].stall_only
            is_direct = gear_name == DIRECT
            if is_servo == is_direct:
                pairs.append((motor_name, gear_name))
    drives: dict[str, Pair] = {}
    if "actuators" in file.content:
        drives.update(_drives(file, motors, gears))
    if not pairs and not drives:
        raise ModelError("it has no entry 'gears:' with the gears that go with its motors.")
    return Catalog(motors, gears, tuple(pairs), drives)


def _motor(name: str, section: Section) -> CatalogMotor:
    """Motor from its entry; a servo becomes the motor with its speed–torque line and its stall torque."""
    fields: dict[str, Any] = section.optional("mass", section.number, "mass")
    fields |= section.optional("price", section.number, "")
    fields["unstated"] = frozenset({"mass"} - set(section.content))
    is_servo = "stall_torque" in section.content
    if is_servo:
        section.only(*_SERVO_UNITS, "mass", "price")
        for key in ("no_load_speed", "voltage"):
            if key not in section.content:
                raise ModelError(f"{section.path} has a stall_torque and no {key}, so it has no speed–torque line.")
        keys = ("stall_torque", "no_load_speed", "voltage")
        stall_torque, no_load_speed, voltage = (section.number(key, _SERVO_UNITS[key]) for key in keys)
        if not min(stall_torque, no_load_speed, voltage) > 0:
            raise ModelError(f"{section.path}: stall torque, no-load speed and voltage must be above 0.")
        # ends of the speed–torque line: no-load speed = voltage / constant, stall torque = constant * voltage / resistance
        constant = voltage / no_load_speed
        resistance = constant * voltage / stall_torque
        motor = Motor(constant, resistance, voltage=voltage, current_peak=stall_torque / constant)
        return _check_motor(CatalogMotor(name, motor, stall_only=True, **fields), section)
    motor = read_motor(section, "mass", "price", "rotor")
    inertia = 0.0
    if "rotor" in section.content:
        rotor = section.section("rotor")
        rotor.only("inertia")
        if "inertia" in rotor.content:
            inertia = rotor.number("inertia", "inertia")
        if not inertia > 0:
            raise ModelError(f"{rotor.where('inertia')} must be given and be above 0.")
    return _check_motor(CatalogMotor(name, motor, inertia, **fields), section)


def _check_motor(motor: CatalogMotor, section: Section) -> CatalogMotor:
    """The motor itself; raises ModelError if a number of its entry has the wrong sign."""
    check_actuator(Actuator(section.path, motor=motor.motor))
    _check_signs({"mass": motor.mass, "price": motor.price}, section, zero_allowed=True)
    return motor


def _gear(name: str, section: Section) -> Gear:
    """Gear from its entry."""
    section.only("kind", "ratio", "efficiency", *_GEAR_UNITS)
    if "ratio" not in section.content:
        raise ModelError(f"{section.path} has no ratio, such as ratio: 100.")
    kind = section.content.get("kind", "strain_wave")
    if not isinstance(kind, str) or kind not in KINDS:
        raise UnknownNameError.from_choices(f"kind of gear ({section.path})", str(kind), KINDS)
    ratio = gear_ratio(section.content["ratio"], section.where("ratio"), sliding=False)
    efficiency = section.optional("efficiency", lambda key: plain_share(section.content[key], section.where(key)))
    check_actuator(Actuator(section.path, ratio=ratio, **efficiency))  # efficiency: a mapping, empty if not given
    numbers = {key: section.number(key, unit) for key, unit in _GEAR_UNITS.items() if key in section.content}
    costs = {key: number for key, number in numbers.items() if key in _MAY_BE_ZERO}
    ratings = {key: number for key, number in numbers.items() if key not in _MAY_BE_ZERO}
    _check_signs(costs, section, zero_allowed=True)
    _check_signs(ratings, section, zero_allowed=False)
    unstated = frozenset(key for key in _COSTS_OF_GEAR if key not in section.content)
    return Gear(name, kind, ratio, **efficiency, **numbers, unstated=unstated)


def _check_signs(numbers: Mapping[str, float], section: Section, *, zero_allowed: bool) -> None:
    """Raise ModelError if a number is negative, or zero unless that is allowed."""
    for key, number in numbers.items():
        if number < 0 or (number == 0 and not zero_allowed):
            bound = "at least" if zero_allowed else "above"
            raise ModelError(f"{section.where(key)} is {printed(number)}; it must be {bound} 0.")


def _pairs(file: Section, motors: Mapping[str, Any], gears: Mapping[str, Any]) -> Iterator[Pair]:
    """Pairs that the file lists; raises ModelError if an entry is not a pair."""
    entries = file.content["pairs"]
    if isinstance(entries, str | Mapping) or not hasattr(entries, "__iter__"):
        raise ModelError(f"pairs is {short_text(entries)}, expected pairs such as [[B, G], [C, G]].")
    for entry in entries:
        is_pair = not isinstance(entry, str) and hasattr(entry, "__len__") and len(entry) == 2
        if not is_pair:
            raise ModelError(f"pairs has {short_text(entry)}, expected a motor and a gear, such as [B, G].")
        yield _check_pair(str(entry[0]), str(entry[1]), motors, gears)


def _drives(file: Section, motors: Mapping[str, Any], gears: Mapping[str, Any]) -> Iterator[tuple[str, Pair]]:
    """Joints that already have a drive, with its motor and gear."""
    joints = file.section("actuators")
    for joint in joints.content:
        entry = joints.section(joint)
        entry.only("motor", "gear")
        if "motor" not in entry.content:
            raise ModelError(f"{entry.path} has no motor.")
        motor = str(entry.content["motor"])
        gear = str(entry.content.get("gear", DIRECT))
        yield joint, _check_pair(motor, gear, motors, gears)


def _check_pair(motor: str, gear: str, motors: Mapping[str, Any], gears: Mapping[str, Any]) -> Pair:
    """Pair of the two names; raises UnknownNameError if the catalogue lacks the motor or the gear."""
    for part, name, choices in (("motor", motor, motors), ("gear", gear, gears)):
        if name not in choices:
            raise UnknownNameError.from_choices(f"{part} of the catalogue", name, choices)
    return motor, gear
