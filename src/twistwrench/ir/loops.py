"""A program taken again and again: its results are its inputs the next time, for as many steps as are asked for.

The loop over the steps is part of the kernel. Its signature has two sizes of its own: ``(k)`` steps are taken, and every
k/m-th state is kept, in ``(m)`` rows. The states at the beginning go in once; whatever else goes in may differ from step to
step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from .program import Program, TensorSpec, signature_of

STEPS, KEPT = "k", "m"
"""The names of the two sizes in the signature."""


@dataclass(frozen=True)
class Source:
    """Where an input of the program comes from.

    ``"state"``: what result number ``state`` was the last time. ``"start"``: what it was when the step began, for programs that
    are taken several times a step. ``"stage"``: the row of the table for this time. ``"given"``: an array of the caller's.
    """

    kind: str
    state: int = 0


@dataclass(frozen=True)
class Scan:
    """A program, what its inputs are, and how often it is taken in a step.

    The first ``visible`` results are the state; ``hidden`` ones follow, which are zero at the beginning and nobody sees. What
    remains is said of a step as it begins: the torques applied, for example.
    """

    program: Program
    sources: tuple[Source, ...]
    visible: int
    hidden: int = 0
    table: tuple[tuple[float, ...], ...] = ((),)
    """A row for each time that the program is taken in a step."""

    @property
    def states(self) -> tuple[TensorSpec, ...]:
        """The results that are fed back, hidden ones last."""
        return self.program.outputs[: self.visible + self.hidden]

    @property
    def given(self) -> tuple[int, ...]:
        """The numbers of the inputs that the caller gives for each step."""
        return tuple(k for k, source in enumerate(self.sources) if source.kind == "given")

    @property
    def said(self) -> tuple[int, ...]:
        """The numbers of the results that are said of a step as it begins."""
        return tuple(range(self.visible + self.hidden, len(self.program.outputs)))

    @property
    def inputs(self) -> tuple[TensorSpec, ...]:
        """What the kernel takes, one step of it: first states, then what is given for each step."""
        return (*self.program.outputs[: self.visible], *(self.program.inputs[k] for k in self.given))

    @property
    def outputs(self) -> tuple[TensorSpec, ...]:
        """What the kernel returns, one row of it: states, then what is said of steps."""
        return (*self.program.outputs[: self.visible], *(self.program.outputs[k] for k in self.said))

    @cached_property
    def signature(self) -> str:
        """The gufunc signature, as in ``(7),(7),(k,7)->(m,7),(m,7)``."""
        ins: list[Sequence[int | str]] = [port.shape for port in self.inputs[: self.visible]]
        ins += [(STEPS, *port.shape) for port in self.inputs[self.visible :]]
        return signature_of(ins, [(KEPT, *port.shape) for port in self.outputs])


# ── A program taken again and again until it says that it is there, from one start after the other: a search

# The loop is part of the kernel. An attempt begins at a start and ends when the program says so, or after as many times as the
# settings allow; the next begins at the nearest of the places that are left. The first attempt that gets there is the answer,
# else the one that comes nearest. So what is found for a sample depends on no other sample, nor on how many of its attempts are
# made side by side.

PLACES = 64
"""Starts that a table has, beside the first."""

TIMES, ATTEMPTS, ALLOWED = 0, 1, 2
"""Where the settings say how often the program is taken in an attempt at most, and how often to start again; what the program
is given of them begins at the third."""


@dataclass(frozen=True)
class Search:
    """A program whose inputs are x, x once more, what is passed on, and what is given: the target and what is allowed of it.

    Its results are the next x, and what is passed on: the best x so far; what is said of it, first whether it is there (1; -1
    where there is nothing to look for) and what it costs; how long nothing got nearer; and last whether it goes on.
    """

    program: Program
    target: TensorSpec
    """What is looked for."""
    near: tuple[int, ...]
    """The entries of the target by which places are near: sums of squares, each with its own weight."""
    begins: tuple[float, ...]
    """What is passed on to the first step, after x."""
    least: tuple[float, ...]
    """What the entries of x are at least, as an attempt begins."""
    most: tuple[float, ...]
    """What they are at most."""

    @property
    def x(self) -> TensorSpec:
        """What is moved."""
        return self.program.outputs[0]

    @property
    def said(self) -> TensorSpec:
        """How many starts it took, and what the program says of the best x."""
        return TensorSpec("said", (self.program.outputs[1].size - self.x.size - 1,))

    @property
    def settings(self) -> TensorSpec:
        """How often, how many, what is allowed, and the weights."""
        given = self.program.inputs[-1].size - self.target.size
        return TensorSpec("settings", (ALLOWED + given + len(self.near),))

    @property
    def inputs(self) -> tuple[TensorSpec, ...]:
        """What the kernel takes: the target, the first start, the settings, and the places with the targets they lead to."""
        size, many = self.x.size, len(self.near)
        tables = TensorSpec("places", (PLACES, size)), TensorSpec("reached", (many, PLACES))
        return self.target, TensorSpec("start", (size,)), self.settings, *tables

    @property
    def outputs(self) -> tuple[TensorSpec, ...]:
        """What the kernel returns."""
        return self.x, self.said

    @cached_property
    def signature(self) -> str:
        """The gufunc signature."""
        return signature_of([p.shape for p in self.inputs], [p.shape for p in self.outputs])


# ── A program, and matrices among its results whose columns are worked on one by one: a loop where unrolled code is too long

# What all columns have in common, such as the factors they are solved with, the program makes once. Columns whose entries are
# zero in the same rows form a group, and a group has one program that takes a column to what takes its place.


@dataclass(frozen=True)
class ColumnGroup:
    """Columns that one program works on. Its inputs are the shared results and a column, its result is the new column."""

    program: Program
    places: tuple[tuple[int, int], ...]
    """The number of a result, a matrix, and of a column of it."""


@dataclass(frozen=True)
class ColumnSolve:
    """A program, and what becomes of the columns of its results."""

    program: Program
    shared: int
    """How many of the last results only the groups take."""
    groups: tuple[ColumnGroup, ...]

    @property
    def inputs(self) -> tuple[TensorSpec, ...]:
        """What the kernel takes: what the program does."""
        return self.program.inputs

    @property
    def outputs(self) -> tuple[TensorSpec, ...]:
        """What the kernel returns."""
        return self.program.outputs[: len(self.program.outputs) - self.shared]

    @cached_property
    def signature(self) -> str:
        """The gufunc signature."""
        return signature_of([p.shape for p in self.inputs], [p.shape for p in self.outputs])

    @cached_property
    def first_entries(self) -> tuple[int, ...]:
        """By result, the number of its first entry among those of all."""
        found = [0]
        for port in self.program.outputs:
            found.append(found[-1] + port.size)
        return tuple(found[:-1])

    def entry(self, matrix: int, row: int, column: int) -> int:
        """The number of an entry of a matrix among those of all results."""
        port = self.program.outputs[matrix]
        return self.first_entries[matrix] + row * port.shape[1] + column

    def stored_rows(self, group: ColumnGroup) -> list[int]:
        """The rows that are not zero before and after."""
        return [
            row
            for row, nothing in enumerate(group.program.zeros)
            if not (nothing and all(self.program.zeros[self.entry(m, row, c)] for m, c in group.places))
        ]

    def stored_entries(self, group: ColumnGroup) -> dict[int, list[int]]:
        """The rows that each instruction of the group's program makes, of those that are stored."""
        entries: dict[int, list[int]] = {}
        for row in self.stored_rows(group):
            entries.setdefault(group.program.results[row], []).append(row)
        return entries

    @cached_property
    def zeros(self) -> tuple[bool, ...]:
        """Of each entry of the program's results whether it is zero in the end, whatever the inputs."""
        zeros = list(self.program.zeros)
        for group in self.groups:
            rows = self.stored_rows(group)
            for matrix, column in group.places:
                for row in rows:
                    zeros[self.entry(matrix, row, column)] = False
        return tuple(zeros)


# ── A program whose results are factors, and matrices that are products of them: what a loop makes better than instructions

# Entry (r, c) of a matrix of relations between joints is a dot product of what belongs to r and what belongs to c; which one
# depends on which of the two carries the other. Unrolled, a chain of n joints has n² of them; as loops they are a few lines.

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
    def inputs(self) -> tuple[TensorSpec, ...]:
        """What the kernel takes: what the program does."""
        return self.program.inputs

    @property
    def outputs(self) -> tuple[TensorSpec, ...]:
        """What the kernel returns: the matrices."""
        n = len(self.relations)
        return tuple(TensorSpec(matrix.name, (n, n)) for matrix in self.matrices)

    @cached_property
    def signature(self) -> str:
        """The gufunc signature."""
        return signature_of([p.shape for p in self.inputs], [p.shape for p in self.outputs])


# ── The forms of what is compiled: a program, or one with a loop around it or behind it

Form = Program | Products | ColumnSolve | Scan | Search


def program_of(form: Form) -> Program:
    """The program without its loop."""
    return form if isinstance(form, Program) else form.program
