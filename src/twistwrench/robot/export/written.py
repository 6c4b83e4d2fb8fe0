"""Results of writing a robot: the files of an export, and what a robot file cannot represent."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from ...core.answers.answer import Answer
from ...core.answers.blocks import Block, Headline, Line, Table, words
from ...core.verdict import Verdict, Word
from ...mechanics.model.description import grouped


class _Files(Answer):
    """Answer about written files of a robot, beside a list or tuple: true if this has entries."""

    path: Path
    """The file, the folder, or the main file."""
    _robot: str

    def __bool__(self) -> bool:
        return len(self) > 0

    def __len__(self) -> int:
        raise NotImplementedError  # subclasses inherit it from list or tuple

    @property
    def robot_name(self) -> str:
        """Name of the robot."""
        return self._robot

    @property
    def verdict(self) -> Verdict:
        """DONE."""
        return Verdict(Word.DONE)


class Written(tuple[Path, ...], _Files):
    """Written files as a tuple of paths, and the answer of ``twistwrench export``; the verdict is DONE.

    It is true if there are files, as a tuple is.

    Parameters
    ----------
    files : iterable of Path
    path : Path of the folder, or of the main file
    robot : str, name of the robot
    check : str, command that compiles and runs the test program; empty without one

    Examples
    --------
    >>> import tempfile, twistwrench as tw
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     written = tw.robots.pendulum().export_c("gravity_forces", folder)
    >>> [file.name for file in written], str(written.verdict.word), written.path.name
    (['pendulum.h', 'pendulum.c', 'pendulum_test.c'], 'DONE', 'pendulum.c')
    """

    call = "export"
    check: str
    """Command that compiles and runs the test program."""

    def __new__(cls, files: Iterable[Path], path: Path, robot: str, check: str = "") -> Written:
        """Make the tuple of the files."""
        written = super().__new__(cls, files)
        written.path = path
        written._robot = robot
        written.check = check
        return written

    @classmethod
    def joined(cls, exports: Sequence[Written]) -> Written:
        """Files of several exports of one robot.

        Parameters
        ----------
        exports : sequence of Written, at least one

        Returns
        -------
        written : Written

        Examples
        --------
        >>> one, other = (Written([Path(name)], Path(name), "arm") for name in ("arm.st", "arm.c"))
        >>> Written.joined([one, other]).brief
        '2 files'
        """
        first_export = exports[0]
        if len(exports) == 1:
            return first_export
        files: list[Path] = []
        commands = ""
        for export in exports:
            files += export
            commands += export.check
        return cls(files, first_export.path, first_export.robot_name, commands)

    def __getnewargs__(self) -> tuple[tuple[Path, ...], Path, str, str]:
        return tuple(self), self.path, self._robot, self.check

    @property
    def brief(self) -> str:
        """Number of files."""
        return "1 file" if len(self) == 1 else f"{len(self)} files"

    def blocks(self) -> Iterator[Block]:
        """Verdict with the file or folder, the files, and how to check them.

        Returns
        -------
        blocks : iterator of Block
        """
        yield Headline(Word.DONE, f"wrote {self.path}.", whole=True)
        yield Table("", words("file", [file.name for file in self], fold=False))
        if self.check:
            yield Line(f"to check it: {self.check}", whole=True)


class Saved(list[str], _Files):
    """Lost properties of a robot in a file, as a list of sentences, and the answer of ``twistwrench convert``.

    The verdict is DONE, or UNSURE if ``strict`` and properties are lost. It is true if properties are lost, as a list is.

    Parameters
    ----------
    lost : iterable of str, a sentence on each lost property
    path : Path of the file
    robot : str, name of the robot
    strict : bool, lost properties count against the verdict

    Examples
    --------
    >>> import tempfile, twistwrench as tw
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     saved = tw.save(tw.robots.planar_2r(), f"{folder}/arm.urdf")
    >>> saved, str(saved.verdict.word), saved.path.name
    ([], 'DONE', 'arm.urdf')
    """

    call = "convert"

    def __init__(self, lost: Iterable[str], path: Path, robot: str, *, strict: bool = False) -> None:
        super().__init__(lost)
        self.path = path
        self._robot = robot
        self.strict = strict
        """True if lost properties count against the verdict."""

    @property
    def verdict(self) -> Verdict:
        """DONE, or UNSURE if ``strict`` and the format cannot represent everything."""
        if self and self.strict:
            return Verdict(Word.UNSURE, (self._loss_text,))
        return super().verdict

    @property
    def _loss_text(self) -> str:
        """Number of lost properties, in a sentence without full stop; empty if none is lost."""
        if not self:
            return ""
        properties = "1 property" if len(self) == 1 else f"{len(self)} properties"
        return f"The format cannot represent {properties}"

    def blocks(self) -> Iterator[Block]:
        """Verdict with the file, and the lost properties.

        Returns
        -------
        blocks : iterator of Block
        """
        loss_sentence = f" {self._loss_text}." if self else ""
        yield Headline(self.verdict.word, f"wrote {self.path}.{loss_sentence}", whole=True)
        yield from (f"lost: {sentence}" for sentence in grouped(self))
