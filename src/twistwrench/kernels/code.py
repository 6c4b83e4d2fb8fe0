"""Machine code in this process: compiled by LLVM or taken from the cache, and the address of its loop."""

from __future__ import annotations

import hashlib
import itertools
import os
import threading
from dataclasses import dataclass
from typing import Any

from ..errors import KernelError
from ..program.program import Program
from ..targets.llvm import LOOP, assembly
from ..targets.machine import Machine, Precision, host
from . import cache

__all__ = ["LOCK", "Code", "assembled", "compiled"]


@dataclass(frozen=True)
class Code:
    """A function in memory; the code is freed with this object."""

    address: int
    keep: Any
    size: int
    """Bytes of object code."""
    cached: bool
    """Whether it came from the disk."""


class _Jit:
    """The one linker of this process, made at its first use; LLVM is not imported before."""

    def __init__(self) -> None:
        self.lock = threading.RLock()
        self._linker: Any = None
        self._numbers = itertools.count()
        if hasattr(os, "register_at_fork"):  # no fork while another thread compiles: the child would find LLVM locked
            release = self.lock.release
            os.register_at_fork(before=self.lock.acquire, after_in_parent=release, after_in_child=release)

    def target(self, machine: Machine) -> Any:
        import llvmlite.binding as llvm

        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        # The small code model lets constants be operands in memory; the default for JITs fetches each one's address.
        return llvm.Target.from_triple(machine.triple).create_target_machine(
            cpu=machine.cpu, features=machine.features, opt=2, reloc="pic", codemodel="small"
        )

    def link(self, code: bytes, symbol: str, machine: Machine) -> Any:
        import llvmlite.binding as llvm

        if self._linker is None:
            self._linker = llvm.create_lljit_compiler(self.target(machine))
        builder = llvm.JITLibraryBuilder().add_object_img(code).add_current_process().export_symbol(symbol)
        return builder.link(self._linker, f"twistwrench{next(self._numbers)}")


_JIT = _Jit()
LOCK = _JIT.lock
"""Held while anything compiles."""


def compiled(program: Program, precision: Precision) -> Code:
    """Code for ``program`` on this machine, from the cache if it is there."""
    with _JIT.lock:
        return assembled(assembly(program, precision, host()), LOOP)


def assembled(text: str, symbol: str) -> Code:
    """Code of a module of LLVM assembly, from the cache if it is there; the address is that of ``symbol``."""
    import llvmlite
    import llvmlite.binding as llvm

    machine = host()
    with _JIT.lock:
        versions = f"{llvmlite.__version__} {llvm.llvm_version_info} {machine}"
        key = hashlib.sha256(f"{versions}\n{text}".encode()).hexdigest()
        code = cache.load(key)
        try:
            if code is not None:
                try:
                    return _loaded(code, symbol, machine, cached=True)
                except RuntimeError:  # a cache entry that no longer links is as good as none
                    code = None
            code = _JIT.target(machine).emit_object(llvm.parse_assembly(text))
            loaded = _loaded(code, symbol, machine, cached=False)
        except RuntimeError as problem:
            raise KernelError(
                f"LLVM refused a kernel ({problem}). Set TWISTWRENCH_JIT=0 to run on NumPy, and please report this."
            ) from problem
        cache.store(key, code)
        return loaded


def _loaded(code: bytes, symbol: str, machine: Machine, *, cached: bool) -> Code:
    library = _JIT.link(code, symbol, machine)
    return Code(library[symbol], library, len(code), cached)
