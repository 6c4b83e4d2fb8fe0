"""Machine code in this process: compiled by LLVM or loaded from the cache, and the address of its loop."""

from __future__ import annotations

import itertools
import os
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from ...core import object_cache
from ...core.errors import KernelError
from ..lowering.target_machine import LOOP, Machine, Precision, chosen, compiler
from .elf_loader import load_objects
from .executable_memory import UnsupportedObject

if TYPE_CHECKING:
    from ..ir.loops import Form

CODE_GENERATION_LEVEL = 1
"""LLVM's level of optimisation. Level 2 takes half as long again without making code faster (bench/NOTES.md). Level 0 takes
less than half as long; its code runs half as long again, with the same bits."""
SILENT_SECONDS = 1.0
"""Compile time [s] after which a message appears on the terminal."""
_LINKER_ERRORS = (
    RuntimeError,  # of LLVM
    ValueError,  # of LLVM, if its message is not UTF-8
    KeyError,  # of a missing function
)
"""Errors of linking."""


class Code(NamedTuple):
    """Function in memory; the code is freed with this object."""

    address: int
    """Address of the function."""
    keep: Any
    """Object that owns the memory."""
    size: int
    """Size of the object code [bytes]."""
    cached: bool
    """True if the code came from the disk cache."""
    keys: tuple[str, ...] = ()
    """Keys of its cache entries."""


class _Jit:
    """The linker of this process, created on first use; LLVM is not imported before."""

    def __init__(self) -> None:
        self.lock = threading.RLock()
        self._linker: Any = None
        self._library_numbers = itertools.count()
        if hasattr(os, "register_at_fork"):  # no fork while a thread compiles: LLVM would stay locked
            release = self.lock.release
            os.register_at_fork(before=self.lock.acquire, after_in_parent=release, after_in_child=release)

    def target(self, machine: Machine) -> Any:
        """LLVM's code generator for a machine."""
        import llvmlite.binding as llvm

        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        llvm.initialize_native_asmparser()
        # codemodel: the small one allows constants as memory operands; LLVM's default in a process would load each address
        return llvm.Target.from_triple(machine.triple).create_target_machine(
            cpu=machine.cpu, features=machine.features, opt=CODE_GENERATION_LEVEL, reloc="pic", codemodel="small"
        )

    def link(self, objects: Sequence[bytes], symbol: str, machine: Machine) -> Any:
        """Library of object codes, whose entry ``symbol`` is the address of this function."""
        import llvmlite.binding as llvm

        if self._linker is None:
            self._linker = llvm.create_lljit_compiler(self.target(machine))
        builder = llvm.JITLibraryBuilder().add_current_process().export_symbol(symbol)
        for code in objects:
            builder.add_object_img(code)
        return builder.link(self._linker, f"twistwrench{next(self._library_numbers)}")


_JIT = _Jit()
LOCK = _JIT.lock
"""Held during every compilation."""


def compile_form(program: Form, precision: Precision, machine: Machine | None = None) -> Code:
    """Code of ``program`` for the given machine, or for the chosen one, from the cache if possible.

    If compilation takes more than a second, a message on the terminal names the results.
    """
    from ..lowering.lower import modules

    chosen_machine = machine or chosen()

    def texts() -> Iterator[str]:
        """Texts of the modules; called again if cache entries have to be compiled again."""
        return _with_message(program, modules(program, precision, chosen_machine))

    with _JIT.lock:
        return _link_modules(texts, LOOP, chosen_machine)


def _with_message(program: Form, texts: Iterable[str]) -> Iterator[str]:
    """Yield the texts of modules; once their compilation has taken long, a message on stderr names the results.

    The caller compiles each text before it takes the next one, so the time between two texts is that of a compilation.
    """
    start = time.perf_counter()
    has_message = False
    for text in texts:
        is_slow = time.perf_counter() - start > SILENT_SECONDS
        if is_slow and not has_message and sys.stderr is not None and sys.stderr.isatty():
            results = ", ".join(port.name for port in program.outputs)
            sys.stderr.write(f"twistwrench: compiling a kernel of {results}; the cache keeps it for the next time.\n")
            has_message = True
        yield text


def cached_code(keys: Sequence[str], machine: Machine) -> Code | None:
    """Code of a kernel from the keys of its cache entries; None if an entry is missing or the entries do not link."""
    objects: list[bytes] = []
    for key in keys:
        object_code = object_cache.load(key)
        if object_code is None:
            return None
        objects.append(object_code)
    with _JIT.lock:
        try:
            loaded = _load(objects, LOOP, machine, cached=True)
            return loaded._replace(keys=tuple(keys))
        except _LINKER_ERRORS:
            return None


def assemble(text: str, symbol: str, machine: Machine) -> Code:
    """Code of a module of LLVM assembly, from the cache if possible, with the address of ``symbol``."""
    return _link_modules(lambda: [text], symbol, machine)


def _link_modules(texts: Callable[[], Iterable[str]], symbol: str, machine: Machine) -> Code:
    """Code of several modules together. Each is written, compiled and cached by itself, so only one long text exists."""
    with _JIT.lock:
        try:
            objects = [_object_code(text, machine) for text in texts()]  # key, code and origin of each
            keys, object_codes, from_cache = zip(*objects, strict=True)
            try:
                loaded = _load(object_codes, symbol, machine, cached=all(from_cache))
            except _LINKER_ERRORS:  # cache entries that no longer link are compiled again
                if not any(from_cache):
                    raise
                objects = [_object_code(text, machine, afresh=True) for text in texts()]
                keys, object_codes, from_cache = zip(*objects, strict=True)
                loaded = _load(object_codes, symbol, machine, cached=False)
        except RuntimeError as problem:
            raise KernelError(
                f"LLVM refused a kernel ({problem}). Set TWISTWRENCH_JIT=0 to run on NumPy, and please report this."
            ) from problem
        for key, object_code, is_cached in objects:
            if not is_cached:
                object_cache.store(key, object_code)
        return loaded._replace(keys=keys)


def _object_code(text: str, machine: Machine, *, afresh: bool = False) -> tuple[str, bytes, bool]:
    """Cache key of a module, its object code, and True if the code came from the cache; ``afresh`` ignores the cache."""
    import llvmlite

    compiler_and_machine = f"{llvmlite.__version__} {compiler().version} {machine}"
    key = object_cache.digest(compiler_and_machine, text).hex()
    if not afresh:
        cached_code = object_cache.load(key)
        if cached_code is not None:
            return key, cached_code, True
    import llvmlite.binding as llvm

    # A context of its own: in the global one, the module's constants would never be freed. The module is freed here, then the
    # context. The garbage collector has no order and could free the module twice, for example after an exception.
    with llvm.create_context() as context, llvm.parse_assembly(text, context) as module:
        return key, _JIT.target(machine).emit_object(module), False


def _load(objects: Sequence[bytes], symbol: str, machine: Machine, *, cached: bool) -> Code:
    """Function in memory from object codes, by the package's own loader if it can, otherwise by LLVM's linker."""
    try:
        library: Any = load_objects(objects)
    except UnsupportedObject:
        library = _JIT.link(objects, symbol, machine)
    return Code(library[symbol], library, size=sum(map(len, objects)), cached=cached)
