"""A text file as UTF-8 with lines that end in newlines, whatever it is on disk: plain, UTF-16, packed by gzip, or a pipe."""

from __future__ import annotations

import codecs
import gzip
import io
import stat
import tempfile
import weakref
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, BinaryIO, cast

from ..errors import NotFoundError, TrajectoryError

_GZIP = b"\x1f\x8b"
_BOMS = (
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
_PORTION = 1 << 20
_LOOK = 1 << 12
_KEPT_IN_MEMORY = 1 << 24


@dataclass(frozen=True, eq=False)
class TextSource:
    """A file that can be read from any place, any number of times.

    What is not plain text on disk is copied once: into memory, or into a nameless temporary file if it is long.
    """

    path: Path
    size: int
    """Size of the plain text [bytes]."""
    _copy: IO[bytes] | None = None

    @classmethod
    def from_path(cls, path: Path) -> TextSource:
        """Look at the file; raises NotFoundError, and TrajectoryError where it cannot be read."""
        if _is_folder(path):
            raise TrajectoryError(f"{path}: is a folder. Give the CSV file of the motion itself.")
        try:
            with path.open("rb") as file:
                regular = stat.S_ISREG(path.stat().st_mode)
                head = file.read(_LOOK)
                if regular and head[:2] != _GZIP and _encoding(head) is None and not _old_line_ends(head):
                    return cls(path, file.seek(0, 2))
                return _copied(path, head, file)
        except FileNotFoundError:
            raise NotFoundError(f"no motion file {str(path)!r}. Give the path of a CSV file.") from None
        except (EOFError, zlib.error, gzip.BadGzipFile) as problem:
            raise TrajectoryError(
                f"{path}: cannot be unpacked: {problem}. Pack it again, or give it unpacked."
            ) from None
        except UnicodeError as problem:
            raise TrajectoryError(
                f"{path}: is not the text that its first bytes say: {problem}. Save it as UTF-8."
            ) from None
        except (OSError, ValueError) as problem:  # ValueError: a path with a NUL
            said = getattr(problem, "strerror", None) or problem
            raise TrajectoryError(f"{path}: cannot be read: {said}. A file that can be read is needed.") from None

    def open(self) -> BinaryIO:
        """The text from its beginning; several may be open at once."""
        if self._copy is None:
            return self.path.open("rb")
        return cast("BinaryIO", io.BufferedReader(_Window(self._copy)))


class _Window(io.RawIOBase):
    """A file with a place of its own in another one."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file, self._at = file, 0

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        self._file.seek(self._at)
        text = self._file.read(len(buffer))
        buffer[: len(text)] = text
        self._at += len(text)
        return len(text)

    def seek(self, offset: int, whence: int = 0) -> int:
        self._at = self._file.seek(offset, whence) if whence == 2 else offset + (self._at if whence == 1 else 0)
        return self._at

    def tell(self) -> int:
        return self._at


def _is_folder(path: Path) -> bool:
    try:
        return path.is_dir()
    except (OSError, ValueError):  # no path at all; opening it says so
        return False


def _copied(path: Path, head: bytes, file: BinaryIO) -> TextSource:
    copy = cast("IO[bytes]", tempfile.SpooledTemporaryFile(_KEPT_IN_MEMORY))  # noqa: SIM115  it lives as long as the source
    size = 0
    try:
        for portion in _plain(head, file):
            size += copy.write(portion)
    except BaseException:
        copy.close()
        raise
    source = TextSource(path, size, copy)
    weakref.finalize(source, copy.close)
    return source


def _plain(head: bytes, file: BinaryIO) -> Iterator[bytes]:
    """The text in portions, unpacked, in UTF-8."""
    portions = _portions(head, file)
    if head[:2] == _GZIP:
        packed = gzip.GzipFile(fileobj=cast("BinaryIO", _Joined(head, file)))
        portions = iter(lambda: packed.read(_PORTION), b"")
        head = next(portions, b"")
        portions = _chained(head, portions)
    encoding = _encoding(head)
    decoder = codecs.getincrementaldecoder(encoding)() if encoding else None
    old = decoder is None and _old_line_ends(head)
    for portion in portions:
        text = decoder.decode(portion).encode("utf-8") if decoder else portion
        yield text.replace(b"\r", b"\n") if old else text
    if decoder:
        yield decoder.decode(b"", final=True).encode("utf-8")


def _portions(head: bytes, file: BinaryIO) -> Iterator[bytes]:
    yield head
    while portion := file.read(_PORTION):
        yield portion


def _chained(first: bytes, rest: Iterator[bytes]) -> Iterator[bytes]:
    yield first
    yield from rest


class _Joined(io.RawIOBase):
    """Bytes that were read already, then the rest of their file."""

    def __init__(self, head: bytes, rest: BinaryIO) -> None:
        self._head, self._rest = head, rest

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        text = self._head[: len(buffer)] or self._rest.read(len(buffer))
        self._head = self._head[len(buffer) :]
        buffer[: len(text)] = text
        return len(text)


def _encoding(head: bytes) -> str | None:
    """The encoding that the first bytes show, None if it may be UTF-8."""
    for mark, name in _BOMS:
        if head.startswith(mark):
            return name
    if len(head) >= 4 and head[0] and not head[1] and head[2] and not head[3]:
        return "utf-16-le"
    if len(head) >= 4 and not head[0] and head[1] and not head[2] and head[3]:
        return "utf-16-be"
    return None


def _old_line_ends(head: bytes) -> bool:
    return b"\r" in head and b"\n" not in head
