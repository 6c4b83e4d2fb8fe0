"""Programs as C99 functions: one operation per line, without loops, branches and heap memory, with math.h only.

Fused products are calls of ``fma``, and nothing else is fused. So results have the bits of the compiled kernels if the C
library's sine, cosine and exponential have the same bits. All inputs are read before any output is written. CUDA uses the same
statements.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ...core.errors import KernelError
from ..ir.program import FUSED, Program

PRECISIONS = {"double": "", "float": "f"}
"""Types, with the suffixes of their functions and literals."""

FUSED_MACROS = """\
/* A product and a sum, rounded once as the kernels do; twice with -DTWISTWRENCH_NO_FMA, for processors without fma. */
#ifdef TWISTWRENCH_NO_FMA
#define FMA(a, b, c) ((a) * (b) + (c))
#define FMS(a, b, c) ((a) * (b) - (c))
#define FNMA(a, b, c) ((c) - (a) * (b))
#define FNMS(a, b, c) (-((a) * (b)) - (c))
#else
#define FMA(a, b, c) {fma}((a), (b), (c))
#define FMS(a, b, c) {fma}((a), (b), -(c))
#define FNMA(a, b, c) {fma}(-(a), (b), (c))
#define FNMS(a, b, c) {fma}(-(a), (b), -(c))
#endif
"""

_INFIX = {"add": "+", "sub": "-", "mul": "*", "div": "/"}
_WIDTH = 116


def identifier(text: str) -> str:
    """Letters, digits and single underscores of a name; empty if there are none. C++ reserves double underscores.

    >>> identifier("panda hand/tcp__2")
    'panda_hand_tcp_2'
    """
    return re.sub(r"[^A-Za-z0-9]+", "_", text).strip("_")


def literal(value: float, precision: str) -> str:
    """Literal that the compiler reads as the same bits. Raises KernelError for a number beyond the precision.

    >>> literal(0.1, "double"), literal(0.1, "float")
    ('0.1', '0.1f')
    """
    with np.errstate(over="ignore"):
        number = np.float32(value) if precision == "float" else np.float64(value)
    if not np.isfinite(number):
        advice = "Look for a division by zero in it"
        if np.isfinite(value):
            advice = "It needs precision='double'"
        raise KernelError(f"the constant {value!r} is not a finite {precision}. {advice}.")
    return f"{number!s}{PRECISIONS[precision]}"


@dataclass(frozen=True)
class CFunction:
    """Program with the name and precision of its function."""

    name: str
    program: Program
    precision: str = "double"

    @property
    def parameters(self) -> tuple[str, ...]:
        """Unique names of the arrays, inputs first."""
        names: list[str] = []
        for ports, ending in ((self.program.inputs, "_2"), (self.program.outputs, "_out")):
            for port in ports:
                name = identifier(port.name.replace("wrench at", "wrench"))
                while name in names:
                    name += ending
                names.append(name)
        return tuple(names)

    @property
    def prototype(self) -> str:
        """Declaration, without a semicolon."""
        inputs, outputs = self.program.inputs, self.program.outputs
        types = [f"const {self.precision}"] * len(inputs) + [self.precision] * len(outputs)
        named = zip(types, self.parameters, (*inputs, *outputs), strict=True)
        parameters = [f"{kind} {name}[{port.size}]" for kind, name, port in named]
        line = f"void {self.name}({', '.join(parameters)})"
        if len(line) <= _WIDTH:
            return line
        return f"void {self.name}(\n    " + ",\n    ".join(parameters) + ")"

    @property
    def definition(self) -> str:
        """Complete function definition."""
        outputs = self.parameters[len(self.program.inputs) :]
        entries: list[str] = []
        for name, port in zip(outputs, self.program.outputs, strict=True):
            entries += [f"{name}[{k}]" for k in range(port.size)]
        stores = zip(entries, self.program.results, strict=True)
        return "\n".join([self.prototype, "{", *statements(self.program, self.precision, self.parameters, stores), "}"])

    @property
    def fuses(self) -> bool:
        """True if the function needs :data:`FUSED_MACROS`."""
        return any(i.op in FUSED for i in self.program.instructions)


def statements(
    program: Program, precision: str, names: Sequence[str], stores: Iterable[tuple[str, int]], sincos: str = ""
) -> list[str]:
    """Lines of a function's body.

    ``names`` are those of the function's arrays, beginning with the program's inputs. ``stores`` pairs each output element
    with the number of its instruction. ``sincos`` is a function ``(x, &s, &c)`` that computes sine and cosine together, if any.
    """
    return _Body(program, precision, names, stores, sincos).lines


class _Body:
    """One pass through a program: its lines, and the text of each value."""

    def __init__(
        self, program: Program, precision: str, names: Sequence[str], stores: Iterable[tuple[str, int]], sincos: str
    ) -> None:
        self.program, self.type, self.sincos = program, precision, sincos
        self.suffix = PRECISIONS[precision]
        self.lines: list[str] = []
        self.written: dict[int, str] = {}
        self.slots: dict[int, list[str]] = {}
        for place, result in stores:
            self.slots.setdefault(result, []).append(place)
        self._constants()
        self._inputs(names)
        partners = self._partners()
        for number, instruction in enumerate(self.program.instructions):
            if instruction.op in ("const", "input"):
                self._store(number)
            elif number not in self.written:
                self._operations(number, partners.get(number, ()))

    def _constants(self) -> None:
        for number, (op, _, value) in enumerate(self.program.instructions):
            if op == "const":
                self.written[number] = literal(value, self.type)

    def _inputs(self, names: Sequence[str]) -> None:
        """Read all used inputs before anything is written, so that an output may use the array of an input."""
        elements: list[tuple[str, int]] = []  # array and index of each input
        for name, port in zip(names, self.program.inputs, strict=False):
            elements += [(name, k) for k in range(port.size)]
        used = sorted((int(i.value), n) for n, i in enumerate(self.program.instructions) if i.op == "input")
        used_names = {elements[element][0] for element, _ in used}
        for name in names[: len(self.program.inputs)]:
            if name not in used_names:
                self.lines.append(f"    (void){name};")
        for element, number in used:
            name, k = elements[element]
            local = f"{name}_{k}"
            while local in names:
                local += "_"
            self.written[number] = local
            self.lines.append(f"    const {self.type} {local} = {name}[{k}];")

    def _partners(self) -> dict[int, tuple[int, ...]]:
        """Cosine of a sine's angle and vice versa; adjacent calls can be computed together."""
        by_angle: dict[int, list[int]] = {}
        for number, (op, args, _) in enumerate(self.program.instructions):
            if op in ("sin", "cos"):
                by_angle.setdefault(args[0], []).append(number)
        partners: dict[int, tuple[int, ...]] = {}
        for pair in by_angle.values():
            partners |= dict.fromkeys(pair, tuple(pair))
        return partners

    def _operations(self, number: int, partners: tuple[int, ...]) -> None:
        """Write an operation, with its partner if it has one."""
        if self.sincos and len(partners) == 2:
            (angle,) = self.program.instructions[number].args
            sine, cosine = sorted(partners, key=lambda k: self.program.instructions[k].op, reverse=True)
            self.lines += [
                f"    {self.type} t{sine}, t{cosine};",
                f"    {self.sincos}({self.written[angle]}, &t{sine}, &t{cosine});",
            ]
            for k in (sine, cosine):
                self.written[k] = f"t{k}"
                self._store(k)
            return
        for k in (number, *partners):
            if k not in self.written:
                self._operation(k)

    def _operation(self, number: int) -> None:
        local = f"t{number}"
        op, args, _ = self.program.instructions[number]
        expression = self._expression(op, [self.written[a] for a in args])
        self.lines.append(f"    const {self.type} {local} = {expression};")
        self.written[number] = local
        self._store(number)

    def _store(self, number: int) -> None:
        """Store results as soon as they are computed, so that values no longer needed occupy no register or stack."""
        for place in self.slots.get(number, ()):
            self.lines.append(f"    {place} = {self.written[number]};")

    def _expression(self, op: str, x: list[str]) -> str:
        if op in _INFIX:
            return f"{x[0]} {_INFIX[op]} {x[1]}"
        if op in FUSED:
            return f"{op.upper()}({', '.join(x)})"
        if op == "neg":
            return f"-{x[0]}"
        if op in ("min", "max"):
            comparison = {"min": "<", "max": ">"}[op]
            return f"{x[0]} {comparison} {x[1]} ? {x[0]} : {x[1]}"
        if op == "sign":  # 0 stays 0 and NaN stays NaN
            one, zero = f"1.0{self.suffix}", f"0.0{self.suffix}"
            return f"{x[0]} > {zero} ? {one} : {x[0]} < {zero} ? -{one} : {x[0]}"
        return f"{op}{self.suffix}({x[0]})"
