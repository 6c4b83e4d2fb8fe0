"""Newton–Euler inverse dynamics on trees (MR section 8.3), and its regressor.

The laws of Newton and Euler hold in every inertial frame. Each body has its own: the frame that at this instant moves with the
body's origin. In it v = 0, and the linear part of dV is the ordinary acceleration ``a`` of the origin. So (8.51)–(8.53) lose a
third of their terms. The acceleration of a body point at r is ``a + U r`` with

    U = [dw] + [w]²,      the upper left block of  T⁻¹ T̈ = [dV] + [V]².
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...core.typing import Array
from ..bodies.inertia import SpatialInertia
from ..lie import so3
from ..lie.adjoint import Ad
from ..model.model import BASE, Model
from .friction import friction_forces
from .recursion import ancestors, armature_forces, collect, inward, joint_poses, outward, spread, spring_forces, zeros

Wrenches = Mapping[str, Array]
"""Wrenches that the robot exerts, by frame and in the axes of the frame."""


@dataclass
class BodyMotion:
    """Angular velocity and acceleration of a body, in its own frame, and the acceleration of its origin."""

    w: Array
    dw: Array
    a: Array

    @cached_property
    def U(self) -> Array:
        """[dw] + [w]², which maps a point of the body to its relative acceleration."""
        W = so3.hat(self.w)
        return so3.hat(self.dw) + W @ W


def body_motions(
    model: Model, T: Sequence[Array], dq: Array, ddq: Array, gravity: bool = True
) -> Iterator[tuple[int, BodyMotion]]:
    """Pairs (index of body, its motion) from the base outward; with ``gravity``, the base accelerates by -g."""
    Adq = spread(model, dq)  # A dq of each body's joint
    Addq = spread(model, ddq)
    base_acceleration = -model.gravity if gravity else zeros(3)
    motions = {BASE: BodyMotion(zeros(3), zeros(3), base_acceleration)}
    for i, p in outward(model):
        parent = motions[p]
        R, r = T[i][:3, :3], T[i][:3, 3]
        wJ, vJ = Adq[i][:3], Adq[i][3:]  # twist of the joint, A dq
        dwJ, dvJ = Addq[i][:3], Addq[i][3:]  # A ddq
        w = R.T @ parent.w + wJ  # (8.51)
        dw = R.T @ parent.dw + so3.cross(w, wJ) + dwJ  # (8.52), angular part
        a = R.T @ (parent.a + parent.U @ r) + so3.cross(2.0 * w - wJ, vJ) + dvJ  # (8.52), origin
        motions[i] = BodyMotion(w, dw, a)
        yield i, motions[i]


def joint_wrenches(
    model: Model, q: Array, dq: Array, ddq: Array, wrenches: Wrenches | None = None, gravity: bool = True
) -> Array:
    """Wrench that each body receives through its joint, in the body's frame; (nbodies, 6)."""
    T = joint_poses(model, q)
    F: dict[int, Array] = {}
    for i, motion in body_motions(model, T, dq, ddq, gravity):
        F[i] = inertial_wrench(model.bodies[i].inertia, motion)  # (8.53), the body's own part
    for i, F_by in applied_wrenches(model, wrenches):
        F[i] = F[i] + F_by
    for i, p in inward(model):
        if p != BASE:
            F[p] = F[p] + Ad(T[i]).inverse.T @ F[i]  # (8.53), the children's part
    return np.array([F[i] for i in range(len(model.bodies))]).reshape(-1, 6)


def applied_wrenches(model: Model, wrenches: Wrenches | None) -> Iterator[tuple[int, Array]]:
    """Pairs (index of body, wrench in the body's frame); wrenches at the base have no effect and are left out."""
    for name, F_by in (wrenches or {}).items():
        frame = model.frame(name)
        if frame.body != BASE:
            yield frame.body, Ad(frame.pose).inverse.T @ F_by


def inertial_wrench(G: SpatialInertia, motion: BodyMotion) -> Array:
    """G dV - ad(V)' G V for V = (w, 0), dV = (dw, a): the Newton–Euler equations with products of inertia.

    The moment n and the force f are

        n = I dw + w × I w + h × a,   f = m a + U h

    Row x of I dw + w × I w is written with entries of U, which are computed for f anyway. Without products of inertia it is
    Euler's equation, I_xx dw_x + (I_zz - I_yy) w_y w_z. Rows y and z follow by cyclic exchange.
    """
    m, h, I = G.mass, G.first_moment, G.moment_about_origin
    w, dw, a, U = motion.w, motion.dw, motion.a, motion.U
    f = m * a + U @ h
    n = zeros(3) + so3.cross(h, a)
    for x, y, z in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        n[x] = n[x] + (
            I[x, x] * dw[x] + (I[z, z] - I[y, y]) * (w[y] * w[z])
            - I[x, y] * U[z, x] + I[x, z] * U[y, x] + I[y, z] * (U[y, y] - U[z, z])
        )  # fmt: skip
    return np.concatenate([n, f])


def inverse_dynamics(
    model: Model, q: Array, dq: Array, ddq: Array, wrenches: Wrenches | None = None, friction: bool = False
) -> Array:
    """Joint torques τ = M q̈ + h + Σ J'F_by, with friction on request; (nv,). MR eq. 8.54."""
    tau = collect(model, joint_wrenches(model, q, dq, ddq, wrenches)) + armature_forces(model, dq, ddq)
    tau = tau + spring_forces(model, q)
    if friction:
        tau = tau + friction_forces(model, dq, load=tau)
    return tau


def bias_forces(model: Model, q: Array, dq: Array, wrenches: Wrenches | None = None) -> Array:
    """h = c + g, Σ J'F_by and spring torques; (nv,). MR section 8.4."""
    return inverse_dynamics(model, q, dq, zeros(model.nv), wrenches)


def coriolis_forces(model: Model, q: Array, dq: Array) -> Array:
    """Centripetal and Coriolis terms c; (nv,)."""
    ddq = zeros(model.nv)
    return collect(model, joint_wrenches(model, q, dq, ddq, gravity=False)) + armature_forces(model, dq, ddq)


def gravity_forces(model: Model, q: Array, wrenches: Wrenches | None = None) -> Array:
    """Gravity torques g, plus Σ J'F_by if wrenches are given, without springs; (nv,)."""
    dq = ddq = zeros(model.nv)
    return collect(model, joint_wrenches(model, q, dq, ddq, wrenches))


def holding_torques(model: Model, q: Array, wrenches: Wrenches | None = None) -> Array:
    """Torques that hold the robot at rest: g, spring torques, and Σ J'F_by; (nv,)."""
    return bias_forces(model, q, zeros(model.nv), wrenches)


def drive_torques(
    model: Model, q: Array, dq: Array, ddq: Array, wrenches: Wrenches | None = None
) -> tuple[Array, Array]:
    """Torques of gears and of rotors at the joints, which add up to τ; (nv,) each. MR section 8.9.3."""
    F = joint_wrenches(model, q, dq, ddq, wrenches)
    is_rotor = np.array([[float(not body.joint.moves_body)] for body in model.bodies])  # 1 or 0 for each row of F
    rotor_torques = collect(model, is_rotor * F) + armature_forces(model, dq, ddq)
    gear_torques = collect(model, (1.0 - is_rotor) * F) + spring_forces(model, q)
    return gear_torques, rotor_torques


# ── Regressor: inverse dynamics linear in the inertial parameters. Atkeson, An and Hollerbach, 1986

PARAMETER_NAMES = ("m", "mcx", "mcy", "mcz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
"""The ten parameters of a body about its frame's origin, in the order of ``SpatialInertia.parameters``."""

_UNIT_INERTIAS = [SpatialInertia.from_parameters(unit_vector) for unit_vector in np.eye(10)]
"""Inertias with one parameter 1 and the others 0."""


def regressor(model: Model, q: Array, dq: Array, ddq: Array) -> Array:
    """Y in τ = Y π, π the ten parameters of each body in turn, without springs and armature; (nv, 10 nbodies)."""
    T = joint_poses(model, q)
    to_parent = [Ad(pose).inverse.T for pose in T]
    Y = zeros(model.nv, 10 * len(model.bodies))
    for i, motion in body_motions(model, T, dq, ddq):
        for k, unit_inertia in enumerate(_UNIT_INERTIAS):
            column = 10 * i + k
            F = inertial_wrench(unit_inertia, motion)
            for j in ancestors(model, i):  # from body i to the base
                body = model.bodies[j]
                _, rows = body.places
                Y[rows, column] = Y[rows, column] + body.ratio * (body.joint.axes @ F)
                F = to_parent[j] @ F
    return Y
