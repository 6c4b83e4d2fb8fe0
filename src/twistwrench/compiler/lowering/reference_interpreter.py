"""Programs evaluated on arrays of NumPy, JAX and PyTorch, and on symbols of CasADi.

Fused products round twice here, so results agree with compiled ones up to rounding errors, not to the bit.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from ..ir.program import FUSED, Program

Functions = Mapping[str, Callable[..., Any]]
"""Functions that compute each operation, by name."""


def functions_of(namespace: Any, where: Callable[[Any, Any, Any], Any]) -> Functions:
    """Operations as functions of a package, from its sqrt, sin, cos, exp and sign; ``where`` selects by a condition."""
    return {
        "add": operator.add, "sub": operator.sub, "mul": operator.mul, "div": _quotient, "neg": operator.neg,
        "sqrt": namespace.sqrt, "sin": namespace.sin, "cos": namespace.cos, "exp": namespace.exp, "sign": namespace.sign,
        "min": lambda a, b: where(a < b, a, b), "max": lambda a, b: where(a > b, a, b),
        **{op: _fused_product(*signs) for op, signs in FUSED.items()},
    }  # fmt: skip


def _quotient(a: Any, b: Any) -> Any:
    """Quotient; for two constants, without Python's exception for a zero divisor."""
    if isinstance(a, float) and isinstance(b, float):
        return float(np.divide(a, b))
    return a / b


def _fused_product(product_sign: int, addend_sign: int) -> Callable[..., Any]:
    """Function of a fused product, ± a b ± c, rounded twice."""

    def run(a: Any, b: Any, c: Any) -> Any:
        product = a * b
        if product_sign < 0:
            product = -product
        if addend_sign < 0:
            return product - c
        return product + c

    return run


def evaluated(
    program: Program, elements: Sequence[Any], functions: Functions, spent: Mapping[int, Sequence[int]] | None = None
) -> list[Any]:
    """Elements of all results in C order from those of all inputs; ``spent`` lists values to release after each instruction."""
    values: dict[int, Any] = {}
    spent = spent or {}
    for number, (op, args, value) in enumerate(program.instructions):
        if op == "const":
            values[number] = value
        elif op == "input":
            values[number] = elements[int(value)]
        else:
            values[number] = functions[op](*(values[a] for a in args))
        for done in spent.get(number, ()):
            del values[done]
    return [values[result] for result in program.results]


def batch_shape(arrays: Sequence[Any], program: Program) -> tuple[int, ...]:
    """Broadcast shape of the batch axes. Raises ValueError if they do not broadcast."""
    batches = [a.shape[: a.ndim - len(port.shape)] for a, port in zip(arrays, program.inputs, strict=True)]
    return np.broadcast_shapes(*batches)


def last_uses(program: Program) -> dict[int, list[int]]:
    """Values whose last use is in each instruction, to be released after it."""
    last_use: dict[int, int] = {}
    for number, instruction in enumerate(program.instructions):
        last_use |= dict.fromkeys(instruction.args, number)
    released: dict[int, list[int]] = {}
    for value in last_use.keys() - set(program.results):
        released.setdefault(last_use[value], []).append(value)
    return released
