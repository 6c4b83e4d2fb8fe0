"""Free motion of one rigid body, and how far its invariants drifted.

The body is integrated in principal axes at its centre of mass, where it turns and travels independently. The state is
the pose and the *spatial* momentum: without a wrench the momentum is a constant, not something to integrate, the centre of
mass moves on a straight line, and only the rotation takes steps (:mod:`twistwrench.bodies.splitting`). A wrench acts as
impulses between half steps of free motion, each an implicit midpoint rule in the momentum, so that the whole stays
symmetric, the orders of the compositions hold for wrenches that depend on velocity too, and work is exactly the gain of energy.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core import arguments
from ..errors import InertiaError, ValueRangeError
from ..lie import quaternion, se3, so3
from .inertia import SpatialInertia
from .labels import common_frame
from .splitting import COMPOSITIONS, Quat, Rotor, Vec

Array = NDArray[Any]
WrenchLaw = Callable[[float, Array, Array], ArrayLike]
"""A wrench (6,) in {b} from the time [s], the pose T_sb (4, 4) and the body twist (6,), which are plain arrays."""

__all__ = ["Drift", "Flight", "WrenchLaw", "fly"]

_LARGE_TURN, _LARGE_LOSS = 1.0, 0.01
"""rad a step, and share of the energy, from which flights of a box were seen to go astray within some turns."""


@dataclass(frozen=True)
class Drift:
    """How far a flight is from what mechanics keeps: momentum less impulse, energy less work. All relative; 0 is exact."""

    momentum: float
    """Largest change of the spatial momentum about the origin of {s}, over the largest of the terms it is made of."""
    energy: float
    """Largest change of the kinetic energy, over its largest value."""
    energy_trend: float
    """The part of that which grows: the slope of the straight line through it, times the duration."""
    rotation: float
    """Largest entry of RᵀR − 1 over all poses."""
    remarks: tuple[str, ...] = ()
    """Steps too large to be trusted, or other than asked for, in words; see :func:`fly`."""

    def __str__(self) -> str:
        return "; note: ".join(
            (
                f"momentum {self.momentum:.1e}, energy {self.energy:.1e} (trend {self.energy_trend:+.1e}), "
                f"rotation {self.rotation:.1e}",
                *self.remarks,
            )
        )


@dataclass(frozen=True, eq=False, repr=False)
class Flight:
    """A recorded free motion: n + 1 states, the first at time 0. Printing it says how many, and what drifted."""

    times: Array
    """(n + 1,) [s]."""
    poses: Array
    """(n + 1, 4, 4), T_sb."""
    twists: Array
    """(n + 1, 6), of the body in {b}, angular part first [rad/s, m/s]."""
    momentum: Array
    """(n + 1, 6), Ad(T_bs)ᵀ G V about the origin of {s} [N m s, N s], from the poses and twists above."""
    energy: Array
    """(n + 1,), ½ Vᵀ G V [J]."""
    impulse: Array
    """(n + 1, 6), of the wrench so far, about the origin of {s} [N m s, N s]."""
    work: Array
    """(n + 1,), of the wrench so far [J]."""
    dt: float = np.nan
    """s: the step asked for."""
    step: float = np.nan
    """s: the step taken, or with a tolerance the spacing of the record; the duration is a whole number of them."""
    turn: float = 0.0
    """rad: the largest turn in one step; 0 where steps adapt, or are exact."""
    drift: Drift = field(init=False)

    @property
    def remarks(self) -> tuple[str, ...]:
        """What to know before the flight is used, in words; empty if nothing. Those of :attr:`drift`."""
        return self.drift.remarks

    def __repr__(self) -> str:
        steps = "" if np.isnan(self.step) else f", steps of {self.step:.6g} s"
        return f"Flight of {self.times[-1]:g} s: {len(self.times)} states{steps}; drift: {self.drift}"

    def __post_init__(self) -> None:
        R, p = self.poses[:, :3, :3], self.poses[:, :3, 3]
        l, f = self.momentum[:, :3], self.momentum[:, 3:]
        dP = self.momentum - self.impulse - self.momentum[0]
        terms = np.abs(l).max() + np.abs(p).max() * np.abs(f).max(), np.abs(f).max()
        moved = (np.abs(dP[:, :3]).max(), np.abs(dP[:, 3:]).max())
        momentum = max(float(d / s) if s else 0.0 for d, s in zip(moved, terms, strict=True))
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
            yield f"steps of {self.step:.6g} s, not {self.dt:.6g} s, so that a whole number fills {self.times[-1]:g} s"
        if self.turn > _LARGE_TURN:
            yield f"dt is too large to trust the motion: the body turns up to {self.turn:.3g} rad in a step; keep it below 1"
        if lost > _LARGE_LOSS:
            yield f"the energy is off by {100 * lost:.2g} %, so the motion is wrong: take a smaller dt, or a tolerance"


@dataclass(frozen=True, eq=False)
class _Body:
    """The body in its principal frame {c} at the centre of mass, and the way to {b}."""

    mass: float
    moments: Array
    T_bc: Array

    def state(self, T_sb: Array, V_b: Array) -> tuple[Array, Array, Array, Array]:
        """Quaternion (4,), position (3,), spatial angular momentum about the centre of mass and linear momentum (3,)."""
        T, V = T_sb @ self.T_bc, se3.Ad(se3.inverse(self.T_bc)) @ V_b
        R = T[:3, :3]
        return quaternion.from_matrix(R), T[:3, 3], R @ (self.moments * V[:3]), self.mass * (R @ V[3:])

    def motion(self, q: Array, p: Array, l: Array, f: Array) -> tuple[Array, Array]:
        """Pose of {b} (..., 4, 4) and its twist (..., 6)."""
        R = quaternion.rotation(q)
        Rt = np.swapaxes(R, -1, -2)
        w, v = (Rt @ l[..., None])[..., 0] / self.moments, (Rt @ f[..., None])[..., 0] / self.mass
        V = se3.Ad(self.T_bc) @ np.concatenate([w, v], axis=-1)
        return se3.pose(R, p) @ se3.inverse(self.T_bc), V

    def push(self, law: WrenchLaw, t: float, q: Array, p: Array, l: Array, f: Array) -> tuple[Array, float]:
        """The wrench (6,) on the body about its centre of mass in the axes of {s}, and its power [W]."""
        T, V = self.motion(q, p, l, f)
        F = _six("the wrench", law(t, T, V))
        F_c = se3.Ad(self.T_bc).T @ F
        R = quaternion.rotation(q)
        return np.concatenate([R @ F_c[:3], R @ F_c[3:]]), float(F @ V)


def fly(
    inertia: SpatialInertia,
    T0: ArrayLike,
    V0: ArrayLike,
    duration: float,
    dt: float,
    wrench: ArrayLike | WrenchLaw | None = None,
    *,
    order: int = 4,
    tolerance: float | None = None,
    every: int = 1,
) -> Flight:
    """Free motion of a body from pose T0 (4, 4) and body twist V0 (6,).

    Parameters
    ----------
    T0, V0: may be labelled, a Pose of {b} and a Twist in {b}.
    duration, dt: s; ``dt`` is shortened so that a whole number of steps fills the duration: 0.3 s becomes 0.25 s in 1 s.
    wrench: in {b}: constant (6,), or a function ``wrench(t, T, V)`` of time, T_sb and V_b; none is torque-free flight. It may
        be labelled, or give a labelled one; T and V are plain arrays.
    order: 2, 4 or 6: the error of the motion falls as that power of dt. A body with two equal moments moves exactly.
    tolerance: relative error per step; given, the steps are SciPy's DOP853 and adapt, and ``dt`` only spaces the record.
        The spatial momentum of torque-free flight stays exact, the energy slowly drifts.
    every: keep one state in so many, and the last.

    Steps that were shortened, in which the body turns by more than 1 rad, or that lose more than 1 % of the energy, are said
    in ``flight.remarks`` and wherever a flight or its drift is printed. No warning is raised.

    Raises
    ------
    ShapeError, ValueRangeError: for arguments of the wrong shape, not finite, a T0 that is not a pose, or a function that
        does not take (t, T, V).
    FrameError: for labels that name two body frames, or a twist for a wrench.
    InertiaError: for a body without inertia about some axis.
    """
    moments, axes = inertia.principal()
    if not (inertia.mass > 0 and moments[0] > 1e-14 * moments[2]):
        raise InertiaError(
            f"a body of mass {inertia.mass:g} kg with principal moments {moments.tolist()} kg m² has no definite rotation. "
            "Give it mass, and some thickness."
        )
    body = _Body(float(inertia.mass), moments, se3.pose(axes, inertia.com))
    n = _steps(duration, dt, every)
    h = float(duration) / n
    if arguments.number(order, "order") not in COMPOSITIONS:
        raise ValueRangeError(f"order {order} is not available; choose one of {sorted(COMPOSITIONS)}.")
    if tolerance is not None and not 1e-13 <= arguments.number(tolerance, "tolerance") <= 1e-2:
        raise ValueRangeError(f"tolerance is {tolerance}, and must be between 1e-13 and 1e-2.")
    frame = common_frame(T0=T0, V0=V0, wrench=wrench)
    pose = arguments.pose(arguments.finite(arguments.one(T0, "T0", 4, 4), "T0", 4, 4), "T0")
    start = body.state(pose, _six("V0", V0))
    kept = np.append(np.arange(0, n, every), n)
    law = None if wrench is None else _called(wrench, frame) if callable(wrench) else _constant(wrench)
    if tolerance is not None:
        rows = _adaptive(body, start, kept * h, law, tolerance)
    elif law is None:
        rows = _torque_free(body, start, h, n, every, COMPOSITIONS[order])
    else:
        rows = _pushed(body, start, h, n, every, COMPOSITIONS[order], law)
    q, p, l, f, impulse, work = rows
    T, V = body.motion(q, p, l, f)
    P = inertia @ V
    energy = 0.5 * np.einsum("ij,ij->i", V, P)
    exact = law is None and np.diff(moments).min() <= 1e-6 * moments[2]
    turn = 0.0 if exact or tolerance is not None else h * float(np.linalg.norm(V[:, :3], axis=-1).max())
    momentum = se3.Ad(se3.inverse(T)).T @ P
    return Flight(kept * h, T, V, momentum, energy, impulse, work, float(dt), h, turn)


Rows = tuple[Array, Array, Array, Array, Array, Array]
"""Of a record: quaternion (k, 4), position, angular and linear momentum (k, 3), impulse (k, 6), work (k,)."""


def _torque_free(
    body: _Body, start: tuple[Array, ...], h: float, n: int, every: int, fractions: tuple[float, ...]
) -> Rows:
    q0, p, l, f = start
    rotor = Rotor.of(_vec(body.moments))
    turns, last = rotor.schedule(h, fractions)
    _countable(l, 0.0)
    q = _quat(q0)
    L = _vec(l)
    record = array("d", q)
    for i in range(1, n + 1):
        q = rotor.step(q, L, h, turns, last)
        if i % every == 0 or i == n:
            record.extend(q)
    Q = np.frombuffer(record).reshape(-1, 4)
    k = len(Q)
    t = np.append(np.arange(0, n, every), n) * h
    return (
        Q,
        p + np.multiply.outer(t, f / body.mass),
        np.broadcast_to(l, (k, 3)),
        np.broadcast_to(f, (k, 3)),
        np.zeros((k, 6)),
        np.zeros(k),
    )


def _pushed(
    body: _Body, start: tuple[Array, ...], h: float, n: int, every: int, fractions: tuple[float, ...], law: WrenchLaw
) -> Rows:
    """Each fraction of a step: half of it free, the impulse of all of it, the other half free."""
    q, p, l, f = start
    rotor = Rotor.of(_vec(body.moments))
    halves = [(0.5 * c * h, *rotor.schedule(0.5 * c * h, COMPOSITIONS[2])) for c in fractions]
    impulse, work = np.zeros(6), 0.0
    record = [(q, p, l, f, impulse, work)]
    for i in range(1, n + 1):
        t = (i - 1) * h
        for half, turns, last in halves:
            _countable(l, t)
            q, p, t = np.array(rotor.step(_quat(q), _vec(l), half, turns, last)), p + half / body.mass * f, t + half
            F, power = _midpoint(body, law, t, q, p, l, f, 2.0 * half)
            l, f = l + 2.0 * half * F[:3], f + 2.0 * half * F[3:]
            about_origin = np.concatenate([F[:3] + so3.cross(p, F[3:]), F[3:]])
            impulse, work = impulse + 2.0 * half * about_origin, work + 2.0 * half * power
            _countable(l, t)
            q, p, t = np.array(rotor.step(_quat(q), _vec(l), half, turns, last)), p + half / body.mass * f, t + half
        if i % every == 0 or i == n:
            record.append((q, p, l, f, impulse, work))
    q, p, l, f, J, W = (np.array(x) for x in zip(*record, strict=True))
    return q, p, l, f, J, W


def _countable(l: Array, t: float) -> None:
    """Refuse an angular momentum whose turns per step cannot be told."""
    if not np.abs(l).max() < 1e100:
        raise ValueRangeError(
            f"at t = {t:g} s the angular momentum is {l.tolist()} N m s. Take a smaller V0 or wrench."
        )


def _midpoint(
    body: _Body, law: WrenchLaw, t: float, q: Array, p: Array, l: Array, f: Array, h: float
) -> tuple[Array, float]:
    """The wrench of an impulse of length ``h``, taken at the mean of the momenta before and after it."""
    F, power = body.push(law, t, q, p, l, f)
    change = np.inf
    for _ in range(60):
        old, before, size = F, change, np.abs(F).max()
        F, power = body.push(law, t, q, p, l + 0.5 * h * old[:3], f + 0.5 * h * old[3:])
        change = np.abs(F - old).max()
        if change <= 1e-15 * size or before <= change <= 1e-12 * size:  # settled, or down to rounding
            return F, power
        if change > 2.0 * before:
            break
    raise ValueRangeError(
        f"at t = {t:g} s the wrench depends on the twist so steeply that a step of {abs(h):g} s finds no balance. "
        "Take a smaller dt, or a tolerance."
    )


def _adaptive(body: _Body, start: tuple[Array, ...], times: Array, law: WrenchLaw | None, tolerance: float) -> Rows:
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
    out = solve_ivp(rate, (0.0, T), y0, method="DOP853", t_eval=times, rtol=tolerance, atol=atol)
    if not out.success:
        raise ValueRangeError(f"the adaptive integration stopped at t = {out.t[-1]:g} s: {out.message}")
    y = out.y.T
    return y[:, :4], y[:, 4:7], y[:, 7:10], y[:, 10:13], y[:, 13:19], y[:, 19]


# ── the door ──


def _steps(duration: float, dt: float, every: int) -> int:
    for name, x in (("duration", duration), ("dt", dt)):
        if not 0.0 < arguments.number(x, name) < np.inf:
            raise ValueRangeError(f"{name} is {x}, and must be a positive number of seconds.")
    if not (arguments.number(every, "every") >= 1 and every % 1 == 0):
        raise ValueRangeError(f"every is {every}, and must be a whole number of steps, at least 1.")
    if not float(duration) < 1e8 * every * dt:
        raise ValueRangeError(
            f"a duration of {duration:g} s in steps of {dt:g} s, one in {every} kept, makes more than 1e8 states. Keep fewer "
            "with every, or take a larger dt."
        )
    return max(1, int(np.ceil(duration / dt * (1.0 - 1e-12))))


def _six(name: str, x: ArrayLike) -> Array:
    return arguments.finite(arguments.one(x, name, 6), name, 6)


def _constant(wrench: ArrayLike) -> WrenchLaw:
    F = _six("wrench", wrench)
    return lambda _t, _T, _V: F


def _called(wrench: WrenchLaw, frame: str | None) -> WrenchLaw:
    """The function, once it takes three arguments; what it gives is held to one frame, the first that is named."""
    from inspect import signature

    try:
        taken = signature(wrench)
    except (TypeError, ValueError):  # some of C say nothing
        taken = None
    if taken is not None:
        try:
            taken.bind(0.0, None, None)
        except TypeError as problem:
            raise ValueRangeError(
                f"wrench is a function of {taken}, and is called as wrench(t, T, V), with the time [s], the pose T_sb "
                f"(4, 4) and the body twist (6,): {problem}. Write lambda t, T, V: …"
            ) from None

    def law(t: float, T: Array, V: Array) -> ArrayLike:
        nonlocal frame
        F = wrench(t, T, V)
        frame = common_frame(frame, wrench=F)
        return F

    return law


def _vec(x: Array) -> Vec:
    return float(x[0]), float(x[1]), float(x[2])


def _quat(x: Array) -> Quat:
    return float(x[0]), float(x[1]), float(x[2]), float(x[3])
