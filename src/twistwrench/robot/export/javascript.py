"""Quantities as JavaScript functions: ES modules that use only Math, with one operation per line."""

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
    """Text of a module with one function, which takes arrays (matrices flat in C order), and fills and returns ``out``."""
    program = quantity.program
    inputs = [_name(port.name) for port in program.inputs]
    outputs = [_name(port.name) for port in program.outputs]
    input_elements = element_names(inputs, program.inputs)
    copies = [element.translate(_BRACKETS_TO_UNDERSCORES) for element in input_elements]  # q[3] to q_3_
    # Inputs are copied before outputs are written, since they may be the same arrays.
    lines = [f"const {copies[k]} = {input_elements[k]};" for k in _read_elements(program)]
    results = evaluated(program, copies, _line_writers(lines))  # a text for each result; adds a line for each operation
    new_arrays = [f"new Float64Array({port.size})" for port in program.outputs]
    if len(outputs) == 1:
        output_elements = element_names(["out"], program.outputs)
        default = new_arrays[0]
    else:
        output_elements = element_names([f"out.{name}" for name in outputs], program.outputs)
        entries = [f"{name}: {array}" for name, array in zip(outputs, new_arrays, strict=True)]
        default = f"{{ {', '.join(entries)} }}"
    for element, result in zip(output_elements, results, strict=True):
        lines.append(f"{element} = {_number(result)};")
    shapes_text = f"{_shapes_text(inputs, program.inputs)} to {_shapes_text(outputs, program.outputs)}"
    model_name = " ".join(quantity.engine.model.name.split())  # in one line
    parameters = ", ".join([*inputs, f"out = {default}"])
    comment = f"// {quantity.name} of {model_name}: {shapes_text}; SI units.\n"
    signature = f"export function {_name(quantity.name)}({parameters}) {{\n"
    body = "".join(f"  {line}\n" for line in lines)
    return f"{comment}{signature}{body}  return out;\n}}\n"


_BRACKETS_TO_UNDERSCORES = str.maketrans("[]", "__")


def _read_elements(program: Program) -> list[int]:
    """Sorted indices of the input elements that the program reads, counted over all inputs."""
    indices = {int(instruction.value) for instruction in program.instructions if instruction.op == "input"}
    return sorted(indices)


def _shapes_text(names: Sequence[str], ports: Sequence[TensorSpec]) -> str:
    """Names with shapes, ``q [6], dq [6]``."""
    return ", ".join(f"{name} {list(port.shape)}" for name, port in zip(names, ports, strict=True))


def _line_writers(lines: list[str]) -> dict[str, Any]:
    """Function for each operation, which writes the operation as a line and returns the name of the result."""

    def operation(pattern: str) -> Any:
        def write(*operands: Any) -> str:
            name = f"t{len(lines)}"
            expression = pattern.format(*map(_number, operands))
            lines.append(f"const {name} = {expression};")
            return name

        return write

    functions = {
        "add": operation("{0} + {1}"),
        "sub": operation("{0} - {1}"),
        "mul": operation("{0} * {1}"),
        "div": operation("{0} / {1}"),
        "neg": operation("-{0}"),
        "min": operation("{0} < {1} ? {0} : {1}"),
        "max": operation("{0} > {1} ? {0} : {1}"),
    }
    for name in ("sqrt", "sin", "cos", "exp", "sign"):
        functions[name] = operation(f"Math.{name}({{0}})")
    for op, (product_sign, sum_sign) in FUSED.items():
        product = "({0} * {1})" if product_sign > 0 else "-({0} * {1})"
        sign = "+" if sum_sign > 0 else "-"
        functions[op] = operation(f"{product} {sign} {{2}}")
    return functions


def _number(operand: Any) -> str:
    """Text of an operand: a name as it is, or a constant with enough digits to read back exactly."""
    if isinstance(operand, str):
        return operand
    number = repr(float(operand))
    return f"({number})" if operand < 0 else number  # in -(-1), as --1 would be a decrement


def _name(text: str) -> str:
    """Valid name for a JavaScript variable."""
    name = identifier(text)
    if name in _RESERVED or not name or name[0].isdigit():
        return f"{name}_"
    return name
