"""Motion files read for one robot: columns assigned, rows decoded once and checked, with one row for each time.

The columns are those of :mod:`.motion_file`; :mod:`.differentiation` makes states of the rows, and :mod:`.motion` holds them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.doubts import Doubt, doubt
from ..core.errors import TrajectoryError, ValueRangeError
from ..core.estimation.single_row_glitches import OVERLAP
from ..core.glossary import complete
from ..core.numbers import number, printed, seconds
from ..core.text import Argument, Placeholder, ReadingNote, listed, spell
from ..core.typing import Array
from ..mechanics.joints.units import unit_of
from ..mechanics.model.limits import Limits
from ..mechanics.model.model import Model
from . import log_table
from .column_names import PARTS, date_note, is_called_seconds, split_unit, time_column
from .columns import Columns, MimicJointColumn, Reading, belongs
from .contradictions import Contradictions, stamp_doubts
from .coordinates import Coordinates
from .log_table import slices, table_of, windows, without_times
from .matching import varying_columns
from .motion_file import JoinedFile, MotionFile, open_motion_file, with_sums
from .plausibility import SURROUNDINGS, Instant, Origin, RecordedSteps, origin_of
from .readers.array_files import ArrayFile
from .readers.csv_reader import CsvFile

if TYPE_CHECKING:
    from .motion import Motion

_MOST = 10_000
"""Number of rows with one time above which the clock is considered stopped."""
_FEWEST, _REPEATED, _PAUSE = 20, 0.02, 3.0
"""Minimum rows, and fraction of zero steps, for rounded stamps; and number of grid steps that make a pause."""
_ROUNDED = 0.65
"""Largest deviation of a rounded stamp in grid steps: 0.5 for rounding, the rest for the error of the clock."""


@dataclass
class DuplicateTimestamps:
    """Merge rows of equal time: repeated rows are dropped, others are averaged."""

    dropped: int = 0
    averaged: int = 0
    first: float | None = None
    """First time with different rows."""

    def merge(self, table: Array, turning: Array, half_turn: Array, where: str) -> Array:
        """Reduce a table (n, k) to one row per time, in place; time is the first column. Raises TrajectoryError."""
        begin = end = 0
        while begin < len(table):
            stop = min(begin + log_table.ROWS, len(table))
            while stop < len(table) and table[stop, 0] == table[stop - 1, 0]:
                stop += 1
                if stop - begin - log_table.ROWS > _MOST:
                    raise TrajectoryError(
                        f"{where}: time stands at {float(table[stop - 1, 0])!r} for more than {_MOST} rows. Say how many rows "
                        "a second has, {0}, after removing the column of time.",
                        Argument("rate", Placeholder("HZ")),
                    )
            rows = self._merged(table[begin:stop], turning, half_turn, where)
            table[end : end + len(rows)] = rows
            begin, end = stop, end + len(rows)
        return table[:end]

    def _merged(self, rows: Array, turning: Array, half_turn: Array, where: str) -> Array:
        time = rows[:, 0]
        again = np.r_[False, time[1:] == time[:-1]]
        if not again.any():
            return rows
        same = again & np.r_[False, (rows[1:] == rows[:-1]).all(axis=1)]
        self.dropped += int(same.sum())
        rows, again = rows[~same], again[~same]
        if not again.any():
            return rows
        starts = np.flatnonzero(~again)
        counts = np.diff(np.r_[starts, len(rows)])
        spread = np.maximum.reduceat(rows, starts) - np.minimum.reduceat(rows, starts)
        at = np.flatnonzero(counts > 1)
        if (far := (spread[np.ix_(at, turning)] > half_turn).any(axis=1)).any():
            k = at[int(far.argmax())]
            raise TrajectoryError(
                f"{where}: rows of one time, {float(rows[starts[k], 0])!r}, differ by more than half a turn. "
                "Keep one of them."
            )
        self.first = float(rows[starts[at[0]], 0]) if self.first is None else self.first
        self.averaged += int(counts[at].sum())
        found = np.add.reduceat(rows, starts) / counts[:, None]
        found[:, 0] = rows[starts, 0]
        return np.asarray(found)

    def doubts(self) -> list[Doubt]:
        """Notes on dropped rows and averaged rows."""
        said = []
        if self.dropped:
            said.append(f"{self.dropped} row{'s that repeat' if self.dropped > 1 else ' that repeats'} the row before")
        if self.averaged and self.first is not None:
            first = printed(self.first)
            said.append(
                f"{self.averaged} rows with a time that others have too, first t = {first} s, but the mean of each time"
            )
        return [doubt("rows-left-out", what=what) for what in said]


def steady_times(stamps: Array) -> Array | None:
    """Reconstruct times (n,) from stamps rounded to a grid coarser than their steps; None without a steady clock.

    Between pauses, the times are the straight line through the stamps; each stamp must agree with it within rounding.
    """
    steps = np.diff(stamps)
    if len(steps) < _FEWEST or (steps < 0).any() or (steps == 0).mean() < _REPEATED:
        return None
    grid = float(steps[steps > 0].min(initial=np.inf))
    on_grid = np.abs(steps - grid * np.round(steps / grid)) <= 1e-6 * grid + 4 * np.spacing(np.abs(stamps[1:]))
    if not (np.isfinite(grid) and on_grid.all()):
        return None
    edges = [0, *(np.flatnonzero(steps > _PAUSE * grid) + 1).tolist(), len(stamps)]
    found = np.empty(len(stamps))
    for a, b in pairwise(edges):
        if b - a < _FEWEST:
            return None
        rows, times = np.arange(b - a) - 0.5 * (b - a - 1), stamps[a:b]
        middle = float(times.mean())
        slope = float(rows @ (times - middle)) / float(rows @ rows)
        found[a:b] = middle + slope * rows
        if np.abs(found[a:b] - times).max() > _ROUNDED * grid:
            return None
    return found if (np.diff(found) > 0).all() else None


# ── The log: blocks of complete rows

_MOST_STAMPS = 1 << 24
"""Number of rows whose stamps are inspected together: 128 MiB."""
_FIRST = 1 << 12
"""Number of rows used to detect rounded stamps."""
_NO_ROTATION = 1e-6  # norm of a quaternion below which it is invalid
_RUNS = 16, 1 << 12
"""Number of runs of a long log, and rows in each, used to assess rates and sampling."""
ASKED = ("time-step", "angle-unit", "degrees-option")
"""Kinds of notes in which a unit may be correct after all."""


@dataclass(frozen=True, eq=False)
class LogRows:
    """Consecutive samples of a motion, in SI units; ``dq``, ``ddq`` and ``tau`` are None if absent from the file."""

    time: Array
    """Times (n,) [s]."""
    q: Array
    """Coordinates (n, nq)."""
    dq: Array | None
    """Velocities (n, nv)."""
    ddq: Array | None
    """Accelerations (n, nv)."""
    tau: Array | None = None
    """Logged torques (n, nv) [N m or N], for comparison."""
    command: Array | None = None
    """Commanded positions (n, nv) [rad, m], NaN for joints without; None if absent or not read."""


@dataclass(frozen=True, eq=False)
class _Decoded:
    table: Array
    duplicates: DuplicateTimestamps
    clock: float | None
    """Rate of the steady clock that replaces rounded stamps [Hz]."""
    stamps: dict[float, float]
    """Times of rows dropped for a wrong stamp, with the delay of the stamp [s]."""
    contradictions: Contradictions
    steps: RecordedSteps
    mimic_joints: list[Doubt]
    """Doubts about the columns of mimic joints."""
    date: tuple[str, ...]
    """Sentence about the date of time 0 if the file's time counts from 1970."""
    epoch: int
    """Stamp of time 0 [ns since 1970]; 0 if time does not count from 1970."""


@dataclass(frozen=True, eq=False)
class MotionLog:
    """Motion log: a file whose header has been read; rows are decoded on first use.

    Examples
    --------
    >>> import twistwrench as tw
    >>> log = MotionLog.open(tw.robots.path_of("ur5").with_name("ur5_demo.csv"), tw.robots.ur5().model)
    >>> log.motion(log.table).q.shape, log.doubts()
    ((751, 6), ())
    """

    file: MotionFile
    """Source file."""
    columns: Columns
    """Assignment of the file's columns."""
    coordinates: Coordinates
    """Names and units of the robot's coordinates."""
    locked: tuple[str, ...] = ()
    """Locked joints."""
    unused: tuple[str, ...] = ()
    """Unused varying columns, which may belong to these joints."""
    of_source: tuple[Doubt, ...] = ()
    """Doubts about conventions of the programs and makers that write such files."""
    plan: bool = False
    """True if the file is known to be a plan and not a recording."""
    degrees: bool = False
    """True if the caller states that angles are in degrees, which confirms a unit in the header."""

    @classmethod
    def open(
        cls,
        path: str | Path | MotionFile,
        model: Model,
        *,
        degrees: bool = False,
        columns: Mapping[str, str] | None = None,
        rate: float | None = None,
        gain: Mapping[str, float] | None = None,
        topic: str | None = None,
        command_topic: str | None = None,
        episode: int | None = None,
        plan: bool = False,
        commands: bool = False,
    ) -> MotionLog:
        r"""Read and check the header of a motion file, and assign its columns.

        Parameters
        ----------
        path : str, Path or MotionFile
            A CSV file (formats: see :meth:`CsvFile.open <twistwrench.motion.readers.csv_reader.CsvFile.open>`), an archive of
            ``simulate --npz``, npz, npy, MAT, HDF5, parquet, feather, MCAP, or a ROS bag (with the extra ``logs``);
            several files of one motion as ``a.csv+b.csv``.
        columns : {name: column}, optional, assignment of columns that cannot be found by name
            ``{"elbow": "pos3", "elbow.vel": "w3"}``; likewise ``.acc``, ``.tau``, ``.current`` and ``time``.
            ``{"log.csv:elbow": "pos4"}`` applies only to the file with that path or name.
        rate : float, optional, sampling rate of a file without a time column [Hz]
        gain : {joint: float}, optional, torque per ampere, for torque columns that are currents [N m/A]
            ``joint.current``: only for columns that are currents by name or unit.
        topic : str, optional, topic of a ROS recording; ``NAME:reference`` is the reference of a controller's state
        command_topic : str, optional, topic of the commands in a ROS recording
        episode : int, optional, episode of a LeRobot dataset
        plan : bool, the file is a plan and not a recording, as for a JointTrajectory
        commands : bool, read commanded positions too

        Returns
        -------
        log : MotionLog

        Raises
        ------
        NotFoundError, TrajectoryError, UnknownNameError, ValueRangeError
            The message has the file, the line and the faulty text.

        Examples
        --------
        >>> import pathlib, tempfile
        >>> import twistwrench as tw
        >>> model = tw.robots.pendulum().model
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = pathlib.Path(folder, "log.csv")
        ...     _ = path.write_text("encoder [deg]\n0\n90\n")
        ...     log = MotionLog.open(path, model, columns={model.leaders[0].joint.name: "encoder"}, rate=100.0)
        ...     motion = log.motion(log.table)
        >>> motion.time.tolist(), motion.q.round(6).tolist()
        ([0.0, 0.01], [[0.0], [1.570796]])
        """
        if model.nv == 0:
            raise ValueRangeError(
                f"robot {model.name!r} has no joint that moves, so no motion fits. Lock fewer joints."
            )
        if rate is not None and not (math.isfinite(rate) and rate > 0):
            raise ValueRangeError(f"rate {rate!r} is not a number of rows a second. Give one above 0, such as 1000.")
        file = open_motion_file(path, topic, episode, command_topic) if isinstance(path, str | Path) else path
        if isinstance(file, JoinedFile) and not columns:
            file.check_columns()
        file = with_sums(file, columns or {})
        dataset = file.dataset if isinstance(file, ArrayFile) else ""
        degrees = degrees or dataset == "degrees"
        coordinates = Coordinates.from_model(model)
        where = f"{file.path}: line {file.header_line}" if isinstance(file, CsvFile) else str(file.path)
        reading = Reading(file.path, columns, rate, degrees, gain, model.all_locked, commands)
        found = Columns.from_header(file.header, coordinates, where, reading, file.first)
        doubts = _dataset_doubts(file, found, coordinates, degrees=degrees) if dataset else []
        if not columns and _FANUC.search(model.name.lower()) and {f"J{k}" for k in range(1, 7)} <= set(file.header):
            third = coordinates.names[2]
            doubts.append(doubt("fanuc-j3", [third], joint=third, column=Argument("columns", {third: "J3+J2"})))
        plan = plan or (isinstance(file, ArrayFile) and file.plan)
        log = cls(file, found, coordinates, tuple(model.locked), (), tuple(doubts), plan, degrees)
        unused = varying_columns(file.header, found.extra, file.first) if log.held else ()
        return replace(log, unused=tuple(unused))

    @classmethod
    def from_motion(cls, motion: Motion) -> MotionLog:
        """Log in memory of a motion, with the rates that it was given; measured torques only if it is not a plan.

        Parameters
        ----------
        motion : Motion

        Returns
        -------
        log : MotionLog

        Examples
        --------
        >>> import twistwrench as tw
        >>> t = np.linspace(0, 1, 11)
        >>> MotionLog.from_motion(tw.Motion(t, t[:, None] ** 2, robot=tw.robots.pendulum())).table.shape
        (11, 2)
        """
        names, given = motion.coordinates, {"q": motion.q}
        if motion.derived != "positions":
            given["dq"] = motion.dq
        if not motion.derived:
            given["ddq"] = motion.ddq
        if motion.tau is not None and not motion.plan:
            given["tau"] = motion.tau
        header = [time_column(names.names)]
        for part in given:
            header += names.headers(part)
        table = np.column_stack([motion.time, *given.values()])
        file = ArrayFile.from_table(Path("motion"), header, table, table.nbytes)
        return cls.open(file, motion.robot.model, plan=motion.plan)

    @property
    def held(self) -> tuple[str, ...]:
        """Locked joints without a column in the file."""
        named = [split_unit(column)[0] for column in self.columns.of_locked]
        return tuple(joint for joint in self.locked if not any(belongs(name, [joint]) for name in named))

    @property
    def path(self) -> Path:
        """Path of the file."""
        return self.file.path

    @property
    def size(self) -> int:
        """Size of the file [bytes]."""
        return self.file.size

    @property
    def table(self) -> Array:
        """Rows of the log (n, columns), one for each time: time in seconds, other columns in the units of the file.

        The file is decoded on first use. This raises TrajectoryError if a value is not a finite number, a row is
        truncated or time decreases. Rows with only a wrong stamp are dropped.
        """
        return self._decoded.table

    @property
    def epoch(self) -> int:
        """Stamp of time 0 [ns], since 1970 or on the recording's clock; 0 if the file has none."""
        return self._decoded.epoch

    @cached_property
    def _decoded(self) -> _Decoded:
        table = self.file.table(self.columns.used)
        if not len(table):
            line = self.file.header_line if isinstance(self.file, CsvFile) else 0
            raise TrajectoryError(f"{self.path}: no rows after the header of line {line}. Give at least one.")
        if self.columns.counted:
            timed = (np.c_[self.columns.seconds * np.arange(s.start, s.stop), table[s]] for s in slices(len(table)))
            table = table_of(timed, table.shape[1] + 1, self.path)
        elif self.columns.seconds != 1.0:
            table[:, 0] *= self.columns.seconds
        begin, epoch = float(table[0, 0]), self.file.epoch if isinstance(self.file, ArrayFile) else 0
        if date := date_note(begin):
            table[:, 0] -= begin
            epoch = round(begin * 1e9)
        clock = None if self.columns.counted else self._steady_clock(table)
        self._check_rows(table)
        turning, duplicates = np.flatnonzero(self.coordinates.angular), DuplicateTimestamps()
        half_turn, where = math.pi / self.columns.angle[turning], self.columns.places["q"]
        table = duplicates.merge(
            table, np.zeros(0, int) if where is None else where[turning], half_turn, str(self.path)
        )
        stamps, found = dict[float, float](), self._contradictions(table, dated=bool(epoch))
        while wrong := found.glitches.stamps():
            stamps |= wrong
            table = without_times(table, wrong)
            found = self._contradictions(table, dated=bool(epoch))
        found.runs = [self.motion(run) for run in log_table.excerpts(table, *_RUNS)]
        portions = ((self.motion(table[s]), table[s]) for s in slices(len(table)))
        mimic = mimic_doubts(self.columns.mimic_joints, portions)
        steps = RecordedSteps(self.coordinates, [(run.time, run.q) for run in found.runs])
        for rows, inner in windows(len(table), log_table.ROWS, SURROUNDINGS):
            steps.add(table[rows, 0], self.columns.si_values(table[rows], "q"), inner)
        return _Decoded(table, duplicates, clock, stamps, found, steps, mimic, date, epoch)

    @cached_property
    def origin(self) -> Origin:
        """Plan, log or either, by what the file has."""
        runs = log_table.excerpts(self.table, *_RUNS)
        at = self.columns.places["q"]
        return origin_of(
            [(run[:, at if at is not None else []], self.columns.si_values(run, "tau")) for run in runs], plan=self.plan
        )

    @property
    def instants(self) -> tuple[Instant, ...]:
        """Instants at which rows are missing, repeated or wrong, or a speed changes from one row to the next."""
        return tuple(self._decoded.steps.instants)

    def _contradictions(self, table: Array, *, dated: bool) -> Contradictions:
        columns = self.columns
        of_seconds = columns.time_stated or is_called_seconds(columns.header[columns.time])
        found = Contradictions(
            self.coordinates,
            time_stated=columns.time_stated,
            may_count_rows=not (columns.counted or of_seconds or dated),
            angle=columns.angle,
            angle_stated=columns.angle_stated & ((columns.angle != math.radians(1.0)) | self.degrees),
        )
        for s in slices(len(table)):
            first = max(0, s.start - OVERLAP)
            rows = table[first : s.stop]
            found.add(rows[:, 0], columns.si_values(rows, "q"), s.start - first)
        return found

    def motion(self, table: Array) -> LogRows:
        """Convert rows of the log to q, dq, ddq and torques, in SI units.

        Parameters
        ----------
        table : (n, columns) array, :attr:`table` or some of its rows

        Returns
        -------
        rows : LogRows
        """
        q, dq, ddq, tau, command = (self.columns.si_values(table, part) for part in PARTS)
        if tau is not None and self.columns.of_motors:
            for at, A, _ in self.coordinates.coupled:
                tau[:, at] = tau[:, at] @ A
        return LogRows(table[:, 0].copy(), q, dq, ddq, tau, command)

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences about assumptions: from the header, and from the rows once they are decoded."""
        columns, last = self.columns, self._decoded
        said: list[str] = [*columns.notes, *map(ReadingNote, last.date)]
        if columns.of_locked:
            said.append(f"Columns of locked joints are ignored: {', '.join(columns.of_locked)}.")
        if columns.extra:
            said.append(f"Columns that are not coordinates of this robot are ignored: {', '.join(columns.extra)}.")
        if last.clock is not None:
            said.append(
                "Time stamps are rounded so that several rows share one: a steady clock of "
                f"{number(last.clock, 4)} Hz is taken."
            )
        said += self.file.notes
        return (*said, *(str(d) for d in self.doubts() if d.level == "note" and d.kind not in ASKED))

    def doubts(
        self, limits: Limits | None = None, *, own: Limits | None = None, glitches: bool = True
    ) -> tuple[Doubt, ...]:
        """Doubts about the log, without a model: contradictions, sampling, and dropped rows.

        Parameters
        ----------
        own : Limits, optional, of the robot's file; steps are judged by it where ``limits`` were given with their unit
        glitches : bool, include single wrong rows; False if smoothing reports them in more detail

        Returns
        -------
        doubts : tuple of Doubt
        """
        held, moved, last = self.held, len(self.coordinates.velocity_names), self._decoded
        words: dict[str, Any] = {
            "checked": f"{moved} of {moved + len(self.locked)}",
            "held": listed(held, 6),
            "columns": listed(self.unused, 6),
        }
        misread = [doubt("unused-columns", held, **words)] if self.unused else []
        found = [
            self._with_listed_column(each)
            for each in last.contradictions.doubts(limits, glitches=glitches, origin=self.origin)
        ]
        left_out = *last.duplicates.doubts(), *stamp_doubts(last.stamps, left_out=True)
        judged = limits
        if limits is not None and own is not None:
            judged = replace(limits, velocity=np.where(limits.has_unit("velocity"), own.velocity, limits.velocity))
        steps = last.steps.doubts(judged, self.origin, found)
        return (*misread, *self.of_source, *found, *steps, *last.mimic_joints, *left_out)

    def _with_listed_column(self, found: Doubt) -> Doubt:
        """Doubt with the column of its joint, if that is the caller's by the order of a list, which may be another order."""
        names, places = self.coordinates.names, self.columns.places["q"]
        named = [joint for joint in found.joints if joint in names]
        if not self.columns.listed or not found.refuses or not named or places is None:
            return found
        joint = named[0]
        column = self.columns.header[int(places[names.index(joint)])]
        order, name = spell(Argument("columns")), spell(Argument("columns", {joint: "COLUMN"}))
        return replace(
            found,
            sentence=f"{found.sentence}. By the order of {order}, {joint} has the column {column}; if it has another, "
            f"name it, {name}",
        )

    def _steady_clock(self, table: Array) -> float | None:
        """Replace rounded stamps by a steady clock and return its rate [Hz]; the first rows show the rounding."""
        first = table[:_FIRST]
        again = np.diff(first[:, 0]) == 0
        differ = (first[1:, 1:] != first[:-1, 1:]).any(axis=1)
        if len(table) > _MOST_STAMPS or not (again & differ).any() or 2 * (again & differ).sum() < again.sum():
            return None
        times = steady_times(np.array(table[:, 0]))
        if times is None:
            return None
        table[:, 0] = times
        return 1.0 / float(np.median(np.diff(times)))

    def _check_rows(self, table: Array) -> None:
        """Raise TrajectoryError if time decreases or a quaternion is zero."""
        before = -math.inf
        for s in slices(len(table)):
            rows = table[s]
            times = np.r_[before, rows[:, 0]]
            if (back := times[1:] < times[:-1]).any():
                k = int(back.argmax())
                raise TrajectoryError(
                    f"{self.path}: {self.file.place(s.start + k)}, column {self.columns.header[0]!r}: time "
                    f"{float(times[k + 1])!r} comes before {float(times[k])!r} of the row above. Sort the rows by time, and "
                    "give one recording at a time."
                )
            before = times[-1]
            for place in self.columns.quaternions:
                none = np.linalg.norm(rows[:, place], axis=1) < _NO_ROTATION
                if none.any():
                    raise TrajectoryError(
                        f"{self.path}: {self.file.place(s.start + int(none.argmax()))}, column "
                        f"{self.columns.header[place[0]]!r}: the quaternion is zero, which is not a rotation. Write 1, 0, 0, 0 "
                        "for none, or remove the row."
                    )


# ── Conventions of the programs that write some files

_FANUC = re.compile(r"fanuc|crx|lr_?mate|^m_?\d+i|^r_?2000")
"""Names of Fanuc robots."""


_MOTORS = {"shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll"}
"""Motors of the arms SO-100 and SO-101 in LeRobot datasets."""


def _dataset_doubts(file: MotionFile, columns: Columns, coordinates: Coordinates, *, degrees: bool) -> list[Doubt]:
    """Doubts about a LeRobot dataset; raises TrajectoryError if units are unknown or need its calibration file."""
    at, stated = columns.places["q"], columns.angle_stated
    if at is None:
        return []
    asked = [k for k in range(len(at)) if coordinates.angular[k] and not stated[k]]
    cells = {k: columns.header[int(at[k])] for k in asked}
    if asked and isinstance(file, ArrayFile) and file.dataset == "range":
        raise TrajectoryError(
            f"{file.path}: by its metadata, positions are from -100 to 100 of each motor's range, and only its calibration "
            "file maps them to angles. Record again with degrees, or convert them."
        )
    largest = {k: float(np.abs(file.first(file.header.index(cells[k]))).max(initial=0.0)) for k in asked}
    if not degrees and any(x > math.tau for x in largest.values()):
        k = max(asked, key=lambda k: largest[k])
        raise TrajectoryError(
            f"{file.path}: {cells[k]} reaches {number(largest[k])}, which is not an angle in radians. LeRobot's SO arms record "
            "degrees since February 2026, and before that -100 to 100 of each motor's range, which needs the calibration "
            "file. If these are degrees, add: {0}",
            Argument("degrees", True),
        )
    grippers = [coordinates.names[k] for k in asked if "gripper" in cells[k].lower()] if degrees else []
    if grippers:
        raise TrajectoryError(
            f"{file.path}: the gripper's column is from 0 to 100 of its range, and not an angle. Hold it still: {{0}}",
            Argument("lock", dict.fromkeys(grippers, 0)),
        )
    joints = [coordinates.names[k] for k in asked]
    if degrees and asked:
        return [doubt("dataset-zero", joints)]
    if not asked or not isinstance(file, ArrayFile) or file.dataset != "unknown":
        return []
    own = bool(_MOTORS & {part for cell in cells.values() for part in cell.split(".")})
    usual = ", although LeRobot records these motors in degrees or in shares of their range" if own else ""
    return [doubt("dataset-unit", joints, level="unsure" if own else "note", named=listed(joints, 6), usual=usual)]


# ── Columns of mimic joints, compared with those of their leaders

_SHARE = 0.1
"""Fraction of a joint's travel; smaller deviations are play or coupling errors."""
_LEAST = {True: 0.02, False: 0.002}
"""Smallest reported deviation of rotating [rad] and sliding [m] joints."""


def mimic_doubts(columns: Sequence[MimicJointColumn], portions: Iterable[tuple[LogRows, Array]]) -> list[Doubt]:
    """Doubts about mimic joints whose columns deviate from the coupling to their leaders.

    ``portions`` are rows of the log, each with the table that they come from.
    """
    least, most = np.full(len(columns), math.inf), np.full(len(columns), -math.inf)
    off = [(0.0, 0.0)] * len(columns)  # largest deviation of each, and its time
    for motion, table in portions if columns else ():
        for k, (follower, column, factor) in enumerate(columns):
            logged, led = factor * table[:, column], follower.ratio * motion.q[:, follower.leader] + follower.offset
            least[k] = min(least[k], logged.min(), led.min())
            most[k] = max(most[k], logged.max(), led.max())
            distance = np.abs(logged - led)
            row = int(distance.argmax())
            off[k] = max(off[k], (float(distance[row]), float(motion.time[row])))
    return [
        doubt(
            "mimic",
            [follower.name],
            joint=follower.name,
            distance=f"{number(distance)} {unit_of('q', follower.angular)}",
            time=seconds(when),
        )
        for k, ((follower, _, _), (distance, when)) in enumerate(zip(columns, off, strict=True))
        if distance > max(_LEAST[follower.angular], _SHARE * float(most[k] - least[k]))
    ]


complete(globals())
