"""Joints of a closed robot with a motor, and checks that these can make a motion."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from ...core.errors import ConstraintError, UnknownNameError
from ...core.numbers import printed
from ...core.typing import Array
from ...mechanics.algorithms.constraints import MAX_RESIDUAL_TORQUE, SINGULAR_VALUE
from ...mechanics.joints import Planar
from ...mechanics.model.model import BASE, Body
from .states import joints, place_in_batch

if TYPE_CHECKING:
    from ..doors import ConstrainedRobot
    from ..robot import Robot


def motor_mask(robot: Robot, actuated: Iterable[str] | None) -> Array:
    """Mask (nv,) of the velocities of the joints ``actuated``; None means :func:`motor_joints`."""
    leaders = {body.joint.name: body for body in robot.model.leaders}
    if actuated is None:
        actuated = motor_joints(robot)
    elif isinstance(actuated, str):
        actuated = [actuated]
    mask = np.zeros(robot.nv, bool)
    for name in actuated:
        if name not in leaders:
            raise UnknownNameError.from_choices("joint", name, leaders)
        _, velocities = leaders[name].places
        mask[velocities] = True
    return mask


def motor_joints(robot: Robot) -> list[str]:
    """Joints that a motor may drive: those of the file's actuators, or all except free joints and a planar base.

    Joints with their own actuator are driven in any case. The leader of a driven mimic joint is driven, too.
    """
    model = robot.model
    if not model.motor_joints:
        return [body.joint.name for body in model.leaders if body.joint.driven and not _is_planar_base(body)]
    return named_motors(robot)


def named_motors(robot: Robot) -> list[str]:
    """Joints driven by the actuators of the robot's own file or of an actuator file; empty without both."""
    model = robot.model
    # A follower has the velocity index of its leader, which is thus driven as well.
    driven_indices = {body.v_index for body in model.bodies if body.joint.name in model.motor_joints}
    return [
        body.joint.name
        for body in model.leaders
        if body.v_index in driven_indices or body.joint.name in robot.actuators
    ]


def _is_planar_base(body: Body) -> bool:
    """True for a base that slides in a plane, such as a cart's: nothing drives it."""
    return body.parent == BASE and isinstance(body.joint, Planar)


def require_balanced(closed: ConstrainedRobot, residual: Array, f: Array, is_driven: Array) -> None:
    """Raise an error if torques are left over at joints without motors.

    ``residual`` (..., n) are these torques; they may be rounding errors of the torques f (..., nv).
    """
    largest_residual = np.abs(residual).max(axis=-1, initial=0.0)
    allowed_residual = MAX_RESIDUAL_TORQUE * np.abs(f).max(axis=-1, initial=0.0)
    if (largest_residual <= allowed_residual).all():
        return
    worst_state = int((largest_residual - allowed_residual).argmax())
    robot = closed.open()
    undriven_joints = joints(robot, ~is_driven)
    driven_joints = ", ".join(joints(robot, is_driven)) or "no joint"
    bases = {body.joint.name for body in robot.model.leaders if body.parent == BASE and not body.joint.driven}
    undriven_bases = [name for name in undriven_joints if name in bases]
    if undriven_bases:
        remedy = (
            f"Nothing drives {', '.join(undriven_bases)}, and the closures cannot hold it: close with the ground what else "
            "holds it, such as another foot, or give the missing force as wrench_on_robot."
        )
    else:
        remedy = f"Degrees of freedom: {closed.nv - len(closed.independent)}; name as many joints that move them."
    residual_text = f"{printed(largest_residual.flat[worst_state], 3)} N m or N is left over"
    raise ConstraintError(
        f"joints {', '.join(undriven_joints)} have no motor, and no torques at {driven_joints} make this motion: "
        f"{residual_text}{place_in_batch(worst_state, largest_residual.shape)}. {remedy}"
    )


def require_independent(closed: ConstrainedRobot, q: Array, is_driven: Array) -> None:
    """Raise an error unless driven joints (mask (nv,)) are as many as the degrees of freedom and determine all other joints."""
    freedoms = closed.nv - len(closed.independent)
    driven_count = int(is_driven.sum())
    names = ", ".join(joints(closed.open(), is_driven)) or "no joint"
    if driven_count != freedoms:
        raise ConstraintError(
            f"{names}: {driven_count} velocities, and there are {freedoms} degrees of freedom. Name joints of as many "
            "velocities, the independent ones."
        )
    if not closed.independent or is_driven.all():
        return
    # The driven joints determine the others if the columns of A of the others are independent.
    rows = list(closed.independent)
    A = closed.constraint_jacobian(q)[..., rows, :]
    A = A / closed.sizes[rows, None]  # rows of usual size 1
    A_undriven = A[..., ~is_driven]
    singular_values = np.linalg.svd(A_undriven, compute_uv=False)
    ratio = singular_values[..., -1] / singular_values[..., 0]
    are_independent = (ratio > SINGULAR_VALUE).all()  # False also for NaN
    if not are_independent:
        worst_state = int(np.argmin(ratio))
        raise ConstraintError(
            f"{names} do not determine the other joints{place_in_batch(worst_state, ratio.shape)}: a dead centre, or a "
            "singular configuration. Choose other joints, or go round it."
        )
