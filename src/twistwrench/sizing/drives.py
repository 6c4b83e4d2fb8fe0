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

_RATED_AMBIENT = 25.0
"""Temperature of the air for which data sheets state continuous currents [°C]."""


@dataclass(frozen=True)
class CatalogMotor:
    """Motor of a catalogue."""

    name: str
    motor: Motor
    inertia: float = 0.0
    """Inertia of the rotor [kg m²]; 0 if unknown."""
    mass: float = 0.0
    """Mass [kg]; 0 if unknown."""
    price: float = 0.0
    stall_only: bool = False
    """True if only the stall torque is known, which a motor cannot hold for long."""
    unstated: frozenset[str] = frozenset()
    """Names of numbers that the catalogue leaves out, by which the motor looks better: ``mass``."""


def hot_motor(motor: Motor, ambient: float) -> Motor:
    """Motor at its maximum temperature: its resistance there, and the continuous current that maintains it."""
    thermal = motor.thermal
    if thermal is None or math.isinf(thermal.maximum):
        return motor
    continuous_current = min(motor.current_continuous, allowed_current(thermal, motor.resistance, ambient))
    resistance_ratio = 1 + thermal.coefficient * (thermal.maximum - thermal.reference)
    resistance = motor.resistance * resistance_ratio
    return replace(motor, resistance=resistance, current_continuous=continuous_current)


@dataclass(frozen=True, eq=False)
class SizedMotor(DrivePart):
    """Loads of a motor."""

    torque: Array
    """Torque at the rotor at the nodes of the cycle (n,) [N m]."""
    speed: Array
    """Speed of the rotor (n,) [rad/s]."""
    rms_torque: float
    """Torque of the root mean square of the current [N m]."""
    peak_torque: float
    rms_current: float
    """[A]"""
    peak_current: float
    peak_speed: float
    """[rad/s]"""
    mean_speed: float
    inertia_ratio: float
    """Maximum of (M_jj / G²) / J over the cycle; NaN for unknown rotor inertia."""
    power: Array
    """Electrical power τ ω + R i² (n,) [W], with the resistance R of :func:`warm_resistance`."""
    temperature: Array
    """Temperatures of winding and housing at the nodes of the repeated cycle (n, 2) [°C]; empty without thermal data."""


def sized_motor(
    entry: CatalogMotor, gear: Gear, cycle: Cycle, *, ambient: float, holding: slice = slice(0, 0), weighs: bool = False
) -> SizedMotor:
    """Loads of a motor behind a gear.

    At the nodes ``holding`` a brake carries the torque. ``weighs`` is True if the motor's mass is a load of other drives.
    """
    motor, ratio = entry.motor, gear.ratio
    gear_torque = gear_input(cycle.torque, cycle.speed, gear.efficiency)
    speed = ratio * cycle.speed
    no_load_torque = gear.no_load_torque * np.sign(ratio * moving(cycle.speed))
    torque = (gear_torque + cycle.rotor_torque(entry.inertia, ratio)) / ratio + no_load_torque
    torque[holding] = 0.0
    current = motor.current(torque)
    # Mean square of a current that is linear between two nodes.
    mean_squares = (current[1:] ** 2 + current[1:] * current[:-1] + current[:-1] ** 2) / 3
    rms_current = math.sqrt(float(mean_squares @ cycle.duration) / float(cycle.duration.sum()))
    temperatures = np.zeros((0, 2))
    if motor.thermal is not None:
        temperatures = periodic_temperatures(motor.thermal, motor.resistance, mean_squares, cycle.duration, ambient)
    demands, missing_ratings = _motor_demands(
        entry, torque, speed, current, rms_current, temperatures, cycle.time, ambient
    )
    if weighs and "mass" in entry.unstated and not entry.stall_only:
        missing_ratings.append("mass")
    inertia_ratios = np.array([math.nan])
    if entry.inertia:
        inertia_ratios = cycle.inertia / (ratio**2 * entry.inertia)
    return SizedMotor(
        entry.name,
        tuple(demands),
        tuple(missing_ratings),
        torque=torque,
        speed=speed,
        rms_torque=motor.torque_constant * rms_current,
        peak_torque=float(np.abs(torque).max()),
        rms_current=rms_current,
        peak_current=float(np.abs(current).max()),
        peak_speed=float(np.abs(speed).max()),
        mean_speed=average_speed(between(np.abs(speed)), cycle.duration),
        inertia_ratio=float(inertia_ratios.max()),
        power=torque * speed + warm_resistance(motor, temperatures) * current**2,
        temperature=temperatures,
    )


def warm_resistance(motor: Motor, temperatures: Array) -> Array:
    """Resistance (n,) of the winding at temperatures of winding and housing (n, 2) [°C].

    Without thermal data it is the resistance of the catalogue, (1,). In a thermal runaway, temperatures are infinite, and the
    resistance is that at the maximum temperature.
    """
    thermal = motor.thermal
    if thermal is None or not temperatures.size:
        return np.array([motor.resistance])
    runaway_temperature = thermal.maximum if math.isfinite(thermal.maximum) else thermal.reference
    winding_temperature = temperatures[:, 0]
    finite_temperature = np.where(np.isfinite(winding_temperature), winding_temperature, runaway_temperature)
    return np.asarray(motor.resistance * (1 + thermal.coefficient * (finite_temperature - thermal.reference)))


def _motor_demands(
    entry: CatalogMotor,
    torque: Array,
    speed: Array,
    current: Array,
    rms_current: float,
    temperatures: Array,
    time: Array,
    ambient: float,
) -> tuple[list[Demand], list[str]]:
    """Demands on a motor, and its missing ratings."""
    motor, thermal = entry.motor, entry.motor.thermal
    motor_at_any_speed = replace(hot_motor(motor, ambient), speed=math.inf)  # speeds are a separate demand
    limits = np.where(
        torque >= 0, motor_at_any_speed.greatest_torque(speed), motor_at_any_speed.greatest_torque(-speed)
    )
    share_without_limit = np.where(torque == 0, 0.0, math.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = np.where(limits > 0, np.abs(torque) / limits, share_without_limit)
    # nodes of the largest demands
    worst = int(shares.argmax())
    peak = int(np.abs(current).argmax())
    fastest = int(np.abs(speed).argmax())
    max_torque = max(float(limits[worst]), 0.0)
    demands = [
        Demand("torque at its speed", float(np.abs(torque[worst])), max_torque, "N m", float(time[worst])),
        Demand("peak current", float(np.abs(current[peak])), motor.current_peak, "A", float(time[peak])),
        Demand("speed", float(np.abs(speed[fastest])) / RPM, motor.speed / RPM, "rpm", float(time[fastest])),
    ]
    if temperatures.size and thermal is not None:
        max_temperature = float(temperatures[:, 0].max())
        demands.append(Demand("winding temperature", max_temperature, thermal.maximum, "degC", base=ambient))
        if not math.isfinite(max_temperature):
            max_current = runaway_current(thermal, motor.resistance)
            demand_name = f"thermal runaway above {printed(max_current, 4)} A, rms current"
            demands[-1] = Demand(demand_name, rms_current, max_current, "A")
    elif math.isfinite(motor.current_continuous):
        demands.append(Demand("rms current", rms_current, motor.current_continuous, "A"))
    return demands, _missing_ratings(entry, ambient)


def _missing_ratings(entry: CatalogMotor, ambient: float) -> list[str]:
    """Names of missing ratings of a motor, with which its verdict might be worse."""
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
    elif ambient > _RATED_AMBIENT:
        missing.append(f"thermal, as current_continuous holds up to {printed(_RATED_AMBIENT)} degC")
    if not entry.inertia:
        missing.append("rotor: inertia")
    return missing


# ── Supply


class Supply(NamedTuple):
    """Electrical supply of all drives of a cycle; electronics are neglected."""

    peak: float
    """Largest power drawn [W]."""
    mean: float
    """Mean power drawn [W]."""
    drawn: float
    """Energy drawn in a cycle [J]."""
    braked: float
    """Energy that the drives return in a cycle [J], to the brake resistor unless the supply accepts it."""


def supply_of(powers: Iterator[Array] | list[Array], duration: Array, *, shared: bool) -> Supply:
    """Supply of drives from their powers (n,) at the nodes; if ``shared``, drives feed each other through a common link."""
    net_powers = np.array(list(powers))
    if shared:
        net_powers = net_powers.sum(axis=0)[None, :]
    drawn_power = np.maximum(net_powers, 0.0).sum(axis=0)
    braking_power = np.maximum(-net_powers, 0.0).sum(axis=0)
    drawn_energy = float(between(drawn_power) @ duration)
    braking_energy = float(between(braking_power) @ duration)
    mean_power = drawn_energy / float(duration.sum())
    return Supply(float(drawn_power.max()), mean_power, drawn_energy, braking_energy)
