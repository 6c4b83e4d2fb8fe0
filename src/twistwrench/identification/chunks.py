"""Logs of any length in chunks: their clock, overlapping chunks on a steady clock, and the rows of equations of each."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import TrajectoryError, ValueRangeError
from ..model.model import Model
from ..motion.motion import Motion
from ..motion.motion_log import LogRows, MotionLog
from ..motion.smoothing import continuous
from ..robot import Robot
from ..typing import Array
from .hyperparameters import FitSettings
from .parameters import BaseParameters
from .payload import MotorSide
from .rows import BaseColumns, of_springs
from .zero_phase import FEWEST, GAP, PAUSE, ROW_RATE, STATE_RATE, Filtered, border_of, low_pass, states_below_of

PIECE = 1 << 20
"""Rows that are one piece of work: seventeen minutes at 1 kHz."""


@dataclass(frozen=True, eq=False)
class LogClock:
    """What one pass over the stamps found.

    Attributes
    ----------
    rows : int
    step : float, mean step that is no gap [s]
    begins, ends : (s,) arrays, first and last stamp of each stretch without a pause [s]
    marks : (m,) array, stamps of the rows 0, PIECE, 2 PIECE, … [s]
    """

    rows: int
    step: float
    begins: Array
    ends: Array
    marks: Array

    @classmethod
    def of(cls, stamps: Iterator[Array], where: str) -> LogClock:
        """From times that do not run back; ``where`` begins the error of a log too short."""
        rows, last = 0, np.zeros(0)
        total, count, usual = 0.0, 0, 0.0
        begins, ends, marks = list[float](), list[float](), list[float]()
        for given in stamps:
            if not len(given):
                continue
            marks += given[-rows % PIECE :: PIECE].tolist()
            rows += len(given)
            t = np.concatenate([last, given])
            begins += [] if len(last) else [float(t[0])]
            last = t[-1:]
            steps = np.diff(t)
            if not usual and (steps > 0).any():
                usual = float(steps[steps > 0].mean())
            regular = (steps > 0) & (steps <= GAP * usual)
            total, count = total + float(steps[regular].sum()), count + int(regular.sum())
            for k in np.flatnonzero(steps > max(PAUSE, GAP * usual)).tolist():
                ends.append(float(t[k]))
                begins.append(float(t[k + 1]))
        if not count:
            raise TrajectoryError(f"{where}: {rows} rows are too few to identify a robot from.")
        ends.append(float(last[0]))
        return cls(rows, total / count, np.array(begins), np.array(ends), np.array(marks))

    @property
    def rate(self) -> float:
        """Rows a second [Hz]."""
        return 1.0 / self.step

    @property
    def seconds(self) -> float:
        """How long it is without its pauses [s]."""
        return float((self.ends - self.begins).sum())


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
    def of(cls, robot: Robot, log: Motion | str | Path, number: int, **reading: Any) -> LogSource:
        """A log that is given as either; ``number`` names one without a file."""
        if isinstance(log, Motion):
            return cls(robot, f"logs number {number}", motion=log)
        return cls(robot, str(log), **reading)

    def log(self) -> MotionLog:
        """The file, opened; raises what opening it raises."""
        return MotionLog.open(self.path, self.robot.model, columns=self.columns, rate=self.rate, degrees=self.degrees)

    def clock(self) -> LogClock:
        """One pass over the stamps."""
        if self.motion is not None:
            return LogClock.of(iter([self.motion.time]), self.path)
        return LogClock.of(self.log().stamps(), self.path)

    def portions(self, begin: int = 0, end: int | None = None, said: list[str] | None = None) -> Iterator[LogRows]:
        """Rows of the joints' side; from a file that is read from its beginning only, all of them.

        ``said`` takes a sentence for each thing by which they contradict themselves, once all were read.
        """
        if self.motion is not None:
            m, rows = self.motion, slice(max(0, begin), end)
            yield LogRows(m.time[rows], m.q[rows], None, None, None if m.tau is None else m.tau[rows])
            return
        log = self.log()
        part = log if end is None else (log.part(begin, end) or log)
        for table in part.tables():
            yield self._sided(part.motion(table))
        if said is not None and self.side is None:
            said += part.contradictions(self.robot.limits)

    @property
    def in_parts(self) -> bool:
        """Whether it can be read from any row on."""
        return self.motion is not None or self.log().part(0, 1) is not None

    def excerpts(self, count: int, rows: int) -> list[Motion]:
        """Runs of consecutive rows spread evenly over the log, as motions; a short one comes whole."""
        if self.motion is not None:
            whole = len(self.motion)
            if whole <= count * rows:
                return [self.motion]
            firsts = [(whole - rows) * k // max(1, count - 1) for k in range(count)]
            return [self.motion[first : first + rows] for first in firsts]
        log = self.log()
        found = [self._sided(log.motion(table)) for table in log.excerpts(count, rows)]
        return [Motion(x.time, x.q, tau=x.tau, robot=self.robot, in_seconds=True) for x in found if len(x.time) > 1]

    def _sided(self, rows: LogRows) -> LogRows:
        if rows.tau is None:
            raise ValueRangeError(
                f"{self.path}: no torque for every joint. Name the columns JOINT.torque, or say which they are, --columns "
                f"'{self.robot.model.velocity_names[0]}.tau=COLUMN'."
            )
        found = rows if self.side is None else self.side.of_joints(rows)
        return replace(found, dq=None, ddq=None)


# ── Chunks on a steady clock, which overlap by the reach of the filters

_STEADY = 1e-3
"""Share of the step that stamps may be off without being moved to the steady clock."""


@dataclass(frozen=True, eq=False)
class Chunk:
    """Samples first, first + 1, … of one stretch of a log, and which of them are this chunk's own.

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


def overlapping(
    portions: Iterable[LogRows], core: int, margin: int
) -> Iterator[tuple[Array, Array, Array, float, float]]:
    """Times, q and τ of about ``core`` rows with up to ``margin`` more on each side, and the times from and until that count.

    Times at the ends of the log are infinite: its first and last chunk own all that is before and after.
    """
    kept: list[tuple[Array, Array, Array]] = []
    rows, begun = 0, 0
    since = -math.inf
    for portion in portions:
        kept.append((portion.time, portion.q, np.asarray(portion.tau)))  # sources refuse logs without torques
        rows += len(portion.time)
        while rows >= begun + core + margin + 1:
            time, q, tau = _joined(kept)
            end = begun + core
            until = float(time[end])
            cut = end + margin
            yield time[:cut], q[:cut], tau[:cut], since, until
            drop = max(0, end - margin)
            kept = [(time[drop:], q[drop:], tau[drop:])]
            rows, begun, since = len(time) - drop, end - drop, until
    if kept:
        yield *_joined(kept), since, math.inf


def _joined(kept: list[tuple[Array, Array, Array]]) -> tuple[Array, Array, Array]:
    if len(kept) == 1:
        return kept[0]
    time, q, tau = zip(*kept, strict=True)
    return np.concatenate(time), np.concatenate(q), np.concatenate(tau)


def chunks(
    portions: Iterable[LogRows], clock: LogClock, model: Model, core: int, margin: int, span: tuple[float, float]
) -> Iterator[Chunk]:
    """Chunks of the rows whose times are in a span [s]; the steady clock of each stretch begins at its first stamp."""
    for time, q, tau, since, until in overlapping(portions, core, margin):
        since, until = max(since, span[0]), min(until, span[1])
        if not since < until:
            continue
        for s, (begin, end) in enumerate(zip(clock.begins.tolist(), clock.ends.tolist(), strict=True)):
            if end < time[0] or begin > time[-1] or end < since or begin >= until:
                continue
            rows = slice(int(np.searchsorted(time, begin)), int(np.searchsorted(time, end, side="right")))
            count = round((end - begin) / clock.step) + 1
            if count < FEWEST or rows.stop - rows.start < 2:
                continue
            steady = _steady(time[rows], continuous(model, q[rows]), tau[rows], begin, clock.step, count)
            if steady is None:
                continue
            first, positions, torques = steady
            own = _number(since, begin, clock.step, count), _number(until, begin, clock.step, count)
            yield Chunk(s, count, begin, clock.step, first, positions, torques, own, len(clock.begins) > 1)


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
"""Of the cut-off, that a filter reaches to either side: what comes from beyond is below 1e-16."""
_STATES = 8192
FASTER = 0.1
"""Share of a friction speed that its derivative is taken over."""


@dataclass(frozen=True, eq=False)
class RowFrame:
    """What rows of all logs are made with, so that they add up.

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
        return BaseColumns.of(self.base)

    @cached_property
    def speeds(self) -> list[tuple[int, Array]]:
        """Of each friction speed that was chosen a column of it, and the joints that it is in."""
        found = self.base.unknown.coulomb_columns(self.base.kept) if self.free_speed else []
        return list({int(np.flatnonzero(joints)[-1]): (c, joints) for c, joints in reversed(found)}.values())[::-1]

    @property
    def extra(self) -> int:
        """How many columns of settings there are."""
        return int(self.free_shift) + len(self.speeds)

    @cached_property
    def felt(self) -> tuple[Array, ...]:
        """Of each joint the columns, of groups and then of settings, that its rows have entries in."""
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


def rows_of(frame: RowFrame, chunk: Chunk) -> Iterator[JointRows]:
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


def _states(chunk: Chunk, cutoff: float, every: int) -> tuple[Filtered, int]:
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
