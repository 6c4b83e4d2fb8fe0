"""Loads of a gear over a cycle, compared with its ratings."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import compress

import numpy as np

from ..core.numbers import over_limit
from ..core.typing import Array
from ..mechanics.model.limits import BEARING_UNITS
from ..reports.motors import Demand
from .cycle import RPM, Cycle, DrivePart, between

_EVENTS = 1e4
"""Twice the turns of the wave generator that a strain-wave gear survives under a momentary peak torque."""
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
    turned = np.abs(speed) * duration
    total = float(turned.sum())
    return float((turned @ np.abs(torque) ** exponent / total) ** (1 / exponent)) if total > 0 else math.nan


def average_speed(speed: Array, duration: Array) -> float:
    """Mean absolute speed over the phases, including pauses."""
    return float(np.abs(speed) @ duration / duration.sum())


def life_hours(gear: Gear, torque: float, speed: float) -> float:
    """Life L₁₀ [h] at an average torque and input speed: L₅₀ / 5 with L₅₀ = L_n (T_N / T_av)³ (n_N / n_av).

    Harmonic Drive, Engineering Data 1019658, equations 20.2 and 20.3.
    """
    return gear.life / 5 * (gear.rated_torque / torque) ** 3 * (gear.rated_speed / speed)


def emergency_events(speed: float, duration: float, ratio: float) -> float:
    """Emergency stops that a strain-wave gear survives at an output speed [rad/s]: 10⁴ / (2 n R t)."""
    turns = speed / (2 * math.pi) * ratio * duration
    return _EVENTS / (2 * turns) if turns else math.inf


@dataclass(frozen=True)
class SizedGear(DrivePart):
    """Loads of a gear; speeds are input speeds [rad/s]."""

    average_torque: float
    """N m; NaN for a joint that only holds."""
    peak_torque: float
    average_speed: float
    maximum_speed: float
    life: float
    """L₁₀ [h]; inf if unknown."""


def sized_gear(
    gear: Gear, cycle: Cycle, life: float | None = None, emergency: Cycle | None = None, *, weighs: bool = False
) -> SizedGear:
    """Loads of a gear over a cycle and an emergency; ``life`` is the required life [h]; ``weighs``: its mass is a load."""
    torque, speed = between(np.abs(cycle.torque)), between(np.abs(cycle.speed))
    mean = average_torque(torque, speed, cycle.duration, gear.mean_exponent)
    turning = np.abs(cycle.speed * gear.ratio)
    mean_in, peak = average_speed(gear.ratio * speed, cycle.duration), int(np.abs(cycle.torque).argmax())
    peak_torque, fast = float(np.abs(cycle.torque[peak])), int(turning.argmax())
    hours, unknown = _life(gear, mean, mean_in)
    demands = [
        Demand("peak torque", peak_torque, gear.repeated_peak, "N m", float(cycle.time[peak])),
        Demand("average input speed", mean_in / RPM, gear.average_speed / RPM, "rpm"),
        Demand("input speed", turning[fast] / RPM, gear.maximum_speed / RPM, "rpm", float(cycle.time[fast])),
    ]
    if mean > 0:
        demands.insert(0, Demand("average torque", mean, gear.average_torque, "N m"))
    if life is not None and gear.kind != "direct":
        demands.append(Demand("life wanted", life, hours, "h"))
    if emergency is not None:
        worst = int(np.abs(emergency.torque).argmax())
        shock = float(np.abs(emergency.torque[worst]))
        demands.append(Demand("emergency torque", shock, gear.momentary_peak, "N m", float(emergency.time[worst])))
    for kind, loads in cycle.bearing.items():
        limit = getattr(gear, kind)
        if math.isfinite(limit):
            at, what = int(loads.argmax()), "moment" if kind == "tilting" else "force"
            load, unit = float(loads[at]), BEARING_UNITS[kind]
            demands.append(Demand(f"{kind} {what} of its bearing", load, limit, unit, float(cycle.time[at])))
    ratings = ["average_torque", "repeated_peak", "average_speed", "maximum_speed"]
    if emergency is not None:
        ratings.append("momentary_peak")
    missing = [name for name in ratings if not math.isfinite(getattr(gear, name))]
    matters = {
        "efficiency": True,
        "no_load_torque": True,
        "mass": weighs,
        "mean_exponent": gear.kind == "planetary" and mean > 0 and over_limit(peak_torque / gear.average_torque),
    }
    missing += [name for name in compress(matters, matters.values()) if name in gear.unstated]
    if life is not None:
        missing += unknown
    if gear.kind == "direct":
        missing = []
    return SizedGear(gear.name, tuple(demands), tuple(missing), mean, peak_torque, mean_in, float(turning[fast]), hours)


def _life(gear: Gear, torque: float, speed: float) -> tuple[float, tuple[str, ...]]:
    """Life [h] at an average torque and input speed, inf if unknown or at standstill, and the names of missing numbers.

    Life of planetary gears has no common law: what the maker states holds for loads up to the rated ones.
    """
    missing = tuple(name for name in ("rated_torque", "rated_speed", "life") if not math.isfinite(getattr(gear, name)))
    if missing or not (torque > 0 and speed > 0):
        return math.inf, missing
    if gear.kind == "strain_wave":
        return life_hours(gear, torque, speed), ()
    within = torque <= gear.rated_torque and speed <= gear.rated_speed
    return (gear.life, ()) if within else (math.inf, ("life beyond the rated torque and speed",))
