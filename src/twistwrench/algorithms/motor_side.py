"""What the motors must give for the torques of the joints. Modern Robotics sections 8.9.1 and 8.9.3."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..model.model import Model
from ..typing import Array


class MotorLoads(NamedTuple):
    """One entry in the last axis per actuator, in the order of ``robot.actuators``; NaN where no motor is described."""

    torque: Array
    """N m, at the rotor."""
    speed: Array
    """rad/s, of the rotor on its stator."""
    current: Array
    """A."""
    voltage: Array
    """V, what the windings need; that of a changing current is left out."""
    power: Array
    """W, electrical, into the motor; negative where it feeds back."""
    heat: Array
    """W, lost in the windings."""


def driven_velocities(model: Model) -> list[int]:
    """Where in dq and τ each actuator acts, in the order of ``model.actuators``."""
    places = {body.joint.name: body.v_index for body in model.leaders}
    return [places[name] for name in model.actuators]


def motor_loads(model: Model, dq: Array, carried: Array, rotor: Array) -> MotorLoads:
    """From what gears carry and what rotors take, both as felt at the joints; (..., nv) each. MR eq. 8.122 and 8.123.

    A gear of efficiency η lets through η of the power that enters it, from whichever side that is.
    """
    at, actuators = driven_velocities(model), list(model.actuators.values())
    G = np.array([a.ratio for a in actuators])
    eta = np.array([a.efficiency for a in actuators])
    dq, carried, rotor = (x[..., at] for x in np.broadcast_arrays(dq, carried, rotor))
    through = np.where(carried * dq >= 0, carried / eta, carried * eta)
    torque, speed = (through + rotor) / G, G * dq
    current, voltage, heat = (np.full_like(torque, np.nan) for _ in range(3))
    for k, motor in enumerate(a.motor for a in actuators):
        if motor is not None:
            current[..., k] = motor.current(torque[..., k])
            voltage[..., k] = motor.voltage_at(current[..., k], speed[..., k])
            heat[..., k] = motor.heat(current[..., k])
    return MotorLoads(torque, speed, current, voltage, voltage * current, heat)
