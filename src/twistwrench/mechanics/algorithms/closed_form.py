"""Dynamics in block matrices, Modern Robotics section 8.4: slow, simple, and independent of the recursions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.typing import Array
from ..lie import se3
from ..lie.adjoint import Ad, ad
from ..model.couplings import armature_matrix
from ..model.model import BASE, Model
from .inverse_dynamics import Wrenches
from .recursion import joint_poses, spring_forces

# The twists of all bodies are stacked: 𝒱 = ℒ(𝒜 q̇), with ℒ = (1 - 𝒲)⁻¹. 𝒲 has the block Ad(T_i,p) in row i and column p if
# body p is the parent of body i. Then M = 𝒜'ℒ'𝒢ℒ𝒜, and c, g and the torques of wrenches follow without a recursion. Floats
# only.


@dataclass(frozen=True, eq=False)
class ClosedForm:
    """τ = M q̈ + c + g + J'F, its terms, and the block matrices that produce them, with six rows per body.

    Examples
    --------
    >>> import numpy as np, twistwrench as tw
    >>> at = tw.robots.ur5().closed_form([0, 1, 1, 0, 0, 0], np.ones(6))
    >>> np.allclose(at.M, at.A.T @ at.L.T @ at.G @ at.L @ at.A)
    True
    >>> np.allclose(at.V, at.L @ at.A @ np.ones(6)) and np.allclose(at.L, np.linalg.inv(np.eye(36) - at.W))
    True
    >>> [term.shape for term in (at.inverse_dynamics(np.ones(6)), at.accelerations(np.ones(6)), at.wrenches(np.ones(6)))]
    [(6,), (36,), (36,)]
    """

    M: Array
    """Mass matrix 𝒜'ℒ'𝒢ℒ𝒜, plus the armature of the drives on its diagonal; (nv, nv)."""
    c: Array
    """Coriolis and centripetal torques; (nv,)."""
    g: Array
    """Gravity torques plus spring torques; (nv,)."""
    wrench_torques: Array
    """J'F, torques of the wrenches that the robot exerts; (nv,)."""
    A: Array
    """𝒜, joint screw axes in the frames of their bodies; (6n, nv)."""
    G: Array
    """𝒢, spatial inertias; (6n, 6n)."""
    W: Array
    """𝒲, Ad(T_ip) in the rows of body i and the columns of its parent p; (6n, 6n)."""
    L: Array
    """ℒ = (1 - 𝒲)⁻¹, with Ad(T_ij) if body j carries body i; (6n, 6n)."""
    V: Array
    """𝒱 = ℒ𝒜 q̇, body twists; (6n,)."""
    ad_V: Array
    """[ad 𝒱], block diagonal; (6n, 6n)."""
    ad_Adq: Array
    """[ad 𝒜q̇], block diagonal; (6n, 6n)."""
    dV_base: Array
    """𝒱̇_base, the base acceleration -gravity in the rows of the bodies attached to it; (6n,)."""
    F_by: Array
    """ℱ, wrenches that the robot exerts; (6n,)."""

    def inverse_dynamics(self, ddq: Array) -> Array:
        """Inverse dynamics by the block matrices: joint torques of the accelerations.

        Parameters
        ----------
        ddq : (nv,) array, joint accelerations [rad/s², m/s²]

        Returns
        -------
        tau : (nv,) array [N m, sliding joints: N]
        """
        return self.M @ ddq + self.c + self.g + self.wrench_torques

    def accelerations(self, ddq: Array) -> Array:
        """Accelerations of the bodies 𝒱̇ = ℒ(𝒜 q̈ - [ad 𝒜q̇] 𝒲𝒱 + 𝒱̇_base), gravity included.

        Parameters
        ----------
        ddq : (nv,) array, joint accelerations [rad/s², m/s²]

        Returns
        -------
        dV : (6n,) array, six rows a body, each in its own frame [rad/s², m/s²]
        """
        return self.L @ (self.A @ ddq - self.ad_Adq @ (self.W @ self.V) + self.dV_base)

    def wrenches(self, ddq: Array) -> Array:
        """Wrenches through the joints, ℱ = ℒ'(𝒢𝒱̇ - [ad 𝒱]'𝒢𝒱 + ℱ_by), which each body receives from its parent.

        Parameters
        ----------
        ddq : (nv,) array, joint accelerations [rad/s², m/s²]

        Returns
        -------
        F : (6n,) array, six rows a body, each in its own frame [N m, N]
        """
        return self.L.T @ (self.G @ self.accelerations(ddq) - self.ad_V.T @ (self.G @ self.V) + self.F_by)


def closed_form(model: Model, q: Array, dq: Array, wrenches: Wrenches | None = None) -> ClosedForm:
    """All terms at one state, from block matrices of size 6n. MR section 8.4."""
    n = len(model.bodies)
    T = [np.asarray(pose, float) for pose in joint_poses(model, np.asarray(q, float))]
    A = np.zeros((6 * n, model.nv))
    G = np.zeros((6 * n, 6 * n))
    W = np.zeros((6 * n, 6 * n))
    dV_base = np.zeros(6 * n)
    F = np.zeros(6 * n)
    rows_of_bodies = [slice(6 * i, 6 * i + 6) for i in range(n)]
    for i, body in enumerate(model.bodies):
        rows = rows_of_bodies[i]
        _, columns = body.places
        A[rows, columns] = body.ratio * body.joint.axes.T
        G[rows, rows] = body.inertia.matrix
        Ad_ip = Ad(se3.inverse(T[i])).matrix
        if body.parent == BASE:
            dV_base[rows] = Ad_ip @ np.concatenate([np.zeros(3), -model.gravity])
        else:
            W[rows, rows_of_bodies[body.parent]] = Ad_ip
    for name, F_by in (wrenches or {}).items():
        frame = model.frame(name)
        if frame.body != BASE:
            Ad_frame = Ad(se3.inverse(frame.pose)).matrix  # from the body to the frame
            F[rows_of_bodies[frame.body]] += Ad_frame.T @ F_by
    L = np.linalg.inv(np.eye(6 * n) - W)
    V = L @ A @ dq
    ad_V = _block_diagonal(V)
    ad_Adq = _block_diagonal(A @ dq)
    return ClosedForm(
        M=A.T @ L.T @ G @ L @ A + armature_matrix(model),
        c=-A.T @ L.T @ (G @ L @ ad_Adq @ W + ad_V.T @ G) @ V + _armature_products(model, dq),
        g=A.T @ L.T @ G @ L @ dV_base + np.asarray(spring_forces(model, q), float),
        wrench_torques=A.T @ L.T @ F,
        A=A, G=G, W=W, L=L, V=V, ad_V=ad_V, ad_Adq=ad_Adq, dV_base=dV_base, F_by=F,
    )  # fmt: skip


def _armature_products(model: Model, dq: Array) -> Array:
    """Part (nv,) of c due to the armature A of the joints: -S [V, ·]' S' A u, with u = dq and the joint's twist V = S' u."""
    c = np.zeros(model.nv)
    A_u = model.armature * dq
    for body in model.leaders:
        _, columns = body.places
        S = body.joint.axes
        V = dq[columns] @ S
        momentum = A_u[columns] @ S
        c[columns] = -S @ (ad(V).T @ momentum)
    return c


def _block_diagonal(V: Array) -> Array:
    """Matrices ad(V_i) on the diagonal, from twists (6n,); (6n, 6n)."""
    matrix = np.zeros((len(V), len(V)))
    for k in range(0, len(V), 6):
        matrix[k : k + 6, k : k + 6] = ad(V[k : k + 6]).matrix
    return matrix
