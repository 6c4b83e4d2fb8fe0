"""Quantities that constraints change, marked "projected" in the table: dynamics with constraint forces.

    τ = M q̈ + h + A'λ,   A q̈ + (dA/dt) dq = 0        (MR section 8.7)

The robot exerts λ on its constraints, as F_by in τ = M q̈ + h + J'F_by. M, h and f = M q̈ + h are those of the robot with
its loops open. :class:`.quantity_methods.QuantityMethods` documents arguments and results.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ...core import arguments, third_party
from ...core.typing import Array
from ...mechanics.algorithms.constraint_projector import needs_singular_values
from ...mechanics.algorithms.constraints import (
    Closure,
    ConstrainedDerivatives,
    ConstrainedMotion,
    ConstrainedTorques,
    Rolling,
    Slopes,
    balance,
    constrained_derivatives,
    names,
    place_of,
)
from ...mechanics.model.model import BASE
from ..arguments import Wrenches, finite_states
from .drives import motor_mask, require_balanced, require_independent
from .states import require_met, warn_of_singular

if TYPE_CHECKING:
    from ..doors import ConstrainedRobot
    from ..explanation import Explanation


@third_party.lazy_by_blocks(lambda closed, _: [(closed.nv,), (len(closed.sizes),)], ConstrainedMotion)
def forward_dynamics(
    closed: ConstrainedRobot,
    q: ArrayLike,
    dq: ArrayLike,
    tau: ArrayLike,
    *,
    wrench_by_robot: Wrenches | None = None,
    wrench_on_robot: Wrenches | None = None,
    friction: bool = False,
) -> ConstrainedMotion:
    """q̈ and λ = (A M⁻¹ A')⁻¹ (A M⁻¹ (τ - h) + (dA/dt) dq); of several λ, if A loses rank, that of minimal norm."""
    robot = closed.open()
    independent_constraints = closed._independent_constraints
    q, dq, tau = finite_states(robot.model, "forward_dynamics", q=q, dq=dq, tau=tau)
    require_met(closed, q, dq)
    if friction:
        tau = robot.engine.call("torque_past_friction", dq, tau)
    if not independent_constraints:
        ddq = robot.forward_dynamics(q, dq, tau, wrench_by_robot=wrench_by_robot, wrench_on_robot=wrench_on_robot)
        zero_lam = np.zeros((*ddq.shape[:-1], len(closed.sizes)), ddq.dtype)
        return ConstrainedMotion(ddq, zero_lam)
    independent_rows = list(closed.independent)  # indices in A
    row_count = len(closed.sizes)
    call_engine = robot.engine.call_with_wrenches
    with np.errstate(all="ignore"):  # singular states are replaced below
        ddq, independent_lam, pivots = call_engine(
            "constrained_dynamics",
            (q, dq, tau),
            wrench_by_robot,
            wrench_on_robot,
            None,
            constraints=independent_constraints,
        )
    lam = np.zeros((*independent_lam.shape[:-1], row_count), independent_lam.dtype)
    lam[..., independent_rows] = independent_lam
    is_singular = needs_singular_values(pivots, closed.sizes[independent_rows])
    has_dependent_rows = len(independent_rows) < row_count
    if has_dependent_rows and not is_singular.all():  # of several λ, the one of minimal norm
        is_regular = ~is_singular
        regular_q = np.broadcast_to(q, (*is_singular.shape, closed.nq))[is_regular]
        _, projector = closed._projector(regular_q)
        lam_columns = lam[is_regular][..., None]
        lam[is_regular] = (projector.range @ lam_columns)[..., 0]
    if is_singular.any():  # pseudo-inverse from singular values: valid for any rank of A
        h = call_engine("bias_forces", (q, dq), wrench_by_robot, wrench_on_robot, None)
        batch_shape = is_singular.shape
        singular_q = np.broadcast_to(q, (*batch_shape, closed.nq))[is_singular]
        singular_dq = np.broadcast_to(dq, (*batch_shape, closed.nv))[is_singular]
        force = np.broadcast_to(tau - h, (*batch_shape, closed.nv))[is_singular]
        _, projector = closed._projector(singular_q)
        warn_of_singular(projector.rank, len(independent_rows))
        bias = closed.constraint_bias(singular_q, singular_dq)
        ddq[is_singular], lam[is_singular] = projector.constrained_acceleration(force, bias)
    return ConstrainedMotion(ddq, lam)


@third_party.lazy_by_blocks(lambda closed, _: [(closed.nv,), (len(closed.sizes),)], ConstrainedTorques)
def inverse_dynamics(
    closed: ConstrainedRobot,
    q: ArrayLike,
    dq: ArrayLike,
    ddq: ArrayLike,
    actuated: Iterable[str] | None = None,
    *,
    wrench_by_robot: Wrenches | None = None,
    wrench_on_robot: Wrenches | None = None,
    friction: bool = False,
) -> ConstrainedTorques:
    """τ = f + A'λ of the ``actuated`` joints, zero at the others, and λ; of several τ, that of minimal norm."""
    robot = closed.open()
    q, dq, ddq = finite_states(robot.model, "inverse_dynamics", q=q, dq=dq, ddq=ddq)
    require_met(closed, q, dq, ddq)
    is_driven = motor_mask(robot, actuated)
    with np.errstate(all="ignore"):
        f = robot.inverse_dynamics(
            q, dq, ddq, wrench_by_robot=wrench_by_robot, wrench_on_robot=wrench_on_robot, friction=friction
        )
    f = arguments.finite(
        f, "inverse_dynamics: the torque of wrench_by_robot, wrench_on_robot and the motion", closed.nv
    )
    A, projector = closed._projector(q)
    # A is projected because λ of rows that no motion changes would be arbitrary.
    lam, residual = balance(f, projector.range @ A, closed.sizes, is_driven)
    require_balanced(closed, residual, f, is_driven)
    constraint_torques = (np.swapaxes(A, -1, -2) @ lam[..., None])[..., 0]  # A'λ
    tau = np.where(is_driven, f + constraint_torques, 0.0)
    lam = (projector.range @ lam[..., None])[..., 0]
    return ConstrainedTorques(tau.astype(f.dtype, copy=False), lam.astype(f.dtype, copy=False))


def holding_torques(
    closed: ConstrainedRobot, q: ArrayLike, actuated: Iterable[str] | None = None, **wrenches: Any
) -> ConstrainedTorques:
    """:func:`inverse_dynamics` at rest, τ = g + A'λ + Σ J'F_by - Σ J'F_on."""
    zero = np.zeros(closed.nv)
    return inverse_dynamics(closed, q, zero, zero, actuated, **wrenches)


def joint_wrenches(
    closed: ConstrainedRobot,
    q: ArrayLike,
    dq: ArrayLike,
    ddq: ArrayLike,
    actuated: Iterable[str] | None = None,
    **wrenches: Any,
) -> Array:
    """Wrenches across the joints of the open robot, with λ of :func:`inverse_dynamics` on both links of each closure."""
    robot = closed.open()
    lam = inverse_dynamics(closed, q, dq, ddq, actuated, **wrenches).lam
    total = robot.joint_wrenches(q, dq, ddq, **wrenches)
    unloaded = robot.joint_wrenches(q, dq, ddq)
    # One frame at a time, since a frame may occur in several constraints.
    for frame, F in link_wrenches(closed, np.asarray(q, float), lam):
        loaded = robot.joint_wrenches(q, dq, ddq, wrench_by_robot={frame: F})
        total = total + (loaded - unloaded)
    return total


def explanation(
    closed: ConstrainedRobot,
    q: ArrayLike,
    dq: ArrayLike,
    ddq: ArrayLike,
    actuated: Iterable[str] | None = None,
    *,
    friction: bool = False,
    **wrenches: Any,
) -> Explanation:
    """Torques of :func:`inverse_dynamics` by term and cause: τ = f + A'λ is linear in f."""
    robot = closed.open()
    inverse_dynamics(closed, q, dq, ddq, actuated, friction=friction, **wrenches)  # checks state and motors
    explanation_of_tree = robot.explain(q, dq, ddq, friction=friction, **wrenches)
    is_driven = motor_mask(robot, actuated)
    (q,) = finite_states(robot.model, "explain", q=q)
    A = closed.constraint_jacobian(q)[..., None, None, :, :]  # for each term and cause
    lam, _ = balance(explanation_of_tree.parts, A, closed.sizes, is_driven)
    constraint_torques = (np.swapaxes(A, -1, -2) @ lam[..., None])[..., 0]  # A'λ
    driven_parts = np.where(is_driven, explanation_of_tree.parts + constraint_torques, 0.0)
    return replace(explanation_of_tree, parts=driven_parts)


def inverse_dynamics_derivatives(
    closed: ConstrainedRobot,
    q: ArrayLike,
    dq: ArrayLike,
    ddq: ArrayLike,
    actuated: Iterable[str] | None = None,
    **wrenches: Any,
) -> ConstrainedDerivatives:
    """Derivatives of the motor torques by the motors' q, dq and ddq, along motions that satisfy the constraints."""
    robot = closed.open()
    independent_constraints = closed._independent_constraints
    is_driven = motor_mask(robot, actuated)
    q, dq, ddq = (x.astype(float) for x in finite_states(robot.model, "derivatives", q=q, dq=dq, ddq=ddq))
    batch_shape = np.broadcast_shapes(*(x.shape[:-1] for x in (q, dq, ddq)))
    q, dq, ddq = (np.broadcast_to(x, (*batch_shape, x.shape[-1])) for x in (q, dq, ddq))
    require_met(closed, q, dq, ddq)
    require_independent(closed, q, is_driven)
    f = robot.inverse_dynamics(q, dq, ddq, **wrenches)
    f_by_q, f_by_dq = robot.inverse_dynamics_derivatives(q, dq, ddq, **wrenches)
    independent_rows = list(closed.independent)
    if not independent_rows:
        A = b_by_q = b_by_dq = np.zeros((*q.shape[:-1], 0, closed.nv))
        A_by_q = np.zeros((*q.shape[:-1], 0, closed.nv, closed.nv))
    else:
        A = closed.constraint_jacobian(q)[..., independent_rows, :]
        jacobian_kernel = robot.kernel("constraint_jacobian", constraints=independent_constraints, by="q")
        bias_kernel = robot.kernel("constraint_bias", constraints=independent_constraints, by=("q", "dq"))
        A_by_q = jacobian_kernel(q)
        b_by_q, b_by_dq = bias_kernel(q, dq)
    slopes = Slopes(A, A_by_q, b_by_q, b_by_dq, f, f_by_q, f_by_dq, robot.mass_matrix(q))
    return constrained_derivatives(slopes, dq, ddq, is_driven)


# ── Constraint forces as wrenches on the links of the open robot

# With T_cb = (R, p), a closure's λ is the wrench F = (m, f) that {b} applies to {a} at the origin of {b}, along the axes
# of {c}. The robot then applies
#
#     at {b}:  (R'm, R'f),        at {a}:  -(R_ac (m + p × f) + p_ac × R_ac f, R_ac f)


def link_wrenches(closed: ConstrainedRobot, q: Array, lam: Array) -> list[tuple[str, Array]]:
    """Wrenches by the robot that are equivalent to λ (..., k): pairs of a frame and its wrench (..., 6), without the ground."""
    pairs: list[tuple[str, Array]] = []
    robot = closed.open()
    closure_poses: Iterator[Array] = iter(())
    if any(isinstance(constraint, Closure) for constraint in closed.constraints):
        T = robot.engine.call("closure_poses", q, constraints=closed.constraints)
        closure_poses = iter(np.moveaxis(T, -3, 0))  # one T_cb for each closure, in the order of the constraints
    for name, constraint in zip(names(closed.constraints), closed.constraints, strict=True):
        F = closed.wrenches(lam)[name]
        if isinstance(constraint, Rolling):
            T = robot.forward_kinematics(q, constraint.frame)
            pairs.append((constraint.frame, _body_wrench(constraint.kind, T, F)))
            continue
        T_cb = next(closure_poses)
        R_bc = np.swapaxes(T_cb[..., :3, :3], -1, -2)
        if place_of(robot.model, constraint.frame_b).body != BASE:
            pairs.append((constraint.frame_b, _rotate(R_bc, F)))
        if place_of(robot.model, constraint.frame_a).body != BASE:
            F_c = _transform(np.eye(3), T_cb[..., :3, 3], F)
            T_ac = constraint.T_ac
            pairs.append((constraint.frame_a, -_transform(T_ac[:3, :3], T_ac[:3, 3], F_c)))
    return pairs


def _body_wrench(kind: str, T: Array, F: Array) -> Array:
    """Wrench in a frame with the pose T, from a wrench F as the Jacobian of this kind takes it: body, space or mixed."""
    if kind == "body":
        return F
    if kind == "space":
        F = _transform(np.eye(3), -T[..., :3, 3], F)
    return _rotate(np.swapaxes(T[..., :3, :3], -1, -2), F)


def _rotate(R: Array, F: Array) -> Array:
    """Wrench (R m, R f)."""
    m = (R @ F[..., :3, None])[..., 0]
    f = (R @ F[..., 3:, None])[..., 0]
    return np.concatenate([m, f], axis=-1)


def _transform(R: Array, p: Array, F: Array) -> Array:
    """Wrench (R m + p × R f, R f), transformed to another frame in which the original frame has the pose (R, p)."""
    rotated = _rotate(R, F)
    m, f = rotated[..., :3], rotated[..., 3:]
    return np.concatenate([m + np.cross(p, f), f], axis=-1)
