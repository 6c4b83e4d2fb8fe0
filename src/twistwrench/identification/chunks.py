"""Logs of any length in chunks: clock, overlapping chunks on a steady clock, and rows of equations of each chunk."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ..core.doubts import Doubt, doubt
from ..core.errors import TrajectoryError, ValueRangeError
from ..core.estimation.covariance import StateCells
from ..core.estimation.filters import UniformSpline, low_pass
from ..core.estimation.sampling import GAP
from ..core.numbers import number
from ..core.typing import Array
from ..motion.log_table import slices, spread_rows, windows
from ..motion.motion import Motion
from ..motion.motion_log import LogRows, MotionLog
from ..motion.smoothing import continuous
from ..robot import Robot
from .fit_doubts import LEFT_OUT
from .hyperparameters import FitSettings
from .parameters import BaseParameters, speed_owner
from .payload import MotorSide, open_log
from .rows import (
    FEWEST,
    PAUSE,
    ROW_RATE,
    STATE_RATE,
    STEADY,
    BaseColumns,
    Filtered,
    border_of,
    filtered_portions,
    resampled,
    states_below_of,
)

CHUNK = 1 << 20
"""Number of rows of one unit of work: 17 minutes at 1 kHz."""


@dataclass(frozen=True, eq=False)
class LogClock:
    """Clock of a log: its time step, and its stretches without a pause."""

    rows: int
    step: float  # mean step within stretches [s]
    begins: Array
    ends: Array  # (s,) last time stamps of the stretches [s]

    @classmethod
    def from_times(cls, time: Array, where: str) -> LogClock:
        """Clock of nondecreasing time stamps (n,); raises TrajectoryError for fewer than two, with ``where`` in the message.

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
        """Rows per second [Hz]."""
        return 1.0 / self.step

    @property
    def seconds(self) -> float:
        """Duration without pauses [s]."""
        return float((self.ends - self.begins).sum())

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentence on the pauses, if there are any."""
        return gap_notes(self.begins[1:] - self.ends[:-1])


def gap_notes(lengths: Array) -> tuple[str, ...]:
    """Sentence on pauses of these lengths (k,) [s], at which logs are split; empty without pauses."""
    if not len(lengths):
        return ()
    count = f"{len(lengths)} gap{'s' if len(lengths) > 1 else ''}"
    return (doubt("gap", count=count, seconds=number(float(np.sum(lengths)), 3)).sentence,)


@dataclass(frozen=True, eq=False)
class LogSource:
    """Log given by a file and its reading options (as for :func:`read_motion`), or by a motion in memory."""

    robot: Robot
    path: str
    columns: Mapping[str, str] | None = None
    rate: float | None = None
    degrees: bool = False
    gain: Mapping[str, float] | None = None
    topic: str | None = None
    episode: int | None = None
    side: MotorSide | None = None
    motion: Motion | None = None

    @classmethod
    def from_log(cls, robot: Robot, log: Motion | str | Path, number: int, **reading: Any) -> LogSource:
        """Source from a path or a motion; ``number`` names a log without a file."""
        if isinstance(log, Motion):
            return cls(robot, f"logs number {number}", motion=log)
        return cls(robot, str(log), **reading)

    @property
    def log(self) -> MotionLog:
        """Log of the file, decoded once per process; raises the errors of :meth:`MotionLog.open`."""
        told, gain = (tuple(sorted((x or {}).items())) for x in (self.columns, self.gain))
        file = Path(self.path)
        written = file.stat().st_mtime_ns if file.is_file() else 0
        options: dict[str, Any] = {
            "rate": self.rate,
            "degrees": self.degrees,
            "topic": self.topic,
            "episode": self.episode,
        }
        motors = () if self.side is None else self.side.names
        key = (self.path, written, self.robot.model.drive_names, motors, told, gain, *options.values())
        if key not in _OPENED:
            options |= {"columns": self.columns, "gain": self.gain}
            log = open_log(self.path, self.robot.model, self.side, **options)
            while len(_OPENED) >= _MOST_OPENED:
                _OPENED.pop(next(iter(_OPENED)))
            _OPENED[key] = log
        return _OPENED[key]

    def clock(self) -> LogClock:
        """Clock of all rows."""
        return LogClock.from_times(self.log.table[:, 0] if self.motion is None else self.motion.time, self.path)

    def notes(self) -> tuple[str, ...]:
        """Sentences, one for each kind of omitted rows."""
        doubts = self.log.doubts() if self.motion is None else self.motion.doubts
        return tuple(doubt.sentence for doubt in doubts if doubt.kind == LEFT_OUT)

    def doubts(self) -> tuple[Doubt, ...]:
        """Doubts about a file whose columns are those of the joints."""
        return () if self.motion is not None or self.side is not None else self.log.doubts(self.robot.limits)

    def rows(self, rows: slice) -> LogRows:
        """Range of rows, converted to the joints' side."""
        m = self.motion
        if m is not None:
            return LogRows(m.time[rows], m.q[rows], None, None, None if m.tau is None else m.tau[rows])
        return self._sided(self.log.motion(self.log.table[rows]))

    def excerpts(self, count: int, rows: int) -> list[Motion]:
        """Runs of consecutive rows, evenly spaced over the log, as motions; a short log is returned whole."""
        if self.motion is not None:
            return [self.motion[span] for span in spread_rows(len(self.motion), count, rows)]
        found = [self.rows(span) for span in spread_rows(len(self.log.table), count, rows)]
        return [Motion(x.time, x.q, tau=x.tau, robot=self.robot, in_seconds=True) for x in found if len(x.time) > 1]

    def _sided(self, rows: LogRows) -> LogRows:
        if rows.tau is None:
            raise ValueRangeError(
                f"{self.path}: no torque for every joint. Name the columns JOINT.torque, or assign them with --columns "
                f"'{self.robot.model.velocity_names[0]}.tau=COLUMN'."
            )
        found = rows if self.side is None else self.side.of_joints(rows)
        return replace(found, dq=None, ddq=None)


_OPENED: dict[Any, MotionLog] = {}  # cache of the logs last decoded in this process; chunks of a log share it
_MOST_OPENED = 2


# ── Windows on a steady clock, which overlap by the settling length of the filters


@dataclass(frozen=True, eq=False)
class SteadyWindow:
    """Consecutive samples of one stretch of a log, q and tau (n, nv), and the range of samples that belong to this window."""

    stretch: int
    count: int  # number of samples of the whole stretch
    begin: float  # time of the stretch's first sample [s]
    step: float
    first: int
    q: Array
    tau: Array
    own: tuple[int, int]  # range of samples of the stretch that belong to this window, end excluded
    cut: bool  # True if there are other stretches


def steady_windows(
    source: LogSource, clock: LogClock, core: int, margin: int, begin: int, end: int
) -> Iterator[SteadyWindow]:
    """Windows of about ``core`` rows from ``begin`` to ``end``, plus ``margin`` on either side, on the clock of the stretch."""
    model = source.robot.model
    for rows, _ in windows(end - begin, core, 0):
        a, b = begin + rows.start, begin + rows.stop
        low = max(0, a - margin)
        part = source.rows(slice(low, min(clock.rows, b + margin + 1)))
        time, q, tau = part.time, part.q, np.asarray(part.tau)  # sources reject logs without torques
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
    """Index of the first sample at or after a time."""
    if math.isinf(time):
        return 0 if time < 0 else count
    return min(max(math.ceil((time - begin) / step - 0.5), 0), count)


def _steady(
    time: Array, q: Array, tau: Array, begin: float, step: float, count: int
) -> tuple[int, Array, Array] | None:
    """Index of the first sample, and interpolated positions and torques at the samples between the rows."""
    first = max(0, math.ceil((time[0] - begin) / step - STEADY))
    last = min(count - 1, math.floor((time[-1] - begin) / step + STEADY))
    if last - first + 1 < 2:
        return None
    at = begin + step * np.arange(first, last + 1)
    if len(time) == len(at) and np.abs(time - at).max() <= STEADY * step:
        return first, q, tau
    return first, *resampled(time, q, tau, at)


# ── Rows of equations of one chunk

# Columns of the settings that were chosen on an excerpt follow those of the groups: derivatives of the equation by the
# clock offset and by the friction speeds. In a fit of all rows, the errors of these settings are additional unknowns,
#
#     τ(t + shift) = W x - δ_shift dτ/dt + Σ_j δ_j ∂(W x_0)/∂v_0j.

PERIODS = 16
"""Margin of chunks on either side, in periods of the cut-off; the filter response beyond is below 1e-16."""
FASTER = 0.1
"""Step of the finite difference by a friction speed, as a share of it."""


@dataclass(frozen=True, eq=False)
class RowFrame:
    """Common settings of the rows of all logs, which make their normal equations additive."""

    base: BaseParameters
    settings: FitSettings
    x: Array  # (r,) groups of an excerpt, at which derivatives are evaluated
    sigma: Array  # (nv,) sizes of the residuals
    dead: Array  # (nv,) bool, True for joints without a torque
    free_shift: bool  # True if the clock offset was chosen automatically
    free_speed: bool  # True if the friction speeds were chosen automatically
    robust: bool  # True if large residuals get lower weights
    cells: StateCells

    @cached_property
    def columns(self) -> BaseColumns:
        """Positions of the entries in a row."""
        return BaseColumns.from_parameters(self.base)

    @cached_property
    def speeds(self) -> dict[int, list[tuple[int, Array]]]:
        """Columns of dry friction with their joints, by the joint whose chosen friction speed they depend on."""
        found: dict[int, list[tuple[int, Array]]] = {}
        for column, joints in self.base.unknown.coulomb_columns(self.base.kept) if self.free_speed else []:
            owner = speed_owner(joints)
            found[owner] = [*found.pop(owner, []), (column, joints)]
        return found

    @property
    def first_speed(self) -> int:
        """Index of the first column of a friction speed; the column of the clock offset precedes it."""
        return self.base.count + int(self.free_shift)

    @property
    def width(self) -> int:
        """Number of columns of groups and settings."""
        return self.first_speed + len(self.speeds)

    @cached_property
    def active(self) -> Array:
        """(nv, width) bool, True for columns of groups, then settings, that are not zero in the rows of each joint."""
        of_speeds = [columns[0][1] for columns in self.speeds.values()]
        offset = np.full((len(self.sigma), int(self.free_shift)), True)
        return np.concatenate([self.base.felt, offset, np.reshape(of_speeds, (-1, len(self.sigma))).T > 0], axis=1)

    def margin(self, rate: float) -> int:
        """Number of samples that a chunk needs as a margin on each side."""
        return math.ceil((2 * PERIODS / self.settings.cutoff + abs(self.settings.shift)) * rate) + 16


def rows_of(frame: RowFrame, chunk: SteadyWindow) -> Iterator[tuple[Array, Array, list[Array]]]:
    """The chunk's own rows in batches: times (n,) [s], cells of state, and entries (n, r_j + 1) per joint, torques last."""
    cutoff, rate = frame.settings.cutoff, 1.0 / chunk.step
    every = max(1, math.floor(rate / (STATE_RATE * cutoff)))
    number = -(-chunk.first // every)  # of the first state, on the grid of the stretch
    time = chunk.begin + chunk.step * (chunk.first + np.arange(len(chunk.q)))
    grid = slice(number * every - chunk.first, None, every)
    states = states_below_of(time, chunk.q, chunk.tau, chunk.step, cutoff, grid)
    total = -(-chunk.count // every)
    apart = max(1, math.floor(states.rate / (ROW_RATE * cutoff)))
    border = border_of(states.rate, cutoff, total, cut=chunk.cut)
    first, last = -(-chunk.own[0] // every), min(-(-chunk.own[1] // every), total - border)
    first = border + max(0, -(-(first - border) // apart)) * apart
    wanted = np.arange(first, max(first, last), apart) - number
    wanted = wanted[(wanted >= 0) & (wanted < len(states.time))]
    if not wanted.size:
        return
    filtered = low_pass(states.tau, cutoff, states.rate)  # second pass, as for the columns
    torques = UniformSpline.from_samples(states.time, filtered)
    there = np.clip(states.time[wanted] + frame.settings.shift, states.time[0], states.time[-1])
    tau, slope = torques(there), torques.slope(there)
    for here, span, entries, springs in filtered_portions(
        frame.columns, states, wanted, cutoff, frame.settings.friction_speed, PERIODS
    ):
        at = wanted[here] - span.start
        beside = [slope[here]] if frame.free_shift else []
        beside += [_slower(frame, states, span, owner)[at] for owner in frame.speeds]
        rows = wanted[here]
        cells = frame.cells.numbers(states.q[rows], states.dq[rows])
        yield states.time[rows], cells, _of_joints(frame, entries, beside, tau[here] - springs)


def _of_joints(frame: RowFrame, entries: Array, beside: Sequence[Array], tau: Array) -> list[Array]:
    """Entries of each joint, with the columns (n, nv) of settings and the torques appended."""
    found = []
    for j, place in enumerate(frame.columns.slices):
        mine = [
            column[:, j] for column, active in zip(beside, frame.active[j, frame.base.count :], strict=True) if active
        ]
        whole = np.column_stack([entries[:, place], *mine, tau[:, j]])
        found.append(np.zeros_like(whole) if frame.dead[j] else whole)
    return found


def _slower(frame: RowFrame, s: Filtered, span: slice, owner: int) -> Array:
    """(n, nv) change of W x_0 if the friction speed of a joint increases by a tenth."""
    unknown, kept = frame.base.unknown, frame.base.kept
    speed = frame.settings.friction_speed
    faster = np.where(np.arange(len(speed)) == owner, 1.0 + FASTER, 1.0) * speed
    states = s.q[span], s.dq[span], s.ddq[span]
    found = np.zeros(states[1].shape)
    for column, mine in frame.speeds[owner]:
        which = kept[column : column + 1]
        change = unknown.columns(which, *states, faster)[..., 0] - unknown.columns(which, *states, speed)[..., 0]
        found[:, mine] += low_pass(change[:, mine], frame.settings.cutoff, s.rate) * frame.x[column]
    return found
