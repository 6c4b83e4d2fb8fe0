"""Constrained dynamics, A(q) dq = 0: rows of constraints, forces, and derivatives. Modern Robotics section 8.7.

There are two kinds of constraints, both plain data. A :class:`Closure` attaches a frame {b} to a frame {c} fixed in {a}.
With T_cb = (R, p), its six rows are the angular velocity of {b} relative to {c} and the rate of p,

    V_cb = (w, dp/dt),   [w] = (dR/dt) R'.

The closure sets the chosen rows of V_cb to zero. A :class:`Rolling` sets chosen rows of one frame's twist to zero; such
rows may be nonholonomic. λ is the wrench that {b} exerts on {a}, at the origin of {b} in axes of {c}, like the book's F_tip.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ...core.typing import Array
from ..lie import se3, so3
from ..lie.adjoint import Ad, ad
from ..lie.labelled import TWIST
from ..model.model import BASE, Body, Frame, Model
from .inverse_dynamics import Wrenches, bias_forces
from .kinematics import jacobian, jacobian_rate
from .mass_matrix import ldl_factors, mass_matrix, solve_ldl, solve_transposed, solve_triangular
from .recursion import ancestors, joint_poses, zeros

GROUND = "ground"
"""Name of the base in a closure, floating or not; a link of that name has priority."""


@dataclass(frozen=True)
class Closure:
    """Attachment of {b} to {c}: the chosen rows of the twist V_cb are zero. ``pose`` is the pose of {c} in {a}."""

    frame_a: str
    frame_b: str
    rows: tuple[int, ...]
    """Indices of the chosen rows of V_cb."""
    pose: tuple[tuple[float, ...], ...]

    @property
    def name(self) -> str:
        """Names of the two frames, as one text."""
        return f"{self.frame_a}–{self.frame_b}"

    @cached_property
    def T_ac(self) -> Array:
        """``pose`` as an array (4, 4), read-only."""
        T = np.array(self.pose)
        T.setflags(write=False)
        return T

    def __getstate__(self) -> dict[str, Any]:
        # Without the cached T_ac: an array comes out of a pickle writable.
        return {entry.name: getattr(self, entry.name) for entry in fields(self)}


@dataclass(frozen=True)
class Rolling:
    """Chosen rows of a frame's twist are zero; ``kind`` is the kind of Jacobian that gives the twist."""

    frame: str
    rows: tuple[int, ...]
    kind: str

    @property
    def name(self) -> str:
        """Name of the frame."""
        return self.frame


Constraint = Closure | Rolling


def names(constraints: Sequence[Constraint]) -> tuple[str, ...]:
    """Name of each constraint, made of its frames; repeated names get a number."""
    frame_names = [constraint.name for constraint in constraints]
    numbered = []
    for k, name in enumerate(frame_names):
        repetitions = frame_names[:k].count(name)
        numbered.append(f"{name} #{repetitions + 1}" if repetitions else name)
    return tuple(numbered)


def row_names(constraints: Sequence[Constraint]) -> tuple[str, ...]:
    """Name of each row of A: the constraint's name and the name of the twist's row."""
    texts: list[str] = []
    for name, constraint in zip(names(constraints), constraints, strict=True):
        texts += [f"{name} {TWIST[row]}" for row in constraint.rows]
    return tuple(texts)


def with_gaps(constraints: Sequence[Constraint]) -> list[bool]:
    """True for each row of A that belongs to a closure: these rows have a position error (gap)."""
    return [isinstance(constraint, Closure) for constraint in constraints for _ in constraint.rows]


def independent_constraints(constraints: Sequence[Constraint], independent: Sequence[int]) -> tuple[Constraint, ...]:
    """Constraints with only the rows of A whose numbers are in ``independent``; a constraint without such rows is dropped."""
    reduced: list[Constraint] = []
    first_row = 0  # number of the constraint's first row in A
    for constraint in constraints:
        rows = tuple(row for n, row in enumerate(constraint.rows) if first_row + n in independent)
        first_row += len(constraint.rows)
        if rows:
            reduced.append(replace(constraint, rows=rows))
    return tuple(reduced)


def place_of(model: Model, frame: str) -> Frame:
    """Frame of that name; ``"ground"`` gives the base frame."""
    if frame == GROUND and frame not in model.all_frames:
        return Frame(BASE, np.eye(4))
    return model.frame(frame)


def _joint_path(model: Model, q: Array, closure: Closure) -> tuple[list[tuple[Body, Array, float]], Array]:
    """Path of joints from {c} to {b}, each as (body, T_c,body, sign), and the pose T_cb.

    The path leads from {c} up to the nearest common ancestor and from there down to {b}. The sign is -1 on the way up, where
    a joint moves {c}, and 1 on the way down, where a joint moves {b}.
    """
    a = place_of(model, closure.frame_a)
    b = place_of(model, closure.frame_b)
    poses_in_parents = joint_poses(model, q)
    ancestors_of_a = list(ancestors(model, a.body))  # from the body to the base
    ancestors_of_b = list(ancestors(model, b.body))
    while ancestors_of_a and ancestors_of_b and ancestors_of_a[-1] == ancestors_of_b[-1]:
        ancestors_of_a.pop()  # common ancestors move both frames alike
        ancestors_of_b.pop()
    path: list[tuple[Body, Array, float]] = []
    T = se3.inverse(a.pose @ closure.T_ac)  # pose in {c} of the body that the path has reached
    for i in ancestors_of_a:
        path.append((model.bodies[i], T, -1.0))
        T = T @ se3.inverse(poses_in_parents[i])
    for i in reversed(ancestors_of_b):
        T = T @ poses_in_parents[i]
        path.append((model.bodies[i], T, 1.0))
    return path, np.asarray(T @ b.pose)


def _axes_on_path(model: Model, q: Array, closure: Closure) -> tuple[list[tuple[Body, Array]], Array]:
    """Pairs of each body on the path and its joint's screw axes (k, 6) in {c}, and the position p of {b} in {c}.

    The axes carry the sign and the gear ratio, so that their sum over all joints, times dq, is the twist of {b}.
    """
    path, T_cb = _joint_path(model, q, closure)
    axes = [(body, sign * body.ratio * Ad(T).apply(body.joint.axes)) for body, T, sign in path]
    return axes, T_cb[:3, 3]


def _relative_jacobian(model: Model, q: Array, closure: Closure) -> Array:
    """Jacobian J with V_cb = J dq; (6, nv)."""
    J = zeros(6, model.nv)
    axes_on_path, p = _axes_on_path(model, q, closure)
    for body, axes in axes_on_path:
        _, columns = body.places
        twists = np.array([_twist_at_point(p, axis) for axis in axes])  # of {b} at unit rates
        J[:, columns] = J[:, columns] + twists.T
    return J


def _relative_bias(model: Model, q: Array, dq: Array, closure: Closure) -> Array:
    """dV_cb/dt at ddq = 0; (6,). A joint's axes move with the joints before it on the path: d(axis)/dt = [V, axis]."""
    V, dV = zeros(6), zeros(6)
    axes_on_path, p = _axes_on_path(model, q, closure)
    for body, axes in axes_on_path:
        _, columns = body.places
        V_joint = dq[columns] @ axes
        dV = dV + ad(V) @ V_joint  # V may include V_joint or not, since [V_joint, V_joint] = 0
        V = V + V_joint
    dp = _twist_at_point(p, V)[3:]
    dV_at_point = _twist_at_point(p, dV)
    ddp = dV_at_point[3:] + so3.cross(V[:3], dp)
    return np.concatenate([dV[:3], ddp])


def _twist_at_point(p: Array, V: Array) -> Array:
    """(w, v + w × p): twist V = (w, v) with the velocity of the point p in place of that of the point at the origin."""
    return np.concatenate([V[:3], V[3:] + so3.cross(V[:3], p)])


def closure_poses(model: Model, q: Array, constraints: tuple[Constraint, ...]) -> Array:
    """T_cb of each closure; (n, 4, 4)."""
    closures = [constraint for constraint in constraints if isinstance(constraint, Closure)]
    poses = []
    for closure in closures:
        _, T_cb = _joint_path(model, q, closure)
        poses.append(T_cb)
    return np.array(poses).reshape(-1, 4, 4)


def constraint_jacobian(model: Model, q: Array, constraints: tuple[Constraint, ...]) -> Array:
    """A in A dq = 0; (k, nv). MR section 8.7."""
    rows = []
    for constraint in constraints:
        if isinstance(constraint, Closure):
            J = _relative_jacobian(model, q, constraint)
        else:
            J = jacobian(model, q, constraint.frame, constraint.kind)
        rows.append(J[list(constraint.rows)])
    return np.concatenate(rows)


def constraint_bias(model: Model, q: Array, dq: Array, constraints: tuple[Constraint, ...]) -> Array:
    """(dA/dt) dq, so that A ddq + (dA/dt) dq = 0; (k,). MR section 8.7."""
    biases = []
    for constraint in constraints:
        rows = list(constraint.rows)
        if isinstance(constraint, Closure):
            biases.append(_relative_bias(model, q, dq, constraint)[rows])
        else:
            dJ = jacobian_rate(model, q, dq, constraint.frame, constraint.kind)
            biases.append(dJ[rows] @ dq)
    return np.concatenate(biases)


def constrained_dynamics(
    model: Model,
    q: Array,
    dq: Array,
    tau: Array,
    wrenches: Wrenches | None = None,
    constraints: tuple[Constraint, ...] = (),
) -> tuple[Array, Array, Array]:
    """q̈ and λ of τ = M q̈ + h + A'λ, A q̈ + (dA/dt) dq = 0, and the pivots of A M⁻¹ A'; (nv,), (k,), (k,).

    M = L'DL is factored once. With Y = L⁻ᵀA' and z = L⁻ᵀ(τ - h),

        S λ = Y'D⁻¹z + (dA/dt) dq,   S = A M⁻¹ A' = Y'D⁻¹Y = R'ER
        q̈ = M⁻¹ (τ - h - A'λ) = L⁻¹ D⁻¹ (z - Yλ)

    and the pivots are E. In the code ``D_inverse`` and ``E_inverse`` stand for D⁻¹ and E⁻¹, which :func:`ldl_factors` returns.
    """
    L, D_inverse = ldl_factors(mass_matrix(model, q))
    Y = solve_transposed(L, constraint_jacobian(model, q, constraints).T)
    z = solve_transposed(L, tau - bias_forces(model, q, dq, wrenches))
    R, E_inverse = ldl_factors(Y.T @ (D_inverse[:, None] * Y))
    right_side = Y.T @ (D_inverse * z) + constraint_bias(model, q, dq, constraints)
    lam = solve_ldl(R, E_inverse, right_side)
    ddq = solve_triangular(L, D_inverse * (z - Y @ lam))
    return ddq, lam, 1.0 / E_inverse


SINGULAR_VALUE = 1e-9
"""Largest singular value, relative to the norm of the scaled A', that counts as zero: λ in its direction does not load
joints."""
MAX_RESIDUAL_TORQUE = 1e-6
"""Largest residual torque at joints without motors, relative to the largest torque, at which motor torques produce the motion.
It allows for the constraint errors that integrators leave in configurations and velocities."""


def balance(f: Array, A: Array, sizes: Array, driven: Array) -> tuple[Array, Array]:
    """λ (..., k), and the residual torques f + A'λ at the joints without motors, by two least-squares problems in sequence.

    λ minimises the residual at the joints without motors, then the torques at the ``driven`` ones. f (..., nv) is M q̈ + h;
    ``driven`` (nv,) is true where there is a motor. ``sizes`` (k,) are the usual sizes W of the rows of A: the unknowns are
    x = W λ, so that all columns of A'W⁻¹ are of one size.
    """
    At = np.swapaxes(A, -1, -2) / sizes  # A'W⁻¹
    f_column = f[..., None]
    f_driven, f_undriven = f_column[..., driven, :], f_column[..., ~driven, :]
    At_driven, At_undriven = At[..., driven, :], At[..., ~driven, :]
    max_zero = SINGULAR_VALUE * np.linalg.norm(At, axis=(-2, -1))  # largest singular value that counts as zero
    undriven_inverse = _pseudoinverse(At_undriven, max_zero)
    x = -undriven_inverse @ f_undriven
    # Projector on changes of x without effect on undriven joints
    null_space = np.eye(len(sizes)) - undriven_inverse @ At_undriven
    driven_inverse = _pseudoinverse(At_driven @ null_space, max_zero)
    x = x - null_space @ driven_inverse @ (f_driven + At_driven @ x)
    residual = f_undriven + At_undriven @ x
    return x[..., 0] / sizes, residual[..., 0]


def _pseudoinverse(X: Array, max_zero: Array) -> Array:
    """Moore–Penrose inverse; singular values up to ``max_zero`` (...) count as zero."""
    if 0 in X.shape[-2:]:
        return np.swapaxes(X, -1, -2)
    U, sigma, Vt = np.linalg.svd(X, full_matrices=False)
    is_significant = sigma > max_zero[..., None]
    safe_sigma = np.where(is_significant, sigma, 1.0)
    sigma_inverse = np.where(is_significant, 1.0 / safe_sigma, 0.0)
    return np.asarray(np.swapaxes(Vt, -1, -2) @ (sigma_inverse[..., None] * np.swapaxes(U, -1, -2)))


class ConstrainedMotion(NamedTuple):
    """Accelerations q̈ (..., nv) and constraint forces λ (..., k) [N m, N]."""

    ddq: Array
    """Accelerations (..., nv), rad/s² or m/s²."""
    lam: Array
    """Multipliers λ (..., k), N m or N, one for each row of A."""


class ConstrainedTorques(NamedTuple):
    """Torques τ (..., nv), zero at joints without a motor, and constraint forces λ (..., k) [N m, N]."""

    tau: Array
    """Joint torques (..., nv), N m or N, zero at joints without a motor."""
    lam: Array
    """Multipliers λ (..., k), N m or N, one for each row of A."""


class MotionForceSplit(NamedTuple):
    """Torques that move the robot, Pτ, and torques that only load its constraints, (1 - P)τ; (..., nv) each."""

    motion: Array
    """Torques that move the robot, Pτ; (..., nv), N m or N."""
    force: Array
    """Torques that only load the constraints, (1 - P)τ; (..., nv), N m or N."""


class ConstrainedDerivatives(NamedTuple):
    """Derivatives of the torques of the independent joints along motions that satisfy the constraints; (..., m, m) each."""

    tau_by_q: Array
    """Derivative with respect to the independent coordinates; the dependent ones follow by the constraints."""
    tau_by_dq: Array
    """Derivative with respect to the independent velocities."""
    tau_by_ddq: Array
    """Derivative with respect to the independent accelerations: the mass matrix of the motors."""


# The velocities dq consist of the independent ones u, which are those of the motors, and of the dependent ones d. With the
# columns of A in the same order, dq = (d, u), A = (A_d, A_u) and b = (dA/dt) dq:
#
#     (1)  dq = N u,  N = (-A_d⁻¹ A_u, 1)                             A dq = 0
#     (2)  A_d q̈_d = -(A_u q̈_u + b)                                  A q̈ + b = 0, MR section 8.7
#     (3)  A_d' λ = -f_d,   τ = f_u + A_u' λ                           f = M q̈ + h, no torque at the other joints
#
# ∂ is the derivative along a direction of the independent coordinates, at constant u and q̈_u:
#
#     (4)  A_d ∂dq_d = -∂A dq                                          ∂A = (dA/dq) N
#     (5)  A_d ∂q̈_d = -(∂A q̈ + ∂b),   ∂b = (db/dq) N + (db/ddq) ∂dq
#     (6)  ∂f = (df/dq) N + (df/ddq) ∂dq + M ∂q̈
#     (7)  A_d' ∂λ = -(∂f_d + ∂A_d' λ),   ∂τ = ∂f_u + ∂A_u' λ + A_u' ∂λ
#
# Here d/ddq is the derivative with respect to the velocities dq. For derivatives by u, N replaces ∂dq, and ∂A is zero.


class Slopes(NamedTuple):
    """Quantities of the open robot and its constraints at a state, with derivatives; any leading batch shape."""

    A: Array
    """Constraint Jacobian, independent rows only; (k, nv)."""
    A_by_q: Array
    """dA/dq; (k, nv, nv)."""
    b_by_q: Array
    """Derivative of b = (dA/dt) dq by q; (k, nv)."""
    b_by_dq: Array
    """Derivative of b by dq; (k, nv)."""
    f: Array
    """Torques M q̈ + h; (nv,)."""
    f_by_q: Array
    """df/dq; (nv, nv)."""
    f_by_dq: Array
    """Derivative of f by dq; (nv, nv)."""
    M: Array
    """Mass matrix; (nv, nv)."""


def constrained_derivatives(at: Slopes, dq: Array, ddq: Array, driven: Array) -> ConstrainedDerivatives:
    """Derivatives of the torques of the ``driven`` joints by their q, dq and ddq.

    ``at`` are the derivatives of the open robot at a state; ``driven`` (nv,) is true at as many joints as there are degrees of
    freedom. A name such as ``b_along_q`` is ∂b of equations (4) to (7); ``b_along_dq`` is the derivative of b by u.
    """
    u, d = driven, ~driven
    freedom = int(u.sum())
    A_d, A_u = at.A[..., d], at.A[..., u]
    N = _all_rows(-np.linalg.solve(A_d, A_u), np.eye(freedom), driven)  # (1)
    lam = -np.linalg.solve(_transpose(A_d), at.f[..., d, None])[..., 0]  # (3)
    constant_u = np.zeros((freedom, freedom))

    def torque_changes(f_along: Array, At_lam_along: Array) -> Array:
        """∂τ from ∂f and ∂A' λ."""
        lam_along = -np.linalg.solve(_transpose(A_d), f_along[..., d, :] + At_lam_along[..., d, :])  # (7)
        return np.asarray(f_along[..., u, :] + At_lam_along[..., u, :] + _transpose(A_u) @ lam_along)

    A_along_q = np.einsum("...ijk,...kl->...ijl", at.A_by_q, N)
    A_dq_along_q = np.einsum("...ijl,...j->...il", A_along_q, dq)
    A_ddq_along_q = np.einsum("...ijl,...j->...il", A_along_q, ddq)
    At_lam_along_q = np.einsum("...ijl,...i->...jl", A_along_q, lam)
    dq_along_q = _all_rows(-np.linalg.solve(A_d, A_dq_along_q), constant_u, driven)  # (4)
    b_along_q = at.b_by_q @ N + at.b_by_dq @ dq_along_q
    ddq_along_q = _all_rows(-np.linalg.solve(A_d, A_ddq_along_q + b_along_q), constant_u, driven)  # (5)
    f_along_q = at.f_by_q @ N + at.f_by_dq @ dq_along_q + at.M @ ddq_along_q  # (6)
    tau_by_q = torque_changes(f_along_q, At_lam_along_q)

    ddq_along_dq = _all_rows(-np.linalg.solve(A_d, at.b_by_dq @ N), constant_u, driven)
    f_along_dq = at.f_by_dq @ N + at.M @ ddq_along_dq
    tau_by_dq = torque_changes(f_along_dq, np.zeros_like(f_along_dq))
    return ConstrainedDerivatives(tau_by_q, tau_by_dq, _transpose(N) @ at.M @ N)


def _all_rows(dependent_rows: Array, driven_rows: Array, driven: Array) -> Array:
    """Rows of all velocities (..., nv, m), assembled from the rows of the dependent and of the driven ones."""
    rows = np.zeros((*dependent_rows.shape[:-2], len(driven), driven_rows.shape[-1]))
    rows[..., ~driven, :] = dependent_rows
    rows[..., driven, :] = driven_rows
    return rows


def _transpose(X: Array) -> Array:
    """Transposes of matrices (..., m, n)."""
    return np.swapaxes(X, -1, -2)
