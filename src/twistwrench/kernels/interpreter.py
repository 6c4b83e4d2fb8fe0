"""Which Python this code runs in."""

from __future__ import annotations

import ctypes
import sys
from functools import cache

__all__ = ["is_main", "runs_machine_code"]


def runs_machine_code() -> bool:
    """Whether programs can be compiled for it: CPython of 64 bits, whose objects lie where their ``id`` says."""
    return sys.implementation.name == "cpython" and sys.maxsize > 2**32


@cache
def is_main() -> bool:
    """Whether it is the process's first interpreter. In another, ctypes waits forever for a lock when C calls back into
    Python, and a daemon thread ends the process with the interpreter.
    """
    if not runs_machine_code():
        return True
    current, main = ctypes.pythonapi.PyInterpreterState_Get, ctypes.pythonapi.PyInterpreterState_Main
    current.restype = main.restype = ctypes.c_void_p
    return bool(current() == main())
