"""Logs of any length, read in portions: the clock that one pass over the stamps finds, pieces of rows, and excerpts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import TrajectoryError, ValueRangeError
from ..motion.motion import Motion
from ..motion.motion_log import LogRows, MotionLog
from ..robot import Robot
from ..typing import Array
from .log_side import MotorSide
from .zero_phase import GAP, PAUSE

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
        """From times that do not run back; ``where`` begins the error of a log too short.

        Parameters
        ----------
        stamps : iterator of (n,) arrays [s]
        where : str

        Returns
        -------
        clock : LogClock

        Raises
        ------
        TrajectoryError
            There are fewer than two times.

        Examples
        --------
        >>> clock = LogClock.of(iter([np.array([0.0, 0.5, 1.0]), np.array([5.0, 5.5])]), "a log")
        >>> clock.step, clock.begins.tolist(), clock.ends.tolist()
        (0.5, [0.0, 5.0], [1.0, 5.5])
        """
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
        """A log that is given as either; ``number`` names one without a file.

        Parameters
        ----------
        robot : Robot
        log : Motion, str or Path
        number : int, counting from 1
        **reading : ``columns``, ``rate``, ``degrees``, ``side`` of files

        Returns
        -------
        source : LogSource

        Examples
        --------
        >>> import twistwrench as tw
        >>> LogSource.of(tw.robots.ur5(), "monday.csv", 1).path
        'monday.csv'
        """
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
