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
from typing import Any, NamedTuple

from .arguments import value_text
from .errors import ValueRangeError
from .text import Argument

MOST_BYTES = 64 * 2**20
"""Default size limit of a reader [bytes]."""

_READ_SIZE = 1 << 16
"""Number of bytes that are read at once."""
_OPENING_TIMEOUT = 10.0
"""Time in which another process must open the other end of a named pipe [s]."""
_OPENING_POLL = 0.01
"""Time between two looks whether another process has opened the pipe [s]."""
_MAX_NAME_PART = 20
"""Number of characters of a file's stem and of its suffix in the name of its temporary file."""


def as_path(path: Any) -> Path:
    """Path from a caller's text or Path. Raises ValueRangeError for anything else and for an empty text."""
    is_path = isinstance(path, str | os.PathLike) and not isinstance(path, bytes)
    if not is_path or not str(path):
        raise ValueRangeError(f"path is {value_text(path)}: give the path of a file, a text or a pathlib.Path.")
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

    Another process has ten seconds to open the other end of a pipe, and any time to write. Raises OSError: ``EFBIG`` for more
    than ``most`` bytes, ``ETIMEDOUT`` if no process opens the pipe for writing.

    >>> read_bytes(Path("/dev/zero"), most=1000)
    Traceback (most recent call last):
    OSError: [Errno 27] it has more than 1000 bytes: '/dev/zero'
    """
    flags = os.O_RDONLY
    for name in ("O_NONBLOCK", "O_BINARY"):
        flags |= getattr(os, name, 0)  # 0 where the system does not have it
    handle = os.open(path, flags)
    try:
        status = os.fstat(handle)
        if stat.S_ISDIR(status.st_mode):
            raise IsADirectoryError(errno.EISDIR, "it is a folder", str(path))
        if stat.S_ISREG(status.st_mode) and status.st_size > most:
            raise _size_error(path, most)
        return _read_to_end(handle, path, most)
    finally:
        os.close(handle)


def read_text(path: Path, most: int = MOST_BYTES) -> str:
    """Text of a file in UTF-8, with or without a byte order mark; line ends are kept.

    Raises the errors of :func:`read_bytes`, and UnicodeDecodeError.
    """
    return read_bytes(path, most).decode("utf-8-sig")


def read_standard_input(most: int = MOST_BYTES) -> bytes:
    """All bytes of standard input. Raises OSError with ``EFBIG`` for more than ``most``."""
    data = sys.stdin.buffer.read(most + 1)  # one more shows that there are too many
    if len(data) > most:
        raise _size_error(Path("-"), most)
    return data


def _read_to_end(handle: int, path: Path, most: int) -> bytes:
    """All bytes of an open file, pipe or device; raises the errors of :func:`read_bytes`."""
    parts: list[bytes] = []
    size = 0
    deadline = time.monotonic() + _OPENING_TIMEOUT
    while True:
        try:
            part = os.read(handle, _READ_SIZE)
        except BlockingIOError:  # the pipe has a writer that has not written yet
            select.select([handle], [], [])
            continue
        if part:
            parts.append(part)
            size += len(part)
            if size > most:
                raise _size_error(path, most)
        elif parts or not _is_unopened_pipe(handle):
            return b"".join(parts)
        elif time.monotonic() > deadline:
            raise OSError(errno.ETIMEDOUT, "it is a pipe that nobody writes to", str(path))
        else:
            time.sleep(_OPENING_POLL)


def _is_unopened_pipe(handle: int) -> bool:
    """True for a pipe whose other end no process has opened yet.

    Reading such a pipe returns nothing, as at the end of the data; but poll reports the end only once a writer has left.
    """
    is_pipe = stat.S_ISFIFO(os.fstat(handle).st_mode)
    if not is_pipe or not hasattr(select, "poll"):
        return False
    poll = select.poll()
    poll.register(handle, select.POLLIN)
    events = poll.poll(0)
    return not events


def _size_error(path: Path, most: int) -> OSError:
    """Error for a file of more than ``most`` bytes."""
    amount = f"{most // 2**20} MiB" if most >= 2**20 else f"{most} bytes"
    return OSError(errno.EFBIG, f"it has more than {amount}", str(path))


# ── Writing: unsuitable outputs are rejected before a run, and files are replaced only when complete

PICTURES = (".png", ".pdf", ".svg")
"""File name suffixes of pictures."""

_SPREADSHEET_SUFFIXES = (".xlsx", ".xls", ".xlsm", ".ods")
"""File name suffixes of spreadsheet formats, which are not written."""


def picture_path(path: str | Path) -> str:
    """File name of a picture: ``path``, with .png appended if it has no suffix.

    Raises :class:`~twistwrench.ValueRangeError` for a suffix that is not one of :data:`PICTURES`.
    """
    text = str(as_path(path))
    suffix = Path(path).suffix.lower()
    if not suffix and Path(text).is_dir():  # rejected later, on writing
        return text
    if not suffix:
        return f"{text}.png"
    if suffix not in PICTURES:
        raise ValueRangeError(
            f"cannot draw {Path(path).name!r}: pictures of kind {suffix[1:]!r} are not made. "
            f"Choose one of {', '.join(PICTURES)}."
        )
    return text


def check_outputs(outputs: Mapping[str, str | Path | None], inputs: Mapping[str, str | Path | None]) -> None:
    """Reject, before a long run, output files that cannot be written, or that equal an input or another output.

    Both mappings are from the user's term for a file (``--csv``, ``ROBOT``) to its path, or None if not given. Links are
    resolved; devices such as /dev/null may be shared. Pass a picture's path through :func:`picture_path` first.
    Raises :class:`~twistwrench.ValueRangeError`.
    """
    used_paths = {name: Path(path) for name, path in inputs.items() if path is not None}
    for name, output in outputs.items():
        if output is None:
            continue
        path = Path(output)
        try:
            for other_name, used_path in used_paths.items():
                if _is_same_file(path, used_path):
                    raise ValueRangeError(
                        f"{name} {str(output)!r} would overwrite the file of {other_name}. Give another name."
                    )
            _check_writable(path)
            if name.endswith("csv") and path.suffix.lower() in _SPREADSHEET_SUFFIXES:
                raise ValueRangeError(
                    f"{name} {str(output)!r}: CSV is written, which spreadsheets do not open under the ending "
                    f"{path.suffix}. Name it {path.with_suffix('.csv').name!r}."
                )
        except (OSError, RuntimeError) as problem:  # name too long, circular links
            reason = getattr(problem, "strerror", None) or str(problem)
            raise ValueRangeError(f"cannot write {str(path)!r}: {reason}. Give another name.") from None
        used_paths[name] = path


def refuse_existing(path: str | Path, *, overwrite: bool) -> Path:
    """Path of an output. Raises :class:`~twistwrench.ValueRangeError` if the file exists and ``overwrite`` is False.

    Devices, such as /dev/stdout, are accepted.
    """
    target = as_path(path)
    if target.is_file() and not overwrite:
        raise ValueRangeError(
            f"{str(target)!r} is there already. Give another name, or {{0}}.", Argument("overwrite", True)
        )
    return target


def _is_same_file(a: Path, b: Path) -> bool:
    """True if two paths name the same file, by links or directly; a device is never the same."""
    if a.exists() and b.exists():
        return a.is_file() and a.samefile(b)  # resolves hard links too
    return a.resolve() == b.resolve()


def _status(path: Path) -> os.stat_result | None:
    """Status of a file; None if it does not exist. Raises OSError for invalid names."""
    try:
        return path.stat()
    except (FileNotFoundError, NotADirectoryError):
        return None


def _check_writable(path: Path) -> None:
    """Raise ValueRangeError, or OSError for an invalid name, unless a file can be written at a path."""
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
    """Context with a temporary name in the same folder, which is renamed to ``path`` on success and removed on an error.

    A replaced file keeps its mode, and its owner and group if the system allows it; a new one gets the mode of the process's
    new files. Raises :class:`~twistwrench.ValueRangeError` if the folder is missing or not writable.
    """
    with replacing_together([path]) as (temporary_path,):
        yield temporary_path


@contextlib.contextmanager
def replacing_together(paths: Sequence[str | Path]) -> Iterator[tuple[Path, ...]]:
    """Temporary names for several files as in :func:`replacing`: all are written to disk before the first is renamed."""
    files: list[_BegunFile] = []
    current_path = as_path(paths[0])  # named in the message of an error
    try:
        for path in map(as_path, paths):
            current_path = path
            files.append(_begin_file(path))
        yield tuple(file.temporary for file in files)
        for file in files:
            current_path = file.path
            if file.is_temporary:
                if file.old_status is not None:
                    _keep_owner_and_mode(file.temporary, file.old_status)
                with file.temporary.open("rb+") as stream:
                    os.fsync(stream.fileno())  # onto the disk
        for file in files:
            current_path = file.path
            if file.is_temporary:
                os.replace(file.temporary, file.target)  # noqa: PTH105  the atomic one, by its plain name
    except BrokenPipeError:
        raise
    except OSError as problem:
        raise ValueRangeError(
            f"cannot write {str(current_path)!r}: {problem.strerror}. Free space, or give another name."
        ) from None
    finally:
        for file in files:
            if file.is_temporary:
                file.temporary.unlink(missing_ok=True)


class _BegunFile(NamedTuple):
    """File that is being written under a temporary name."""

    path: Path
    """Path as given."""
    temporary: Path
    """Temporary file; the target itself for pipes and devices, which are written directly."""
    target: Path
    """Path without links."""
    old_status: os.stat_result | None
    """Status of an existing target; None without one."""

    @property
    def is_temporary(self) -> bool:
        """True unless the target is written directly."""
        return self.temporary != self.target


def _begin_file(path: Path) -> _BegunFile:
    """Create an empty temporary file beside the target."""
    if path.is_dir():
        raise ValueRangeError(f"cannot write {str(path)!r}: it is a folder. Give a file name.")
    if path.exists() and not path.is_file():
        return _BegunFile(path, path, path, None)
    advice = "Name a file in a folder that exists and is writable."
    try:
        target = path.resolve()  # so that a link stays, and the file that it names is replaced
        old_status = _status(target)
    except (OSError, RuntimeError) as problem:  # name too long, circular links
        reason = getattr(problem, "strerror", None) or str(problem)
        raise ValueRangeError(f"cannot write {str(path)!r}: {reason}. {advice}") from None
    random_text = os.urandom(8).hex()
    temporary_name = f".{target.stem[:_MAX_NAME_PART]}.{random_text}{target.suffix[-_MAX_NAME_PART:]}"
    temporary = target.with_name(temporary_name)
    # The system applies the umask to a new file; a file that replaces another is private until it has the other's mode.
    mode = 0o666 if old_status is None else 0o600
    try:
        handle = os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, mode)
        os.close(handle)
    except OSError as problem:
        raise ValueRangeError(f"cannot write {str(path)!r}: {problem.strerror}. {advice}") from None
    return _BegunFile(path, temporary, target, old_status)


def _keep_owner_and_mode(path: Path, old_status: os.stat_result) -> None:
    """Give a file owner, group and mode of the file that it replaces.

    If the system refuses the group, the new group may do no more than others could.
    """
    mode = stat.S_IMODE(old_status.st_mode)
    if hasattr(os, "chown"):
        with contextlib.suppress(OSError):
            os.chown(path, old_status.st_uid, -1)  # -1: the group stays
        with contextlib.suppress(OSError):
            os.chown(path, -1, old_status.st_gid)
        if path.stat().st_gid != old_status.st_gid:
            permissions_of_others = mode & 0o007
            mode &= ~0o070 | permissions_of_others << 3
    path.chmod(mode)
