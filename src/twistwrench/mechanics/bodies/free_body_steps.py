"""Steps of a free rigid body: torque-free, under a wrench, of adaptive length; and the impulse that quadrature misses."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ...core import arguments
from ...core.errors import ValueRangeError
from ...core.numbers import printed
from ...core.quadrature import ProbeRule, left_out
from ...core.typing import Array
from ..lie import quaternion, se3, so3
from .inertia import COMPOSITIONS, Quat, SplitRotor, Vec

WrenchLaw = Callable[[float, Array, Array], ArrayLike]
"""Function that returns a wrench (6,) in {b} from the time [s], the pose T_sb (4, 4) and the body twist (6,), plain arrays."""

_MAX_IMPULSE_ERROR = 0.05
"""Fraction of the momentum above which a quadrature error is reported."""

State = tuple[Array, Array, Array, Array]
Push = Callable[..., Array]
"""Wrench (6,) about the centre of mass from time, quaternion, position, angular and linear momentum."""


def six(name: str, x: ArrayLike) -> Array:
    """Return six finite numbers. Raises ShapeError, ValueRangeError."""
    return arguments.finite(arguments.one(x, name, 6), name, 6)


class MissedImpulse:
    """Estimate of the impulses missed so far (absolute values), and the time of the largest."""

    def __init__(self, fractions: Sequence[float], h: float, spacing: float) -> None:
        b = np.array(fractions)
        self.h, self.rule = h, ProbeRule(np.cumsum(b) - 0.5 * b, b, spacing)
        self.needed = bool(np.isfinite(spacing)) and self.rule.needed(h)
        self.sum = np.zeros(6)
        self.worst, self.when = 0.0, 0.0

    def look(self, t: float, push: Push, before: State, after: State) -> None:
        """Record a step from t: the wrench is evaluated along the straight line between the two states."""
        if not self.needed:
            return
        shares, weights = self.rule.shares(self.h)
        wrenches = []
        for share in shares.tolist():
            q, *state = ((1.0 - share) * a + share * b for a, b in zip(before, after, strict=True))
            wrenches.append(push(t + share * self.h, q / np.linalg.norm(q), *state))
        forces = np.array(wrenches)
        missing = self.h * np.abs(left_out(weights, forces))
        self.sum += missing
        if missing.max() > self.worst:
            deviation = np.abs(forces - np.median(forces, axis=0)).max(axis=1)
            self.worst, self.when = float(missing.max()), t + self.h * float(shares[int(deviation.argmax())])

    def remark(self, linear: float, angular: float) -> str:
        """Remark if the missed impulse is a large part of the largest linear [N s] or angular momentum [N m s]; else empty."""
        if not (self.sum[3:].max() > _MAX_IMPULSE_ERROR * linear or self.sum[:3].max() > _MAX_IMPULSE_ERROR * angular):
            return ""
        return (
            f"the wrench changes within steps of {printed(self.h, 3)} s in a way that the method does not see, most of all "
            f"about t = {printed(self.when)} s: take a smaller dt"
        )


# ── Steps: torque-free, under a wrench, and of adaptive length


@dataclass(frozen=True, eq=False)
class FreeBody:
    """Body in its principal frame {c} at the centre of mass, with the transform to {b}."""

    mass: float
    moments: Array
    T_bc: Array

    @cached_property
    def T_cb(self) -> Array:
        """Pose of the body's frame {b} in {c}."""
        return np.asarray(se3.inverse(self.T_bc))

    @cached_property
    def Ad_bc(self) -> Array:
        """Adjoint that takes twists from {c} to {b}; its transpose takes wrenches from {b} to {c}."""
        return np.asarray(se3.Ad(self.T_bc))

    def state(self, T_sb: Array, V_b: Array) -> tuple[Array, Array, Array, Array]:
        """Quaternion (4,), position (3,), spatial angular momentum about the centre of mass and linear momentum (3,)."""
        T, V = T_sb @ self.T_bc, se3.Ad(self.T_cb).apply(V_b)
        R = T[:3, :3]
        return quaternion.from_matrix(R), T[:3, 3], R @ (self.moments * V[:3]), self.mass * (R @ V[3:])

    def motion(self, q: Array, p: Array, l: Array, f: Array) -> tuple[Array, Array]:
        """Pose of {b} (..., 4, 4) and its twist (..., 6)."""
        R = quaternion.rotation(q)
        Rt = np.swapaxes(R, -1, -2)
        w, v = (Rt @ l[..., None])[..., 0] / self.moments, (Rt @ f[..., None])[..., 0] / self.mass
        return se3.pose(R, p) @ self.T_cb, np.concatenate([w, v], axis=-1) @ self.Ad_bc.T

    def push(self, law: WrenchLaw, t: float, q: Array, p: Array, l: Array, f: Array) -> tuple[Array, float]:
        """Wrench (6,) on the body about its centre of mass in the axes of {s}, and its power [W], for one state."""
        w, x, y, z = q.tolist()
        R = np.array(quaternion.entries(w, x, y, z, 2.0 / (w * w + x * x + y * y + z * z))).reshape(3, 3)
        V = self.Ad_bc @ np.concatenate([(l @ R) / self.moments, (f @ R) / self.mass])
        T_sc = np.eye(4)
        T_sc[:3, :3], T_sc[:3, 3] = R, p
        F = six("the wrench", law(t, T_sc @ self.T_cb, V))
        F_c = F @ self.Ad_bc
        return np.concatenate([R @ F_c[:3], R @ F_c[3:]]), float(F @ V)


Rows = tuple[Array, Array, Array, Array, Array, Array]
"""Rows of a record: quaternion (k, 4), position, angular and linear momentum (k, 3), impulse (k, 6), work (k,)."""


def torque_free_motion(
    body: FreeBody, start: tuple[Array, ...], h: float, n: int, stride: int, fractions: tuple[float, ...]
) -> Rows:
    """Record of torque-free motion: rotation steps are composed of split rotors with the given fractions."""
    q0, p, l, f = start
    rotor = SplitRotor.from_moments(_vec(body.moments))
    turns, last_turn = rotor.schedule(h, fractions)
    _require_computable(l, 0.0)
    q = _quat(q0)
    L = _vec(l)
    record = array("d", q)
    for i in range(1, n + 1):
        q = rotor.step(q, L, h, turns, last_turn)
        if i % stride == 0 or i == n:
            record.extend(q)
    Q = np.frombuffer(record).reshape(-1, 4)
    k = len(Q)
    t = np.append(np.arange(0, n, stride), n) * h
    positions = p + np.multiply.outer(t, f / body.mass)
    return Q, positions, np.broadcast_to(l, (k, 3)), np.broadcast_to(f, (k, 3)), np.zeros((k, 6)), np.zeros(k)


def motion_under_wrench(
    body: FreeBody,
    start: tuple[Array, ...],
    h: float,
    n: int,
    stride: int,
    fractions: tuple[float, ...],
    law: WrenchLaw,
    missed: MissedImpulse,
) -> Rows:
    """Record of motion under a wrench. Each fraction of a step: half of it free, the whole impulse, the other half free."""
    q, p, l, f = start
    rotor = SplitRotor.from_moments(_vec(body.moments))
    half_steps = [(0.5 * c * h, *rotor.schedule(0.5 * c * h, COMPOSITIONS[2])) for c in fractions]
    impulse, work = np.zeros(6), 0.0
    record = [(q, p, l, f, impulse, work)]
    for i in range(1, n + 1):
        t, before = (i - 1) * h, (q, p, l, f)
        for half, turns, last_turn in half_steps:
            _require_computable(l, t)
            q, p, t = (
                np.array(rotor.step(_quat(q), _vec(l), half, turns, last_turn)),
                p + half / body.mass * f,
                t + half,
            )
            F, power = _midpoint(body, law, t, q, p, l, f, 2.0 * half)
            l, f = l + 2.0 * half * F[:3], f + 2.0 * half * F[3:]
            about_origin = np.concatenate([F[:3] + so3.cross(p, F[3:]), F[3:]])
            impulse, work = impulse + 2.0 * half * about_origin, work + 2.0 * half * power
            _require_computable(l, t)
            q, p, t = (
                np.array(rotor.step(_quat(q), _vec(l), half, turns, last_turn)),
                p + half / body.mass * f,
                t + half,
            )
        missed.look((i - 1) * h, lambda t, *state: body.push(law, t, *state)[0], before, (q, p, l, f))
        if i % stride == 0 or i == n:
            record.append((q, p, l, f, impulse, work))
    q, p, l, f, J, W = (np.array(x) for x in zip(*record, strict=True))
    return q, p, l, f, J, W


def _require_computable(l: Array, t: float) -> None:
    """Raise ValueRangeError if the angular momentum is too large to compute the rotation per step."""
    if not np.abs(l).max() < 1e100:
        raise ValueRangeError(
            f"at t = {printed(t)} s the angular momentum is {l.tolist()} N m s. Take a smaller V0 or wrench."
        )


def _midpoint(
    body: FreeBody, law: WrenchLaw, t: float, q: Array, p: Array, l: Array, f: Array, h: float
) -> tuple[Array, float]:
    """Wrench of an impulse of duration ``h`` at the mean of the momenta before and after it, by fixed-point iteration."""
    F, power = body.push(law, t, q, p, l, f)
    change = np.inf
    for _ in range(60):
        old, before, size = F, change, np.abs(F).max()
        F, power = body.push(law, t, q, p, l + 0.5 * h * old[:3], f + 0.5 * h * old[3:])
        change = np.abs(F - old).max()
        if change <= 1e-15 * size or before <= change <= 1e-12 * size:  # converged, or down to rounding errors
            return F, power
        if change > 2.0 * before:
            break
    raise ValueRangeError(
        f"at t = {printed(t)} s the wrench depends on the twist so steeply that a step of {printed(abs(h))} s finds no "
        "balance. Take a smaller dt, or a tolerance."
    )


def adaptive_motion(
    body: FreeBody, start: tuple[Array, ...], times: Array, law: WrenchLaw | None, tolerance: float, longest: float
) -> Rows:
    """Record integrated by SciPy's DOP853 in pose and momentum, to a relative error per step."""
    from scipy.integrate import solve_ivp

    q, p, l, f = start

    def rate(t: float, y: Array) -> Array:
        q, p, l, f = y[:4] / np.linalg.norm(y[:4]), y[4:7], y[7:10], y[10:13]
        w = (quaternion.rotation(q).T @ l) / body.moments
        F, power = (np.zeros(6), 0.0) if law is None else body.push(law, t, q, p, l, f)
        dq = 0.5 * quaternion.multiply(q, np.append(0.0, w))
        return np.concatenate([dq, f / body.mass, F, F[:3] + so3.cross(p, F[3:]), F[3:], [power]])

    # Absolute tolerances in units of the body: its radius of gyration, and one radius or radian per flight.

    T, m, r = times[-1], body.mass, float(np.sqrt(body.moments[2] / body.mass))
    speed = r / T + np.linalg.norm(f) / m + np.linalg.norm(l) / (m * r)
    sizes = [1.0] * 4 + [r] * 3 + [m * r * speed] * 3 + [m * speed] * 3 + [m * r * speed] * 3 + [m * speed] * 3
    atol = tolerance * np.array([*sizes, m * speed**2])
    y0 = np.concatenate([q, p, l, f, np.zeros(7)])
    out = solve_ivp(rate, (0.0, T), y0, method="DOP853", t_eval=times, rtol=tolerance, atol=atol, max_step=longest)
    if not out.success:
        raise ValueRangeError(f"the adaptive integration stopped at t = {printed(out.t[-1])} s: {out.message}")
    y = out.y.T
    return y[:, :4], y[:, 4:7], y[:, 7:10], y[:, 10:13], y[:, 13:19], y[:, 19]


def _vec(x: Array) -> Vec:
    return float(x[0]), float(x[1]), float(x[2])


def _quat(x: Array) -> Quat:
    return float(x[0]), float(x[1]), float(x[2]), float(x[3])
