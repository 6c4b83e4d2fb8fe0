"""Loops around programs: scans over steps, searches, column solves and products of factors.

A scan evaluates a program for a number of steps; its results are the inputs of the next step. The loop is part of the kernel.
The kernel's signature has two additional sizes, k and m: it evaluates k steps, and stores every k/m-th state in one of m rows.
The initial states are given once; all other inputs may differ from step to step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from .program import Program, TensorSpec, gufunc_signature, signature_of

STEPS, STORED_ROWS = "k", "m"
"""Names of two sizes in the signature: number of steps, and number of stored rows."""


@dataclass(frozen=True)
class Source:
    """Source of an input of the program.

    ``"state"``: last value of result number ``state``. ``"start"``: value of that result at the beginning of the step, for
    programs with several evaluations per step. ``"stage"``: row of the table for this stage. ``"given"``: the caller's array.
    """

    kind: str
    state: int = 0  # number of a result; 0 for kinds without one


@dataclass(frozen=True)
class Scan:
    """Program that is evaluated once for each stage of each step, with the sources of its inputs.

    The first ``visible`` results are states that the kernel returns. ``hidden`` states follow; they start at zero and are not
    returned. All other results, such as the applied torques, are reported once for each step, at its beginning.
    """

    program: Program
    sources: tuple[Source, ...]
    """Source of each input."""
    visible: int  # number of states
    hidden: int = 0  # number of states
    table: tuple[tuple[float, ...], ...] = ((),)
    """Rows by stage; the program is evaluated once per row."""

    @property
    def states(self) -> tuple[TensorSpec, ...]:
        """Results that are fed back: visible states, then hidden ones."""
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
        """Inputs of the kernel for one step: visible states, then arrays that the caller gives for each step."""
        given_inputs = [self.program.inputs[k] for k in self.given]
        return (*self.program.outputs[: self.visible], *given_inputs)

    @property
    def outputs(self) -> tuple[TensorSpec, ...]:
        """One row of the kernel's results: visible states, then reports of steps."""
        return self.program.outputs[: self.visible] + self.program.outputs[self.visible + self.hidden :]

    @cached_property
    def signature(self) -> str:
        """Gufunc signature, as in ``(7),(7),(k,7)->(m,7),(m,7)``."""
        inputs: list[Sequence[int | str]] = []
        for k, port in enumerate(self.inputs):
            is_given_each_step = k >= self.visible
            inputs.append((STEPS, *port.shape) if is_given_each_step else port.shape)
        return gufunc_signature(inputs, [(STORED_ROWS, *port.shape) for port in self.outputs])


# A search evaluates a program repeatedly until the program reports success. An attempt begins at a start configuration. It ends
# when the program stops it, or after the number of steps in the settings. The next attempt begins at the nearest unused start.
# The first successful attempt gives the result; without success, the attempt with the smallest error does. The result depends
# neither on other samples nor on the number of parallel attempts.

PLACES = 64
"""Number of start configurations in the table; the caller gives the start of the first attempt separately."""

TIMES, ATTEMPTS, TOLERANCES = 0, 1, 2
"""Positions in the settings: maximum number of steps of an attempt, maximum number of attempts after the first, and the first
tolerance for the program."""


@dataclass(frozen=True)
class Search:
    """Program with four inputs: x, x at the beginning of the step, memory, and the target with tolerances.

    Its results are the next x and the next memory. The memory contains the best x so far, a report on it, the number of steps
    without progress, and a flag to continue. The report begins with a status (1: found, -1: invalid target) and the error.
    """

    program: Program
    target: TensorSpec
    """Target of the search."""
    near: tuple[int, ...]
    """Entries of the target that determine the distance of a start configuration, a weighted sum of squares."""
    begins: tuple[float, ...]
    """Initial values of the memory, after the best x."""
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
        """Maximum numbers of steps and attempts, tolerances, and weights of the entries ``near``."""
        # In the last input, tolerances follow the target.
        tolerance_count = self.program.inputs[-1].size - self.target.size
        return TensorSpec("settings", (TOLERANCES + tolerance_count + len(self.near),))

    @property
    def inputs(self) -> tuple[TensorSpec, ...]:
        """Inputs of the kernel: target, first start, settings, table of starts, and the entries ``near`` of their targets."""
        start = TensorSpec("start", (self.x.size,))
        starts = TensorSpec("places", (PLACES, self.x.size))
        reached = TensorSpec("reached", (len(self.near), PLACES))
        return self.target, start, self.settings, starts, reached

    @property
    def outputs(self) -> tuple[TensorSpec, ...]:
        """Results of the kernel."""
        return self.x, self.status

    @cached_property
    def signature(self) -> str:
        """Gufunc signature."""
        return signature_of(self.inputs, self.outputs)


# A column solve is a program whose results are matrices, the right-hand sides of linear equations. A loop, which is shorter
# than unrolled code, solves the equations column by column. The program computes values that all columns need once, such as
# the factors of the matrix. Columns with zeros in the same rows form a group, and each group has one program that maps a
# column to its solution.


@dataclass(frozen=True)
class ColumnGroup:
    """Columns solved by one program, whose inputs are the shared results and a column. Its result is the solution."""

    program: Program
    places: tuple[tuple[int, int], ...]
    """For each column of the group, number of the result that is its matrix, and number of the column in the matrix."""


@dataclass(frozen=True)
class ColumnSolve:
    """Program whose results are matrices, and groups of their columns with programs for the solutions."""

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
        """Rows that may be nonzero before or after the solve, in any column of a group."""
        rows = []
        for row, is_zero_after in enumerate(group.program.zeros):
            entries_before = [self.entry(matrix, row, column) for matrix, column in group.places]
            is_zero_before = all(self.program.zeros[entry] for entry in entries_before)
            if not (is_zero_before and is_zero_after):
                rows.append(row)
        return rows

    def stored_entries(self, group: ColumnGroup) -> dict[int, list[int]]:
        """Stored rows, by the number of the instruction that computes them in the group's program."""
        rows_by_instruction: dict[int, list[int]] = {}
        for row in self.stored_rows(group):
            rows_by_instruction.setdefault(group.program.results[row], []).append(row)
        return rows_by_instruction

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


# Products are a program whose results are factors of matrices; loops multiply the factors. Rows and columns of a matrix belong
# to joints. Entry (r, c) is the dot product of row r of one factor and column c of the other. There are two pairs of factors:
# one for entries whose row's joint carries the column's joint, and one for the reverse. A chain of n joints has n² dot
# products; loops need only a few lines.

NEITHER, BEFORE, AFTER = 0, 1, 2
"""Kinds of an entry. NEITHER: zero. BEFORE: the row's joint carries the column's. AFTER: the reverse, or they are equal."""


@dataclass(frozen=True)
class Product:
    """Matrix (n, n) with two pairs of factors: rows (n, k) and columns (k, n). Each factor is the number of a result."""

    name: str
    before: tuple[int, int]
    """Pair of factors of entries of kind BEFORE."""
    after: tuple[int, int]
    """Pair of factors of entries of kind AFTER."""
    added: tuple[tuple[int, int, float], ...] = ()
    """Row, column and value of each constant that is added."""


@dataclass(frozen=True)
class Products:
    """Program of factors, and the matrices computed from them."""

    program: Program
    matrices: tuple[Product, ...]
    relations: tuple[tuple[int, ...], ...]
    """Kind of each entry, NEITHER, BEFORE or AFTER, row by row."""

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
    """Program of a form, without its loop."""
    if isinstance(form, Program):
        return form
    return form.program
