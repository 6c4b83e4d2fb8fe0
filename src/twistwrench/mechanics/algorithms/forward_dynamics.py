"""Forward dynamics by articulated bodies (RBDA chapter 7) and by M (MR section 8.5).

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

import numpy as np

from ...core.typing import Array
from ..bodies.inertia import SpatialInertia
from ..lie import so3
from ..lie.adjoint import Ad
from ..model.model import BASE, Model
from .friction import torque_past_friction
from .inverse_dynamics import BodyMotion, Wrenches, applied_wrenches, bias_forces, inertial_wrench
from .mass_matrix import ldl_factors, mass_matrix, solve_ldl, with_diagonal
from .recursion import armature_forces, inward, joint_poses, outward, spread, spring_forces, zeros


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
    """Symmetric matrix from the lower triangle. A trace omits operations without effect: those of the upper one."""
    symmetric = X.copy()
    for i in range(3):
        for j in range(i):
            symmetric[j, i] = X[i, j]
    return symmetric


def articulated_dynamics(
    model: Model, q: Array, dq: Array, tau: Array, wrenches: Wrenches | None = None, added: Array | None = None
) -> Array:
    """q̈ (nv,) if joints share neither coordinates nor motors. ``added`` (nv,) is additional inertia, like a rotor's."""
    T = joint_poses(model, q)
    Adq = spread(model, dq)  # twist V_J of each joint, in the frame of its body
    velocity_products = armature_forces(model, dq, zeros(model.nv))  # of drives, what remains without acceleration
    tau = tau - spring_forces(model, q) - velocity_products
    drives = model.armature if added is None else added + model.armature
    A, p, c, w = [], [], [], {BASE: zeros(3)}
    for i, parent in outward(model):
        R, r, w_parent, wJ, vJ = T[i][:3, :3], T[i][:3, 3], w[parent], Adq[i][:3], Adq[i][3:]
        w[i] = R.T @ w_parent + wJ
        angular, linear = so3.cross(w[i], wJ), so3.cross(2.0 * w[i] - wJ, vJ)
        c.append(np.concatenate([angular, R.T @ so3.cross(w_parent, so3.cross(w_parent, r)) + linear]))  # (1)
        A.append(_Articulated.rigid(model.bodies[i].inertia))
        p.append(inertial_wrench(model.bodies[i].inertia, BodyMotion(w[i], zeros(3), zeros(3))))
    for i, F_by in applied_wrenches(model, wrenches):  # by the robot on the world
        p[i] = p[i] + F_by
    joint_solutions: dict[int, tuple[Array, Array]] = {}
    for i, parent in inward(model):
        body = model.bodies[i]
        S = body.joint.axes
        U = np.array([A[i] @ s for s in S]).T
        columns = body.places[1]
        factors = ldl_factors(with_diagonal(S @ U, drives[columns]))  # D
        u = tau[columns] - S @ p[i]  # (2)
        W = np.array([solve_ldl(*factors, row) for row in U])  # U D⁻¹
        joint_solutions[i] = W, solve_ldl(*factors, u)  # and q̈ of a body that does not accelerate
        if parent != BASE:
            remainder = A[i].less(U, W)
            A[parent] = A[parent] + remainder.in_frame(T[i])
            p[parent] = p[parent] + Ad(T[i]).inverse.T @ (p[i] + remainder @ c[i] + W @ u)  # (3)
    ddq, dV = zeros(model.nv), {BASE: np.concatenate([zeros(3), -model.gravity])}
    for i, parent in outward(model):
        body = model.bodies[i]
        W, ddq_free = joint_solutions[i]
        dV_carried = Ad(T[i]).inverse @ dV[parent] + c[i]
        ddq_joint = ddq_free - W.T @ dV_carried
        ddq[body.places[1]] = ddq_joint
        dV[i] = dV_carried + ddq_joint @ body.joint.axes  # (4)
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
        before[i] = before[parent] + model.bodies[i].joint.nv
        depth[i] = depth[parent] + 1
        for velocities_before in range(before[parent], before[i]):
            by_mass_matrix += 60 + 14 * depth[i] + velocities_before * (velocities_before + 1) // 2
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
