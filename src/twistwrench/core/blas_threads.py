"""Number of threads of OpenBLAS within NumPy and SciPy: one while matrices are small, as further threads would only wait."""

from __future__ import annotations

import ctypes
import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

_FUNCTION_NAMES = (
    "scipy_openblas_{}_num_threads64_", "scipy_openblas_{}_num_threads", "openblas_{}_num_threads64_",
    "openblas_{}_num_threads",
)  # fmt: skip
"""Names of the functions of OpenBLAS, with "get" or "set" in the braces.

The first two are those in wheels of NumPy and SciPy, with integers of 64 and 32 bits; the others are those elsewhere.
"""


class _Library(NamedTuple):
    """One loaded OpenBLAS library."""

    threads: Callable[[], int]
    """Function that returns the number of threads."""
    set_threads: Callable[[int], Any]
    """Function that sets the number of threads."""


class _OneThread:
    """Counter of the calls that need one thread. The first call sets one thread; the last restores the former numbers."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.calls = 0
        """Number of calls that run now."""
        self.former_counts: list[tuple[_Library, int]] = []
        """Libraries with their numbers of threads before the first call."""

    def begin(self) -> None:
        """Begin a call."""
        with self.lock:
            self.calls += 1
            if self.calls == 1:
                self.former_counts = [(library, library.threads()) for library in _libraries()]
                for library, _ in self.former_counts:
                    library.set_threads(1)

    def end(self) -> None:
        """End a call."""
        with self.lock:
            self.calls -= 1
            if self.calls == 0:
                for library, count in self.former_counts:
                    library.set_threads(count)


_ONE_THREAD = _OneThread()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Context in which OpenBLAS runs on one thread, for all threads of the process; other BLAS libraries are not changed."""
    _ONE_THREAD.begin()
    try:
        yield
    finally:
        _ONE_THREAD.end()


def blas_threads() -> list[int]:
    """Number of threads of each loaded OpenBLAS library."""
    return [library.threads() for library in _libraries()]


def _libraries() -> list[_Library]:
    """OpenBLAS libraries that NumPy and SciPy have loaded."""
    libraries = []
    for name in ("numpy", "scipy"):
        module = sys.modules.get(name)
        if module is None or not getattr(module, "__file__", None):
            continue
        package = Path(str(module.__file__)).parent
        for folder in (package.with_name(f"{name}.libs"), package / ".dylibs"):  # on Linux and Windows; on macOS
            for file in sorted(folder.glob("*openblas*")):
                library = _open_library(file)
                if library is not None:
                    libraries.append(library)
    return libraries


def _open_library(path: Path) -> _Library | None:
    """Library in a file if it is loaded already; otherwise None."""
    only_if_loaded = getattr(os, "RTLD_NOLOAD", 0) | getattr(os, "RTLD_NOW", 0)
    with suppress(OSError, AttributeError):
        loaded = ctypes.CDLL(str(path), mode=only_if_loaded)
        for name in _FUNCTION_NAMES:
            getter = name.format("get")
            setter = name.format("set")
            if hasattr(loaded, setter):
                return _Library(getattr(loaded, getter), getattr(loaded, setter))
    return None
