"""Properties of the Python interpreter, and the decision whether programs are compiled."""

from __future__ import annotations

import ctypes
import importlib.util
import mmap
import os
import sys
import warnings
from functools import cache

import numpy as np

from ...core.errors import ValueRangeError
from .executable_memory import ExecutableMemory, UnsupportedObject

VARIABLE = "TWISTWRENCH_JIT"


def switched_on(variable: str, off: str, on: str) -> bool:
    """True unless an environment variable switches off a default; ``off`` and ``on`` describe the effects in the error.

    Raises ValueRangeError for another value.
    """
    text = os.environ.get(variable, "").strip().lower() or "1"
    if text not in ("0", "1", "off", "on"):
        raise ValueRangeError(
            f"{variable}: {os.environ[variable]!r} is not understood. Set 0 or off to {off}; 1, on or nothing to {on}."
        )
    return text in ("1", "on")


def compiles() -> bool:
    """True if programs are compiled: if that is possible, unless ``TWISTWRENCH_JIT=0``."""
    return switched_on(VARIABLE, "run programs on NumPy", "compile them") and runs_machine_code() and _may_run_pages()


def runs_machine_code() -> bool:
    """True if programs can be compiled: 64-bit CPython, whose objects are at the address ``id``, with llvmlite."""
    return sys.implementation.name == "cpython" and sys.maxsize > 2**32 and _has_llvmlite()


@cache
def _may_run_pages() -> bool:
    """True if the system executes memory that was written to; SELinux and systemd's MemoryDenyWriteExecute can forbid it."""
    try:
        ExecutableMemory.from_image(np.zeros(mmap.PAGESIZE, np.uint8))
    except UnsupportedObject:
        warnings.warn(
            "The system forbids executable memory, so programs run on NumPy, which is slower. Allow it to this process "
            f"(MemoryDenyWriteExecute=no in systemd, execmem in SELinux), or set {VARIABLE}=0.",
            RuntimeWarning,
            stacklevel=2,
        )
        return False
    return True


@cache
def _has_llvmlite() -> bool:
    """True if llvmlite is installed; it is optional, as some platforms such as browsers have no wheel."""
    try:
        return importlib.util.find_spec("llvmlite") is not None
    except ImportError:
        return False


@cache
def is_main() -> bool:
    """True in the process's first interpreter.

    In another one, ctypes deadlocks when C calls back into Python, and a daemon thread ends the process when the interpreter
    ends.
    """
    if not runs_machine_code():
        return True
    current, main = ctypes.pythonapi.PyInterpreterState_Get, ctypes.pythonapi.PyInterpreterState_Main
    current.restype = main.restype = ctypes.c_void_p
    return bool(current() == main())
