"""Torques of many motions: one line each, on processes or a cluster."""

from __future__ import annotations

import glob
import math
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
    """First word, or ``failed``."""
    joint: str = ""
    """Joint nearest to its limit."""
    peak: float = math.nan
    """Its torque of largest magnitude, with its sign."""
    limit: float = math.nan
    """Its torque limit."""
    unit: str = ""
    """Unit of peak and limit."""
    time: float = math.nan
    """Time of the peak [s]."""
    rows: int = 0
    """Number of states."""
    reason: str = ""
    """Reasons against OK, or the error."""

    @property
    def severity(self) -> float:
        """Rank of the verdict, 0 for OK, and below 1 the share of the limit."""
        share = abs(self.peak / self.limit) if self.limit else math.nan
        rank = len(_SEVEREST_FIRST) - _SEVEREST_FIRST.index(self.verdict) if self.verdict in _SEVEREST_FIRST else 0
        return rank + (share / (1.0 + share) if math.isfinite(share) else 0.0)

    @classmethod
    def from_report(cls, file: str, report: TorqueReport) -> CheckedMotion:
        """The line of a report."""
        judged = report.verdict
        found = cls(file, str(judged.word), rows=report.rows, reason="; ".join(judged.reasons))
        if report.worst is None:
            return found
        worst = report.joints[report.worst]
        return replace(found, joint=worst.joint, peak=worst.peak, limit=worst.limit, unit=worst.unit, time=worst.time)


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
        found = [one.verdict for one in self.motions]
        word = next((word for word in _SEVEREST_FIRST if word in found), None)
        if word is None:
            return Verdict(Word.OK)
        counts = [f"{found.count(each)} of {len(found)} {_MEANING[each]}" for each in _SEVEREST_FIRST if each in found]
        return Verdict(Word.UNSURE if word == FAILED else Word(word), tuple(counts))

    @property
    def robot_name(self) -> str:
        """Name of the robot."""
        return self.robot

    @property
    def subject(self) -> str:
        """Number of motions."""
        return f"{len(self)} motion{'s' * (len(self) != 1)}"

    def blocks(self) -> Iterator[Block]:
        """Verdict on all, and a table of one row each."""
        if self.verdict.ok:
            yield Headline(Word.OK, f"all limits kept by {self.subject}.")
        else:
            yield Headline.from_verdict(self.verdict)
        units = ", ".join(dict.fromkeys(one.unit for one in self if one.unit))
        column = partial(numbers, unit=units, headed=False)
        yield Table(
            "",
            words("motion", [Path(one.file).name for one in self]),
            words("verdict", [word_cell(one.verdict) for one in self]),
            words("joint", [one.joint for one in self]),
            column("peak", [Line(quantity(one.peak, one.unit), value=one.peak) for one in self]),
            column("limit", [Line(quantity(one.limit, one.unit), value=one.limit) for one in self]),
            numbers("at", [Line(quantity(one.time, "s"), value=one.time) for one in self], unit="s", headed=False),
            words("", [one.reason for one in self]),
            most=12,
            by=[one.severity for one in self],
            of_limits=False,
        )

    def sources(self) -> Mapping[str, str | Path]:
        """Files of the motions.

        Returns
        -------
        files : {argument: path}
        """
        return {f"MOTION {one.file}": one.file for one in self if Path(one.file).is_file()}

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
        names = [field.name for field in fields(CheckedMotion)]
        with csv_table(path, names) as table:
            for one in self:
                values = [getattr(one, name) for name in names]
                table.row(str(value) if isinstance(value, int) else value for value in values)
        return as_path(path)


_MEANING: Mapping[str, str] = {
    FAILED: "cannot be read",
    Word.LOOK_AGAIN: "contradict themselves",
    Word.COLLISION: "have links in contact",
    Word.OVER_LIMIT: "are over a limit",
    Word.UNSURE: "cannot be decided",
}


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
    loaded, _ = robot_of(robot, asked.pop("actuators", None), asked.pop("lock", None))
    given = expanded_paths(motions) if isinstance(motions, str | Path) else list(motions)
    return checked_motions(loaded.name, given, _Question(loaded, asked).answer, workers, scheduler, progress)


@dataclass(frozen=True, eq=False)
class _Question:
    """Question about one motion; it is sent to other processes."""

    robot: Robot
    asked: CheckOptions

    def answer(self, motion: Any) -> CheckedMotion:
        name = str(motion) if isinstance(motion, str | Path) else ""
        return CheckedMotion.from_report(name, check(self.robot, motion, **self.asked))


def checked_motions(
    robot_name: str,
    motions: Sequence[Any],
    answer: Callable[[Any], CheckedMotion],
    workers: int | None,
    scheduler: str | None,
    progress: Callable[[float], None] | None,
) -> CheckedMotions:
    """Verdicts of a question on each motion; a file that cannot be read has its error as reason."""
    with workers_of(workers, scheduler) as team:
        found = []
        for k, result in enumerate(team.results(answer, motions, progress)):
            name = str(motions[k]) if isinstance(motions[k], str | Path) else f"motion {k}"
            if isinstance(result, Failure):
                found.append(CheckedMotion(name, FAILED, reason=result.reason))
            else:
                found.append(replace(result, file=name))
    if found and all(one.verdict == FAILED for one in found):
        raise ValueRangeError(f"none of the {len(found)} motions can be read. The first: {found[0].reason}")
    return CheckedMotions(robot_name, tuple(found))


def expanded_paths(motions: str | Path) -> list[str]:
    """Files of a folder or of a pattern, sorted by name; other paths are returned unchanged.

    Raises :class:`~twistwrench.ValueRangeError` if there are none.
    """
    text, path = str(motions), Path(motions)
    if any(c in text for c in "*?[") and not path.exists():
        matches = sorted(glob.glob(text))  # noqa: PTH207  the pattern may begin at the root
        if not matches:
            raise ValueRangeError(f"no file matches {text!r}.")
        return matches
    if path.is_dir() and format_of(path) is None:
        inside = sorted(str(p) for p in path.iterdir() if p.is_file() and not p.name.startswith("."))
        if not inside:
            raise ValueRangeError(f"{text!r} is a folder without files.")
        return inside
    return [text]
