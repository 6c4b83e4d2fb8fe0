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
    model, full = robot.model, request.full
    option = spell(Argument("torque", "motor", option="torque-side"))
    if request.quantity != "inverse_dynamics" or "derivative" in full or "parameters" in full:
        raise KernelError(
            f"{option} applies to inverse_dynamics, not to {request.function.name}. Export {request.quantity} by itself."
        )
    driven, actuators = driven_velocities(model), list(model.actuators.values())
    missing = [name for k, name in enumerate(model.drive_names) if k not in driven]
    if missing:
        remedy = "robot.with_actuators(file)"
        if in_the_shell():
            remedy = spell(Argument("actuators", Placeholder("FILE")))
        raise ModelError(
            f"{option} needs an actuator at every joint; there is none at {', '.join(missing)}. Describe them: {remedy}."
        )
    gears = [(actuator.ratio, actuator.efficiency, actuator.no_load_torque) for actuator in actuators]
    ratio, efficiency, no_load_torque = np.array(gears, float)[np.argsort(driven)].T
    ports = inputs_of(model, "inverse_dynamics", full)

    def torques(q: Array, dq: Array, ddq: Array, *more: Array) -> Array:
        inputs = dict(zip([label for label, _ in ports[3:]], more, strict=True))
        wrenches = {}
        for frame in full.get("wrenches", ()):
            sign = -1.0 if frame in full.get("on_robot", ()) else 1.0
            wrenches[frame] = sign * inputs[f"wrench at {frame}"]
        own_model = model
        if "gravity" in inputs:
            own_model = replace(model, gravity=inputs["gravity"])
        carried, rotor = drive_torques(own_model, q, dq, ddq, wrenches)
        if full.get("friction"):
            carried = carried + friction_forces(model, dq, carried + rotor)
        carried, rotor = motor_torques(model, carried), motor_torques(model, rotor)
        speeds = motor_velocities(model, dq)
        directions = np.array([positive(w - STANDING) - positive(-w - STANDING) for w in speeds], object)
        braking = [positive(-(force * direction)) for force, direction in zip(carried, directions, strict=True)]
        share = np.array([either(b, e, 1.0 / e) for b, e in zip(braking, efficiency, strict=True)], object)
        torque = (carried * share + rotor) / ratio
        if not no_load_torque.any():
            return torque
        return torque + no_load_torque * np.sign(ratio) * directions

    name = request.function.name.replace("inverse_dynamics", "motor_torques")
    return replace(request, function=replace(request.function, name=name, program=trace(torques, ports, ["tau"])))
