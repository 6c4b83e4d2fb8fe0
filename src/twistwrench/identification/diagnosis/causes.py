"""Causes of faults in logs: corrections of states that remove one fault, and additional torques of joint laws.

A cause c with value β maps the states s of a log to c(s, β). If c is the fault, the robot's equations hold for c(s, β):

    gain g of joint k:        τ_k = g (W x)_k                         g = -1 is a wrong sign
    zero β of joint k:        q_k - β                                 W evaluated there
    tilt (β_x, β_y):          gravity exp([β]) g
    delay β:                  τ(t + β)
    low-pass ω:               W / (1 + s/ω)
    time scale s:             dq / s, ddq / s²
    elasticity β of joint k:  q_k - β τ̂_k, with its rates             τ̂ = W x̂, the fitted torque
    play 2 β of joint k:      q_k - β u(q_k), with its rates            u: place of the link in the play, -1 to 1
    zero β from t_1 on:       q_k - β 1(t ≥ t_1), with its rates; all of them low-passed

Laws of the joint add β e_k to the fitted torque, with R the rigid part of τ̂, v_0 the speed of Coulomb friction:

    load friction |R_k| tanh(dq_k / v_0),   Stribeck fc_k tanh(dq_k / v_0) exp(-(dq_k / v_s)²),
    warming fc_k (t - t_0)/T tanh(dq_k / v_0),   drift (t - t_0)/T,   a delay of one joint -dτ̂_k/dt,
    gain drift (t - t_0)/T τ̂_k,   spring q_k - q̄_k,   offset from t_1 on 1(t ≥ t_1),   force on the tip -J' e.

All of them use the fitted torque. The measured torque contains the residual itself.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations
from typing import NamedTuple

import numpy as np

from ...core.typing import Array
from ...mechanics.bodies.inertia import SpatialInertia
from ...mechanics.lie import so3
from ...mechanics.model.model import BASE
from ..parameters import turning_joints
from .log_states import PORTION, LogStates

MIN_NEGATIVE_PART, _MIN_ROWS_OF_SIGN = 0.2, 0.1
"""Part of a torque (rms) below zero from which it has a sign, and minimum share of rows on either side of zero."""


def _with_column(values: Array, k: int, change: Callable[[Array], Array]) -> Array:
    found = values.copy()
    found[:, k] = change(values[:, k])
    return found


def gain(s: LogStates, k: int, g: float) -> LogStates:
    """Scale the torque of joint k by g."""
    return s.with_fields(gain=np.where(np.arange(len(s.gain)) == k, g * s.gain, s.gain))


def positions_times(s: LogStates, k: int, factor: float) -> LogStates:
    """Scale the position of joint k and its rates, and with them the width of its dry friction's step."""
    factors = np.where(np.arange(len(s.gain)) == k, factor, 1.0)
    width = np.where(np.arange(len(s.friction_speed)) == k, abs(factor) * s.friction_speed, s.friction_speed)
    return s.with_fields(q=s.q * factors, dq=s.dq * factors, ddq=s.ddq * factors, friction_speed=width)


def add_position(s: LogStates, k: int, j: int, sign: float) -> LogStates:
    """Add the position of joint j, times a sign, to that of joint k: encoders of coupled drives count both."""
    q, dq, ddq = s.q.copy(), s.dq.copy(), s.ddq.copy()
    for x in (q, dq, ddq):
        x[:, k] += sign * x[:, j]
    return s.with_fields(q=q, dq=dq, ddq=ddq)


def torque_without_sign(s: LogStates, k: int, x: Array) -> Cause | None:
    """Torque of joint k without its sign, which that of groups x (r,) gives it; None if that keeps its sign."""
    predicted = s.torques(x)[0][:, k]
    negative = float((predicted < -MIN_NEGATIVE_PART * np.sqrt((predicted**2).mean())).mean())
    if not _MIN_ROWS_OF_SIGN < negative < 1.0 - _MIN_ROWS_OF_SIGN:
        return None
    return Cause("unsigned", (k,), partial(_with_signs, k=k, sign=np.sign(predicted)))


def _with_signs(s: LogStates, k: int, sign: Array) -> LogStates:
    if not s.pieces:
        return s
    return s.with_fields(tau=_with_column(s.tau, k, lambda x: sign * x))


def zero(s: LogStates, k: int, beta: float) -> LogStates:
    """Subtract the zero error β from the position of joint k."""
    return s.with_fields(q=_with_column(s.q, k, lambda x: x - beta))


def exchanged_positions(s: LogStates, j: int, k: int) -> LogStates:
    """Exchange the positions of joints j and k."""
    order = np.arange(s.q.shape[1])
    order[[j, k]] = k, j
    return s.with_fields(q=s.q[:, order], dq=s.dq[:, order], ddq=s.ddq[:, order])


def exchanged_torques(s: LogStates, order: Array) -> LogStates:
    """Reorder the torques: joint j gets column ``order[j]``."""
    return s.with_fields(tau=s.tau[:, order])


def exchanged_joints(s: LogStates, j: int, k: int, order: Array) -> LogStates:
    """Exchange both positions and torques of joints j and k."""
    return exchanged_torques(exchanged_positions(s, j, k), order)


def tilt(s: LogStates, beta: Array) -> LogStates:
    """Turn the base by the vector β (2,) of a horizontal axis, so that gravity is exp([β]) g in its frame."""
    level = np.linalg.svd(s.gravity[None])[2][1:]  # two axes perpendicular to gravity
    return s.with_fields(gravity=so3.exp(level.T @ beta) @ s.gravity)


def time_scale(s: LogStates, factor: float) -> LogStates:
    """Scale the rates for a log whose times are ``factor`` times the true ones.

    The width of dry friction's step scales alike: another width would explain slow motions better without another time.
    """
    return s.with_fields(dq=s.dq * factor, ddq=s.ddq * factor**2, friction_speed=s.friction_speed * factor)


def behind(s: LogStates, beta: Array, turn: Array, rate: Array, acceleration: Array) -> LogStates:
    """Shift joint positions back by β times ``turn`` (n, nv), with its rates: links lag behind their motors."""
    if not s.pieces:
        return s
    return s.with_fields(q=s.q - beta * turn, dq=s.dq - beta * rate, ddq=s.ddq - beta * acceleration)


def compliances(s: LogStates, torque: Array, largest: Array | None = None) -> Iterator[Cause]:
    """Elasticity of each joint, and of all joints; β is the deflection at the ``largest`` (nv,) fitted torques (n, nv)."""
    if largest is None:
        largest = np.abs(torque).max(axis=0)
    share = torque / np.maximum(largest, 1e-300)
    rate = s.slope(share)
    acceleration = s.slope(rate)
    count = torque.shape[1]
    for joints in _joint_sets(count):
        of_joints = np.isin(np.arange(count), joints)
        correct = partial(behind, turn=share * of_joints, rate=rate * of_joints, acceleration=acceleration * of_joints)
        yield Cause("elasticity", joints, lambda s, beta, correct=correct: correct(s, beta), 1e-4)


def _joint_sets(count: int) -> list[tuple[int, ...]]:
    """Each joint by itself; of several joints also all of them."""
    sets: list[tuple[int, ...]] = [(k,) for k in range(count)]
    if count > 1:
        sets.append(tuple(range(count)))
    return sets


_PLAY, _PULSES = 4e-3, 0.05
"""Half of a play where its value starts [rad, m]; share of squared accelerations from which its pulses give the start."""


def side_in_play(positions: Array, half: float) -> Array:
    """(n,) place of a link in the play of its gear, -1 to 1: the motor at ``positions`` (n,) moves it at the ends of the play.

    The link stays until the motor has crossed the play, q_link ← min(max(q_link, q - β), q + β), with β half of the play.
    """
    lead, link = np.empty(len(positions)), float(positions[0])
    for k, q in enumerate(positions.tolist()):
        link = min(max(link, q - half), q + half)
        lead[k] = q - link
    return lead / half


def plays(s: LogStates) -> Iterator[Cause]:
    """Play of the gear of each joint; β is half of the play, by which the link lags behind its motor.

    Where the motor crosses the play, accelerations have pulses; β starts at their part in the accelerations if that is large.
    """
    if s.unfiltered is None:
        return
    for k in range(s.dq.shape[1]):
        pulse, ddq = _place_in_play(s, k, _PLAY)[2][:, k], s.ddq[:, k]
        size, product = float(pulse @ pulse), float(pulse @ ddq)
        start = _PLAY
        if product > 0.0 and product**2 > _PULSES * size * float(ddq @ ddq):
            start = product / size
        yield Cause("backlash", (k,), partial(_remove_play, k=k), 0.1 * _PLAY, starts=(start,))


def _remove_play(s: LogStates, beta: Array, k: int) -> LogStates:
    if not s.pieces:
        return s
    turn, rate, acceleration = _place_in_play(s, k, max(abs(float(beta[0])), 0.1 * _PLAY))
    return behind(s, beta, turn, rate, acceleration)


def _place_in_play(s: LogStates, k: int, half: float) -> tuple[Array, Array, Array]:
    """(n, nv) low-passed place of link k in a play, with its rates."""
    assert s.unfiltered is not None, "states of a log have positions"
    side = s.low_passed(np.concatenate([side_in_play(s.unfiltered[p, k], half) for p in s.pieces]))
    return _with_rates(s, side, k)


def _with_rates(s: LogStates, x: Array, k: int) -> tuple[Array, Array, Array]:
    """Course x (n,) of joint k with its first and second derivatives, (n, nv) each; 0 for the other joints."""
    rate = s.slope(x)
    of_joint = np.arange(s.dq.shape[1]) == k
    return x[:, None] * of_joint, rate[:, None] * of_joint, s.slope(rate)[:, None] * of_joint


def jumps(s: LogStates) -> Iterator[Cause]:
    """Another zero of a joint from a jump of its position on, if it jumps."""
    for k, piece, begin in s.jumps:
        reached = np.clip((s.time - begin) * s.rate + 0.5, 0.0, 1.0) * (s.piece == piece) + (s.piece > piece)
        turn, rate, acceleration = _with_rates(s, s.low_passed(reached), k)
        correct = partial(behind, turn=turn, rate=rate, acceleration=acceleration)
        yield Cause("zero-change", (k,), lambda s, beta, correct=correct: correct(s, beta), 1e-3, since=(piece, begin))


# ── Causes by name


@dataclass(frozen=True, eq=False)
class Cause:
    """Correction of states to test; ``correct`` applies it with a value β, and the search begins at ``starts``."""

    kind: str
    joints: tuple[int, ...]
    correct: Callable[..., LogStates]
    step: float = 0.0
    """Step of β in finite differences; 0 for a cause without a value."""
    size: int = 1
    """Number of components of β."""
    starts: tuple[float, ...] = (0.0,)
    number: float | None = None
    """Value of a discrete cause, in the unit of the table of doubts."""
    cost: float = 0.0
    """Amount by which its S must exceed the S of other causes."""
    since: tuple[int, float] | None = None
    """Piece and time [s] at which the cause begins; None for the whole log."""


class FittedTorques(NamedTuple):
    """Fitted torques of states: total and of the rigid bodies (n, nv), and Coulomb friction of each joint (nv,)."""

    whole: Array
    rigid: Array
    coulomb: Array

    @classmethod
    def from_groups(cls, s: LogStates, x: Array) -> FittedTorques:
        """Torques of the states ``s`` with groups ``x`` (r,)."""
        unknown, kept = s.base.unknown, s.base.kept
        dry = np.zeros(len(s.gain))
        for c, joints in unknown.coulomb_columns(kept):
            dry[joints] += abs(float(x[c])) * (unknown.kinds[int(kept[c])] == "coulomb")
        return cls(*s.torques(x), dry)


@dataclass(frozen=True, eq=False)
class Law:
    """Joint law: a torque as a function of the states and their fitted torques, optionally from some row on."""

    kind: str
    joints: tuple[int, ...]
    values: Callable[[LogStates, FittedTorques], Array]
    speed: float = 0.0
    """Speed at which static friction has decayed (Stribeck speed)."""
    since: tuple[int, float] | None = None
    """Piece and time [s] at which the law begins to act."""

    def columns(self, s: LogStates, fitted: FittedTorques) -> Array:
        """Columns (n, nv, k) of the law, in the rows of its joints."""
        return self.everywhere(s, fitted) * np.isin(np.arange(len(s.gain)), self.joints)[:, None]

    def everywhere(self, s: LogStates, fitted: FittedTorques) -> Array:
        """Columns (n, nv, k) of the law applied to all joints."""
        values = self.values(s, fitted)
        if values.ndim == 2:
            values = values[..., None]
        return values * self.acting(s)[:, None, None]

    def acting(self, s: LogStates) -> Array:
        """(n,) bool: states in which the law acts."""
        if self.since is None:
            return np.ones(len(s.time), bool)
        piece, time = self.since
        return np.asarray((s.piece > piece) | ((s.piece == piece) & (s.time >= time)))


def discrete_causes(s: LogStates, suspects: Sequence[int]) -> Iterator[Cause]:
    """Signs, units and exchanges of columns, zeros by quarters of a turn, mountings and units of time."""
    turning = turning_joints(s.base.unknown.model)
    for k in suspects:
        yield Cause("torque-sign", (k,), partial(gain, k=k, g=-1.0))
        yield Cause("position-sign", (k,), partial(positions_times, k=k, factor=-1.0))
        yield Cause("both-signs", (k,), lambda s, k=k: gain(positions_times(s, k, -1.0), k, -1.0))
        if s.gravity.any():
            yield Cause("no-gravity", (k,), partial(LogStates.with_fields, weightless=(*s.weightless, k)))
        if turning[k]:
            yield Cause("degrees", (k,), partial(positions_times, k=k, factor=np.pi / 180))
            for turn in (0.5 * np.pi, -0.5 * np.pi, np.pi):
                yield Cause("zero-turn", (k,), partial(zero, k=k, beta=turn), number=float(np.degrees(turn)))
        if k and turning[k - 1] and turning[k]:  # wrists; each further test makes others less significant
            for sign in (-1.0, 1.0):
                yield Cause("coupled", (k, k - 1), partial(add_position, k=k, j=k - 1, sign=sign), number=sign)
    for j, k in combinations(suspects, 2):
        if turning[j] == turning[k]:
            yield from _exchanges(s, j, k)
    if s.gravity.any():
        yield from _mountings(s)
    for factor in (2.0, 0.5, 10.0, 0.1):
        yield Cause("time-scale", (), partial(time_scale, factor=factor), number=factor)


def _exchanges(s: LogStates, j: int, k: int) -> Iterator[Cause]:
    """Exchanged columns of two joints: positions, torques, and both."""
    order = np.arange(len(s.gain))
    order[[j, k]] = k, j
    yield Cause("exchanged-positions", (j, k), partial(exchanged_positions, j=j, k=k))
    yield Cause("exchanged-torques", (j, k), partial(exchanged_torques, order=order))
    yield Cause("exchanged-joints", (j, k), partial(exchanged_joints, j=j, k=k, order=order))


def _mountings(s: LogStates) -> Iterator[Cause]:
    """Mountings on four walls and on the ceiling, and a robot without gravity."""
    size = float(np.linalg.norm(s.gravity))
    down = s.gravity / np.linalg.norm(s.gravity)
    level = np.linalg.svd(down[None])[2][1:]
    for direction in (*level, *-level, -down, 0.0 * down):
        yield Cause("mounting", (), partial(LogStates.with_fields, gravity=size * direction))


def continuous_causes(s: LogStates, *, wide: bool) -> Iterator[Cause]:
    """Gain, scale and zero of each joint, tilt of the base, delay and low-pass; with distant starts if ``wide``."""
    gains: tuple[float, ...] = (0.0,)
    delays: tuple[float, ...] = (0.0,)
    if wide:
        gains, delays = _GAINS, _DELAYS
    for k, is_turning in enumerate(turning_joints(s.base.unknown.model)):
        yield Cause("gain", (k,), lambda s, beta, k=k: gain(s, k, _factor(beta)), 1e-3, 1, gains)
        yield Cause("position-scale", (k,), lambda s, beta, k=k: positions_times(s, k, 1.0 / _factor(beta)), 1e-3)
        if is_turning:
            yield Cause("zero", (k,), lambda s, beta, k=k: zero(s, k, float(beta[0])), 1e-3)
    if s.gravity.any():
        yield Cause("tilt", (), tilt, 1e-3, 2)
    yield Cause("late", (), _later, 1e-3, 1, delays)
    if wide:
        yield Cause("low-pass", (), _with_lag, 1e-3, 1, _LAGS, cost=1.0)


def _with_lag(s: LogStates, beta: Array) -> LogStates:
    return s.with_fields(lag=max(float(beta[0]), 1e-6))


def _factor(beta: Array) -> float:
    return float(np.exp(np.clip(beta[0], -8.0, 8.0)))


def _later(s: LogStates, beta: Array) -> LogStates:
    return s.with_fields(shift=s.shift + float(beta[0]))


_GAINS = (0.0, -3.0, 3.0)
_DELAYS = (0.0, -0.2, -0.12, -0.07, -0.03, 0.03, 0.07, 0.12, 0.2, 0.3)
_LAGS = (0.02, 0.05, 0.1, 0.2)
STRIBECK_SPEEDS = (0.03, 0.1, 0.3)


def laws(s: LogStates) -> Iterator[Law]:
    """Laws of each joint, and of all joints with one coefficient."""
    count = len(s.gain)
    static = [(partial(_stribeck, speed=speed), speed) for speed in STRIBECK_SPEEDS]
    for joints in _joint_sets(count):
        yield Law("load-friction", joints, _load_friction)
        yield Law("warming", joints, _warming)
        for values, speed in static:
            yield Law("stribeck", joints, values, speed)
    for k in range(count):
        yield Law("late-joint", (k,), _delay_column)
        yield Law("drift", (k,), _drift)
        yield Law("spring", (k,), _spring)


def changes(s: LogStates) -> Iterator[Law]:
    """Laws that may begin within the log: gain and offset of a joint, a changed delay of all torques, a load on the tip."""
    all_joints = tuple(range(len(s.gain)))
    for k in all_joints:
        yield Law("gain-change", (k,), _whole)
        yield Law("offset-step", (k,), _offset)
    yield Law("late-change", all_joints, _delay_column)
    if _has_moving_tip(s):
        yield Law("load-change", all_joints, _load)


def laws_of_the_log(s: LogStates) -> Iterator[Law]:
    """Constant force on the tip in the world, as of a hose, and gains that change steadily, of each joint and of all."""
    count = len(s.gain)
    for joints in _joint_sets(count):
        yield Law("gain-drift", joints, _gain_drift)
    if _has_moving_tip(s):
        yield Law("force", tuple(range(count)), _force)


def _has_moving_tip(s: LogStates) -> bool:
    """True if the robot has a tip that moves."""
    model = s.base.unknown.model
    return model.tip is not None and model.frames[model.tip].body != BASE


def _force(s: LogStates, _fitted: FittedTorques) -> Array:
    """Columns -J' e of forces along the world's axes, against which motors work; those that move no joint are left out."""
    J = np.asarray(s.base.unknown.robot.jacobian(s.q, kind="world_aligned"))[:, 3:]
    e = -J.swapaxes(1, 2)
    return np.asarray(
        e[..., np.linalg.norm(e, axis=(0, 1)) > _MIN_INDEPENDENT_SHARE * max(float(np.linalg.norm(e)), 1e-300)]
    )


def _load(s: LogStates, _fitted: FittedTorques) -> Array:
    """Columns of a mass m on the tip and of its first moments m c; dependent columns are left out and m c c' is neglected."""
    model = s.base.unknown.model
    frame = model.frames[str(model.tip)]
    columns = slice(10 * frame.body, 10 * frame.body + 10)
    portions = list[Array]()
    for k in range(0, len(s.time), PORTION):
        p = slice(k, k + PORTION)
        portions.append(s.base.unknown.regressor(s.q[p], s.dq[p], s.ddq[p], s.gravity)[:, :, columns])
    e = np.concatenate(portions) @ _unit_loads(frame.pose)
    size = np.maximum(np.linalg.norm(e, axis=(0, 1)), 1e-300)
    R = np.linalg.qr((e / size).reshape(-1, 4))[1]
    independent = np.abs(R.diagonal()) > _MIN_INDEPENDENT_SHARE
    return np.asarray(e[..., independent])


def _unit_loads(pose: Array) -> Array:
    """(10, 4) parameters of the carrying body by a mass at a pose and by its first moments, by central differences."""

    def parameters(com: Array) -> Array:
        return SpatialInertia.from_com(1.0, com, np.zeros((3, 3))).in_frame(pose).parameters

    steps = _COM_STEP * np.eye(3)
    moments = [0.5 * (parameters(step) - parameters(-step)) / _COM_STEP for step in steps]
    return np.stack([parameters(np.zeros(3)), *moments], axis=1)


_COM_STEP, _MIN_INDEPENDENT_SHARE = 1e-3, 1e-6
"""Step of finite differences [m]; share of a column not spanned by others below which the column is dependent."""


def _offset(_s: LogStates, fitted: FittedTorques) -> Array:
    return np.ones_like(fitted.whole)


def _gain_drift(s: LogStates, fitted: FittedTorques) -> Array:
    return _elapsed_share(s)[:, None] * fitted.whole


def _spring(s: LogStates, _fitted: FittedTorques) -> Array:
    return s.q[:, : len(s.gain)] - s.q[:, : len(s.gain)].mean(axis=0)


def _whole(_s: LogStates, fitted: FittedTorques) -> Array:
    return fitted.whole


def _load_friction(s: LogStates, fitted: FittedTorques) -> Array:
    return np.abs(fitted.rigid) * _dry(s)


def _delay_column(s: LogStates, fitted: FittedTorques) -> Array:
    return -s.slope(fitted.whole)


def _warming(s: LogStates, fitted: FittedTorques) -> Array:
    return _elapsed_share(s)[:, None] * _dry(s) * fitted.coulomb


def _drift(s: LogStates, fitted: FittedTorques) -> Array:
    return _elapsed_share(s)[:, None] * np.ones(fitted.whole.shape[1])


def _stribeck(s: LogStates, fitted: FittedTorques, *, speed: float) -> Array:
    return np.asarray(_dry(s) * np.exp(-((s.dq / speed) ** 2)) * fitted.coulomb)


def _dry(s: LogStates) -> Array:
    return np.asarray(np.tanh(s.dq / s.friction_speed))


def _elapsed_share(s: LogStates) -> Array:
    """Elapsed share of the duration of the logs; 0.5 for states without time."""
    length = np.ptp(s.time)
    return (s.time - s.time.min()) / length if length else np.full(len(s.time), 0.5)


_MIN_RUN, _MAX_GAP = 0.3, 0.2
"""Minimum length of a run of rows, and maximum gap in a run [s]."""


def runs(time: Array, piece: Array, high: Array) -> list[tuple[int, int]]:
    """Runs of high rows within one piece, of at least 0.3 s; short gaps are bridged."""
    rows = np.flatnonzero(high)
    if not rows.size:
        return []
    ends = np.flatnonzero((np.diff(time[rows]) > _MAX_GAP) | (np.diff(piece[rows]) != 0))
    first, last = rows[np.append(0, ends + 1)], rows[np.append(ends, len(rows) - 1)]
    is_long = time[last] - time[first] >= _MIN_RUN
    return list(zip(first[is_long].tolist(), (last[is_long] + 1).tolist(), strict=True))


def value_with_interval(kind: str, value: Array, half: Array) -> tuple[float, tuple[float, float]]:
    """β (k,) and its interval of half-widths (k,), in the unit of the table; the magnitude if β is a vector."""
    size, direction = float(value[0]), np.eye(len(value))[0]
    if len(value) > 1:
        size = float(np.linalg.norm(value))
        if size:
            direction = value / size
    half_width = float(np.sqrt(((direction * half) ** 2).sum()))
    in_unit = _TO_UNITS.get(kind, float)
    low, high = sorted([float(in_unit(size - half_width)), float(in_unit(size + half_width))])
    return float(in_unit(size)), (low, high)


_TO_UNITS: Mapping[str, Callable[[float], float]] = {
    **dict.fromkeys(("zero", "tilt", "elasticity", "zero-change"), np.degrees),
    "backlash": lambda half: 2.0 * np.degrees(half),
    **dict.fromkeys(("late", "late-change", "late-joint"), lambda seconds: 1e3 * seconds),
    "gain-change": lambda share: 1.0 + share,
    "low-pass": lambda seconds: 1.0 / (2.0 * np.pi * max(seconds, 1e-9)),
    **dict.fromkeys(("load-friction", "stribeck", "warming", "gain-drift"), lambda share: 100.0 * share),
    **dict.fromkeys(("gain", "position-scale"), lambda x: float(np.exp(np.clip(x, -30.0, 30.0)))),
}
