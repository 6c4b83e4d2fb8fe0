"""LLVM assembly of a program with its loop: one function, or partitions if the program is long.

Loops are imported at their first use: the first kernel of an arm needs few modules.
"""

from __future__ import annotations

from collections.abc import Iterator

from ..ir.loops import ColumnSolve, Form, Products, Scan, program_of
from ..ir.program import Program
from .batch_loop import Loop, loop
from .block import assembly
from .target_machine import Machine, Precision

LONG = 2000
"""Most instructions of one function; longer programs are partitioned, and run faster so (bench/NOTES.md)."""


def modules(given: Form, precision: Precision, machine: Machine) -> Iterator[str]:
    """The texts to compile and to link together."""
    program, around = program_of(given), _around(given, machine)
    cut = given if isinstance(given, ColumnSolve) else program
    if cut is not program or len(program.instructions) > LONG:
        from .partition import partitioned

        yield from partitioned(cut, precision, machine, around)
    else:
        yield assembly(program, precision, machine, around)


def _around(given: Form, machine: Machine) -> Loop:
    """The loop around the blocks."""
    if isinstance(given, Program | ColumnSolve):
        return loop
    if isinstance(given, Scan):
        from .scan_loop import loop_over

        return loop_over(given)
    if isinstance(given, Products):
        from .product_loop import products_over

        return products_over(given, fused=machine.fused)
    from .search_loop import search_over

    return search_over(given)
