"""Robots whose files an earlier process has read: what a first result needs is kept on disk, and nothing is parsed or traced.

A robot is known by the bytes of its file, the options it was loaded with, and the version of this library. Only URDF is known
so, which is read from one file, and only where there was nothing to remark: what is doubtful is said at each loading. The model
is made, from the bytes that were read, when somebody asks for more than the kernels that are kept.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import cache, cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ..core import cache as disk
from ..core.files import read_bytes

if TYPE_CHECKING:
    from ..model.model import Model
    from ..program.forms import Form

_PLAIN = (str, int, float, bool, type(None))
"""Types of options that are known again by how they are written."""
_SOUND = b"nothing to remark"
_READERS = ("twistwrench.model.builder", "twistwrench.program.trace")
"""Modules that are imported to make a robot and a kernel. Where somebody else has imported one first, perhaps to change it,
nothing is kept and nothing taken."""
_PARTS = (
    "",
    "algorithms",
    "bodies",
    "core",
    "formats",
    "joints",
    "kernels",
    "lie",
    "model",
    "program",
    "robot",
    "targets",
)
"""Packages that robots and kernels depend on."""


class KnownFile(NamedTuple):
    """A robot's file, with the options it is loaded with."""

    data: bytes
    key: str
    sound: bool
    """Whether it was loaded before, and nothing was to be remarked."""


class KeptModel:
    """The model of a robot of which something is kept under the key of its file; made when first asked for."""

    def __init__(self, key: str, make: Callable[[], Model]) -> None:
        self.key, self._make = key, make

    @cached_property
    def model(self) -> Model:
        """The model."""
        return self._make()


def known_file(source: object, options: Mapping[str, Any]) -> KnownFile | None:
    """What is known of a robot's file; None of all that is no plain URDF file, and where nothing is kept."""
    if not isinstance(source, str | os.PathLike) or not str(source).endswith(".urdf") or not _serves():
        return None
    written = _written(options)
    try:
        if written is None or not Path(source).is_file() or disk.folder() is None:
            return None
        data, version = read_bytes(Path(source)), _version()
    except (OSError, ValueError):  # which loading explains; or the library's own files are in an archive
        return None
    if b"<robot" not in data or b"<mujoco" in data or b"<sdf" in data:
        return None
    key = disk.digest("robot", version, os.fspath(source), written, data).hex()
    return KnownFile(data, key, disk.load(key) == _SOUND)


def keep_file(known: KnownFile) -> None:
    """Note that a file was loaded, and nothing was to be remarked."""
    if not known.sound:
        disk.store(known.key, _SOUND)


def kernel_key(origin: str, names: Sequence[str], options: Mapping[str, Any]) -> str:
    """The key of what is kept of a kernel; empty where nothing is."""
    written = _written({**options, "names": tuple(names)}) if origin else None
    if written is None:
        return ""
    import llvmlite

    from ..targets.compiler import compiler
    from ..targets.processor import chosen

    return disk.digest("kernel", origin, written, llvmlite.__version__, compiler().version, str(chosen())).hex()


def kernel(key: str, form: Callable[[], Form]) -> Any:
    """The kernel that is kept under a key; None where there is none. ``form`` makes its program when it is needed."""
    from ..kernels.kept_kernels import outline
    from ..kernels.ufunc import make_ufunc

    found = outline(key, form)
    return None if found is None else make_ufunc(*found)


def keep_kernel(key: str, made: Any) -> None:
    """Keep what is known of a kernel."""
    from ..kernels.kept_kernels import keep
    from ..kernels.ufunc import owner_of

    if (owner := owner_of(made)) is not None:
        keep(key, made.__name__, owner)


@cache
def _serves() -> bool:
    """Whether robots are kept in this process; decided when the first is loaded."""
    return not any(name in sys.modules for name in _READERS)


@cache
def _version() -> str:
    """What tells this library from another version of it: size and time of its files, compiled ones where it has no others.

    Raises OSError where a package is in no folder, or has no files there.
    """
    root = Path(__file__).parents[1]
    about = []
    for part in _PARTS:
        with os.scandir(root / part) as entries:
            files = sorted((entry.name, entry.stat()) for entry in entries if entry.name.endswith((".py", ".pyc")))
        if not files:
            raise FileNotFoundError(root / part)
        about += [f"{part}/{name} {s.st_size} {s.st_mtime_ns}" for name, s in files]
    return "\n".join([sys.version, *about])


def _written(options: Mapping[str, Any]) -> str | None:
    """The options as text, those that are None left out; None where one is no plain value."""
    given = {name: value for name, value in sorted(options.items()) if value is not None}
    return repr(given) if _is_plain(given) else None


def _is_plain(value: Any) -> bool:
    if type(value) is dict:
        return all(type(name) is str and _is_plain(x) for name, x in value.items())
    return type(value) in _PLAIN or (type(value) in (list, tuple) and all(map(_is_plain, value)))
