"""A program whose results are factors, and matrices that are products of them: what a loop makes better than instructions.

Entry (r, c) of a matrix of relations between joints is a dot product of what belongs to r and what belongs to c; which one
depends on which of the two carries the other. Unrolled, a chain of n joints has n² of them; as loops they are a few lines.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from .port import Port, signature_of
from .program import Program

NEITHER, BEFORE, AFTER = 0, 1, 2
"""Of an entry: nothing there; its row's joint carries its column's; it is the other way about, or they are the same."""


@dataclass(frozen=True)
class Product:
    """One matrix (n, n): by number the results that are its factors, a row (n, k) and a column (k, n) of each pair."""

    name: str
    before: tuple[int, int]
    after: tuple[int, int]
    added: tuple[tuple[int, int, float], ...] = ()
    """Row, column and number of what is added."""


@dataclass(frozen=True)
class Products:
    """A program, and what is made of its results."""

    program: Program
    matrices: tuple[Product, ...]
    relations: tuple[tuple[int, ...], ...]
    """Row by row, which product an entry is."""

    @property
    def inputs(self) -> tuple[Port, ...]:
        """What the kernel takes: what the program does."""
        return self.program.inputs

    @property
    def outputs(self) -> tuple[Port, ...]:
        """What the kernel returns: the matrices."""
        n = len(self.relations)
        return tuple(Port(matrix.name, (n, n)) for matrix in self.matrices)

    @cached_property
    def signature(self) -> str:
        """The gufunc signature."""
        return signature_of([p.shape for p in self.inputs], [p.shape for p in self.outputs])
