"""Constrained dynamics, A(q) dq = 0: rows of constraints, forces, and derivatives. Modern Robotics section 8.7.

Two kinds of constraints, both plain data. A :class:`Closure` attaches a frame {b} to a frame {c}, which is fixed in {a}.
With T_cb = (R, p), its six rows are the angular velocity of {b} relative to {c} and the rate of p,

    V_cb = (w, dp/dt),   [w] = (dR/dt) R',

of which the chosen ones are zero. A :class:`Rolling` sets chosen rows of one frame's Jacobian to zero; such rows may be
nonholonomic. λ is the wrench that the robot exerts: {b} on {a}, at the origin of {b}, axes of {c}, like the book's F_tip.
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
    """{b} attached to {c}, whose pose in {a} is ``pose``, in the chosen rows of their relative twist, axes of {c}."""

    frame_a: str
    frame_b: str
    rows: tuple[int, ...]
    pose: tuple[tuple[float, ...], ...]

    @property
    def name(self) -> str:
        """Names of the two frames."""
        return f"{self.frame_a}–{self.frame_b}"

    @cached_property
    def T_ac(self) -> Array:
        """``pose`` as an array (4, 4), read-only."""
        T = np.array(self.pose)
        T.setflags(write=False)
        return T

    def __getstate__(self) -> dict[str, Any]:
        return {f.name: getattr(self, f.name) for f in fields(self)}  # arrays come out of a pickle writable


@dataclass(frozen=True)
class Rolling:
    """Chosen rows of a frame's twist are zero; ``kind`` is that of the Jacobian."""

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
    plain = [c.name for c in constraints]
    before = [plain[:n].count(name) for n, name in enumerate(plain)]
    return tuple(f"{name} #{n + 1}" if n else name for name, n in zip(plain, before, strict=True))


def row_names(constraints: Sequence[Constraint]) -> tuple[str, ...]:
    """Name of each row of A: the constraint's name and the name of the twist's row."""
    return tuple(f"{name} {TWIST[k]}" for name, c in zip(names(constraints), constraints, strict=True) for k in c.rows)


def with_gaps(constraints: Sequence[Constraint]) -> list[bool]:
    """True for each row of A that belongs to a closure: these rows have a position error (gap)."""
    return [isinstance(c, Closure) for c in constraints for _ in c.rows]


def independent_constraints(constraints: Sequence[Constraint], independent: Sequence[int]) -> tuple[Constraint, ...]:
    """Constraints reduced to the rows of A with the given numbers; constraints without any of these rows are dropped."""
    reduced, first_row = [], 0
    for c in constraints:
        rows = tuple(row for n, row in enumerate(c.rows) if first_row + n in independent)
        first_row += len(c.rows)
        if rows:
            reduced.append(replace(c, rows=rows))
    return tuple(reduced)


def place_of(model: Model, frame: str) -> Frame:
    """Frame of that name; ``"ground"`` gives the base frame."""
    return Frame(BASE, np.eye(4)) if frame == GROUND and frame not in model.all_frames else model.frame(frame)


def _walk(model: Model, q: Array, closure: Closure) -> tuple[list[tuple[Body, Array, float]], Array]:
    """Joints on the path from {c} to {b}, in that order, as (body, T_c,body, sign); and T_cb.

    The sign is -1 from {c} up to the nearest common ancestor, where a joint moves {c}, and 1 from there down to {b}.
    """
    a, b = place_of(model, closure.frame_a), place_of(model, closure.frame_b)
    T = joint_poses(model, q)
    up, down = list(ancestors(model, a.body)), list(ancestors(model, b.body))
    while up and down and up[-1] == down[-1]:
        up.pop(), down.pop()
    walk: list[tuple[Body, Array, float]] = []
    X = se3.inverse(a.pose @ closure.T_ac)
    for i in up:
        walk.append((model.bodies[i], X, -1.0))
        X = X @ se3.inverse(T[i])
    for i in reversed(down):
        X = X @ T[i]
        walk.append((model.bodies[i], X, 1.0))
    return walk, np.asarray(X @ b.pose)


def _columns(model: Model, q: Array, closure: Closure) -> tuple[list[tuple[Body, Array]], Array]:
    """(body, contribution of its joint to the twist of {b} in {c}, (k, 6)) along the path, and the position p of {b} in {c}."""
    walk, T_cb = _walk(model, q, closure)
    return [(b, sign * b.ratio * Ad(X).apply(b.joint.axes)) for b, X, sign in walk], T_cb[:3, 3]


def _relative_jacobian(model: Model, q: Array, closure: Closure) -> Array:
    """Jacobian J with V_cb = J dq; (6, nv)."""
    J = zeros(6, model.nv)
    columns, p = _columns(model, q, closure)
    for body, axes in columns:
        block = body.places[1]
        J[:, block] = J[:, block] + np.array([_twist_at_point(p, V) for V in axes]).T
    return J


def _relative_bias(model: Model, q: Array, dq: Array, closure: Closure) -> Array:
    """dV_cb/dt at ddq = 0; (6,). A joint's axes move with the joints before it on the path: d(axis)/dt = [V, axis]."""
    V, dV = zeros(6), zeros(6)
    columns, p = _columns(model, q, closure)
    for body, axes in columns:
        V_joint = dq[body.places[1]] @ axes
        dV = dV + ad(V) @ V_joint  # V before or after this joint gives the same: [mine, mine] = 0
        V = V + V_joint
    dp = _twist_at_point(p, V)[3:]
    return np.concatenate([dV[:3], _twist_at_point(p, dV)[3:] + so3.cross(V[:3], dp)])


def _twist_at_point(p: Array, V: Array) -> Array:
    """(w, v + w × p): twist with the velocity of the point p in place of that of the origin."""
    return np.concatenate([V[:3], V[3:] + so3.cross(V[:3], p)])


def closure_poses(model: Model, q: Array, constraints: tuple[Constraint, ...]) -> Array:
    """T_cb of each closure; (n, 4, 4)."""
    return np.array([_walk(model, q, c)[1] for c in constraints if isinstance(c, Closure)]).reshape(-1, 4, 4)


def constraint_jacobian(model: Model, q: Array, constraints: tuple[Constraint, ...]) -> Array:
    """A in A dq = 0; (k, nv). MR section 8.7."""
    rows = []
    for c in constraints:
        J = _relative_jacobian(model, q, c) if isinstance(c, Closure) else jacobian(model, q, c.frame, c.kind)
        rows.append(J[list(c.rows)])
    return np.concatenate(rows)


def constraint_bias(model: Model, q: Array, dq: Array, constraints: tuple[Constraint, ...]) -> Array:
    """(dA/dt) dq, so that A ddq + (dA/dt) dq = 0; (k,). MR section 8.7."""
    biases = []
    for c in constraints:
        if isinstance(c, Closure):
            biases.append(_relative_bias(model, q, dq, c)[list(c.rows)])
        else:
            biases.append(jacobian_rate(model, q, dq, c.frame, c.kind)[list(c.rows)] @ dq)
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

    M = L'DL is factored once: with Y = L⁻ᵀA' and z = L⁻ᵀ(τ - h), A M⁻¹ A' is Y'D⁻¹Y.
    """
    L, D = ldl_factors(mass_matrix(model, q))
    Y = solve_transposed(L, constraint_jacobian(model, q, constraints).T)
    z = solve_transposed(L, tau - bias_forces(model, q, dq, wrenches))
    R, E = ldl_factors(Y.T @ (D[:, None] * Y))
    lam = solve_ldl(
        R, E, Y.T @ (D * z) + constraint_bias(model, q, dq, constraints)
    )  # S λ = A M⁻¹ (τ - h) + (dA/dt) dq
    return solve_triangular(L, D * (z - Y @ lam)), lam, 1.0 / E  # q̈ = M⁻¹ (τ - h - A'λ)


SINGULAR_VALUE = 1e-9
"""Singular value, relative to the norm of A' with rows of usual size, below which a direction of λ has no effect on joints."""
MAX_RESIDUAL_TORQUE = 1e-6
"""Residual torques at joints without motors, relative to the largest torque. Above this value, no motor torques produce the
motion. The value allows for the constraint errors that integrators leave in configurations and velocities."""


def balance(f: Array, A: Array, sizes: Array, driven: Array) -> tuple[Array, Array]:
    """λ (..., k) and the residual torques f + A'λ at the joints without motors, by two least-squares problems in sequence.

    λ minimises the residual at the joints without motors, then the torques at the ``driven`` ones. f (..., nv) is M q̈ + h;
    ``driven`` (nv,) is true where there is a motor.
    """
    At = np.swapaxes(A, -1, -2) / sizes  # A'λ = (A'W⁻¹)(W λ), columns of one size
    f = f[..., None]
    with_motor, without_motor = At[..., driven, :], At[..., ~driven, :]
    floor = SINGULAR_VALUE * np.linalg.norm(At, axis=(-2, -1))
    inverse = _pseudoinverse(without_motor, floor)
    x = -inverse @ f[..., ~driven, :]
    free = np.eye(len(sizes)) - inverse @ without_motor  # changes of λ without effect on joints without motors
    x = x - free @ _pseudoinverse(with_motor @ free, floor) @ (f[..., driven, :] + with_motor @ x)
    return x[..., 0] / sizes, (f[..., ~driven, :] + without_motor @ x)[..., 0]


def _pseudoinverse(X: Array, floor: Array) -> Array:
    """Moore–Penrose inverse; singular values up to ``floor`` (...) count as zero."""
    if 0 in X.shape[-2:]:
        return np.swapaxes(X, -1, -2)
    U, sigma, Vt = np.linalg.svd(X, full_matrices=False)
    significant = sigma > floor[..., None]
    inverse = np.where(significant, 1.0 / np.where(significant, sigma, 1.0), 0.0)
    return np.asarray(np.swapaxes(Vt, -1, -2) @ (inverse[..., None] * np.swapaxes(U, -1, -2)))


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


# With the independent velocities u, which are those of the motors, dq = (d, u) and A = (A_d, A_u):
#
#     (1)  dq = N u,  N = (-A_d⁻¹ A_u, 1)                             A dq = 0
#     (2)  A_d q̈_d = -(A_u q̈_u + b)                                  A q̈ + b = 0, MR section 8.7
#     (3)  A_d' λ = -f_d,   τ = f_u + A_u' λ                           f = M q̈ + h, no torque at the other joints
#
# and along a direction of the independent coordinates, ∂ at constant u and q̈_u,
#
#     (4)  A_d ∂dq_d = -∂A dq                                          ∂A = (dA/dq) N
#     (5)  A_d ∂q̈_d = -(∂A q̈ + ∂b),   ∂b = (db/dq) N + (db/ddq) ∂dq
#     (6)  ∂f = (df/dq) N + (df/ddq) ∂dq + M ∂q̈
#     (7)  A_d' ∂λ = -(∂f_d + ∂A_d' λ),   ∂τ = ∂f_u + ∂A_u' λ + A_u' ∂λ
#
# where d/ddq is the derivative with respect to dq. For derivatives by u, N replaces ∂dq, and ∂A is zero.


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
    """Derivatives of the torques of the ``driven`` joints (nv,), one per degree of freedom, by their q, dq and ddq."""
    u, d = driven, ~driven
    A_d, A_u = at.A[..., d], at.A[..., u]
    N = _all_columns(-np.linalg.solve(A_d, A_u), driven, np.eye(int(u.sum())))  # (1)
    lam = -np.linalg.solve(_t(A_d), at.f[..., d, None])[..., 0]  # (3)
    dA = np.einsum("...ijk,...kl->...ijl", at.A_by_q, N)
    none = np.zeros((int(u.sum()),) * 2)

    def torques(df: Array, dA: Array | float) -> Array:
        pressed = np.einsum("...ijl,...i->...jl", dA, lam) if isinstance(dA, np.ndarray) else np.zeros_like(df)
        dlam = -np.linalg.solve(_t(A_d), df[..., d, :] + pressed[..., d, :])  # (7)
        return np.asarray(df[..., u, :] + pressed[..., u, :] + _t(A_u) @ dlam)

    dv = _all_columns(-np.linalg.solve(A_d, np.einsum("...ijl,...j->...il", dA, dq)), driven, none)  # (4)
    db = at.b_by_q @ N + at.b_by_dq @ dv
    da = _all_columns(-np.linalg.solve(A_d, np.einsum("...ijl,...j->...il", dA, ddq) + db), driven, none)  # (5)
    by_q = torques(at.f_by_q @ N + at.f_by_dq @ dv + at.M @ da, dA)  # (6)
    da = _all_columns(-np.linalg.solve(A_d, at.b_by_dq @ N), driven, none)
    by_dq = torques(at.f_by_dq @ N + at.M @ da, 0.0)
    return ConstrainedDerivatives(by_q, by_dq, _t(N) @ at.M @ N)


def _all_columns(dependent: Array, driven: Array, of_driven: Array) -> Array:
    """Columns for all velocities, assembled from those of the dependent and of the driven ones; (..., nv, m)."""
    columns = np.zeros((*dependent.shape[:-2], len(driven), of_driven.shape[-1]))
    columns[..., ~driven, :], columns[..., driven, :] = dependent, of_driven
    return columns


def _t(X: Array) -> Array:
    return np.swapaxes(X, -1, -2)
