"""Robot file with its content and its elements, each read once."""

from __future__ import annotations

import os
from functools import cached_property
from pathlib import Path

from ..mechanics.model.model import Model
from .source import bytes_of, decode_text, path_given
from .xacro import xacro_in
from .xml import MOST_BODIES, Element, parse

USD = (".usd", ".usda", ".usdc", ".usdz")
"""Suffixes of USD files."""


class RobotFile(str):
    """Path of a robot file with its content, text and elements, each read at first use and kept.

    A pickled copy, as in another process, has only the path, and reads the file again. Properties raise the errors of
    :func:`~twistwrench.formats.source.read_robot_text` and :func:`~twistwrench.formats.xml.parse`.
    """

    @classmethod
    def from_path(cls, path: str | os.PathLike[str], data: bytes | None = None) -> RobotFile:
        """File at a path, with its content if it was read before; raises RobotFileError if ``path`` is not a path."""
        if isinstance(path, cls):
            return path
        file = cls(path_given(path))
        if data is not None:
            file.data = data
        return file

    @cached_property
    def data(self) -> bytes:
        """Content of the file."""
        return bytes_of(Path(self))

    @cached_property
    def text(self) -> str:
        """Text of the file."""
        return decode_text(self.data, str(self))

    @cached_property
    def root(self) -> Element:
        """Root element. After loading, includes of MJCF are replaced by the elements of their files."""
        return self.parse_root()

    def parse_root(self, max_bodies: int = MOST_BODIES) -> Element:
        """Root element. The file is parsed, and its number of bodies checked, only at the first call."""
        if "root" not in vars(self):
            self.root = parse(self.text, max_bodies=max_bodies)
        return self.root

    @cached_property
    def xacro(self) -> str:
        """Name of the first element that only xacro can read; empty if there is none."""
        return xacro_in(self.text, vars(self).get("root"))

    def __reduce__(self) -> tuple[type[RobotFile], tuple[str]]:
        return type(self), (str(self),)


def file_of(model: Model) -> RobotFile | None:
    """File of a model; None if the model has no file, a USD file, or a file that was never parsed and no longer exists."""
    source = model.source
    file = source if isinstance(source, RobotFile) else RobotFile(source)
    if "root" in vars(file):  # parsed before, so the file need not exist any more
        return file
    path = Path(source)
    if source and path.suffix.lower() not in USD and path.is_file():
        return file
    return None
