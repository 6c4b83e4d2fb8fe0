"""Loops around programs: scans over steps, searches, column solves and products of factors.

A scan evaluates a program for a number of steps; its results are the inputs of the next step. The loop is part of the kernel.
Its signature has two additional sizes: ``(k)`` steps are evaluated, and every k/m-th state is stored, in ``(m)`` rows. The
initial states are given once; all other inputs may differ from step to step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from .program import Program, TensorSpec, gufunc_signature, signature_of

STEPS, KEPT = "k", "m"
"""Names of the two sizes in the signature."""


@dataclass(frozen=True)
class Source:
    """Source of an input of the program.

    ``"state"``: last value of result number ``state``. ``"start"``: its value at the beginning of the step, for programs with
    several evaluations per step. ``"stage"``: row of the table for this stage. ``"given"``: the caller's array.
    """

    kind: str
    state: int = 0


@dataclass(frozen=True)
class Scan:
    """Program that is evaluated once for each stage of each step, with the sources of its inputs.

    The first ``visible`` results are the state. ``hidden`` results follow; they start at zero and are not returned. The other
    results are reported for each step at its beginning, such as the torques applied.
    """

    program: Program
    sources: tuple[Source, ...]
    visible: int
    hidden: int = 0
    table: tuple[tuple[float, ...], ...] = ((),)
    """Rows by stage; the program is evaluated once per row."""

    @property
    def states(self) -> tuple[TensorSpec, ...]:
        """Results that are fed back, hidden ones last."""
        return self.program.outputs[: self.visible + self.hidden]

    @property
    def given(self) -> tuple[int, ...]:
        """Numbers of the inputs that the caller gives for each step."""
        return tuple(k for k, source in enumerate(self.sources) if source.kind == "given")

    @property
    def reported(self) -> tuple[int, ...]:
        """Numbers of the results that are reported at the beginning of each step: all after the states."""
        return tuple(range(self.visible + self.hidden, len(self.program.outputs)))

    @property
    def inputs(self) -> tuple[TensorSpec, ...]:
        """Inputs of the kernel for one step: states, then those given for each step."""
        given = [self.program.inputs[k] for k in self.given]
        return (*self.program.outputs[: self.visible], *given)

    @property
    def outputs(self) -> tuple[TensorSpec, ...]:
        """One row of the kernel's results: states, then reports of steps."""
        return self.program.outputs[: self.visible] + self.program.outputs[self.visible + self.hidden :]

    @cached_property
    def signature(self) -> str:
        """Gufunc signature, as in ``(7),(7),(k,7)->(m,7),(m,7)``."""
        inputs: list[Sequence[int | str]] = []
        for k, port in enumerate(self.inputs):
            is_given_each_step = k >= self.visible
            inputs.append((STEPS, *port.shape) if is_given_each_step else port.shape)
        return gufunc_signature(inputs, [(KEPT, *port.shape) for port in self.outputs])


# A search is a program evaluated until it reports success, for one start configuration after another. An attempt begins at a
# start configuration. It ends when the program stops it, or after the number of steps in the settings; the next one begins at
# the nearest unused start. The result is that of the first successful attempt, else the nearest. It depends neither on other
# samples nor on the number of parallel attempts.

PLACES = 64
"""Number of start configurations in a table, besides the first."""

TIMES, ATTEMPTS, TOLERANCES = 0, 1, 2
"""Positions in the settings: maximum steps per attempt, further attempts, and the first tolerance passed to the program."""


@dataclass(frozen=True)
class Search:
    """Program with the inputs x, x of the step's beginning, memory, and the target with tolerances.

    Its results are the next x and the memory: the best x so far; its report, which begins with a status (1: found, -1: invalid
    target) and the error; the number of steps without progress; and a flag to continue.
    """

    program: Program
    target: TensorSpec
    """Target of the search."""
    near: tuple[int, ...]
    """Entries of the target for the distance of a start configuration, a weighted sum of squares."""
    begins: tuple[float, ...]
    """Initial memory after x."""
    least: tuple[float, ...]
    """Lower limits of x at the start of an attempt."""
    most: tuple[float, ...]
    """Upper limits of x at the start of an attempt."""

    @property
    def x(self) -> TensorSpec:
        """The variable of the search."""
        return self.program.outputs[0]

    @property
    def status(self) -> TensorSpec:
        """Number of attempts, and the program's report on the best x."""
        return TensorSpec("status", (self.program.outputs[1].size - self.x.size - 1,))

    @property
    def settings(self) -> TensorSpec:
        """Maximum steps, attempts, tolerances and weights."""
        numbers = self.program.inputs[-1].size - self.target.size  # tolerances follow the target in the last input
        return TensorSpec("settings", (TOLERANCES + numbers + len(self.near),))

    @property
    def inputs(self) -> tuple[TensorSpec, ...]:
        """Inputs of the kernel: target, first start, settings, and the table of start configurations with their targets."""
        size, entries = self.x.size, len(self.near)
        tables = TensorSpec("places", (PLACES, size)), TensorSpec("reached", (entries, PLACES))
        return self.target, TensorSpec("start", (size,)), self.settings, *tables

    @property
    def outputs(self) -> tuple[TensorSpec, ...]:
        """Results of the kernel."""
        return self.x, self.status

    @cached_property
    def signature(self) -> str:
        """Gufunc signature."""
        return signature_of(self.inputs, self.outputs)


# A column solve is a program with result matrices whose columns are solved in a loop, which is shorter than unrolled code. The
# program computes values common to all columns once, such as the factors of the solve. Columns with zeros in the same rows
# form a group, and each group has one program that maps a column to its solution.


@dataclass(frozen=True)
class ColumnGroup:
    """Columns solved by one program: its inputs are the shared results and a column, its result is the solution."""

    program: Program
    places: tuple[tuple[int, int], ...]
    """Number of the result that is the matrix, and column."""


@dataclass(frozen=True)
class ColumnSolve:
    """Program with solves of columns of its results."""

    program: Program
    shared: int
    """Number of results at the end that only the groups use."""
    groups: tuple[ColumnGroup, ...]

    @property
    def inputs(self) -> tuple[TensorSpec, ...]:
        """Inputs of the kernel: those of the program."""
        return self.program.inputs

    @property
    def outputs(self) -> tuple[TensorSpec, ...]:
        """Results of the kernel."""
        return self.program.outputs[: len(self.program.outputs) - self.shared]

    @cached_property
    def signature(self) -> str:
        """Gufunc signature."""
        return signature_of(self.inputs, self.outputs)

    @cached_property
    def first_entries(self) -> tuple[int, ...]:
        """Position of each result's first entry among the entries of all results."""
        positions = [0]
        for port in self.program.outputs:
            positions.append(positions[-1] + port.size)
        return tuple(positions[:-1])

    def entry(self, matrix: int, row: int, column: int) -> int:
        """Position of a matrix entry among the entries of all results."""
        port = self.program.outputs[matrix]
        return self.first_entries[matrix] + row * port.shape[1] + column

    def stored_rows(self, group: ColumnGroup) -> list[int]:
        """Rows that are nonzero before or after the solve."""
        rows = []
        for row, is_zero_after in enumerate(group.program.zeros):
            zero_before = [self.program.zeros[self.entry(matrix, row, column)] for matrix, column in group.places]
            if not (is_zero_after and all(zero_before)):
                rows.append(row)
        return rows

    def stored_entries(self, group: ColumnGroup) -> dict[int, list[int]]:
        """Stored rows by the instruction of the group's program that computes them."""
        entries: dict[int, list[int]] = {}
        for row in self.stored_rows(group):
            entries.setdefault(group.program.results[row], []).append(row)
        return entries

    @cached_property
    def zeros(self) -> tuple[bool, ...]:
        """For each entry of the program's results, True if it is zero after the solves for all inputs."""
        zeros = list(self.program.zeros)
        for group in self.groups:
            rows = self.stored_rows(group)
            for matrix, column in group.places:
                for row in rows:
                    zeros[self.entry(matrix, row, column)] = False
        return tuple(zeros)


# Products are a program whose results are factors of matrices; loops multiply the factors. Entry (r, c) of such a matrix is a
# dot product of row r of one factor and column c of the other. Which pair of factors applies depends on which of the two joints
# carries the other. A chain of n joints has n² dot products; loops need only a few lines.

NEITHER, BEFORE, AFTER = 0, 1, 2
"""Kinds of an entry: zero; its row's joint carries its column's; or the reverse, including equal joints."""


@dataclass(frozen=True)
class Product:
    """Matrix (n, n) with two pairs of factors, as numbers of results: rows (n, k) and columns (k, n)."""

    name: str
    before: tuple[int, int]
    after: tuple[int, int]
    added: tuple[tuple[int, int, float], ...] = ()
    """Row, column and value of constants to add."""


@dataclass(frozen=True)
class Products:
    """Program of factors, and the matrices computed from them."""

    program: Program
    matrices: tuple[Product, ...]
    relations: tuple[tuple[int, ...], ...]
    """Kind of each entry, row by row."""

    @property
    def inputs(self) -> tuple[TensorSpec, ...]:
        """Inputs of the kernel: those of the program."""
        return self.program.inputs

    @property
    def outputs(self) -> tuple[TensorSpec, ...]:
        """Results of the kernel: the matrices."""
        n = len(self.relations)
        return tuple(TensorSpec(matrix.name, (n, n)) for matrix in self.matrices)

    @cached_property
    def signature(self) -> str:
        """Gufunc signature."""
        return signature_of(self.inputs, self.outputs)


Form = Program | Products | ColumnSolve | Scan | Search
"""Forms of compiled code: a program, or a program with a loop around or after it."""


def program_of(form: Form) -> Program:
    """Program without its loop."""
    if isinstance(form, Program):
        return form
    return form.program
