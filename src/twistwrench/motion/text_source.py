"""A text file as UTF-8 with lines that end in newlines, whatever it is on disk: plain, UTF-16, packed by gzip, or a pipe."""

from __future__ import annotations

import codecs
import gzip
import io
import os
import stat
import tempfile
import weakref
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, cast

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
    _copy: BinaryIO | None = None

    @classmethod
    def from_path(cls, path: Path) -> TextSource:
        """Look at the file; raises NotFoundError, and TrajectoryError where it cannot be read."""
        if os.path.isdir(path):  # noqa: PTH112  False where the text is no path at all
            raise TrajectoryError(f"{path}: is a folder. Give the CSV file of the motion itself.")
        try:
            with path.open("rb") as file:
                copy = None if stat.S_ISREG(path.stat().st_mode) else _copied(_portions(file))
                raw = copy or file
                packed, _ = raw.read(2) == _GZIP, raw.seek(0)
                text = cast("BinaryIO", gzip.GzipFile(fileobj=raw)) if packed else raw
                head, _ = text.read(_LOOK), text.seek(0)
                encoding, old = _encoding(head), b"\r" in head and b"\n" not in head
                if packed or encoding or old:
                    copy = text = _copied(_plain(text, encoding, old=old))
                source = cls(path, text.seek(0, 2), copy)
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
        if copy is not None:
            weakref.finalize(source, copy.close)
        return source

    def open(self) -> BinaryIO:
        """The text from its beginning; several may be open at once."""
        if self._copy is None:
            return self.path.open("rb")
        return cast("BinaryIO", io.BufferedReader(_Window(self._copy)))


class _Window(io.RawIOBase):
    """A file with a place of its own in another one."""

    def __init__(self, file: BinaryIO) -> None:
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


def _portions(file: BinaryIO) -> Iterator[bytes]:
    while portion := file.read(_PORTION):
        yield portion


def _copied(portions: Iterator[bytes]) -> BinaryIO:
    """A copy in memory, or in a nameless temporary file if it is long, at its beginning."""
    copy = cast("BinaryIO", tempfile.SpooledTemporaryFile(_KEPT_IN_MEMORY))  # noqa: SIM115  it lives as long as the source
    try:
        for portion in portions:
            copy.write(portion)
    except BaseException:
        copy.close()
        raise
    copy.seek(0)
    return copy


def _plain(file: BinaryIO, encoding: str | None, *, old: bool) -> Iterator[bytes]:
    """The text in portions, in UTF-8; ``old`` lines end in returns."""
    decoder = codecs.getincrementaldecoder(encoding)() if encoding else None
    for portion in _portions(file):
        text = decoder.decode(portion).encode("utf-8") if decoder else portion
        yield text.replace(b"\r", b"\n") if old else text
    if decoder:
        yield decoder.decode(b"", final=True).encode("utf-8")


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
