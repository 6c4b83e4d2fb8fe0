"""Motor of a drive over a cycle: loads compared with ratings; and the supply of all motors."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..core.numbers import printed
from ..core.typing import Array
from ..mechanics.model.actuators import Motor, gear_input, moving
from ..reports.motors import Demand
from .cycle import RPM, Cycle, DrivePart, between
from .gear import Gear, average_speed
from .winding import allowed_current, periodic_temperatures, runaway_current

_HOUR = 3600.0
_RATED_AIR = 25.0
"""Temperature of the air [°C] to which continuous currents of data sheets apply."""


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
        Demand("speed", float(np.abs(speed[fast])) / RPM, motor.speed / RPM, "rpm", float(time[fast])),
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
