"""Programs from traced functions: order of evaluation, fusion of products into sums, numbering.

The order of evaluation matters more than any compiler optimisation, because a program has thousands of values and a processor
a few dozen registers. Programs keep the order in which the algorithm computes values, with sines and cosines first, so that
values used together stay together. Depth-first order from the results needs half as many more register spills (see
bench/NOTES.md).
"""

from __future__ import annotations

import gc
import math
import os
import threading
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ...core.errors import KernelError
from ...core.typing import Array
from .composed_functions import Composed
from .expr import Expr
from .program import FUSED, Instruction, Program, TensorSpec


def build(results: Sequence[Expr], inputs: tuple[TensorSpec, ...], outputs: tuple[TensorSpec, ...]) -> Program:
    """Program that computes ``results``."""
    nodes = _sort_nodes(results)
    fused = _fusions(nodes, results)
    instructions, number_of_node = _emit(nodes, fused)
    result_numbers = tuple(number_of_node[result.index] for result in results)
    return Program(tuple(instructions), result_numbers, inputs, outputs)


def _sort_nodes(results: Sequence[Expr]) -> list[Expr]:
    """All expressions that the results need, in order of creation, but sines, cosines and their operands first."""
    nodes = reachable(results)
    sines_and_cosines = [node for node in nodes if node.op in ("sin", "cos")]
    early_indices = {node.index for node in reachable(sines_and_cosines)}

    def place(node: Expr) -> tuple[bool, int]:
        is_late = node.index not in early_indices
        return is_late, node.index

    return sorted(nodes, key=place)  # False comes before True


def operands_of(node: Expr) -> tuple[Expr, ...]:
    """Operands of an expression: none, one or two."""
    if node.a is None:
        return ()
    if node.b is None:
        return (node.a,)
    return node.a, node.b


def reachable(results: Sequence[Expr], operands: Callable[[Expr], Sequence[Expr]] = operands_of) -> list[Expr]:
    """All expressions that the results depend on, and the results; iterative, because programs may be deep."""
    nodes: dict[int, Expr] = {}
    stack = list(results)
    while stack:
        node = stack.pop()
        if node.index not in nodes:
            nodes[node.index] = node
            stack.extend(operands(node))
    return list(nodes.values())


_OPERATION_OF_SIGNS = {signs: operation for operation, signs in FUSED.items()}
"""Fused operation by the signs of its product and of its other operand."""


def _fusions(nodes: Sequence[Expr], results: Sequence[Expr]) -> dict[int, tuple[str, Expr, Expr]]:
    """Sums that absorb a product without other uses: (fused operation, product, other operand) by index of the sum."""
    use_counts: dict[int, int] = {}  # by index of the expression
    for node in nodes:
        for operand in operands_of(node):
            use_counts[operand.index] = use_counts.get(operand.index, 0) + 1
    for result in results:
        use_counts[result.index] = use_counts.get(result.index, 0) + 1
    fused: dict[int, tuple[str, Expr, Expr]] = {}
    for node in nodes:
        if node.op not in ("add", "sub") or node.a is None or node.b is None:
            continue
        sign_of_b = 1 if node.op == "add" else -1
        if node.b.op == "mul" and use_counts[node.b.index] == 1:
            fused[node.index] = _OPERATION_OF_SIGNS[sign_of_b, 1], node.b, node.a
        elif node.a.op == "mul" and use_counts[node.a.index] == 1:
            fused[node.index] = _OPERATION_OF_SIGNS[1, sign_of_b], node.a, node.b
    return fused


def _emit(nodes: Sequence[Expr], fused: dict[int, tuple[str, Expr, Expr]]) -> tuple[list[Instruction], dict[int, int]]:
    """Instructions in the order of the nodes, and the number of each node's instruction, by index of the node."""
    absorbed_products = {product.index for _, product, _ in fused.values()}
    instructions: list[Instruction] = []
    number_of_node: dict[int, int] = {}
    for node in nodes:
        if node.index in absorbed_products:
            continue
        if node.index in fused:
            op, product, other = fused[node.index]
            operands: tuple[Expr | None, ...] = (product.a, product.b, other)
        else:
            op = node.op
            operands = (node.a, node.b)
        operand_numbers = tuple(number_of_node[operand.index] for operand in operands if operand is not None)
        number_of_node[node.index] = len(instructions)
        instructions.append(Instruction(op, operand_numbers, node.value))
    return instructions, number_of_node


# A trace is a table of distinct expressions, which are folded on creation. Folding evaluates operations of constants, removes
# terms 0 and factors 1, moves negations outward, and shares common subexpressions. It may reassociate constants (``2 * (3 *
# x)`` is ``6 * x``), but never drops a term that is not exactly zero.

MAX_EXPRESSIONS = 2_000_000
"""Maximum number of expressions in a trace. Each takes half a kilobyte until the program is built, so all take a gigabyte."""


class Trace:
    """Owner of the expressions of one program."""

    def __init__(self) -> None:
        self._table: dict[tuple[Any, ...], Expr] = {}  # by operation, operands and value
        self._angle_sums: dict[int, tuple[Expr, Expr]] = {}  # the two angles, by index of their sum
        self.composed: dict[int, Composed] = {}
        self.zero = self.constant(0.0)
        self.one = self.constant(1.0)

    def _make(self, op: str, a: Expr | None = None, b: Expr | None = None, value: float = 0.0) -> Expr:
        """Expression of an operation; it is new only if the table has no equal expression.

        Called for every operation, hence conditionals in place and no calls.
        """
        key = (op, -1 if a is None else a.index, -1 if b is None else b.index, value)
        expression = self._table.get(key)
        if expression is None:
            if (a is not None and a.trace is not self) or (b is not None and b.trace is not self):
                raise ValueError("an expression of another trace was mixed in.")
            if len(self._table) >= MAX_EXPRESSIONS:
                raise KernelError(
                    f"this takes more than {MAX_EXPRESSIONS:,} operations a state, too many for a program without loops. "
                    "robot.reference evaluates one state by the algorithm itself; a robot with some joints locked has less."
                )
            expression = self._table[key] = Expr(self, op, a, b, value, len(self._table))
        return expression

    def forget(self) -> None:
        """Release all expressions.

        Expressions refer to this trace and the trace to them: the garbage collector would free such a large cycle late.
        """
        self._table.clear()
        self._angle_sums.clear()
        self.composed.clear()

    def constant(self, value: float) -> Expr:
        """Return a constant; -0.0 becomes 0.0."""
        return self._make("const", value=float(value) + 0.0)

    def input(self, number: int) -> Expr:
        """Return the input element with this number."""
        return self._make("input", value=number)

    def inputs(self, first: int, shape: tuple[int, ...]) -> Array:
        """Return an object array of inputs, numbered in C order from ``first``."""
        array = np.empty(shape, object)
        flat = array.reshape(-1)
        for k in range(flat.size):
            flat[k] = self.input(first + k)
        return array

    def lift(self, value: Any) -> Expr:
        """Return an expression for an expression or a number."""
        if isinstance(value, Expr):
            if value.trace is not self:
                raise ValueError("an expression of another trace was mixed in.")
            return value
        return self.constant(value)

    # ── arithmetic ──

    def add(self, a: Expr, b: Expr) -> Expr:
        """Return a + b, folded."""
        if a.op == "const":
            a, b = b, a
        if b.op == "const":
            if a.op == "const":
                return self.constant(a.value + b.value)
            if b.value == 0.0:
                return a
        if b.op == "neg":
            return self.sub(a, b.a)  # type: ignore[arg-type]
        if a.op == "neg":
            return self.sub(b, a.a)  # type: ignore[arg-type]
        if a.index > b.index:
            a, b = b, a
        return self._make("add", a, b)

    def sub(self, a: Expr, b: Expr) -> Expr:
        """Return a - b, folded."""
        if a is b:
            return self.zero
        if b.op == "const":
            if a.op == "const":
                return self.constant(a.value - b.value)
            if b.value == 0.0:
                return a
        if a is self.zero:
            return self.neg(b)
        if b.op == "neg":
            return self.add(a, b.a)  # type: ignore[arg-type]
        if a.op == "neg":
            return self.neg(self.add(a.a, b))  # type: ignore[arg-type]
        return self._make("sub", a, b)

    def neg(self, a: Expr) -> Expr:
        """Return -a, folded."""
        if a.op == "const":
            return self.constant(-a.value)
        if a.op == "neg":
            return a.a  # type: ignore[return-value]
        if a.op == "sub":
            return self._make("sub", a.b, a.a)
        return self._make("neg", a)

    def mul(self, a: Expr, b: Expr) -> Expr:
        """Return a * b, folded; a constant factor comes first and is positive."""
        if b.op == "const":
            a, b = b, a
        if a.op == "const":
            return self.scale(a.value, b)
        if a.op == "neg":
            return self.neg(self.mul(a.a, b))  # type: ignore[arg-type]
        if b.op == "neg":
            return self.neg(self.mul(a, b.a))  # type: ignore[arg-type]
        if a.index > b.index:
            a, b = b, a
        return self._make("mul", a, b)

    def scale(self, factor: float, b: Expr) -> Expr:
        """Return a number times b, folded."""
        if b.op == "const":
            return self.constant(factor * b.value)
        if factor == 0.0:
            return self.zero
        if factor < 0.0:
            return self.neg(self.scale(-factor, b))
        if factor == 1.0:
            return b
        if b.op == "neg":
            return self.neg(self.scale(factor, b.a))  # type: ignore[arg-type]
        if b.op == "mul" and b.a is not None and b.a.op == "const":
            return self.scale(factor * b.a.value, b.b)  # type: ignore[arg-type]
        return self._make("mul", self.constant(factor), b)

    def div(self, a: Expr, b: Expr) -> Expr:
        """Return a / b, folded; division by a constant becomes a product with its reciprocal."""
        if b.op == "const" and b.value != 0.0:
            return self.scale(1.0 / b.value, a)
        if a is self.zero:
            return a
        if a.op == "neg":
            return self.neg(self.div(a.a, b))  # type: ignore[arg-type]
        if b.op == "neg":
            return self.neg(self.div(a, b.a))  # type: ignore[arg-type]
        return self._make("div", a, b)

    # ── functions ──

    def turned(self, a: Expr, b: Expr) -> Expr:
        """Sum of two angles. Its sine and cosine come from the sines and cosines of ``a`` and ``b`` by addition theorems.

        Compiled sines and cosines are accurate in a range that is checked for inputs only, and a sum may leave it.
        """
        angle_sum = self.add(a, b)
        if angle_sum is not a and angle_sum is not b:
            self._angle_sums[angle_sum.index] = a, b
        return angle_sum

    def sin(self, a: Expr) -> Expr:
        """Return sin a, folded as an odd function."""
        if a.op == "const":
            return self.constant(math.sin(a.value))
        if a.index in self._angle_sums:
            x, y = self._angle_sums[a.index]
            return self.add(self.mul(self.sin(x), self.cos(y)), self.mul(self.cos(x), self.sin(y)))
        if a.op == "neg" and a.a is not None:
            return self.neg(self.sin(a.a))
        return self._make("sin", a)

    def cos(self, a: Expr) -> Expr:
        """Return cos a, folded as an even function."""
        if a.op == "const":
            return self.constant(math.cos(a.value))
        if a.index in self._angle_sums:
            x, y = self._angle_sums[a.index]
            return self.sub(self.mul(self.cos(x), self.cos(y)), self.mul(self.sin(x), self.sin(y)))
        if a.op == "neg" and a.a is not None:
            return self.cos(a.a)
        return self._make("cos", a)

    def sqrt(self, a: Expr) -> Expr:
        """Return the square root, folded."""
        if a.op == "const":
            return self.constant(math.sqrt(a.value))
        return self._make("sqrt", a)

    def exp(self, a: Expr) -> Expr:
        """Return e to the power of a, folded."""
        if a.op == "const":
            return self.constant(math.exp(a.value))
        return self._make("exp", a)

    def min(self, a: Expr, b: Expr) -> Expr:
        """Return a if a < b, else b, folded."""
        if a.op == "const" and b.op == "const":
            return a if a.value < b.value else b
        if a is b or (a.op == "const" and a.value == math.inf):
            return b
        return self._make("min", a, b)

    def max(self, a: Expr, b: Expr) -> Expr:
        """Return a if a > b, else b, folded."""
        if a.op == "const" and b.op == "const":
            return a if a.value > b.value else b
        if a is b or (a.op == "const" and a.value == -math.inf):
            return b
        return self._make("max", a, b)

    def sign(self, a: Expr) -> Expr:
        """Return the sign, folded as an odd function."""
        if a.op == "const":
            return self.constant((a.value > 0) - (a.value < 0))
        if a.op == "neg" and a.a is not None:
            return self.neg(self.sign(a.a))
        return self._make("sign", a)


def trace(
    function: Callable[..., Any], inputs: Sequence[tuple[str, tuple[int, ...]]], outputs: Sequence[str]
) -> Program:
    """Return the operations of ``function`` on symbols as a program.

    ``inputs`` are (name, shape) pairs, passed in order as object arrays. The function returns one array or a tuple of arrays
    with the names ``outputs``.

    >>> program = trace(lambda x, y: x * y + 1.0, [("x", ()), ("y", ())], ["z"])
    >>> program.counts()["fma"], program.outputs[0].shape
    (1, ())
    """
    owner = Trace()
    arguments = []
    input_specs = []
    input_count = 0  # number of input elements so far
    for name, shape in inputs:
        array = owner.inputs(input_count, shape)
        arguments.append(array if shape else array[()])  # a number is passed as an expression, not as an array of one
        input_specs.append(TensorSpec(name, shape))
        input_count += math.prod(shape)
    try:
        with _PAUSED_COLLECTOR:
            returned = function(*arguments)
            if not isinstance(returned, tuple):
                returned = (returned,)
            output_specs: list[TensorSpec] = []
            results: list[Expr] = []
            for name, result in zip(outputs, returned, strict=True):
                array = np.asarray(result, object)
                output_specs.append(TensorSpec(name, array.shape))
                results += map(owner.lift, array.reshape(-1))
            return build(results, tuple(input_specs), tuple(output_specs))
    finally:
        owner.forget()


class _PausedCollector:
    """Pause of the cyclic garbage collector while any thread traces.

    The collector would take up to a quarter of the time without freeing anything.
    The first trace disables it, and the last one enables it again if it was enabled before.
    """

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.traces = 0  # number of traces that run now
        self.was_enabled = False
        if hasattr(os, "register_at_fork"):
            os.register_at_fork(after_in_child=self._end_traces_of_other_threads)

    def __enter__(self) -> None:
        with self.lock:
            if self.traces == 0:
                self.was_enabled = gc.isenabled()
                gc.disable()
            self.traces += 1

    def __exit__(self, *_exception: object) -> None:
        with self.lock:
            self.traces = max(self.traces - 1, 0)
            if self.traces == 0 and self.was_enabled:
                gc.enable()

    def _end_traces_of_other_threads(self) -> None:
        """End all traces in a forked process, which has only the thread that forked."""
        self.lock = threading.Lock()  # another thread may have held the old one
        if self.traces and self.was_enabled:
            gc.enable()
        self.traces = 0


_PAUSED_COLLECTOR = _PausedCollector()
