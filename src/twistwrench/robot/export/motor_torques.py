"""Torques at the motor shafts as a quantity for export."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ...compiler.ir.tracer import trace
from ...core.errors import KernelError, ModelError
from ...core.text import Argument, Placeholder, in_the_shell, spell
from ...core.typing import Array
from ...mechanics.algorithms.friction import either, friction_forces, positive
from ...mechanics.algorithms.inverse_dynamics import drive_torques
from ...mechanics.algorithms.motor_loads import driven_velocities
from ...mechanics.model.actuators import STANDING
from ...mechanics.model.couplings import motor_torques, motor_velocities
from ..programs import inputs_of
from .request import Request

if TYPE_CHECKING:
    from .. import Robot


def with_motor_torques(robot: Robot, request: Request) -> Request:
    """Request for inverse dynamics with torques converted to the motor side of the gears.

    Raises KernelError for another quantity, and ModelError for a joint without an actuator.
    """
    model = robot.model
    options = request.full
    option = spell(Argument("torque", "motor", option="torque-side"))
    is_varied = "derivative" in options or "parameters" in options
    if request.quantity != "inverse_dynamics" or is_varied:
        raise KernelError(
            f"{option} applies to inverse_dynamics, not to {request.function.name}. Export {request.quantity} by itself."
        )
    driven = driven_velocities(model)
    names_without_actuator = [name for k, name in enumerate(model.drive_names) if k not in driven]
    if names_without_actuator:
        remedy = "robot.with_actuators(file)"
        if in_the_shell():
            remedy = spell(Argument("actuators", Placeholder("FILE")))
        raise ModelError(
            f"{option} needs an actuator at every joint; there is none at {', '.join(names_without_actuator)}. Describe "
            f"them: {remedy}."
        )
    gears = [(actuator.ratio, actuator.efficiency, actuator.no_load_torque) for actuator in model.actuators.values()]
    by_velocity = np.argsort(driven)
    ratio, efficiency, no_load_torque = np.array(gears, float)[by_velocity].T  # (nv,) each
    ports = inputs_of(model, "inverse_dynamics", options)
    other_labels = [label for label, _ in ports[3:]]  # of the inputs after q, dq and ddq

    def torques(q: Array, dq: Array, ddq: Array, *other_inputs: Array) -> Array:
        """Torques (nv,) at the motor shafts."""
        inputs = dict(zip(other_labels, other_inputs, strict=True))
        wrenches = {}  # by the robot
        for frame in options.get("wrenches", ()):
            sign = -1.0 if frame in options.get("on_robot", ()) else 1.0
            wrenches[frame] = sign * inputs[f"wrench at {frame}"]
        own_model = model
        if "gravity" in inputs:
            own_model = replace(model, gravity=inputs["gravity"])
        gear_torques, rotor_torques = drive_torques(own_model, q, dq, ddq, wrenches)
        if options.get("friction"):
            gear_torques = gear_torques + friction_forces(model, dq, gear_torques + rotor_torques)
        gear_torques = motor_torques(model, gear_torques)
        rotor_torques = motor_torques(model, rotor_torques)
        speeds = motor_velocities(model, dq)
        # 1, 0 or -1: a motor is at rest at speeds below STANDING.
        directions = np.array([positive(speed - STANDING) - positive(-speed - STANDING) for speed in speeds], object)
        torque_factors = []
        for torque, direction, eta in zip(gear_torques, directions, efficiency, strict=True):
            is_braking = positive(-(torque * direction))
            torque_factors.append(either(is_braking, eta, 1.0 / eta))
        shaft_torques = (gear_torques * np.array(torque_factors, object) + rotor_torques) / ratio
        if not no_load_torque.any():
            return shaft_torques
        return shaft_torques + no_load_torque * np.sign(ratio) * directions

    name = request.function.name.replace("inverse_dynamics", "motor_torques")
    program = trace(torques, ports, ["tau"])
    return replace(request, function=replace(request.function, name=name, program=program))
