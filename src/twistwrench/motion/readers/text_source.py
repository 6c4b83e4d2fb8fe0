"""Text of a file as seekable UTF-8 with newlines. The file may be UTF-16, packed by gzip, or a pipe.

If the file is not plain text on disk, a copy holds the text: in memory, or in a temporary file without a name.
"""

from __future__ import annotations

import codecs
import contextlib
import gzip
import os
import stat
import tempfile
import weakref
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import BinaryIO, cast

from ...core.errors import NotFoundError, TrajectoryError
from ..log_table import check_ratio
from .file_ends import FileEnds

_GZIP_MARK = b"\x1f\x8b"
"""First bytes of a file packed by gzip."""
_BYTE_ORDER_MARKS = (
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
"""First bytes of a text, and its encoding. Marks of UTF-32 come first, as they begin with marks of UTF-16."""
_PORTION_SIZE = 2**20
"""Number of bytes of a text that are decoded at once."""
_HEAD_SIZE = 2**12
"""Number of first bytes of a file by which its form is recognised."""
_MAX_COPY_IN_MEMORY = 2**24
"""Largest copy of a text in memory [bytes]."""


@dataclass(frozen=True, eq=False)
class TextSource:
    """Seekable text of a file, readable repeatedly; copied to memory or a temporary file unless it is plain text."""

    ends: FileEnds
    """Beginning and end of the plain text, and its size."""
    _copy: BinaryIO | None = None
    """Copy of the text; None if the file is plain text."""

    @classmethod
    def from_ends(cls, ends: FileEnds) -> TextSource:
        """Text of a file whose ends were read; raises NotFoundError, and TrajectoryError if it cannot be read."""
        path = ends.path
        if os.path.isdir(path):  # noqa: PTH112  False if the text cannot be a path
            raise TrajectoryError(f"{path}: is a folder. Give the CSV file of the motion itself.")
        if ends.start and _is_plain(ends.start):  # the start of a pipe is empty
            return cls(ends)
        copy = _plain_copy(path)
        ends_of_copy = FileEnds.from_file(path, copy)
        source = cls(ends_of_copy, copy)
        weakref.finalize(source, copy.close)
        return source

    @property
    def path(self) -> Path:
        """Path of the file."""
        return self.ends.path

    @property
    def size(self) -> int:
        """Size of the plain text [bytes]."""
        return self.ends.size

    @contextlib.contextmanager
    def open(self) -> Iterator[BinaryIO]:
        """Open the text at its beginning."""
        if self._copy is None:
            with self.ends.open() as file:
                yield file
        else:
            self._copy.seek(0)
            yield self._copy


def _is_plain(start: bytes) -> bool:
    """True if a file with these first bytes is text in UTF-8 with newlines."""
    head = start[:_HEAD_SIZE]
    is_packed = head.startswith(_GZIP_MARK)
    is_utf_8 = _encoding(head) is None
    return not is_packed and is_utf_8 and not _has_old_line_ends(head)


def _has_old_line_ends(head: bytes) -> bool:
    """True if lines end in carriage returns alone."""
    return b"\r" in head and b"\n" not in head


def _plain_copy(path: Path) -> BinaryIO:
    """Copy of a text in UTF-8 with newlines; raises NotFoundError and TrajectoryError."""
    try:
        with path.open("rb") as file:
            stream: BinaryIO = file
            is_regular_file = stat.S_ISREG(path.stat().st_mode)
            if not is_regular_file:  # a pipe is not seekable: copy it first
                portions = _portions(file)
                stream = _copy_portions(portions)
            size = stream.seek(0, os.SEEK_END)  # packed size, if the file is packed
            stream.seek(0)
            is_packed = stream.read(len(_GZIP_MARK)) == _GZIP_MARK
            stream.seek(0)
            text: BinaryIO = stream
            if is_packed:
                text = cast("BinaryIO", gzip.GzipFile(fileobj=stream, mode="rb"))
            head = text.read(_HEAD_SIZE)
            text.seek(0)
            is_copy = stream is not file
            if is_copy and not is_packed and _is_plain(head):
                return stream
            plain_text = _plain_portions(text, _encoding(head), old_line_ends=_has_old_line_ends(head))
            if is_packed:
                plain_text = _check_proportion(plain_text, path, size)
            copy = _copy_portions(plain_text)
            if is_copy:
                stream.close()
            return copy
    except TrajectoryError:  # raised by check_ratio; other errors get a message below
        raise
    except FileNotFoundError:
        raise NotFoundError(f"no motion file {str(path)!r}. Give the path of a CSV file.") from None
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise TrajectoryError(f"{path}: cannot be unpacked: {error}. Pack it again, or give it unpacked.") from None
    except UnicodeError as error:
        raise TrajectoryError(
            f"{path}: is not text in the encoding of its first bytes: {error}. Save it as UTF-8."
        ) from None
    except (OSError, ValueError) as error:  # ValueError: a path with a NUL
        reason = getattr(error, "strerror", None) or error
        raise TrajectoryError(f"{path}: cannot be read: {reason}. A file that can be read is needed.") from None


def _portions(file: BinaryIO) -> Iterator[bytes]:
    """Portions of a file up to its end."""
    return iter(partial(file.read, _PORTION_SIZE), b"")  # at the end, read returns b""


def _copy_portions(portions: Iterator[bytes]) -> BinaryIO:
    """Copy in memory, or in a temporary file without a name if it is large; its position is the beginning."""
    copy = cast("BinaryIO", tempfile.SpooledTemporaryFile(_MAX_COPY_IN_MEMORY))  # noqa: SIM115  it lives as long as the source
    try:
        for portion in portions:
            copy.write(portion)
    except BaseException:  # also for a keyboard interrupt
        copy.close()
        raise
    copy.seek(0)
    return copy


def _check_proportion(portions: Iterator[bytes], path: Path, packed_size: int) -> Iterator[bytes]:
    """Portions of an unpacked text; raises TrajectoryError once they are out of proportion to the packed size."""
    size = 0
    for portion in portions:
        size += len(portion)
        check_ratio(path, size, packed_size)
        yield portion


def _plain_portions(file: BinaryIO, encoding: str | None, *, old_line_ends: bool) -> Iterator[bytes]:
    """Portions of the text in UTF-8; ``old_line_ends`` is True if lines end in carriage returns alone."""
    portions = _portions(file)
    if encoding:
        portions = _encode_utf_8(portions, encoding)
    if not old_line_ends:
        return portions
    return (portion.replace(b"\r", b"\n") for portion in portions)


def _encode_utf_8(portions: Iterator[bytes], encoding: str) -> Iterator[bytes]:
    """Portions of a text in another encoding, in UTF-8."""
    decoder = codecs.getincrementaldecoder(encoding)()
    for portion in portions:
        yield decoder.decode(portion).encode("utf-8")
    yield decoder.decode(b"", final=True).encode("utf-8")  # raises UnicodeError for an incomplete character


def _encoding(head: bytes) -> str | None:
    """Encoding detected from the first bytes; None if it may be UTF-8."""
    for mark, encoding in _BYTE_ORDER_MARKS:
        if head.startswith(mark):
            return encoding
    # UTF-16 without a mark: one of the two bytes of each ASCII character is zero.
    is_zero = [byte == 0 for byte in head[:4]]
    if is_zero == [False, True, False, True]:
        return "utf-16-le"
    if is_zero == [True, False, True, False]:
        return "utf-16-be"
    return None
