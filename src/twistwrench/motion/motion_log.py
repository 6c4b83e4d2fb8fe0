"""Motion files read for one robot: columns assigned, rows decoded once and checked, with one row for each time.

The columns are those of :mod:`.motion_file`; :mod:`.differentiation` makes states of the rows, and :mod:`.motion` holds them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.doubts import Doubt, doubt
from ..core.errors import TrajectoryError, ValueRangeError
from ..core.estimation.single_row_glitches import OVERLAP
from ..core.glossary import complete
from ..core.numbers import number
from ..core.text import Argument, ReadingNote, listed, spell
from ..core.typing import Array
from ..mechanics.model.limits import Limits
from ..mechanics.model.model import Model
from . import log_table
from .column_names import PARTS, date_note, is_called_seconds, split_unit, time_column
from .columns import Columns, Reading, belongs
from .contradictions import Contradictions, stamp_doubts
from .coordinates import Coordinates
from .log_checks.log_conventions import dataset_doubts, fanuc_doubts
from .log_checks.mimic_columns import mimic_doubts
from .log_checks.time_stamps import DuplicateTimestamps, steady_times
from .log_table import slices, table_of, windows, without_times
from .matching import varying_columns
from .motion_file import JoinedFile, MotionFile, open_motion_file, with_sums
from .plausibility import SURROUNDINGS, Instant, Origin, RecordedSteps, origin_of
from .readers.columnar_file import ArrayFile
from .readers.csv_reader import CsvFile

if TYPE_CHECKING:
    from .motion import Motion

_MAX_STAMPS = 1 << 24
"""Largest number of rows whose stamps are inspected, since they are inspected together: 128 MiB."""
_ROUNDING_ROWS = 1 << 12
"""Number of rows used to detect rounded stamps."""
_MIN_QUATERNION_NORM = 1e-6
"""Norm of a quaternion below which it is not a rotation."""
_RUN_COUNT = 16
"""Number of runs of a long log by which rates and sampling are judged."""
_ROWS_OF_RUN = 1 << 12
"""Number of rows in each of these runs."""
_MAX_LISTED = 6
"""Largest number of joints or columns that a doubt names."""
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
class _DecodedRows:
    """Rows of a log and what was found in them."""

    table: Array
    """Rows (n, columns), one for each time."""
    duplicates: DuplicateTimestamps
    """Rows that repeat a time, and are left out."""
    clock: float | None
    """Rate of the steady clock that replaces rounded stamps [Hz]; None if stamps are not rounded."""
    wrong_stamps: dict[float, float]
    """Delays of wrong stamps [s], by the times of their rows, which are dropped."""
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
    """Unused varying columns, which may belong to locked joints."""
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
        if isinstance(file, ArrayFile):
            degrees = degrees or file.dataset == "degrees"
            plan = plan or file.plan
        coordinates = Coordinates.from_model(model)
        where = str(file.path)
        if isinstance(file, CsvFile):
            where = f"{file.path}: line {file.header_line}"
        reading = Reading(file.path, columns, rate, degrees, gain, model.all_locked, commands)
        assigned_columns = Columns.from_header(file.header, coordinates, where, reading, file.first)
        doubts = dataset_doubts(file, assigned_columns, coordinates, degrees=degrees)
        if not columns:
            doubts += fanuc_doubts(file, model, coordinates)
        log = cls(
            file,
            assigned_columns,
            coordinates,
            locked=tuple(model.locked),
            of_source=tuple(doubts),
            plan=plan,
            degrees=degrees,
        )
        if not log.locked_without_column:
            return log
        unused = varying_columns(file.header, assigned_columns.extra, file.first)
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
        coordinates = motion.coordinates
        recorded_parts = {"q": motion.q}
        if motion.derived != "positions":
            recorded_parts["dq"] = motion.dq
        if not motion.derived:
            recorded_parts["ddq"] = motion.ddq
        if motion.tau is not None and not motion.plan:
            recorded_parts["tau"] = motion.tau
        header = [time_column(coordinates.names)]
        for part in recorded_parts:
            header += coordinates.headers(part)
        table = np.column_stack([motion.time, *recorded_parts.values()])
        file = ArrayFile.from_table(Path("motion"), header, table, table.nbytes)
        return cls.open(file, motion.robot.model, plan=motion.plan)

    @property
    def locked_without_column(self) -> tuple[str, ...]:
        """Locked joints without a column in the file."""
        joints_with_column = set()
        for column in self.columns.of_locked:
            name, _ = split_unit(column)
            joints_with_column |= {joint for joint in self.locked if belongs(name, [joint])}
        return tuple(joint for joint in self.locked if joint not in joints_with_column)

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
        return self._rows.table

    @property
    def epoch(self) -> int:
        """Stamp of time 0 [ns], since 1970 or on the recording's clock; 0 if the file has none."""
        return self._rows.epoch

    @cached_property
    def _rows(self) -> _DecodedRows:
        """Rows of the file, decoded, repaired and checked."""
        table = self.file.table(self.columns.used)
        if not len(table):
            line = self.file.header_line if isinstance(self.file, CsvFile) else 0
            raise TrajectoryError(f"{self.path}: no rows after the header of line {line}. Give at least one.")
        if self.columns.counted:
            table = self._with_row_times(table)
        elif self.columns.seconds != 1.0:
            table[:, 0] *= self.columns.seconds
        begin = float(table[0, 0])
        epoch = self.file.epoch if isinstance(self.file, ArrayFile) else 0
        date = date_note(begin)
        if date:
            table[:, 0] -= begin
            epoch = round(begin * 1e9)
        clock = None
        if not self.columns.counted:
            clock = self._steady_clock(table)
        self._check_rows(table)
        table, duplicates = self._merge_duplicates(table)
        all_wrong_stamps: dict[float, float] = {}
        contradictions = self._contradictions(table, dated=bool(epoch))
        while wrong_stamps := contradictions.glitches.stamps():
            all_wrong_stamps |= wrong_stamps
            table = without_times(table, wrong_stamps)
            contradictions = self._contradictions(table, dated=bool(epoch))  # others may show without these rows
        contradictions.runs = [self.motion(run) for run in log_table.excerpts(table, _RUN_COUNT, _ROWS_OF_RUN)]
        # converted rows, and the same rows in the units of the file
        portions = ((self.motion(table[rows]), table[rows]) for rows in slices(len(table)))
        doubts_about_mimic_joints = mimic_doubts(self.columns.mimic_joints, portions)
        steps = RecordedSteps(self.coordinates, [(run.time, run.q) for run in contradictions.runs])
        for window, own_rows in windows(len(table), log_table.ROWS, SURROUNDINGS):
            steps.add(table[window, 0], self.columns.si_values(table[window], "q"), own_rows)
        return _DecodedRows(
            table, duplicates, clock, all_wrong_stamps, contradictions, steps, doubts_about_mimic_joints, date, epoch
        )

    def _with_row_times(self, table: Array) -> Array:
        """Table with times [s] from the numbers of the rows as its first column."""

        def timed_portions() -> Iterator[Array]:
            """Rows with their times, portion by portion."""
            for rows in slices(len(table)):
                times = self.columns.seconds * np.arange(rows.start, rows.stop)
                yield np.c_[times, table[rows]]

        return table_of(timed_portions(), table.shape[1] + 1, self.path)

    def _merge_duplicates(self, table: Array) -> tuple[Array, DuplicateTimestamps]:
        """Table with one row for each time, and the rows that this leaves out."""
        duplicates = DuplicateTimestamps()
        angle_indices = np.flatnonzero(self.coordinates.angular)  # among the coordinates
        half_turns = math.pi / self.columns.angle[angle_indices]  # in the unit of each column
        q_columns = self.columns.places["q"]
        angle_columns = np.zeros(0, int) if q_columns is None else q_columns[angle_indices]
        merged_table = duplicates.merge(table, angle_columns, half_turns, str(self.path))
        return merged_table, duplicates

    @cached_property
    def origin(self) -> Origin:
        """Plan, log or either, by what the file has."""
        q_columns = self.columns.places["q"]
        if q_columns is None:
            q_columns = np.zeros(0, int)
        runs = log_table.excerpts(self.table, _RUN_COUNT, _ROWS_OF_RUN)
        # positions in the unit of the file: their steps show an encoder
        positions_and_torques = [(run[:, q_columns], self.columns.si_values(run, "tau")) for run in runs]
        return origin_of(positions_and_torques, plan=self.plan)

    @property
    def instants(self) -> tuple[Instant, ...]:
        """Instants at which rows are missing, repeated or wrong, or a speed changes from one row to the next."""
        return tuple(self._rows.steps.instants)

    def _contradictions(self, table: Array, *, dated: bool) -> Contradictions:
        """Statistics of all rows; ``dated`` is True if time counts from 1970 in the file."""
        columns = self.columns
        is_in_seconds = columns.time_stated or is_called_seconds(columns.header[columns.time])
        # Degrees in a header are doubted, since some programs write them by habit, unless the caller confirms them.
        is_in_degrees = columns.angle == math.radians(1.0)
        contradictions = Contradictions(
            self.coordinates,
            time_stated=columns.time_stated,
            may_count_rows=not (columns.counted or is_in_seconds or dated),
            angle=columns.angle,
            angle_stated=columns.angle_stated & (~is_in_degrees | self.degrees),
        )
        for block in slices(len(table)):
            first_row = max(0, block.start - OVERLAP)
            rows = table[first_row : block.stop]
            contradictions.add(rows[:, 0], columns.si_values(rows, "q"), block.start - first_row)
        return contradictions

    def motion(self, table: Array) -> LogRows:
        """Convert rows of the log to q, dq, ddq and torques, in SI units.

        Parameters
        ----------
        table : (n, columns) array, :attr:`table` or some of its rows

        Returns
        -------
        rows : LogRows
        """
        q, dq, ddq, tau, command = [self.columns.si_values(table, part) for part in PARTS]  # in the order of PARTS
        if tau is not None and self.columns.of_motors:
            for entries, motor_per_joint, _ in self.coordinates.coupled:
                tau[:, entries] = tau[:, entries] @ motor_per_joint
        return LogRows(table[:, 0].copy(), q, dq, ddq, tau, command)

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences about assumptions: from the header, and from the rows once they are decoded."""
        columns = self.columns
        decoded = self._rows
        notes: list[str] = [*columns.notes, *map(ReadingNote, decoded.date)]
        if columns.of_locked:
            notes.append(f"Columns of locked joints are ignored: {', '.join(columns.of_locked)}.")
        if columns.extra:
            notes.append(f"Columns that are not coordinates of this robot are ignored: {', '.join(columns.extra)}.")
        if decoded.clock is not None:
            notes.append(
                "Time stamps are rounded so that several rows share one: a steady clock of "
                f"{number(decoded.clock, 4)} Hz is taken."
            )
        notes += self.file.notes
        notes += [str(note) for note in self.doubts() if note.level == "note" and note.kind not in ASKED]
        return tuple(notes)

    def doubts(
        self, limits: Limits | None = None, *, own: Limits | None = None, glitches: bool = True
    ) -> tuple[Doubt, ...]:
        """Doubts about the log, without a model: contradictions, sampling, and dropped rows.

        Parameters
        ----------
        own : Limits, optional, of the robot's file; they judge steps of joints whose ``limits`` were given with their unit
        glitches : bool, include single wrong rows; False if smoothing reports them in more detail

        Returns
        -------
        doubts : tuple of Doubt
        """
        decoded = self._rows
        contradictions = decoded.contradictions.doubts(limits, glitches=glitches, origin=self.origin)
        contradictions = list(map(self._with_listed_column, contradictions))
        step_limits = limits
        if limits is not None and own is not None:
            velocity = np.where(limits.has_unit("velocity"), own.velocity, limits.velocity)
            step_limits = replace(limits, velocity=velocity)
        return (
            *self._unused_doubts(),
            *self.of_source,
            *contradictions,
            *decoded.steps.doubts(step_limits, self.origin, contradictions),
            *decoded.mimic_joints,
            *decoded.duplicates.doubts(),
            *stamp_doubts(decoded.wrong_stamps, left_out=True),
        )

    def _unused_doubts(self) -> list[Doubt]:
        """Doubt about varying columns that are not used, and may belong to locked joints."""
        if not self.unused:
            return []
        joints = self.locked_without_column
        checked_count = len(self.coordinates.velocity_names)
        words: dict[str, Any] = {
            "checked": f"{checked_count} of {checked_count + len(self.locked)}",
            "held": listed(joints, _MAX_LISTED),
            "columns": listed(self.unused, _MAX_LISTED),
        }
        return [doubt("unused-columns", joints, **words)]

    def _with_listed_column(self, joint_doubt: Doubt) -> Doubt:
        """Doubt with the column of its joint, if the caller listed the columns, as their order may be another one."""
        names = self.coordinates.names
        q_columns = self.columns.places["q"]
        joints = [joint for joint in joint_doubt.joints if joint in names]
        may_be_other_order = self.columns.listed and joint_doubt.refuses
        if not may_be_other_order or not joints or q_columns is None:
            return joint_doubt
        joint, *_ = joints
        column_index = int(q_columns[names.index(joint)])
        column = self.columns.header[column_index]
        columns_option = spell(Argument("columns"))
        remedy = spell(Argument("columns", {joint: "COLUMN"}))
        return replace(
            joint_doubt,
            sentence=f"{joint_doubt.sentence}. By the order of {columns_option}, {joint} has the column {column}; if it has "
            f"another, name it, {remedy}",
        )

    def _steady_clock(self, table: Array) -> float | None:
        """Replace rounded stamps by a steady clock and return its rate [Hz]; the first rows show the rounding."""
        first_rows = table[:_ROUNDING_ROWS]
        has_equal_time = np.diff(first_rows[:, 0]) == 0
        has_other_values = (first_rows[1:, 1:] != first_rows[:-1, 1:]).any(axis=1)
        is_rounded = has_equal_time & has_other_values
        rounded_share = is_rounded.sum() / max(1, has_equal_time.sum())
        most_rows_repeat = rounded_share < 0.5
        if len(table) > _MAX_STAMPS or not is_rounded.any() or most_rows_repeat:
            return None
        times = steady_times(np.array(table[:, 0]))
        if times is None:
            return None
        table[:, 0] = times
        return 1.0 / float(np.median(np.diff(times)))

    def _check_rows(self, table: Array) -> None:
        """Raise TrajectoryError if time decreases or a quaternion is zero."""
        last_time = -math.inf  # of the block before
        for block in slices(len(table)):
            rows = table[block]
            times = np.r_[last_time, rows[:, 0]]
            decreases = times[1:] < times[:-1]
            if decreases.any():
                k = int(decreases.argmax())  # the first True
                raise TrajectoryError(
                    f"{self.path}: {self.file.place(block.start + k)}, column {self.columns.header[0]!r}: time "
                    f"{float(times[k + 1])!r} comes before {float(times[k])!r} of the row above. Sort the rows by time, and "
                    "give one recording at a time."
                )
            last_time = times[-1]
            for quaternion_columns in self.columns.quaternions:
                norms = np.linalg.norm(rows[:, quaternion_columns], axis=1)
                is_zero = norms < _MIN_QUATERNION_NORM
                if is_zero.any():
                    place = self.file.place(block.start + int(is_zero.argmax()))
                    first_column = self.columns.header[quaternion_columns[0]]
                    raise TrajectoryError(
                        f"{self.path}: {place}, column {first_column!r}: the quaternion is zero, which is not a rotation. "
                        "Write 1, 0, 0, 0 for none, or remove the row."
                    )


complete(globals())
