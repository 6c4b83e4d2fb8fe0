"""First and last bytes of a file, which show its kind, its header and whether it is cut; a small file is read once."""

from __future__ import annotations

import io
import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, cast

if TYPE_CHECKING:
    from _typeshed import WriteableBuffer

_START_SIZE, _END_SIZE = 1 << 19, 1 << 14
"""Bytes read at the beginning and at the end of a file."""


@dataclass(frozen=True, eq=False)
class FileEnds:
    """First and last bytes of a regular file; empty for a folder, a pipe, and a file that cannot be read."""

    path: Path
    start: bytes = b""
    end: bytes = b""
    size: int = 0
    """Size of the file [bytes]."""

    @classmethod
    def from_path(cls, path: Path) -> FileEnds:
        """Open the file once and read both ends."""
        try:
            if not path.is_file():  # reading a pipe here would consume its data
                return cls(path)
            with path.open("rb") as file:
                return cls.from_file(path, file)
        except (OSError, ValueError):  # ValueError: a path with a NUL
            return cls(path)

    @classmethod
    def from_file(cls, path: Path, file: BinaryIO) -> FileEnds:
        """Ends of an open file, which is left at its beginning."""
        size = file.seek(0, os.SEEK_END)
        file.seek(max(0, size - _END_SIZE))
        end = file.read(_END_SIZE)
        file.seek(0)
        start = file.read(_START_SIZE)
        file.seek(0)
        return cls(path, start, end, size)

    def after(self, offset: int) -> bytes:
        """Last bytes of the file, as far as they follow an offset from its beginning."""
        return self.end[max(0, offset - (self.size - len(self.end))) :]

    def open(self) -> BinaryIO:
        """Read the file from its beginning; it is opened at the first byte between its ends."""
        return cast("BinaryIO", io.BufferedReader(_BetweenEnds(self)))


class _BetweenEnds(io.RawIOBase):
    """Bytes of a file whose ends are known: the file is opened if others are read."""

    def __init__(self, ends: FileEnds) -> None:
        self._ends, self._at = ends, 0
        self._file: io.FileIO | None = None

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        self._at = offset + {os.SEEK_CUR: self._at, os.SEEK_END: self._ends.size}.get(whence, 0)
        return self._at

    def readinto(self, buffer: WriteableBuffer) -> int:
        view, ends = memoryview(buffer), self._ends
        end = ends.size - len(ends.end)
        if len(ends.start) <= self._at < end:
            self._file = self._file or ends.path.open("rb", buffering=0)
            self._file.seek(self._at)
            count = self._file.readinto(view[: end - self._at]) or 0
        else:
            known = ends.start[self._at :] or ends.end[self._at - end :]
            count = min(len(known), len(view))
            view[:count] = known[:count]
        self._at += count
        return count

    def close(self) -> None:
        if self._file:
            self._file.close()
        super().close()
