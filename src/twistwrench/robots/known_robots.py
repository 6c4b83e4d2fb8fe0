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

_BUNDLED = "twistwrench"


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
    call = "robots"

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
        bundled = [name for name in robots.names() if word.lower() in f"{name} {_description(name)}".lower()]
        others = [
            found for name, found in sorted(known.items()) if found.source != _BUNDLED and plain_name(word) in name
        ]
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
        by_source: dict[str, list[FoundRobot]] = {}
        for found in self.others:
            by_source.setdefault(found.source, []).append(found)
        for source, of_source in by_source.items():
            names = sorted(called[0] for called in _names_by_file(of_source).values())
            count = f"{len(names)} robot{'s' * (len(names) > 1)}"
            yield Aligned(f"{count} of {source}", [("", " ".join(names))], name_columns, gap="")
        for source, of_source in by_source.items():
            yield _file_table(source, of_source)
        if self.others:
            yield More("Files, and further names of the same robots")


def name_columns(names: str, width: int) -> list[str]:
    """Names, separated by blanks, in rows of at most a width; each begins at a multiple of 13 characters."""
    rows = [""]
    for name in names.split():
        start = _STEP * math.ceil((text_width(rows[-1]) + 2 * bool(rows[-1])) / _STEP)
        if rows[-1] and start + text_width(name) > width:
            rows.append("")
            start = 0
        rows[-1] = rows[-1].ljust(start) + name
    return rows


_STEP = 13


def _description(name: str) -> str:
    """First line of the docstring of a bundled robot."""
    first = (getattr(robots, name).__doc__ or "").strip().split("\n")[0]
    return first.partition("; options as")[0].replace("``", "")


def _bundled_table(names: Sequence[str]) -> Table:
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


def _names_by_file(found: Sequence[FoundRobot]) -> dict[str, list[str]]:
    """Names of each file, the shortest first."""
    by_file: dict[str, list[str]] = {}
    for robot in found:
        by_file.setdefault("/".join(robot.path.parts[-3:]), []).append(robot.name)
    return {file: sorted(called, key=lambda name: (len(name), name)) for file, called in by_file.items()}


def _file_table(source: str, found: Sequence[FoundRobot]) -> Table:
    """Table with one row per file."""
    by_file = _names_by_file(found)
    names = [", ".join(called) for called in by_file.values()]
    return Table(
        "", words(f"of {source}", names, fold=False, style=Style.STRONG), words("file", by_file), level=Level.ALL
    )
