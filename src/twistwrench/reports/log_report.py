"""Report of the command ``log``: columns of a log, its rates, gaps, grids and noise."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ..core.answers.answer import Answer
from ..core.answers.blocks import Block, Line, Table, numbers, remarks, words
from ..core.colours import Style
from ..core.numbers import number, percent
from ..core.verdict import Verdict, Word
from .log_quality import LogColumn, LogQuality

__all__ = ["LogReport", "check_log"]


@dataclass(frozen=True, eq=False, repr=False)
class LogReport(Answer):
    """Columns of a log, its rates, gaps, grids and noise. Nothing is judged: the verdict is always DONE.

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
        """DONE, since nothing is judged."""
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
        figures = asdict(self.quality)
        figures["path"] = str(self.quality.path)  # JSON has no paths
        return {**super().to_dict(), **_without_infinities(figures)}


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


_MAX_ROWS = 10
"""Largest number of columns of the log in the short form, one in each row of the table."""
_MAX_SHARE_OF_ZEROS = 0.1
"""Share of exact zeros above which a column gets a remark."""
_MIN_GRID_STEPS = 50
"""Number of grid steps between the extremes of a column below which it gets a remark."""
_MIN_JITTER = 1e-3
"""Variation of the steps, relative to the usual step, above which the clock gets a remark."""


def log_view(quality: LogQuality) -> Iterator[Block]:
    """Line on the clock, table of the columns, and notes."""
    columns = quality.columns
    yield Line((quality.path.name, Style.STRONG), f"  {_clock_text(quality)}")
    yield Table(
        "",
        words("column", [column.name for column in columns]),
        numbers("least", [column.least for column in columns]),
        numbers("most", [column.most for column in columns]),
        numbers("grid", [column.grid or None for column in columns]),  # None prints as a dash, in place of 0
        numbers("noise", [column.noise or None for column in columns]),
        words("", [_remarks_on_column(column) for column in columns], style=Style.NEAR),
        most=_MAX_ROWS,
    )
    yield from remarks(quality.notes)


def _clock_text(quality: LogQuality) -> str:
    """Number of rows, duration and rate of the log, and irregular steps."""
    rows = "1 row" if quality.rows == 1 else f"{quality.rows} rows"
    if not quality.time:
        return f"{rows}, no column of time"
    duration, rate = number(quality.seconds), number(quality.rate)
    parts = [f"{rows} in {duration} s, {rate} Hz by the usual step"]
    relative_jitter = quality.jitter * quality.rate
    if math.isfinite(quality.jitter) and relative_jitter > _MIN_JITTER:
        parts.append(f"steps vary by {percent(relative_jitter, 2)}")
    longest_gap = f", the longest {number(quality.longest)} s"
    irregularities = (  # number, noun for one, noun for several
        (quality.gaps, f"gap{longest_gap}", f"gaps{longest_gap}"),
        (quality.repeated, "stamp repeated", "stamps repeated"),
        (quality.backward, "stamp runs back", "stamps run back"),
    )
    for count, singular, plural in irregularities:
        if count:
            noun = singular if count == 1 else plural
            parts.append(f"{count} {noun}")
    return "; ".join(parts)


def _remarks_on_column(column: LogColumn) -> str:
    """Remarks on saturation, zeros and grid of a column; empty if there are none."""
    if column.dead:
        return "one number throughout"
    column_remarks = []
    if column.cut:
        column_remarks.append(f"cut off: {percent(column.cut, 2)} of the rows at an extreme")
    if column.zeros > _MAX_SHARE_OF_ZEROS:
        column_remarks.append(f"exactly 0 in {percent(column.zeros, 2)} of the rows")
    extent = column.most - column.least
    if column.grid and extent < _MIN_GRID_STEPS * column.grid:
        step_count = round(extent / column.grid)
        column_remarks.append(f"no more than {step_count} steps of its grid in all")
    return "; ".join(column_remarks)


def _without_infinities(value: Any) -> Any:
    """Data for JSON, in which numbers that are not finite become None."""
    if isinstance(value, dict):
        return {name: _without_infinities(entry) for name, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_without_infinities(entry) for entry in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
