"""Programs as LLVM assembly: a block of samples, one in each SIMD lane, and the loop around it; long programs are cut.

There are no fast-math flags: only the program's own fused products are fused. So a sample's bits do not depend on the number
of lanes, its position in the batch, or its neighbours. Without hardware fma, products and sums are rounded separately.
Modules for other loops are imported on first use, because the first kernel of an arm does not need them.
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
"""Maximum number of instructions in one function; longer programs are cut into parts, which also makes them faster."""


def modules(form: Form, precision: Precision, machine: Machine) -> Iterator[str]:
    """Assembly texts of a form, to be compiled and linked together."""
    program = program_of(form)
    write_loop = _loop_writer(form, machine)
    if not isinstance(form, ColumnSolve) and len(program.instructions) <= MAX_INSTRUCTIONS:
        yield assembly(program, precision, machine, write_loop)
        return
    from .partition import partitioned

    form_in_loop = form if isinstance(form, ColumnSolve) else program  # ``write_loop`` writes the loop around it
    yield from partitioned(form_in_loop, precision, machine, write_loop)


def _loop_writer(form: Form, machine: Machine) -> Loop:
    """Return the writer of the loop around the blocks."""
    if isinstance(form, Program | ColumnSolve):
        return loop
    if isinstance(form, Scan):
        from .scan_loop import loop_over

        return loop_over(form)
    if isinstance(form, Products):
        from .product_loop import products_over

        return products_over(form, fused=machine.fused)
    from .search_loop import search_over

    return search_over(form)


# ── One block in one function

INSTRUCTIONS_PER_BLOCK = 500
"""Number of instructions per basic block of a program that is cut."""

MAX_ANGLES_IN_LOCKSTEP = 6
"""Maximum number of angles whose sine and cosine are computed in lockstep."""

MAX_UNCUT_INSTRUCTIONS = 6000
"""Number of instructions above which a function is cut into basic blocks: LLVM's time grows faster than a block's length."""

CUT_OUTPUTS = 125
"""Number of stored result entries per basic block of a wide program."""

MAX_UNCUT_OUTPUTS = 500
"""Number of result entries above which a function is cut, too: LLVM's schedulers compare all pairs of stores in a block."""


def assembly(program: Program, precision: Precision, machine: Machine, write_loop: Loop = loop) -> str:
    """Module with the block, the loop around it that ``write_loop`` writes, and the functions they call."""
    lanes = machine.lanes(precision)
    w = LlvmWriter(precision, lanes, fused=machine.fused)
    emitter = _WholeProgramEmitter(w, program)
    entries: dict[int, list[int]] = {}  # result entries by number of the instruction
    for k, result in enumerate(program.results):
        entries.setdefault(result, []).append(k)
    is_large = len(program.instructions) > MAX_UNCUT_INSTRUCTIONS
    emitter.walk(0, len(program.instructions), entries, large=is_large)
    body = "\n".join(w.lines)
    array_count = len(program.inputs) + len(program.outputs)
    arguments = typed_list("ptr noalias", [f"%a{k}" for k in range(array_count)])
    return "\n".join(
        [
            declarations(w),
            wrapper(precision, lanes),
            f'define internal void @block({arguments}) noinline "stackrealign" {{\nentry:\n{body}\n  ret void\n}}\n',
            write_loop(LOOP, program, precision, lanes, 0, 1),  # the block has no frame, and a call processes one block
        ]
    )


_INTRINSICS = {"fma": 3, "sqrt": 1, "fabs": 1, "copysign": 2}
"""Number of operands of each vector intrinsic of LLVM."""


def declarations(w: LlvmWriter) -> str:
    """Declarations of functions that a module may call."""
    lines = []
    for op, operand_count in _INTRINSICS.items():
        operands = ", ".join([w.vector] * operand_count)
        lines.append(f"declare {w.vector} @llvm.{op}.{w.suffix}({operands})")
    lines += [
        f"declare {w.element} @llvm.fabs.f{w.precision.bits}({w.element})",
        "declare double @sin(double)",
        "declare double @cos(double)",
        "declare double @atan2(double, double)",
    ]
    return "\n".join([*lines, ""])


class Emitter:
    """State of one pass through instructions: the value of each, and the label of the current basic block."""

    def __init__(self, w: LlvmWriter, program: Program) -> None:
        self.w = w
        self.program = program
        self.values: dict[int, str] = {}
        """Name of each instruction's vector, by number of the instruction."""
        self.label = "entry"
        """Label of the current basic block."""
        self.pairs: dict[int, tuple[str, str]] = {}
        """Sine and cosine of each angle, by number of the angle's instruction."""
        self.waiting: dict[int, str] = {}
        """Angles whose sine and cosine are not computed yet, reduced to the range of the polynomials."""
        self._inputs: list[tuple[RowLoader, int]] = []
        """Loader and column of each input element."""
        for k, port in enumerate(program.inputs):
            loader = RowLoader(w, f"%a{k}", port.size)
            self._inputs += [(loader, column) for column in range(port.size)]

    def input(self, number: int) -> str:
        """Vector of an input element."""
        loader, column = self._inputs[number]
        return loader.column(column)

    def meet(self, number: int) -> None:
        """Load the input that instruction ``number`` reads, where the program first mentions it."""
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
        """Emit the instructions from ``first`` to before ``end``, and store the result entries that they compute.

        ``entries`` are the result entries that each instruction computes, by number of the instruction. ``large`` cuts the
        program into basic blocks.
        """
        instructions = self.program.instructions
        self.reduce_input_angles(_input_angles(self.program, first, end))
        for number in range(first, end):
            op, operand_numbers, value = instructions[number]
            if op == "const":
                for k in entries.get(number, ()):
                    self.output(k, self.w.splat(value))
                continue
            is_last_of_block = (number + 1) % INSTRUCTIONS_PER_BLOCK == 0
            if large and is_last_of_block:
                self.cut()
            if op in ("sin", "cos"):
                sine, cosine = self.sincos(operand_numbers[0])
                self.record(number, sine if op == "sin" else cosine)
            elif op == "input":
                self.meet(number)
            else:
                operands = [self.value(operand) for operand in operand_numbers]
                self.record(number, _emit_operation(self.w, op, operands))
            for k in entries.get(number, ()):
                self.output(k, self.value(number))

    def cut(self) -> None:
        """End the basic block with a branch that is never taken; LLVM cannot exclude that the pointer is null."""
        next_block = self.w.label("cut")
        is_null = self.w.new("icmp eq ptr %a0, null")
        self.w.do(f"br i1 {is_null}, label %out{next_block}, label %{next_block}")
        self.w.begin(f"out{next_block}")
        self.w.do("ret void")
        self.w.begin(next_block)
        self.label = next_block

    def reduce_input_angles(self, angles: list[int]) -> None:
        """Load the inputs ``angles``, by number, and reduce them to the range of the polynomials for sine and cosine."""
        for number in angles:
            self.values[number] = self.input(int(self.program.instructions[number].value))
        if angles:
            vectors = [self.values[number] for number in angles]
            reduced, self.label = wrap(self.w, vectors, self.label)
            self.waiting = dict(zip(angles, reduced, strict=True))

    def sincos(self, angle: int) -> tuple[str, str]:
        """Sine and cosine of an angle, by number; the first use also computes those of other waiting angles, in lockstep."""
        if angle not in self.pairs:
            if angle in self.waiting:
                other_angles = [other for other in self.waiting if other != angle]
                group = [angle, *other_angles][:MAX_ANGLES_IN_LOCKSTEP]
                reduced = [self.waiting.pop(number) for number in group]
            else:
                group = [angle]
                reduced, self.label = wrap(self.w, [self.value(angle)], self.label)
            self.pairs.update(zip(group, sincos(self.w, reduced), strict=True))
        return self.pairs[angle]


class _WholeProgramEmitter(Emitter):
    """Emitter of a whole program, which stores the results in the output arrays."""

    def __init__(self, w: LlvmWriter, program: Program) -> None:
        super().__init__(w, program)
        self.wide = len(program.results) > MAX_UNCUT_OUTPUTS
        """True if the stores of results cut basic blocks."""
        self.stored = 0
        """Number of result entries that are stored."""
        self._outputs: list[tuple[RowStorer, int]] = []
        """Storer and column of each result entry."""
        for k, port in enumerate(program.outputs, start=len(program.inputs)):
            storer = RowStorer(w, f"%a{k}", port.size)
            self._outputs += [(storer, column) for column in range(port.size)]

    def output(self, number: int, value: str) -> None:
        """Store an entry of the results."""
        storer, column = self._outputs[number]
        storer.put(column, value)
        self.stored += 1
        if self.wide and self.stored % CUT_OUTPUTS == 0:
            self.cut()


def _input_angles(program: Program, first: int, end: int) -> list[int]:
    """Numbers of the inputs whose sine or cosine is computed; their ranges are checked together at the start."""
    angles = set()
    for op, operands, _ in program.instructions[first:end]:
        if op in ("sin", "cos") and program.instructions[operands[0]].op == "input":
            angles.add(operands[0])
    return sorted(angles)


_LLVM_OPERATIONS = {"add": "fadd", "sub": "fsub", "mul": "fmul", "div": "fdiv"}
"""LLVM's names of operations with two operands."""


def _emit_operation(w: LlvmWriter, op: str, operands: list[str]) -> str:
    """Vector of an operation on these vectors; sines and cosines are emitted elsewhere."""
    first_operand = operands[0]
    if op in _LLVM_OPERATIONS:
        return w.binary(_LLVM_OPERATIONS[op], first_operand, operands[1])
    if op in FUSED:
        product_sign, addend_sign = FUSED[op]
        a, b, addend = operands
        if product_sign < 0:
            a = w.negate(a)
        if addend_sign < 0:
            addend = w.negate(addend)
        return w.fma(a, b, addend)
    if op == "neg":
        return w.negate(first_operand)
    if op == "sign":  # 0 stays 0 and NaN stays NaN; unlike <, a comparison for equality with NaN sets no error flag
        is_zero_or_nan = w.new(f"fcmp ueq {w.vector} {first_operand}, {w.splat(0.0)}")
        return w.select(is_zero_or_nan, first_operand, w.intrinsic("copysign", w.splat(1.0), first_operand))
    if op in ("min", "max"):
        comparison = "olt" if op == "min" else "ogt"
        takes_first = w.new(f"fcmp {comparison} {w.vector} {first_operand}, {operands[1]}")
        return w.select(takes_first, first_operand, operands[1])
    if op == "exp":
        return exp(w, first_operand)
    return w.intrinsic(op, first_operand)
