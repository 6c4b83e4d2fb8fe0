"""Kernels as an earlier process left them: their ports, and the keys of their code; nothing is traced or printed again.

An entry says what a kernel takes and gives and which entries of the cache are its code. The program itself is made when
somebody asks for it: to compile it for float32 or for single samples, to count its operations.
"""

from __future__ import annotations

from ast import literal_eval
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

from ..core import object_cache
from ..ir.program import TensorSpec, signature_of
from .jit import Code, compiled, found

if TYPE_CHECKING:
    from ..ir.loops import Form
    from ..lowering.target_machine import Machine, Precision


class KernelMetadata(NamedTuple):
    """What is known of a kernel without its program."""

    inputs: tuple[TensorSpec, ...]
    outputs: tuple[TensorSpec, ...]
    length: int
    """Instructions of its program."""
    cost: int
    """Operations that a sample takes."""
    code: tuple[str, ...]
    """Keys of its code for float64."""
    form: Callable[[], Form]
    """Makes the program."""
    key: str
    """What it is kept under."""

    @property
    def signature(self) -> str:
        """The gufunc signature, as the program has it."""
        return signature_of([p.shape for p in self.inputs], [p.shape for p in self.outputs])


def outline(key: str, form: Callable[[], Form]) -> tuple[KernelMetadata, str, str] | None:
    """What was kept of a kernel, its name and its description; None where there is nothing."""
    kept = object_cache.load(key)
    if kept is None:
        return None
    name, doc, inputs, outputs, length, cost, code = literal_eval(kept.decode())
    ins, outs = (tuple(TensorSpec(*port) for port in several) for several in (inputs, outputs))
    return KernelMetadata(ins, outs, length, cost, code, form, key), name, doc


def code_of(key: str, precision: Precision, machine: Machine, form: Callable[[], Form]) -> Code:
    """Further code of a kernel that is kept under a key, if one is: for another type or other vectors."""
    if not key:
        return compiled(form(), precision, machine)
    mine = object_cache.digest("code", key, precision.char, str(machine)).hex()
    if (kept := object_cache.load(mine)) is not None and (code := found(kept.decode().split(), machine)) is not None:
        return code
    code = compiled(form(), precision, machine)
    if code.keys:
        object_cache.store(mine, " ".join(code.keys).encode())
    return code


def keep(key: str, name: str, owner: Any) -> None:
    """Keep what is known of a kernel, by what is behind its ufunc; nothing where its code is not kept."""
    owner.kept = key
    code = owner.code["d"]
    if code.keys:
        ports = [tuple((p.name, p.shape) for p in several) for several in (owner.given.inputs, owner.given.outputs)]
        about = (name, owner.description, *ports, owner.length, owner.cost, code.keys)
        object_cache.store(key, repr(about).encode())
