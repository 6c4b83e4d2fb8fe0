"""Straight-line programs: named arrays, gufunc signatures, instructions, and functions composed of instructions."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from .expr import Expr


class TensorSpec(NamedTuple):
    """Name and shape of an input or output array."""

    name: str
    shape: tuple[int, ...]

    @property
    def size(self) -> int:
        """Number of elements."""
        return math.prod(self.shape)


def signature_of(inputs: Sequence[Sequence[int | str]], outputs: Sequence[Sequence[int | str]]) -> str:
    """Gufunc signature of operands with those sizes."""
    return f"{_operand_sizes(inputs)}->{_operand_sizes(outputs)}"


def _operand_sizes(operands: Sequence[Sequence[int | str]]) -> str:
    return ",".join(f"({','.join(map(str, sizes))})" for sizes in operands)


@cache
def axes_of(signature: str) -> list[list[int]]:
    """Position of each axis' size in a loop's ``dims``, by operand; sizes are numbered in the order of first appearance.

    >>> axes_of("(7),(k,7)->(m,7)")
    [[1], [2, 1], [3, 1]]
    """
    names: list[str] = []
    operands = []
    for operand in re.findall(r"\(([^)]*)\)", signature):
        sizes = [size for size in operand.split(",") if size]
        names += [size for size in dict.fromkeys(sizes) if size not in names]
        operands.append([1 + names.index(size) for size in sizes])
    return operands


# ── A program: straight-line instructions without loops and branches, with explicit rounding

FUSED = {"fma": (1, 1), "fms": (1, -1), "fnma": (-1, 1), "fnms": (-1, -1)}
"""Fused products with one rounding: ``fma`` is a b + c; the two signs are those of the product and of c."""

ARITY = {
    "const": 0, "input": 0, "add": 2, "sub": 2, "mul": 2, "div": 2, "neg": 1,
    "sqrt": 1, "sin": 1, "cos": 1, "sign": 1, "exp": 1, "min": 2, "max": 2, **dict.fromkeys(FUSED, 3),
}  # fmt: skip
"""Number of operands of every operation.

``min`` is a if a < b, else b; ``max`` is a if a > b, else b. As in processors, unordered operands give the second one.
"""


class Instruction(NamedTuple):
    """Operation on earlier results. ``value`` is the value of a constant or the number of an input."""

    op: str
    args: tuple[int, ...]
    value: float


@dataclass(frozen=True, repr=False)
class Program:
    """Computation of a kernel for one sample.

    Input elements are numbered through all inputs in C order. ``results`` has the number of the instruction that computes each
    output element, in the same order.
    """

    instructions: tuple[Instruction, ...]
    """Instructions, each on earlier results."""
    results: tuple[int, ...]
    """Number of the instruction that computes each output element, in C order."""
    inputs: tuple[TensorSpec, ...]
    """Names and shapes of the inputs."""
    outputs: tuple[TensorSpec, ...]
    """Names and shapes of the outputs."""

    def __repr__(self) -> str:
        inputs, outputs = ", ".join(port.name for port in self.inputs), ", ".join(port.name for port in self.outputs)
        return f"<Program {inputs} → {outputs}, {self.signature}: {len(self.instructions)} instructions>"

    def counts(self) -> dict[str, int]:
        """Number of occurrences of each operation, without constants and inputs.

        Returns
        -------
        counts : {operation: int}

        Examples
        --------
        >>> import twistwrench as tw
        >>> tw.robots.pendulum().program("gravity_forces").counts()
        {'sin': 1, 'mul': 1}
        """
        return dict(Counter(i.op for i in self.instructions if ARITY[i.op]))

    @property
    def flops(self) -> int:
        """Number of additions, multiplications and divisions; a fused product counts two, sines and cosines are not counted."""
        c = self.counts()
        return sum(c.get(op, 0) for op in ("add", "sub", "mul", "div")) + 2 * sum(c.get(op, 0) for op in FUSED)

    @property
    def multiplications(self) -> int:
        """Number of products, including fused ones."""
        c = self.counts()
        return c.get("mul", 0) + sum(c.get(op, 0) for op in FUSED)

    @cached_property
    def zeros(self) -> tuple[bool, ...]:
        """For each output element, True if it is zero for all inputs."""
        instructions = [self.instructions[result] for result in self.results]
        return tuple(x.op == "const" and x.value == 0.0 for x in instructions)

    @cached_property
    def digest(self) -> str:
        """Hash of the whole computation; equal programs have equal digests in every process."""
        import hashlib

        state = hashlib.sha256(repr((self.inputs, self.outputs, self.results)).encode())
        for op, args, value in self.instructions:
            state.update(f"{op}{args}{value!r}\n".encode())
        return state.hexdigest()

    @property
    def signature(self) -> str:
        """Gufunc signature with the program's sizes, as in ``(7),(7)->(7,7)``."""
        return signature_of([p.shape for p in self.inputs], [p.shape for p in self.outputs])


# ── Functions that targets lack, composed of available ones: tanh, log and arctan2

# Each result is an ordinary expression, which every target can compute. A :class:`Composed` names it for the chain rule, which
# uses the function's own derivative, not that of its formula. Errors are below 1e-15 in double precision, absolute for
# results below 1.

_LARGEST = float(np.finfo(float).max)
_SMALLEST = float(np.finfo(float).tiny)
_TERMS = 11
_ROOTS = 10


class Composed(NamedTuple):
    """Function and operands that an expression represents."""

    name: str
    """Name of the function."""
    operands: tuple[Expr, ...]
    """Operands of the function."""


def tanh(x: Expr) -> Expr:
    """Hyperbolic tangent: (1 - e) / (1 + e) with e = exp(-2 |x|), and the sign of x."""
    e = (-2.0 * abs(x)).exp()
    return _record_function("tanh", x.sign() * ((1.0 - e) / (1.0 + e)), 1.0, x)


def log(x: Expr) -> Expr:
    """Natural logarithm. Roots r of x near 1 give ln r from 2 artanh((r - 1) / (r + 1)); Halley's steps refine it.

    -inf at 0, NaN for negative numbers.
    """
    trace, r = x.trace, x
    for _ in range(_ROOTS):  # then sqrt(1/2) < r < 2
        r = r.sqrt()
    s = (r - 1.0) / (r + 1.0)
    y = 2.0 ** (_ROOTS + 1) * (s * _odd(s * s, 1.0))
    for _ in range(2):
        e = y.exp()
        y = y + (x - e) / trace.max(trace.constant(_SMALLEST), 0.5 * x + 0.5 * e)
    at_zero = 1.0 - 1.0 / x.sign()  # 0 for x > 0, -inf at 0
    return _record_function("log", y + at_zero, _LARGEST, x)


def arctan2(y: Expr, x: Expr) -> Expr:
    """Angle of the point (x, y), from -pi to pi; 0 at the origin. Abramowitz and Stegun (1964), section 4.4."""
    trace, h, w = y.trace, abs(y), abs(x)
    longer = trace.max(h, w)
    t: Any = trace.min(h, w) / trace.max(trace.constant(_SMALLEST), longer)
    for _ in range(2):  # half the angle, twice: t < tan(pi / 16)
        t = t / (1.0 + (1.0 + t * t).sqrt())
    angle = 4.0 * (t * _odd(t * t, -1.0))
    steep, back = 0.5 + 0.5 * (h - w).sign(), 0.5 - 0.5 * x.sign()
    angle = angle + steep * (0.5 * math.pi - 2.0 * angle)
    angle = angle + back * (math.pi - 2.0 * angle)
    up = y.sign()
    return _record_function("arctan2", (up + (1.0 - up * up)) * (longer.sign() * angle), math.pi, y, x)


def _odd(square: Any, sign: float) -> Any:
    """1 + s z / 3 + z^2 / 5 + s z^3 / 7 + ..., by Horner's scheme: artanh(t) / t or arctan(t) / t at z = t^2."""
    total: Any = 0.0
    for k in reversed(range(_TERMS)):
        total = total * square + sign**k / (2 * k + 1)
    return total


def _record_function(name: str, value: Any, maximum: float, *operands: Expr) -> Expr:
    """Value, at most ``maximum``, as an unfolded expression that records the function it computes."""
    trace = operands[0].trace
    expression = trace.min(trace.constant(maximum), trace.lift(value))  # NaN stays NaN
    if expression.op != "const":
        trace.composed[expression.index] = Composed(name, operands)
    return expression
