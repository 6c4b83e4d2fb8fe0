"""First and last bytes of a file, which show its kind, its header and whether it is truncated; a small file is read once."""

from __future__ import annotations

import io
import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, cast

if TYPE_CHECKING:
    from _typeshed import WriteableBuffer

_START_SIZE = 1 << 19
"""Number of bytes that are read at the beginning of a file: 512 KiB."""
_END_SIZE = 1 << 14
"""Number of bytes that are read at the end of a file: 16 KiB."""


@dataclass(frozen=True, eq=False)
class FileEnds:
    """First and last bytes of a regular file; empty for a folder, a pipe, and a file that cannot be read."""

    path: Path
    start: bytes = b""
    """First bytes; all bytes of a small file."""
    end: bytes = b""
    """Last bytes."""
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
        """Ends of an open file, whose position is set to the beginning."""
        size = file.seek(0, os.SEEK_END)
        file.seek(max(0, size - _END_SIZE))
        end = file.read(_END_SIZE)
        file.seek(0)
        start = file.read(_START_SIZE)
        file.seek(0)
        return cls(path, start, end, size)

    def after(self, offset: int) -> bytes:
        """Last bytes of the file from ``offset`` on, which is counted from the beginning of the file."""
        end_offset = self.size - len(self.end)
        return self.end[max(0, offset - end_offset) :]

    def open(self) -> BinaryIO:
        """Stream of the file from its beginning; the file is only opened if bytes between its ends are read."""
        return cast("BinaryIO", io.BufferedReader(_BetweenEnds(self)))


class _BetweenEnds(io.RawIOBase):
    """Stream of a file whose ends are known. The file is opened when bytes between the ends are read."""

    def __init__(self, ends: FileEnds) -> None:
        self._ends = ends
        self._offset = 0
        self._file: io.FileIO | None = None

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        origins = {os.SEEK_SET: 0, os.SEEK_CUR: self._offset, os.SEEK_END: self._ends.size}
        self._offset = origins.get(whence, 0) + offset
        return self._offset

    def readinto(self, buffer: WriteableBuffer) -> int:
        view = memoryview(buffer)
        ends = self._ends
        end_offset = ends.size - len(ends.end)
        if len(ends.start) <= self._offset < end_offset:
            if self._file is None:
                self._file = ends.path.open("rb", buffering=0)
            self._file.seek(self._offset)
            byte_count = self._file.readinto(view[: end_offset - self._offset]) or 0
        else:
            known_bytes = ends.start[self._offset :] or ends.end[self._offset - end_offset :]
            byte_count = min(len(known_bytes), len(view))
            view[:byte_count] = known_bytes[:byte_count]
        self._offset += byte_count
        return byte_count

    def close(self) -> None:
        if self._file:
            self._file.close()
        super().close()
