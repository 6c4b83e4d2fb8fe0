"""Forward dynamics by articulated bodies: work that grows with the number of bodies, not its cube. Featherstone, RBDA, ch. 7.

The wrench F that gives a body the acceleration dV, while all that it carries is free to move, is  F = A dV + p. Its
articulated inertia A is symmetric but no rigid body's: a body is heavier across a joint than along it. Bodies are watched
as in :mod:`.inverse_dynamics`: from the inertial frame that at this instant moves with the body's own origin. Outward,
with λ the parent and R, r its pose, then inward, then outward again, RBDA, table 7.1:

    (1)  w = R'w_λ + w_J,   c = (w × w_J, R'(w_λ × (w_λ × r)) + (2w - w_J) × v_J)
    (2)  U = A S,   D = S'U + J,   u = τ - S'p                      J: of rotors
    (3)  A_λ += A - U D⁻¹ U',   p_λ += p + (A - U D⁻¹ U') c + U D⁻¹ u,   both seen from λ
    (4)  q̈ = D⁻¹ u - (U D⁻¹)'(dV_λ + c),   dV = dV_λ + c + S q̈         dV_λ seen from the body
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..bodies.inertia import SpatialInertia
from ..lie import so3
from ..lie.adjoint import Ad
from ..model.model import BASE, Model
from ..typing import Array
from .armature import armature_forces
from .inverse_dynamics import BodyMotion, Wrenches, applied_wrenches, inertial_wrench
from .recursion import inward, joint_poses, outward, spread, zeros
from .springs import spring_forces
from .tree_factorisation import factored, solved, widened


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
    """Whether this takes fewer multiplications than M and its factors; never where joints share a coordinate.

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
