"""A quantity as a CasADi function: the program in CasADi symbols, for its derivatives and code generation."""

from __future__ import annotations

from itertools import islice
from typing import Any

from ...compiler.ir.program import TensorSpec
from ...compiler.lowering.reference_interpreter import evaluated, functions_of
from ...compiler.printers.c99 import identifier
from ...core.errors import MissingExtraError
from .request import BridgedQuantity


def casadi_function(quantity: BridgedQuantity) -> Any:
    """A ``casadi.Function`` of columns; results of more than two axes are flattened to rows of the first axis.

    Raises MissingExtraError.
    """
    try:
        import casadi
    except ImportError:
        raise MissingExtraError.from_extra("casadi", "casadi", "robot.to_casadi") from None
    program = quantity.program
    symbols = [casadi.SX.sym(port.name, port.size) for port in program.inputs]
    elements = []
    for symbol, port in zip(symbols, program.inputs, strict=True):
        elements += [symbol[k] for k in range(port.size)]
    values = iter(evaluated(program, elements, functions_of(casadi, casadi.if_else)))
    results = [_matrix(casadi, list(islice(values, port.size)), port) for port in program.outputs]
    input_names = list(map(identifier, quantity.input_names))
    output_names = []
    for port in program.outputs:
        name = identifier(port.name)
        output_names.append(f"{name}_out" if name in input_names else name)
    return casadi.Function(identifier(quantity.name), symbols, results, input_names, output_names)


def _matrix(casadi: Any, elements: list[Any], port: TensorSpec) -> Any:
    """CasADi matrix of elements in C order: a column, or rows."""
    rows, *_ = port.shape or (1,)
    columns = port.size // max(rows, 1)
    matrix = casadi.SX.zeros(rows, columns)
    for k, element in enumerate(elements):
        matrix[k // columns, k % columns] = element
    return matrix
