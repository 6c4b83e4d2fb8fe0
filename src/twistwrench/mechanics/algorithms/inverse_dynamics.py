"""Newton–Euler inverse dynamics on trees (MR section 8.3), its regressor, motor torques, powers, and closed form (8.4).

The laws of Newton and Euler hold in every inertial frame. For each body, the frame is the one that at this instant moves
with the body's own origin: there v = 0, the linear part of dV is the ordinary acceleration ``a`` of the origin, and
(8.51)–(8.53) lose a third of their terms. The acceleration of a body point at r is then ``a + U r`` with

    U = [dw] + [w]²,      the upper left block of  T⁻¹ T̈ = [dV] + [V]².
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ...core.numbers import printed
from ...core.typing import Array
from ..bodies.inertia import SpatialInertia
from ..lie import se3, so3
from ..lie.adjoint import Ad, ad
from ..model.actuators import gear_input, moving
from ..model.couplings import armature_matrix, motor_torques, motor_velocities
from ..model.model import BASE, Model
from .friction import friction_forces
from .recursion import ancestors, armature_forces, collect, inward, joint_poses, outward, spread, spring_forces, zeros

Wrenches = Mapping[str, Array]


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
    """(body, its motion) from the base outward; with gravity, the base accelerates upward."""
    Adq, Addq = spread(model, dq), spread(model, ddq)
    motion = {BASE: BodyMotion(zeros(3), zeros(3), -model.gravity if gravity else zeros(3))}
    for i, p in outward(model):
        R, r, up = T[i][:3, :3], T[i][:3, 3], motion[p]
        wJ, vJ, dwJ, dvJ = Adq[i][:3], Adq[i][3:], Addq[i][:3], Addq[i][3:]
        w = R.T @ up.w + wJ  # (8.51)
        dw = R.T @ up.dw + so3.cross(w, wJ) + dwJ  # (8.52), angular part
        a = R.T @ (up.a + up.U @ r) + so3.cross(2.0 * w - wJ, vJ) + dvJ  # (8.52), origin
        motion[i] = BodyMotion(w, dw, a)
        yield i, motion[i]


def joint_wrenches(
    model: Model, q: Array, dq: Array, ddq: Array, wrenches: Wrenches | None = None, gravity: bool = True
) -> Array:
    """Wrench that each body receives through its joint, in its own frame; (nbodies, 6).

    ``wrenches`` are exerted by the robot, at the named frames and in their axes.
    """
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
    """(body, wrench in its frame) for the robot's wrenches at frames; wrenches at the base have no effect and are skipped."""
    for name, F_by in (wrenches or {}).items():
        frame = model.frame(name)
        if frame.body != BASE:
            yield frame.body, Ad(frame.pose).inverse.T @ F_by


def inertial_wrench(G: SpatialInertia, motion: BodyMotion) -> Array:
    """G dV - ad(V)' G V for V = (w, 0), dV = (dw, a): the Newton–Euler equations with products of inertia.

    I dw + w × I w uses entries of U, which are already computed. Without products of inertia its rows are Euler's equations,
    ``m_x = I_xx dw_x + (I_zz - I_yy) w_y w_z``.
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
    return tau + friction_forces(model, dq, load=tau) if friction else tau


def bias_forces(model: Model, q: Array, dq: Array, wrenches: Wrenches | None = None) -> Array:
    """h = c + g plus spring torques; (nv,). MR section 8.4."""
    return inverse_dynamics(model, q, dq, zeros(model.nv), wrenches)


def coriolis_forces(model: Model, q: Array, dq: Array) -> Array:
    """c, the centripetal and Coriolis terms; (nv,)."""
    still = zeros(model.nv)
    return collect(model, joint_wrenches(model, q, dq, still, gravity=False)) + armature_forces(model, dq, still)


def gravity_forces(model: Model, q: Array, wrenches: Wrenches | None = None) -> Array:
    """g, plus Σ J'F_by if wrenches are given; (nv,)."""
    still = zeros(model.nv)
    return collect(model, joint_wrenches(model, q, still, still, wrenches))


def holding_torques(model: Model, q: Array, wrenches: Wrenches | None = None) -> Array:
    """Torques that hold the robot at rest: g, spring torques, and Σ J'F_by; (nv,)."""
    return bias_forces(model, q, zeros(model.nv), wrenches)


def drive_torques(
    model: Model, q: Array, dq: Array, ddq: Array, wrenches: Wrenches | None = None
) -> tuple[Array, Array]:
    """Torques of gears and of rotors at the joints, which add up to τ; (nv,) each. MR section 8.9.3."""
    F = joint_wrenches(model, q, dq, ddq, wrenches)
    spins = np.array([[float(not body.joint.moves_body)] for body in model.bodies])
    rotors = collect(model, spins * F) + armature_forces(model, dq, ddq)
    return collect(model, (1.0 - spins) * F) + spring_forces(model, q), rotors


# ── Motor torques from joint torques. Modern Robotics sections 8.9.1 and 8.9.3


class MotorLoads(NamedTuple):
    """Motor loads, one entry per actuator (last axis), in the order of ``robot.actuators``; NaN for unspecified motors."""

    torque: Array
    """Torque at the rotor [N m]."""
    speed: Array
    """Speed of the rotor relative to its stator [rad/s]."""
    current: Array
    """Motor current [A]."""
    voltage: Array
    """Voltage of the windings [V], without the inductive part."""
    power: Array
    """Electrical power into the motor [W]; negative when it regenerates."""
    heat: Array
    """Heat loss in the windings [W]."""


def driven_velocities(model: Model) -> list[int]:
    """Index of each actuator among the drives' velocities and torques, in the order of ``model.actuators``."""
    return [model.drive_names.index(name) for name in model.actuators]


def motor_loads(model: Model, dq: Array, carried: Array, rotor: Array) -> MotorLoads:
    """Motor loads from the gear and rotor torques, both at the joints; (..., nv) each. MR eq. 8.122 and 8.123.

    A gear of efficiency η transmits the fraction η of the power that enters it, in either direction; at rest the motor
    carries the larger torque, T/η.
    """
    at, actuators = driven_velocities(model), list(model.actuators.values())
    dq, carried, rotor = motor_velocities(model, dq), motor_torques(model, carried), motor_torques(model, rotor)
    G = np.array([a.ratio for a in actuators])
    eta = np.array([a.efficiency for a in actuators])
    dq, carried, rotor = (x[..., at] for x in np.broadcast_arrays(dq, carried, rotor))
    idle = np.array([a.no_load_torque for a in actuators])
    speed = G * dq
    torque = (gear_input(carried, dq, eta) + rotor) / G + idle * np.sign(G * moving(dq))
    current, voltage, heat = (np.full_like(torque, np.nan) for _ in range(3))
    for k, motor in enumerate(a.motor for a in actuators):
        if motor is not None:
            current[..., k] = motor.current(torque[..., k])
            voltage[..., k] = motor.voltage_at(current[..., k], speed[..., k])
            heat[..., k] = motor.heat(current[..., k])
    return MotorLoads(torque, speed, current, voltage, voltage * current, heat)


# ── Regressor: inverse dynamics linear in the inertial parameters. Atkeson, An and Hollerbach, 1986

PARAMETER_NAMES = ("m", "mcx", "mcy", "mcz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
"""The ten parameters of a body about its frame's origin, in the order of ``SpatialInertia.parameters``."""

_UNITS = [SpatialInertia.from_parameters(e) for e in np.eye(10)]


def regressor(model: Model, q: Array, dq: Array, ddq: Array) -> Array:
    """Y in τ = Y π, π the ten parameters of each body in turn, without springs and armature; (nv, 10 nbodies)."""
    T = joint_poses(model, q)
    up = [Ad(X).inverse.T for X in T]
    Y = zeros(model.nv, 10 * len(model.bodies))
    for i, motion in body_motions(model, T, dq, ddq):
        for k, unit in enumerate(_UNITS):
            F, column = inertial_wrench(unit, motion), 10 * i + k
            for j in ancestors(model, i):
                body = model.bodies[j]
                rows = body.places[1]
                Y[rows, column] = Y[rows, column] + body.ratio * (body.joint.axes @ F)
                F = up[j] @ F
    return Y


# ── Power balance


class PowerBalance(NamedTuple):
    """Powers into the mechanism [W]; powers out of it are negative. The sum is zero."""

    joints: Array
    """Power of the joints, τ'dq."""
    motion: Array
    """Minus the rate of kinetic and potential energy, including springs."""
    wrenches: Array
    """Minus the power that the robot delivers through the wrenches."""
    friction: Array
    """Minus the friction loss in the joints."""

    def __str__(self) -> str:
        if np.ndim(self.joints):
            return f"<PowerBalance of states {np.shape(self.joints)}>"
        parts = ", ".join(f"{name} {printed(float(value), 4, signed=True)} W" for name, value in self._asdict().items())
        return f"into the mechanism from: {parts}"


def power_balance(dq: Array, tau: Array, moving: Array, pushing: Array, lost: Array) -> PowerBalance:
    """Power balance from τ and its parts M ddq + h, Σ J'F and friction; (..., nv) each."""
    return PowerBalance(*(np.sum(x * dq, axis=-1) for x in (tau, -moving, -pushing, -lost)))


# ── Dynamics in block matrices, Modern Robotics section 8.4: slow, simple, and independent of the recursions

# The bodies are stacked: 𝒱 = ℒ(𝒜 q̇), with ℒ = (1 - 𝒲)⁻¹ and 𝒲 with Ad(T_i,p) where body p is the parent of body i.
# M = 𝒜'ℒ'𝒢ℒ𝒜, and c, g and the wrenches' part follow without a recursion. Floats only.


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
    n, nv = len(model.bodies), model.nv
    T = [np.asarray(X, float) for X in joint_poses(model, np.asarray(q, float))]
    A, G, W = np.zeros((6 * n, nv)), np.zeros((6 * n, 6 * n)), np.zeros((6 * n, 6 * n))
    dV_base, F = np.zeros(6 * n), np.zeros(6 * n)
    for i, body in enumerate(model.bodies):
        rows = slice(6 * i, 6 * i + 6)
        A[rows, body.places[1]] = body.ratio * body.joint.axes.T
        G[rows, rows] = body.inertia.matrix
        X = Ad(se3.inverse(T[i])).matrix
        if body.parent == BASE:
            dV_base[rows] = X @ np.concatenate([np.zeros(3), -model.gravity])
        else:
            W[rows, 6 * body.parent : 6 * body.parent + 6] = X
    for name, F_by in (wrenches or {}).items():
        frame = model.frame(name)
        if frame.body != BASE:
            F[6 * frame.body : 6 * frame.body + 6] += Ad(se3.inverse(frame.pose)).matrix.T @ F_by
    L = np.linalg.inv(np.eye(6 * n) - W)
    V = L @ A @ dq
    ad_V, ad_Adq = _block_diagonal(V), _block_diagonal(A @ dq)
    return ClosedForm(
        M=A.T @ L.T @ G @ L @ A + armature_matrix(model),
        c=-A.T @ L.T @ (G @ L @ ad_Adq @ W + ad_V.T @ G) @ V + _armature_products(model, dq),
        g=A.T @ L.T @ G @ L @ dV_base + np.asarray(spring_forces(model, q), float),
        wrench_torques=A.T @ L.T @ F,
        A=A, G=G, W=W, L=L, V=V, ad_V=ad_V, ad_Adq=ad_Adq, dV_base=dV_base, F_by=F,
    )  # fmt: skip


def _armature_products(model: Model, dq: Array) -> Array:
    """Part of c due to the armature of each joint: -S [V, ·]' S' A u, with V = S' u the joint's own twist; (nv,)."""
    c = np.zeros(model.nv)
    for body in model.leaders:
        columns, S = body.places[1], body.joint.axes
        c[columns] = -S @ (ad(dq[columns] @ S).T @ ((model.armature * dq)[columns] @ S))
    return c


def _block_diagonal(V: Array) -> Array:
    matrix = np.zeros((len(V), len(V)))
    for k in range(0, len(V), 6):
        matrix[k : k + 6, k : k + 6] = ad(V[k : k + 6]).matrix
    return matrix
