"""Which emitter serves: our own for processors with AVX2, else LLVM's, in sections if the program is long."""

from __future__ import annotations

from collections.abc import Iterator

from ..program.column_groups import ColumnGroups
from ..program.forms import Form, program_of
from ..program.products import Products
from ..program.program import Program
from ..program.recurrence import Recurrence
from ..program.search import Search
from . import avx2_module
from .batch_loop import Loop, loop
from .llvm import LOOP, assembly
from .processor import Machine, Precision
from .product_loop import products_over
from .search_loop import search_over
from .sections import in_sections
from .time_loop import loop_over

SHORT, SHORT_WITH_DIVISIONS = 400, 1500
"""Programs below these are LLVM's everywhere: it hides the waiting for a division, and finds registers for few values."""

LONG = 2000
"""Programs beyond this many instructions are emitted in sections; from here on they run faster, too (bench/NOTES.md)."""


def modules(given: Form, precision: Precision, machine: Machine) -> Iterator[str]:
    """The texts to compile and to link together."""
    program, around = program_of(given), _around(given, machine)
    if isinstance(given, ColumnGroups):
        yield from in_sections(given, precision, machine, around)
    elif _is_long_enough(program) and avx2_module.serves(program, machine):
        yield avx2_module.module(program, precision, machine, LOOP, around)
    elif len(program.instructions) > LONG:
        yield from in_sections(program, precision, machine, around)
    else:
        yield assembly(program, precision, machine, around)


def _around(given: Form, machine: Machine) -> Loop:
    """The loop around the blocks."""
    if isinstance(given, Recurrence):
        return loop_over(given)
    if isinstance(given, Products):
        return products_over(given, fused=machine.fused)
    return search_over(given) if isinstance(given, Search) else loop


def _is_long_enough(program: Program) -> bool:
    """Whether registers of our own choosing pay; measured, see bench/NOTES.md."""
    divides = any(i.op == "div" for i in program.instructions)
    return len(program.instructions) >= (SHORT_WITH_DIVISIONS if divides else SHORT)
