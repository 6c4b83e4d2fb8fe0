"""What an object file holds, of whatever format: sections, symbols, and relocations relative to the code."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..typing import Array

PAGE = 4096
"""Bytes that sections are aligned to at most."""


class Unplaced(Exception):
    """Code that is not placed here, or a system that runs no code from such pages."""


class CodeSection(NamedTuple):
    """Bytes that are read or run, never written."""

    contents: bytes
    align: int


class Relocations(NamedTuple):
    """Places in a section where the distance to a symbol goes, in four bytes: symbol + addend - place."""

    section: int
    places: Array
    symbols: Array
    addends: Array


class ObjectFile(NamedTuple):
    """An object file, as far as it is loaded."""

    sections: dict[int, CodeSection]
    names: list[bytes]
    """Of each symbol; empty for those that are local to the file."""
    homes: list[int]
    """The section of each symbol; 0 where it is undefined."""
    values: Array
    """Where each symbol is in its section."""
    relocations: list[Relocations]

    def undefined(self) -> set[bytes]:
        """Names that relocations want and the file has not."""
        wanted = {int(k) for r in self.relocations for k in np.unique(r.symbols)}
        return {self.names[k] for k in wanted if self.names[k] and not self.homes[k]}


def table(raw: bytes, kind: np.dtype[Any], offset: int, count: int) -> Array:
    """Rows of a table in a file; raises :class:`Unplaced` where the file ends before them."""
    if offset + count * kind.itemsize > len(raw):
        raise Unplaced
    return np.frombuffer(raw, kind, count, offset)


def text_at(texts: bytes, at: int) -> bytes:
    """The text that begins at a place and ends before a zero."""
    return texts[at : texts.index(b"\0", at)]
