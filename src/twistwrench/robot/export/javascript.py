"""Quantities as JavaScript functions, in an ES module that uses only Math, one operation a line; and as CasADi functions."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice
from typing import Any

from ...compiler.ir.program import FUSED, TensorSpec
from ...compiler.lowering.reference_interpreter import evaluated, functions_of
from ...compiler.printers.c99 import identifier
from ...core.errors import MissingExtraError
from .request import BridgedQuantity

_RESERVED = frozenset([
    "arguments", "await", "break", "case", "catch", "class", "const", "continue", "debugger", "default", "delete",
    "do", "else", "enum", "eval", "export", "extends", "false", "finally", "for", "function", "if", "implements",
    "import", "in", "instanceof", "interface", "let", "new", "null", "package", "private", "protected", "public",
    "return", "static", "super", "switch", "this", "throw", "true", "try", "typeof", "var", "void", "while", "with",
    "yield", "Math", "out",
])  # fmt: skip


def javascript_module(quantity: BridgedQuantity) -> str:
    """Text of the module: a function of arrays of numbers, matrices flat in C order, that fills and returns ``out``."""
    program = quantity.program
    names = [_name(port.name) for port in program.inputs]
    results = [_name(port.name) for port in program.outputs]
    elements = _elements(names, program.inputs)
    copies = [f"{element[:-1].replace('[', '_')}_" for element in elements]
    numbers = sorted({int(i.value) for i in program.instructions if i.op == "input"})
    lines = [f"const {copies[k]} = {elements[k]};" for k in numbers]  # inputs are read before outputs are written
    values = evaluated(program, copies, _functions(lines))
    if len(results) == 1:
        targets = _elements(["out"], program.outputs)
        default = f"new Float64Array({program.outputs[0].size})"
    else:
        targets = _elements([f"out.{name}" for name in results], program.outputs)
        arrays = [f"{name}: new Float64Array({p.size})" for name, p in zip(results, program.outputs, strict=True)]
        default = f"{{ {', '.join(arrays)} }}"
    for target, value in zip(targets, values, strict=True):
        lines.append(f"{target} = {_number(value)};")
    shapes = f"{_shapes_text(names, program.inputs)} to {_shapes_text(results, program.outputs)}"
    return "\n".join(
        [
            f"// {quantity.name} of {' '.join(quantity.engine.model.name.split())}: {shapes}; SI units.",
            f"export function {_name(quantity.name)}({', '.join([*names, f'out = {default}'])}) {{",
            *(f"  {line}" for line in lines),
            "  return out;",
            "}",
            "",
        ]
    )


def _elements(names: Sequence[str], ports: Sequence[TensorSpec]) -> list[str]:
    """Elements of arrays, one after the other."""
    return [f"{name}[{k}]" for name, port in zip(names, ports, strict=True) for k in range(port.size)]


def _shapes_text(names: Sequence[str], ports: Sequence[TensorSpec]) -> str:
    return ", ".join(f"{name} {list(port.shape)}" for name, port in zip(names, ports, strict=True))


def _functions(lines: list[str]) -> dict[str, Any]:
    """Functions that write an operation: each adds a line and returns the name of its result."""

    def local(pattern: str) -> Any:
        def run(*operands: Any) -> str:
            name = f"t{len(lines)}"
            lines.append(f"const {name} = {pattern.format(*map(_number, operands))};")
            return name

        return run

    return {
        "add": local("{0} + {1}"), "sub": local("{0} - {1}"), "mul": local("{0} * {1}"), "div": local("{0} / {1}"),
        "neg": local("-{0}"), "min": local("{0} < {1} ? {0} : {1}"), "max": local("{0} > {1} ? {0} : {1}"),
        **{name: local(f"Math.{name}({{0}})") for name in ("sqrt", "sin", "cos", "exp", "sign")},
        **{op: local(f"{'' if a > 0 else '-'}({{0}} * {{1}}) {'+' if b > 0 else '-'} {{2}}") for op, (a, b) in FUSED.items()},
    }  # fmt: skip


def _number(value: Any) -> str:
    """Names are unchanged; constants are written with enough digits to read back exactly."""
    if isinstance(value, str):
        return value
    return f"({float(value)!r})" if value < 0 else repr(float(value))


def _name(text: str) -> str:
    name = identifier(text)
    return f"{name}_" if name in _RESERVED or not name or name[0].isdigit() else name


# ── A quantity as a CasADi function: the program in CasADi symbols, for its derivatives and code generation


def casadi_function(quantity: BridgedQuantity) -> Any:
    """A ``casadi.Function`` of columns; results of more than two axes are flattened to rows of the first axis.

    Raises MissingExtraError.
    """
    try:
        import casadi
    except ImportError:
        raise MissingExtraError.from_extra("casadi", "casadi", "robot.to_casadi") from None
    program = quantity.program
    symbols = [casadi.SX.sym(port.name, max(port.size, 0)) for port in program.inputs]
    elements = [symbol[k] for symbol, port in zip(symbols, program.inputs, strict=True) for k in range(port.size)]
    values = iter(evaluated(program, elements, functions_of(casadi, casadi.if_else)))
    results = [_matrix(casadi, list(islice(values, port.size)), port) for port in program.outputs]
    input_names = [identifier(port.name) for port in program.inputs]
    output_names = [identifier(port.name) for port in program.outputs]
    output_names = [f"{name}_out" if name in input_names else name for name in output_names]
    return casadi.Function(identifier(quantity.name), symbols, results, input_names, output_names)


def _matrix(casadi: Any, elements: list[Any], port: TensorSpec) -> Any:
    """CasADi matrix of elements in C order: a column, or rows."""
    rows = port.shape[0] if port.shape else 1
    columns = port.size // rows if rows else 0
    whole = casadi.SX.zeros(rows, columns)
    for k, element in enumerate(elements):
        whole[k // columns, k % columns] = element
    return whole
