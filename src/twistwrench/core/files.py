"""Files in: the bytes of a file, of a pipe or of standard input, never more than a bound."""

from __future__ import annotations

import errno
import os
import select
import stat
import sys
import time
from pathlib import Path
from typing import Any

from ..errors import ValueRangeError
from .arguments import shown

MOST_BYTES = 64 * 2**20
"""What a reader takes unless it says otherwise."""

_PORTION = 1 << 16
_PATIENCE = 10.0
"""Seconds that a named pipe is waited for until somebody opens its other end."""


def as_path(path: Any) -> Path:
    """The path that a caller gives, a text or a Path. Raises ValueRangeError for anything else, and for an empty text.

    >>> as_path("motion.csv").suffix
    '.csv'
    """
    if not isinstance(path, str | os.PathLike) or isinstance(path, bytes) or not str(path):
        raise ValueRangeError(f"path is {shown(path)}: give the path of a file, a text or a pathlib.Path.")
    return Path(path)


def is_stream(path: Path) -> bool:
    """Whether the path is there and can be read only once: a pipe, a terminal or another device.

    >>> is_stream(Path("/dev/null")), is_stream(Path("."))
    (True, False)
    """
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):
        return False
    return stat.S_ISFIFO(mode) or stat.S_ISCHR(mode) or stat.S_ISSOCK(mode)


def read_bytes(path: Path, most: int = MOST_BYTES) -> bytes:
    """All bytes of a file, or of a pipe or device up to its end.

    A pipe is waited for as long as somebody holds its other end open; one that nobody opens, for ten seconds.

    Raises
    ------
    OSError
        What the system says; with ``EFBIG`` for more than ``most`` bytes, ``ETIMEDOUT`` for a pipe that nobody writes to.

    Examples
    --------
    >>> read_bytes(Path("/dev/zero"), most=1000)
    Traceback (most recent call last):
    OSError: [Errno 27] it has more than 1000 bytes: '/dev/zero'
    """
    handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    try:
        about = os.fstat(handle)
        if stat.S_ISDIR(about.st_mode):
            raise IsADirectoryError(errno.EISDIR, "it is a folder", str(path))
        if stat.S_ISREG(about.st_mode) and about.st_size > most:
            raise _too_large(path, most)
        return _to_the_end(handle, path, most)
    finally:
        os.close(handle)


def read_text(path: Path, most: int = MOST_BYTES) -> str:
    """The text of a file in UTF-8, with or without a byte order mark; lines end as they do in the file.

    Raises what :func:`read_bytes` raises, and UnicodeDecodeError.
    """
    return read_bytes(path, most).decode("utf-8-sig")


def read_standard_input(most: int = MOST_BYTES) -> bytes:
    """All bytes of standard input. Raises OSError with ``EFBIG`` for more than ``most``."""
    data = sys.stdin.buffer.read(most + 1)
    if len(data) > most:
        raise _too_large(Path("-"), most)
    return data


def _to_the_end(handle: int, path: Path, most: int) -> bytes:
    portions: list[bytes] = []
    size, until = 0, time.monotonic() + _PATIENCE
    while True:
        try:
            portion = os.read(handle, _PORTION)
        except BlockingIOError:  # somebody has the other end, and has written nothing yet
            select.select([handle], [], [])
            continue
        if portion:
            portions.append(portion)
            size += len(portion)
            if size > most:
                raise _too_large(path, most)
        elif portions or not _unopened(handle):
            return b"".join(portions)
        elif time.monotonic() > until:
            raise OSError(errno.ETIMEDOUT, "it is a pipe that nobody writes to", str(path))
        else:
            time.sleep(0.01)


def _unopened(handle: int) -> bool:
    """Whether it is a pipe whose other end nobody has opened since this one was: its end would be reported otherwise."""
    if not hasattr(select, "poll") or not stat.S_ISFIFO(os.fstat(handle).st_mode):
        return False
    poll = select.poll()
    poll.register(handle, select.POLLIN)
    return not poll.poll(0)


def _too_large(path: Path, most: int) -> OSError:
    amount = f"{most // 2**20} MiB" if most >= 2**20 else f"{most} bytes"
    return OSError(errno.EFBIG, f"it has more than {amount}", str(path))
