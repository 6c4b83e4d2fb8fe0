"""Result of writing a robot: the properties that the file's format cannot represent."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from ...answers.answer import Answer
from ...answers.blocks import Block, Headline
from ...core.verdict import Verdict, Word
from ...mechanics.model.description import grouped


class Saved(list[str], Answer):
    """Lost properties of a robot in a file, as a list of sentences, and the answer of ``twistwrench convert``.

    The verdict is DONE; if ``strict``, UNSURE with lost properties. The truth of it is that of a list.

    Parameters
    ----------
    lost : iterable of str, sentences
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
        self.path, self.strict = path, strict
        """The file, and True if lost properties count against the verdict."""
        self._robot = robot

    def __bool__(self) -> bool:
        return len(self) > 0

    @property
    def robot_name(self) -> str:
        """Name of the robot."""
        return self._robot

    @property
    def verdict(self) -> Verdict:
        """DONE, or UNSURE if ``strict`` and the format cannot represent everything."""
        return Verdict(Word.UNSURE, (self._loss,)) if self and self.strict else Verdict(Word.DONE)

    @property
    def _loss(self) -> str:
        return f"The format cannot represent {len(self)} propert{'y' if len(self) == 1 else 'ies'}" if self else ""

    def blocks(self) -> Iterator[Block]:
        """Verdict with the file, and the lost properties.

        Returns
        -------
        blocks : iterator of Block
        """
        loss = f" {self._loss}." if self else ""
        yield Headline(self.verdict.word, f"wrote {self.path}.{loss}")
        yield from (f"lost: {sentence}" for sentence in grouped(self))
