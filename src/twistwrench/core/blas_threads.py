"""Threads of the BLAS library within NumPy and SciPy: one where matrices are small, so that no thread only waits."""

from __future__ import annotations

import ctypes
import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

_NAMES = [f"{begin}openblas_{{}}_num_threads{end}" for begin in ("scipy_", "") for end in ("64_", "")]
"""Functions of OpenBLAS in wheels of NumPy and SciPy, and elsewhere."""


class _Library(NamedTuple):
    threads: Callable[[], int]
    set_threads: Callable[[int], Any]


class _OneThread:
    """Calls that want one thread; the first sets it, and the last restores what was set before."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.calls = 0
        self.before: list[tuple[_Library, int]] = []

    def begin(self) -> None:
        with self.lock:
            self.calls += 1
            if self.calls == 1:
                self.before = [(library, library.threads()) for library in _libraries()]
                for library, _ in self.before:
                    library.set_threads(1)

    def end(self) -> None:
        with self.lock:
            self.calls -= 1
            if self.calls == 0:
                for library, count in self.before:
                    library.set_threads(count)


_ONE = _OneThread()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Run OpenBLAS on one thread in the block, in all threads of the process; other libraries are left as they are."""
    _ONE.begin()
    try:
        yield
    finally:
        _ONE.end()


def blas_threads() -> list[int]:
    """Number of threads of each loaded OpenBLAS library."""
    return [library.threads() for library in _libraries()]


def _libraries() -> list[_Library]:
    """OpenBLAS libraries that NumPy and SciPy have loaded."""
    found = []
    for name in ("numpy", "scipy"):
        module = sys.modules.get(name)
        if module is None or not getattr(module, "__file__", None):
            continue
        package = Path(str(module.__file__)).parent
        for folder in (package.with_name(f"{name}.libs"), package / ".dylibs"):
            found += [library for path in sorted(folder.glob("*openblas*")) if (library := _opened(path)) is not None]
    return found


def _opened(path: Path) -> _Library | None:
    with suppress(OSError, AttributeError):
        loaded = ctypes.CDLL(str(path), mode=getattr(os, "RTLD_NOLOAD", 0) | getattr(os, "RTLD_NOW", 0))
        for name in _NAMES:
            if hasattr(loaded, name.format("set")):
                return _Library(getattr(loaded, name.format("get")), getattr(loaded, name.format("set")))
    return None
