"""Forward dynamics by articulated bodies (RBDA chapter 7) and by M (MR section 8.5); derivatives; factors for long robots.

The cost of the articulated-body algorithm grows linearly with the number of bodies, not cubically. F = A dV + p is the
wrench that gives a body the acceleration dV while all bodies it carries move freely. The articulated inertia A is symmetric,
but not that of a rigid body: a body is heavier across a joint than along it. The reference frame is that of
:mod:`.inverse_dynamics`: inertial, and at this instant moving with the body's own origin. λ is the parent and R, r the pose
in it. An outward pass evaluates (1), an inward pass (2) and (3), an outward pass (4); RBDA, table 7.1:

    (1)  w = R'w_λ + w_J,   c = (w × w_J, R'(w_λ × (w_λ × r)) + (2w - w_J) × v_J)
    (2)  U = A S,   D = S'U + J,   u = τ - S'p                      J: rotor inertia
    (3)  A_λ += A - U D⁻¹ U',   p_λ += p + (A - U D⁻¹ U') c + U D⁻¹ u,   both transformed to λ
    (4)  q̈ = D⁻¹ u - (U D⁻¹)'(dV_λ + c),   dV = dV_λ + c + S q̈         dV_λ transformed to the body
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...core.typing import Array
from ..bodies.inertia import SpatialInertia
from ..lie import so3
from ..lie.adjoint import Ad, ad
from ..model.model import BASE, Body, Model
from .coriolis_matrix import BodyCoriolis
from .energies import body_velocities
from .friction import torque_past_friction
from .inverse_dynamics import BodyMotion, Wrenches, applied_wrenches, bias_forces, body_motions, inertial_wrench
from .mass_matrix import (
    composite_inertias,
    inverse_factor,
    ldl_factors,
    mass_matrix,
    solve_ldl,
    symmetric_product,
    with_diagonal,
)
from .recursion import (
    add_entry,
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
            _symmetric(self.I - U[:3] @ W[:3].T), self.H - U[:3] @ W[3:].T, _symmetric(self.M - U[3:] @ W[3:].T)
        )

    def in_frame(self, T: Array) -> _Articulated:
        """Operator expressed in {a}, given one in {b} and T = T_ab."""
        R, P = T[:3, :3], so3.hat(T[:3, 3])
        I, H, M = _symmetric(R @ self.I @ R.T), R @ self.H @ R.T, _symmetric(R @ self.M @ R.T)
        PH = P @ H.T
        return _Articulated(_symmetric(I + PH + PH.T - P @ M @ P), H + P @ M, M)


def _symmetric(X: Array) -> Array:
    """Symmetric matrix from the lower triangle; the upper one is not computed."""
    symmetric = X.copy()
    for i in range(3):
        for j in range(i):
            symmetric[j, i] = X[i, j]
    return symmetric


def articulated_dynamics(
    model: Model, q: Array, dq: Array, tau: Array, wrenches: Wrenches | None = None, added: Array | None = None
) -> Array:
    """q̈ (nv,) if joints share neither coordinates nor motors. ``added`` (nv,) is additional inertia, like a rotor's."""
    T, Adq = joint_poses(model, q), spread(model, dq)
    tau = tau - spring_forces(model, q) - armature_forces(model, dq, zeros(model.nv))
    drives = model.armature if added is None else added + model.armature
    A, p, c, w = [], [], [], {BASE: zeros(3)}
    for i, parent in outward(model):
        R, r, w_parent, wJ, vJ = T[i][:3, :3], T[i][:3, 3], w[parent], Adq[i][:3], Adq[i][3:]
        w[i] = R.T @ w_parent + wJ
        angular, linear = so3.cross(w[i], wJ), so3.cross(2.0 * w[i] - wJ, vJ)
        c.append(np.concatenate([angular, R.T @ so3.cross(w_parent, so3.cross(w_parent, r)) + linear]))  # (1)
        A.append(_Articulated.rigid(model.bodies[i].inertia))
        p.append(inertial_wrench(model.bodies[i].inertia, BodyMotion(w[i], zeros(3), zeros(3))))
    for i, F_by in applied_wrenches(model, wrenches):
        p[i] = p[i] + F_by
    joints: dict[int, tuple[Array, Array]] = {}
    for i, parent in inward(model):
        body = model.bodies[i]
        S = body.joint.axes
        U = np.array([A[i] @ s for s in S]).T
        columns = body.places[1]
        factors = ldl_factors(with_diagonal(S @ U, drives[columns]))  # D
        u = tau[columns] - S @ p[i]  # (2)
        W = np.array([solve_ldl(*factors, row) for row in U])  # U D⁻¹
        joints[i] = W, solve_ldl(*factors, u)
        if parent != BASE:
            remainder = A[i].less(U, W)
            A[parent] = A[parent] + remainder.in_frame(T[i])
            p[parent] = p[parent] + Ad(T[i]).inverse.T @ (p[i] + remainder @ c[i] + W @ u)  # (3)
    ddq, dV = zeros(model.nv), {BASE: np.concatenate([zeros(3), -model.gravity])}
    for i, parent in outward(model):
        body, (W, ddq_free) = model.bodies[i], joints[i]
        dV_carried = Ad(T[i]).inverse @ dV[parent] + c[i]
        columns = ddq[body.places[1]] = ddq_free - W.T @ dV_carried
        dV[i] = dV_carried + columns @ body.joint.axes  # (4)
    return ddq


def articulated_pays(model: Model) -> bool:
    """True if this takes fewer multiplications than M and its factors; never if joints share a coordinate or a motor.

    Counted on chains, a quadruped and a humanoid: 190 per body here. M takes 60 per velocity, 14 for each body that carries it,
    and its factorisation the triangle of preceding velocities. The costs are equal for chains of about fifteen joints.
    """
    if model.couplings or any(body.follows for body in model.bodies):
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

    ``added`` (nv,) is additional inertia on the diagonal of M. ``friction`` subtracts the joints' friction from τ.
    """
    if friction:
        tau = torque_past_friction(model, dq, tau)
    if articulated_pays(model):
        return articulated_dynamics(model, q, dq, tau, wrenches, added)
    M = mass_matrix(model, q)
    L, D = ldl_factors(M if added is None else with_diagonal(M, added))
    return solve_ldl(L, D, tau - bias_forces(model, q, dq, wrenches))


# ── Derivatives by recursion: ∂τ/∂(q, dq) and ∂ddq/∂(q, dq, τ). Analytic, exact to rounding

# Coordinate j moves all bodies it carries along S_j. In frames that move along, body k has (λ the parent of j's body)
#
#     (1)  P_j = [V_λ, S_j]                                 ∂V_k/∂q_j = P_j
#     (2)  Q_j = [dV_λ, S_j] + [V_λ, P_j]                   ∂dV_k/∂q_j = Q_j - [V_k, P_j]
#     (3)  R_j = P_j + [V_j, S_j]
#
# with everything expressed in body k. The bracket with V_k is combined with the velocity products, which give 2 B P_j. B is
# the operator of the Coriolis matrix and adds up over bodies like the inertia G. With G, B and F of all bodies that i
# carries, for j before i, or j = i in (4) and (6),
#
#     (4)  ∂τ_i/∂q_j = P_j·(2B)'S_i + Q_j·G S_i             (5)  ∂τ_j/∂q_i = S_j·(2B P_i + G Q_i - [S_i, ·]'F)
#     (6)  ∂τ_i/∂dq_j = S_j·(2B)'S_i + R_j·G S_i            (7)  ∂τ_j/∂dq_i = S_j·(2B S_i + G R_i)
#
# Four wrenches of each joint propagate to the base. Derivatives by q are along robot.add, also for planar and floating joints.
# Sources: Carpentier and Mansard, RSS 2018; Singh, Russell and Wensing, IEEE RA-L 7(2), 2022.


class _Column(NamedTuple):
    """One velocity of one joint, in its body's frame: the axis S, and P, Q, R of (1) to (3)."""

    S: Array
    P: Array
    Q: Array
    R: Array


def inverse_dynamics_derivatives(
    model: Model, q: Array, dq: Array, ddq: Array, wrenches: Wrenches | None = None
) -> tuple[Array, Array]:
    """∂τ/∂q and ∂τ/∂dq; (nv, nv) each. ∂τ/∂ddq is M."""
    T = joint_poses(model, q)
    V, G = body_velocities(model, T, dq), composite_inertias(model, q)
    B, F, columns = composite_terms(model, T, V, dq, ddq, wrenches)
    to_parent = [Ad(X).inverse.T for X in T]
    by_q, by_dq = zeros(model.nv, model.nv) + spring_stiffness(model), zeros(model.nv, model.nv)
    for i, body in enumerate(model.bodies):
        for b, c in enumerate(columns[i]):
            GS, BS = G[i] @ c.S, B[i].transposed_times(c.S)
            for j in ancestors(model, i):
                ancestor = model.bodies[j]
                for a, d in enumerate(columns[j]):
                    if turns(ancestor):
                        add_entry(by_q, body, b, ancestor, a, d.P @ BS + d.Q @ GS)  # (4)
                    add_entry(by_dq, body, b, ancestor, a, d.S @ BS + d.R @ GS)  # (6)
                GS, BS = to_parent[j] @ GS, to_parent[j] @ BS
            if turns(body):
                _add_to_ancestors(
                    by_q, model, columns, to_parent, i, b, B[i] @ c.P + G[i] @ c.Q - ad(c.S).T @ F[i]
                )  # (5)
            _add_to_ancestors(by_dq, model, columns, to_parent, i, b, B[i] @ c.S + G[i] @ c.R)  # (7)
    for block, L in armature_symbols(model):
        by_dq[block, block] = by_dq[block, block] + (L + L.swapaxes(1, 2)) @ dq[block]
    return by_q, by_dq


def composite_terms(
    model: Model, T: list[Array], V: list[Array], dq: Array, ddq: Array, wrenches: Wrenches | None
) -> tuple[list[BodyCoriolis], list[Array], list[list[_Column]]]:
    """2 B and F summed over all bodies that each body carries, and the columns of its joint."""
    B, columns = [BodyCoriolis.from_twist(body.inertia, 2.0 * V[i]) for i, body in enumerate(model.bodies)], []
    Adq, Addq = spread(model, dq), spread(model, ddq)
    F: list[Array] = []
    for i, motion in body_motions(model, T, dq, ddq):
        body = model.bodies[i]
        F.append(inertial_wrench(body.inertia, motion))
        V_parent = V[i] - Adq[i]
        dV_parent = (
            np.concatenate([motion.dw, motion.a - so3.cross(V[i][:3], V[i][3:])]) - Addq[i] - ad(V_parent) @ Adq[i]
        )
        joint_columns = []
        for S in body.joint.axes:
            P = ad(V_parent) @ S  # (1)
            joint_columns.append(_Column(S, P, ad(dV_parent) @ S + ad(V_parent) @ P, P + ad(V[i]) @ S))  # (2), (3)
        columns.append(joint_columns)
    for i, F_by in applied_wrenches(model, wrenches):
        F[i] = F[i] + F_by
    for i, p in inward(model):
        if p != BASE:
            B[p], F[p] = B[p] + B[i].in_frame(T[i]), F[p] + Ad(T[i]).inverse.T @ F[i]
    return B, F, columns


def _add_to_ancestors(
    matrix: Array, model: Model, columns: list[list[_Column]], up: list[Ad], i: int, b: int, F: Array
) -> None:
    """Add the effect of a wrench on body i on the joints before it, to their rows of its column."""
    F = up[i] @ F
    for j in ancestors(model, i):
        if j == i:
            continue
        for a, d in enumerate(columns[j]):
            add_entry(matrix, model.bodies[j], a, model.bodies[i], b, d.S @ F)
        F = up[j] @ F


def turns(body: Body) -> bool:
    """True if the joint's coordinate changes the dynamics; the coordinate of a body of revolution does not."""
    return body.joint.moves_body


def forward_dynamics_derivatives(
    model: Model, q: Array, dq: Array, tau: Array, wrenches: Wrenches | None = None
) -> tuple[Array, Array, Array]:
    """∂ddq/∂q, ∂ddq/∂dq and ∂ddq/∂τ = M⁻¹; (nv, nv) each. From M ∂ddq/∂x = -∂τ/∂x at the ddq that τ produces."""
    by_q, by_dq, inverse, W, D = torque_derivatives_and_factors(model, q, dq, tau, wrenches)
    return accelerations(W, D, by_q), accelerations(W, D, by_dq), inverse


def torque_derivatives_and_factors(
    model: Model, q: Array, dq: Array, tau: Array, wrenches: Wrenches | None = None
) -> tuple[Array, Array, Array, Array, Array]:
    """∂τ/∂q and ∂τ/∂dq at the ddq that τ produces, M⁻¹, and its factors W (nv, nv) and D (nv,): M⁻¹ = W D W'."""
    L, D = ldl_factors(mass_matrix(model, q))
    ddq = solve_ldl(L, D, tau - bias_forces(model, q, dq, wrenches))
    by_q, by_dq = inverse_dynamics_derivatives(model, q, dq, ddq, wrenches)
    W = inverse_factor(L)  # keeps the zeros between branches, unlike M⁻¹
    return by_q, by_dq, symmetric_product(W, D), W, D


def accelerations(W: Array, D: Array, X: Array) -> Array:
    """-M⁻¹ X for one column (nv,) or several (nv, m)."""
    return -(W @ (D * (W.T @ X).T).T)


# ── Factors of the matrices of long robots: one vector per joint velocity, in base coordinates

# M_ji = S_j·(G S_i),
#     ∂τ_i/∂q_j = P_j·(B' S_i) + Q_j·(G S_i),         ∂τ_j/∂q_i = S_j·(2B P_i + G Q_i - [S_i, ·]'F)     for j before i,
#
# and so on: the equations of :mod:`.mass_matrix` and those above, where a wrench is transformed to the base joint by joint.
# In base coordinates no transformation is needed, so that an entry is one dot product. Bodies far from the base lose digits,
# about as many as their distance in body lengths. B' S is a pure couple in every frame.


class Relations(NamedTuple):
    """Relations between the velocities of joints."""

    carries: Array
    """(nv, nv) of bool: the row's joint carries the column's joint, or is the same."""
    bodies: Array
    """(nv,) index of the body of each velocity."""


def applies(model: Model) -> bool:
    """True if no velocity is shared between joints or motors, and the matrices depend on dq only through the bodies."""
    shared = model.couplings or any(body.follows for body in model.bodies)
    return not shared and not any(True for _ in armature_symbols(model))


def relations(model: Model) -> Relations:
    """Table of which joints carry which."""
    bodies = np.zeros(model.nv, int)
    for k, body in enumerate(model.bodies):
        bodies[body.places[1]] = k
    carries = np.zeros((model.nv, model.nv), bool)
    for column, body in enumerate(bodies):
        carries[:, column] = np.isin(bodies, list(ancestors(model, int(body))))
    return Relations(carries, bodies)


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
    B, F, columns = composite_terms(model, T, V, dq, ddq, wrenches)
    axes, by_position, by_velocity = zeros(model.nv, 6), zeros(model.nv, 6), zeros(model.nv, 6)
    left_factor, by_q, by_dq = zeros(model.nv, 9), zeros(model.nv, 9), zeros(model.nv, 9)
    for i, (body, X) in enumerate(zip(model.bodies, base_poses(model, T), strict=True)):
        to_base, wrench_to_base = Ad(X), Ad(X).inverse.T
        for k, c in enumerate(columns[i], start=body.v_index):
            axes[k] = to_base @ c.S
            left_factor[k] = np.concatenate([X[:3, :3] @ B[i].transposed_times(c.S)[:3], wrench_to_base @ (G[i] @ c.S)])
            by_dq[k] = np.concatenate([axes[k, :3], to_base @ c.R])
            by_velocity[k] = wrench_to_base @ (B[i] @ c.S + G[i] @ c.R)
            if turns(body):
                by_q[k] = np.concatenate([X[:3, :3] @ c.P[:3], to_base @ c.Q])
                by_position[k] = wrench_to_base @ (B[i] @ c.P + G[i] @ c.Q - ad(c.S).T @ F[i])
    return axes, by_position.T, by_velocity.T, left_factor, by_q.T, by_dq.T


def constant_stiffness(model: Model) -> Array:
    """Constant part of ∂τ/∂q: springs; (nv, nv)."""
    return np.asarray(zeros(model.nv, model.nv) + spring_stiffness(model), float)
