"""Windows of logs: all rows are checked, and at most 200,000 samples of all logs are fitted.

Short logs are one window each; windows of longer logs are spread evenly over every log. Each window becomes samples on a
steady clock of its own, so that filters settle at its ends as at a pause. Windows are independent of one another: a loop,
processes, or a cluster may read them.
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
_MAX_WRONG_SHARE = 0.01
"""Largest share of single-row glitches that are removed from a log."""
_MIN_CLOSED_PAUSE = 0.06
"""Least length of a pause with closed-up time stamps [s]."""
_MIN_CLOSED_PAUSE_STEPS = 6.0
"""Least length of such a pause, in usual steps."""
_ROWS_PER_CHECK = MOST_STATES
"""Number of rows that are checked together, to limit memory."""
_COMMANDS_MESSAGE = (
    "no torque for every joint; the log has commands: {0} identifies gains, friction and armature from them. If it has "
    "torques, too, name their columns JOINT.torque."
)
"""End of a message on a log without torques; {0} is the option :data:`_IDENTIFY_SERVOS`."""
_IDENTIFY_SERVOS = Argument("identify_servos", None, option="from-commands")

Log: TypeAlias = Motion | str | Path


@dataclass(frozen=True, eq=False)
class LogSource:
    """Log given by a file and its reading options (as for :func:`read_motion`), or by a motion in memory."""

    robot: Robot
    path: str
    """Path of the file; the name in messages for a motion in memory."""
    columns: Mapping[str, str] | None = None
    rate: float | None = None
    degrees: bool = False
    gain: Mapping[str, float] | None = None
    topic: str | None = None
    episode: int | None = None
    side: MotorSide | None = None
    """Relation of the log's columns to the joints; None for a log of the joints."""
    motion: Motion | None = None
    """Motion in memory; None for a file."""

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
                raise ShapeError(f"identify: {name} has {_COMMANDS_MESSAGE}", _IDENTIFY_SERVOS)
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
        # everything that the decoded log depends on is in its key
        columns = tuple(sorted((self.columns or {}).items()))
        gain = tuple(sorted((self.gain or {}).items()))
        file = Path(self.path)
        modification_time = file.stat().st_mtime_ns if file.is_file() else 0
        options = self._options
        motor_names = () if self.side is None else self.side.names
        drive_names = self.robot.model.drive_names
        key = (self.path, modification_time, drive_names, motor_names, columns, gain, *options.values())
        if key not in _OPENED_LOGS:
            options |= {"columns": self.columns, "gain": self.gain}
            log = open_log(self.path, self.robot.model, self.side, **options)
            free_bytes = _MAX_BYTES_OPENED - log.table.nbytes  # a log that cannot be decoded raises here
            opened_bytes = sum(opened.table.nbytes for opened in _OPENED_LOGS.values())
            while _OPENED_LOGS and opened_bytes > free_bytes:
                oldest_key = next(iter(_OPENED_LOGS))
                oldest_log = _OPENED_LOGS.pop(oldest_key)
                opened_bytes -= oldest_log.table.nbytes
            _OPENED_LOGS[key] = log
        return _OPENED_LOGS[key]

    @property
    def _options(self) -> dict[str, Any]:
        """Reading options that can be part of a key."""
        return {"rate": self.rate, "degrees": self.degrees, "topic": self.topic, "episode": self.episode}

    def _has_commands(self) -> bool:
        """True if the file has commands of some joint."""
        log = MotionLog.open(self.path, self.robot.model, columns=self.columns, commands=True, **self._options)
        return log.columns.places["command"] is not None  # places of columns, by quantity

    @property
    def count(self) -> int:
        """Number of rows."""
        return len(self.log.table) if self.motion is None else len(self.motion)

    def rows(self, rows: slice) -> LogRows:
        """Range of rows, with torques at the joints; raises ValueRangeError if a file has no torques."""
        if self.motion is not None:
            tau = np.asarray(self.motion.tau)
            return LogRows(self.motion.time[rows], self.motion.q[rows], None, None, tau[rows])
        log_rows = self.log.motion(self.log.table[rows])
        if log_rows.tau is None and self._has_commands():
            raise ValueRangeError(f"{self.path}: {_COMMANDS_MESSAGE}", _IDENTIFY_SERVOS)
        if log_rows.tau is None:
            raise ValueRangeError(
                f"{self.path}: no torque for every joint. Name the columns JOINT.torque, or assign them: {{0}}; "
                "currents, JOINT.current, need {1}.",
                Argument("columns", {f"{self.robot.model.velocity_names[0]}.tau": "COLUMN"}),
                Argument("gain"),
            )
        return log_rows if self.side is None else self.side.of_joints(log_rows)

    def doubts(self) -> tuple[Doubt, ...]:
        """Doubts about all rows that need no model of the dynamics."""
        if self.motion is not None:
            return self.motion.doubts
        if self.side is None or self.side.is_of_joints:
            return self.log.doubts(self.robot.limits)
        return sided_doubts(self.log, self.side, self.robot.limits)

    def part_for_window(self, window: slice) -> tuple[LogSource, slice]:
        """Source to send to a worker, and the rows of the window in this source.

        A motion in memory is cut to the window, so that only these rows are sent.
        """
        row_count = window.stop - window.start
        if self.motion is None or len(self.motion) == row_count:
            return self, window
        return replace(self, motion=self.motion[window]), slice(0, row_count)


_OPENED_LOGS: dict[Any, MotionLog] = {}
"""Logs last decoded in this process; all windows of a log share it."""
_MAX_BYTES_OPENED = 1 << 28
"""Maximum size of the tables of opened logs [bytes]; the last log is kept whatever its size."""


@dataclass(frozen=True, eq=False)
class LogChecks:
    """Results of the checks of all rows of a log, and the rows that its windows leave out."""

    count: int  # number of rows
    doubts: tuple[Doubt, ...]
    wrong_times: Array  # times of wrong single rows that are left out [s]
    pause_lengths: Array  # lengths of the pauses of the time stamps [s]

    @property
    def kinds(self) -> set[str]:
        """Kinds of the doubts."""
        return {doubt.kind for doubt in self.doubts}


def checks_of(log: LogSource) -> LogChecks:
    """Check all rows of a log; wrong single rows are left out if they are few."""
    coordinates = Coordinates.from_model(log.robot.model)
    count = log.count
    doubts = log.doubts()
    has_position = coordinates.position_of >= 0  # mask of velocities with a coordinate of their own
    columns = coordinates.position_of[has_position]
    glitches = SingleRowGlitches(len(columns), coordinates.angular[columns])
    for portion in slices(count, _ROWS_PER_CHECK):
        first_row = max(0, portion.start - OVERLAP)
        rows = log.rows(slice(first_row, portion.stop))
        glitches.add(rows.time, rows.q[:, columns])
    wrong_times = glitches.times()
    max_wrong_rows = max(1.0, _MAX_WRONG_SHARE * count)
    if 0 < len(wrong_times) <= max_wrong_rows:
        names = [log.robot.model.velocity_names[k] for k in np.flatnonzero(has_position)]
        # doubts about single rows are repeated with the remark that the rows are left out
        other_doubts = [doubt for doubt in doubts if doubt.kind not in ("single-row", "stamp")]
        doubts = (*other_doubts, *row_doubts(glitches, names, left_out=True))
    else:
        wrong_times = wrong_times[:0]  # all rows stay
    time = log.log.table[:, 0] if log.motion is None else log.motion.time  # of all rows
    return LogChecks(count, doubts, wrong_times, pause_lengths(time))


@dataclass(frozen=True, eq=False)
class WindowRows:
    """Used rows of a window, and their samples on steady clocks."""

    time: Array  # (n,) [s]
    q: Array  # (n, nq)
    tau: Array  # (n, nv)
    samples: tuple[SteadySamples, ...]  # empty if a part of a log has too few rows
    count: int  # number of rows of the window, including those that are left out


def rows_of_window(log: LogSource, window: slice, checks: LogChecks) -> WindowRows:
    """Rows of a window without repeated rows, wrong rows and spikes; pauses that were closed up are reinserted.

    The result depends on the arguments alone.
    """
    rows = log.rows(window)
    model = log.robot.model
    is_whole_log = len(rows.time) == checks.count
    time, q, tau = rows.time, continuous(model, rows.q), np.asarray(rows.tau)
    is_kept = ~spikes(tau).any(axis=1)
    is_kept &= ~np.isin(time, checks.wrong_times)
    if "repeated" in checks.kinds:
        is_new = new_rows(q)
        if is_new is not None:
            is_kept &= is_new
    if "pause" in checks.kinds:
        time = _with_pauses(time, q)
    if "held" in checks.kinds:
        is_kept &= ~held_rows(rows.time, gaps(rows.time, q))
    if "dropout" in checks.kinds:
        is_kept &= ~dropouts(time, tau, q).any(axis=1)
    time, q, tau = time[is_kept], rows.q[is_kept], tau[is_kept]
    count = len(is_kept)
    if not is_whole_log and len(time) < MIN_SAMPLES:
        return WindowRows(time, q, tau, (), count)
    samples = SteadySamples.pieces(time, continuous(model, q), tau, log.path)
    if not is_whole_log:
        samples = [replace(piece, cut=True) for piece in samples]
    return WindowRows(time, q, tau, tuple(samples), count)


def _with_pauses(time: Array, q: Array) -> Array:
    """Times (n,) with the pauses that were closed up, which are steps of q (n, nq) without held rows.

    Their true lengths are unknown; the least length of a pause stands for each.
    """
    usual_step = float(np.median(np.diff(time)))
    pause_length = max(_MIN_CLOSED_PAUSE, _MIN_CLOSED_PAUSE_STEPS * usual_step)
    pause_times = [gap.time for gap in gaps(time, q) if not gap.held]
    pauses_before = np.searchsorted(pause_times, time)  # number of pauses before each row
    return time + pause_length * pauses_before


def spread_windows(counts: Sequence[int]) -> list[list[slice]]:
    """Windows of logs with these numbers of rows: whole logs, or at most 49 windows spread evenly over every log.

    >>> [len(windows) for windows in spread_windows([100_000, 50_000])], len(spread_windows([3_600_000])[0])
    ([1, 1], 49)
    """
    if sum(counts) <= MOST_STATES:
        return [[slice(0, row_count)] for row_count in counts]
    max_windows = -(-MOST_STATES // WINDOW)  # rounded up
    # if there are more logs than windows, evenly spread logs are used
    used_count = min(max_windows, len(counts))
    evenly_spread = np.linspace(0, len(counts) - 1, used_count).astype(int)
    used_logs = np.unique(evenly_spread).tolist()  # indices of logs
    used_rows = sum(counts[k] for k in used_logs)
    window_counts = [0] * len(counts)
    for k in used_logs:
        windows_of_share = round(max_windows * counts[k] / used_rows)
        window_counts[k] = max(1, windows_of_share)
    rows_per_window = MOST_STATES // sum(window_counts)
    windows_of_logs = []
    for row_count, window_count in zip(counts, window_counts, strict=True):
        windows_of_logs.append(spread_rows(row_count, window_count, rows_per_window))
    return windows_of_logs


@dataclass(frozen=True, eq=False)
class ReadLog:
    """Log of a fit: results of its checks, and the rows of its windows."""

    name: str
    """Path of the log; empty for the only file, and for a motion in memory."""
    checks: LogChecks
    windows: tuple[WindowRows, ...]

    @cached_property
    def time(self) -> Array:
        """(n,) times of the rows [s]."""
        return np.concatenate([window.time for window in self.windows])

    @cached_property
    def q(self) -> Array:
        """(n, nq) coordinates of the rows."""
        return np.concatenate([window.q for window in self.windows])

    @cached_property
    def tau(self) -> Array:
        """(n, nv) torques of the rows."""
        return np.concatenate([window.tau for window in self.windows])

    @property
    def doubts(self) -> tuple[Doubt, ...]:
        """Doubts about all rows that need no model of the dynamics."""
        return self.checks.doubts

    @property
    def count(self) -> int:
        """Number of rows that were read; the windows leave out some of them."""
        return sum(window.count for window in self.windows)

    @property
    def gaps(self) -> Array:
        """Lengths of the log's pauses [s], of the used rows if the log is one window, otherwise of all time stamps."""
        if "pause" in self.checks.kinds:  # a doubt about closed-up pauses, which have no gaps in time
            return np.zeros(0)
        is_one_window = self.count == self.checks.count
        return pause_lengths(self.time) if is_one_window else self.checks.pause_lengths

    @property
    def samples(self) -> list[SteadySamples]:
        """Samples of all windows, in order."""
        return [piece for window in self.windows for piece in window.samples]


def read_logs(
    sources: Sequence[LogSource], team: Workers, progress: Callable[[float], None]
) -> list[ReadLog | Failure]:
    """Check logs and read their windows, in the order of the logs; results do not depend on the workers."""
    checks = list(team.results(checks_of, sources, lambda share: progress(0.5 * share)))
    # by index of the log
    readable_checks = {k: check for k, check in enumerate(checks) if not isinstance(check, Failure)}
    windows_of_logs = spread_windows([check.count for check in readable_checks.values()])
    calls = list[Callable[[], WindowRows]]()
    log_of_call = list[int]()  # index of the log of each call
    for (k, check), windows in zip(readable_checks.items(), windows_of_logs, strict=True):
        for window in windows:
            part, part_window = sources[k].part_for_window(window)
            calls.append(partial(rows_of_window, part, part_window, check))
            log_of_call.append(k)
    results = team.results(operator.call, calls, lambda share: progress(0.5 + 0.5 * share))
    results_of_logs: list[list[WindowRows | Failure]] = [[] for _ in sources]
    for k, result in zip(log_of_call, results, strict=True):
        results_of_logs[k].append(result)
    _OPENED_LOGS.clear()  # the memory is free again
    file_count = sum(source.motion is None for source in sources)
    logs = list[ReadLog | Failure]()
    for source, check_or_failure, results_of_log in zip(sources, checks, results_of_logs, strict=True):
        is_named = file_count > 1 and source.motion is None
        name = source.path if is_named else ""
        logs.append(_read_log(name, check_or_failure, results_of_log))
    return logs


def _read_log(name: str, checks: LogChecks | Failure, windows: Sequence[WindowRows | Failure]) -> ReadLog | Failure:
    """Log from its checks and windows, or the first failure among them."""
    if isinstance(checks, Failure):
        return checks
    read_windows = list[WindowRows]()
    for window in windows:
        if isinstance(window, Failure):
            return window
        read_windows.append(window)
    return ReadLog(name, checks, tuple(read_windows))


def steady_samples(logs: Sequence[ReadLog]) -> list[SteadySamples]:
    """Samples of all logs; each has the number of its log if logs have times in common, otherwise 0."""
    spans = sorted((float(log.time[0]), float(log.time[-1])) for log in logs if len(log.time))
    have_common_times = False
    for (_, end), (next_begin, _) in pairwise(spans):
        if next_begin <= end:
            have_common_times = True
    samples = list[SteadySamples]()
    for k, log in enumerate(logs, 1):
        number = k if have_common_times else 0
        samples += [replace(piece, log=number) for piece in log.samples]
    return samples
