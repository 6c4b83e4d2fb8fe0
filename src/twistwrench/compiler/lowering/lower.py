"""Programs as LLVM assembly: a block of samples in SIMD lanes and the loop around it; long programs are partitioned.

There are no fast-math flags: only the program's own fused products are fused. So a sample's bits do not depend on the number
of lanes, its position in the batch, or its neighbours. Without hardware fma, products and sums are rounded separately.
Loops are imported on first use, so that the first kernel of an arm needs few modules.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from ..ir.loops import ColumnSolve, Form, Products, Scan, program_of
from ..ir.program import FUSED, Program
from .batch_loop import Loop, loop
from .ir_builder import LlvmWriter, RowLoader, RowStorer, typed_list
from .target_machine import LOOP, Machine, Precision
from .vector_math import exp, sincos, wrap, wrapper

MAX_INSTRUCTIONS = 2000
"""Maximum number of instructions in one function; longer programs are partitioned, which also makes them faster."""


def modules(given: Form, precision: Precision, machine: Machine) -> Iterator[str]:
    """Assembly texts to compile and link together."""
    program, around = program_of(given), _around(given, machine)
    divided = given if isinstance(given, ColumnSolve) else program
    if divided is not program or len(program.instructions) > MAX_INSTRUCTIONS:
        from .partition import partitioned

        yield from partitioned(divided, precision, machine, around)
    else:
        yield assembly(program, precision, machine, around)


def _around(given: Form, machine: Machine) -> Loop:
    """Return the writer of the loop around the blocks."""
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


# ── One block in one function

INSTRUCTIONS_PER_BLOCK = 500
"""Number of instructions per basic block of a large program."""

MAX_ANGLES_IN_LOCKSTEP = 6
"""Maximum number of angles whose sine and cosine are computed in lockstep."""

MAX_UNCUT_INSTRUCTIONS = 6000
"""Number of instructions above which programs are cut: LLVM's time grows faster than the length of a basic block."""

CUT_OUTPUTS = 125
"""Number of stored result entries per basic block of a wide program."""

MAX_UNCUT_OUTPUTS = 500
"""Number of result entries above which programs are also cut: LLVM's schedulers compare all pairs of stores in a block."""


def assembly(program: Program, precision: Precision, machine: Machine, around: Loop = loop) -> str:
    """Module with the block, the loop around it, and the functions they call."""
    lanes = machine.lanes(precision)
    w = LlvmWriter(precision, lanes, fused=machine.fused)
    e = _Whole(w, program)
    entries: dict[int, list[int]] = {}
    for k, result in enumerate(program.results):
        entries.setdefault(result, []).append(k)
    e.walk(0, len(program.instructions), entries, large=len(program.instructions) > MAX_UNCUT_INSTRUCTIONS)
    body = "\n".join(w.lines)
    ports = len(program.inputs) + len(program.outputs)
    arguments = typed_list("ptr noalias", [f"%a{k}" for k in range(ports)])
    return "\n".join(
        [
            declarations(w),
            wrapper(precision, lanes),
            f'define internal void @block({arguments}) noinline "stackrealign" {{\nentry:\n{body}\n  ret void\n}}\n',
            around(LOOP, program, precision, lanes, 0, 1),
        ]
    )


_INTRINSICS = (("fma", 3), ("sqrt", 1), ("fabs", 1), ("copysign", 2))


def declarations(w: LlvmWriter) -> str:
    """Declarations of functions that a module may call."""
    v, e, bits = w.vector, w.element, w.precision.bits
    lines = [f"declare {v} @llvm.{op}.{w.suffix}({', '.join([v] * n)})" for op, n in _INTRINSICS]
    lines += [f"declare {e} @llvm.fabs.f{bits}({e})", "declare double @sin(double)", "declare double @cos(double)"]
    return "\n".join([*lines, "declare double @atan2(double, double)", ""])


class Emitter:
    """State of one pass through instructions: the value of each, and the label of the current basic block."""

    def __init__(self, w: LlvmWriter, program: Program) -> None:
        self.w, self.program = w, program
        self.values: dict[int, str] = {}
        self.label = "entry"
        self.pairs: dict[int, tuple[str, str]] = {}
        self.waiting: dict[int, str] = {}
        self._inputs: list[tuple[RowLoader, int]] = []
        """Loader and column of each input element."""
        for k, port in enumerate(program.inputs):
            loader = RowLoader(w, f"%a{k}", port.size)
            self._inputs += [(loader, column) for column in range(port.size)]

    def input(self, number: int) -> str:
        """Vector of an input."""
        loader, column = self._inputs[number]
        return loader.column(column)

    def meet(self, number: int) -> None:
        """Load an input at its place in the program."""
        self.values[number] = self.input(int(self.program.instructions[number].value))

    def value(self, number: int) -> str:
        """Vector of an earlier instruction; constants are written at each use."""
        instruction = self.program.instructions[number]
        if instruction.op == "const":
            return self.w.splat(instruction.value)
        return self.values[number]

    def record(self, number: int, value: str) -> None:
        """Record the vector of an instruction."""
        self.values[number] = value

    def output(self, number: int, value: str) -> None:
        """Store an entry of the results."""
        raise NotImplementedError

    def walk(self, first: int, end: int, entries: Mapping[int, Sequence[int]], *, large: bool) -> None:
        """Emit some instructions, and store the result entries that they compute."""
        instructions = self.program.instructions
        self.check(_plain_angles(self.program, first, end))
        for number in range(first, end):
            op, args, value = instructions[number]
            if op == "const":
                for k in entries.get(number, ()):
                    self.output(k, self.w.splat(value))
                continue
            if large and number % INSTRUCTIONS_PER_BLOCK == INSTRUCTIONS_PER_BLOCK - 1:
                self.cut()
            if op in ("sin", "cos"):
                self.record(number, self.sincos(args[0])[op == "cos"])
            elif op == "input":
                self.meet(number)
            else:
                self.record(number, _operation(self.w, op, [self.value(a) for a in args]))
            for k in entries.get(number, ()):
                self.output(k, self.value(number))

    def cut(self) -> None:
        """End the basic block with a branch that is never taken, on a condition that LLVM cannot evaluate."""
        following = self.w.label("cut")
        never = self.w.new("icmp eq ptr %a0, null")
        self.w.do(f"br i1 {never}, label %out{following}, label %{following}")
        self.w.begin(f"out{following}")
        self.w.do("ret void")
        self.w.begin(following)
        self.label = following

    def check(self, angles: list[int]) -> None:
        """Load angles that are inputs, and reduce huge ones."""
        for number in angles:
            self.values[number] = self.input(int(self.program.instructions[number].value))
        if angles:
            vectors = [self.values[number] for number in angles]
            checked, self.label = wrap(self.w, vectors, self.label)
            self.waiting = dict(zip(angles, checked, strict=True))

    def sincos(self, angle: int) -> tuple[str, str]:
        """Sine and cosine of an angle, computed at the first use in lockstep with those of other pending angles."""
        if angle not in self.pairs:
            if angle in self.waiting:  # other pending angles are computed in lockstep
                others = [a for a in self.waiting if a != angle]
                group = [angle, *others][:MAX_ANGLES_IN_LOCKSTEP]
                reachable = [self.waiting.pop(a) for a in group]
            else:
                group = [angle]
                reachable, self.label = wrap(self.w, [self.value(angle)], self.label)
            self.pairs.update(zip(group, sincos(self.w, reachable), strict=True))
        return self.pairs[angle]


class _Whole(Emitter):
    """Emitter of a whole program, which stores the results in the output arrays."""

    def __init__(self, w: LlvmWriter, program: Program) -> None:
        super().__init__(w, program)
        self.wide, self.stored = len(program.results) > MAX_UNCUT_OUTPUTS, 0
        first = len(program.inputs)
        self._outputs: list[tuple[RowStorer, int]] = []
        """Storer and column of each result entry."""
        for k, port in enumerate(program.outputs, start=first):
            storer = RowStorer(w, f"%a{k}", port.size)
            self._outputs += [(storer, column) for column in range(port.size)]

    def output(self, number: int, value: str) -> None:
        """Store an entry of the results."""
        storer, column = self._outputs[number]
        storer.put(column, value)
        self.stored += 1
        if self.wide and self.stored % CUT_OUTPUTS == 0:
            self.cut()


def _plain_angles(program: Program, first: int, end: int) -> list[int]:
    """Inputs that are arguments of sines and cosines: their sizes are checked together at the start."""
    angles = set()
    for op, args, _ in program.instructions[first:end]:
        if op in ("sin", "cos") and program.instructions[args[0]].op == "input":
            angles.add(args[0])
    return sorted(angles)


_BINARY = {"add": "fadd", "sub": "fsub", "mul": "fmul", "div": "fdiv"}


def _operation(w: LlvmWriter, op: str, x: list[str]) -> str:
    if op in _BINARY:
        return w.binary(_BINARY[op], x[0], x[1])
    if op in FUSED:
        product_sign, addend_sign = FUSED[op]
        a, b, addend = x
        if product_sign < 0:
            a = w.negate(a)
        if addend_sign < 0:
            addend = w.negate(addend)
        return w.fma(a, b, addend)
    if op == "neg":
        return w.negate(x[0])
    if op == "sign":  # 0 stays 0 and NaN stays NaN; an equality comparison raises no flags
        neither = w.new(f"fcmp ueq {w.vector} {x[0]}, {w.splat(0.0)}")
        return w.select(neither, x[0], w.intrinsic("copysign", w.splat(1.0), x[0]))
    if op in ("min", "max"):
        comparison = {"min": "olt", "max": "ogt"}[op]
        return w.select(w.new(f"fcmp {comparison} {w.vector} {x[0]}, {x[1]}"), x[0], x[1])
    if op == "exp":
        return exp(w, x[0])
    return w.intrinsic(op, x[0])
