"""Torques of many motions: one line each, on processes or a cluster."""

from __future__ import annotations

import glob
import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Unpack, overload

from ..core.answers.answer import Answer
from ..core.answers.blocks import Block, Headline, Line, Table, numbers, word_cell, words
from ..core.errors import ValueRangeError
from ..core.files import as_path
from ..core.numbers import quantity
from ..core.tables import csv_table
from ..core.third_party.workers import Failure, workers_of
from ..core.verdict import Verdict, Word
from ..motion.readers import format_of
from .check import CheckOptions, check, robot_of

if TYPE_CHECKING:
    from ..robot import Robot
    from .torque_report import TorqueReport

__all__ = ["check_each"]

FAILED = "failed"
"""Word of a file that cannot be read."""


@dataclass(frozen=True)
class CheckedMotion:
    """Verdict on one motion, and the joint nearest to its limit or with the largest torque."""

    file: str
    """Path of the motion, or its number."""
    verdict: str
    """First word of the verdict; ``failed`` for a file that cannot be read."""
    joint: str = ""
    """Joint nearest to its limit."""
    peak: float = math.nan
    """Torque of that joint with the largest magnitude, with its sign."""
    limit: float = math.nan
    """Torque limit of that joint."""
    unit: str = ""
    """Unit of peak and limit."""
    time: float = math.nan
    """Time of the peak [s]."""
    rows: int = 0
    """Number of states."""
    reason: str = ""
    """Reasons against OK, with "; " between them; empty for OK. For a file that cannot be read: the error."""

    @property
    def severity(self) -> float:
        """Sort key: rank of the verdict (0 for OK), plus a number from 0 to 1 that grows with peak / limit."""
        severity = 0.0
        if self.verdict in _SEVEREST_FIRST:
            severity = float(len(_SEVEREST_FIRST) - _SEVEREST_FIRST.index(self.verdict))
        if self.limit == 0.0:
            return severity
        share = abs(self.peak / self.limit)
        if math.isfinite(share):
            severity += share / (1.0 + share)  # below 1, so that the verdict decides first
        return severity

    @classmethod
    def from_report(cls, file: str, report: TorqueReport) -> CheckedMotion:
        """The line of a report; without joint, peak and limit if the report has no worst joint."""
        word = str(report.verdict.word)
        reason = "; ".join(report.verdict.reasons)
        checked = cls(file, verdict=word, rows=report.rows, reason=reason)
        if report.worst is None:
            return checked
        worst = report.joints[report.worst]
        return replace(checked, joint=worst.joint, peak=worst.peak, limit=worst.limit, unit=worst.unit, time=worst.time)


_SEVEREST_FIRST = (Word.LOOK_AGAIN, Word.COLLISION, Word.OVER_LIMIT, FAILED, Word.UNSURE)


@dataclass(frozen=True, eq=False, repr=False)
class CheckedMotions(Answer, Sequence[CheckedMotion]):
    """Verdicts on many motions, a sequence in their order: result of :func:`twistwrench.check_each`.

    Examples
    --------
    >>> import twistwrench as tw
    >>> demo = tw.robots.path_of("ur5").with_name("ur5_demo.csv")
    >>> found = tw.check_each("ur5", [demo, demo], payload=10)
    >>> found.verdict.word, len(found), found[0].joint, found.subject, found.robot_name, len(found.sources())
    (<Word.OVER_LIMIT: 'OVER LIMIT'>, 2, 'shoulder_lift_joint', '2 motions', 'ur5', 1)
    """

    call: ClassVar[str] = "torques"

    robot: str
    """Name of the robot."""
    motions: tuple[CheckedMotion, ...]
    """One entry for each motion."""

    @overload
    def __getitem__(self, k: int) -> CheckedMotion: ...
    @overload
    def __getitem__(self, k: slice) -> tuple[CheckedMotion, ...]: ...
    def __getitem__(self, k: int | slice) -> CheckedMotion | tuple[CheckedMotion, ...]:
        return self.motions[k]

    def __len__(self) -> int:
        return len(self.motions)

    @cached_property
    def verdict(self) -> Verdict:
        """The severest word, with the number of motions that have it; a file that cannot be read makes OK UNSURE."""
        motion_counts = Counter(motion.verdict for motion in self.motions)
        words_by_severity = [word for word in _SEVEREST_FIRST if motion_counts[word] > 0]
        if not words_by_severity:
            return Verdict(Word.OK)
        severest = words_by_severity[0]
        if severest == FAILED:  # not a word of verdicts
            severest = Word.UNSURE
        reasons = [f"{motion_counts[word]} of {len(self)} {_REASON_ENDINGS[word]}" for word in words_by_severity]
        return Verdict(Word(severest), tuple(reasons))

    @property
    def robot_name(self) -> str:
        """Name of the robot."""
        return self.robot

    @property
    def subject(self) -> str:
        """Number of motions."""
        if len(self) == 1:
            return "1 motion"
        return f"{len(self)} motions"

    def blocks(self) -> Iterator[Block]:
        """Verdict on all, and a table of one row each."""
        if self.verdict.ok:
            yield Headline(Word.OK, f"all limits kept by {self.subject}.")
        else:
            yield Headline.from_verdict(self.verdict)
        units = dict.fromkeys(motion.unit for motion in self if motion.unit)  # each unit once, in order
        peaks, limits, times = list[Line](), list[Line](), list[Line]()
        for motion in self:
            peaks.append(_quantity_cell(motion.peak, motion.unit))
            limits.append(_quantity_cell(motion.limit, motion.unit))
            times.append(_quantity_cell(motion.time, "s"))
        torque_column = partial(numbers, unit=", ".join(units), headed=False)
        yield Table(
            "",
            words("motion", [Path(motion.file).name for motion in self]),
            words("verdict", [word_cell(motion.verdict) for motion in self]),
            words("joint", [motion.joint for motion in self]),
            torque_column("peak", peaks),
            torque_column("limit", limits),
            numbers("at", times, unit="s", headed=False),
            words("", [motion.reason for motion in self]),
            most=_MAX_ROWS,
            by=[motion.severity for motion in self],  # the severest rows stay in a short answer
            of_limits=False,
        )

    def sources(self) -> Mapping[str, str | Path]:
        """Files of the motions.

        Returns
        -------
        files : {argument: path}
        """
        return {f"MOTION {motion.file}": motion.file for motion in self if Path(motion.file).is_file()}

    def to_csv(self, path: str | Path) -> Path:
        """Write one row for each motion.

        Parameters
        ----------
        path : str or Path

        Returns
        -------
        path : Path of the written file

        Examples
        --------
        >>> import tempfile, twistwrench as tw
        >>> demo = tw.robots.path_of("ur5").with_name("ur5_demo.csv")
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     tw.check_each("ur5", [demo]).to_csv(f"{folder}/all.csv").read_text().splitlines()[0]
        'file,verdict,joint,peak,limit,unit,time,rows,reason'
        """
        with csv_table(path, [field.name for field in fields(CheckedMotion)]) as table:
            for motion in self:
                cells = vars(motion) | {"rows": str(motion.rows)}  # a count has no decimals
                table.row(cells.values())
        return as_path(path)


_MAX_ROWS = 12
"""Rows of the table in a short answer."""


def _quantity_cell(value: float, unit: str) -> Line:
    return Line(quantity(value, unit), value=value)


_REASON_ENDINGS: Mapping[str, str] = {
    FAILED: "cannot be read",
    Word.LOOK_AGAIN: "contradict themselves",
    Word.COLLISION: "have links in contact",
    Word.OVER_LIMIT: "are over a limit",
    Word.UNSURE: "cannot be decided",
}
"""Rest of the reason "3 of 5 …", by verdict of these motions."""


def check_each(
    robot: Robot | str | Path,
    motions: str | Path | Iterable[Any],
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Callable[[float], None] | None = None,
    **asked: Unpack[CheckOptions],
) -> CheckedMotions:
    """Judge many motions as :func:`twistwrench.check` does, on this machine's processes or on a cluster.

    Parameters
    ----------
    robot : Robot, path of a robot file, or name of a known robot
    motions : folder, pattern of paths, or iterable of paths and motions
    workers : int, optional, number of processes (Dask)
    scheduler : str, optional, address of a Dask scheduler
    progress : callable, optional, receives the finished share, 0 to 1
    **asked : further arguments of :func:`twistwrench.check`

    Returns
    -------
    found : CheckedMotions

    Raises
    ------
    ValueRangeError
        There is no motion, or none can be read.

    Examples
    --------
    >>> import twistwrench as tw
    >>> demo = tw.robots.path_of("ur5").with_name("ur5_demo.csv")
    >>> print(tw.check_each("ur5", [demo], payload=5).headline)
    OK: all limits kept by 1 motion.
    """
    actuators = asked.pop("actuators", None)  # the loaded robot has them
    locked_joints = asked.pop("lock", None)
    loaded_robot, _ = robot_of(robot, actuators, locked_joints)
    all_motions = expanded_paths(motions) if isinstance(motions, str | Path) else list(motions)
    check_motion = _MotionCheck(loaded_robot, options=asked).check
    return checked_motions(loaded_robot.name, all_motions, check_motion, workers, scheduler, progress)


@dataclass(frozen=True, eq=False)
class _MotionCheck:
    """Check of one motion; a class and not a closure, since it is sent to other processes."""

    robot: Robot
    options: CheckOptions

    def check(self, motion: Any) -> CheckedMotion:
        """Verdict on one motion; its ``file`` is empty, since the name is not sent."""
        return CheckedMotion.from_report("", check(self.robot, motion, **self.options))


def checked_motions(
    robot_name: str,
    motions: Sequence[Any],
    check_motion: Callable[[Any], CheckedMotion],
    workers: int | None,
    scheduler: str | None,
    progress: Callable[[float], None] | None,
) -> CheckedMotions:
    """Results of ``check_motion`` in the order of the motions; a file that cannot be read has its error as reason."""
    checked: list[CheckedMotion] = []
    with workers_of(workers, scheduler) as team:
        for k, result in enumerate(team.results(check_motion, motions, progress)):
            motion = motions[k]
            file = str(motion) if isinstance(motion, str | Path) else f"motion {k}"
            if isinstance(result, Failure):
                checked.append(CheckedMotion(file, FAILED, reason=result.reason))
            else:
                checked.append(replace(result, file=file))
    all_failed = all(motion.verdict == FAILED for motion in checked)
    if checked and all_failed:
        raise ValueRangeError(f"none of the {len(checked)} motions can be read. The first: {checked[0].reason}")
    return CheckedMotions(robot_name, tuple(checked))


def expanded_paths(motions: str | Path) -> list[str]:
    """Files of a folder or of a pattern, sorted by name; other paths are returned unchanged.

    Raises :class:`~twistwrench.ValueRangeError` if there are none.
    """
    text = str(motions)
    path = Path(motions)
    has_wildcard = any(character in text for character in "*?[")
    if has_wildcard and not path.exists():  # names of files may have brackets
        matches = sorted(glob.glob(text))  # noqa: PTH207  the pattern may begin at the root
        if not matches:
            raise ValueRangeError(f"no file matches {text!r}.")
        return matches
    if path.is_dir() and format_of(path) is None:  # a folder with a format is one motion
        visible_entries = [entry for entry in path.iterdir() if not entry.name.startswith(".")]
        files = [str(entry) for entry in visible_entries if entry.is_file()]
        if not files:
            raise ValueRangeError(f"{text!r} is a folder without files.")
        return sorted(files)
    return [text]
