"""Which emitter serves: our own for processors with AVX2, else LLVM's, in sections if the program is long."""

from __future__ import annotations

from collections.abc import Iterator

from ..program.program import Program
from ..program.recurrence import Recurrence
from . import avx2_module
from .llvm import LOOP, assembly
from .loop import loop
from .machine import Machine, Precision
from .sections import in_sections
from .steps import loop_over

__all__ = ["modules"]

LONG = 2000
"""Programs beyond this many instructions are emitted in sections; from here on they run faster, too (bench/NOTES.md)."""


def modules(given: Program | Recurrence, precision: Precision, machine: Machine) -> Iterator[str]:
    """The texts to compile and to link together."""
    program, around = (given.program, loop_over(given)) if isinstance(given, Recurrence) else (given, loop)
    if avx2_module.serves(program, machine):
        yield avx2_module.module(program, precision, machine, LOOP, around)
    elif len(program.instructions) > LONG:
        yield from in_sections(program, precision, machine, around)
    else:
        yield assembly(program, precision, machine, around)
