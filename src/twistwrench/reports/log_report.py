"""Function of the command ``log``: columns of a log, its rates, gaps, grids and noise."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.answers.answer import Answer
from ..core.verdict import Verdict, Word
from .log_quality import LogQuality

if TYPE_CHECKING:
    from ..core.answers.blocks import Block

__all__ = ["LogReport", "check_log"]


@dataclass(frozen=True, eq=False, repr=False)
class LogReport(Answer):
    """Columns of a log, its rates, gaps, grids and noise; nothing is judged, so the verdict is DONE.

    Examples
    --------
    >>> import twistwrench as tw
    >>> report = tw.check_log(tw.robots.path_of("ur5").with_name("ur5_demo.csv"))
    >>> report, report.quality.rows, round(report.to_dict()["rate"]), list(report.sources())
    (<LogReport: DONE, ur5_demo.csv>, 751, 125, ['FILE'])
    """

    quality: LogQuality
    """Figures of the log and of its columns."""
    call = "log"

    @property
    def verdict(self) -> Verdict:
        """DONE."""
        return Verdict(Word.DONE)

    @property
    def subject(self) -> str:
        """Name of the file."""
        return self.quality.path.name

    @property
    def brief(self) -> str:
        """Name of the file."""
        return self.quality.path.name

    def blocks(self) -> Iterator[Block]:
        """Line on the clock, table of the columns, and notes.

        Returns
        -------
        blocks : iterator of Block
        """
        from .log_view import log_view

        return log_view(self.quality)

    def sources(self) -> Mapping[str, str | Path]:
        """File of the log.

        Returns
        -------
        files : {argument: path}
        """
        return {"FILE": self.quality.path}

    def to_dict(self) -> dict[str, Any]:
        """Data of the answer, and all figures of ``quality``.

        Returns
        -------
        data : dict, as written by ``--json`` for each file
        """
        return {**super().to_dict(), **_plain({**asdict(self.quality), "path": str(self.quality.path)})}


def check_log(file: str | Path, *, topic: str | None = None, episode: int | None = None) -> LogReport:
    """Check the columns of a log: rates, gaps, repeated stamps, and range, grid and noise of each column.

    Parameters
    ----------
    file : path of a log; several files of one log are written a.csv+b.csv
    topic : str, optional, topic of a ROS recording
    episode : int, optional, episode of a LeRobot dataset

    Returns
    -------
    report : LogReport

    Raises
    ------
    NotFoundError, TrajectoryError
        The file does not exist, or is not a log.

    Examples
    --------
    >>> import twistwrench as tw
    >>> tw.check_log(tw.robots.path_of("ur5").with_name("ur5_demo.csv")).quality.gaps
    0
    """
    return LogReport(LogQuality.from_file(file, topic=topic, episode=episode))


def _plain(value: Any) -> Any:
    """Replace non-finite numbers by None for JSON."""
    if isinstance(value, dict):
        return {name: _plain(x) for name, x in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(x) for x in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
