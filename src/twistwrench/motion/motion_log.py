"""Logs of motions, read in blocks: time, coordinates, and velocities, accelerations and torques, one row of each time."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from ..core.numbers import number, printed
from ..core.text import listed
from ..errors import TrajectoryError, TwistWrenchError, ValueRangeError
from ..model.limits import Limits
from ..model.model import Model
from ..typing import Array
from .array_stream import LARGE, ArrayStream, NpzFile, passing_runs
from .columns import Columns, MimicJointCheck, varying_columns
from .contradictions import Contradictions
from .coordinates import Coordinates
from .csv_reader import Block, CsvFile
from .motion_file import MotionFile, open_motion_file
from .rate_checks import LEFT_OUT, stamp_words

_MOST = 10_000
"""Rows of one time, from which the clock is taken to stand."""
_FEWEST, _REPEATED, _PAUSE = 20, 0.02, 3.0
"""Rows, and share of the steps that are 0, from which stamps seem rounded; and steps of their grid that are a pause."""
_ROUNDED = 0.65
"""Steps of the grid that a rounded stamp is off at most: half of one, and what few rows leave open of the clock."""


class DuplicateTimestamps:
    """Rows come in any portions; the last time of each is held back, as more rows of it may follow.

    Rows that equal the one before are dropped. Others of one time become their mean, which is the best estimate of two
    readings that a coarse clock does not tell apart.
    """

    def __init__(self, time: int, turning: Array, half_turn: Array, where: str) -> None:
        self._time, self._turning, self._half_turn, self._where = time, turning, half_turn, where
        self._held: Array | None = None
        self.dropped = self.averaged = 0
        self.first: float | None = None
        """When rows that differ first had one time."""

    def add(self, rows: Array) -> Array:
        """Consecutive rows (n, columns) whose times do not decrease; those of times that are surely over."""
        rows = rows if self._held is None else np.concatenate([self._held, rows])
        if not len(rows):
            return rows
        time = rows[:, self._time]
        starts = np.r_[0, np.flatnonzero(time[1:] != time[:-1]) + 1]
        self._held = rows[starts[-1] :].copy()
        if len(self._held) > _MOST:
            raise TrajectoryError(
                f"{self._where}: time stands at {float(time[-1])!r} for more than {_MOST} rows. Say how many rows a second has "
                "(--rate HZ), after removing the column of time."
            )
        return self._one_each(rows[: starts[-1]])

    def rest(self) -> Array | None:
        """What was held back; None if no row came at all."""
        held, self._held = self._held, None
        return None if held is None else self._one_each(held)

    def _one_each(self, rows: Array) -> Array:
        time = rows[:, self._time]
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
        if (spread[np.ix_(at, self._turning)] > self._half_turn).any():
            k = at[int((spread[np.ix_(at, self._turning)] > self._half_turn).any(axis=1).argmax())]
            raise TrajectoryError(
                f"{self._where}: rows of one time, {float(rows[starts[k], self._time])!r}, differ by more than half a turn. "
                "Keep one of them."
            )
        self.first = float(rows[starts[at[0]], self._time]) if self.first is None else self.first
        self.averaged += int(counts[at].sum())
        found = np.add.reduceat(rows, starts) / counts[:, None]
        found[:, self._time] = rows[starts, self._time]
        return np.asarray(found)

    def notes(self) -> list[str]:
        """A sentence for what was dropped, and one for what was averaged."""
        said = []
        if self.dropped:
            said.append(
                f"{self.dropped} row{'s that repeat the row' if self.dropped > 1 else ' that repeats the row'} before dropped."
            )
        if self.averaged and self.first is not None:
            said.append(
                f"{self.averaged} rows have a time that others have too, the first at t = {printed(self.first)} s: the "
                "mean of each is taken."
            )
        return said


def steady_times(stamps: Array) -> Array | None:
    """Times (n,) of rows whose stamps were rounded to a grid coarser than their steps; None where they are no steady clock's.

    Between pauses, times are the straight line through the stamps, which no stamp is farther from than rounding takes it.
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
"""Rows whose stamps are looked at together: 128 MiB."""
_NO_ROTATION = 1e-6  # norm of a quaternion


@dataclass(frozen=True, eq=False)
class LogRows:
    """Consecutive samples of a motion, in SI units; ``dq``, ``ddq`` and ``tau`` are None where the file has none."""

    time: Array
    """(n,) s."""
    q: Array
    """(n, nq)."""
    dq: Array | None
    """(n, nv)."""
    ddq: Array | None
    """(n, nv)."""
    tau: Array | None = None
    """(n, nv) N m or N: what was logged, for comparison."""


@dataclass(eq=False)
class _Pass:
    """What one pass over all rows found."""

    repeats: DuplicateTimestamps | None = None
    contradictions: Contradictions | None = None
    followers: MimicJointCheck | None = None
    stamps: dict[float, float] = field(default_factory=dict)
    """Times of rows whose stamp alone is wrong, which later passes leave out, and what it is late by [s]."""
    clock: Array | None = None
    """(n,) times of all rows, where their stamps are rounded so coarsely that several are alike [s]."""
    clock_known: bool = False


@dataclass(frozen=True, eq=False)
class MotionLog:
    """Motion log: a file that has been opened once to read its header; the rows stay in the file."""

    file: MotionFile
    """The file."""
    columns: Columns
    """Which column is which."""
    coordinates: Coordinates
    """Names and units of the robot's coordinates."""
    first_row: int = 0
    """Number of the first row that is given, of a part of a file."""
    held: tuple[str, ...] = ()
    """Joints that are held still as the file has no column for them."""
    unused: tuple[str, ...] = ()
    """Columns that may be theirs: numbers that vary and are not used."""
    _last: _Pass = field(default_factory=_Pass)

    @classmethod
    def open(
        cls,
        path: str | Path | MotionFile,
        model: Model,
        *,
        degrees: bool = False,
        locked: Sequence[str] = (),
        columns: Mapping[str, str] | None = None,
        rate: float | None = None,
        held: Sequence[str] = (),
    ) -> MotionLog:
        r"""Read and check the header of a motion file, and see which column is which.

        Parameters
        ----------
        path : str, Path or MotionFile
            A CSV file (see :meth:`CsvFile.open <twistwrench.motion.csv_reader.CsvFile.open>` for what is understood), an
            archive that ``simulate --npz`` wrote, npz, npy, MAT, HDF5, parquet, feather, MCAP, or a bag of ROS (with the
            extra ``logs``); several files of one motion as ``a.csv+b.csv``.
        model : Model, of the robot that moves
        degrees : bool, angles are in degrees wherever the column does not name its unit
        locked : sequence of str, joints whose columns are ignored
        columns : {name: column}, optional, which column is which, where its name does not say so
            ``{"elbow": "pos3", "elbow.vel": "w3"}``; ``.acc``, ``.tau`` and ``time`` likewise.
        rate : float, optional, rows a second of a file without a column of time [Hz]
        held : sequence of str, those of ``locked`` that the file has no column for

        Returns
        -------
        log : MotionLog

        Raises
        ------
        NotFoundError, TrajectoryError, UnknownNameError, ValueRangeError
            Naming the file, the line and what was found there.

        Examples
        --------
        >>> import pathlib, tempfile
        >>> import twistwrench as tw
        >>> model = tw.robots.pendulum().model
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = pathlib.Path(folder, "log.csv")
        ...     _ = path.write_text("encoder [deg]\n0\n90\n")
        ...     log = MotionLog.open(path, model, columns={model.leaders[0].joint.name: "encoder"}, rate=100.0)
        ...     motion = log.motion(np.concatenate(list(log.tables())))
        >>> motion.time.tolist(), motion.q.round(6).tolist()
        ([0.0, 0.01], [[0.0], [1.570796]])
        """
        if model.nv == 0:
            raise ValueRangeError(
                f"robot {model.name!r} has no joint that moves, so no motion fits. Lock fewer joints."
            )
        if rate is not None and not (math.isfinite(rate) and rate > 0):
            raise ValueRangeError(f"rate {rate!r} is no number of rows a second. Give one above 0, such as 1000.")
        file = open_motion_file(path) if isinstance(path, str | Path) else path
        coordinates = Coordinates.of(model)
        where = f"{file.path}: line {file.header_line}" if isinstance(file, CsvFile) else str(file.path)
        options: dict[str, Any] = {"degrees": degrees, "locked": locked, "columns": columns, "rate": rate}
        options["look"] = look = lambda column: next((b.table[:, 0] for b in file.blocks([column])), np.zeros(0))
        found = Columns.of(file.header, coordinates, where, **options)
        unused = varying_columns(file.header, found.extra, look) if held else ()
        return cls(file, found, coordinates, held=tuple(held), unused=tuple(unused))

    @property
    def path(self) -> Path:
        """Of the file."""
        return self.file.path

    @property
    def size(self) -> int:
        """Of the file [bytes]."""
        return self.file.size

    def tables(self, progress: Callable[[int], None] | None = None) -> Iterator[Array]:
        """Rows of the file in blocks: time in seconds, all else as it stands in the file.

        Parameters
        ----------
        progress : callable, optional, told the bytes of each block

        Returns
        -------
        blocks : iterator of (n, columns) arrays

        Raises
        ------
        TrajectoryError
            A value is no number or not finite, a row is not whole, or time runs back.

        Notes
        -----
        One row of each time is given. What was found is in :attr:`notes` and :meth:`contradictions` afterwards. Rows whose
        stamp alone is wrong are known after a pass over all rows, and are left out in the next.

        Examples
        --------
        >>> import twistwrench as tw
        >>> log = MotionLog.open(tw.robots.path_of("ur5").with_name("ur5_demo.csv"), tw.robots.ur5().model)
        >>> sum(len(table) for table in log.tables())
        751
        """
        self._last.repeats = repeats = self._repeats()
        self._last.contradictions = found = Contradictions(
            self.coordinates,
            time_stated=self.columns.time_stated,
            angle=self.columns.angle,
            angle_stated=self.columns.angle_stated,
        )
        self._last.followers = followers = MimicJointCheck(self.columns.mimic_joints)

        def take_in(table: Array) -> Array:
            motion = self.motion(table)
            found.add(motion)
            followers.add(motion.time, motion.q, table)
            return table

        last, rows = -math.inf, self.first_row
        for block in self.file.blocks(self.columns.used):
            self._look_at_clock(block.table)
            table = self._timed(block, rows, last)
            if len(table):
                last, rows = float(table[-1, 0]), rows + len(table)
                table = self._without(repeats.add(table))
                if len(table):
                    yield take_in(table)
            if progress:
                progress(block.size)
        final = repeats.rest()
        if final is None:
            line = self.file.header_line if isinstance(self.file, CsvFile) else 0
            raise TrajectoryError(f"{self.path}: no rows after the header of line {line}. Give at least one.")
        final = self._without(final)
        if len(final):
            yield take_in(final)
        self._last.stamps |= found.stamps()

    def whole(self) -> Array:
        """All rows at once, as :meth:`tables` gives them, without those whose stamp is wrong.

        Returns
        -------
        table : (n, columns) array

        Examples
        --------
        >>> import twistwrench as tw
        >>> log = MotionLog.open(tw.robots.path_of("ur5").with_name("ur5_demo.csv"), tw.robots.ur5().model)
        >>> len(log.whole())
        751
        """
        return self._without(np.concatenate(list(self.tables())))

    @property
    def stamps_left_out(self) -> int:
        """How many rows are left out for their stamps, as known so far."""
        return len(self._last.stamps)

    def _without(self, table: Array) -> Array:
        """The rows but those whose stamp is known to be wrong."""
        return table[~np.isin(table[:, 0], list(self._last.stamps))] if self._last.stamps else table

    def part(self, begin: int, end: int) -> MotionLog | None:
        """Rows of the log from one to another, with their own times; None where the file is read from its beginning only.

        Parameters
        ----------
        begin, end : int, numbers of rows

        Returns
        -------
        part : MotionLog or None

        Examples
        --------
        >>> import twistwrench as tw
        >>> log = MotionLog.open(tw.robots.path_of("ur5").with_name("ur5_demo.csv"), tw.robots.ur5().model)
        >>> log.part(0, 10) is None
        True
        """
        if isinstance(self.file, NpzFile):
            rows = replace(self.file, table=self.file.table[max(0, begin) : end])
            return replace(self, file=rows, first_row=max(0, begin), _last=self._same_clock())
        if isinstance(self.file, ArrayStream):
            part = self.file.part(begin, end)
            return replace(self, file=part, first_row=max(0, begin), _last=self._same_clock())
        return None

    def stamps(self) -> Iterator[Array]:
        """Times of all rows, in blocks [s], as they stand in the file.

        Returns
        -------
        times : iterator of (n,) arrays

        Examples
        --------
        >>> import twistwrench as tw
        >>> log = MotionLog.open(tw.robots.path_of("ur5").with_name("ur5_demo.csv"), tw.robots.ur5().model)
        >>> sum(len(times) for times in log.stamps())
        751
        """
        rows = 0
        for block in self.file.blocks(self.columns.used):
            self._look_at_clock(block.table)
            break
        if self._last.clock is not None:
            yield self._last.clock
            return
        for block in self.file.blocks(self.columns.used[:1]):
            yield (
                np.arange(rows, rows + len(block.table)) if self.columns.counted else block.table[:, 0]
            ) * self.columns.seconds
            rows += len(block.table)

    def excerpts(self, count: int, rows: int) -> list[Array]:
        """Runs of consecutive rows spread evenly over the file, its ends included.

        Parameters
        ----------
        count : int, up to so many runs
        rows : int, about so many rows each; a short file comes whole, as one

        Returns
        -------
        tables : list of (n, columns) arrays

        Raises
        ------
        TrajectoryError
            Values are no numbers, as in :meth:`tables`.

        Examples
        --------
        >>> import twistwrench as tw
        >>> log = MotionLog.open(tw.robots.path_of("ur5").with_name("ur5_demo.csv"), tw.robots.ur5().model)
        >>> len(log.excerpts(2, 10))
        2
        """
        try:
            blocks = self.file.excerpts(self.columns.used, count, rows)
            blocks = None if blocks is None else list(blocks)
            for block in blocks or []:
                self._look_at_clock(block.table)
            if blocks is None or self._last.clock is not None:
                return [self._without(x) for x in passing_runs(self.tables, count, rows, whole=self.size <= LARGE)]
            found = []
            for block in blocks:
                repeats = self._repeats()
                begun = repeats.add(self._timed(block, 0, -math.inf))
                rest = repeats.rest()
                found.append(begun if rest is None else np.concatenate([begun, rest]))
        except TwistWrenchError:
            for _ in self.tables():  # fails at the same row, and knows its line
                pass
            raise
        return [table for table in found if len(table)]

    def motion(self, table: Array) -> LogRows:
        """Columns of a table sorted into q, dq, ddq and torques, in SI units.

        Parameters
        ----------
        table : (n, columns) array

        Returns
        -------
        rows : LogRows

        Examples
        --------
        >>> import twistwrench as tw
        >>> log = MotionLog.open(tw.robots.path_of("ur5").with_name("ur5_demo.csv"), tw.robots.ur5().model)
        >>> log.motion(next(log.tables())).q.shape[1]
        6
        """
        return LogRows(table[:, 0].copy(), *(self.columns.take(table, part) for part in ("q", "dq", "ddq", "tau")))

    @property
    def notes(self) -> tuple[str, ...]:
        """A sentence for each thing that was taken to be meant: of the header, and of the rows once they were read."""
        columns, last = self.columns, self._last
        said = list(columns.notes)
        if columns.of_locked:
            said.append(f"Columns of locked joints are ignored: {', '.join(columns.of_locked)}.")
        if columns.extra:
            said.append(f"Columns that are no coordinate of this robot are ignored: {', '.join(columns.extra)}.")
        if last.clock is not None:
            said.append(
                "Time stamps are rounded so that several rows share one: a steady clock of "
                f"{number(1.0 / float(np.median(np.diff(last.clock))), 4)} Hz is taken."
            )
        said += last.repeats.notes() if last.repeats else []
        said += [f"{LEFT_OUT}{stamp_words(last.stamps)}."] if last.stamps else []
        said += self.file.notes
        return (*said, *(last.contradictions.notes() if last.contradictions else ()))

    def contradictions(self, limits: Limits | None = None, *, glitches: bool = True) -> tuple[str, ...]:
        """Contradictions: a sentence for each thing by which the motion contradicts itself.

        Parameters
        ----------
        limits : Limits, optional; those of velocity help to tell a jump from a fast motion
        glitches : bool, single wrong rows too; False where smoothing found them, which says more of them

        Returns
        -------
        sentences : tuple of str, after all rows of :meth:`tables` were read

        Examples
        --------
        >>> import twistwrench as tw
        >>> log = MotionLog.open(tw.robots.path_of("ur5").with_name("ur5_demo.csv"), tw.robots.ur5().model)
        >>> blocks = list(log.tables())
        >>> log.contradictions()
        ()
        """
        found, followers = self._last.contradictions, self._last.followers
        if found is None or followers is None:
            return ()
        misread = []
        if self.unused:
            checked, held = len(self.coordinates.velocity_names), len(self.held)
            misread.append(
                f"{checked} of {checked + held} joints checked: {listed(self.held, 6)} held still for want of a column, while "
                f"columns that vary are not used, {listed(self.unused, 6)}. Say which they are with --columns"
            )
        return (*misread, *found.sentences(limits, glitches=glitches), *followers.sentences())

    def hints(self, limits: Limits | None = None) -> tuple[str, ...]:
        """Hints: a sentence for each thing that is odd, and may yet be meant.

        Parameters
        ----------
        limits : Limits, optional; those of velocity help to tell a jump from a fast motion

        Returns
        -------
        sentences : tuple of str, after all rows of :meth:`tables` were read

        Examples
        --------
        >>> import twistwrench as tw
        >>> log = MotionLog.open(tw.robots.path_of("ur5").with_name("ur5_demo.csv"), tw.robots.ur5().model)
        >>> blocks = list(log.tables())
        >>> log.hints()
        ()
        """
        found = self._last.contradictions
        return () if found is None else found.hints(limits)

    def _repeats(self) -> DuplicateTimestamps:
        angles = np.flatnonzero(self.coordinates.angular)
        where = self.columns.places["q"]
        turning = np.zeros(0, int) if where is None else where[angles]
        return DuplicateTimestamps(0, turning, math.pi / self.columns.angle[angles], str(self.path))

    def _same_clock(self) -> _Pass:
        """Nothing known yet of a part, but for the clock of the whole."""
        return _Pass(clock=self._last.clock, clock_known=self._last.clock_known)

    def _look_at_clock(self, table: Array) -> None:
        """Take all stamps for those of a steady clock, where the first rows show that rounding makes rows share them."""
        last = self._last
        if last.clock_known or self.columns.counted or not len(table):
            return
        last.clock_known = True
        again = np.diff(table[:, 0]) == 0
        differ = (table[1:, 1:] != table[:-1, 1:]).any(axis=1)
        if not (again & differ).any() or 2 * (again & differ).sum() < again.sum():
            return
        stamps, rows = [], 0
        for block in self.file.blocks(self.columns.used[:1]):
            rows += len(block.table)
            if rows > _MOST_STAMPS:
                return
            stamps.append(block.table[:, 0] * self.columns.seconds)
        last.clock = steady_times(np.concatenate(stamps))

    def _timed(self, block: Block, rows: int, last: float) -> Array:
        """The block with time in seconds first, which is checked not to run back from ``last``; ``rows`` were before it."""
        if self.columns.counted:
            time = (rows + np.arange(len(block.table))) * self.columns.seconds
            table = np.concatenate([time[:, None], block.table], axis=1)
        else:
            table = block.table
            if self.columns.seconds != 1.0:
                table = table.copy()
                table[:, 0] *= self.columns.seconds
        if self._last.clock is not None:
            table = table if table is not block.table else table.copy()
            table[:, 0] = self._last.clock[rows : rows + len(table)]
        before = np.r_[last, table[:-1, 0]][: len(table)]
        if (back := table[:, 0] < before).any():
            k = int(back.argmax())
            raise TrajectoryError(
                f"{self.path}: {block.place(k)}, column {self.columns.header[0]!r}: time {float(table[k, 0])!r} comes before "
                f"{float(before[k])!r} of the row above. Sort the rows by time, and give one recording at a time."
            )
        for place in self.columns.quaternions:
            none = np.linalg.norm(table[:, place], axis=1) < _NO_ROTATION
            if none.any():
                raise TrajectoryError(
                    f"{self.path}: {block.place(int(none.argmax()))}, column {self.columns.header[place[0]]!r}: the "
                    "quaternion is zero, which is no rotation. Write 1, 0, 0, 0 for none, or remove the row."
                )
        return table
