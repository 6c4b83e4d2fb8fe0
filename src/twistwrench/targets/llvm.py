"""A program as LLVM assembly: a block of samples side by side in SIMD lanes, and the loop NumPy calls.

No fast-math flags: what the program fuses is fused, nothing else is, so a sample's bits do not depend on the number of
lanes, on its place in the batch, or on its neighbours.
"""

from __future__ import annotations

from ..program.program import FUSED, Program
from .exp import exp
from .loop import loop
from .machine import Machine, Precision
from .rows import RowLoader, RowStorer
from .sincos import sincos, wrap, wrapper
from .writer import Writer

__all__ = ["LOOP", "assembly"]

LOOP = "loop"
"""Name of the function that has the shape of a ufunc's inner loop."""

CUT = 500
"""Instructions in a basic block of a large program."""

SIDE_BY_SIDE = 6
"""Angles whose sine and cosine are computed in lockstep."""

LARGE = 6000
"""Programs beyond this many instructions are cut: LLVM's time grows faster than the length of a block."""

CUT_OUTPUTS = 125
"""Entries of results handed over in a basic block of a wide program."""

WIDE = 500
"""Programs with more entries of results are cut by these, too: LLVM's schedulers compare every two stores of a block."""


def assembly(program: Program, precision: Precision, machine: Machine) -> str:
    """The module: the block, the loop, and what they call."""
    lanes = machine.lanes(precision)
    w = Writer(precision, lanes)
    _block(w, program)
    body = "\n".join(w.lines)
    ports = len(program.inputs) + len(program.outputs)
    arguments = ", ".join(f"ptr noalias %a{k}" for k in range(ports))
    return "\n".join(
        [
            _declarations(w),
            wrapper(precision, lanes),
            f'define internal void @block({arguments}) noinline "stackrealign" {{\nentry:\n{body}\n  ret void\n}}\n',
            loop(LOOP, program, precision, lanes),
        ]
    )


_INTRINSICS = (("fma", 3), ("sqrt", 1), ("fabs", 1), ("copysign", 2))


def _declarations(w: Writer) -> str:
    v, e, bits = w.vector, w.element, w.precision.bits
    lines = [f"declare {v} @llvm.{op}.{w.suffix}({', '.join([v] * n)})" for op, n in _INTRINSICS]
    lines += [f"declare {e} @llvm.fabs.f{bits}({e})", "declare double @sin(double)", "declare double @cos(double)"]
    return "\n".join([*lines, "declare double @atan2(double, double)", ""])


class _Emitter:
    """State of one walk through a program: where each value is, and the label of the current basic block."""

    def __init__(self, w: Writer, program: Program) -> None:
        self.w, self.program = w, program
        self.values: dict[int, str] = {}
        self.label = "entry"
        self.pairs: dict[int, tuple[str, str]] = {}
        self.waiting: dict[int, str] = {}
        self.wide, self.stored = len(program.results) > WIDE, 0
        self.loaders, self.storers = [], []
        for k, port in enumerate([*program.inputs, *program.outputs]):
            if k < len(program.inputs):
                self.loaders.append(RowLoader(w, f"%a{k}", port.size))
            else:
                self.storers.append(RowStorer(w, f"%a{k}", port.size))
        self._inputs = [
            (loader, c) for loader, port in zip(self.loaders, program.inputs, strict=True) for c in range(port.size)
        ]
        self._outputs = [
            (s, c) for s, port in zip(self.storers, program.outputs, strict=True) for c in range(port.size)
        ]

    def input(self, number: int) -> str:
        loader, column = self._inputs[number]
        return loader.column(column)

    def value(self, number: int) -> str:
        """The vector of an earlier instruction; constants are named anew at each use."""
        instruction = self.program.instructions[number]
        return self.w.splat(instruction.value) if instruction.op == "const" else self.values[number]

    def output(self, number: int, value: str) -> None:
        storer, column = self._outputs[number]
        storer.put(column, value)
        self.stored += 1
        if self.wide and self.stored % CUT_OUTPUTS == 0:
            self.cut()

    def cut(self) -> None:
        """End the basic block with a branch that is never taken, for a reason LLVM cannot know."""
        following = self.w.label("cut")
        never = self.w.new("icmp eq ptr %a0, null")
        self.w.do(f"br i1 {never}, label %out{following}, label %{following}")
        self.w.begin(f"out{following}")
        self.w.do("ret void")
        self.w.begin(following)
        self.label = following

    def check(self, angles: list[int]) -> None:
        """Load angles that are plain inputs, and bring huge ones into reach."""
        for number in angles:
            self.values[number] = self.input(int(self.program.instructions[number].value))
        if angles:
            checked, self.label = wrap(self.w, [self.values[number] for number in angles], self.label)
            self.waiting = dict(zip(angles, checked, strict=True))

    def sincos(self, angle: int) -> tuple[str, str]:
        if angle not in self.pairs:
            if angle in self.waiting:  # some others come along in lockstep
                group = [angle, *(a for a in self.waiting if a != angle)][:SIDE_BY_SIDE]
                reachable = [self.waiting.pop(a) for a in group]
            else:
                group = [angle]
                reachable, self.label = wrap(self.w, [self.values[angle]], self.label)
            self.pairs.update(zip(group, sincos(self.w, reachable), strict=True))
        return self.pairs[angle]


def _block(w: Writer, program: Program) -> None:
    e = _Emitter(w, program)
    wanted: dict[int, list[int]] = {}
    for k, result in enumerate(program.results):
        wanted.setdefault(result, []).append(k)
    e.check(_plain_angles(program))
    large = len(program.instructions) > LARGE
    for number, (op, args, value) in enumerate(program.instructions):
        if op == "const":
            for k in wanted.get(number, ()):
                e.output(k, w.splat(value))
            continue
        if large and number % CUT == CUT - 1:
            e.cut()
        if op in ("sin", "cos"):
            e.values[number] = e.sincos(args[0])[op == "cos"]
        elif op == "input":
            e.values[number] = e.input(int(value))
        else:
            e.values[number] = _operation(w, op, [e.value(a) for a in args])
        for k in wanted.get(number, ()):
            e.output(k, e.value(number))


def _plain_angles(program: Program) -> list[int]:
    """Inputs whose sine or cosine is taken: their sizes are checked together, once a block."""
    taken = {i.args[0] for i in program.instructions if i.op in ("sin", "cos")}
    return sorted(k for k in taken if program.instructions[k].op == "input")


_BINARY = {"add": "fadd", "sub": "fsub", "mul": "fmul", "div": "fdiv"}


def _operation(w: Writer, op: str, x: list[str]) -> str:
    if op in _BINARY:
        return w.binary(_BINARY[op], x[0], x[1])
    if op in FUSED:
        product, addend = FUSED[op]
        return w.fma(w.negate(x[0]) if product < 0 else x[0], x[1], w.negate(x[2]) if addend < 0 else x[2])
    if op == "neg":
        return w.negate(x[0])
    if op == "sign":  # 0 stays 0 and NaN stays NaN; a comparison for equality raises no flags
        neither = w.new(f"fcmp ueq {w.vector} {x[0]}, {w.splat(0.0)}")
        return w.select(neither, x[0], w.intrinsic("copysign", w.splat(1.0), x[0]))
    if op == "exp":
        return exp(w, x[0])
    return w.intrinsic(op, x[0])
