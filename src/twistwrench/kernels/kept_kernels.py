"""Kernels as an earlier process left them: their ports, and the keys of their code; nothing is traced or printed again.

An entry says what a kernel takes and gives and which entries of the cache are its code. The program itself is made when
somebody asks for it: to compile it for float32 or for single samples, to count its operations.
"""

from __future__ import annotations

from ast import literal_eval
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

from ..core import cache
from ..program.port import Port, signature_of

if TYPE_CHECKING:
    from ..program.forms import Form


class KernelOutline(NamedTuple):
    """What is known of a kernel without its program."""

    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    length: int
    """Instructions of its program."""
    effort: int
    """Operations that a sample takes."""
    code: tuple[str, ...]
    """Keys of its code for float64."""
    form: Callable[[], Form]
    """Makes the program."""

    @property
    def signature(self) -> str:
        """The gufunc signature, as the program has it."""
        return signature_of([p.shape for p in self.inputs], [p.shape for p in self.outputs])


def outline(key: str, form: Callable[[], Form]) -> tuple[KernelOutline, str, str] | None:
    """What was kept of a kernel, its name and its description; None where there is nothing."""
    kept = cache.load(key)
    if kept is None:
        return None
    name, doc, inputs, outputs, length, effort, code = literal_eval(kept.decode())
    ins, outs = (tuple(Port(*port) for port in several) for several in (inputs, outputs))
    return KernelOutline(ins, outs, length, effort, code, form), name, doc


def keep(key: str, name: str, owner: Any) -> None:
    """Keep what is known of a kernel, by what is behind its ufunc; nothing where its code is not kept."""
    code = owner.code["d"]
    if code.keys:
        ports = [tuple((p.name, p.shape) for p in several) for several in (owner.given.inputs, owner.given.outputs)]
        about = (name, owner.description, *ports, owner.length, owner.effort, code.keys)
        cache.store(key, repr(about).encode())
