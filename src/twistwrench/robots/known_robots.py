"""Function of the command ``robots``: bundled robots, and those of installed packages."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from .. import robots
from ..core.answers.answer import Answer
from ..core.answers.blocks import Aligned, Block, Level, More, Table, numbers, words
from ..core.colours import Style
from ..core.errors import UnknownNameError
from ..core.text import text_width
from ..core.verdict import Verdict, Word
from .finding import FoundRobot, known_robots, plain_name

__all__ = ["KnownRobots"]

_BUNDLED_SOURCE = "twistwrench"
"""Source of the bundled robots; see :class:`FoundRobot`."""


@dataclass(frozen=True, eq=False, repr=False)
class KnownRobots(Answer):
    """Robots that :func:`twistwrench.load` takes by name; nothing is judged, so the verdict is DONE.

    Examples
    --------
    >>> import twistwrench as tw
    >>> known = tw.robots.known("planar")
    >>> known.bundled, str(known.verdict.word), known.tables["robot"].rows()[0]["dq"]
    (('planar_2r', 'planar_3r'), 'DONE', 2)
    """

    bundled: tuple[str, ...]
    """Names of bundled robots."""
    others: tuple[FoundRobot, ...]
    """Robots of other installed packages, sorted by name."""
    call = "robots"  # command

    @classmethod
    def from_word(cls, word: str) -> KnownRobots:
        """Known robots with a word in the name, or in the description of a bundled one.

        Parameters
        ----------
        word : str, empty for all

        Returns
        -------
        known : KnownRobots

        Raises
        ------
        UnknownNameError
            There are none.

        Examples
        --------
        >>> KnownRobots.from_word("quadruped").bundled
        ('quadruped',)
        """
        known = known_robots()
        bundled = []
        for name in robots.names():
            name_and_description = f"{name} {_description(name)}".lower()
            if word.lower() in name_and_description:
                bundled.append(name)
        others = []
        for name, robot in sorted(known.items()):
            if robot.source != _BUNDLED_SOURCE and plain_name(word) in name:
                others.append(robot)
        if not bundled and not others:
            raise UnknownNameError.from_choices("robot", word, known)
        return cls(tuple(bundled), tuple(others))

    @property
    def verdict(self) -> Verdict:
        """DONE."""
        return Verdict(Word.DONE)

    @property
    def brief(self) -> str:
        """Number of names."""
        return f"{len(self.bundled) + len(self.others)} names"

    def blocks(self) -> Iterator[Block]:
        """Bundled robots, names of the others, and their files.

        Returns
        -------
        blocks : iterator of Block
        """
        if self.bundled:
            yield _bundled_table(self.bundled)
        robots_by_source: dict[str, list[FoundRobot]] = {}
        for robot in self.others:
            robots_by_source.setdefault(robot.source, []).append(robot)
        for source, robots_of_source in robots_by_source.items():
            names_by_file = _names_by_file(robots_of_source)
            shortest_names = sorted(names[0] for names in names_by_file.values())  # the first one of each file
            count_text = "1 robot" if len(shortest_names) == 1 else f"{len(shortest_names)} robots"
            yield Aligned(f"{count_text} of {source}", [("", " ".join(shortest_names))], name_columns, gap="")
        for source, robots_of_source in robots_by_source.items():
            yield _file_table(source, robots_of_source)
        if self.others:
            yield More("Files, and further names of the same robots")


def name_columns(names: str, width: int) -> list[str]:
    """Rows of at most ``width`` characters from names separated by blanks; each name begins at a column of 13 characters."""
    rows = [""]
    for name in names.split():
        start = 0
        if rows[-1]:
            width_with_gap = text_width(rows[-1]) + _MIN_GAP
            start = _COLUMN_WIDTH * math.ceil(width_with_gap / _COLUMN_WIDTH)
        if rows[-1] and start + text_width(name) > width:
            rows.append("")
            start = 0
        rows[-1] = rows[-1].ljust(start) + name
    return rows


_COLUMN_WIDTH = 13
"""Width of a column of names [characters]."""
_MIN_GAP = 2
"""Smallest number of blanks between two names."""


def _description(name: str) -> str:
    """First line of the docstring of a bundled robot, without its remark on options."""
    docstring = getattr(robots, name).__doc__ or ""
    first_line, *_ = docstring.strip().split("\n")
    description, _, _ = first_line.partition("; options as")
    return description.replace("``", "")


def _bundled_table(names: Sequence[str]) -> Table:
    """Table of bundled robots, with their sizes and descriptions."""
    coordinate_counts, velocity_counts, masses = [], [], []
    for name in names:
        model = getattr(robots, name)().model
        coordinate_counts.append(model.nq)
        velocity_counts.append(model.nv)
        masses.append(model.moving_mass)
    return Table(
        "",
        words("robot", names, fold=False, style=Style.STRONG),
        numbers("q", coordinate_counts),
        numbers("dq", velocity_counts),
        numbers("kg", masses),
        words("what it is", map(_description, names)),
    )


def _names_by_file(robots_of_source: Sequence[FoundRobot]) -> dict[str, list[str]]:
    """Names of each file, the shortest first; a file is written with its last two folders."""
    names_by_file: dict[str, list[str]] = {}
    for robot in robots_of_source:
        file = "/".join(robot.path.parts[-3:])
        names_by_file.setdefault(file, []).append(robot.name)
    return {file: sorted(names, key=lambda name: (len(name), name)) for file, names in names_by_file.items()}


def _file_table(source: str, robots_of_source: Sequence[FoundRobot]) -> Table:
    """Table with one row per file."""
    names_by_file = _names_by_file(robots_of_source)
    name_texts = [", ".join(names) for names in names_by_file.values()]
    return Table(
        "",
        words(f"of {source}", name_texts, fold=False, style=Style.STRONG),
        words("file", names_by_file),
        level=Level.ALL,
    )
