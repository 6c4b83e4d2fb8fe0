"""Interpreter of programs, for arrays of NumPy, JAX and PyTorch, and for symbols of CasADi.

Fused products are rounded twice, so results agree with those of compiled programs up to rounding errors, not to the bit.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from ..ir.program import FUSED, Program

Functions = Mapping[str, Callable[..., Any]]
"""Function that computes each operation, by name of the operation."""


def functions_of(namespace: Any, where: Callable[[Any, Any, Any], Any]) -> Functions:
    """Functions for the arrays of a package, from its sqrt, sin, cos, exp and sign.

    ``where(condition, a, b)`` selects a where the condition holds, and b elsewhere.
    """
    return {
        "add": operator.add, "sub": operator.sub, "mul": operator.mul, "div": _quotient, "neg": operator.neg,
        "sqrt": namespace.sqrt, "sin": namespace.sin, "cos": namespace.cos, "exp": namespace.exp, "sign": namespace.sign,
        "min": lambda a, b: where(a < b, a, b), "max": lambda a, b: where(a > b, a, b),
        **{op: _fused_product(*signs) for op, signs in FUSED.items()},
    }  # fmt: skip


def _quotient(a: Any, b: Any) -> Any:
    """Quotient; for two constants, infinity or NaN in place of Python's exception for a zero divisor."""
    if isinstance(a, float) and isinstance(b, float):
        return float(np.divide(a, b))
    return a / b


def _fused_product(product_sign: int, addend_sign: int) -> Callable[..., Any]:
    """Function of a fused product, ± a b ± c, rounded twice."""

    def fused_product(a: Any, b: Any, c: Any) -> Any:
        product = a * b
        if product_sign < 0:
            product = -product
        if addend_sign < 0:
            return product - c
        return product + c

    return fused_product


def evaluated(
    program: Program, elements: Sequence[Any], functions: Functions, spent: Mapping[int, Sequence[int]] | None = None
) -> list[Any]:
    """Elements of all results in C order. ``elements`` are the elements of all inputs in C order.

    ``spent`` lists the values that are no longer used after an instruction, by number of the instruction; they are released.
    """
    values: dict[int, Any] = {}  # by number of the instruction
    if spent is None:
        spent = {}
    for number, (op, args, value) in enumerate(program.instructions):
        if op == "const":
            values[number] = value
        elif op == "input":
            values[number] = elements[int(value)]
        else:
            operands = [values[operand] for operand in args]
            values[number] = functions[op](*operands)
        for spent_number in spent.get(number, ()):
            del values[spent_number]
    return [values[result] for result in program.results]


def batch_shape(arrays: Sequence[Any], program: Program) -> tuple[int, ...]:
    """Broadcast shape of the batch axes. Raises ValueError if they do not broadcast, or are more than NumPy broadcasts."""
    shapes = []
    for array, port in zip(arrays, program.inputs, strict=True):
        batch_axes = array.ndim - len(port.shape)
        shapes.append(array.shape[:batch_axes])
    try:
        return np.broadcast_shapes(*shapes)
    except RuntimeError as too_many_axes:
        raise ValueError(str(too_many_axes)) from None


def last_uses(program: Program) -> dict[int, list[int]]:
    """Values that are no longer used after an instruction, by number of the instruction; results are not among them."""
    last_use: dict[int, int] = {}  # number of the last instruction that uses a value, by number of the value
    for number, instruction in enumerate(program.instructions):
        for operand in instruction.args:
            last_use[operand] = number
    spent: dict[int, list[int]] = {}
    for value in last_use.keys() - set(program.results):
        spent.setdefault(last_use[value], []).append(value)
    return spent
