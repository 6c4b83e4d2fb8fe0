"""Disk cache of loaded robots: first results without parsing or tracing.

A robot is known by the bytes of its file, the options it was loaded with, and the versions of this library, Python and NumPy.
Only URDF is known so, which is read from one file. Remarks are kept too, and issued at each loading. The model is made, from
the bytes that were read, when more is asked for than the kernels that are kept.
"""

from __future__ import annotations

import os
import sys
from ast import literal_eval
from collections.abc import Callable, Mapping, Sequence
from functools import cache, cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..core import object_cache
from ..core.files import read_bytes

if TYPE_CHECKING:
    from ..ir.loops import Form
    from ..model.model import Model

_PLAIN = (str, int, float, bool, type(None))
"""Types of options that their text identifies."""


class CacheEntry(NamedTuple):
    """A robot's file, with the options it is loaded with."""

    data: bytes
    key: str
    remarks: tuple[str, ...] | None
    """Warnings of an earlier loading; None if there was none."""


class CachedModel:
    """Model of a robot with cached kernels, under the key of its file; built at first use."""

    def __init__(self, key: str, make: Callable[[], Model]) -> None:
        self.key, self._make = key, make

    @cached_property
    def model(self) -> Model:
        """The model."""
        return self._make()


def known_file(source: object, options: Mapping[str, Any]) -> CacheEntry | None:
    """Cache entry of a robot's file; None if it is not a plain URDF file, or there is no cache."""
    if not isinstance(source, str | os.PathLike) or not str(source).endswith(".urdf"):
        return None
    written = _written(options)
    try:
        if written is None or not Path(source).is_file() or object_cache.folder() is None:
            return None
        data, version = read_bytes(Path(source)), _version()
    except (OSError, ValueError):  # which loading explains; or the library's own files are in an archive
        return None
    if b"<robot" not in data or b"<mujoco" in data or b"<sdf" in data:
        return None
    key = object_cache.digest("robot", version, os.fspath(source), written, data).hex()
    kept = object_cache.load(key)
    return CacheEntry(data, key, None if kept is None else literal_eval(kept.decode()))


def keep_file(known: CacheEntry, remarks: Sequence[str]) -> None:
    """Note that a file was loaded, and the warnings that came with it."""
    object_cache.store(known.key, repr(tuple(remarks)).encode())


def kernel_key(origin: str, names: Sequence[str], options: Mapping[str, Any]) -> str:
    """The key of what is kept of a kernel; empty where nothing is."""
    written = _written({**options, "names": tuple(names)}) if origin else None
    if written is None:
        return ""
    import llvmlite

    from ..lowering.target_machine import chosen, compiler

    return object_cache.digest("kernel", origin, written, llvmlite.__version__, compiler().version, str(chosen())).hex()


def kernel(key: str, form: Callable[[], Form]) -> Any:
    """The kernel that is kept under a key; None where there is none. ``form`` makes its program when it is needed."""
    from ..runtime.gufunc import make_ufunc
    from ..runtime.kernel_metadata import outline

    found = outline(key, form)
    return None if found is None else make_ufunc(*found)


def keep_kernel(key: str, made: Any) -> None:
    """Store the metadata of a kernel."""
    from ..runtime.gufunc import owner_of
    from ..runtime.kernel_metadata import keep

    if (owner := owner_of(made)) is not None:
        keep(key, made.__name__, owner)


@cache
def _version() -> str:
    """Versions of Python and NumPy, and of this library: size and time of all its files, so that an edited copy is another.

    Raises OSError if the library is in no folder, as in an archive.
    """
    found, folders = [], [str(Path(__file__).parents[1])]
    while folders:
        with os.scandir(folders.pop()) as entries:
            for entry in entries:
                if entry.name.endswith((".py", ".pyc")):  # compiled ones in the place of others, if it has no others
                    about = entry.stat()
                    found.append(f"{entry.path} {about.st_size} {about.st_mtime_ns}")
                elif "." not in entry.name and entry.name != "__pycache__" and entry.is_dir():
                    folders.append(entry.path)
    return "\n".join([sys.version, np.__version__, *sorted(found)])


def _written(options: Mapping[str, Any]) -> str | None:
    """Options as text, without those that are None; None if one is not a plain value."""
    given = {name: value for name, value in sorted(options.items()) if value is not None}
    return repr(given) if _is_plain(given) else None


def _is_plain(value: Any) -> bool:
    if type(value) is dict:
        return all(type(name) is str and _is_plain(x) for name, x in value.items())
    return type(value) in _PLAIN or (type(value) in (list, tuple) and all(map(_is_plain, value)))
