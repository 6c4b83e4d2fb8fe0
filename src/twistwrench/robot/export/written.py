"""Result of an export: the written files."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from ...answers.answer import Answer
from ...answers.blocks import Block, Headline, Table, words
from ...core.verdict import Verdict, Word


class Written(tuple[Path, ...], Answer):
    """Written files as a tuple of paths, and the answer of ``twistwrench export``; the verdict is DONE.

    The truth of it is that of a tuple.

    Parameters
    ----------
    files : iterable of Path
    path : Path of the folder, or of the main file
    robot : str, name of the robot

    Examples
    --------
    >>> import tempfile, twistwrench as tw
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     written = tw.robots.pendulum().export_c("gravity_forces", folder)
    >>> [file.name for file in written], str(written.verdict.word), written.path.name
    (['pendulum.h', 'pendulum.c', 'pendulum_test.c'], 'DONE', 'pendulum.c')
    """

    call = "export"
    path: Path
    """The folder, or the main file."""
    _robot: str

    def __new__(cls, files: Iterable[Path], path: Path, robot: str) -> Written:
        """Tuple of the files."""
        written = super().__new__(cls, files)
        written.path, written._robot = path, robot
        return written

    def __getnewargs__(self) -> tuple[tuple[Path, ...], Path, str]:
        return tuple(self), self.path, self._robot

    def __bool__(self) -> bool:
        return len(self) > 0

    @property
    def robot_name(self) -> str:
        """Name of the robot."""
        return self._robot

    @property
    def brief(self) -> str:
        """Number of files."""
        return f"{len(self)} file{'s' * (len(self) != 1)}"

    @property
    def verdict(self) -> Verdict:
        """DONE."""
        return Verdict(Word.DONE)

    def blocks(self) -> Iterator[Block]:
        """Verdict with the file or folder, and the files.

        Returns
        -------
        blocks : iterator of Block
        """
        yield Headline(Word.DONE, f"wrote {self.path}.")
        yield Table("", words("file", [file.name for file in self], fold=False))
