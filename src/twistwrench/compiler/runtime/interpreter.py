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
"""Environment variable: 0 runs programs on NumPy."""


def switched_on(variable: str, off: str, on: str) -> bool:
    """True if an environment variable is 1, on, empty or missing; False if it is 0 or off.

    Raises ValueRangeError for another value; ``off`` and ``on`` are the effects of both values, for its message.
    """
    text = os.environ.get(variable, "").strip().lower()
    if not text:
        text = "1"
    if text not in ("0", "1", "off", "on"):
        raise ValueRangeError(
            f"{variable}: {os.environ[variable]!r} is not understood. Set 0 or off to {off}; 1, on or nothing to {on}."
        )
    return text in ("1", "on")


def compiles() -> bool:
    """True if programs are compiled: whenever that is possible, unless ``TWISTWRENCH_JIT=0``."""
    if not switched_on(VARIABLE, "run programs on NumPy", "compile them"):
        return False
    return runs_machine_code() and _may_run_pages()


def runs_machine_code() -> bool:
    """True if programs can be compiled: on 64-bit CPython, where ``id`` is the address of an object, with llvmlite."""
    has_64_bits = sys.maxsize > 2**32
    return sys.implementation.name == "cpython" and has_64_bits and _has_llvmlite()


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
    """True if llvmlite is installed; it is optional, because it has no wheel for some platforms, such as browsers."""
    try:
        return importlib.util.find_spec("llvmlite") is not None
    except ImportError:
        return False


@cache
def is_main() -> bool:
    """True in the process's main interpreter, False in a subinterpreter.

    In a subinterpreter, ctypes deadlocks when C calls back into Python. If a subinterpreter ends while a daemon thread runs,
    the process ends.
    """
    if not runs_machine_code():  # only compiled programs need to know
        return True
    current_interpreter = ctypes.pythonapi.PyInterpreterState_Get
    main_interpreter = ctypes.pythonapi.PyInterpreterState_Main
    current_interpreter.restype = main_interpreter.restype = ctypes.c_void_p
    return bool(current_interpreter() == main_interpreter())
