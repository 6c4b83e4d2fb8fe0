"""Rows of equations τ = W x from logs: zero-phase filtered states and torques, filtered regressor columns, decimation.

The low-pass is a Butterworth filter, applied forward and backward (zero phase); derivatives are central differences.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from ..core.doubts import doubt
from ..core.errors import TrajectoryError
from ..core.estimation.filters import REACH, UniformSpline, low_pass, low_pass_at
from ..core.estimation.sampling import GAP, pauses
from ..core.numbers import number
from ..core.typing import Array
from ..motion.log_table import slices
from .base_columns import BaseColumns
from .parameters import BaseParameters, speed_owner

STATE_RATE, ROW_RATE = 20.0, 2.5
"""Samples per period of the cut-off, of computed states and of rows of equations."""
MAX_CLOCK_DEVIATION = 1e-3
"""Largest deviation of time stamps from a steady clock, as a share of the step, without resampling."""
PAUSE = 0.05
"""Minimum pause [s]: a log is split at steps that exceed it and five usual steps; gaps are never filled."""
_CUT_BORDER = 2  # periods of the cut-off at a pause, in which filters have not settled
_MIN_PIECE_SHARE = 0.1  # minimum length of a piece, as a share of the longest piece
MIN_SAMPLES = 60
"""Minimum number of samples for an identification."""
_ROWS_OF_USUAL_STEP = 1 << 20
"""Number of first rows whose steps of time are the usual ones."""


@dataclass(frozen=True, eq=False)
class SteadySamples:
    """One log on a steady clock."""

    start: float  # time of the first sample [s]
    rate: float  # samples per second [Hz]
    q: Array  # (n, nv), positions of the joints
    tau: Array  # (n, nv), torques of the joints
    moved: float = 0.0  # share of time stamps that deviate from the steady clock by over a tenth of a step
    cut: bool = False  # True for one of several pieces of a log with pauses
    log: int = 0  # number of its log, from 1; 0 if there is only one log

    @classmethod
    def pieces(cls, time: Array, q: Array, tau: Array, where: str) -> list[SteadySamples]:
        """Split a log at its pauses and resample each piece on its own steady clock; pieces that are too short are left out."""
        edges = [0, *(pauses(time, PAUSE) + 1).tolist(), len(time)]
        is_cut = len(edges) > 2
        rows = [slice(a, b) for a, b in pairwise(edges) if b - a >= MIN_SAMPLES] or [slice(None)]
        pieces = [replace(cls.from_arrays(time[s], q[s], tau[s], where), cut=is_cut) for s in rows]
        longest = max(piece.seconds for piece in pieces)
        return [piece for piece in pieces if piece.seconds >= _MIN_PIECE_SHARE * longest]

    @classmethod
    def from_arrays(cls, time: Array, q: Array, tau: Array, where: str) -> SteadySamples:
        """Resample at a steady rate: positions by a cubic spline, torques linearly between their time stamps."""
        if len(time) < MIN_SAMPLES:
            raise TrajectoryError(
                f"{where}: {len(time)} rows are too few to identify a robot from. Give {MIN_SAMPLES} at least."
            )
        steps = np.diff(time)
        mean = float((time[-1] - time[0]) / (len(time) - 1))
        step = float(steps[steps <= GAP * mean].mean())  # step of the clock itself, without gaps
        count = round((time[-1] - time[0]) / step) + 1
        steady = time[0] + step * np.arange(count)
        if len(time) == count and np.abs(time - steady).max() <= MAX_CLOCK_DEVIATION * step:
            return cls(float(time[0]), 1.0 / step, q, tau)
        moved = float(np.mean(np.abs(steps - step) > 0.1 * step))
        return cls(float(time[0]), 1.0 / step, *_resample(time, q, tau, steady), moved)

    def __len__(self) -> int:
        return len(self.q)

    @property
    def seconds(self) -> float:
        """Duration [s]."""
        return (len(self) - 1) / self.rate


def total_seconds(samples: Sequence[SteadySamples]) -> float:
    """Duration of several logs together [s]."""
    return sum(log.seconds for log in samples)


def lowest_rate(samples: Sequence[SteadySamples]) -> float:
    """Lowest sampling rate of several logs [Hz]."""
    return min(log.rate for log in samples)


def interpolate(at: Array, time: Array, x: Array) -> Array:
    """(k, n) values at times (k,) of columns x (m, n), straight between times (m,)."""
    return np.stack([np.interp(at, time, column) for column in x.T], axis=1)


def pause_lengths(time: Array) -> Array:
    """Lengths (k,) [s] of the pauses of time stamps (n,), at which logs are split.

    >>> pause_lengths(np.array([0.0, 0.5, 1.0, 5.0, 5.5])).tolist()
    [4.0]
    """
    longest_step, pauses = PAUSE, list[Array]()
    first_steps = np.diff(time[:_ROWS_OF_USUAL_STEP])
    if len(first_steps):
        longest_step = max(PAUSE, GAP * float(np.median(first_steps)))
    for s in slices(len(time)):
        steps = np.diff(time[s.start : s.stop + 1])
        pauses.append(steps[steps > longest_step])
    return np.concatenate(pauses)


def gap_notes(lengths: Array) -> tuple[str, ...]:
    """Sentence on pauses of these lengths (k,) [s], at which logs are split; empty without pauses."""
    if not len(lengths):
        return ()
    count = "1 gap" if len(lengths) == 1 else f"{len(lengths)} gaps"
    return (doubt("gap", count=count, seconds=number(float(np.sum(lengths)), 3)).sentence,)


def _resample(time: Array, q: Array, tau: Array, at: Array) -> tuple[Array, Array]:
    """Interpolate positions by a cubic spline and torques linearly, at times clamped to the range of the log."""
    from scipy.interpolate import CubicSpline

    local = time - time[0]
    at = np.clip(at - time[0], 0.0, local[-1])
    return CubicSpline(local, q)(at), interpolate(at, local, tau)


@dataclass(frozen=True, eq=False)
class Filtered:
    """States of one log below a cut-off, with the torques."""

    time: Array  # (m,) [s]
    rate: float  # [Hz]
    q: Array  # (m, nv)
    dq: Array  # (m, nv)
    ddq: Array  # (m, nv)
    tau: Array  # (m, nv), low-passed like q


def states_below(samples: SteadySamples, cutoff: float, rate: float | None = None) -> Filtered:
    """States below a cut-off [Hz], at 20 samples per period of the cut-off, or at about ``rate`` samples per second."""
    every = max(1, math.floor(samples.rate / (rate or STATE_RATE * cutoff)))
    step = 1.0 / samples.rate
    time = samples.start + step * np.arange(len(samples))
    rows, states = slice(None, None, every), np.empty((4, len(time[::every]), samples.q.shape[1]))
    for j in range(samples.q.shape[1]):  # one joint at a time, to limit memory
        x = low_pass(samples.q[:, j], cutoff, samples.rate)
        dx = np.gradient(x, step)
        tau = low_pass(samples.tau[:, j], cutoff, samples.rate)
        states[:, :, j] = x[rows], dx[rows], np.gradient(dx, step)[rows], tau[rows]
    return Filtered(time[rows], samples.rate / every, *states)


def torques_below(samples: SteadySamples, cutoff: float) -> tuple[Array, Array]:
    """Times (m,) and torques (m, nv) of the states below a cut-off [Hz]."""
    rows = slice(None, None, max(1, math.floor(samples.rate / (STATE_RATE * cutoff))))
    time = samples.start + np.arange(len(samples)) / samples.rate
    return time[rows], np.stack([low_pass(x, cutoff, samples.rate)[rows] for x in samples.tau.T], axis=1)


def kept_rows(states: Filtered, cutoff: float, most: float, *, cut: bool = False) -> slice:
    """States that become rows: 2.5 per period of the cut-off, at most ``most``, without the settling time of the filters."""
    every = max(1, math.floor(states.rate / (ROW_RATE * cutoff)), math.ceil(len(states.time) / most))
    border = border_of(states.rate, cutoff, len(states.time), cut=cut)
    return slice(border, max(border, len(states.time) - border), every)


def states_with_rows(
    samples: Sequence[SteadySamples], cutoff: float, most: float, *, whole: bool = False
) -> Iterator[tuple[SteadySamples, Filtered, slice]]:
    """States of each log below a cut-off (all samples if ``whole``), and its rows, at most ``most`` of all logs."""
    total = total_seconds(samples)
    for log in samples:
        s = states_below(log, cutoff, log.rate if whole else None)
        yield log, s, kept_rows(s, cutoff, max(1.0, most * log.seconds / total), cut=log.cut)


def border_of(rate: float, cutoff: float, count: int, *, cut: bool) -> int:
    """Number of states at either end to leave out, of ``count``; more if the piece is ``cut`` from a log with pauses."""
    border = math.ceil(rate / cutoff)
    return _CUT_BORDER * border if cut else min(border, count // 10)


def cutoffs(samples: Sequence[SteadySamples], rows: float) -> tuple[float, ...]:
    """Candidate cut-offs [Hz] with at least ``rows`` rows, at most 1/3 decade apart, up to a tenth of the rate."""
    shortest_log, longest_piece = math.inf, 0.0
    for s in samples:
        if s.cut:
            longest_piece = max(longest_piece, s.seconds)
        else:
            shortest_log = min(shortest_log, s.seconds)
    duration = shortest_log
    if longest_piece:
        duration = min(shortest_log, 0.5 * longest_piece)  # shorter pieces then have no rows
    lowest = max(4.0 / duration, rows / (ROW_RATE * total_seconds(samples)))
    highest = 0.1 * lowest_rate(samples)
    steps = [base * 10.0**power for power in range(-1, 3) for base in (1.0, 2.0, 3.0, 5.0, 7.0)]
    return tuple(f for f in steps if lowest <= f <= highest) or (highest,)


# An equation stays valid if both sides are filtered alike, for any columns (Gautier's parallel decimation, "Dynamic
# identification of robots with power model", ICRA 1997).

_PORTION = 8192  # states per batch, so that columns fit in the processor's cache
MOST_ROWS = 10_000
"""Maximum number of rows of all logs together: 46 MB for seven joints."""
_JUDGED_ROWS = 2500  # number of states of all logs on which predictions of different cut-offs are compared


@dataclass(eq=False)
class _LogRows:
    """States of one log, including states between rows, which other friction speeds or clock offsets need."""

    time: Array
    rate: float
    rows: slice
    position: Array
    """Positions of the rows."""
    dq: Array
    acceleration: Array
    """Accelerations of the rows."""
    _tau: Array
    """Torques, low-passed twice; empty once the spline exists."""

    @cached_property
    def spline(self) -> UniformSpline:
        """Spline of the torques."""
        found, self._tau = UniformSpline.from_samples(self.time, self._tau), self._tau[:0]
        return found

    def torques(self, shift: float) -> Array:
        """(m, nv) torques at the rows, from ``shift`` seconds later."""
        return np.asarray(self.spline(np.clip(self.time[self.rows] + shift, self.time[0], self.time[-1])))


@dataclass(eq=False)
class FilteredRows:
    """Rows of several logs at one cut-off."""

    base: BaseParameters
    cutoff: float  # [Hz]
    W: Array  # (m, nv, r)
    time: Array  # (m,), time of each row in its own log [s]
    log: Array  # (m,), index of the log of each row
    known: Array
    logs: list[_LogRows]
    dead: Array | None = None
    _coulomb: dict[tuple[int, float], Array] = field(default_factory=dict)

    @classmethod
    def from_samples(
        cls,
        base: BaseParameters,
        samples: Sequence[SteadySamples],
        cutoff: float,
        friction_speed: Array,
        most: float = MOST_ROWS,
    ) -> FilteredRows:
        """Rows of logs below a cut-off."""
        W, known, times, logs = list[Array](), list[Array](), list[Array](), list[Array]()
        parts = list[_LogRows]()
        for k, (_, s, rows) in enumerate(states_with_rows(samples, cutoff, most)):
            columns, springs = _columns(base, s, rows, cutoff, friction_speed)
            W.append(columns)
            known.append(springs)
            times.append(s.time[rows])
            logs.append(np.full(len(columns), k))
            tau = low_pass(s.tau, cutoff, s.rate)
            parts.append(_LogRows(s.time, s.rate, rows, s.q[rows].copy(), s.dq.copy(), s.ddq[rows].copy(), tau))
        whole = _concatenate_and_empty(W)
        return cls(base, cutoff, whole, np.concatenate(times), np.concatenate(logs), np.concatenate(known), parts)

    def torques(self, shift: float) -> Array:
        """(m, nv) torques, ``shift`` seconds later in the log than the rows' positions, without the torques of springs."""
        found = [log.torques(shift) for log in self.logs]
        tau = np.asarray(np.concatenate(found) - self.known)
        if self.dead is not None:
            tau[:, self.dead] = 0.0
        return tau

    def coulomb(self, column: int, joints: Array, friction_speed: Array) -> Array:
        """(m, nv) column of Coulomb friction for other friction speeds."""
        key = (column, float(friction_speed[speed_owner(joints)]))
        if key not in self._coulomb:
            self._coulomb[key] = self._coulomb_column(column, joints, friction_speed)
        return self._coulomb[key]

    def _coulomb_column(self, column: int, joints: Array, friction_speed: Array) -> Array:
        k, unknown = int(self.base.kept[column]), self.base.unknown
        parts = list[Array]()
        for log in self.logs:
            factor = unknown.drives([k], log.dq, log.dq, friction_speed)  # independent of the acceleration
            part = np.zeros((len(log.acceleration), len(joints)))
            part[:, joints] = low_pass(factor, self.cutoff, log.rate)[log.rows] * unknown.shares[k, joints]
            parts.append(part)
        whole = np.concatenate(parts)
        if self.dead is not None:
            whole[:, self.dead] = 0.0
        return whole

    @property
    def position(self) -> Array:
        """(m, nq) positions of the joints in the rows."""
        return np.concatenate([log.position for log in self.logs])

    @property
    def speed(self) -> Array:
        """(m, nv) velocities of the joints in the rows."""
        return np.concatenate([log.dq[log.rows] for log in self.logs])

    @property
    def acceleration(self) -> Array:
        """(m, nv) accelerations of the joints in the rows."""
        return np.concatenate([log.acceleration for log in self.logs])


def _concatenate_and_empty(parts: list[Array]) -> Array:
    """Concatenate arrays and empty the list, releasing each part at once to limit memory."""
    if len(parts) == 1:
        return parts.pop()
    whole, at = np.empty((sum(map(len, parts)), *parts[0].shape[1:])), 0
    while parts:
        part = parts.pop(0)
        whole[at : at + len(part)] = part
        at += len(part)
    return whole


def filtered_portions(
    columns: BaseColumns,
    s: Filtered,
    wanted: Array,
    cutoff: float,
    friction_speed: Array,
) -> Iterator[tuple[Array, Array, Array | float]]:
    """Low-passed entries (k, f) and torques of springs (k, nv) at the ``wanted`` states (m,), in batches.

    Yields each batch with its indices (k,) among the wanted states.
    """
    margin, base = int(REACH * s.rate / cutoff) + 1, columns.base
    for begin in range(0, len(s.time), _PORTION):
        here = np.flatnonzero((wanted >= begin) & (wanted < begin + _PORTION))
        if not here.size:
            continue
        span = slice(max(0, begin - margin), min(len(s.time), begin + _PORTION + margin))
        states, at = (s.q[span], s.dq[span], s.ddq[span]), wanted[here] - span.start
        entries = low_pass_at(columns.rows(*states, friction_speed), cutoff, s.rate, at)
        springs: Array | float = 0.0
        if base.unknown.model.springs:
            springs = low_pass_at(spring_torques(base, *states), cutoff, s.rate, at)
        yield here, entries, springs


def _columns(
    base: BaseParameters, s: Filtered, rows: slice, cutoff: float, friction_speed: Array
) -> tuple[Array, Array]:
    """Low-passed kept columns (m, nv, r) and torques of springs (m, nv) at the rows."""
    wanted, columns = np.arange(len(s.time))[rows], BaseColumns.from_parameters(base)
    W = np.zeros((len(wanted), s.dq.shape[1], base.count))
    known = np.zeros(W.shape[:2])
    for here, entries, springs in filtered_portions(columns, s, wanted, cutoff, friction_speed):
        known[here] = springs
        for j, (groups, place) in enumerate(zip(columns.groups, columns.slices, strict=True)):
            W[np.ix_(here, np.array([j]), groups)] = entries[:, None, place]
    return W, known


def spring_torques(base: BaseParameters, q: Array, dq: Array, ddq: Array) -> Array:
    """(n, nv) torques of springs at given states."""
    robot = base.unknown.robot
    if not base.unknown.model.springs:
        return np.zeros(dq.shape)
    return np.asarray(robot.inverse_dynamics(q, dq, ddq)) - robot.regressor(q, dq, ddq) @ robot.parameters


@dataclass(eq=False)
class JudgedStates:
    """States on which predictions of different cut-offs are compared, with almost unfiltered torques."""

    W: Array
    """(m, nv, r) columns from positions below the tested cut-off."""
    known: Array
    log: Array
    time: Array
    states: list[Filtered]

    @classmethod
    def from_samples(
        cls, base: BaseParameters, samples: Sequence[SteadySamples], cutoff: float, friction_speed: Array
    ) -> JudgedStates:
        """States at the same times for every cut-off."""
        rate = _JUDGED_ROWS / total_seconds(samples)
        states = [states_below(s, cutoff, rate) for s in samples]
        W, known, logs, times = list[Array](), list[Array](), list[Array](), list[Array]()
        for k, s in enumerate(states):
            times.append(s.time)
            W.append(base.unknown.columns(base.kept, s.q, s.dq, s.ddq, friction_speed))
            known.append(spring_torques(base, s.q, s.dq, s.ddq))
            logs.append(np.full(len(s.time), k))
        return cls(np.concatenate(W), np.concatenate(known), np.concatenate(logs), np.concatenate(times), states)
