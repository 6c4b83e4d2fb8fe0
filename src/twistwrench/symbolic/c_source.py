"""Equations as C99: functions of plain arrays, without allocation, that need only math.h."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from ..core.errors import ValueRangeError
from ..core.text import visible
from .names import names_of
from .source_code import (
    FUNCTIONS,
    Routine,
    constants,
    expression_text,
    header,
    ordered_names,
    routine,
    unread_arrays,
)

if TYPE_CHECKING:
    from .equations import Equations

# :mod:`..targets.c` prints recorded programs for machines: one numbered operation a line, with the kernel's results to the last
# bit. This module prints equations for readers: one formula a line, with the names of the equations.


def c_source(equations: Equations, prefix: str | None = None) -> str:
    """C file with names that begin with ``prefix`` or the robot's name.

    Raises ValueRangeError if the prefix is not a C identifier, or for functions that math.h does not have.
    """
    if prefix is None:
        prefix = re.sub(r"\W", "_", equations.name, flags=re.ASCII)
        begins_with_letter = re.match(r"[A-Za-z]", prefix)
        if not begins_with_letter:
            prefix = f"robot_{prefix}"
    if not isinstance(prefix, str) or not re.fullmatch(r"[A-Za-z]\w*", prefix, flags=re.ASCII):
        raise ValueRangeError(f"prefix={prefix!r} cannot begin a name in C. Use letters, digits and underscores.")
    names = ordered_names(equations)
    symbols = constants(equations)
    n = len(equations.q)
    remarks = header(equations)
    if symbols:
        remarks.append(f"p = ({', '.join(names_of(symbols))})")
    remarks_text = visible("\n".join(remarks))
    remarks_text = remarks_text.replace("*/", "* /").replace("/*", "/ *")  # they must not end the comment
    comment = "\n".join(f" * {line}" for line in remarks_text.splitlines())
    blocks = [f"/*\n{comment}\n * Matrices are stored row by row.\n */", "#include <math.h>"]
    signatures = {name: _signature(name, prefix, n, len(symbols)) for name in FUNCTIONS}
    blocks.append("\n".join(f"{signature};" for signature in signatures.values()))
    values = equations.values
    all_have_values = values.keys() >= set(symbols)
    if symbols and all_have_values:
        value_lines = "\n".join(f"    {float(values[symbol])!r}, /* {symbol.name} */" for symbol in symbols)
        array = f"const double {prefix}_parameters[{len(symbols)}]"
        blocks.append(f"extern {array};\n{array} = {{\n{value_lines}\n}};")
    for name, signature in signatures.items():
        function = routine(equations, name, names)
        blocks.append(_function(function, signature, bool(symbols)))
    return "\n\n".join(blocks) + "\n"


def _signature(name: str, prefix: str, n: int, parameter_count: int) -> str:
    """Declaration of a function for n joints: its input arrays, the parameters p if there are any, and the array of results."""
    arrays, result_letter, result_axes, _ = FUNCTIONS[name]
    inputs = [f"const double {array}[{n}]" for array in arrays]
    if parameter_count:
        inputs.append(f"const double p[{parameter_count}]")
    return f"void {prefix}_{name}({', '.join(inputs)}, double {result_letter}[{n**result_axes}])"


def _function(function: Routine, signature: str, has_parameters: bool) -> str:
    """Definition of a function with its comment."""
    arrays, result_letter, _, meaning = FUNCTIONS[function.name]
    if has_parameters:
        arrays = (*arrays, "p")
    lines = [f"/* {meaning}. */", signature, "{"]
    lines += [f"    (void){name};" for name in unread_arrays(arrays, function)]  # no warnings of unused arguments
    for array, index, name in function.inputs:
        lines.append(f"    const double {name} = {array}[{index}];")
    for name, expr in function.lines:
        lines.append(f"    const double {name} = {expression_text(expr, _C)};")
    for index, expr in enumerate(function.results):
        lines.append(f"    {result_letter}[{index}] = {expression_text(expr, _C)};")
    return "\n".join([*lines, "}"])


_C = {
    "sin": "sin({})", "cos": "cos({})", "tan": "tan({})", "sinh": "sinh({})", "cosh": "cosh({})", "tanh": "tanh({})",
    "exp": "exp({})", "log": "log({})", "sqrt": "sqrt({})",
    "asin": "asin({})", "acos": "acos({})", "atan": "atan({})",
    "asinh": "asinh({})", "acosh": "acosh({})", "atanh": "atanh({})",
    "atan2": "atan2({}, {})",
    "Abs": "fabs({})",
    "sign": "(double)((({0}) > 0.0) - (({0}) < 0.0))",
    "pow": "pow({}, {})",
}  # fmt: skip
"""Form of each function in C, with placeholders for its arguments."""
