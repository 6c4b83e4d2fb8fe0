"""Disk cache of robots: after an earlier loading, first results need no parsing or tracing."""

from __future__ import annotations

import os
import sys
from ast import literal_eval
from collections.abc import Callable, Mapping, Sequence
from functools import cache, cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...core import object_cache
from ...core.files import read_bytes

if TYPE_CHECKING:
    from ...mechanics.model.model import Model

# The key of a robot consists of the bytes of its file, the options of loading, and the versions of this library, Python
# and NumPy. Only URDF robots are cached, because they are read from one file. Warnings are cached too, and issued at
# each loading. The model is built from the bytes of the file as soon as cached kernels do not suffice.

_PLAIN_TYPES = (str, int, float, bool, type(None))
"""Types of options whose text identifies their value."""
_OTHER_FORMAT_MARKS = (b"<mujoco", b"<sdf", b"xacro:", b"${")
"""Texts in files that are not plain URDF."""


class CacheEntry(NamedTuple):
    """Cache entry of a robot file, loaded with certain options."""

    data: bytes
    """Bytes of the file."""
    key: str
    """Key of file and options."""
    remarks: tuple[str, ...] | None
    """Warnings of an earlier loading; None if the file was not loaded before."""


class CachedModel:
    """Model of a robot with cached kernels, under the key of its file; built at first use."""

    def __init__(self, key: str, make: Callable[[], Model]) -> None:
        self.key, self._make = key, make

    @cached_property
    def model(self) -> Model:
        """Model, built at first use."""
        return self._make()


def known_file(source: object, options: Mapping[str, Any]) -> CacheEntry | None:
    """Cache entry of a plain URDF file; None without a cache, and for other input, such as xacro, which includes files."""
    if not isinstance(source, str | os.PathLike) or not str(source).endswith(".urdf"):
        return None
    options_text = _options_text(options)
    if options_text is None:
        return None
    try:
        folder = object_cache.folder() if Path(source).is_file() else None
        if folder is None:
            return None
        # A RobotFile has its bytes as data, since it may be loaded twice.
        data = getattr(source, "data", None) or read_bytes(Path(source))
        version = _version()
    except (OSError, ValueError):  # the loader reports an unreadable file; or the library is in an archive
        return None
    has_other_format = any(mark in data for mark in _OTHER_FORMAT_MARKS)
    if b"<robot" not in data or has_other_format:
        return None
    key = object_cache.digest("robot", version, os.fspath(source), options_text, data).hex()
    stored_bytes = object_cache.load(key, folder)
    remarks = None if stored_bytes is None else _remarks(stored_bytes)
    return CacheEntry(data, key, remarks)


def _remarks(stored_bytes: bytes) -> tuple[str, ...] | None:
    """Warnings that :func:`keep_file` stored; None for other bytes."""
    try:
        remarks = literal_eval(stored_bytes.decode())
    except (ValueError, SyntaxError, TypeError, RecursionError, MemoryError):  # the file is loaded again
        return None
    if isinstance(remarks, tuple) and all(isinstance(remark, str) for remark in remarks):
        return remarks
    return None


def keep_file(known: CacheEntry, remarks: Sequence[str]) -> None:
    """Store the warnings of a file that was loaded, in the entry ``known``."""
    object_cache.store(known.key, repr(tuple(remarks)).encode())


def kernel_key(origin: str, names: Sequence[str], options: Mapping[str, Any]) -> str:
    """Cache key of a kernel of the robot with the key ``origin``; empty if the kernel is not cached."""
    if not origin:
        return ""
    options_text = _options_text({**options, "names": tuple(names)})
    if options_text is None:
        return ""
    import llvmlite

    from ...compiler.lowering.target_machine import chosen, compiler

    compiler_versions = llvmlite.__version__, compiler().version, str(chosen())
    return object_cache.digest("kernel", origin, options_text, *compiler_versions).hex()


@cache
def _version() -> str:
    """Versions of Python and NumPy, and sizes and times of all files of this library, to detect edited copies.

    Raises OSError if the library is not in a folder, for example in an archive.
    """
    file_texts = []
    remaining_folders = [str(Path(__file__).parents[2])]
    while remaining_folders:
        with os.scandir(remaining_folders.pop()) as entries:
            for entry in entries:
                if entry.name.endswith((".py", ".pyc")):  # .pyc files count if the library has no sources
                    status = entry.stat()
                    file_texts.append(f"{entry.path} {status.st_size} {status.st_mtime_ns}")
                elif "." not in entry.name and entry.name != "__pycache__" and entry.is_dir():
                    remaining_folders.append(entry.path)
    return "\n".join([sys.version, np.__version__, *sorted(file_texts)])


def _options_text(options: Mapping[str, Any]) -> str | None:
    """Text of the options that are not None; None if an option is not a plain value."""
    given_options = {name: value for name, value in sorted(options.items()) if value is not None}
    if not _is_plain(given_options):
        return None
    return repr(given_options)


def _is_plain(value: Any) -> bool:
    """True for plain values, and for dicts, lists and tuples of them."""
    if type(value) is dict:
        return all(type(name) is str and _is_plain(element) for name, element in value.items())
    if type(value) in (list, tuple):
        return all(map(_is_plain, value))
    return type(value) in _PLAIN_TYPES
