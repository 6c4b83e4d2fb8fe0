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

STATE_RATE = 20.0
"""Number of computed states per period of the cut-off."""
ROW_RATE = 2.5
"""Number of rows of equations per period of the cut-off."""
MAX_CLOCK_DEVIATION = 1e-3
"""Largest deviation of time stamps from a steady clock, as a share of the step, without resampling."""
PAUSE = 0.05
"""Minimum pause [s]: a log is split at steps that exceed it and five usual steps; gaps are never filled."""
_CUT_BORDER = 2  # periods of the cut-off at a pause, in which filters have not settled
_MIN_PIECE_SHARE = 0.1  # minimum length of a piece, as a share of the longest piece
_MAX_STEP_DEVIATION = 0.1  # of a step of time from the clock's step, as a share of it, above which the sample moved
_MIN_PERIODS = 4.0  # of a cut-off in the duration of a log
_MAX_CUTOFF_SHARE = 0.1  # largest cut-off, as a share of the sampling rate
_CUTOFF_DIGITS = (1.0, 2.0, 3.0, 5.0, 7.0)  # of cut-offs; neighbours are at most 1/3 decade apart
MIN_SAMPLES = 60
"""Minimum number of samples for an identification."""
_ROWS_OF_USUAL_STEP = 1 << 20
"""Number of first rows whose median step of time is the usual step of the log."""


@dataclass(frozen=True, eq=False)
class SteadySamples:
    """One log on a steady clock."""

    start: float
    """Time of the first sample [s]."""
    rate: float
    """Samples per second [Hz]."""
    q: Array
    """(n, nv), positions of the joints."""
    tau: Array
    """(n, nv), torques of the joints."""
    moved: float = 0.0
    """Share of steps of time that differ from the clock's step by over a tenth of it."""
    cut: bool = False
    """True for one of several pieces of a log with pauses."""
    log: int = 0
    """Number of the log, from 1; 0 if there is only one log."""

    @classmethod
    def pieces(cls, time: Array, q: Array, tau: Array, where: str) -> list[SteadySamples]:
        """Pieces of a log between its pauses, each resampled on its own steady clock; short pieces are left out."""
        first_rows = (pauses(time, PAUSE) + 1).tolist()  # after the pauses
        edges = [0, *first_rows, len(time)]
        rows_of_pieces = [slice(a, b) for a, b in pairwise(edges) if b - a >= MIN_SAMPLES]
        if not rows_of_pieces:  # the whole log, so that its error message counts all samples
            rows_of_pieces = [slice(None)]
        pieces = []
        for rows in rows_of_pieces:
            piece = cls.from_arrays(time[rows], q[rows], tau[rows], where)
            pieces.append(replace(piece, cut=bool(first_rows)))
        longest_seconds = max(piece.seconds for piece in pieces)
        return [piece for piece in pieces if piece.seconds >= _MIN_PIECE_SHARE * longest_seconds]

    @classmethod
    def from_arrays(cls, time: Array, q: Array, tau: Array, where: str) -> SteadySamples:
        """Samples on a steady clock, resampled if needed: positions by a cubic spline, torques linearly."""
        if len(time) < MIN_SAMPLES:
            raise TrajectoryError(
                f"{where}: {len(time)} rows are too few to identify a robot from. Give {MIN_SAMPLES} at least."
            )
        steps = np.diff(time)
        mean_step = float((time[-1] - time[0]) / (len(time) - 1))
        step = float(steps[steps <= GAP * mean_step].mean())  # step of the clock itself, without gaps
        sample_count = round((time[-1] - time[0]) / step) + 1
        steady_time = time[0] + step * np.arange(sample_count)
        if len(time) == sample_count and np.abs(time - steady_time).max() <= MAX_CLOCK_DEVIATION * step:
            return cls(float(time[0]), 1.0 / step, q, tau)
        has_moved = np.abs(steps - step) > _MAX_STEP_DEVIATION * step
        moved = float(np.mean(has_moved))
        resampled_q, resampled_tau = _resample(time, q, tau, steady_time)
        return cls(float(time[0]), 1.0 / step, resampled_q, resampled_tau, moved)

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
    """(k, n) values at the times ``at`` (k,), by linear interpolation of columns x (m, n) at the times ``time`` (m,)."""
    return np.stack([np.interp(at, time, column) for column in x.T], axis=1)


def pause_lengths(time: Array) -> Array:
    """Lengths (k,) [s] of the pauses of time stamps (n,), at which logs are split.

    >>> pause_lengths(np.array([0.0, 0.5, 1.0, 5.0, 5.5])).tolist()
    [4.0]
    """
    min_pause = PAUSE
    first_steps = np.diff(time[:_ROWS_OF_USUAL_STEP])
    if len(first_steps):
        min_pause = max(PAUSE, GAP * float(np.median(first_steps)))
    lengths = list[Array]()
    for rows in slices(len(time)):  # portions, to limit memory
        steps = np.diff(time[rows.start : rows.stop + 1])  # with the step to the next portion
        lengths.append(steps[steps > min_pause])
    return np.concatenate(lengths)


def gap_notes(lengths: Array) -> tuple[str, ...]:
    """One sentence on pauses of these lengths (k,) [s], at which logs are split; none without pauses."""
    if not len(lengths):
        return ()
    count_text = "1 gap" if len(lengths) == 1 else f"{len(lengths)} gaps"
    seconds = number(float(np.sum(lengths)), 3)
    return (doubt("gap", count=count_text, seconds=seconds).sentence,)


def _resample(time: Array, q: Array, tau: Array, at: Array) -> tuple[Array, Array]:
    """Positions and torques at the times ``at``, clamped to the range of the log: by a cubic spline, and linearly."""
    from scipy.interpolate import CubicSpline

    elapsed = time - time[0]
    elapsed_at = np.clip(at - time[0], 0.0, elapsed[-1])
    return CubicSpline(elapsed, q)(elapsed_at), interpolate(elapsed_at, elapsed, tau)


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
    """States below a cut-off [Hz], at about ``rate`` samples per second, by default 20 per period of the cut-off."""
    state_rate = STATE_RATE * cutoff if rate is None else rate
    row_step = max(1, math.floor(samples.rate / state_rate))
    rows = slice(None, None, row_step)
    step = 1.0 / samples.rate
    time = samples.start + step * np.arange(len(samples))
    states = np.empty((4, len(time[rows]), samples.q.shape[1]))  # q, dq, ddq and tau
    for j in range(samples.q.shape[1]):  # one joint at a time, to limit memory
        q = low_pass(samples.q[:, j], cutoff, samples.rate)
        dq = np.gradient(q, step)
        ddq = np.gradient(dq, step)
        tau = low_pass(samples.tau[:, j], cutoff, samples.rate)
        states[:, :, j] = q[rows], dq[rows], ddq[rows], tau[rows]
    return Filtered(time[rows], samples.rate / row_step, *states)


def torques_below(samples: SteadySamples, cutoff: float) -> tuple[Array, Array]:
    """Times (m,) and torques (m, nv) of the states below a cut-off [Hz]."""
    row_step = max(1, math.floor(samples.rate / (STATE_RATE * cutoff)))
    rows = slice(None, None, row_step)
    time = samples.start + np.arange(len(samples)) / samples.rate
    torques = [low_pass(tau, cutoff, samples.rate)[rows] for tau in samples.tau.T]
    return time[rows], np.stack(torques, axis=1)


def kept_rows(states: Filtered, cutoff: float, most: float, *, cut: bool = False) -> slice:
    """States that become rows: 2.5 per period of the cut-off, at most ``most`` rows, without the settling of the filters."""
    count = len(states.time)
    row_step = max(1, math.floor(states.rate / (ROW_RATE * cutoff)), math.ceil(count / most))
    border = border_of(states.rate, cutoff, count, cut=cut)
    return slice(border, max(border, count - border), row_step)


def states_with_rows(
    samples: Sequence[SteadySamples], cutoff: float, most: float, *, whole: bool = False
) -> Iterator[tuple[SteadySamples, Filtered, slice]]:
    """Each log with its states below a cut-off, and the states that are its rows.

    All logs together have at most ``most`` rows, in proportion to their durations. With ``whole``, all samples are states.
    """
    total = total_seconds(samples)
    for log in samples:
        state_rate = log.rate if whole else None
        states = states_below(log, cutoff, state_rate)
        most_of_log = max(1.0, most * log.seconds / total)
        yield log, states, kept_rows(states, cutoff, most_of_log, cut=log.cut)


def border_of(rate: float, cutoff: float, count: int, *, cut: bool) -> int:
    """Number of states to leave out at either end of ``count`` states; more for a piece that is ``cut`` at pauses."""
    period = math.ceil(rate / cutoff)  # states in a period of the cut-off
    if cut:
        return _CUT_BORDER * period
    return min(period, count // 10)  # at most a tenth of the states


def cutoffs(samples: Sequence[SteadySamples], rows: float) -> tuple[float, ...]:
    """Candidate cut-offs [Hz] with at least ``rows`` rows, up to a tenth of the sampling rate, which is the default."""
    shortest_log = math.inf  # [s]
    longest_piece = 0.0  # [s]
    for log in samples:
        if log.cut:
            longest_piece = max(longest_piece, log.seconds)
        else:
            shortest_log = min(shortest_log, log.seconds)
    duration = shortest_log
    if longest_piece:
        duration = min(shortest_log, 0.5 * longest_piece)  # shorter pieces then have no rows
    cutoff_of_rows = rows / (ROW_RATE * total_seconds(samples))
    lowest_cutoff = max(_MIN_PERIODS / duration, cutoff_of_rows)
    highest_cutoff = _MAX_CUTOFF_SHARE * lowest_rate(samples)
    round_frequencies = [digit * 10.0**power for power in range(-1, 3) for digit in _CUTOFF_DIGITS]
    candidates = tuple(frequency for frequency in round_frequencies if lowest_cutoff <= frequency <= highest_cutoff)
    if not candidates:
        return (highest_cutoff,)
    return candidates


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
    """(m,) times of the states [s]."""
    rate: float
    """States per second [Hz]."""
    rows: slice
    """States that are rows."""
    position: Array
    """Positions of the rows."""
    dq: Array
    """(m, nv) velocities of the states."""
    acceleration: Array
    """Accelerations of the rows."""
    _tau: Array
    """Torques, low-passed twice; empty once the spline exists."""

    @cached_property
    def spline(self) -> UniformSpline:
        """Spline of the torques."""
        spline = UniformSpline.from_samples(self.time, self._tau)
        self._tau = self._tau[:0]  # release the memory: the spline has a copy
        return spline

    def torques(self, shift: float) -> Array:
        """(m, nv) torques at the rows, from ``shift`` seconds later; at the ends, the first and the last torque."""
        shifted_time = np.clip(self.time[self.rows] + shift, self.time[0], self.time[-1])
        return np.asarray(self.spline(shifted_time))


@dataclass(eq=False)
class FilteredRows:
    """Rows of several logs at one cut-off."""

    base: BaseParameters
    cutoff: float
    """Cut-off [Hz]."""
    W: Array
    """(m, nv, r) columns of the equations τ = W x."""
    time: Array
    """(m,), time of each row in its own log [s]."""
    log: Array
    """(m,), index of the log of each row."""
    known: Array
    """(m, nv), known torques: those of springs."""
    logs: list[_LogRows]
    dead: Array | None = None
    """(nv,) mask of dead joints, which have no torque; their entries are set to 0. None without any."""
    _coulomb: dict[tuple[int, float], Array] = field(default_factory=dict)
    """Columns of Coulomb friction by number of the column and friction speed."""

    @classmethod
    def from_samples(
        cls,
        base: BaseParameters,
        samples: Sequence[SteadySamples],
        cutoff: float,
        friction_speed: Array,
        most: float = MOST_ROWS,
    ) -> FilteredRows:
        """Rows of logs below a cut-off [Hz], at most ``most`` of all logs together."""
        W_of_logs: list[Array] = []
        springs_of_logs: list[Array] = []
        times: list[Array] = []
        log_indices: list[Array] = []
        logs: list[_LogRows] = []
        for k, (_, s, rows) in enumerate(states_with_rows(samples, cutoff, most)):
            columns, springs = _columns(base, s, rows, cutoff, friction_speed)
            W_of_logs.append(columns)
            springs_of_logs.append(springs)
            times.append(s.time[rows])
            log_indices.append(np.full(len(columns), k))
            tau = low_pass(s.tau, cutoff, s.rate)  # a second time, like the columns
            logs.append(_LogRows(s.time, s.rate, rows, s.q[rows].copy(), s.dq.copy(), s.ddq[rows].copy(), tau))
        W = _concatenate_and_empty(W_of_logs)
        time = np.concatenate(times)
        log = np.concatenate(log_indices)
        known = np.concatenate(springs_of_logs)
        return cls(base, cutoff, W, time, log, known, logs)

    def torques(self, shift: float) -> Array:
        """(m, nv) torques, ``shift`` seconds later in the log than the rows' positions, without the torques of springs."""
        torques_of_logs = [log.torques(shift) for log in self.logs]
        tau = np.asarray(np.concatenate(torques_of_logs) - self.known)
        if self.dead is not None:
            tau[:, self.dead] = 0.0
        return tau

    def coulomb(self, column: int, joints: Array, friction_speed: Array) -> Array:
        """(m, nv) column of Coulomb friction for other friction speeds; ``joints`` (nv,) is True for joints that it affects."""
        key = (column, float(friction_speed[speed_owner(joints)]))
        if key not in self._coulomb:
            self._coulomb[key] = self._coulomb_column(column, joints, friction_speed)
        return self._coulomb[key]

    def _coulomb_column(self, column: int, joints: Array, friction_speed: Array) -> Array:
        """(m, nv) low-passed column for :meth:`coulomb`."""
        k = int(self.base.kept[column])  # index of the parameter
        unknown = self.base.unknown
        columns_of_logs = list[Array]()
        for log in self.logs:
            any_acceleration = log.dq  # friction does not depend on it
            friction = unknown.drives([k], log.dq, any_acceleration, friction_speed)
            filtered_friction = low_pass(friction, self.cutoff, log.rate)
            column_of_log = np.zeros((len(log.acceleration), len(joints)))
            column_of_log[:, joints] = filtered_friction[log.rows] * unknown.shares[k, joints]
            columns_of_logs.append(column_of_log)
        coulomb = np.concatenate(columns_of_logs)
        if self.dead is not None:
            coulomb[:, self.dead] = 0.0
        return coulomb

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
    row_count = sum(map(len, parts))
    result = np.empty((row_count, *parts[0].shape[1:]))
    begin = 0
    while parts:
        part = parts.pop(0)
        end = begin + len(part)
        result[begin:end] = part
        begin = end
    return result


def filtered_portions(
    columns: BaseColumns,
    s: Filtered,
    wanted: Array,
    cutoff: float,
    friction_speed: Array,
) -> Iterator[tuple[Array, Array, Array | float]]:
    """Low-passed entries of rows and torques of springs at the ``wanted`` states, in batches.

    Parameters
    ----------
    columns : BaseColumns
    s : Filtered, states of a log
    wanted : (m,) array, indices of states
    cutoff : float [Hz]
    friction_speed : (nv,) array

    Yields
    ------
    batch : (k,) array, indices among the wanted states
    entries : (k, f) array
    springs : (k, nv) array; 0 without springs
    """
    margin = int(REACH * s.rate / cutoff) + 1  # states on either side that the low-pass needs
    base = columns.base
    for begin in range(0, len(s.time), _PORTION):
        batch = np.flatnonzero((wanted >= begin) & (wanted < begin + _PORTION))
        if not batch.size:
            continue
        span = slice(max(0, begin - margin), min(len(s.time), begin + _PORTION + margin))
        q, dq, ddq = s.q[span], s.dq[span], s.ddq[span]
        indices_in_span = wanted[batch] - span.start
        entries = low_pass_at(columns.rows(q, dq, ddq, friction_speed), cutoff, s.rate, indices_in_span)
        springs: Array | float = 0.0
        if base.unknown.model.springs:
            springs = low_pass_at(spring_torques(base, q, dq, ddq), cutoff, s.rate, indices_in_span)
        yield batch, entries, springs


def _columns(
    base: BaseParameters, s: Filtered, rows: slice, cutoff: float, friction_speed: Array
) -> tuple[Array, Array]:
    """Low-passed kept columns (m, nv, r) and torques of springs (m, nv) at the rows."""
    wanted = np.arange(len(s.time))[rows]
    columns = BaseColumns.from_parameters(base)
    W = np.zeros((len(wanted), s.dq.shape[1], base.count))
    spring_torques_of_rows = np.zeros(W.shape[:2])
    for batch, entries, springs in filtered_portions(columns, s, wanted, cutoff, friction_speed):
        spring_torques_of_rows[batch] = springs
        for j, (groups, entries_of_joint) in enumerate(zip(columns.groups, columns.slices, strict=True)):
            W[np.ix_(batch, np.array([j]), groups)] = entries[:, None, entries_of_joint]
    return W, spring_torques_of_rows


def spring_torques(base: BaseParameters, q: Array, dq: Array, ddq: Array) -> Array:
    """(n, nv) torques of springs at given states: all torques minus the torques of the bodies."""
    robot = base.unknown.robot
    if not base.unknown.model.springs:
        return np.zeros(dq.shape)
    body_torques = robot.regressor(q, dq, ddq) @ robot.parameters
    return np.asarray(robot.inverse_dynamics(q, dq, ddq)) - body_torques


@dataclass(eq=False)
class JudgedStates:
    """States on which predictions of different cut-offs are compared, with almost unfiltered torques."""

    W: Array
    """(m, nv, r) columns from positions below the tested cut-off."""
    known: Array
    """(m, nv) torques of springs."""
    log: Array
    """(m,) index of the log of each state."""
    time: Array
    """(m,) time of each state in its own log [s]."""
    states: list[Filtered]
    """States of each log."""

    @classmethod
    def from_samples(
        cls, base: BaseParameters, samples: Sequence[SteadySamples], cutoff: float, friction_speed: Array
    ) -> JudgedStates:
        """States at times that are equal for all cut-offs."""
        rate = _JUDGED_ROWS / total_seconds(samples)
        states = [states_below(log, cutoff, rate) for log in samples]
        columns: list[Array] = []
        springs: list[Array] = []
        log_indices: list[Array] = []
        times: list[Array] = []
        for k, s in enumerate(states):
            times.append(s.time)
            columns.append(base.unknown.columns(base.kept, s.q, s.dq, s.ddq, friction_speed))
            springs.append(spring_torques(base, s.q, s.dq, s.ddq))
            log_indices.append(np.full(len(s.time), k))
        W = np.concatenate(columns)
        known = np.concatenate(springs)
        return cls(W, known, np.concatenate(log_indices), np.concatenate(times), states)
