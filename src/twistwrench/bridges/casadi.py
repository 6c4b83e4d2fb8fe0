"""A quantity as a function of CasADi: the program in symbols, which CasADi differentiates and generates code from."""

from __future__ import annotations

from typing import Any

from ..errors import MissingExtraError
from ..program.port import Port
from ..targets.c import identifier
from ..targets.elementwise import evaluated, functions_of
from .quantity import BridgedQuantity


def casadi_function(quantity: BridgedQuantity) -> Any:
    """A ``casadi.Function`` of columns; a result of more than two axes has its first as rows. Raises MissingExtraError."""
    try:
        import casadi
    except ImportError:
        raise MissingExtraError.of("casadi", "casadi", "robot.to_casadi") from None
    program = quantity.program
    symbols = [casadi.SX.sym(port.name, max(port.size, 0)) for port in program.inputs]
    elements = [symbol[k] for symbol, port in zip(symbols, program.inputs, strict=True) for k in range(port.size)]
    found = iter(evaluated(program, elements, functions_of(casadi, casadi.if_else)))
    results = [_matrix(casadi, [next(found) for _ in range(port.size)], port) for port in program.outputs]
    labels = [[identifier(port.name) for port in ports] for ports in (program.inputs, program.outputs)]
    names_out = [f"{name}_out" if name in labels[0] else name for name in labels[1]]
    return casadi.Function(identifier(quantity.name), symbols, results, labels[0], names_out)


def _matrix(casadi: Any, elements: list[Any], port: Port) -> Any:
    """The elements, in C order, as CasADi has them: a column, or rows."""
    rows = port.shape[0] if port.shape else 1
    columns = port.size // rows if rows else 0
    whole = casadi.SX.zeros(rows, columns)
    for k, element in enumerate(elements):
        whole[k // columns, k % columns] = element
    return whole
