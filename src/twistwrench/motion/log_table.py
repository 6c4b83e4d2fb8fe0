"""Storage of a log, below its readers: ends of a file, text as seekable UTF-8, rows decoded once into a table of float64.

A file is opened for its head and for its rows; a file of up to half a megabyte is opened once. A temporary file without a name
holds text that is not plain on disk, and tables above 32 MiB. :mod:`.motion_file` opens files of any format as such tables.
"""

from __future__ import annotations

import codecs
import contextlib
import gzip
import io
import os
import stat
import tempfile
import weakref
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, cast

import numpy as np

from ..core.errors import NotFoundError, TrajectoryError
from ..core.numbers import number, printed
from ..core.typing import Array

if TYPE_CHECKING:
    from _typeshed import WriteableBuffer

MAX_TABLE_IN_MEMORY = 1 << 25
"""Largest table in memory [bytes]; larger ones are in a temporary file, whose pages the system can evict."""
ROWS = 1 << 14
"""Rows per block in passes over a table."""


MAX_RATIO = 100
"""Largest size of data in multiples of the file's that holds it. Logs are packed to a third to a thirtieth of their size."""
FREE_UNPACKED_SIZE = 1 << 28
"""Size of data that a file of any size may hold [bytes]."""


def most_unpacked(packed: int) -> int:
    """Largest size [bytes] of the data of a file of ``packed`` bytes."""
    return max(FREE_UNPACKED_SIZE, MAX_RATIO * packed)


def check_ratio(path: Path, unpacked: int, packed: int) -> None:
    """Raise TrajectoryError if data of ``unpacked`` bytes are out of proportion to their file of ``packed`` bytes."""
    limit = most_unpacked(packed)
    if unpacked > limit:
        raise TrajectoryError(
            f"{path}: has {number(packed / 2**20)} MiB and unpacks to more than {number(limit / 2**20)} MiB, which no log "
            "does. If it is a log, unpack it before, or save parts of it."
        )


def table_of(portions: Iterable[Array], columns: int, path: Path) -> Array:
    """Writable table (n, columns) of consecutive portions of rows; raises TrajectoryError if the disk is full.

    >>> table_of([np.ones((2, 3)), np.zeros((1, 3))], 3, Path("log.csv")).shape
    (3, 3)
    """
    with contextlib.ExitStack() as closing:  # a memory map outlives its file
        parts, rows, file = list[Array](), 0, None
        try:
            for portion in portions:
                rows += len(portion)
                parts.append(portion)
                if 8 * rows * columns <= MAX_TABLE_IN_MEMORY and file is None:
                    continue
                file = file or closing.enter_context(tempfile.TemporaryFile())
                for part in parts:
                    file.write(np.ascontiguousarray(part, float).data)
                file.flush()
                parts.clear()
        except OSError as problem:
            raise TrajectoryError(
                f"{path}: its rows take {printed(8e-9 * rows * columns, 2)} GB or more in {tempfile.gettempdir()}, "
                f"which cannot be written: {problem.strerror or problem}. Free the space, or set TMPDIR."
            ) from None
        if file is None:
            return np.concatenate([np.zeros((0, columns)), *parts])
        return np.memmap(file, np.float64, "r+", shape=(rows, columns))


def slices(count: int, rows: int = 0) -> Iterator[slice]:
    """Consecutive slices of ``rows`` rows each."""
    rows = rows or ROWS
    return (slice(k, min(k + rows, count)) for k in range(0, count, rows))


def without_times(table: Array, times: Iterable[float]) -> Array:
    """Remove the rows with the given times (first column), in place."""
    end, removed_times = 0, list(times)
    for s in slices(len(table)):
        rows = table[s][~np.isin(table[s, 0], removed_times)]
        table[end : end + len(rows)] = rows
        end += len(rows)
    return table[:end]


def excerpts(table: Array, count: int, rows: int) -> list[Array]:
    """Up to ``count`` runs of ``rows`` rows, evenly spread over the table including its ends; a short table whole.

    >>> [run[:, 0].tolist() for run in excerpts(np.arange(10.0)[:, None], 2, 3)]
    [[0.0, 1.0, 2.0], [7.0, 8.0, 9.0]]
    """
    return [np.array(table[s]) for s in spread_rows(len(table), count, rows)]


def spread_rows(total: int, count: int, rows: int) -> list[slice]:
    """Up to ``count`` slices of ``rows`` rows, evenly spread over ``total`` rows; one slice if these are few.

    >>> spread_rows(10, 2, 3), spread_rows(10, 1, 4), spread_rows(10, 0, 4)
    ([slice(0, 3, None), slice(7, 10, None)], [slice(3, 7, None)], [])
    """
    if count and total <= count * rows:
        return [slice(0, total)]
    if count == 1:
        return [slice((total - rows) // 2, (total - rows) // 2 + rows)]
    firsts = [(total - rows) * k // (count - 1) for k in range(count)]
    return [slice(first, first + rows) for first in firsts]


def windows(count: int, core: int, margin: int) -> Iterator[tuple[slice, slice]]:
    """Windows of ``core`` rows with up to ``margin`` more on either side, and the slice of the core in each.

    The last core includes the remaining rows if they are fewer than ``margin``.

    >>> [(a.start, a.stop, b.start, b.stop) for a, b in windows(9, 4, 2)]
    [(0, 6, 0, 4), (2, 9, 2, 7)]
    """
    begin = 0
    while begin < count:
        end = begin + core
        if count - end < margin:
            end = count
        first = max(0, begin - margin)
        yield slice(first, min(end + margin, count)), slice(begin - first, end - first)
        begin = end


# ── Beginning and end of a file, which show its kind, its header and whether it is cut

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


# ── Text in any form on disk: plain, UTF-16, gzip, or a pipe

_GZIP = b"\x1f\x8b"
_BOMS = (
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
_PORTION_SIZE = 1 << 20
"""Bytes of a text that are decoded at once."""
_HEAD_SIZE = 1 << 12
"""First bytes of a file by which its form is recognised."""
_MAX_COPY_IN_MEMORY = 1 << 24
"""Largest copy of a text in memory [bytes]."""


@dataclass(frozen=True, eq=False)
class TextSource:
    """Seekable text of a file, readable repeatedly; copied to memory or a temporary file unless it is plain text."""

    ends: FileEnds
    """Beginning and end of the plain text, and its size."""
    _copy: BinaryIO | None = None

    @classmethod
    def from_ends(cls, ends: FileEnds) -> TextSource:
        """Text of a file whose ends were read; raises NotFoundError, and TrajectoryError if it cannot be read."""
        path = ends.path
        if os.path.isdir(path):  # noqa: PTH112  False if the text cannot be a path
            raise TrajectoryError(f"{path}: is a folder. Give the CSV file of the motion itself.")
        if ends.start and _is_plain(ends.start):
            return cls(ends)
        copy = _plain_copy(path)
        source = cls(FileEnds.from_file(path, copy), copy)
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
    return not (head.startswith(_GZIP) or _encoding(head) or _has_old_line_ends(head))


def _has_old_line_ends(head: bytes) -> bool:
    """True if lines end in carriage returns alone."""
    return b"\r" in head and b"\n" not in head


def _plain_copy(path: Path) -> BinaryIO:
    """Copy of a text in UTF-8 with newlines; raises NotFoundError and TrajectoryError."""
    try:
        with path.open("rb") as file:
            raw: BinaryIO = file
            if not stat.S_ISREG(path.stat().st_mode):
                raw = _copy_portions(_portions(file))
            size = raw.seek(0, os.SEEK_END)
            raw.seek(0)
            packed = raw.read(2) == _GZIP
            raw.seek(0)
            text: BinaryIO = raw
            if packed:
                text = cast("BinaryIO", gzip.GzipFile(fileobj=raw))
            head = text.read(_HEAD_SIZE)
            text.seek(0)
            if raw is not file and _is_plain(head) and not packed:
                return raw
            plain = _plain_portions(text, _encoding(head), old=_has_old_line_ends(head))
            if packed:
                plain = _check_proportion(plain, path, size)
            return _copy_portions(plain)
    except TrajectoryError:
        raise
    except FileNotFoundError:
        raise NotFoundError(f"no motion file {str(path)!r}. Give the path of a CSV file.") from None
    except (EOFError, zlib.error, gzip.BadGzipFile) as problem:
        raise TrajectoryError(f"{path}: cannot be unpacked: {problem}. Pack it again, or give it unpacked.") from None
    except UnicodeError as problem:
        raise TrajectoryError(
            f"{path}: is not text in the encoding of its first bytes: {problem}. Save it as UTF-8."
        ) from None
    except (OSError, ValueError) as problem:  # ValueError: a path with a NUL
        reason = getattr(problem, "strerror", None) or problem
        raise TrajectoryError(f"{path}: cannot be read: {reason}. A file that can be read is needed.") from None


def _portions(file: BinaryIO) -> Iterator[bytes]:
    return iter(partial(file.read, _PORTION_SIZE), b"")


def _copy_portions(portions: Iterator[bytes]) -> BinaryIO:
    """Copy in memory, or in a temporary file without a name if large, at its beginning."""
    copy = cast("BinaryIO", tempfile.SpooledTemporaryFile(_MAX_COPY_IN_MEMORY))  # noqa: SIM115  it lives as long as the source
    try:
        for portion in portions:
            copy.write(portion)
    except BaseException:
        copy.close()
        raise
    copy.seek(0)
    return copy


def _check_proportion(portions: Iterator[bytes], path: Path, packed: int) -> Iterator[bytes]:
    """Portions of a packed text, as long as they are in proportion to its size."""
    size = 0
    for portion in portions:
        size += len(portion)
        check_ratio(path, size, packed)
        yield portion


def _plain_portions(file: BinaryIO, encoding: str | None, *, old: bool) -> Iterator[bytes]:
    """Portions of the text in UTF-8; ``old`` if lines end in carriage returns."""
    portions = _portions(file)
    if encoding:
        portions = _encode_utf_8(portions, encoding)
    for portion in portions:
        yield portion.replace(b"\r", b"\n") if old else portion


def _encode_utf_8(portions: Iterator[bytes], encoding: str) -> Iterator[bytes]:
    """Portions of a text in another encoding, in UTF-8."""
    decoder = codecs.getincrementaldecoder(encoding)()
    for portion in portions:
        yield decoder.decode(portion).encode("utf-8")
    yield decoder.decode(b"", final=True).encode("utf-8")


def _encoding(head: bytes) -> str | None:
    """Encoding detected from the first bytes; None if it may be UTF-8."""
    for mark, name in _BOMS:
        if head.startswith(mark):
            return name
    if len(head) >= 4 and head[0] and not head[1] and head[2] and not head[3]:
        return "utf-16-le"
    if len(head) >= 4 and not head[0] and head[1] and not head[2] and head[3]:
        return "utf-16-be"
    return None
