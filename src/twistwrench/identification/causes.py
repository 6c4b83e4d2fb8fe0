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
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from ..core.estimation.filters import UniformSpline, lagged, low_pass
from ..core.typing import Array
from ..mechanics.bodies.inertia import SpatialInertia
from ..mechanics.lie import so3
from ..mechanics.model.model import BASE
from .parameters import BaseParameters
from .rows import SteadySamples, of_springs, states_with_rows

_PORTION = 2048
SIGNED, _SIDE = 0.2, 0.1
"""Part of a torque (rms) below zero from which it has a sign, and minimum share of rows on either side of zero."""
_MADE_OF = {
    "bodies": ("q", "dq", "ddq", "gravity", "weightless", "rows"),
    "drives": ("dq", "ddq", "pieces", "friction_speed", "rows", "lagging"),
    "columns": ("q", "dq", "ddq", "gravity", "weightless", "rows", "pieces", "friction_speed", "lag"),
}
"""Fields on which the columns depend."""


@dataclass(frozen=True, eq=False)
class LogStates:
    """States of logs below a cut-off, at 20 samples per period of the cut-off, and the rows of equations among them.

    Attributes
    ----------
    base : BaseParameters, independent of the direction of gravity
    cutoff : float [Hz]
    pieces : list of slice, states of each piece of a log without pauses
    rows : (m,) array, indices of the states that become rows
    time, piece : (n,) arrays, time [s] and index of the piece
    rate : float, states per second [Hz]
    q, dq, ddq, tau : (n, nv) arrays
    friction_speed : (nv,) array, v_0
    gravity : (3,) array
    gain : (nv,) array
    logs : sequence of int, number of the log of each piece, from 1; 0 if there is only one log
    lag : float, time constant of the low-pass of the torques [s]
    weightless : tuple of int, joints whose logged torques exclude gravity
    unfiltered : (n, nv) array, positions before the low-pass
    jumps : sequence of (joint, piece, time), jumps of positions
    """

    base: BaseParameters
    cutoff: float
    pieces: Sequence[slice]
    rows: Array
    time: Array
    piece: Array
    rate: Array
    q: Array
    dq: Array
    ddq: Array
    tau: Array
    friction_speed: Array
    gravity: Array
    gain: Array
    logs: Sequence[int]
    lag: float = 0.0
    shift: float = 0.0
    weightless: tuple[int, ...] = ()
    unfiltered: Array | None = None
    jumps: Sequence[tuple[int, int, float]] = ()

    @classmethod
    def from_samples(
        cls,
        base: BaseParameters,
        samples: Sequence[SteadySamples],
        cutoff: float,
        friction_speed: Array,
        most: float,
        *,
        whole: bool = False,
    ) -> LogStates:
        """Resample samples on steady clocks to at most ``most`` rows; if ``whole``, keep all samples with q and τ unchanged."""
        found, rows, pieces, unfiltered, at = list[Any](), list[Array](), list[slice](), list[Array](), 0
        jumps = list[tuple[int, int, float]]()
        for one, s, kept in states_with_rows(samples, cutoff, most, whole=whole):
            found.append(replace(s, q=one.q, tau=one.tau) if whole else s)
            rows.append(at + np.arange(len(s.time))[kept])
            pieces.append(slice(at, at + len(s.time)))
            found_jumps = ((k, jump_of(q)) for k, q in enumerate(one.q.T))
            jumps += [(k, len(pieces) - 1, one.start + (i - 0.5) / one.rate) for k, i in found_jumps if i is not None]
            own = one.start + np.arange(len(one.q)) / one.rate
            unfiltered.append(np.stack([np.interp(s.time, own, q) for q in one.q.T], axis=1))
            at += len(s.time)
        nv, counts = base.unknown.model.nv, [len(s.time) for s in found]
        return cls(
            base,
            cutoff,
            pieces,
            np.concatenate(rows),
            np.concatenate([s.time for s in found]),
            np.repeat(np.arange(len(found)), counts),
            np.repeat([s.rate for s in found], counts),
            np.concatenate([s.q for s in found]),
            np.concatenate([s.dq for s in found]),
            np.concatenate([s.ddq for s in found]),
            np.concatenate([s.tau for s in found]),
            friction_speed,
            np.asarray(base.unknown.model.gravity, float),
            np.ones(nv),
            [one.log for one in samples],
            unfiltered=np.concatenate(unfiltered),
            jumps=jumps,
        )

    def filtered(self, x: Array) -> Array:
        """Low-pass values (n, ...) of the states at the cut-off, piece by piece."""
        if not self.pieces:
            return x
        return np.concatenate([low_pass(x[s], self.cutoff, float(self.rate[s.start])) for s in self.pieces])

    def slope(self, x: Array) -> Array:
        """Time derivatives of values (n, ...) of the states."""
        if not self.pieces:
            return np.zeros_like(x)
        return np.concatenate([np.gradient(x[s], self.time[s], axis=0) for s in self.pieces])

    @cached_property
    def measured(self) -> Array:
        """(m, nv) measured torques at the rows, without the torques of springs."""
        known = of_springs(self.base, self.q[self.rows], self.dq[self.rows], self.ddq[self.rows])
        return np.asarray(self.in_time[self.rows] - known)

    @cached_property
    def in_time(self) -> Array:
        """(n, nv) measured torques, corrected for the time shift."""
        return np.concatenate([self._moved(s) for s in self.pieces]) if self.shift else self.tau

    def _moved(self, s: slice) -> Array:
        time = self.time[s]
        return UniformSpline.from_samples(time, self.tau[s])(np.clip(time + self.shift, time[0], time[-1]))

    @property
    def lagging(self) -> bool:
        """True if the torques passed a low-pass, which also depends on the states between the rows."""
        return self.lag > 0.0

    @cached_property
    def columns(self) -> Array:
        """(m, nv, r) columns of the groups at the rows, without gains, with friction low-passed like the torques."""
        if not self.lagging:
            return self._joined(self.bodies, self.drives)
        return self._lagged(lambda span: self._joined(self._of_bodies(span), self.drives[span]))

    def _joined(self, bodies: Array, drives: Array) -> Array:
        """Columns (n, nv, r) of the groups from columns of the body parameters and factors of the drives."""
        kept, unknown = self.base.kept, self.base.unknown
        W = np.take(bodies, np.maximum(unknown.of_bodies[kept], 0), axis=2)
        W[:, :, self.base.drives] = drives[:, None] * unknown.shares[kept[self.base.drives]].T
        return W

    def predicted(self, x: Array) -> Array:
        """(m, nv) torques W x at the rows."""
        if not self.lagging:
            bodies, drives = self._parts(x)
            return np.asarray(self.gain * (bodies + drives))
        mine, drives = self._values_of_bodies(x), self._torques_of_drives(x)
        return np.asarray(self.gain * self._lagged(lambda span: self._of_bodies(span) @ mine + drives[span]))

    def _parts(self, x: Array) -> tuple[Array, Array]:
        """Torques of the bodies and of the drives by groups x (r,)."""
        return self.bodies @ self._values_of_bodies(x), self._torques_of_drives(x)

    def _values_of_bodies(self, x: Array) -> Array:
        """Values of the body parameters, of those that represent groups x (r,)."""
        unknown = self.base.unknown
        mine, places = np.zeros(10 * len(unknown.model.bodies)), unknown.of_bodies[self.base.kept]
        mine[places[places >= 0]] = x[places >= 0]
        return mine

    def _torques_of_drives(self, x: Array) -> Array:
        drives = self.base.drives
        return np.asarray((self.drives * x[drives]) @ self.base.unknown.shares[self.base.kept[drives]])

    def _lagged(self, values: Callable[[slice], Array]) -> Array:
        """Low-pass of the torques, at the rows, of ``values`` of ranges of the states, in portions to limit memory."""
        found = list[Array]()
        for piece in self.pieces:
            steps, last = self.lag * float(self.rate[piece.start]), None
            for k in range(piece.start, piece.stop, _PORTION):
                span = slice(k, min(piece.stop, k + _PORTION))
                y = lagged(values(span), steps, last)
                here, last = self.rows[(self.rows >= k) & (self.rows < span.stop)], y[-1]
                found.append(y[here - k])
        return np.concatenate(found)

    @cached_property
    def bodies(self) -> Array:
        """Columns of the body parameters at the rows."""
        return self._of_bodies(self.rows)

    def _of_bodies(self, at: Array | slice) -> Array:
        """Columns (n, nv, p) of the body parameters at some states."""
        states = self.q[at], self.dq[at], self.ddq[at]
        Y = self.base.unknown.regressor(*states, self.gravity)
        if self.weightless:
            joints = list(self.weightless)
            Y[:, joints] = self.base.unknown.regressor(*states, 0.0 * self.gravity)[:, joints]
        return np.asarray(Y)

    @cached_property
    def drives(self) -> Array:
        """Factors of the columns of motor inertias, friction and offsets at the rows, or in all states for a low-pass."""
        unknown, at = self.base.unknown, slice(None) if self.lagging else self.rows
        which = self.base.kept[self.base.drives]
        found = unknown.drives(which, self.dq[at], self.ddq[at], self.friction_speed)
        dry = [c for c, k in enumerate(which.tolist()) if unknown.kinds[k] in ("coulomb", "stribeck")]
        if dry:
            found[:, dry] = self.filtered(unknown.drives(which[dry], self.dq, self.ddq, self.friction_speed))[at]
        return found

    def torques(self, x: Array) -> tuple[Array, Array]:
        """(n, nv) torques W x of all states, and the part of the bodies, computed in portions."""
        n, found = len(self.time), []
        for k in range(0, n, _PORTION):
            span = slice(k, min(n, k + _PORTION))
            arrays = {name: getattr(self, name)[span] for name in ("time", "piece", "rate", "q", "dq", "ddq", "tau")}
            part = self.changed(**arrays, rows=np.arange(span.stop - k), pieces=(), lag=0.0)
            bodies, drives = part._parts(x)
            found.append(self.gain * np.stack([bodies + drives, bodies]))
        whole, bodies = np.concatenate(found, axis=1)
        return whole, bodies

    def changed(self, **columns: Any) -> LogStates:
        """Copy with other values of some fields; columns that do not depend on them stay cached."""
        found = replace(self, **columns)
        for part, fields in _MADE_OF.items():
            if part in self.__dict__ and all(getattr(found, name) is getattr(self, name) for name in fields):
                found.__dict__[part] = self.__dict__[part]
        return found


# ── Corrections of states


def _one(values: Array, k: int, change: Callable[[Array], Array]) -> Array:
    found = values.copy()
    found[:, k] = change(values[:, k])
    return found


def gain(s: LogStates, k: int, g: float) -> LogStates:
    """Scale the torque of joint k by g."""
    return s.changed(gain=np.where(np.arange(len(s.gain)) == k, g * s.gain, s.gain))


def positions_times(s: LogStates, k: int, factor: float) -> LogStates:
    """Scale the position of joint k and its rates, and with them the width of its dry friction's step."""
    scaled = {name: _one(getattr(s, name), k, lambda x: factor * x) for name in ("q", "dq", "ddq")}
    width = np.where(np.arange(len(s.friction_speed)) == k, abs(factor) * s.friction_speed, s.friction_speed)
    return s.changed(**scaled, friction_speed=width)


def coupled(s: LogStates, k: int, j: int, sign: float) -> LogStates:
    """Add the position of joint j, times a sign, to that of joint k: encoders of coupled drives count both."""
    both = {name: getattr(s, name).copy() for name in ("q", "dq", "ddq")}
    for x in both.values():
        x[:, k] += sign * x[:, j]
    return s.changed(**both)


def unsigned(s: LogStates, k: int, x: Array) -> Cause | None:
    """Torque of joint k without its sign, which that of groups x (r,) gives it; None if that keeps its sign."""
    predicted = s.torques(x)[0][:, k]
    negative = float((predicted < -SIGNED * np.sqrt((predicted**2).mean())).mean())
    if not _SIDE < negative < 1.0 - _SIDE:
        return None
    return Cause("unsigned", (k,), partial(_with_signs, k=k, sign=np.sign(predicted)))


def _with_signs(s: LogStates, k: int, sign: Array) -> LogStates:
    return s.changed(tau=_one(s.tau, k, lambda x: sign * x)) if s.pieces else s


def zero(s: LogStates, k: int, beta: float) -> LogStates:
    """Subtract the zero error β from the position of joint k."""
    return s.changed(q=_one(s.q, k, lambda x: x - beta))


def exchanged_positions(s: LogStates, j: int, k: int) -> LogStates:
    """Exchange the positions of joints j and k."""
    order = np.arange(s.q.shape[1])
    order[[j, k]] = k, j
    return s.changed(q=s.q[:, order], dq=s.dq[:, order], ddq=s.ddq[:, order])


def exchanged_torques(s: LogStates, order: Array) -> LogStates:
    """Reorder the torques: joint j gets column ``order[j]``."""
    return s.changed(tau=s.tau[:, order])


def exchanged_joints(s: LogStates, j: int, k: int, order: Array) -> LogStates:
    """Exchange both positions and torques of joints j and k."""
    return exchanged_torques(exchanged_positions(s, j, k), order)


def tilt(s: LogStates, beta: Array) -> LogStates:
    """Turn the base by the vector β (2,) of a horizontal axis, so that gravity is exp([β]) g in its frame."""
    level = np.linalg.svd(s.gravity[None])[2][1:]  # two axes perpendicular to gravity
    return s.changed(gravity=so3.exp(level.T @ beta) @ s.gravity)


def time_scale(s: LogStates, factor: float) -> LogStates:
    """Scale the rates for a log whose times are ``factor`` times the true ones.

    The width of dry friction's step scales alike: another width would explain slow motions better without another time.
    """
    return s.changed(dq=s.dq * factor, ddq=s.ddq * factor**2, friction_speed=s.friction_speed * factor)


def behind(s: LogStates, beta: Array, turn: Array, rate: Array, acceleration: Array) -> LogStates:
    """Shift joint positions back by β times ``turn`` (n, nv), with its rates: links lag behind their motors."""
    if not s.pieces:
        return s
    return s.changed(q=s.q - beta * turn, dq=s.dq - beta * rate, ddq=s.ddq - beta * acceleration)


def compliances(s: LogStates, torque: Array, largest: Array | None = None) -> Iterator[Cause]:
    """Elasticity of each joint, and of all joints; β is the deflection at the ``largest`` (nv,) fitted torques (n, nv)."""
    every = tuple(range(torque.shape[1]))
    share = torque / np.maximum(np.abs(torque).max(axis=0) if largest is None else largest, 1e-300)
    rate = s.slope(share)
    rates = share, rate, s.slope(rate)
    for joints in (*((k,) for k in every), *([every] if len(every) > 1 else [])):
        turn, dturn, ddturn = (x * np.isin(every, joints) for x in rates)
        correct = partial(behind, turn=turn, rate=dturn, acceleration=ddturn)
        yield Cause("elasticity", joints, lambda s, beta, correct=correct: correct(s, beta), 1e-4)


_PLAY, _PULSES = 4e-3, 0.05
"""Half of a play where its value starts [rad, m]; share of squared accelerations from which its pulses give the start."""


def side_in_play(positions: Array, half: float) -> Array:
    """(n,) place of a link in the play of its gear, -1 to 1: the motor at ``positions`` (n,) moves it at the ends of the play.

    The link stays until the motor has crossed the play, q_link ← min(max(q_link, q - β), q + β), with β half of the play.
    """
    found, link = np.empty(len(positions)), float(positions[0])
    for k, q in enumerate(positions.tolist()):
        link = min(max(link, q - half), q + half)
        found[k] = q - link
    return found / half


def plays(s: LogStates) -> Iterator[Cause]:
    """Play of the gear of each joint; β is half of the play, by which the link lags behind its motor.

    Where the motor crosses the play, accelerations have pulses; β starts at their part in the accelerations if that is large.
    """
    if s.unfiltered is None:
        return
    for k in range(s.dq.shape[1]):
        pulse, ddq = _in_play(s, k, _PLAY)[2][:, k], s.ddq[:, k]
        size, inner = float(pulse @ pulse), float(pulse @ ddq)
        pulses = inner > 0.0 and inner**2 > _PULSES * size * float(ddq @ ddq)
        start = inner / size if pulses else _PLAY
        yield Cause("backlash", (k,), partial(_without_play, k=k), 0.1 * _PLAY, starts=(start,))


def _without_play(s: LogStates, beta: Array, k: int) -> LogStates:
    if not s.pieces:
        return s
    turn, rate, acceleration = _in_play(s, k, max(abs(float(beta[0])), 0.1 * _PLAY))
    return behind(s, beta, turn, rate, acceleration)


def _in_play(s: LogStates, k: int, half: float) -> tuple[Array, Array, Array]:
    """(n, nv) low-passed place of link k in a play, with its rates."""
    assert s.unfiltered is not None, "states of a log have positions"
    side = s.filtered(np.concatenate([side_in_play(s.unfiltered[p, k], half) for p in s.pieces]))
    rate = s.slope(side)
    mine = np.arange(s.dq.shape[1]) == k
    turn, dturn, ddturn = (x[:, None] * mine for x in (side, rate, s.slope(rate)))
    return turn, dturn, ddturn


_JUMP, _ALONE = 20.0, 3.0
"""Ratios of the largest departure of a step of positions from its neighbours to the usual one, and to the next largest one."""


def jump_of(positions: Array) -> int | None:
    """Index of the sample (n,) at which a position jumps, once and far beyond its other steps; None if it does not."""
    steps = np.diff(positions)
    if len(steps) < 2 * _BESIDE:
        return None
    off = np.abs(steps[1:-1] - 0.5 * (steps[:-2] + steps[2:]))
    k = int(off.argmax())
    others = np.delete(off, slice(max(0, k - _BESIDE), k + _BESIDE + 1))
    if off[k] < _JUMP * np.sqrt((others**2).mean()) or off[k] < _ALONE * others.max():
        return None
    return k + 2


_BESIDE = 5
"""Steps on both sides of a jump that are not compared with it."""


def jumps(s: LogStates) -> Iterator[Cause]:
    """Another zero of a joint from a jump of its position on, if it jumps."""
    every = np.arange(s.dq.shape[1])
    for k, piece, begin in s.jumps:
        reached = np.clip((s.time - begin) * s.rate + 0.5, 0.0, 1.0) * (s.piece == piece) + (s.piece > piece)
        step = s.filtered(reached)
        rate = s.slope(step)
        turn, dturn, ddturn = (x[:, None] * (every == k) for x in (step, rate, s.slope(rate)))
        correct = partial(behind, turn=turn, rate=dturn, acceleration=ddturn)
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
        values = values if values.ndim == 3 else values[..., None]
        return values * self.acting(s)[:, None, None]

    def acting(self, s: LogStates) -> Array:
        """(n,) bool: states in which the law acts."""
        if self.since is None:
            return np.ones(len(s.time), bool)
        piece, time = self.since
        return np.asarray((s.piece > piece) | ((s.piece == piece) & (s.time >= time)))


def discrete_causes(s: LogStates, suspects: Sequence[int]) -> Iterator[Cause]:
    """Signs, units and exchanges of columns, zeros by quarters of a turn, mountings and units of time."""
    turning = [bool(b.joint.turning[0]) for b in s.base.unknown.model.leaders]
    for k in suspects:
        yield Cause("torque-sign", (k,), partial(gain, k=k, g=-1.0))
        yield Cause("position-sign", (k,), partial(positions_times, k=k, factor=-1.0))
        yield Cause("both-signs", (k,), lambda s, k=k: gain(positions_times(s, k, -1.0), k, -1.0))
        if s.gravity.any():
            yield Cause("no-gravity", (k,), partial(LogStates.changed, weightless=(*s.weightless, k)))
        if turning[k]:
            yield Cause("degrees", (k,), partial(positions_times, k=k, factor=np.pi / 180))
            for turn in (0.5 * np.pi, -0.5 * np.pi, np.pi):
                yield Cause("zero-turn", (k,), partial(zero, k=k, beta=turn), number=float(np.degrees(turn)))
        if k and turning[k - 1] and turning[k]:  # wrists; each further test makes others less significant
            for sign in (-1.0, 1.0):
                yield Cause("coupled", (k, k - 1), partial(coupled, k=k, j=k - 1, sign=sign), number=sign)
    for j, k in combinations(suspects, 2):
        if turning[j] == turning[k]:
            yield Cause("exchanged-positions", (j, k), partial(exchanged_positions, j=j, k=k))
            order = np.arange(len(s.gain))
            order[[j, k]] = k, j
            yield Cause("exchanged-torques", (j, k), partial(exchanged_torques, order=order))
            yield Cause("exchanged-joints", (j, k), partial(exchanged_joints, j=j, k=k, order=order))
    if s.gravity.any():
        down = s.gravity / np.linalg.norm(s.gravity)
        level = np.linalg.svd(down[None])[2][1:]
        size = float(np.linalg.norm(s.gravity))
        for direction in (*level, *-level, -down, 0.0 * down):
            yield Cause("mounting", (), partial(LogStates.changed, gravity=size * direction))
    for factor in (2.0, 0.5, 10.0, 0.1):
        yield Cause("time-scale", (), partial(time_scale, factor=factor), number=factor)


def continuous_causes(s: LogStates, *, wide: bool) -> Iterator[Cause]:
    """Gain, scale and zero of each joint, tilt of the base, delay and low-pass; with distant starts if ``wide``."""
    turning = [bool(b.joint.turning[0]) for b in s.base.unknown.model.leaders]
    for k in range(len(s.gain)):
        yield Cause("gain", (k,), lambda s, beta, k=k: gain(s, k, _factor(beta)), 1e-3, 1, _GAINS if wide else (0.0,))
        yield Cause("position-scale", (k,), lambda s, beta, k=k: positions_times(s, k, 1.0 / _factor(beta)), 1e-3)
        if turning[k]:
            yield Cause("zero", (k,), lambda s, beta, k=k: zero(s, k, float(beta[0])), 1e-3)
    if s.gravity.any():
        yield Cause("tilt", (), tilt, 1e-3, 2)
    yield Cause("late", (), _later, 1e-3, 1, _DELAYS if wide else (0.0,))
    if not wide:
        return
    yield Cause("low-pass", (), lambda s, beta: s.changed(lag=max(float(beta[0]), 1e-6)), 1e-3, 1, _LAGS, cost=1.0)


def _factor(beta: Array) -> float:
    return float(np.exp(np.clip(beta[0], -8.0, 8.0)))


def _later(s: LogStates, beta: Array) -> LogStates:
    return s.changed(shift=s.shift + float(beta[0]))


_GAINS = (0.0, -3.0, 3.0)
_DELAYS = (0.0, -0.2, -0.12, -0.07, -0.03, 0.03, 0.07, 0.12, 0.2, 0.3)
_LAGS = (0.02, 0.05, 0.1, 0.2)
STRIBECK_SPEEDS = (0.03, 0.1, 0.3)


def laws(s: LogStates) -> Iterator[Law]:
    """Laws of each joint, and of all joints with one coefficient."""
    every = tuple(range(len(s.gain)))
    static = [(partial(_stribeck, speed=speed), speed) for speed in STRIBECK_SPEEDS]
    for joints in (*((k,) for k in every), *([every] if len(every) > 1 else [])):
        yield Law("load-friction", joints, _load_friction)
        yield Law("warming", joints, _warming)
        yield from (Law("stribeck", joints, *one) for one in static)
    for k in every:
        yield Law("late-joint", (k,), _delayed)
        yield Law("drift", (k,), _drift)
        yield Law("spring", (k,), _spring)


def changes(s: LogStates) -> Iterator[Law]:
    """Laws that may begin within the log: gain and offset of a joint, a changed delay of all torques, a load on the tip."""
    every = tuple(range(len(s.gain)))
    for k in every:
        yield Law("gain-change", (k,), _whole)
        yield Law("offset-step", (k,), _offset)
    yield Law("late-change", every, _delayed)
    model = s.base.unknown.model
    if model.tip is not None and model.frames[model.tip].body != BASE:
        yield Law("load-change", every, _load)


def laws_of_the_log(s: LogStates) -> Iterator[Law]:
    """Constant force on the tip in the world, as of a hose, and gains that change steadily, of each joint and of all."""
    every = tuple(range(len(s.gain)))
    for joints in (*((k,) for k in every), *([every] if len(every) > 1 else [])):
        yield Law("gain-drift", joints, _gain_drift)
    model = s.base.unknown.model
    if model.tip is not None and model.frames[model.tip].body != BASE:
        yield Law("force", every, _force)


def _force(s: LogStates, _fitted: FittedTorques) -> Array:
    """Columns -J' e of forces along the world's axes, against which motors work; those that move no joint are left out."""
    J = np.asarray(s.base.unknown.robot.jacobian(s.q, kind="world_aligned"))[:, 3:]
    e = -J.swapaxes(1, 2)
    return np.asarray(e[..., np.linalg.norm(e, axis=(0, 1)) > _DEPENDENT * max(float(np.linalg.norm(e)), 1e-300)])


def _load(s: LogStates, _fitted: FittedTorques) -> Array:
    """Columns of a mass m on the tip and of its first moments m c; dependent columns are left out and m c c' is neglected."""
    model = s.base.unknown.model
    frame = model.frames[str(model.tip)]
    near = [SpatialInertia.from_com(1.0, c, np.zeros((3, 3))).in_frame(frame.pose).parameters for c in _NEAR]
    point, *moved = np.array(near)
    mine = slice(10 * frame.body, 10 * frame.body + 10)
    portions = (slice(k, k + _PORTION) for k in range(0, len(s.time), _PORTION))
    Y = np.concatenate([s.base.unknown.regressor(s.q[p], s.dq[p], s.ddq[p], s.gravity)[:, :, mine] for p in portions])
    e = Y @ np.stack([point, *(0.5 * (a - b) / _OFF for a, b in zip(moved[::2], moved[1::2], strict=True))], axis=1)
    size = np.maximum(np.linalg.norm(e, axis=(0, 1)), 1e-300)
    R = np.linalg.qr((e / size).reshape(-1, 4))[1]
    told = np.abs(R.diagonal()) > _DEPENDENT
    return np.asarray(e[..., told])


_OFF, _DEPENDENT = 1e-3, 1e-6
"""Step of finite differences [m]; share of a column not spanned by others below which the column is dependent."""
_NEAR = np.concatenate([np.zeros((1, 3)), *(_OFF * way * np.eye(3)[[k]] for k in range(3) for way in (1, -1))])


def _offset(_s: LogStates, fitted: FittedTorques) -> Array:
    return np.ones_like(fitted.whole)


def _gain_drift(s: LogStates, fitted: FittedTorques) -> Array:
    return _through(s)[:, None] * fitted.whole


def _spring(s: LogStates, _fitted: FittedTorques) -> Array:
    return s.q[:, : len(s.gain)] - s.q[:, : len(s.gain)].mean(axis=0)


def _whole(_s: LogStates, fitted: FittedTorques) -> Array:
    return fitted.whole


def _load_friction(s: LogStates, fitted: FittedTorques) -> Array:
    return np.abs(fitted.rigid) * _dry(s)


def _delayed(s: LogStates, fitted: FittedTorques) -> Array:
    return -s.slope(fitted.whole)


def _warming(s: LogStates, fitted: FittedTorques) -> Array:
    return _through(s)[:, None] * _dry(s) * fitted.coulomb


def _drift(s: LogStates, fitted: FittedTorques) -> Array:
    return _through(s)[:, None] * np.ones(fitted.whole.shape[1])


def _stribeck(s: LogStates, fitted: FittedTorques, *, speed: float) -> Array:
    return np.asarray(_dry(s) * np.exp(-((s.dq / speed) ** 2)) * fitted.coulomb)


def _dry(s: LogStates) -> Array:
    return np.asarray(np.tanh(s.dq / s.friction_speed))


def _through(s: LogStates) -> Array:
    """Elapsed share of the duration of the logs; 0.5 for states without time."""
    length = np.ptp(s.time)
    return (s.time - s.time.min()) / length if length else np.full(len(s.time), 0.5)


_SHORTEST, _GAP = 0.3, 0.2
"""Minimum length of a run of rows, and maximum gap in a run [s]."""


def runs(time: Array, piece: Array, high: Array) -> list[tuple[int, int]]:
    """Runs of high rows within one piece, of at least 0.3 s; short gaps are bridged."""
    places = np.flatnonzero(high)
    if not places.size:
        return []
    ends = np.flatnonzero((np.diff(time[places]) > _GAP) | (np.diff(piece[places]) != 0))
    begins, stops = np.concatenate([[0], ends + 1]), np.concatenate([ends, [len(places) - 1]])
    runs = [(int(places[a]), int(places[b]) + 1) for a, b in zip(begins, stops, strict=True)]
    return [(a, b) for a, b in runs if time[b - 1] - time[a] >= _SHORTEST]


def in_units(kind: str, value: Array, half: Array) -> tuple[float, tuple[float, float]]:
    """β (k,) and its interval of half-widths (k,), in the unit of the table; the magnitude if β is a vector."""
    size = float(np.linalg.norm(value)) if len(value) > 1 else float(value[0])
    along = value / size if len(value) > 1 and size else np.eye(len(value))[0]
    wide = float(np.sqrt(((along * half) ** 2).sum()))
    to = _TO_UNITS.get(kind, float)
    low, high = sorted(float(to(size + way * wide)) for way in (-1.0, 1.0))
    return float(to(size)), (low, high)


_TO_UNITS: Mapping[str, Callable[[float], float]] = {
    **dict.fromkeys(("zero", "tilt", "elasticity", "zero-change"), np.degrees),
    "backlash": lambda half: 2.0 * np.degrees(half),
    **dict.fromkeys(("late", "late-change", "late-joint"), lambda seconds: 1e3 * seconds),
    "gain-change": lambda share: 1.0 + share,
    "low-pass": lambda seconds: 1.0 / (2.0 * np.pi * max(seconds, 1e-9)),
    **dict.fromkeys(("load-friction", "stribeck", "warming", "gain-drift"), lambda share: 100.0 * share),
    **dict.fromkeys(("gain", "position-scale"), lambda x: float(np.exp(np.clip(x, -30.0, 30.0)))),
}
