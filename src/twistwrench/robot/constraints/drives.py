"""Joints of a closed robot with a motor, and torques that they can make."""

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
    """Mask of the velocities of the named joints (None: all with a motor, see :func:`motor_joints`); (nv,)."""
    leaders = {b.joint.name: b for b in robot.model.leaders}
    if actuated is None:
        actuated = motor_joints(robot)
    elif isinstance(actuated, str):
        actuated = [actuated]
    mask = np.zeros(robot.nv, bool)
    for name in actuated:
        if name not in leaders:
            raise UnknownNameError.from_choices("joint", name, leaders)
        mask[leaders[name].v_index : leaders[name].v_index + leaders[name].joint.nv] = True
    return mask


def motor_joints(robot: Robot) -> list[str]:
    """Joints that a motor may drive: those of the file's actuators, or all except free joints and a planar base.

    Joints with an actuator of their own are driven in any case. If a follower of a mimic joint is driven, its leader is.
    """
    model = robot.model
    if not model.motor_joints:
        return [b.joint.name for b in model.leaders if b.joint.driven and not _is_planar_base(b)]
    return named_motors(robot)


def named_motors(robot: Robot) -> list[str]:
    """Joints driven by the actuators of the robot's own file or of an actuator file; empty without both."""
    model = robot.model
    at = {b.v_index for b in model.bodies if b.joint.name in model.motor_joints}
    return [b.joint.name for b in model.leaders if b.v_index in at or b.joint.name in robot.actuators]


def _is_planar_base(body: Body) -> bool:
    """True for a base that glides in a plane, such as a cart's: nothing drives it."""
    return body.parent == BASE and isinstance(body.joint, Planar)


def require_balanced(closed: ConstrainedRobot, residual: Array, f: Array, driven: Array) -> None:
    """Raise an error if residual torques (..., n) at joints without motors exceed rounding errors of f (..., nv)."""
    largest = np.abs(residual).max(axis=-1, initial=0.0)
    allowed = MAX_RESIDUAL_TORQUE * np.abs(f).max(axis=-1, initial=0.0)
    if (largest <= allowed).all():
        return
    worst = int((largest - allowed).argmax())
    idle, moving = joints(closed.open(), ~driven), joints(closed.open(), driven)
    bases = {b.joint.name for b in closed.open().model.leaders if b.parent == BASE and not b.joint.driven}
    if loose := [name for name in idle if name in bases]:
        remedy = (
            f"Nothing drives {', '.join(loose)}, and the closures cannot hold it: close with the ground what else holds it, "
            "such as another foot, or give the missing force as wrench_on_robot."
        )
    else:
        remedy = f"Degrees of freedom: {closed.nv - len(closed.independent)}; name as many joints that move them."
    raise ConstraintError(
        f"joints {', '.join(idle)} have no motor, and no torques at {', '.join(moving) or 'no joint'} make this motion: "
        f"{printed(largest.flat[worst], 3)} N m or N is left over{place_in_batch(worst, largest.shape)}. {remedy}"
    )


def require_independent(closed: ConstrainedRobot, q: Array, driven: Array) -> None:
    """Raise an error unless the joints ``driven`` (nv,) determine all others and match the degrees of freedom in number."""
    free, count = closed.nv - len(closed.independent), int(driven.sum())
    names = ", ".join(joints(closed.open(), driven)) or "no joint"
    if count != free:
        raise ConstraintError(
            f"{names}: {count} velocities, and there are {free} degrees of freedom. Name joints of as many velocities, the "
            "independent ones."
        )
    if not closed.independent or not (~driven).any():
        return
    rows = list(closed.independent)
    A = closed.constraint_jacobian(q)[..., rows, :][..., ~driven] / closed.sizes[rows, None]
    sigma = np.linalg.svd(A, compute_uv=False)
    condition = sigma[..., -1] / sigma[..., 0]
    if not (condition > SINGULAR_VALUE).all():
        worst = int(np.argmin(condition))
        raise ConstraintError(
            f"{names} do not determine the other joints{place_in_batch(worst, condition.shape)}: a dead centre, or a singular "
            "configuration. Choose other joints, or go round it."
        )
