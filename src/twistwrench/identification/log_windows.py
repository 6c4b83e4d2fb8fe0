"""Windows of logs: all rows are checked, and at most 200,000 samples of all logs are fitted.

Short logs are one window each; windows of longer logs are spread evenly over every log. Each becomes samples on a steady clock
of its own, so filters settle at its ends as at a pause. Windows are independent: a loop, processes, or a cluster read them.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from ..core.doubts import Doubt
from ..core.errors import ShapeError, TrajectoryError, ValueRangeError
from ..core.estimation.sampling import dropouts, gaps, held_rows, new_rows, spikes
from ..core.estimation.single_row_glitches import OVERLAP, SingleRowGlitches
from ..core.text import Argument
from ..core.third_party.workers import Failure, Workers
from ..core.typing import Array
from ..motion.contradictions import row_doubts
from ..motion.coordinates import Coordinates
from ..motion.log_table import slices, spread_rows
from ..motion.motion import Motion
from ..motion.motion_log import LogRows, MotionLog
from ..motion.smoothing import continuous
from ..robot import Robot
from .payload import MotorSide, open_log, sided_doubts
from .rows import MIN_SAMPLES, SteadySamples, pause_lengths

MOST_STATES = 200_000
"""Maximum number of samples of all logs that are fitted."""
WINDOW = 4096
"""Samples per window of a longer log."""
_MAX_WRONG_ROWS = 0.01  # maximum share of single-row glitches that are removed from a log
_MIN_CLOSED_PAUSE = 0.06, 6.0  # pause with closed-up time stamps: minimum [s], and minimum in usual steps
_PORTION = MOST_STATES  # rows that are checked together
_HAS_COMMANDS = (
    "no torque for every joint; the log has commands: {0} identifies gains, friction and armature from them. If it has "
    "torques, too, name their columns JOINT.torque."
)
_SERVOS = Argument("identify_servos", None, option="from-commands")

Log: TypeAlias = Motion | str | Path


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
    def from_log(cls, robot: Robot, log: Log, name: str, reading: Mapping[str, Any]) -> LogSource:
        """Source from a path, or from a motion with torques of this robot, named for messages.

        Raises ShapeError and TrajectoryError.
        """
        if isinstance(log, str | Path):
            return cls(robot, str(log), **reading)
        if not isinstance(log, Motion):
            raise ShapeError(
                f"identify: {name} is not a tw.Motion or the path of a file. tw.Motion.from_file(path, robot) reads one."
            )
        if log.tau is None:
            if log.command is not None:
                raise ShapeError(f"identify: {name} has {_HAS_COMMANDS}", _SERVOS)
            raise ShapeError(
                f"identify: {name} has no torques for every joint. Name their columns JOINT.torque, or "
                "assign them: columns={'JOINT.tau': 'COLUMN'}."
            )
        if log.robot.coordinate_names != robot.coordinate_names:
            raise TrajectoryError(
                f"identify: {name} is of {log.robot.name!r}, whose joints are not those of {robot.name!r}."
            )
        return cls(robot, name, motion=log)

    @property
    def log(self) -> MotionLog:
        """Log of the file, decoded once per process; raises the errors of :meth:`MotionLog.open`."""
        columns, gain = sorted((self.columns or {}).items()), sorted((self.gain or {}).items())
        file = Path(self.path)
        written = file.stat().st_mtime_ns if file.is_file() else 0
        options = self._options
        motors = () if self.side is None else self.side.names
        drives = self.robot.model.drive_names
        key = (self.path, written, drives, motors, tuple(columns), tuple(gain), *options.values())
        if key not in _OPENED:
            options |= {"columns": self.columns, "gain": self.gain}
            log = open_log(self.path, self.robot.model, self.side, **options)
            room = _MAX_BYTES_OPENED - log.table.nbytes  # a log that cannot be decoded raises here
            while _OPENED and sum(one.table.nbytes for one in _OPENED.values()) > room:
                _OPENED.pop(next(iter(_OPENED)))
            _OPENED[key] = log
        return _OPENED[key]

    @property
    def _options(self) -> dict[str, Any]:
        return {"rate": self.rate, "degrees": self.degrees, "topic": self.topic, "episode": self.episode}

    def _has_commands(self) -> bool:
        """True if the file has commands of some joint."""
        log = MotionLog.open(self.path, self.robot.model, columns=self.columns, commands=True, **self._options)
        return log.columns.places["command"] is not None

    @property
    def count(self) -> int:
        """Number of rows."""
        return len(self.log.table) if self.motion is None else len(self.motion)

    def rows(self, rows: slice) -> LogRows:
        """Range of rows on the joints' side; raises ValueRangeError if a file has no torques."""
        if self.motion is not None:
            m = self.motion
            return LogRows(m.time[rows], m.q[rows], None, None, np.asarray(m.tau)[rows])
        found = self.log.motion(self.log.table[rows])
        if found.tau is None and self._has_commands():
            raise ValueRangeError(f"{self.path}: {_HAS_COMMANDS}", _SERVOS)
        if found.tau is None:
            raise ValueRangeError(
                f"{self.path}: no torque for every joint. Name the columns JOINT.torque, or assign them: {{0}}; "
                "currents, JOINT.current, need {1}.",
                Argument("columns", {f"{self.robot.model.velocity_names[0]}.tau": "COLUMN"}),
                Argument("gain"),
            )
        return found if self.side is None else self.side.of_joints(found)

    def doubts(self) -> tuple[Doubt, ...]:
        """Doubts about all rows, without a model."""
        if self.motion is not None:
            return self.motion.doubts
        if self.side is None or self.side.is_of_joints:
            return self.log.doubts(self.robot.limits)
        return sided_doubts(self.log, self.side, self.robot.limits)

    def part_for_window(self, window: slice) -> tuple[LogSource, slice]:
        """Source to send to a worker, with the range of its rows: a motion without its other rows."""
        if self.motion is None or len(self.motion) == window.stop - window.start:
            return self, window
        return replace(self, motion=self.motion[window]), slice(0, window.stop - window.start)


_OPENED: dict[Any, MotionLog] = {}
"""Logs last decoded in this process, which their windows share."""
_MAX_BYTES_OPENED = 1 << 28
"""Maximum size of their tables [bytes]; the last one is kept whatever its size."""


@dataclass(frozen=True, eq=False)
class LogChecks:
    """Results of the checks of all rows of a log, and the rows that its windows leave out."""

    count: int
    doubts: tuple[Doubt, ...]
    wrong: Array  # times of wrong single rows [s]
    pauses: Array  # lengths of the pauses of the time stamps [s]

    @property
    def kinds(self) -> set[str]:
        """Kinds of the doubts."""
        return {one.kind for one in self.doubts}


def checks_of(log: LogSource) -> LogChecks:
    """Check all rows of a log; wrong single rows are left out if they are few."""
    c, count, doubts = Coordinates.from_model(log.robot.model), log.count, log.doubts()
    at = c.position_of[c.position_of >= 0]
    glitches = SingleRowGlitches(len(at), c.angular[at])
    for s in slices(count, _PORTION):
        first = max(0, s.start - OVERLAP)
        rows = log.rows(slice(first, s.stop))
        glitches.add(rows.time, rows.q[:, at])
    wrong = glitches.times()
    if 0 < len(wrong) <= max(1.0, _MAX_WRONG_ROWS * count):
        names = [log.robot.model.velocity_names[k] for k in np.flatnonzero(c.position_of >= 0)]
        others = [one for one in doubts if one.kind not in ("single-row", "stamp")]
        doubts = (*others, *row_doubts(glitches, names, left_out=True))
    else:
        wrong = wrong[:0]
    time = log.log.table[:, 0] if log.motion is None else log.motion.time
    return LogChecks(count, doubts, wrong, pause_lengths(time))


@dataclass(frozen=True, eq=False)
class WindowRows:
    """Rows of a window that are used, time (n,), q and tau (n, nv), and their samples on steady clocks."""

    time: Array
    q: Array
    tau: Array
    samples: tuple[SteadySamples, ...]
    count: int  # rows of the window, including those that are left out


def rows_of_window(log: LogSource, window: slice, checks: LogChecks) -> WindowRows:
    """Rows of a window without repeated rows, wrong rows and spikes; pauses that were closed up are reinserted.

    The result depends on the arguments alone.
    """
    rows, model = log.rows(window), log.robot.model
    whole = len(rows.time) == checks.count
    doubts = checks.kinds
    time, q, tau = rows.time, continuous(model, rows.q), np.asarray(rows.tau)
    kept = ~spikes(tau).any(axis=1) & ~np.isin(time, checks.wrong)
    if "repeated" in doubts:
        new = new_rows(q)
        if new is not None:
            kept &= new
    if "pause" in doubts:
        time = _with_pauses(time, q)
    if "held" in doubts:
        kept &= ~held_rows(rows.time, gaps(rows.time, q))
    if "dropout" in doubts:
        kept &= ~dropouts(time, tau, q).any(axis=1)
    time, q, tau = time[kept], rows.q[kept], tau[kept]
    if not whole and len(time) < MIN_SAMPLES:
        return WindowRows(time, q, tau, (), len(kept))
    samples = SteadySamples.pieces(time, continuous(model, q), tau, log.path)
    if not whole:
        samples = [replace(piece, cut=True) for piece in samples]
    return WindowRows(time, q, tau, tuple(samples), len(kept))


def _with_pauses(time: Array, q: Array) -> Array:
    """Times (n,) with the pauses that were closed up, where positions q (n, nv) are not held."""
    length = max(_MIN_CLOSED_PAUSE[0], _MIN_CLOSED_PAUSE[1] * float(np.median(np.diff(time))))
    moving_gaps = [gap.time for gap in gaps(time, q) if not gap.held]
    return time + length * np.searchsorted(moving_gaps, time)


def spread_windows(counts: Sequence[int]) -> list[list[slice]]:
    """Windows of logs with these numbers of rows: whole logs, or at most 49 windows spread evenly over every log.

    >>> [len(windows) for windows in spread_windows([100_000, 50_000])], len(spread_windows([3_600_000])[0])
    ([1, 1], 49)
    """
    if sum(counts) <= MOST_STATES:
        return [[slice(0, n)] for n in counts]
    most_windows = -(-MOST_STATES // WINDOW)
    logs = np.unique(np.linspace(0, len(counts) - 1, min(most_windows, len(counts))).astype(int)).tolist()
    total = sum(counts[k] for k in logs)
    shares = [0] * len(counts)
    for k in logs:
        shares[k] = max(1, round(most_windows * counts[k] / total))
    return [spread_rows(n, share, MOST_STATES // sum(shares)) for n, share in zip(counts, shares, strict=True)]


@dataclass(frozen=True, eq=False)
class ReadLog:
    """Log of a fit: results of its checks, and the rows of its windows; ``name`` is the path of one of several files."""

    name: str
    checks: LogChecks
    windows: tuple[WindowRows, ...]

    @cached_property
    def time(self) -> Array:
        """(n,) times of the rows [s]."""
        return np.concatenate([window.time for window in self.windows])

    @cached_property
    def q(self) -> Array:
        """(n, nv) positions of the rows."""
        return np.concatenate([window.q for window in self.windows])

    @cached_property
    def tau(self) -> Array:
        """(n, nv) torques of the rows."""
        return np.concatenate([window.tau for window in self.windows])

    @property
    def doubts(self) -> tuple[Doubt, ...]:
        """Doubts about all rows, without a model."""
        return self.checks.doubts

    @property
    def count(self) -> int:
        """Number of rows that were read; the windows leave out some of them."""
        return sum(window.count for window in self.windows)

    @property
    def gaps(self) -> Array:
        """Lengths of its pauses [s]: of the rows that are used, or of all time stamps if the log is not one window."""
        if "pause" in self.checks.kinds:  # closed up, so not split yet
            return np.zeros(0)
        return pause_lengths(self.time) if self.count == self.checks.count else self.checks.pauses

    @property
    def samples(self) -> list[SteadySamples]:
        """Samples of all windows, in order."""
        return [piece for window in self.windows for piece in window.samples]


def read_logs(
    sources: Sequence[LogSource], team: Workers, progress: Callable[[float], None]
) -> list[ReadLog | Failure]:
    """Check logs and read their windows, in the order of the logs; results do not depend on the workers."""
    checks = list(team.results(checks_of, sources, lambda share: progress(0.5 * share)))
    sound = {k: one for k, one in enumerate(checks) if not isinstance(one, Failure)}
    calls, owners = list[Callable[[], WindowRows]](), list[int]()
    for k, windows in zip(sound, spread_windows([one.count for one in sound.values()]), strict=True):
        calls += [partial(rows_of_window, *sources[k].part_for_window(window), sound[k]) for window in windows]
        owners += [k] * len(windows)
    rows = team.results(operator.call, calls, lambda share: progress(0.5 + 0.5 * share))
    windows_of: list[list[WindowRows | Failure]] = [[] for _ in sources]
    for k, window in zip(owners, rows, strict=True):
        windows_of[k].append(window)
    _OPENED.clear()
    files = sum(source.motion is None for source in sources)
    logs = list[ReadLog | Failure]()
    for source, check, results in zip(sources, checks, windows_of, strict=True):
        name = source.path if files > 1 and source.motion is None else ""
        logs.append(_read_log(name, check, results))
    return logs


def _read_log(name: str, checks: LogChecks | Failure, windows: Sequence[WindowRows | Failure]) -> ReadLog | Failure:
    """Log from its checks and windows; the first failure if one of them failed."""
    if isinstance(checks, Failure):
        return checks
    read = list[WindowRows]()
    for window in windows:
        if isinstance(window, Failure):
            return window
        read.append(window)
    return ReadLog(name, checks, tuple(read))


def steady_samples(logs: Sequence[ReadLog]) -> list[SteadySamples]:
    """Samples of all logs; each has the number of its log if logs have times in common."""
    spans = sorted((float(log.time[0]), float(log.time[-1])) for log in logs if len(log.time))
    common = any(after[0] <= before[1] for before, after in pairwise(spans))
    samples = list[SteadySamples]()
    for k, log in enumerate(logs, 1):
        number = k if common else 0
        samples += [replace(piece, log=number) for piece in log.samples]
    return samples
