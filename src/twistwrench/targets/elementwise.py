"""A program on anything that adds and multiplies: arrays of NumPy, JAX and PyTorch, symbols of CasADi.

Fused products round twice here, so results agree with compiled ones to round-off, not to the bit.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from ..program.program import FUSED, Program

Functions = Mapping[str, Callable[..., Any]]
"""What computes each operation."""


def functions_of(namespace: Any, where: Callable[[Any, Any, Any], Any]) -> Functions:
    """The operations in the functions of a package: its sqrt, sin, cos, exp and sign; ``where`` picks by a condition."""
    return {
        "add": operator.add, "sub": operator.sub, "mul": operator.mul, "div": _quotient, "neg": operator.neg,
        **{name: getattr(namespace, name) for name in ("sqrt", "sin", "cos", "exp", "sign")},
        "min": lambda a, b: where(a < b, a, b), "max": lambda a, b: where(a > b, a, b),
        **{op: _fused(*signs) for op, signs in FUSED.items()},
    }  # fmt: skip


def _quotient(a: Any, b: Any) -> Any:
    """Of two constants too, where Python would raise for a divisor of 0."""
    return float(np.divide(a, b)) if isinstance(a, float) and isinstance(b, float) else a / b


def _fused(product: int, addend: int) -> Callable[..., Any]:
    def run(a: Any, b: Any, c: Any) -> Any:
        ab = a * b if product > 0 else -(a * b)
        return ab + c if addend > 0 else ab - c

    return run


def evaluated(
    program: Program, elements: Sequence[Any], functions: Functions, spent: Mapping[int, Sequence[int]] | None = None
) -> list[Any]:
    """The elements of all results, in C order, from those of all inputs; values are let go of as ``spent`` says."""
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
    """The shape that the axes before the program's own broadcast to; raises ValueError where they do not."""
    return np.broadcast_shapes(*(a.shape[: a.ndim - len(p.shape)] for a, p in zip(arrays, program.inputs, strict=True)))


def last_uses(program: Program) -> dict[int, list[int]]:
    """After which instruction which values are not needed any more, so that memory stays bounded."""
    last = {a: k for k, i in enumerate(program.instructions) for a in i.args}
    kept = set(program.results)
    found: dict[int, list[int]] = {}
    for number, k in last.items():
        if number not in kept:
            found.setdefault(k, []).append(number)
    return found
