"""Forward dynamics by articulated bodies (RBDA chapter 7) and by M (MR section 8.5).

The cost of the articulated-body algorithm grows linearly with the number of bodies, not cubically. F = A dV + p is the
wrench that gives a body the acceleration dV while all bodies it carries move freely. The articulated inertia A is symmetric,
but not the inertia of a rigid body: a body is heavier across a joint than along it. The reference frame is the one of
:mod:`.inverse_dynamics`: inertial, and at this instant moving with the body's own origin. λ is the parent, and (R, r) the pose
of the body in λ. An outward pass evaluates (1), an inward pass (2) and (3), an outward pass (4); RBDA, table 7.1:

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
    """Articulated inertia: the symmetric operator [I, H; H', M] on accelerations (dw, a), with blocks (3, 3)."""

    I: Array
    H: Array
    M: Array

    @classmethod
    def from_rigid_body(cls, G: SpatialInertia) -> _Articulated:
        """Operator of a single rigid body."""
        return cls(G.moment_about_origin, so3.hat(G.first_moment), G.mass * np.eye(3))

    def __add__(self, other: _Articulated) -> _Articulated:
        return _Articulated(self.I + other.I, self.H + other.H, self.M + other.M)

    def __matmul__(self, V: Array) -> Array:
        w, v = V[:3], V[3:]
        return np.concatenate([self.I @ w + self.H @ v, self.H.T @ w + self.M @ v])

    def minus_product(self, U: Array, W: Array) -> _Articulated:
        """A - U W' for U and W (6, k) whose product U W' is symmetric."""
        I = _symmetric(self.I - U[:3] @ W[:3].T)
        H = self.H - U[:3] @ W[3:].T
        M = _symmetric(self.M - U[3:] @ W[3:].T)
        return _Articulated(I, H, M)

    def in_frame(self, T: Array) -> _Articulated:
        """Operator in {a}, from this one in {b} and T = T_ab."""
        R = T[:3, :3]
        P = so3.hat(T[:3, 3])
        # in the axes of {a}, still about the origin of {b}
        I = _symmetric(R @ self.I @ R.T)
        H = R @ self.H @ R.T
        M = _symmetric(R @ self.M @ R.T)
        PH = P @ H.T
        return _Articulated(_symmetric(I + PH + PH.T - P @ M @ P), H + P @ M, M)


def _symmetric(X: Array) -> Array:
    """Symmetric matrix from the lower triangle of X. A trace then omits the operations for the upper triangle."""
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
    joint_twists = spread(model, dq)  # V_J, each in the frame of its body
    drive_torques = armature_forces(model, dq, zeros(model.nv))  # of armatures at q̈ = 0
    tau = tau - spring_forces(model, q) - drive_torques
    rotor_inertia = model.armature if added is None else added + model.armature
    A = []  # articulated inertia of each body
    p = []  # (6,) of each body: the wrench at dV = 0
    c = []  # (6,) of each body: the acceleration due to velocities
    w = {BASE: zeros(3)}  # angular velocity of each body
    for i, parent in outward(model):
        R = T[i][:3, :3]
        r = T[i][:3, 3]
        w_joint, v_joint = joint_twists[i][:3], joint_twists[i][3:]
        w[i] = R.T @ w[parent] + w_joint
        c_angular = so3.cross(w[i], w_joint)
        centripetal = so3.cross(w[parent], so3.cross(w[parent], r))
        joint_part = so3.cross(2.0 * w[i] - w_joint, v_joint)
        c_linear = R.T @ centripetal + joint_part
        c.append(np.concatenate([c_angular, c_linear]))  # (1)
        A.append(_Articulated.from_rigid_body(model.bodies[i].inertia))
        p.append(inertial_wrench(model.bodies[i].inertia, BodyMotion(w[i], zeros(3), zeros(3))))
    for i, F_by in applied_wrenches(model, wrenches):  # by the robot on the world
        p[i] = p[i] + F_by
    joint_solutions: dict[int, tuple[Array, Array]] = {}  # U D⁻¹ and D⁻¹ u of each body
    for i, parent in inward(model):
        body = model.bodies[i]
        S = body.joint.axes
        U = np.array([A[i] @ axis for axis in S]).T
        _, velocity_slice = body.places
        D = with_diagonal(S @ U, rotor_inertia[velocity_slice])
        D_factors = ldl_factors(D)
        u = tau[velocity_slice] - S @ p[i]  # (2)
        U_D_inverse = np.array([solve_ldl(*D_factors, row) for row in U])
        joint_solutions[i] = U_D_inverse, solve_ldl(*D_factors, u)
        if parent != BASE:
            A_across = A[i].minus_product(U, U_D_inverse)  # A - U D⁻¹ U'
            p_across = p[i] + A_across @ c[i] + U_D_inverse @ u
            A[parent] = A[parent] + A_across.in_frame(T[i])
            p[parent] = p[parent] + Ad(T[i]).inverse.T @ p_across  # (3)
    ddq = zeros(model.nv)
    dV = {BASE: np.concatenate([zeros(3), -model.gravity])}
    for i, parent in outward(model):
        body = model.bodies[i]
        U_D_inverse, D_inverse_u = joint_solutions[i]
        dV_carried = Ad(T[i]).inverse @ dV[parent] + c[i]
        ddq_joint = D_inverse_u - U_D_inverse.T @ dV_carried
        _, velocity_slice = body.places
        ddq[velocity_slice] = ddq_joint
        dV[i] = dV_carried + ddq_joint @ body.joint.axes  # (4)
    return ddq


def articulated_pays(model: Model) -> bool:
    """True if articulated bodies take fewer multiplications than M; False if joints share a coordinate or a motor.

    The numbers of multiplications were counted on chains, a quadruped and a humanoid. Articulated bodies take 190 for each
    body. M takes 60 for each velocity, and 14 more for each body that carries it. The factors of M take n (n + 1)/2 more for a
    velocity after n others on its path. The costs are equal for chains of about fifteen joints.
    """
    if model.couplings or any(body.follows for body in model.bodies):
        return False
    velocity_counts = {BASE: 0}  # on the path from the base to each body
    depths = {BASE: -1}  # number of bodies that carry a body
    mass_matrix_cost = 0
    for i, parent in outward(model):
        velocity_counts[i] = velocity_counts[parent] + model.bodies[i].joint.nv
        depths[i] = depths[parent] + 1
        for n in range(velocity_counts[parent], velocity_counts[i]):
            mass_matrix_cost += 60 + 14 * depths[i] + n * (n + 1) // 2
    return 190 * len(model.bodies) < mass_matrix_cost


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
    if added is not None:
        M = with_diagonal(M, added)
    L, D_inverse = ldl_factors(M)
    return solve_ldl(L, D_inverse, tau - bias_forces(model, q, dq, wrenches))
