"""Logs of any length in chunks: their clock, overlapping chunks on a steady clock, and the rows of equations of each."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ..core.numbers import number
from ..errors import TrajectoryError, ValueRangeError
from ..motion.log_table import slices, windows
from ..motion.motion import Motion
from ..motion.motion_log import LogRows, MotionLog
from ..motion.rate_checks import LEFT_OUT
from ..motion.smoothing import continuous
from ..robot import Robot
from ..typing import Array
from .hyperparameters import FitSettings
from .parameters import BaseParameters
from .payload import MotorSide
from .rows import BaseColumns, of_springs
from .zero_phase import FEWEST, GAP, PAUSE, ROW_RATE, STATE_RATE, Filtered, border_of, low_pass, states_below_of

CHUNK = 1 << 20
"""Rows of one unit of work: seventeen minutes at 1 kHz."""


@dataclass(frozen=True, eq=False)
class LogClock:
    """Clock of a log: its step, and its stretches without a pause.

    Attributes
    ----------
    rows : int
    step : float, mean step within stretches [s]
    begins, ends : (s,) arrays, first and last stamp of each stretch [s]
    """

    rows: int
    step: float
    begins: Array
    ends: Array

    @classmethod
    def from_times(cls, time: Array, where: str) -> LogClock:
        """Clock of stamps (n,) that do not run back; raises TrajectoryError, which begins with ``where``, for fewer than two.

        >>> clock = LogClock.from_times(np.array([0.0, 0.5, 1.0, 5.0, 5.5]), "a log")
        >>> clock.step, clock.begins.tolist(), clock.ends.tolist()
        (0.5, [0.0, 5.0], [1.0, 5.5])
        """
        first = np.diff(time[:CHUNK])
        usual = float(np.median(first[first > 0])) if (first > 0).any() else 0.0
        total, count, cuts = 0.0, 0, [0]
        for s in slices(len(time)):
            steps = np.diff(time[s.start : s.stop + 1])
            regular = (steps > 0) & (steps <= GAP * usual)
            total, count = total + float(steps[regular].sum()), count + int(regular.sum())
            cuts += (np.flatnonzero(steps > max(PAUSE, GAP * usual)) + s.start + 1).tolist()
        if not count:
            raise TrajectoryError(f"{where}: {len(time)} rows are too few to identify a robot from.")
        ends = [*cuts[1:], len(time)]
        return cls(len(time), total / count, np.array(time[cuts]), np.array([time[k - 1] for k in ends]))

    @property
    def rate(self) -> float:
        """Rows a second [Hz]."""
        return 1.0 / self.step

    @property
    def seconds(self) -> float:
        """Duration without pauses [s]."""
        return float((self.ends - self.begins).sum())

    @property
    def notes(self) -> tuple[str, ...]:
        """A sentence on the pauses, if there are any."""
        return gap_notes(self.begins[1:] - self.ends[:-1])


def gap_notes(lengths: Array) -> tuple[str, ...]:
    """A sentence on pauses of these lengths (k,) [s], at which logs are split; none without pauses."""
    if not len(lengths):
        return ()
    count = f"{len(lengths)} gap{'s' if len(lengths) > 1 else ''}"
    return (
        f"{count}, {number(float(np.sum(lengths)), 3)} s in all: the logs are split there, and nothing is filled in.",
    )


@dataclass(frozen=True, eq=False)
class LogSource:
    """A log, by its file and how it is read, or by its motion in memory.

    Attributes
    ----------
    robot : Robot
    path : str
    columns, rate, degrees, side : as :func:`read_motion` takes them
    motion : Motion, optional, the log itself
    """

    robot: Robot
    path: str
    columns: Mapping[str, str] | None = None
    rate: float | None = None
    degrees: bool = False
    side: MotorSide | None = None
    motion: Motion | None = None

    @classmethod
    def from_log(cls, robot: Robot, log: Motion | str | Path, number: int, **reading: Any) -> LogSource:
        """A log that is given as either; ``number`` names one without a file."""
        if isinstance(log, Motion):
            return cls(robot, f"logs number {number}", motion=log)
        return cls(robot, str(log), **reading)

    @property
    def log(self) -> MotionLog:
        """Log of the file, decoded once in a process; raises the errors of :meth:`MotionLog.open`."""
        told, file = tuple(sorted((self.columns or {}).items())), Path(self.path)
        written = file.stat().st_mtime_ns if file.is_file() else 0
        key = (self.path, written, self.robot.coordinate_names, told, self.rate, self.degrees)
        if key not in _OPENED:
            options: dict[str, Any] = {"columns": self.columns, "rate": self.rate, "degrees": self.degrees}
            log = MotionLog.open(self.path, self.robot.model, **options)
            while len(_OPENED) >= _MOST_OPENED:
                _OPENED.pop(next(iter(_OPENED)))
            _OPENED[key] = log
        return _OPENED[key]

    def clock(self) -> LogClock:
        """Clock of all rows."""
        return LogClock.from_times(self.log.table[:, 0] if self.motion is None else self.motion.time, self.path)

    def notes(self) -> tuple[str, ...]:
        """A sentence for each kind of rows left out."""
        notes = self.log.notes if self.motion is None else self.motion.notes
        return tuple(note for note in notes if note.startswith(LEFT_OUT))

    def contradictions(self) -> tuple[str, ...]:
        """A sentence for each contradiction in a file of the joints' own columns."""
        return () if self.motion is not None or self.side is not None else self.log.contradictions(self.robot.limits)

    def rows(self, rows: slice) -> LogRows:
        """Some rows, of the joints' side."""
        m = self.motion
        if m is not None:
            return LogRows(m.time[rows], m.q[rows], None, None, None if m.tau is None else m.tau[rows])
        return self._sided(self.log.motion(self.log.table[rows]))

    def excerpts(self, count: int, rows: int) -> list[Motion]:
        """Runs of consecutive rows spread evenly over the log, as motions; a short one comes whole."""
        whole = len(self.log.table if self.motion is None else self.motion)
        firsts = [0] if whole <= count * rows else [(whole - rows) * k // max(1, count - 1) for k in range(count)]
        spans = [slice(first, first + rows if len(firsts) > 1 else whole) for first in firsts]
        if self.motion is not None:
            return [self.motion[span] for span in spans]
        found = [self.rows(span) for span in spans]
        return [Motion(x.time, x.q, tau=x.tau, robot=self.robot, in_seconds=True) for x in found if len(x.time) > 1]

    def _sided(self, rows: LogRows) -> LogRows:
        if rows.tau is None:
            raise ValueRangeError(
                f"{self.path}: no torque for every joint. Name the columns JOINT.torque, or say which they are, --columns "
                f"'{self.robot.model.velocity_names[0]}.tau=COLUMN'."
            )
        found = rows if self.side is None else self.side.of_joints(rows)
        return replace(found, dq=None, ddq=None)


_OPENED: dict[Any, MotionLog] = {}
"""Logs that this process has decoded last, so that the chunks of one decode it once."""
_MOST_OPENED = 2


# ── Windows on a steady clock, which overlap by the reach of the filters

_STEADY = 1e-3
"""Share of the step that stamps may be off without being moved to the steady clock."""


@dataclass(frozen=True, eq=False)
class SteadyWindow:
    """Samples first, first + 1, … of one stretch of a log, and those that are this window's own.

    Attributes
    ----------
    stretch : int
    count : int, samples of the whole stretch
    begin : float, time of the stretch's first sample [s]
    step : float [s]
    first : int, number of the first sample here
    q, tau : (n, nv) arrays
    own : (a, b), numbers of the stretch's samples, from the first to the one after the last
    cut : bool, whether there are other stretches
    """

    stretch: int
    count: int
    begin: float
    step: float
    first: int
    q: Array
    tau: Array
    own: tuple[int, int]
    cut: bool = False


def steady_windows(
    source: LogSource, clock: LogClock, core: int, margin: int, begin: int, end: int
) -> Iterator[SteadyWindow]:
    """Windows of about ``core`` rows from ``begin`` to ``end`` of a log, with ``margin`` more on either side.

    The steady clock of each stretch begins at its first stamp.
    """
    model = source.robot.model
    for rows, _ in windows(end - begin, core, 0):
        a, b = begin + rows.start, begin + rows.stop
        low = max(0, a - margin)
        part = source.rows(slice(low, min(clock.rows, b + margin + 1)))
        time, q, tau = part.time, part.q, np.asarray(part.tau)  # sources refuse logs without torques
        since = -math.inf if a == 0 else float(time[a - low])
        until = math.inf if b == clock.rows else float(time[b - low])
        for s, (first, last) in enumerate(zip(clock.begins.tolist(), clock.ends.tolist(), strict=True)):
            if last < time[0] or first > time[-1] or last < since or first >= until:
                continue
            here = slice(int(np.searchsorted(time, first)), int(np.searchsorted(time, last, side="right")))
            count = round((last - first) / clock.step) + 1
            if count < FEWEST or here.stop - here.start < 2:
                continue
            steady = _steady(time[here], continuous(model, q[here]), tau[here], first, clock.step, count)
            if steady is None:
                continue
            place, positions, torques = steady
            own = _number(since, first, clock.step, count), _number(until, first, clock.step, count)
            yield SteadyWindow(s, count, first, clock.step, place, positions, torques, own, len(clock.begins) > 1)


def _number(time: float, begin: float, step: float, count: int) -> int:
    """Number of the first sample at that time or later."""
    if math.isinf(time):
        return 0 if time < 0 else count
    return min(max(math.ceil((time - begin) / step - 0.5), 0), count)


def _steady(
    time: Array, q: Array, tau: Array, begin: float, step: float, count: int
) -> tuple[int, Array, Array] | None:
    """Number of the first sample, and positions and torques at the samples that lie between the rows."""
    first = max(0, math.ceil((time[0] - begin) / step - _STEADY))
    last = min(count - 1, math.floor((time[-1] - begin) / step + _STEADY))
    if last - first + 1 < 2:
        return None
    at = begin + step * np.arange(first, last + 1)
    if len(time) == len(at) and np.abs(time - at).max() <= _STEADY * step:
        return first, q, tau
    from scipy.interpolate import CubicSpline

    local = time - time[0]
    inside = np.clip(at - time[0], 0.0, local[-1])
    return first, CubicSpline(local, q)(inside), np.stack([np.interp(inside, local, x) for x in tau.T], axis=1)


# ── Rows of equations of one chunk

# Beside the groups' columns stand those of the settings that were chosen on an excerpt, the derivatives of the equation by the
# clock's offset and by the speeds of friction: in a fit of all rows the errors of that choice are unknowns like others,
#
#     τ(t + shift) = W x - δ_shift dτ/dt + Σ_j δ_j ∂(W x_0)/∂v_0j.

PERIODS = 16
"""Periods of the cut-off that a filter reaches to either side: beyond, its response is below 1e-16."""
_STATES = 8192
FASTER = 0.1
"""Share of a friction speed that its derivative is taken over."""


@dataclass(frozen=True, eq=False)
class RowFrame:
    """Common settings of the rows of all logs, so that they add up.

    Attributes
    ----------
    base : BaseParameters
    settings : FitSettings
    x : (r,) array, groups that an excerpt gave: where derivatives are taken
    sigma : (nv,) array, sizes of the residuals
    dead : (nv,) bool array, joints without a torque
    free_shift, free_speed : bool, whether the clock's offset and the speeds of friction were chosen
    robust : bool, whether large residuals count less
    """

    base: BaseParameters
    settings: FitSettings
    x: Array
    sigma: Array
    dead: Array
    free_shift: bool
    free_speed: bool
    robust: bool

    @cached_property
    def columns(self) -> BaseColumns:
        """Places of the entries."""
        return BaseColumns.from_parameters(self.base)

    @cached_property
    def speeds(self) -> list[tuple[int, Array]]:
        """Column of each chosen friction speed, and the joints that it is in."""
        found = self.base.unknown.coulomb_columns(self.base.kept) if self.free_speed else []
        return list({int(np.flatnonzero(joints)[-1]): (c, joints) for c, joints in reversed(found)}.values())[::-1]

    @property
    def extra(self) -> int:
        """Number of columns of settings."""
        return int(self.free_shift) + len(self.speeds)

    @cached_property
    def felt(self) -> tuple[Array, ...]:
        """Columns of each joint, of groups and then of settings, in which its rows have entries."""
        r, found = self.base.count, list[Array]()
        for j, groups in enumerate(self.columns.groups):
            mine = [r] if self.free_shift else []
            mine += [r + int(self.free_shift) + k for k, (_, joints) in enumerate(self.speeds) if joints[j]]
            found.append(np.concatenate([groups, np.array(mine, int)]))
        return tuple(found)

    def margin(self, rate: float) -> int:
        """Samples on each side that a chunk needs besides its own."""
        return math.ceil((2 * PERIODS / self.settings.cutoff + abs(self.settings.shift)) * rate) + 16


@dataclass(frozen=True, eq=False)
class JointRows:
    """Rows of one portion: times (n,) [s], and of each joint the entries (n, r_j + 1), torques in the last column."""

    time: Array
    entries: tuple[Array, ...]


def rows_of(frame: RowFrame, chunk: SteadyWindow) -> Iterator[JointRows]:
    """The rows that are the chunk's own, in portions of states that stay in the processor's cache."""
    cutoff, rate = frame.settings.cutoff, 1.0 / chunk.step
    every = max(1, math.floor(rate / (STATE_RATE * cutoff)))
    states, number = _states(chunk, cutoff, every)
    total = -(-chunk.count // every)
    apart = max(1, math.floor(states.rate / (ROW_RATE * cutoff)))
    border = border_of(states.rate, cutoff, total, cut=chunk.cut)
    first, last = -(-chunk.own[0] // every), min(-(-chunk.own[1] // every), total - border)
    first = border + max(0, -(-(first - border) // apart)) * apart
    wanted = np.arange(first, max(first, last), apart) - number
    wanted = wanted[(wanted >= 0) & (wanted < len(states.time))]
    if not wanted.size:
        return
    torques = _Torques(frame, states)
    margin = int(PERIODS * states.rate / cutoff) + 1
    for begin in range(int(wanted[0]), int(wanted[-1]) + 1, _STATES):
        mine = wanted[(wanted >= begin) & (wanted < begin + _STATES)]
        if mine.size:
            span = slice(max(0, begin - margin), min(len(states.time), begin + _STATES + margin))
            yield _portion(frame, states, torques, span, mine)


def _states(chunk: SteadyWindow, cutoff: float, every: int) -> tuple[Filtered, int]:
    """States on the stretch's own grid of every so many samples, and the number of the first."""
    number = -(-chunk.first // every)
    time = chunk.begin + chunk.step * (chunk.first + np.arange(len(chunk.q)))
    return states_below_of(
        time, chunk.q, chunk.tau, chunk.step, cutoff, slice(number * every - chunk.first, None, every)
    ), number


class _Torques:
    """Torques of a chunk's states, low-passed once more as the columns are, and their slope."""

    def __init__(self, frame: RowFrame, s: Filtered) -> None:
        from scipy.interpolate import CubicSpline

        self._spline = CubicSpline(s.time, low_pass(s.tau, frame.settings.cutoff, s.rate))
        self._span, self._shift = (float(s.time[0]), float(s.time[-1])), frame.settings.shift

    def at(self, time: Array) -> tuple[Array, Array]:
        """(n, nv) both, at times of positions."""
        there = np.clip(time + self._shift, *self._span)
        return self._spline(there), self._spline(there, 1)


def _portion(frame: RowFrame, s: Filtered, torques: _Torques, span: slice, wanted: Array) -> JointRows:
    base, settings, columns = frame.base, frame.settings, frame.columns
    q, dq, ddq = s.q[span], s.dq[span], s.ddq[span]
    at = wanted - span.start
    entries = low_pass(columns.rows(q, dq, ddq, settings.friction_speed), settings.cutoff, s.rate)[at]
    tau, slope = torques.at(s.time[wanted])
    if base.unknown.model.springs:
        tau = tau - low_pass(of_springs(base, q, dq, ddq), settings.cutoff, s.rate)[at]
    changes = [_slower(frame, s, span, joints)[at] for _, joints in frame.speeds]
    found = []
    for j, place in enumerate(columns.slices):
        beside = [slope[:, j]] if frame.free_shift else []
        beside += [change[:, j] for change, (_, joints) in zip(changes, frame.speeds, strict=True) if joints[j]]
        whole = np.column_stack([entries[:, place], *beside, tau[:, j]])
        found.append(np.zeros_like(whole) if frame.dead[j] else whole)
    return JointRows(s.time[wanted], tuple(found))


def _slower(frame: RowFrame, s: Filtered, span: slice, joints: Array) -> Array:
    """(n, nv) what W x_0 changes by when the friction speed of the last of these joints grows by a tenth of itself."""
    unknown, owner = frame.base.unknown, int(np.flatnonzero(joints)[-1])
    speed = frame.settings.friction_speed
    faster = np.where(np.arange(len(speed)) == owner, 1.0 + FASTER, 1.0) * speed
    states = s.q[span], s.dq[span], s.ddq[span]
    found = np.zeros(states[1].shape)
    for column, mine in unknown.coulomb_columns(frame.base.kept):
        if int(np.flatnonzero(mine)[-1]) != owner:
            continue
        kept = frame.base.kept[column : column + 1]
        change = unknown.columns(kept, *states, faster)[..., 0] - unknown.columns(kept, *states, speed)[..., 0]
        found[:, mine] += low_pass(change[:, mine], frame.settings.cutoff, s.rate) * frame.x[column]
    return found
