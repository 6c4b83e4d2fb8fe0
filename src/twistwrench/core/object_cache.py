"""Disk cache of machine code and of LLVM's properties: private to the user, verified before use, optional.

Entries are in the user's cache folder, or in ``TWISTWRENCH_CACHE_DIR``; ``TWISTWRENCH_CACHE_DIR=off`` disables the cache. If
others can write to the folder, an entry cannot be read or the disk is full, code is compiled again. If there is a remedy, a
:class:`CacheWarning` reports this once.
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
"""Beginning of every entry; the number is that of the format."""
MOST_ENTRIES = 10_000
"""Maximum number of entries, of about 10 kB each."""
MOST_BYTES = 2**28
"""Maximum size of an entry [bytes]; the code of the largest robots has a few MiB."""
VARIABLE = "TWISTWRENCH_CACHE_DIR"
"""Environment variable with the folder, or "off"."""

_CHECKSUM_SIZE = 32
"""Size of a checksum [bytes]."""

_OWN_NAMES = re.compile(r"[0-9a-f]{64}|\.new-\w+")
"""Names of entries and of temporary files; other files in the folder are ignored."""

_BINARY = getattr(os, "O_BINARY", 0)
"""Flag of Windows for files without conversion of line ends."""
_READING_FLAGS = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | _BINARY
"""Flags for reading an entry: no links, and no waiting for the other end of a pipe."""
_WRITABLE_BY_OTHERS = stat.S_IWGRP | stat.S_IWOTH
"""Mode bits of write access for the group and for all."""
_NOT_A_FILE = (errno.EINVAL, errno.ELOOP, errno.EMLINK, errno.ENXIO)
"""Error numbers for links, sockets and anything else that is not a regular file."""

_WARNINGS_GIVEN: set[str] = set()
"""Texts of the warnings that were given in this process."""


def folder() -> Path | None:
    """Cache folder, created if necessary; None if the cache is off, or the folder is not writable by this user alone."""
    users_choice = os.environ.get(VARIABLE, "")
    if users_choice.lower() == "off":
        return None
    try:
        cache_folder = Path(users_choice).expanduser() if users_choice else _default_folder()
        if not cache_folder.exists():
            missing_folders = [path for path in (cache_folder, *cache_folder.parents) if not path.exists()]
            for missing_folder in reversed(missing_folders):  # parents first
                missing_folder.mkdir(mode=0o700, exist_ok=True)  # mkdir(parents=True) would ignore the parents' mode
        status = cache_folder.stat()
        if not stat.S_ISDIR(status.st_mode):
            raise NotADirectoryError(errno.ENOTDIR, "it is not a folder")
    except (OSError, RuntimeError) as problem:  # RuntimeError: the user of ~ has no home
        if users_choice:  # without a choice, an inaccessible home folder needs no warning
            _warn_once(
                f"{VARIABLE} is {users_choice!r}, which is not a folder and cannot be made one ({problem}). Give another, "
                "or off."
            )
        return None
    if hasattr(os, "getuid"):  # not on Windows. Code is executed from here: only this user may write it
        for parent in cache_folder.resolve().parents:
            if not _is_safe_parent(parent.stat()):
                _warn_once(f"others can rename what is in {parent}. Set {VARIABLE} to a folder of your own, or to off.")
                return None
        if status.st_uid != os.getuid():
            _warn_once(
                f"{cache_folder} belongs to another user (uid {status.st_uid}). Set {VARIABLE} to a folder of your own, or to "
                "off."
            )
            return None
        if status.st_mode & _WRITABLE_BY_OTHERS:
            mode = f"mode {stat.S_IMODE(status.st_mode):o}"
            _warn_once(
                f"others can write to {cache_folder} ({mode}). Run chmod go-w on it, or set {VARIABLE} to another folder."
            )
            return None
    return cache_folder


def _is_safe_parent(status: os.stat_result) -> bool:
    """True if only this user and the system can rename entries of a folder with this status."""
    if status.st_uid not in (0, os.getuid()):  # 0 is root, the system
        return False
    if status.st_mode & stat.S_ISVTX:  # the sticky bit, as of /tmp: an entry is renamed by the entry's owner only
        return True
    if status.st_mode & stat.S_IWOTH:
        return False
    has_own_group = status.st_gid == status.st_uid  # by convention of distributions, no other user is in it
    return has_own_group or not status.st_mode & stat.S_IWGRP


def digest(*parts: bytes | str) -> bytes:
    """Hash (32 bytes) of all parts together, for keys and checksums."""
    hasher = blake2b(digest_size=_CHECKSUM_SIZE)
    for part in parts:
        data = part.encode() if isinstance(part, str) else part
        # with its length, so that ("ab", "c") and ("a", "bc") have different hashes
        hasher.update(len(data).to_bytes(8, "little") + data)
    return hasher.digest()


def _default_folder() -> Path:
    """Folder for the cache if the user has chosen none."""
    if str(sys.platform) == "linux":  # the folder of platformdirs, whose import takes longer than reading an entry
        user_cache = os.environ.get("XDG_CACHE_HOME", "").strip()
        base = Path(user_cache) if user_cache else Path("~/.cache").expanduser()
        return base / "twistwrench" / "kernels"
    import platformdirs

    return Path(platformdirs.user_cache_dir("twistwrench", appauthor=False)) / "kernels"


def _warn_once(text: str) -> None:
    """Warn once per process: there are many kernels, and each looks for the folder twice."""
    if text not in _WARNINGS_GIVEN:
        _WARNINGS_GIVEN.add(text)
        warnings.warn(f"Compiled code is not kept: {text}", CacheWarning, stacklevel=2)


def load(key: str, cache_folder: Path | None = None) -> bytes | None:
    """Code stored under ``key``; None if there is none. A damaged entry is removed. ``cache_folder`` may be given if known."""
    cache_folder = cache_folder or folder()
    if cache_folder is None:
        return None
    entry = cache_folder / key
    try:
        raw = _bytes_of(entry)  # magic, checksum, code
    except OSError as problem:
        if problem.errno in _NOT_A_FILE:
            _remove_entry(entry)
        return None
    after_magic = raw[len(MAGIC) :]
    checksum = after_magic[:_CHECKSUM_SIZE]
    code = after_magic[_CHECKSUM_SIZE:]
    if raw.startswith(MAGIC) and digest(key, code) == checksum:
        return code
    _remove_entry(entry)
    return None


def _bytes_of(entry: Path) -> bytes:
    """Bytes of an entry. Raises OSError unless it is a regular file of this user alone, and not too large for code."""
    handle = os.open(entry, _READING_FLAGS)
    status = os.fstat(handle)
    others_can_write = False  # Windows has no such modes
    if hasattr(os, "getuid"):
        others_can_write = status.st_uid != os.getuid() or bool(status.st_mode & _WRITABLE_BY_OTHERS)
    if not stat.S_ISREG(status.st_mode) or status.st_size > MOST_BYTES or others_can_write:
        os.close(handle)
        raise OSError(errno.EINVAL, "no entry of the cache", str(entry))
    with os.fdopen(handle, "rb") as file:
        return file.read(status.st_size)  # not MOST_BYTES, for which memory would be reserved at each call


def _remove_entry(entry: Path) -> None:
    """Remove an invalid entry, or an empty folder in its place; a nonempty folder stays, and the entry is not cached."""
    with suppress(OSError):
        if entry.is_dir() and not entry.is_symlink():
            entry.rmdir()
        else:
            entry.unlink()


def store(key: str, code: bytes) -> None:
    """Store ``code`` under ``key``; written to a temporary name and renamed, so that readers never see a partial file."""
    cache_folder = folder()
    if cache_folder is None:
        return
    import tempfile

    temporary_path = None  # of a file that is not yet renamed
    try:
        handle, temporary_path = tempfile.mkstemp(dir=cache_folder, prefix=".new-")
        with os.fdopen(handle, "wb") as file:
            file.write(MAGIC + digest(key, code) + code)
        Path(temporary_path).replace(cache_folder / key)
        temporary_path = None
        _prune(cache_folder)
    except OSError as problem:
        if os.environ.get(VARIABLE):  # the user has chosen the folder
            _warn_once(f"{cache_folder}: {problem.strerror or problem}. Set {VARIABLE} to another folder, or to off.")
    finally:
        if temporary_path is not None:
            with suppress(OSError):
                Path(temporary_path).unlink()


def _prune(cache_folder: Path) -> None:
    """If there are too many entries, remove the oldest: a quarter of the maximum number."""
    with os.scandir(cache_folder) as folder_entries:
        names = [entry.name for entry in folder_entries]
    if len(names) <= MOST_ENTRIES:  # the usual case, without a look at the files
        return
    own_paths = [cache_folder / name for name in names if _OWN_NAMES.fullmatch(name)]
    entries = [path for path in own_paths if path.is_file()]
    if len(entries) <= MOST_ENTRIES:
        return
    entries.sort(key=_time_of_writing)
    for old_entry in entries[: MOST_ENTRIES // 4]:
        with suppress(OSError):
            old_entry.unlink()


def _time_of_writing(entry: Path) -> float:
    """Modification time of an entry [s]; zero if another process has removed it since it was listed."""
    try:
        return entry.stat().st_mtime
    except OSError:
        return 0.0
