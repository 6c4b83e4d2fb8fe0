"""Programs as C99 functions: one operation per line, without loops, branches and heap memory; they need only math.h.

Fused products are calls of ``fma``, and nothing else is fused. So results have the bits of the compiled kernels, if the C
library's sine, cosine and exponential have those of the kernels. All inputs are read before any output is written. CUDA uses
the same statements.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ...core.errors import KernelError
from ..ir.program import FUSED, Program

PRECISIONS = {"double": "", "float": "f"}
"""Suffix of functions and literals in C, by the C type of their numbers."""

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

_OPERATOR_SIGNS = {"add": "+", "sub": "-", "mul": "*", "div": "/"}
_MAX_LINE_LENGTH = 116
"""Maximum length of a prototype on one line."""


def identifier(text: str) -> str:
    """Name in C: letters and digits of a text, with single underscores between them; C++ reserves double ones.

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
        for ports, suffix_of_repeated in ((self.program.inputs, "_2"), (self.program.outputs, "_out")):
            for port in ports:
                short_name = port.name.replace("wrench at", "wrench")
                name = identifier(short_name)
                while name in names:
                    name += suffix_of_repeated
                names.append(name)
        return tuple(names)

    @property
    def prototype(self) -> str:
        """Declaration, without a semicolon."""
        inputs, outputs = self.program.inputs, self.program.outputs
        element_types = [f"const {self.precision}"] * len(inputs) + [self.precision] * len(outputs)
        arrays = zip(element_types, self.parameters, (*inputs, *outputs), strict=True)
        declarations = [f"{element_type} {name}[{port.size}]" for element_type, name, port in arrays]
        single_line = f"void {self.name}({', '.join(declarations)})"
        if len(single_line) <= _MAX_LINE_LENGTH:
            return single_line
        return f"void {self.name}(\n    " + ",\n    ".join(declarations) + ")"

    @property
    def definition(self) -> str:
        """Complete function definition."""
        output_names = self.parameters[len(self.program.inputs) :]
        output_elements: list[str] = []
        for name, port in zip(output_names, self.program.outputs, strict=True):
            output_elements += [f"{name}[{k}]" for k in range(port.size)]
        stores = zip(output_elements, self.program.results, strict=True)
        body_lines = statements(self.program, self.precision, self.parameters, stores)
        return "\n".join([self.prototype, "{", *body_lines, "}"])

    @property
    def fuses(self) -> bool:
        """True if the function needs :data:`FUSED_MACROS`."""
        return any(instruction.op in FUSED for instruction in self.program.instructions)


def statements(
    program: Program, precision: str, names: Sequence[str], stores: Iterable[tuple[str, int]], sincos: str = ""
) -> list[str]:
    """Lines of a function's body.

    ``names`` are the names of the function's arrays, beginning with the program's inputs. ``stores`` pairs each output element
    with the number of its instruction. ``sincos`` names a function ``(x, &s, &c)`` that computes sine and cosine together;
    empty: the two are computed apart.
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
        self.operands: dict[int, str] = {}
        """Variable or literal of each value written so far, by number of its instruction."""
        self.output_elements: dict[int, list[str]] = {}
        """Output elements that get each value, by number of its instruction."""
        for element, number in stores:
            self.output_elements.setdefault(number, []).append(element)
        self._define_constants()
        self._read_inputs(names)
        partners_by_number = self._sines_and_cosines()
        for number, instruction in enumerate(self.program.instructions):
            if instruction.op in ("const", "input"):
                self._write_stores(number)
            elif number not in self.operands:
                self._write_with_partner(number, partners_by_number.get(number, ()))

    def _define_constants(self) -> None:
        """Let constants be literals where they are used."""
        for number, (op, _, value) in enumerate(self.program.instructions):
            if op == "const":
                self.operands[number] = literal(value, self.type)

    def _read_inputs(self, names: Sequence[str]) -> None:
        """Read all used inputs before anything is written, so that an output may use the array of an input."""
        elements: list[tuple[str, int]] = []  # array and index of each input
        for name, port in zip(names, self.program.inputs, strict=False):  # names of outputs follow
            elements += [(name, k) for k in range(port.size)]
        reads: list[tuple[int, int]] = []  # number of the input, and number of its instruction
        for number, instruction in enumerate(self.program.instructions):
            if instruction.op == "input":
                reads.append((int(instruction.value), number))
        reads.sort()
        used_arrays = {elements[input_number][0] for input_number, _ in reads}
        for name in names[: len(self.program.inputs)]:
            if name not in used_arrays:
                self.lines.append(f"    (void){name};")  # avoids the compiler's warning of an unused parameter
        for input_number, number in reads:
            name, k = elements[input_number]
            variable = f"{name}_{k}"
            while variable in names:
                variable += "_"
            self.operands[number] = variable
            self.lines.append(f"    const {self.type} {variable} = {name}[{k}];")

    def _sines_and_cosines(self) -> dict[int, tuple[int, ...]]:
        """For each sine and cosine, the numbers of all of its angle, itself included. Compilers compute neighbours together."""
        numbers_by_angle: dict[int, list[int]] = {}
        for number, (op, args, _) in enumerate(self.program.instructions):
            if op in ("sin", "cos"):
                numbers_by_angle.setdefault(args[0], []).append(number)
        partners_by_number: dict[int, tuple[int, ...]] = {}
        for numbers in numbers_by_angle.values():
            partners_by_number |= dict.fromkeys(numbers, tuple(numbers))
        return partners_by_number

    def _write_with_partner(self, number: int, partners: tuple[int, ...]) -> None:
        """Write an operation; with a sine or cosine also the other one of its angle, if the program has both."""
        instructions = self.program.instructions
        if self.sincos and len(partners) == 2:  # a sine and a cosine
            (angle,) = instructions[number].args
            cosine, sine = sorted(partners, key=lambda partner: instructions[partner].op)  # "cos" before "sin"
            self.lines += [
                f"    {self.type} t{sine}, t{cosine};",
                f"    {self.sincos}({self.operands[angle]}, &t{sine}, &t{cosine});",
            ]
            for partner in (sine, cosine):
                self.operands[partner] = f"t{partner}"
                self._write_stores(partner)
            return
        for partner in (number, *partners):
            if partner not in self.operands:
                self._write_operation(partner)

    def _write_operation(self, number: int) -> None:
        """Write one operation, and store its value where it is a result."""
        variable = f"t{number}"
        op, args, _ = self.program.instructions[number]
        expression = self._expression(op, [self.operands[operand] for operand in args])
        self.lines.append(f"    const {self.type} {variable} = {expression};")
        self.operands[number] = variable
        self._write_stores(number)

    def _write_stores(self, number: int) -> None:
        """Store a value as soon as it is computed if it is a result: afterwards it needs no register or stack."""
        for element in self.output_elements.get(number, ()):
            self.lines.append(f"    {element} = {self.operands[number]};")

    def _expression(self, op: str, operands: list[str]) -> str:
        """Expression in C for an operation."""
        x = operands[0]
        if op in _OPERATOR_SIGNS:
            return f"{x} {_OPERATOR_SIGNS[op]} {operands[1]}"
        if op in FUSED:
            return f"{op.upper()}({', '.join(operands)})"
        if op == "neg":
            return f"-{x}"
        if op in ("min", "max"):
            comparison = "<" if op == "min" else ">"
            return f"{x} {comparison} {operands[1]} ? {x} : {operands[1]}"
        if op == "sign":  # 0 stays 0 and NaN stays NaN
            one, zero = f"1.0{self.suffix}", f"0.0{self.suffix}"
            return f"{x} > {zero} ? {one} : {x} < {zero} ? -{one} : {x}"
        return f"{op}{self.suffix}({x})"
