"""The disk cache of machine code: private to the user, verified before use, never in the way.

Entries live under the user's cache folder, or where ``TWISTWRENCH_CACHE_DIR`` says; ``TWISTWRENCH_CACHE_DIR=off`` turns the
cache off. A folder that others could write to, an unreadable entry and a full disk all mean the same: compile again.
"""

from __future__ import annotations

import hashlib
import os
import stat
import tempfile
from contextlib import suppress
from pathlib import Path

__all__ = ["folder", "load", "store"]

MAGIC = b"twistwrench code 1\n"
MOST_ENTRIES = 2000


def folder() -> Path | None:
    """The cache folder, made if need be; None when there is none that only this user can write to."""
    chosen = os.environ.get("TWISTWRENCH_CACHE_DIR", "")
    if chosen.lower() == "off":
        return None
    if chosen:
        place = Path(chosen)
    else:
        import platformdirs

        place = Path(platformdirs.user_cache_dir("twistwrench", appauthor=False)) / "kernels"
    try:
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
        about = place.stat()
    except OSError:
        return None
    if hasattr(os, "getuid"):  # code is run from here: nobody else may put any
        if about.st_uid != os.getuid():
            return None
        if about.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
            return None
    return place


def load(key: str) -> bytes | None:
    """The code stored under ``key``, or None; a damaged entry is removed."""
    place = folder()
    if place is None:
        return None
    entry = place / key
    try:
        raw = entry.read_bytes()
    except OSError:
        return None
    head = len(MAGIC)
    checksum, code = raw[head : head + 32], raw[head + 32 :]
    if raw[:head] == MAGIC and hashlib.sha256(key.encode() + code).digest() == checksum:
        return code
    with suppress(OSError):
        entry.unlink()
    return None


def store(key: str, code: bytes) -> None:
    """Keep ``code`` under ``key``; written to a temporary name and renamed, so readers never see half of it."""
    place = folder()
    if place is None:
        return
    temporary = None
    try:
        handle, temporary = tempfile.mkstemp(dir=place, prefix=".new-")
        with os.fdopen(handle, "wb") as file:
            file.write(MAGIC + hashlib.sha256(key.encode() + code).digest() + code)
        Path(temporary).replace(place / key)
        _prune(place)
    except OSError:
        if temporary is not None:
            with suppress(OSError):
                Path(temporary).unlink()


def _prune(place: Path) -> None:
    """Drop the oldest quarter when there are too many entries."""
    entries = [p for p in place.iterdir() if p.is_file()]
    if len(entries) <= MOST_ENTRIES:
        return
    entries.sort(key=lambda p: p.stat().st_mtime)
    for old in entries[: MOST_ENTRIES // 4]:
        with suppress(OSError):
            old.unlink()
