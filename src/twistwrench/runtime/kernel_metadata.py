"""Kernels cached by an earlier process: their arrays, and the keys of their code; nothing is traced or printed again.

The program itself is made at its first use: to compile it for float32 or for single samples, to count its operations.
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
    """Description of a kernel without its program."""

    inputs: tuple[TensorSpec, ...]
    outputs: tuple[TensorSpec, ...]
    length: int
    """Number of instructions of its program."""
    cost: int
    """Operations of a sample."""
    code: tuple[str, ...]
    """Cache keys of its code for float64."""
    form: Callable[[], Form]
    """Function that makes the program."""
    key: str
    """Its own cache key."""

    @property
    def signature(self) -> str:
        """The gufunc signature, as the program has it."""
        return signature_of([p.shape for p in self.inputs], [p.shape for p in self.outputs])


def outline(key: str, form: Callable[[], Form]) -> tuple[KernelMetadata, str, str] | None:
    """Cached metadata of a kernel, its name and its description; None if there are none."""
    kept = object_cache.load(key)
    if kept is None:
        return None
    name, doc, inputs, outputs, length, cost, code = literal_eval(kept.decode())
    ins, outs = (tuple(TensorSpec(*port) for port in several) for several in (inputs, outputs))
    return KernelMetadata(ins, outs, length, cost, code, form, key), name, doc


def code_of(key: str, precision: Precision, machine: Machine, form: Callable[[], Form]) -> Code:
    """Code of a kernel for another type or another vector width, cached if the kernel is."""
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
    """Cache the metadata of a kernel by the owner of its ufunc, if its code is cached."""
    owner.kept = key
    code = owner.code["d"]
    if code.keys:
        ports = [tuple((p.name, p.shape) for p in several) for several in (owner.given.inputs, owner.given.outputs)]
        about = (name, owner.description, *ports, owner.length, owner.cost, code.keys)
        object_cache.store(key, repr(about).encode())
