"""One drive over a cycle: gear loads compared with ratings, motor loads, and the winding temperature.

A cycle is a sequence of nodes. Between two nodes torque and speed are linear in time, and the winding's heat is
constant.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import compress
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from ..core.numbers import over_limit, printed
from ..core.typing import Array
from ..mechanics.model.actuators import Motor, Thermal, gear_input, moving
from ..mechanics.model.limits import BEARING_UNITS
from ..reports.motors import Demand

_RPM = 2 * math.pi / 60
_HOUR = 3600.0
_RATED_AIR = 25.0
"""Temperature of the air [°C] to which continuous currents of data sheets apply."""
_EVENTS = 1e4
"""Twice the turns of the wave generator that a strain-wave gear survives under a momentary peak torque."""

KINDS = {"strain_wave": 3.0, "planetary": 3.0, "direct": math.nan}
"""Kinds of gears, with the usual exponent of the mean torque."""


@dataclass(frozen=True)
class CatalogMotor:
    """Motor of a catalogue."""

    name: str
    motor: Motor
    inertia: float = 0.0
    """Inertia of the rotor [kg m²]; 0 if unknown."""
    mass: float = 0.0
    price: float = 0.0
    stall_only: bool = False
    """True if only the stall torque is known, which a motor cannot hold for long."""
    unstated: frozenset[str] = frozenset()
    """Numbers that the catalogue leaves out and that are then favourable: ``mass``."""


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


class Cycle(NamedTuple):
    """Loads of one joint at the nodes of a cycle, (n,) each, with ``duration`` (n - 1,) between nodes."""

    time: Array
    duration: Array
    speed: Array
    """Joint speed [rad/s]."""
    torque: Array
    """Torque at the gear's output, including friction [N m]."""
    acceleration: Array
    """Joint acceleration [rad/s²]."""
    carrier: Array
    """Acceleration of the motor's link about the rotor axis [rad/s²]."""
    inertia: Array
    """Inertia of the joint in M [kg m²]."""
    bearing: Mapping[str, Array] = MappingProxyType({})
    """Loads of the joint's bearing by kind [N, N, N m]; empty if no gear has limits of them."""

    def rotor_torque(self, inertia: float, ratio: float) -> Array:
        """Torque at the joint that accelerates the rotor: G J (G q̈ + α). MR section 8.9.2."""
        return ratio * inertia * (ratio * self.acceleration + self.carrier)


def between(x: Array) -> Array:
    """Means of consecutive nodes."""
    return np.asarray(0.5 * (x[1:] + x[:-1]))


def with_noise(demands: Sequence[Demand], draws: Sequence[Sequence[Demand]]) -> tuple[Demand, ...]:
    """Demands less what noise adds to them on average, with standard deviations, from those of equally likely motions."""
    corrected = []
    for demand in demands:
        key = demand.what, demand.limit
        values = np.array([d.value for draw in draws for d in draw if (d.what, d.limit) == key])
        if len(values) > 1 and np.isfinite([demand.value, *values]).all():
            mean, sigma = float(values.mean()), float(values.std(ddof=1))
            corrected.append(replace(demand, value=2 * demand.value - mean, sigma=sigma))
        else:
            corrected.append(demand)
    return tuple(corrected)


# ── Gear


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
class DrivePart:
    """Motor or gear with its demands over the cycle."""

    name: str
    demands: tuple[Demand, ...]
    missing: tuple[str, ...]
    """Names of missing ratings."""

    @property
    def tightest(self) -> Demand:
        """Demand nearest to its limit."""
        return max(self.demands, key=lambda d: d.share)

    @property
    def excess(self) -> tuple[Demand, ...]:
        """Demands beyond their limits."""
        return tuple(d for d in self.demands if d.over)

    @property
    def open(self) -> tuple[Demand, ...]:
        """Demands of which noise of the log decides whether they exceed their limits."""
        return tuple(d for d in self.demands if d.open)


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
        Demand("average input speed", mean_in / _RPM, gear.average_speed / _RPM, "rpm"),
        Demand("input speed", turning[fast] / _RPM, gear.maximum_speed / _RPM, "rpm", float(cycle.time[fast])),
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


# ── Winding temperature. Maxon academy, Formulae Handbook: two thermal masses; exact, since linear in each segment


def transitions(thermal: Thermal, resistance: float, squares: Array, duration: Array, ambient: float) -> Array:
    """Transition matrices (m, 3, 3) of (winding, housing, 1) above ambient through each segment, for mean squared currents.

    C_w dθ_w/dt = R (1 + α (T_w - T_0)) i² - (θ_w - θ_h) / R_wh, C_h dθ_h/dt = (θ_w - θ_h) / R_wh - θ_h / R_ha. A single
    thermal mass is the winding; the housing is then a separate entry that cools alone.
    """
    R, alpha, heat = resistance, thermal.coefficient, np.asarray(squares, float)
    cold = 1 + alpha * (ambient - thermal.reference)
    if thermal.winding_housing:
        R_w, R_h = thermal.winding_housing, thermal.housing_ambient
        C_w, C_h = thermal.winding_time / R_w, thermal.housing_time / R_h
        a, b = (R * alpha * heat - 1 / R_w) / C_w, 1 / (R_w * C_w)
        c, d = 1 / (R_w * C_h), np.full_like(heat, -(1 / R_w + 1 / R_h) / C_h)
    else:
        C_w = thermal.housing_time / thermal.housing_ambient
        a, b, c = (R * alpha * heat - 1 / thermal.housing_ambient) / C_w, 0.0, 0.0
        d = a - 1 / thermal.housing_time
    middle, distance = 0.5 * (a + d), np.sqrt((0.5 * (a - d)) ** 2 + b * c)
    half = 0.5 * (a - d)
    skew = np.stack([np.stack([half, np.full_like(half, b)], -1), np.stack([np.full_like(half, c), -half], -1)], -2)

    def matrix_function(first: Array, second: Array) -> Array:
        """Matrix function from its values at the two eigenvalues."""
        plain = 0.5 * (first + second)[:, None, None] * np.eye(2)
        return np.asarray(plain + (0.5 * (first - second) / distance)[:, None, None] * skew)

    larger, smaller = middle + distance, middle - distance  # eigenvalues
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        steps = [
            np.where(np.abs(x * duration) > 1e-12, np.expm1(x * duration) / x, duration) for x in (larger, smaller)
        ]
        matrices = np.zeros((len(heat), 3, 3))
        matrices[:, :2, :2] = matrix_function(np.exp(larger * duration), np.exp(smaller * duration))
        matrices[:, :2, 2] = matrix_function(*steps)[:, :, 0] * (R * cold * heat / C_w)[:, None]
    matrices[:, 2, 2] = 1.0
    return matrices


def periodic_temperatures(
    thermal: Thermal, resistance: float, squares: Array, duration: Array, ambient: float
) -> Array:
    """Periodic temperatures of winding and housing, (m + 1, 2) [°C], at the segment ends of a repeated cycle.

    They are inf if there is no periodic state (thermal runaway): the hotter winding heats more than its housing
    dissipates.
    """
    from_start = _cumulative(transitions(thermal, resistance, squares, duration, ambient))
    cycle = from_start[-1]
    if not np.isfinite(cycle).all() or np.abs(np.linalg.eigvals(cycle[:2, :2])).max() >= 1:
        return np.full((len(squares) + 1, 2), np.inf)
    state = np.append(np.linalg.solve(np.eye(2) - cycle[:2, :2], cycle[:2, 2]), 1.0)
    return np.asarray(np.vstack([state, from_start @ state]))[:, :2] + ambient


def _cumulative(each: Array) -> Array:
    """Products each[k] ··· each[0] of matrices (m, 3, 3), from those of pairs: as many steps as m has binary digits."""
    if len(each) == 1:
        return each
    even = len(each) // 2 * 2
    with np.errstate(over="ignore", invalid="ignore"):
        pairs = _cumulative(each[1:even:2] @ each[:even:2])
        products = np.empty_like(each)
        products[0], products[1:even:2] = each[0], pairs
        products[2::2] = each[2::2] @ pairs[: len(each[2::2])]
    return products


def runaway_current(thermal: Thermal, resistance: float) -> float:
    """Constant current [A] above which the winding temperature grows without bound."""
    inverse_square = resistance * thermal.coefficient * (thermal.winding_housing + thermal.housing_ambient)
    return 1 / math.sqrt(inverse_square) if inverse_square > 0 else math.inf


def allowed_current(thermal: Thermal, resistance: float, ambient: float) -> float:
    """Constant current [A] at which the winding reaches its maximum temperature."""
    hot = resistance * (1 + thermal.coefficient * (thermal.maximum - thermal.reference))
    warmer = thermal.maximum - ambient
    if not warmer > 0 or hot == 0:
        return 0.0 if warmer <= 0 else math.inf
    if math.isinf(warmer):
        return runaway_current(thermal, resistance)
    return math.sqrt(warmer / ((thermal.winding_housing + thermal.housing_ambient) * hot))


# ── Motor


def hot_motor(motor: Motor, ambient: float) -> Motor:
    """Motor at its maximum temperature: resistance at that temperature, and the current that maintains it."""
    thermal = motor.thermal
    if thermal is None or math.isinf(thermal.maximum):
        return motor
    continuous = min(motor.current_continuous, allowed_current(thermal, motor.resistance, ambient))
    growth = 1 + thermal.coefficient * (thermal.maximum - thermal.reference)
    return replace(motor, resistance=motor.resistance * growth, current_continuous=continuous)


@dataclass(frozen=True, eq=False)
class SizedMotor(DrivePart):
    """Loads of a motor."""

    torque: Array
    """(n,) N m at the rotor, at the nodes of the cycle."""
    speed: Array
    """(n,) rad/s."""
    rms_torque: float
    peak_torque: float
    rms_current: float
    peak_current: float
    peak_speed: float
    mean_speed: float
    inertia_ratio: float
    """Maximum of (M_jj / G²) / J over the cycle; NaN for unknown rotor inertia."""
    power: Array
    """(n,) W, τ ω + R i², with the resistance at the temperature of the winding, or the stated one without thermal data."""
    temperature: Array
    """(n, 2) °C of winding and housing at the nodes of the repeated cycle; empty without thermal data."""


def sized_motor(
    entry: CatalogMotor, gear: Gear, cycle: Cycle, *, ambient: float, holding: slice = slice(0, 0), weighs: bool = False
) -> SizedMotor:
    """Loads of a motor behind a gear; in the nodes ``holding`` a brake carries the torque; ``weighs``: its mass is a load."""
    motor, ratio = entry.motor, gear.ratio
    gear_torque = gear_input(cycle.torque, cycle.speed, gear.efficiency)
    speed = ratio * cycle.speed
    no_load_torque = gear.no_load_torque * np.sign(ratio * moving(cycle.speed))
    torque = (gear_torque + cycle.rotor_torque(entry.inertia, ratio)) / ratio + no_load_torque
    torque[holding] = 0.0
    current = motor.current(torque)
    squares = (current[1:] ** 2 + current[1:] * current[:-1] + current[:-1] ** 2) / 3
    rms = math.sqrt(float(squares @ cycle.duration) / float(cycle.duration.sum()))
    heated = np.zeros((0, 2))
    if motor.thermal is not None:
        heated = periodic_temperatures(motor.thermal, motor.resistance, squares, cycle.duration, ambient)
    demands, missing = _motor_demands(entry, torque, speed, current, rms, heated, cycle.time, ambient)
    if weighs and "mass" in entry.unstated and not entry.stall_only:
        missing.append("mass")
    ratios = cycle.inertia / (ratio**2 * entry.inertia) if entry.inertia else np.array([math.nan])
    return SizedMotor(
        entry.name, tuple(demands), tuple(missing), torque, speed, motor.torque_constant * rms,
        float(np.abs(torque).max()), rms, float(np.abs(current).max()), float(np.abs(speed).max()),
        average_speed(between(np.abs(speed)), cycle.duration), float(ratios.max()),
        torque * speed + warm_resistance(motor, heated) * current**2, heated,
    )  # fmt: skip


def warm_resistance(motor: Motor, heated: Array) -> Array:
    """Resistance of the winding at temperatures (n, 2) [°C]; the stated one (1,) without thermal data.

    In a thermal runaway it is that of the highest temperature that the winding may have.
    """
    thermal = motor.thermal
    if thermal is None or not heated.size:
        return np.array([motor.resistance])
    known = thermal.maximum if math.isfinite(thermal.maximum) else thermal.reference
    warm = np.where(np.isfinite(heated[:, 0]), heated[:, 0], known)
    return np.asarray(motor.resistance * (1 + thermal.coefficient * (warm - thermal.reference)))


def _motor_demands(
    entry: CatalogMotor,
    torque: Array,
    speed: Array,
    current: Array,
    rms: float,
    heated: Array,
    time: Array,
    ambient: float,
) -> tuple[list[Demand], list[str]]:
    """Demands on a motor, and its missing ratings."""
    motor, thermal = entry.motor, entry.motor.thermal
    hot = replace(hot_motor(motor, ambient), speed=math.inf)  # speeds are a separate demand
    limits = np.where(torque >= 0, hot.greatest_torque(speed), hot.greatest_torque(-speed))
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = np.where(limits > 0, np.abs(torque) / limits, np.where(torque == 0, 0.0, math.inf))
    worst, peak, fast = int(shares.argmax()), int(np.abs(current).argmax()), int(np.abs(speed).argmax())
    allowed = max(float(limits[worst]), 0.0)
    demands = [
        Demand("torque at its speed", float(np.abs(torque[worst])), allowed, "N m", float(time[worst])),
        Demand("peak current", float(np.abs(current[peak])), motor.current_peak, "A", float(time[peak])),
        Demand("speed", float(np.abs(speed[fast])) / _RPM, motor.speed / _RPM, "rpm", float(time[fast])),
    ]
    if heated.size and thermal is not None:
        warmest = float(heated[:, 0].max())
        demands.append(Demand("winding temperature", warmest, thermal.maximum, "degC", base=ambient))
        if not math.isfinite(warmest):
            bound = runaway_current(thermal, motor.resistance)
            demands[-1] = Demand(f"thermal runaway above {printed(bound, 4)} A, rms current", rms, bound, "A")
    elif math.isfinite(motor.current_continuous):
        demands.append(Demand("rms current", rms, motor.current_continuous, "A"))
    return demands, _missing_ratings(entry, ambient)


def _missing_ratings(entry: CatalogMotor, ambient: float) -> list[str]:
    """Names of the numbers of a motor without which its verdict would be better than it is."""
    motor, thermal = entry.motor, entry.motor.thermal
    missing = [name for name in ("voltage", "current_peak") if not math.isfinite(getattr(motor, name))]
    if entry.stall_only:
        return [*missing, "stall data only"]
    if not math.isfinite(motor.speed):
        missing.append("speed")
    if not motor.resistance > 0:
        missing.append("resistance")
    if thermal is not None:
        if not math.isfinite(thermal.maximum):
            missing.append("thermal: maximum")
    elif not math.isfinite(motor.current_continuous):
        missing.append("thermal or current_continuous")
    elif ambient > _RATED_AIR:
        missing.append(f"thermal, as current_continuous holds up to {printed(_RATED_AIR)} degC")
    if not entry.inertia:
        missing.append("rotor: inertia")
    return missing


# ── Supply


class Supply(NamedTuple):
    """Electrical supply of all drives of a cycle; electronics are neglected."""

    peak: float
    """W, largest power drawn."""
    mean: float
    """W, mean power drawn."""
    drawn: float
    """Energy drawn in a cycle [J]."""
    braked: float
    """Energy returned by the drives in a cycle [J], to the brake resistor unless the supply accepts it."""


def supply_of(powers: Iterator[Array] | list[Array], duration: Array, *, shared: bool) -> Supply:
    """Supply of drives from their powers (n,) at the nodes; ``shared``: drives feed each other through a common link."""
    drive_powers = np.array(list(powers))
    flows = drive_powers.sum(axis=0)[None, :] if shared else drive_powers
    drawn_power, braking_power = np.maximum(flows, 0.0).sum(axis=0), np.maximum(-flows, 0.0).sum(axis=0)
    drawn, braked = float(between(drawn_power) @ duration), float(between(braking_power) @ duration)
    return Supply(float(drawn_power.max()), drawn / float(duration.sum()), drawn, braked)
