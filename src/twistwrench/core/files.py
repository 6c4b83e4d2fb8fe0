"""Files: bounded reading of files, pipes and standard input; checked and atomic writing."""

from __future__ import annotations

import contextlib
import errno
import os
import select
import stat
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from ..errors import ValueRangeError
from .arguments import shown

MOST_BYTES = 64 * 2**20
"""Default bound of a reader [bytes]."""

_PORTION = 1 << 16
_PATIENCE = 10.0
"""Seconds to wait until another process opens the other end of a named pipe."""


def as_path(path: Any) -> Path:
    """The caller's path, a text or a Path. Raises ValueRangeError for anything else, and for an empty text."""
    if not isinstance(path, str | os.PathLike) or isinstance(path, bytes) or not str(path):
        raise ValueRangeError(f"path is {shown(path)}: give the path of a file, a text or a pathlib.Path.")
    return Path(path)


def is_stream(path: Path) -> bool:
    """True if the path exists and can be read only once: a pipe, a terminal or another device."""
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):
        return False
    return stat.S_ISFIFO(mode) or stat.S_ISCHR(mode) or stat.S_ISSOCK(mode)


def read_bytes(path: Path, most: int = MOST_BYTES) -> bytes:
    """All bytes of a file, or of a pipe or device up to its end.

    A pipe is waited for as long as somebody holds its other end open; one that nobody opens, for ten seconds. Raises OSError,
    with ``EFBIG`` for more than ``most`` bytes, ``ETIMEDOUT`` for a pipe that nobody writes to.

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
    """True if it is a pipe whose other end has not been opened since this one was: its end would be reported otherwise."""
    if not hasattr(select, "poll") or not stat.S_ISFIFO(os.fstat(handle).st_mode):
        return False
    poll = select.poll()
    poll.register(handle, select.POLLIN)
    return not poll.poll(0)


def _too_large(path: Path, most: int) -> OSError:
    amount = f"{most // 2**20} MiB" if most >= 2**20 else f"{most} bytes"
    return OSError(errno.EFBIG, f"it has more than {amount}", str(path))


# ── Writing: harmful outputs are rejected before anything runs, and files are replaced only when complete

PICTURES = (".png", ".pdf", ".svg")
"""Kinds of pictures, by their suffixes."""

_SHEETS = (".xlsx", ".xls", ".xlsm", ".ods")
"""Suffixes of spreadsheets' own formats, none of which is written."""


def picture_path(path: str | Path) -> str:
    """The file a picture goes to: ``path``, with .png added if it has no suffix.

    Raises :class:`~twistwrench.ValueRangeError` for a suffix that is none of :data:`PICTURES`.
    """
    text, suffix = str(as_path(path)), Path(path).suffix.lower()
    if not suffix:
        return text if Path(text).is_dir() else f"{text}.png"  # a folder is refused as one where it is written
    if suffix not in PICTURES:
        raise ValueRangeError(
            f"cannot draw {Path(path).name!r}: pictures of kind {suffix[1:]!r} are not made. "
            f"Choose one of {', '.join(PICTURES)}."
        )
    return text


def check_outputs(outputs: Mapping[str, str | Path | None], inputs: Mapping[str, str | Path | None]) -> None:
    """Reject, before a long run, output files that cannot be written, or that are an input or another output.

    Both map what the user calls a file (``--csv``, ``ROBOT``) to its path, None where it was not given. Links count as what
    they lead to; devices, such as /dev/null, may be shared. Pass a picture's path through :func:`picture_path` first.
    Raises :class:`~twistwrench.ValueRangeError`.
    """
    others = {name: Path(path) for name, path in inputs.items() if path is not None}
    for name, given in outputs.items():
        if given is None:
            continue
        path = Path(given)
        try:
            for other, known in others.items():
                if _same(path, known):
                    raise ValueRangeError(
                        f"{name} {str(given)!r} would overwrite the file of {other}. Give another name."
                    )
            _check_writable(path)
            if name == "--csv" and path.suffix.lower() in _SHEETS:
                raise ValueRangeError(
                    f"--csv {str(given)!r}: CSV is written, which spreadsheets do not open under the ending "
                    f"{path.suffix}. Name it {path.with_suffix('.csv').name!r}."
                )
        except (OSError, RuntimeError) as problem:  # a name too long, links in a circle
            reason = getattr(problem, "strerror", None) or str(problem)
            raise ValueRangeError(f"cannot write {str(path)!r}: {reason}. Give another name.") from None
        others[name] = path


def refuse_existing(path: str | Path, *, overwrite: bool) -> Path:
    """The path, unless a file is there already and ``overwrite`` is False: files of robots are made by hand.

    Devices, such as /dev/stdout, may be written to. Raises :class:`~twistwrench.ValueRangeError`.
    """
    target = as_path(path)
    if target.is_file() and not overwrite:
        raise ValueRangeError(f"{str(target)!r} is there already. Give another name, or overwrite=True.")
    return target


def _same(one: Path, other: Path) -> bool:
    if one.exists() and other.exists():
        return one.is_file() and one.samefile(other)  # hard links too
    return one.resolve() == other.resolve()


def _status(path: Path) -> os.stat_result | None:
    """Status of a file, None if there is none. Raises OSError for names that can have none."""
    try:
        return path.stat()
    except (FileNotFoundError, NotADirectoryError):
        return None


def _check_writable(path: Path) -> None:
    _status(path)
    if path.is_dir():
        raise ValueRangeError(f"cannot write {str(path)!r}: it is a folder. Give a file name.")
    folder = path.resolve().parent
    advice = "Name a file in a folder that exists and is writable."
    if not folder.is_dir():
        raise ValueRangeError(f"cannot write {str(path)!r}: no such folder. {advice}")
    if path.exists() and not os.access(path, os.W_OK):
        raise ValueRangeError(f"cannot write {str(path)!r}: it is write-protected. Give another name.")
    if (path.is_file() or not path.exists()) and not os.access(folder, os.W_OK):
        raise ValueRangeError(f"cannot write {str(path)!r}: the folder is not writable. {advice}")


@contextlib.contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Context with a scratch name in the same folder; without an error the file there becomes ``path``, else it is removed.

    A file that is replaced keeps its mode, and its owner and group where the system allows it; a new one gets the mode that
    the process gives to new files. :class:`~twistwrench.ValueRangeError` if the folder is missing or not writable.
    """
    with replacing_together([path]) as (scratch,):
        yield scratch


@contextlib.contextmanager
def replacing_together(paths: Sequence[str | Path]) -> Iterator[tuple[Path, ...]]:
    """Scratch names for files that belong together, as of :func:`replacing`: all are on the disk before one is renamed."""
    files: list[tuple[Path, Path, os.stat_result | None]] = []  # scratch, what it becomes, and what is there
    at = as_path(paths[0])
    try:
        for path in map(as_path, paths):
            at = path
            files.append(_begun(path))
        yield tuple(scratch for scratch, _, _ in files)
        for path, (scratch, target, before) in zip(map(as_path, paths), files, strict=True):
            at = path
            if scratch != target:
                if before is not None:
                    _keep(scratch, before)
                with scratch.open("rb+") as file:
                    os.fsync(file.fileno())
        for path, (scratch, target, _) in zip(map(as_path, paths), files, strict=True):
            at = path
            if scratch != target:
                os.replace(scratch, target)  # noqa: PTH105  the atomic one, by its plain name
    except BrokenPipeError:
        raise
    except OSError as problem:
        raise ValueRangeError(
            f"cannot write {str(at)!r}: {problem.strerror}. Free space, or give another name."
        ) from None
    finally:
        for scratch, target, _ in files:
            if scratch != target:
                scratch.unlink(missing_ok=True)


def _begun(path: Path) -> tuple[Path, Path, os.stat_result | None]:
    """An empty scratch file, its target, and the target's status; pipes and devices are written to, never replaced."""
    if path.is_dir():
        raise ValueRangeError(f"cannot write {str(path)!r}: it is a folder. Give a file name.")
    if path.exists() and not path.is_file():
        return path, path, None
    advice = "Name a file in a folder that exists and is writable."
    try:
        target = path.resolve()  # a link stays a link
        before = _status(target)
    except (OSError, RuntimeError) as problem:  # a name too long, links in a circle
        reason = getattr(problem, "strerror", None) or str(problem)
        raise ValueRangeError(f"cannot write {str(path)!r}: {reason}. {advice}") from None
    scratch = target.with_name(f".{target.stem[:20]}.{os.urandom(8).hex()}{target.suffix[-20:]}")
    try:
        # With the mode of new files the system itself takes the umask off; what will be private is so from the start.
        os.close(os.open(scratch, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666 if before is None else 0o600))
    except OSError as problem:
        raise ValueRangeError(f"cannot write {str(path)!r}: {problem.strerror}. {advice}") from None
    return scratch, target, before


def _keep(scratch: Path, before: os.stat_result) -> None:
    """Copy owner, group and mode of the replaced file; a group that cannot be kept passes on no rights."""
    mode = stat.S_IMODE(before.st_mode)
    if hasattr(os, "chown"):
        with contextlib.suppress(OSError):
            os.chown(scratch, before.st_uid, -1)
        with contextlib.suppress(OSError):
            os.chown(scratch, -1, before.st_gid)
        if scratch.stat().st_gid != before.st_gid:
            mode &= ~0o070 | (mode & 0o007) << 3
    scratch.chmod(mode)
