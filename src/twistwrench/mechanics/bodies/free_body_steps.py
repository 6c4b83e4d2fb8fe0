"""Steps of a free rigid body: torque-free, under a wrench, and of adaptive length. Estimate of the impulse that steps miss."""

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
_MAX_ANGULAR_MOMENTUM = 1e100
"""Angular momentum for which the rotation per step can be computed [N m s]."""
_MAX_ITERATIONS = 60
"""Number of fixed-point iterations for the wrench of an impulse."""
_CONVERGED_CHANGE = 1e-15
"""Change of the wrench, relative to the wrench, at which the iterations end."""
_MAX_ROUNDING = 1e-12
"""Change of the wrench, relative to the wrench, that may be a rounding error."""

State = tuple[Array, Array, Array, Array]
"""Quaternion q (4,), position p, angular momentum l and linear momentum f, (3,) each."""
Push = Callable[..., Array]
"""Function that returns the wrench (6,) about the centre of mass from the time and the four parts of a state."""


def six(name: str, x: ArrayLike) -> Array:
    """Return six finite numbers. Raises ShapeError, ValueRangeError."""
    return arguments.finite(arguments.one(x, name, 6), name, 6)


class MissedImpulse:
    """Estimate of the impulses missed so far (absolute values), and the time of the largest missed impulse.

    A step ``h`` evaluates the wrench in the middle of each of its ``fractions``. To estimate the impulse that these
    evaluations miss, the wrench is also evaluated at probes, which are at most ``spacing`` [s] apart.
    """

    def __init__(self, fractions: Sequence[float], h: float, spacing: float) -> None:
        lengths = np.array(fractions)
        midpoints = np.cumsum(lengths) - 0.5 * lengths
        self.h = h
        self.rule = ProbeRule(midpoints, lengths, spacing)
        self.needs_probes = bool(np.isfinite(spacing)) and self.rule.needed(h)
        self.sum = np.zeros(6)
        """Sum of the missed impulses: angular, then linear [N m s, N s]."""
        self.largest = 0.0
        """Largest entry of a missed impulse."""
        self.time_of_largest = 0.0

    def record(self, t: float, push: Push, state_before: State, state_after: State) -> None:
        """Record a step from t: the wrench is evaluated along the straight line between the two states."""
        if not self.needs_probes:
            return
        shares, weights = self.rule.shares(self.h)
        wrenches_at_probes = []
        for share in shares.tolist():
            parts = []
            for before, after in zip(state_before, state_after, strict=True):
                parts.append((1.0 - share) * before + share * after)
            q, *other_parts = parts
            wrenches_at_probes.append(push(t + share * self.h, q / np.linalg.norm(q), *other_parts))
        wrenches = np.array(wrenches_at_probes)
        missed_impulse = self.h * np.abs(left_out(weights, wrenches))
        self.sum += missed_impulse
        if missed_impulse.max() > self.largest:
            deviations = np.abs(wrenches - np.median(wrenches, axis=0)).max(axis=1)
            share_of_peak = float(shares[int(deviations.argmax())])
            self.largest = float(missed_impulse.max())
            self.time_of_largest = t + self.h * share_of_peak

    def remark(self, linear: float, angular: float) -> str:
        """Remark if the missed impulse is a large part of the largest linear [N s] or angular momentum [N m s]; else empty."""
        has_large_angular = self.sum[:3].max() > _MAX_IMPULSE_ERROR * angular
        has_large_linear = self.sum[3:].max() > _MAX_IMPULSE_ERROR * linear
        if not has_large_angular and not has_large_linear:
            return ""
        return (
            f"the wrench changes within steps of {printed(self.h, 3)} s in a way that the method does not see, most of all "
            f"about t = {printed(self.time_of_largest)} s: take a smaller dt"
        )


# ── Steps: torque-free, under a wrench, and of adaptive length


@dataclass(frozen=True, eq=False)
class FreeBody:
    """Body in its principal frame {c} at the centre of mass, with the transform to {b}."""

    mass: float
    moments: Array
    """Principal moments (3,), ascending."""
    T_bc: Array
    """Pose of {c} in {b}."""

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
        T_sc = T_sb @ self.T_bc
        V_c = se3.Ad(self.T_cb).apply(V_b)
        R, p = T_sc[:3, :3], T_sc[:3, 3]
        l = R @ (self.moments * V_c[:3])
        f = self.mass * (R @ V_c[3:])
        return quaternion.from_matrix(R), p, l, f

    def motion(self, q: Array, p: Array, l: Array, f: Array) -> tuple[Array, Array]:
        """Pose of {b} (..., 4, 4) and its twist (..., 6)."""
        R = quaternion.rotation(q)
        Rt = np.swapaxes(R, -1, -2)
        w = (Rt @ l[..., None])[..., 0] / self.moments
        v = (Rt @ f[..., None])[..., 0] / self.mass
        V_c = np.concatenate([w, v], axis=-1)
        return se3.pose(R, p) @ self.T_cb, V_c @ self.Ad_bc.T

    def push(self, law: WrenchLaw, t: float, q: Array, p: Array, l: Array, f: Array) -> tuple[Array, float]:
        """Wrench (6,) on the body about its centre of mass in the axes of {s}, and its power [W], for one state."""
        w, x, y, z = q.tolist()
        R = np.array(quaternion.entries(w, x, y, z, 2.0 / (w * w + x * x + y * y + z * z))).reshape(3, 3)
        V_b = self.Ad_bc @ np.concatenate([(l @ R) / self.moments, (f @ R) / self.mass])
        T_sc = np.eye(4)
        T_sc[:3, :3] = R
        T_sc[:3, 3] = p
        F_b = six("the wrench", law(t, T_sc @ self.T_cb, V_b))
        F_c = F_b @ self.Ad_bc
        return np.concatenate([R @ F_c[:3], R @ F_c[3:]]), float(F_b @ V_b)


Rows = tuple[Array, Array, Array, Array, Array, Array]
"""Rows of a record: quaternion (k, 4), position, angular and linear momentum (k, 3), impulse (k, 6), work (k,)."""


def torque_free_motion(
    body: FreeBody, start: tuple[Array, ...], h: float, n: int, stride: int, fractions: tuple[float, ...]
) -> Rows:
    """Record of torque-free motion in ``n`` steps ``h``, every ``stride`` steps and at the end.

    Rotation steps are composed of split rotors with the given fractions. The centre of mass moves uniformly.
    """
    q_start, p, l, f = start
    rotor = SplitRotor.from_moments(_vec(body.moments))
    turns, last_turn = rotor.schedule(h, fractions)
    _require_computable(l, 0.0)
    q = _quat(q_start)
    l_floats = _vec(l)
    record = array("d", q)
    for i in range(1, n + 1):
        q = rotor.step(q, l_floats, h, turns, last_turn)
        if i % stride == 0 or i == n:
            record.extend(q)
    quaternions = np.frombuffer(record).reshape(-1, 4)
    k = len(quaternions)
    t = np.append(np.arange(0, n, stride), n) * h
    positions = p + np.multiply.outer(t, f / body.mass)
    angular_momenta = np.broadcast_to(l, (k, 3))
    linear_momenta = np.broadcast_to(f, (k, 3))
    no_impulse = np.zeros((k, 6))
    no_work = np.zeros(k)
    return quaternions, positions, angular_momenta, linear_momenta, no_impulse, no_work


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
    """Record of motion under a wrench in ``n`` steps ``h``, every ``stride`` steps and at the end.

    In each fraction of a step, the body moves freely for one half, gets the impulse of the whole fraction, and moves freely
    for the other half.
    """

    def wrench(t: float, *state: Array) -> Array:
        F, _ = body.push(law, t, *state)
        return F

    q, p, l, f = start
    rotor = SplitRotor.from_moments(_vec(body.moments))
    half_steps = []
    for fraction in fractions:
        half = 0.5 * fraction * h
        turns, last_turn = rotor.schedule(half, COMPOSITIONS[2])
        half_steps.append((half, turns, last_turn))
    impulse = np.zeros(6)
    work = 0.0
    record = [(q, p, l, f, impulse, work)]
    for i in range(1, n + 1):
        t = (i - 1) * h
        state_before = (q, p, l, f)
        for half, turns, last_turn in half_steps:
            _require_computable(l, t)
            q = np.array(rotor.step(_quat(q), _vec(l), half, turns, last_turn))
            p = p + half / body.mass * f
            t = t + half
            F, power = _midpoint_wrench(body, law, t, q, p, l, f, 2.0 * half)
            l = l + 2.0 * half * F[:3]
            f = f + 2.0 * half * F[3:]
            about_origin = np.concatenate([F[:3] + so3.cross(p, F[3:]), F[3:]])
            impulse = impulse + 2.0 * half * about_origin
            work = work + 2.0 * half * power
            _require_computable(l, t)
            q = np.array(rotor.step(_quat(q), _vec(l), half, turns, last_turn))
            p = p + half / body.mass * f
            t = t + half
        missed.record((i - 1) * h, wrench, state_before, (q, p, l, f))
        if i % stride == 0 or i == n:
            record.append((q, p, l, f, impulse, work))
    q, p, l, f, impulses, works = (np.array(column) for column in zip(*record, strict=True))
    return q, p, l, f, impulses, works


def _require_computable(l: Array, t: float) -> None:
    """Raise ValueRangeError if the angular momentum is too large to compute the rotation per step."""
    if not np.abs(l).max() < _MAX_ANGULAR_MOMENTUM:
        raise ValueRangeError(
            f"at t = {printed(t)} s the angular momentum is {l.tolist()} N m s. Take a smaller V0 or wrench."
        )


def _midpoint_wrench(
    body: FreeBody, law: WrenchLaw, t: float, q: Array, p: Array, l: Array, f: Array, h: float
) -> tuple[Array, float]:
    """Wrench of an impulse of duration ``h`` at the mean of the momenta before and after it, by fixed-point iteration."""
    F, power = body.push(law, t, q, p, l, f)
    change = np.inf
    for _ in range(_MAX_ITERATIONS):
        previous_F = F
        previous_change = change
        size = np.abs(F).max()
        mean_l = l + 0.5 * h * previous_F[:3]
        mean_f = f + 0.5 * h * previous_F[3:]
        F, power = body.push(law, t, q, p, mean_l, mean_f)
        change = np.abs(F - previous_F).max()
        has_converged = change <= _CONVERGED_CHANGE * size
        is_rounding_error = previous_change <= change <= _MAX_ROUNDING * size  # it does not decrease further
        if has_converged or is_rounding_error:
            return F, power
        diverges = change > 2.0 * previous_change
        if diverges:
            break
    raise ValueRangeError(
        f"at t = {printed(t)} s the wrench depends on the twist so steeply that a step of {printed(abs(h))} s finds no "
        "balance. Take a smaller dt, or a tolerance."
    )


def adaptive_motion(
    body: FreeBody, start: tuple[Array, ...], times: Array, law: WrenchLaw | None, tolerance: float, longest: float
) -> Rows:
    """Record of motion at ``times``, by SciPy's DOP853 in pose and momentum, to a relative error ``tolerance`` per step."""
    from scipy.integrate import solve_ivp

    q, p, l, f = start

    def rate(t: float, y: Array) -> Array:
        q, p, l, f = y[:4] / np.linalg.norm(y[:4]), y[4:7], y[7:10], y[10:13]
        w = (quaternion.rotation(q).T @ l) / body.moments
        F = np.zeros(6)
        power = 0.0
        if law is not None:
            F, power = body.push(law, t, q, p, l, f)
        dq = 0.5 * quaternion.multiply(q, np.append(0.0, w))
        return np.concatenate([dq, f / body.mass, F, F[:3] + so3.cross(p, F[3:]), F[3:], [power]])

    # Sizes of the unknowns for absolute tolerances: lengths are compared with the radius of gyration r, speeds with one radius
    # per flight plus the initial speeds of translation and rotation.
    T = times[-1]
    m = body.mass
    r = float(np.sqrt(body.moments[2] / body.mass))
    speed = r / T + np.linalg.norm(f) / m + np.linalg.norm(l) / (m * r)
    momentum_sizes = [m * r * speed] * 3 + [m * speed] * 3  # angular, then linear
    impulse_sizes = momentum_sizes
    sizes = [1.0] * 4 + [r] * 3 + momentum_sizes + impulse_sizes + [m * speed**2]  # the last one is the work
    y_start = np.concatenate([q, p, l, f, np.zeros(7)])
    solution = solve_ivp(
        rate, (0.0, T), y_start, method="DOP853", t_eval=times,
        rtol=tolerance, atol=tolerance * np.array(sizes), max_step=longest,
    )  # fmt: skip
    if not solution.success:
        raise ValueRangeError(
            f"the adaptive integration stopped at t = {printed(solution.t[-1])} s: {solution.message}"
        )
    y = solution.y.T
    return y[:, :4], y[:, 4:7], y[:, 7:10], y[:, 10:13], y[:, 13:19], y[:, 19]


def _vec(x: Array) -> Vec:
    return float(x[0]), float(x[1]), float(x[2])


def _quat(x: Array) -> Quat:
    return float(x[0]), float(x[1]), float(x[2]), float(x[3])
