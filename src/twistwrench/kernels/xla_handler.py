"""The compiled loop of a kernel as a handler of XLA's foreign functions: a call of it enters no Python."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from typing import Any

from ..targets.processor import DOUBLE, SINGLE
from ..targets.xla_handler_text import INSTALL, handler_assembly
from .jit import assembled
from .ufunc import owner_of

_INSTALLED = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_void_p)


@dataclass(frozen=True)
class XlaHandler:
    """A function in memory, and what has to live as long as it."""

    address: int
    keep: tuple[Any, ...]


def is_compiled(kernel: Any) -> bool:
    """Whether there is machine code behind a kernel, with something to compute."""
    owner = owner_of(kernel)
    return owner is not None and any(port.size for port in owner.given.outputs)


def make_handler(kernel: Any, char: str, version: tuple[int, int], *, alone: bool) -> XlaHandler:
    """The handler of a compiled kernel for arrays of type ``char``, of one sample (``alone``) or of any number."""
    owner = owner_of(kernel)
    if owner is None:
        raise TypeError("kernel: a compiled one is wanted; is_compiled says which are")
    precision = SINGLE if char == SINGLE.char else DOUBLE
    loop = owner.alone(precision).address if alone else owner.address(precision)
    code = assembled(
        handler_assembly(owner.given.inputs, owner.given.outputs, precision, version), INSTALL, owner.machine
    )
    address = _INSTALLED(code.address)(loop)
    return XlaHandler(address, (code, kernel))
