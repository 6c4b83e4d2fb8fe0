"""Actuator of a joint: motor, rotor, gear and spring, with validation of the numbers. Modern Robotics section 8.9."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...core.errors import ValueRangeError
from ...core.numbers import printed
from ...core.typing import Array

__all__ = ["Actuator", "Motor", "Rotor", "Thermal"]

STANDING = 1e-6
"""Largest speed [rad/s or m/s] of a joint that stands: a turn in ten weeks, above rounding errors of computed velocities."""


def moving(velocity: ArrayLike) -> Array:
    """Velocities, 0 for standing joints, so that rounding errors do not determine a direction.

    >>> moving([0.3, -1e-13]).tolist()
    [0.3, 0.0]
    """
    dq = np.asarray(velocity)
    return np.where(np.abs(dq) > STANDING, dq, 0.0)


def gear_input(torque: ArrayLike, velocity: ArrayLike, efficiency: ArrayLike) -> Array:
    """Torque before a gear, referred to its output: T/η if the motor drives or the joint stands, T η if the load drives.

    At rest the friction of the gear may help or hinder; T/η is the larger of the two.

    >>> gear_input([10.0, -10.0, 10.0, 10.0], [1.0, 1.0, 0.0, -1e-13], 0.8).tolist()
    [12.5, -8.0, 12.5, 12.5]
    """
    T = np.asarray(torque)
    eta = np.asarray(efficiency)
    power = T * moving(velocity)
    return np.where(power < 0, T * eta, T / eta)


@dataclass(frozen=True)
class Thermal:
    """Thermal two-mass model of a motor, winding and housing; a single mass if ``winding_housing`` is 0."""

    housing_ambient: float
    """Thermal resistance from the housing to the air [K/W]."""
    housing_time: float
    """Time constant of the housing [s]."""
    winding_housing: float = 0.0
    """Thermal resistance from the winding to the housing [K/W]."""
    winding_time: float = 0.0
    """Time constant of the winding [s]."""
    maximum: float = np.inf
    """Highest temperature of the winding [°C]."""
    coefficient: float = 0.0039
    """Temperature coefficient of the resistance [1/K]; default: copper."""
    reference: float = 20.0
    """Temperature at which the resistance is given [°C]."""


class Rating(NamedTuple):
    """Names of one number of a motor's data sheet, in files, tables and messages."""

    kind: str
    """Kind of its unit: a key of ``UNITS`` of :mod:`twistwrench.formats.yaml`."""
    head: str = ""
    """Head of its column in tables; empty if tables leave it out."""
    load: str = ""
    """Load that the number bounds, such as ``peak current``; empty if it bounds none."""


RATINGS = {  # kind, head, load
    "torque_constant": Rating("torque constant", "k_t"),
    "resistance": Rating("resistance", "R"),
    "inductance": Rating("inductance"),
    "voltage": Rating("voltage", "V", "voltage"),
    "current_continuous": Rating("current", "A", "rms current"),
    "current_peak": Rating("current", "A peak", "peak current"),
    "speed": Rating("rotor speed", "speed", "speed"),
}
"""Numbers of a :class:`Motor`, by the names of its fields, which are also their names in actuator files."""


@dataclass(frozen=True)
class Motor:
    """Direct-current motor, or the equivalent one of a servo motor. MR section 8.9.1.

    Examples
    --------
    >>> motor = Motor(torque_constant=0.1, resistance=0.5, voltage=48.0, current_peak=20.0)
    >>> round(float(motor.voltage_at(current=10.0, speed=200.0)), 9)
    25.0
    >>> round(float(motor.greatest_torque(speed=430.0)), 9)  # the voltage, not the current, is the limit here
    1.0
    >>> float(motor.current(torque=0.5)), float(motor.heat(current=10.0))
    (5.0, 50.0)
    """

    torque_constant: float
    """Torque constant k_t [N m/A or V s/rad]."""
    resistance: float = 0.0
    """Terminal resistance R [ohm]."""
    inductance: float = 0.0
    """Inductance L [H]."""
    voltage: float = np.inf
    """Supply voltage [V]."""
    current_continuous: float = np.inf
    """Continuous current [A]."""
    current_peak: float = np.inf
    """Peak current of the motor or its amplifier [A]."""
    speed: float = np.inf
    """Largest speed of bearings and rotor [rad/s]."""
    thermal: Thermal | None = None
    """Thermal data; None if unknown."""

    def current(self, torque: ArrayLike) -> Array:
        """Current for a torque, i = τ / k_t.

        Parameters
        ----------
        torque : (...) array_like, at the rotor [N m]

        Returns
        -------
        current : (...) array [A]
        """
        return np.asarray(torque, float) / self.torque_constant

    def voltage_at(self, current: ArrayLike, speed: ArrayLike, current_rate: ArrayLike = 0.0) -> Array:
        """Voltage across the windings, V = k_t ω + R i + L di/dt.

        Parameters
        ----------
        current : (...) array_like [A]
        speed : (...) array_like, of the rotor [rad/s]
        current_rate : (...) array_like, di/dt [A/s]

        Returns
        -------
        voltage : (...) array [V]
        """
        i = np.asarray(current, float)
        w = np.asarray(speed, float)
        di = np.asarray(current_rate, float)
        return np.asarray(self.torque_constant * w + self.resistance * i + self.inductance * di)

    def heat(self, current: ArrayLike) -> Array:
        """Heat in the windings, R i².

        Parameters
        ----------
        current : (...) array_like [A]

        Returns
        -------
        heat : (...) array [W]
        """
        return np.asarray(self.resistance * np.asarray(current, float) ** 2)

    def greatest_torque(self, speed: ArrayLike, current: float | None = None) -> Array:
        """Speed–torque curve: largest torque within the current and voltage limits.

        Parameters
        ----------
        speed : (...) array_like, of the rotor [rad/s]
        current : float, optional [A]; None: the peak current

        Returns
        -------
        torque : (...) array [N m]

        Notes
        -----
        If the motor runs faster than its no-load speed at this voltage, the torque is negative: the motor brakes.
        Beyond its largest speed in either direction, the result is -inf.
        """
        w = np.asarray(speed, float)
        max_current = self.current_peak if current is None else current
        torque_by_current = self.torque_constant * max_current
        if self.resistance == 0.0:  # any current flows below the no-load speed, none above it
            torque_by_voltage = np.where(self.torque_constant * w <= self.voltage, np.inf, -np.inf)
        else:
            torque_by_voltage = self.torque_constant * (self.voltage - self.torque_constant * w) / self.resistance
        torque = np.minimum(torque_by_current, torque_by_voltage)
        torque = np.where(np.abs(w) <= self.speed, torque, -np.inf)
        return np.where(np.isnan(w), np.nan, torque)


@dataclass(frozen=True, eq=False)
class Rotor:
    """Rotor: the spinning part of a motor, a body of revolution about its axis."""

    inertia: float
    """Moment of inertia about the axis [kg m²]."""
    extra: bool = False
    """True if the link masses exclude the rotor; otherwise its inertia is part of the link that carries it."""
    mass: float = 0.0
    """Mass of an extra rotor [kg]."""
    link: str | None = None
    """Link that carries the motor; None: the parent link of the joint."""
    axis: Array | None = None
    """Direction of the axis in that link's frame (3,); None: the joint's axis."""
    place: Array = field(default_factory=lambda: np.zeros(3))
    """Centre in that link's frame (3,) [m]; in the joint's frame if no link is named."""

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self.__post_init__()  # unpickled arrays are writable

    def __post_init__(self) -> None:
        for name in ("axis", "place"):
            value = getattr(self, name)
            if value is not None:
                array = np.array(value, float)
                array.setflags(write=False)
                object.__setattr__(self, name, array)  # the dataclass is frozen


@dataclass(frozen=True, eq=False)
class Actuator:
    """Actuator of one joint: motor, rotor, gear and spring; the rotor turns ``ratio`` times as fast as the joint."""

    joint: str
    """Driven joint."""
    ratio: float = 1.0
    """Gear ratio G; in rad/m for a sliding joint; negative if the rotor turns in the opposite direction."""
    efficiency: float = 1.0
    """Efficiency η of the gear: output power over input power, in either direction."""
    no_load_torque: float = 0.0
    """Friction of the turning gear at its input [N m], at any load."""
    motor: Motor | None = None
    """Motor; None if not described."""
    rotor: Rotor | None = None
    """Rotor; None if not described."""
    stiffness: float = np.inf
    """Stiffness of the gear referred to the joint [N m/rad or N/m]; if finite, each side has a coordinate."""


# ── Validation of a drive's parameters

MAX_DRIVE_NUMBER = 1e12
"""Largest number of a drive in SI units; its square does not overflow."""
_MIN_DRIVE_NUMBER = 1e-18
"""Smallest number of a drive in SI units; its square does not underflow."""
_MIN_RATIO = 1e-6
"""Smallest gear ratio: rad/rad, or rad/m for a spindle."""
_MAX_RATIO = 1e9
"""Largest gear ratio: rad/rad, or rad/m for a spindle, where it is a thread of 6 nm pitch."""


def check_actuator(actuator: Actuator) -> None:
    """Raise ValueRangeError for a number that is impossible for a drive."""
    first_problem = next(_problems(actuator), "")
    if first_problem:
        raise ValueRangeError(f"the actuator of joint {actuator.joint!r} has {first_problem}")


def _problems(actuator: Actuator) -> Iterator[str]:
    """Impossible numbers, each with its remedy, as ends of the sentence "the actuator has …"."""
    motor, rotor = actuator.motor, actuator.rotor
    largest_text = printed(MAX_DRIVE_NUMBER)
    if not _MIN_RATIO <= abs(actuator.ratio) <= _MAX_RATIO:
        bounds = f"from {printed(_MIN_RATIO)} to {printed(_MAX_RATIO)}"
        yield f"the ratio {printed(actuator.ratio)}; it must be a number {bounds}, or minus one."
    if not 0 < actuator.efficiency <= 1:
        yield f"the efficiency {printed(actuator.efficiency)}; it must be above 0 and at most 1."
    if not 0 <= actuator.no_load_torque <= MAX_DRIVE_NUMBER:
        yield f"the no-load torque {printed(actuator.no_load_torque)} N m; it must be at least 0 and at most {largest_text}."
    if not (_is_in_range(actuator.stiffness) or actuator.stiffness == np.inf):
        stiffness = printed(actuator.stiffness)
        yield f"the stiffness {stiffness}; it must be above 0 and at most {largest_text}. Leave it out where the gear is rigid."
    if rotor is not None:
        is_place_possible = np.isfinite(rotor.place).all() and np.abs(rotor.place).max() <= MAX_DRIVE_NUMBER
        if not is_place_possible:
            yield f"a rotor at {np.asarray(rotor.place).tolist()}; its place must be finite."
        if not (_is_in_range(rotor.inertia) and 0 <= rotor.mass <= MAX_DRIVE_NUMBER):
            yield f"a rotor of {printed(rotor.inertia)} kg m² and {printed(rotor.mass)} kg; give positive ones."
    if motor is None:
        return
    if motor.current_peak < motor.current_continuous < np.inf:
        continuous, peak = printed(motor.current_continuous), printed(motor.current_peak)
        yield f"current continuous {continuous} A above current peak {peak} A. Are they exchanged?"
    if not _is_in_range(motor.torque_constant):
        yield f"the torque constant {printed(motor.torque_constant)} N m/A; it must be above 0."
    if motor.thermal is not None and not _is_possible(motor.thermal):
        numbers = ", ".join(map(printed, vars(motor.thermal).values()))
        yield (
            f"thermal data that cannot be meant ({numbers}): resistances and times "
            "must be above 0, those of the winding both or none, and the greatest temperature above that of the reference."
        )
    for name, value in vars(motor).items():
        if name == "thermal":
            continue
        may_be_zero = name in ("resistance", "inductance")
        value_if_not_given = 0 if may_be_zero else np.inf
        if not (_is_in_range(value) or value == value_if_not_given):
            title = name.replace("_", " ")
            bound = "at least" if may_be_zero else "above"
            yield f"{title} {printed(value)}; it must be {bound} 0 and at most {largest_text}."


def _is_possible(thermal: Thermal) -> bool:
    """True if resistances and times are positive, except two zeros of the winding, and temperatures possible."""
    positive_numbers = [thermal.housing_ambient, thermal.housing_time]
    if thermal.winding_housing or thermal.winding_time:
        positive_numbers += [thermal.winding_housing, thermal.winding_time]
    if not all(map(_is_in_range, positive_numbers)):
        return False
    return bool(np.isfinite(thermal.coefficient) and thermal.maximum > thermal.reference)


def _is_in_range(x: float) -> bool:
    """True if the number is in the range allowed for a drive."""
    return bool(_MIN_DRIVE_NUMBER <= x <= MAX_DRIVE_NUMBER)
