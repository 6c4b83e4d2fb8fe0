"""Quantities as JavaScript functions, in an ES module that uses only Math, one operation a line."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ...compiler.ir.program import FUSED, Program, TensorSpec
from ...compiler.lowering.reference_interpreter import evaluated
from ...compiler.printers.c99 import identifier
from .request import BridgedQuantity, element_names

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
    elements = element_names(names, program.inputs)
    copies = " ".join(elements).translate(_TO_UNDERSCORES).split()  # q[3] to q_3_
    # Inputs are copied before outputs are written, which may be the same arrays.
    lines = [f"const {copies[k]} = {elements[k]};" for k in _read_elements(program)]
    values = evaluated(program, copies, _functions(lines))  # adds a line for each operation
    arrays = [f"new Float64Array({port.size})" for port in program.outputs]
    if len(results) == 1:
        targets, (default,) = element_names(["out"], program.outputs), arrays
    else:
        targets = element_names([f"out.{name}" for name in results], program.outputs)
        entries = map(": ".join, zip(results, arrays, strict=True))
        default = f"{{ {', '.join(entries)} }}"
    for target, value in zip(targets, values, strict=True):
        lines.append(f"{target} = {_number(value)};")
    shapes = f"{_shapes_text(names, program.inputs)} to {_shapes_text(results, program.outputs)}"
    model_name = " ".join(quantity.engine.model.name.split())
    arguments = ", ".join([*names, f"out = {default}"])
    head = f"// {quantity.name} of {model_name}: {shapes}; SI units.\nexport function {_name(quantity.name)}({arguments}) {{\n"
    body = "".join(f"  {line}\n" for line in lines)
    return f"{head}{body}  return out;\n}}\n"


_TO_UNDERSCORES = str.maketrans("[]", "__")


def _read_elements(program: Program) -> list[int]:
    """Numbers of the elements of all inputs that the program reads, ascending."""
    numbers = {int(instruction.value) for instruction in program.instructions if instruction.op == "input"}
    return sorted(numbers)


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

    functions = {
        "add": local("{0} + {1}"), "sub": local("{0} - {1}"), "mul": local("{0} * {1}"), "div": local("{0} / {1}"),
        "neg": local("-{0}"), "min": local("{0} < {1} ? {0} : {1}"), "max": local("{0} > {1} ? {0} : {1}"),
    }  # fmt: skip
    for name in ("sqrt", "sin", "cos", "exp", "sign"):
        functions[name] = local(f"Math.{name}({{0}})")
    for op, (product_sign, sum_sign) in FUSED.items():
        product = "({0} * {1})" if product_sign > 0 else "-({0} * {1})"
        sign = "+" if sum_sign > 0 else "-"
        functions[op] = local(f"{product} {sign} {{2}}")
    return functions


def _number(value: Any) -> str:
    """Names are unchanged; constants are written with enough digits to read back exactly."""
    if isinstance(value, str):
        return value
    number = repr(float(value))
    return f"({number})" if value < 0 else number


def _name(text: str) -> str:
    name = identifier(text)
    if name in _RESERVED or not name or name[0].isdigit():
        return f"{name}_"
    return name
