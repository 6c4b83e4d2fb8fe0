"""Motor torques from joint torques, and the power balance. Modern Robotics sections 8.9.1 and 8.9.3."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...core.numbers import printed
from ...core.typing import Array
from ..model.actuators import gear_input, moving
from ..model.couplings import motor_torques, motor_velocities
from ..model.model import Model


class MotorLoads(NamedTuple):
    """Motor loads, one entry per actuator (last axis), in the order of ``robot.actuators``; NaN for unspecified motors."""

    torque: Array
    """Torque at the rotor [N m]."""
    speed: Array
    """Speed of the rotor relative to its stator [rad/s]."""
    current: Array
    """Motor current [A]."""
    voltage: Array
    """Voltage of the windings [V], without the inductive part."""
    power: Array
    """Electrical power into the motor [W]; negative when it regenerates."""
    heat: Array
    """Heat loss in the windings [W]."""


def driven_velocities(model: Model) -> list[int]:
    """Index of each actuator among the drives' velocities and torques, in the order of ``model.actuators``."""
    return [model.drive_names.index(name) for name in model.actuators]


def motor_loads(model: Model, dq: Array, carried: Array, rotor: Array) -> MotorLoads:
    """Motor loads from the torques ``carried`` by the gears and the ``rotor`` torques; MR eq. 8.122 and 8.123.

    Both torques are given at the joints, (..., nv) each. A gear of efficiency η transmits the fraction η of the power that
    enters it, in either direction. At rest the motor carries the larger torque, T/η.
    """
    driven_entries = driven_velocities(model)
    actuators = model.actuators.values()
    dq = motor_velocities(model, dq)
    carried = motor_torques(model, carried)
    rotor = motor_torques(model, rotor)
    dq, carried, rotor = (x[..., driven_entries] for x in np.broadcast_arrays(dq, carried, rotor))
    gears = [(actuator.ratio, actuator.efficiency, actuator.no_load_torque) for actuator in actuators]
    G, eta, no_load_torque = np.array(gears, float).reshape(-1, 3).T  # also without actuators
    speed = G * dq
    direction = np.sign(G * moving(dq))  # 0 at rest
    torque = (gear_input(carried, dq, eta) + rotor) / G + no_load_torque * direction
    current, voltage, heat = np.full((3, *torque.shape), np.nan)  # NaN stays for unspecified motors
    for k, actuator in enumerate(actuators):
        motor = actuator.motor
        if motor is not None:
            current[..., k] = motor.current(torque[..., k])
            voltage[..., k] = motor.voltage_at(current[..., k], speed[..., k])
            heat[..., k] = motor.heat(current[..., k])
    return MotorLoads(torque, speed, current, voltage, voltage * current, heat)


# ── Power balance


class PowerBalance(NamedTuple):
    """Powers into the mechanism [W]; powers out of it are negative. The sum is zero."""

    joints: Array
    """Power of the joints, τ'dq."""
    motion: Array
    """Minus the rate of kinetic and potential energy, including springs."""
    wrenches: Array
    """Minus the power that the robot delivers through the wrenches."""
    friction: Array
    """Minus the friction loss in the joints."""

    def __str__(self) -> str:
        if np.ndim(self.joints):
            return f"<PowerBalance of states {np.shape(self.joints)}>"
        powers = [f"{name} {printed(float(value), 4, signed=True)} W" for name, value in self._asdict().items()]
        return f"into the mechanism from: {', '.join(powers)}"


def power_balance(dq: Array, tau: Array, moving: Array, pushing: Array, lost: Array) -> PowerBalance:
    """Power balance of torques (..., nv): τ and its parts M ddq + h (``moving``), Σ J'F (``pushing``), friction (``lost``)."""

    def power(torques: Array) -> Array:
        """Power of torques at the velocities dq [W]."""
        return np.asarray(np.sum(torques * dq, axis=-1))

    return PowerBalance(power(tau), power(-moving), power(-pushing), power(-lost))
