"""Free motion of one rigid body under wrenches, with the drift of its invariants."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from inspect import signature

import numpy as np
from numpy.typing import ArrayLike

from ...core import arguments
from ...core.errors import InertiaError, ValueRangeError
from ...core.numbers import number, percent, printed, residual
from ...core.quadrature import ProbeRule, left_out, probe_spacing
from ...core.typing import Array
from ..lie import quaternion, se3, so3
from .inertia import COMPOSITIONS, Quat, SpatialInertia, SplitRotor, Vec
from .rigid_body import common_frame

WrenchLaw = Callable[[float, Array, Array], ArrayLike]
"""Function that returns a wrench (6,) in {b} from the time [s], the pose T_sb (4, 4) and the body twist (6,), plain arrays."""


def steps(duration: float, dt: float, stride: int) -> int:
    """Number of steps that fill the duration. Raises ValueRangeError."""
    for name, x in (("duration", duration), ("dt", dt)):
        if not 0.0 < arguments.number(x, name) < np.inf:
            raise ValueRangeError(f"{name} is {x}, and must be a positive number of seconds.")
    if not (arguments.number(stride, "every") >= 1 and stride % 1 == 0):
        raise ValueRangeError(f"every is {stride}, and must be a whole number of steps, at least 1.")
    if not float(duration) < 1e8 * stride * dt:
        raise ValueRangeError(
            f"a duration of {printed(duration)} s in steps of {printed(dt)} s, one in {stride} kept, makes more than 1e8 "
            "states. Keep fewer with every, or take a larger dt."
        )
    return max(1, int(np.ceil(duration / dt * (1.0 - 1e-12))))


def six(name: str, x: ArrayLike) -> Array:
    """Return six finite numbers. Raises ShapeError, ValueRangeError."""
    return arguments.finite(arguments.one(x, name, 6), name, 6)


def constant(wrench: ArrayLike) -> WrenchLaw:
    """Return a constant wrench (6,) as a function of the state."""
    F = six("wrench", wrench)
    return lambda _t, _T, _V: F


def checked_law(wrench: WrenchLaw, frame: str | None) -> WrenchLaw:
    """Function checked to take three arguments; all its labelled values must be in one frame."""
    try:
        parameters = signature(wrench)
    except (TypeError, ValueError):  # some C functions have no signature
        parameters = None
    if parameters is not None:
        try:
            parameters.bind(0.0, None, None)
        except TypeError as problem:
            raise ValueRangeError(
                f"wrench is a function of {parameters}, and is called as wrench(t, T, V), with the time [s], the pose T_sb "
                f"(4, 4) and the body twist (6,): {problem}. Write lambda t, T, V: …"
            ) from None

    def law(t: float, T: Array, V: Array) -> ArrayLike:
        nonlocal frame
        F = wrench(t, T, V)
        frame = common_frame(frame, wrench=F)
        return F

    return law


# ── Quadrature error of the impulse of a time-dependent wrench

_MAX_IMPULSE_ERROR = 0.05
"""Fraction of the momentum above which a quadrature error is reported."""

State = tuple[Array, Array, Array, Array]
Push = Callable[..., Array]
"""Wrench (6,) about the centre of mass from time, quaternion, position, angular and linear momentum."""


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


# ── Recorded motion and drift of its invariants

_LARGE_TURN, _LARGE_LOSS = 1.0, 0.01
"""Rotation per step [rad] and fraction of the energy above which simulations of boxes failed within a few turns."""


@dataclass(frozen=True)
class Drift:
    """Drift of the invariants of a flight: momentum minus impulse, energy minus work. All relative; 0 is exact."""

    momentum: float
    """Largest change of the spatial momentum about the origin of {s}, relative to its largest terms."""
    energy: float
    """Largest change of the kinetic energy, relative to its largest value."""
    energy_trend: float
    """Growing part of the energy change: the slope of its regression line, times the duration."""
    rotation: float
    """Largest entry of RᵀR − 1 over all poses."""
    remarks: tuple[str, ...] = ()
    """Steps that are too large, or differ from the requested ones, as text; see :func:`fly`."""

    def __str__(self) -> str:
        return "; note: ".join(
            (
                f"momentum {residual(self.momentum)}, energy {residual(self.energy)} (trend "
                f"{printed(self.energy_trend, 2, signed=True)}), rotation {residual(self.rotation)}",
                *self.remarks,
            )
        )


@dataclass(frozen=True, eq=False, repr=False)
class Flight:
    """Recorded free motion: n + 1 states, the first at time 0. ``print`` shows the number of states and the drift."""

    times: Array
    """Times (n + 1,) [s]."""
    poses: Array
    """Poses T_sb (n + 1, 4, 4)."""
    twists: Array
    """Body twists (n + 1, 6) in {b}, angular part first [rad/s, m/s]."""
    momentum: Array
    """Spatial momentum (n + 1, 6), Ad(T_bs)ᵀ G V about the origin of {s} [N m s, N s], from the poses and twists above."""
    energy: Array
    """Kinetic energy (n + 1,), ½ Vᵀ G V [J]."""
    impulse: Array
    """Impulse (n + 1, 6) of the wrench up to each time, about the origin of {s} [N m s, N s]."""
    work: Array
    """Work (n + 1,) of the wrench up to each time [J]."""
    dt: float = np.nan
    """Requested step [s]."""
    step: float = np.nan
    """Step taken [s], or with a tolerance the interval of the record; a whole number of them fills the duration."""
    turn: float = 0.0
    """Largest rotation in one step [rad]; 0 if steps are adaptive or exact."""
    unseen: str = ""
    """Change of the wrench within steps that the method does not resolve, as text; empty if none."""
    drift: Drift = field(init=False)
    """Drift of momentum and energy."""

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks of :attr:`drift` and on the wrench, to be read before the flight is used; empty if none."""
        return self.drift.remarks

    def __repr__(self) -> str:
        steps = "" if np.isnan(self.step) else f", steps of {number(self.step, 6)} s"
        return f"Flight of {printed(self.times[-1])} s: {len(self.times)} states{steps}; drift: {self.drift}"

    def __post_init__(self) -> None:
        R, p = self.poses[:, :3, :3], self.poses[:, :3, 3]
        l, f = self.momentum[:, :3], self.momentum[:, 3:]
        dP = self.momentum - self.impulse - self.momentum[0]
        terms = np.abs(l).max() + np.abs(p).max() * np.abs(f).max(), np.abs(f).max()
        changes = (np.abs(dP[:, :3]).max(), np.abs(dP[:, 3:]).max())
        momentum = max(float(d / s) if s else 0.0 for d, s in zip(changes, terms, strict=True))
        scale = float(self.energy.max()) or 1.0
        dE = (self.energy - self.work - self.energy[0]) / scale
        t = self.times / self.times[-1] - 0.5
        trend = float((t - t.mean()) @ dE / ((t - t.mean()) @ t))
        rotation = float(np.abs(np.swapaxes(R, 1, 2) @ R - np.eye(3)).max())
        lost = float(np.abs(dE).max())
        remarks = tuple(self._remarks(lost))
        object.__setattr__(self, "drift", Drift(momentum, lost, trend, rotation, remarks))

    def _remarks(self, lost: float) -> Iterator[str]:
        if abs(self.step - self.dt) > 1e-9 * self.dt:
            yield (
                f"steps of {number(self.step, 6)} s, not {number(self.dt, 6)} s, so that a whole number fills "
                f"{printed(self.times[-1])} s"
            )
        if self.turn > _LARGE_TURN:
            yield (
                f"dt is too large to trust the motion: the body turns up to {number(self.turn, 3)} rad in a step; keep it "
                "below 1"
            )
        if self.unseen:
            yield self.unseen
        if lost > _LARGE_LOSS:
            yield f"the energy is off by {percent(lost, 2)}, so the motion is wrong: take a smaller dt, or a tolerance"


# ── Integration of the free motion

# The body is integrated in principal axes at its centre of mass, where rotation and translation are independent. The state is
# the pose and the *spatial* momentum. Without a wrench this momentum is constant, the centre of mass moves on a straight line,
# and only the rotation takes steps (:mod:`twistwrench.mechanics.bodies.inertia`). A wrench acts as impulses between half steps
# of free motion, each an implicit midpoint rule in the momentum. So the method is symmetric, the orders of the compositions
# also hold for wrenches that depend on velocity, and work is exactly the gain of energy.

_STAGES = 3.0
"""Maximum step of DOP853 in probe intervals: its stages are at most 0.27 of a step apart."""


def fly(
    inertia: SpatialInertia,
    T0: ArrayLike,
    V0: ArrayLike,
    duration: float,
    dt: float,
    wrench: ArrayLike | WrenchLaw | None,
    *,
    order: int,
    tolerance: float | None,
    every: int,
) -> Flight:
    """Free motion of a body; the arguments are those of :meth:`twistwrench.RigidBody.fly`."""
    moments, axes = inertia.principal()
    if not (inertia.mass > 0 and moments[0] > 1e-14 * moments[2]):
        raise InertiaError(
            f"a body of mass {printed(inertia.mass)} kg with principal moments {moments.tolist()} kg m² has no definite "
            "rotation. Give it mass, and some thickness."
        )
    body = FreeBody(float(inertia.mass), moments, se3.pose(axes, inertia.com))
    n = steps(duration, dt, every)
    h = float(duration) / n
    if arguments.number(order, "order") not in COMPOSITIONS:
        raise ValueRangeError(f"order {order} is not available; choose one of {sorted(COMPOSITIONS)}.")
    if tolerance is not None and not 1e-13 <= arguments.number(tolerance, "tolerance") <= 1e-2:
        raise ValueRangeError(f"tolerance is {tolerance}, and must be between 1e-13 and 1e-2.")
    frame = common_frame(T0=T0, V0=V0, wrench=wrench)
    pose = arguments.pose(arguments.finite(arguments.one(T0, "T0", 4, 4), "T0", 4, 4), "T0")
    start = body.state(pose, six("V0", V0))
    records = np.append(np.arange(0, n, every), n)
    law: WrenchLaw | None = None
    if wrench is not None:
        law = checked_law(wrench, frame) if callable(wrench) else constant(wrench)
    spacing = probe_spacing(h, float(duration)) if callable(wrench) else np.inf
    unseen = MissedImpulse(COMPOSITIONS[order], h, spacing)
    if tolerance is not None:
        rows = adaptive_motion(body, start, records * h, law, tolerance, _STAGES * spacing)
    elif law is None:
        rows = torque_free_motion(body, start, h, n, every, COMPOSITIONS[order])
    else:
        rows = motion_under_wrench(body, start, h, n, every, COMPOSITIONS[order], law, unseen)
    q, p, l, f, impulse, work = rows
    T, V = body.motion(q, p, l, f)
    P = inertia @ V
    energy = 0.5 * np.einsum("ij,ij->i", V, P)
    exact = law is None and np.diff(moments).min() <= 1e-6 * moments[2]
    turn = 0.0 if exact or tolerance is not None else h * float(np.linalg.norm(V[:, :3], axis=-1).max())
    momentum = se3.Ad(se3.inverse(T)).T @ P
    remark = unseen.remark(
        max(float(np.abs(f).max()), float(np.abs(impulse[:, 3:]).sum(axis=-1).max())), float(np.abs(l).max())
    )
    return Flight(records * h, T, V, momentum, energy, impulse, work, float(dt), h, turn, remark)
