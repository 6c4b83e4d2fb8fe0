"""Forward dynamics: articulated bodies (RBDA chapter 7), solving with M (MR section 8.5), and factors of long robots.

The work of articulated bodies grows with the number of bodies, not its cube. The wrench F that gives a body the
acceleration dV, while all that it carries is free to move, is  F = A dV + p. Its articulated inertia A is symmetric
but no rigid body's: a body is heavier across a joint than along it. Bodies are watched as in
:mod:`.inverse_dynamics`: from the inertial frame that at this instant moves with the body's own origin. Outward, with
λ the parent and R, r its pose, then inward, then outward again, RBDA, table 7.1:

    (1)  w = R'w_λ + w_J,   c = (w × w_J, R'(w_λ × (w_λ × r)) + (2w - w_J) × v_J)
    (2)  U = A S,   D = S'U + J,   u = τ - S'p                      J: of rotors
    (3)  A_λ += A - U D⁻¹ U',   p_λ += p + (A - U D⁻¹ U') c + U D⁻¹ u,   both seen from λ
    (4)  q̈ = D⁻¹ u - (U D⁻¹)'(dV_λ + c),   dV = dV_λ + c + S q̈         dV_λ seen from the body
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..bodies.inertia import SpatialInertia
from ..lie import so3
from ..lie.adjoint import Ad, ad
from ..model.model import BASE, Model
from ..typing import Array
from .derivatives import carried, turns
from .friction import torque_past_friction
from .inverse_dynamics import BodyMotion, Wrenches, applied_wrenches, bias_forces, inertial_wrench
from .mass_matrix import body_velocities, composite_inertias, factored, mass_matrix, solved, widened
from .recursion import (
    ancestors,
    armature_forces,
    armature_symbols,
    base_poses,
    inward,
    joint_poses,
    outward,
    spread,
    spring_forces,
    spring_stiffness,
    zeros,
)


@dataclass
class _Articulated:
    """The symmetric operator [I, H; H', M] on (dw, a)."""

    I: Array
    H: Array
    M: Array

    @classmethod
    def rigid(cls, G: SpatialInertia) -> _Articulated:
        return cls(G.moment_about_origin, so3.hat(G.first_moment), G.mass * np.eye(3))

    def __add__(self, other: _Articulated) -> _Articulated:
        return _Articulated(self.I + other.I, self.H + other.H, self.M + other.M)

    def __matmul__(self, V: Array) -> Array:
        w, v = V[:3], V[3:]
        return np.concatenate([self.I @ w + self.H @ v, self.H.T @ w + self.M @ v])

    def less(self, U: Array, W: Array) -> _Articulated:
        """A - U W' for columns of U and W whose product is symmetric."""
        return _Articulated(
            _mirrored(self.I - U[:3] @ W[:3].T), self.H - U[:3] @ W[3:].T, _mirrored(self.M - U[3:] @ W[3:].T)
        )

    def in_frame(self, T: Array) -> _Articulated:
        """Seen from {a}, if this is in {b} and T is T_ab."""
        R, P = T[:3, :3], so3.hat(T[:3, 3])
        I, H, M = _mirrored(R @ self.I @ R.T), R @ self.H @ R.T, _mirrored(R @ self.M @ R.T)
        PH = P @ H.T
        return _Articulated(_mirrored(I + PH + PH.T - P @ M @ P), H + P @ M, M)


def _mirrored(X: Array) -> Array:
    """The lower triangle, twice: the other half of a symmetric matrix is not computed."""
    return np.array([[X[max(i, j), min(i, j)] for j in range(3)] for i in range(3)])


def articulated_dynamics(
    model: Model, q: Array, dq: Array, tau: Array, wrenches: Wrenches | None = None, added: Array | None = None
) -> Array:
    """q̈ (nv,); robots whose joints share no coordinates. ``added`` (nv,) is inertia of the joints, as that of a rotor."""
    T, Adq = joint_poses(model, q), spread(model, dq)
    tau = tau - spring_forces(model, q) - armature_forces(model, dq, zeros(model.nv))
    drives = model.armature if added is None else added + model.armature
    A, p, c, w = [], [], [], {BASE: zeros(3)}
    for i, parent in outward(model):
        R, r, up, wJ, vJ = T[i][:3, :3], T[i][:3, 3], w[parent], Adq[i][:3], Adq[i][3:]
        w[i] = R.T @ up + wJ
        turning, moving = so3.cross(w[i], wJ), so3.cross(2.0 * w[i] - wJ, vJ)
        c.append(np.concatenate([turning, R.T @ so3.cross(up, so3.cross(up, r)) + moving]))  # (1)
        A.append(_Articulated.rigid(model.bodies[i].inertia))
        p.append(inertial_wrench(model.bodies[i].inertia, BodyMotion(w[i], zeros(3), zeros(3))))
    for i, F_by in applied_wrenches(model, wrenches):
        p[i] = p[i] + F_by
    joints: dict[int, tuple[Array, Array]] = {}
    for i, parent in inward(model):
        body = model.bodies[i]
        S = body.joint.axes
        U = np.array([A[i] @ s for s in S]).T
        mine = body.places[1]
        factors = factored(widened(S @ U, drives[mine]))  # D
        u = tau[mine] - S @ p[i]  # (2)
        W = np.array([solved(*factors, row) for row in U])  # U D⁻¹
        joints[i] = W, solved(*factors, u)
        if parent != BASE:
            left = A[i].less(U, W)
            A[parent] = A[parent] + left.in_frame(T[i])
            p[parent] = p[parent] + Ad(T[i]).inverse.T @ (p[i] + left @ c[i] + W @ u)  # (3)
    ddq, dV = zeros(model.nv), {BASE: np.concatenate([zeros(3), -model.gravity])}
    for i, parent in outward(model):
        body, (W, free) = model.bodies[i], joints[i]
        carried = Ad(T[i]).inverse @ dV[parent] + c[i]
        mine = ddq[body.places[1]] = free - W.T @ carried
        dV[i] = carried + mine @ body.joint.axes  # (4)
    return ddq


def articulated_pays(model: Model) -> bool:
    """True if this takes fewer multiplications than M and its factors; never if joints share a coordinate.

    Counted on chains, a quadruped and a humanoid: 190 a body here; there 60 a velocity, 14 for each body that carries it,
    and the triangle of a factor over the velocities before it. The two meet at chains of some fifteen joints.
    """
    if any(body.follows for body in model.bodies):
        return False
    before, depth = {BASE: 0}, {BASE: -1}
    by_mass_matrix = 0
    for i, parent in outward(model):
        before[i], depth[i] = before[parent] + model.bodies[i].joint.nv, depth[parent] + 1
        by_mass_matrix += sum(d * (d + 1) // 2 + 14 * depth[i] + 60 for d in range(before[parent], before[i]))
    return 190 * len(model.bodies) < by_mass_matrix


# ── q̈ from torques by solving M q̈ = τ - h. Modern Robotics section 8.5


def forward_dynamics(
    model: Model,
    q: Array,
    dq: Array,
    tau: Array,
    wrenches: Wrenches | None = None,
    added: Array | None = None,
    friction: bool = False,
) -> Array:
    """q̈ = M⁻¹ (τ - h - Σ J'F_by); (nv,). MR section 8.5.

    ``added`` (nv,) is inertia on top, on the diagonal of M; ``friction`` takes off τ what the joints' friction costs.
    """
    if friction:
        tau = torque_past_friction(model, dq, tau)
    if articulated_pays(model):
        return articulated_dynamics(model, q, dq, tau, wrenches, added)
    M = mass_matrix(model, q)
    L, D = factored(M if added is None else widened(M, added))
    return solved(L, D, tau - bias_forces(model, q, dq, wrenches))


# ── Factors of the matrices of long robots: one vector a joint velocity, in base coordinates

# M_ji = S_j·(G S_i),
#     ∂τ_i/∂q_j = P_j·(B' S_i) + Q_j·(G S_i),         ∂τ_j/∂q_i = S_j·(2B P_i + G Q_i - [S_i, ·]'F)     for j before i,
#
# and so on: the equations of :mod:`.mass_matrix` and :mod:`.derivatives`, in which a wrench travels to the base joint by joint.
# From the base nothing has to travel, so that an entry is one dot product; what is far from the base loses some digits by it,
# about as many as it is body lengths away. B' S is a pure couple wherever it is seen from.


class Relations(NamedTuple):
    """Relations between the velocities of joints."""

    carries: Array
    """(nv, nv) of bool: the row's joint carries the column's, or is the same."""
    bodies: Array
    """(nv,): whose they are."""


def applies(model: Model) -> bool:
    """True if every velocity is one joint's own and only the bodies make the matrices depend on dq."""
    return not any(body.follows for body in model.bodies) and not any(True for _ in armature_symbols(model))


def relations(model: Model) -> Relations:
    """Table of joints that carry each other."""
    bodies = np.zeros(model.nv, int)
    for k, body in enumerate(model.bodies):
        bodies[body.places[1]] = k
    carried_by = [set(ancestors(model, k)) for k in range(len(model.bodies))]
    carries = [[int(r) in carried_by[int(c)] for c in bodies] for r in bodies]
    return Relations(np.array(carries, bool).reshape(model.nv, model.nv), bodies)


def mass_matrix_factors(model: Model, q: Array) -> tuple[Array, ...]:
    """S (nv, 6), G S (6, nv), G S (nv, 6), S (6, nv)."""
    T = joint_poses(model, q)
    S, GS = zeros(model.nv, 6), zeros(model.nv, 6)
    for body, X, G in zip(model.bodies, base_poses(model, T), composite_inertias(model, q), strict=True):
        for k, axis in enumerate(body.joint.axes, start=body.v_index):
            S[k], GS[k] = Ad(X) @ axis, Ad(X).inverse.T @ (G @ axis)
    return S, GS.T, GS, S.T


def constant_mass(model: Model) -> Array:
    """Constant part of M: the armature; (nv, nv)."""
    return np.diag(model.armature)


def derivative_factors(
    model: Model, q: Array, dq: Array, ddq: Array, wrenches: Wrenches | None = None
) -> tuple[Array, ...]:
    """S (nv, 6) and its factors by q and by dq, (6, nv); (B' S, G S) (nv, 9) and its factor, (9, nv)."""
    T = joint_poses(model, q)
    V, G = body_velocities(model, T, dq), composite_inertias(model, q)
    B, F, columns = carried(model, T, V, dq, ddq, wrenches)
    own, moved, faster = zeros(model.nv, 6), zeros(model.nv, 6), zeros(model.nv, 6)
    left, by_q, by_dq = zeros(model.nv, 9), zeros(model.nv, 9), zeros(model.nv, 9)
    for i, (body, X) in enumerate(zip(model.bodies, base_poses(model, T), strict=True)):
        seen, felt = Ad(X), Ad(X).inverse.T
        for k, c in enumerate(columns[i], start=body.v_index):
            own[k] = seen @ c.S
            left[k] = np.concatenate([X[:3, :3] @ B[i].transposed_times(c.S)[:3], felt @ (G[i] @ c.S)])
            by_dq[k] = np.concatenate([own[k, :3], seen @ c.R])
            faster[k] = felt @ (B[i] @ c.S + G[i] @ c.R)
            if turns(body):
                by_q[k] = np.concatenate([X[:3, :3] @ c.P[:3], seen @ c.Q])
                moved[k] = felt @ (B[i] @ c.P + G[i] @ c.Q - ad(c.S).T @ F[i])
    return own, moved.T, faster.T, left, by_q.T, by_dq.T


def constant_stiffness(model: Model) -> Array:
    """Constant part of ∂τ/∂q: springs; (nv, nv)."""
    return np.asarray(zeros(model.nv, model.nv) + spring_stiffness(model), float)
