"""Loads of a gear over a cycle, compared with its ratings."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..core.numbers import over_limit
from ..core.typing import Array
from ..mechanics.model.limits import BEARING_UNITS
from ..reports.motors import Demand
from .cycle import RPM, Cycle, DrivePart, between

_MOMENTARY_TURNS = 1e4
"""Twice the turns of the wave generator under momentary peak torques in the life of a strain-wave gear."""
KINDS = {"strain_wave": 3.0, "planetary": 3.0, "direct": math.nan}
"""Kinds of gears, with the usual exponent of the mean torque."""


@dataclass(frozen=True)
class Gear:
    """Gear of a catalogue; missing ratings are inf. Torques at the output, speeds at the input [rad/s]."""

    name: str
    kind: str = "strain_wave"
    ratio: float = 1.0
    efficiency: float = 1.0
    no_load_torque: float = 0.0
    """Friction at the input [N m]."""
    mass: float = 0.0
    price: float = 0.0
    rated_torque: float = math.inf
    rated_speed: float = math.inf
    average_torque: float = math.inf
    """Limit of the mean torque [N m]."""
    repeated_peak: float = math.inf
    """Limit of the peak torque of the cycle; for planetary gears the acceleration torque T_2B."""
    momentary_peak: float = math.inf
    """Limit of the torque in an emergency stop or collision; for planetary gears T_2Not."""
    average_speed: float = math.inf
    maximum_speed: float = math.inf
    life: float = math.inf
    """Life reached by half of the gears at rated torque and speed [h]."""
    mean_exponent: float = 3.0
    axial: float = math.inf
    """Limit of the force on the output bearing along its axis [N]."""
    radial: float = math.inf
    """Limit of the force across the axis [N]."""
    tilting: float = math.inf
    """Limit of the moment across the axis [N m]."""
    unstated: frozenset[str] = frozenset()
    """Numbers that the catalogue leaves out and whose substitutes are favourable, such as ``efficiency``."""


def average_torque(torque: Array, speed: Array, duration: Array, exponent: float = 3.0) -> float:
    """Mean torque with the same gear wear as the cycle: (Σ |n| t |T|^p / Σ |n| t)^(1/p); NaN at standstill.

    Parameters
    ----------
    torque, speed, duration : (n,) arrays, of each phase; any units

    Examples
    --------
    >>> T, t, n = np.array([150.0, 82, 130, 0]), np.array([0.2, 3, 0.3, 0.2]), np.array([10.0, 20, 10, 0])
    >>> round(average_torque(T, n, t), 2)
    89.39
    """
    angles = np.abs(speed) * duration  # turned in each phase
    total_angle = float(angles.sum())
    if total_angle == 0.0:
        return math.nan
    mean_of_powers = angles @ np.abs(torque) ** exponent / total_angle
    return float(mean_of_powers ** (1 / exponent))


def average_speed(speed: Array, duration: Array) -> float:
    """Mean absolute speed over the phases, including pauses."""
    return float(np.abs(speed) @ duration / duration.sum())


def life_hours(gear: Gear, torque: float, speed: float) -> float:
    """Life L₁₀ [h] at an average torque and input speed: L₅₀ / 5 with L₅₀ = L_n (T_N / T_av)³ (n_N / n_av).

    Harmonic Drive, Engineering Data 1019658, equations 20.2 and 20.3.
    """
    return gear.life / 5 * (gear.rated_torque / torque) ** 3 * (gear.rated_speed / speed)  # 5: L₅₀ over L₁₀


def emergency_events(speed: float, duration: float, ratio: float) -> float:
    """Number of emergency stops, from an output speed [rad/s], that a strain-wave gear survives: 10⁴ / (2 n R t)."""
    turns = speed / (2 * math.pi) * ratio * duration  # of the wave generator
    return _MOMENTARY_TURNS / (2 * turns) if turns else math.inf


@dataclass(frozen=True)
class SizedGear(DrivePart):
    """Loads of a gear; speeds are input speeds [rad/s]."""

    average_torque: float
    """Mean torque [N m]; NaN for a joint that only holds."""
    peak_torque: float
    """Largest torque [N m]."""
    average_speed: float
    maximum_speed: float
    life: float
    """L₁₀ [h]; inf if unknown."""


def sized_gear(
    gear: Gear, cycle: Cycle, life: float | None = None, emergency: Cycle | None = None, *, weighs: bool = False
) -> SizedGear:
    """Loads of a gear over a cycle and an emergency.

    ``life`` is the required life [h]. If the gear ``weighs``, its mass loads the robot, and an unknown mass is reported.
    """
    torque = between(np.abs(cycle.torque))  # of each phase
    speed = between(np.abs(cycle.speed))
    mean_torque = average_torque(torque, speed, cycle.duration, gear.mean_exponent)
    mean_input_speed = average_speed(gear.ratio * speed, cycle.duration)
    peak_row = int(np.abs(cycle.torque).argmax())
    peak_torque = float(np.abs(cycle.torque[peak_row]))
    input_speeds = np.abs(cycle.speed * gear.ratio)
    fastest_row = int(input_speeds.argmax())
    max_input_speed = float(input_speeds[fastest_row])
    gear_life, missing_for_life = _life(gear, mean_torque, mean_input_speed)
    demands = [
        Demand("peak torque", peak_torque, gear.repeated_peak, "N m", float(cycle.time[peak_row])),
        Demand("average input speed", mean_input_speed / RPM, gear.average_speed / RPM, "rpm"),
        Demand("input speed", max_input_speed / RPM, gear.maximum_speed / RPM, "rpm", float(cycle.time[fastest_row])),
    ]
    if mean_torque > 0:
        demands.insert(0, Demand("average torque", mean_torque, gear.average_torque, "N m"))
    if life is not None and gear.kind != "direct":
        demands.append(Demand("life wanted", life, gear_life, "h"))
    if emergency is not None:
        worst_row = int(np.abs(emergency.torque).argmax())
        emergency_torque = float(np.abs(emergency.torque[worst_row]))
        emergency_time = float(emergency.time[worst_row])
        demands.append(Demand("emergency torque", emergency_torque, gear.momentary_peak, "N m", emergency_time))
    for kind, loads in cycle.bearing.items():
        limit = getattr(gear, kind)
        if math.isfinite(limit):
            largest_row = int(loads.argmax())
            name = f"{kind} moment of its bearing" if kind == "tilting" else f"{kind} force of its bearing"
            load = float(loads[largest_row])
            time = float(cycle.time[largest_row])
            demands.append(Demand(name, load, limit, BEARING_UNITS[kind], time))
    ratings = ["average_torque", "repeated_peak", "average_speed", "maximum_speed"]
    if emergency is not None:
        ratings.append("momentary_peak")
    missing = [name for name in ratings if not math.isfinite(getattr(gear, name))]
    used_numbers = ["efficiency", "no_load_torque"]
    if weighs:
        used_numbers.append("mass")
    # If even the peak is below the limit of the mean torque, the exponent does not matter.
    if gear.kind == "planetary" and mean_torque > 0 and over_limit(peak_torque / gear.average_torque):
        used_numbers.append("mean_exponent")
    missing += [name for name in used_numbers if name in gear.unstated]
    if life is not None:
        missing += missing_for_life
    if gear.kind == "direct":
        missing = []
    return SizedGear(
        name=gear.name,
        demands=tuple(demands),
        missing=tuple(missing),
        average_torque=mean_torque,
        peak_torque=peak_torque,
        average_speed=mean_input_speed,
        maximum_speed=max_input_speed,
        life=gear_life,
    )


def _life(gear: Gear, torque: float, speed: float) -> tuple[float, tuple[str, ...]]:
    """Life [h] at an average torque and input speed, inf if unknown or at standstill, and the names of missing numbers.

    Life of planetary gears has no common law: the maker's number holds up to the rated torque and speed.
    """
    missing = tuple(name for name in ("rated_torque", "rated_speed", "life") if not math.isfinite(getattr(gear, name)))
    if missing or not (torque > 0 and speed > 0):
        return math.inf, missing
    if gear.kind == "strain_wave":
        return life_hours(gear, torque, speed), ()
    is_within_ratings = torque <= gear.rated_torque and speed <= gear.rated_speed
    if is_within_ratings:
        return gear.life, ()
    return math.inf, ("life beyond the rated torque and speed",)
