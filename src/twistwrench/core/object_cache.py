"""Disk cache of machine code and of LLVM's properties: private to the user, verified before use, optional.

Entries are in the user's cache folder, or in ``TWISTWRENCH_CACHE_DIR``; ``TWISTWRENCH_CACHE_DIR=off`` disables the cache. A
folder that others can write to, an unreadable entry or a full disk makes the code be compiled again. A :class:`CacheWarning`
reports this once, if there is a remedy.
"""

from __future__ import annotations

import errno
import os
import re
import stat
import sys
import warnings
from contextlib import suppress
from pathlib import Path

from .errors import CacheWarning

try:  # hashlib loads OpenSSL, which takes longer than the hash
    from _blake2 import blake2b
except ImportError:
    from hashlib import blake2b

MAGIC = b"twistwrench code 2\n"
MOST_ENTRIES = 2000
MOST_BYTES = 2**28
"""Maximum size of an entry [bytes]; the code of the largest robots has a few MiB."""
VARIABLE = "TWISTWRENCH_CACHE_DIR"

_CHECKSUM = 32

_OURS = re.compile(r"[0-9a-f]{64}|\.new-\w+")
"""Names of entries and of temporary files; other files in the folder are ignored."""

_BINARY = getattr(os, "O_BINARY", 0)
_NO_ENTRY = (errno.EINVAL, errno.ELOOP, errno.EMLINK, errno.ENXIO)
"""Error numbers for links, sockets and anything else that is not a regular file."""

_REMARKS: set[str] = set()


def folder() -> Path | None:
    """Cache folder, created if necessary; None if no folder is writable by this user alone."""
    chosen = os.environ.get(VARIABLE, "")
    if chosen.lower() == "off":
        return None
    try:
        place = Path(chosen).expanduser() if chosen else _usual()
        if not place.exists():
            for missing in [p for p in (place, *place.parents) if not p.exists()][::-1]:
                missing.mkdir(mode=0o700, exist_ok=True)
        about = place.stat()
        if not stat.S_ISDIR(about.st_mode):
            raise NotADirectoryError(errno.ENOTDIR, "it is not a folder")
    except (OSError, RuntimeError) as problem:  # RuntimeError: no home for ~
        if chosen:  # an inaccessible home folder is not the user's mistake
            _remark(
                f"{VARIABLE} is {chosen!r}, which is not a folder and cannot be made one ({problem}). Give another, or off."
            )
        return None
    if hasattr(os, "getuid"):  # code is executed from here: only this user may write it
        for parent in place.resolve().parents:
            if not _is_ours_alone(parent.stat()):
                _remark(f"others can rename what is in {parent}. Set {VARIABLE} to a folder of your own, or to off.")
                return None
        if about.st_uid != os.getuid():
            _remark(
                f"{place} belongs to another user (uid {about.st_uid}). Set {VARIABLE} to a folder of your own, or to off."
            )
            return None
        if about.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
            mode = f"mode {stat.S_IMODE(about.st_mode):o}"
            _remark(f"others can write to {place} ({mode}). Run chmod go-w on it, or set {VARIABLE} to another folder.")
            return None
    return place


def _is_ours_alone(about: os.stat_result) -> bool:
    """True if only this user and the system can rename files in a folder.

    A group with the user's own number is the user's alone, by the convention of distributions.
    """
    if about.st_uid not in (0, os.getuid()):
        return False
    by_others, by_group = about.st_mode & stat.S_IWOTH, about.st_mode & stat.S_IWGRP
    return bool(about.st_mode & stat.S_ISVTX) or not (by_others or (by_group and about.st_gid != about.st_uid))


def digest(*parts: bytes | str) -> bytes:
    """Hash (32,) of all parts together, for keys and checksums."""
    state = blake2b(digest_size=_CHECKSUM)
    for part in parts:
        data = part.encode() if isinstance(part, str) else part
        state.update(len(data).to_bytes(8, "little") + data)
    return state.digest()


def _usual() -> Path:
    if str(sys.platform) == "linux":  # same as platformdirs, whose import takes longer than a cache hit
        given = os.environ.get("XDG_CACHE_HOME", "").strip()
        return (Path(given) if given else Path("~/.cache").expanduser()) / "twistwrench" / "kernels"
    import platformdirs

    return Path(platformdirs.user_cache_dir("twistwrench", appauthor=False)) / "kernels"


def _remark(text: str) -> None:
    """Warn once per process: there are many kernels, and each uses the folder twice."""
    if text not in _REMARKS:
        _REMARKS.add(text)
        warnings.warn(f"Compiled code is not kept: {text}", CacheWarning, stacklevel=2)


def load(key: str, place: Path | None = None) -> bytes | None:
    """Code stored under ``key``, or None; a damaged entry is removed. ``place`` is the folder if the caller has it."""
    place = place or folder()
    if place is None:
        return None
    entry = place / key
    try:
        raw = _bytes_of(entry)
    except OSError as problem:
        if problem.errno in _NO_ENTRY:
            _clear(entry)
        return None
    head = len(MAGIC)
    checksum, code = raw[head : head + _CHECKSUM], raw[head + _CHECKSUM :]
    if raw[:head] == MAGIC and digest(key, code) == checksum:
        return code
    _clear(entry)
    return None


def _bytes_of(entry: Path) -> bytes:
    """Bytes of an entry. Raises OSError for a link, a pipe, a folder, a device, and for a file that is too large for code."""
    handle = os.open(entry, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | _BINARY)
    about = os.fstat(handle)
    foreign = hasattr(os, "getuid") and (about.st_uid != os.getuid() or about.st_mode & 0o022)
    if not stat.S_ISREG(about.st_mode) or about.st_size > MOST_BYTES or foreign:
        os.close(handle)
        raise OSError(errno.EINVAL, "no entry of the cache", str(entry))
    with os.fdopen(handle, "rb") as file:
        return file.read(about.st_size)  # not MOST_BYTES, for which memory would be reserved at each call


def _clear(entry: Path) -> None:
    """Remove an invalid entry, or an empty folder in its place; a nonempty folder stays, and the entry is not cached."""
    with suppress(OSError):
        if entry.is_dir() and not entry.is_symlink():
            entry.rmdir()
        else:
            entry.unlink()


def store(key: str, code: bytes) -> None:
    """Store ``code`` under ``key``; written to a temporary name and renamed, so that readers never see a partial file."""
    place = folder()
    if place is None:
        return
    import tempfile

    temporary = None
    try:
        handle, temporary = tempfile.mkstemp(dir=place, prefix=".new-")
        with os.fdopen(handle, "wb") as file:
            file.write(MAGIC + digest(key, code) + code)
        Path(temporary).replace(place / key)
        temporary = None
        _prune(place)
    except OSError as problem:
        if os.environ.get(VARIABLE):
            _remark(f"{place}: {problem.strerror or problem}. Set {VARIABLE} to another folder, or to off.")
    finally:
        if temporary is not None:
            with suppress(OSError):
                Path(temporary).unlink()


def _prune(place: Path) -> None:
    """Remove the oldest quarter of the entries if there are too many."""
    entries = list(place.iterdir())
    if len(entries) <= MOST_ENTRIES:  # usual after an entry is stored: no file is looked at
        return
    entries = [entry for entry in entries if _OURS.fullmatch(entry.name) and entry.is_file()]
    if len(entries) <= MOST_ENTRIES:
        return
    entries.sort(key=_written)
    for old in entries[: MOST_ENTRIES // 4]:
        with suppress(OSError):
            old.unlink()


def _written(entry: Path) -> float:
    """Modification time of an entry; zero if another process has removed it since it was listed."""
    try:
        return entry.stat().st_mtime
    except OSError:
        return 0.0
