"""A program as AVX2 instructions, in an order and in registers that we choose ourselves.

Straight-line code is all a program is, and a compiler's allocation of registers is the half of it: LLVM moves every second
value of a long block out of its registers and back, and takes ten times as long for it. Here instructions keep the order of
the program, and registers are given out by :mod:`.registers`, which knows every later use. The bits are those of :mod:`.llvm`,
which serves all other processors.
"""

from __future__ import annotations

from collections.abc import Iterator

from ..program.program import FUSED, Instruction, Program
from .avx2_code import Avx2Code
from .avx2_rows import ColumnLoader, ColumnStorer
from .processor import Precision
from .sincos import COSINE, HALF_PI, SINE, TWO_OVER_PI

SIDE_BY_SIDE = 3
"""Angles whose sine and cosine are computed in lockstep: four values each are alive at a time, of sixteen registers."""

_BINARY = {"add": "vadd", "sub": "vsub", "mul": "vmul", "div": "vdiv", "min": "vmin", "max": "vmax"}

OPERATIONS = frozenset({"const", "input", "neg", "sqrt", "sin", "cos", *_BINARY, *FUSED})
"""What there are instructions for here."""


class Selection:
    """One walk through a program: the instructions of each operation, in the program's order.

    Results go to the arrays as soon as a tile of them is complete, or, if ``packed``, to the entries of a frame.
    """

    def __init__(self, program: Program, precision: Precision, *, packed: bool = False) -> None:
        self.program, self.precision, self.bits = program, precision, precision.bits
        self.code = Avx2Code("pd" if precision.bits == 64 else "ps")
        self.constants: dict[int, int] = {}
        self.pairs: dict[int, tuple[int, int]] = {}
        self.values: dict[int, int] = {}
        self.loaders: list[tuple[ColumnLoader, int]] = []
        for number, port in enumerate(program.inputs):
            loader = ColumnLoader(self.code, number, port.size, precision)
            self.loaders += [(loader, c) for c in range(port.size)]
        self.storers: list[tuple[ColumnStorer, int]] = []
        for number, port in enumerate(program.outputs, start=len(program.inputs)):
            storer = ColumnStorer(self.code, number, port.size, precision)
            self.storers += [(storer, c) for c in range(port.size)]
        places: dict[int, list[int]] = {}
        for k, result in enumerate(program.results):
            places.setdefault(result, []).append(k)
        angles = dict.fromkeys(i.args[0] for i in program.instructions if i.op in ("sin", "cos"))
        self.waiting = [a for a in angles if program.instructions[a].op == "input"]
        for number, instruction in enumerate(program.instructions):
            if instruction.op == "input" and number not in places and number in self.waiting:
                continue
            self.values[number] = self._value(instruction)
            for k in places.get(number, ()):
                if not packed:
                    storer, column = self.storers[k]
                    storer.put(column, self.values[number])
                elif instruction.op != "const":
                    self.code.keep(self.values[number], k)

    def constant(self, value: float) -> int:
        """The same number in every lane."""
        return self.pattern(self.precision.pattern(value))

    def pattern(self, bits: int) -> int:
        """The same bits in every lane."""
        bits &= (1 << self.bits) - 1
        if bits not in self.constants:
            self.constants[bits] = self.code.constant(bits)
        return self.constants[bits]

    def _value(self, instruction: Instruction) -> int:
        op, args, value = instruction
        code = self.code
        if op == "const":
            return self.constant(value)
        if op == "input":
            loader, column = self.loaders[int(value)]
            return loader.column(column)
        if op in ("sin", "cos"):
            return self._sincos(args[0])[op == "cos"]
        x = [self.values[a] for a in args]
        if op in FUSED:
            return code.fused(FUSED[op], x[0], x[1], x[2])
        if op == "neg":
            return code.binary("vxor", self._sign, x[0], swaps=True)
        if op == "sqrt":
            return code.unary("vsqrt", x[0])
        return code.binary(_BINARY[op], x[0], x[1], swaps=op in ("add", "mul"))

    @property
    def _sign(self) -> int:
        return self.pattern(1 << (self.bits - 1))

    def _sincos(self, angle: int) -> tuple[int, int]:
        if angle not in self.pairs:
            group = [angle, *(a for a in self.waiting if a != angle)][:SIDE_BY_SIDE]
            self.waiting = [a for a in self.waiting if a not in group]
            values = [self.values[a] if a in self.values else self._value(self.program.instructions[a]) for a in group]
            self.pairs.update(zip(group, self._several_sincos(values), strict=True))
        return self.pairs[angle]

    def _several_sincos(self, angles: list[int]) -> Iterator[tuple[int, int]]:
        """:func:`.sincos.sincos`, step by step."""
        code, const = self.code, self.constant
        magic = const(1.5 * 2.0**self.precision.mantissa)
        shifted = [code.fused((1, 1), x, const(TWO_OVER_PI), magic) for x in angles]
        turns = [code.binary("vsub", s, magic) for s in shifted]
        reduced = angles
        for part in HALF_PI[self.bits]:
            reduced = [code.fused((1, 1), k, const(-part), r) for k, r in zip(turns, reduced, strict=True)]
        squares = [code.binary("vmul", r, r) for r in reduced]
        sines = self._horner(SINE[self.bits], squares)
        cubes = [code.binary("vmul", r, r2) for r, r2 in zip(reduced, squares, strict=True)]
        sines = [code.fused((1, 1), s, r3, r) for s, r3, r in zip(sines, cubes, reduced, strict=True)]
        cosines = self._horner(COSINE[self.bits], squares)
        return (self._quadrant(*triple) for triple in zip(shifted, sines, cosines, strict=True))

    def _horner(self, coefficients: tuple[float, ...], points: list[int]) -> list[int]:
        values = [self.constant(coefficients[0])] * len(points)
        for c in coefficients[1:]:
            values = [self.code.fused((1, 1), v, x, self.constant(c)) for v, x in zip(values, points, strict=True)]
        return values

    def _quadrant(self, shifted: int, sine: int, cosine: int) -> tuple[int, int]:
        code, top = self.code, self._sign
        low, high = code.shifted(shifted, self.bits - 1), code.shifted(shifted, self.bits - 2)
        both = code.binary("vxor", low, high, swaps=True)
        s, c = code.blend(sine, cosine, low), code.blend(cosine, sine, low)
        signs = (code.binary("vand", top, x, swaps=True) for x in (high, both))
        flipped = [code.binary("vxor", v, sign, swaps=True) for v, sign in zip((s, c), signs, strict=True)]
        return flipped[0], flipped[1]
