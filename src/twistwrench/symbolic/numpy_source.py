"""Equations as a Python module that needs only NumPy."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .source_code import FUNCTIONS, Routine, constants, expression_text, header, ordered_names, routine

if TYPE_CHECKING:
    from .equations import Equations


def numpy_source(equations: Equations) -> str:
    """Text of the Python module."""
    names = ordered_names(equations)
    values = equations.values
    symbols = constants(equations)
    docstring = "\n".join(header(equations)).replace("\\", "").replace('"', "'")
    parts = [f'"""{docstring}\n"""\n\nimport numpy as np\n']
    all_have_values = values.keys() >= set(symbols)
    if all_have_values:
        entry_lines = [f"    {symbol.name!r}: {float(values[symbol])!r}," for symbol in symbols]
        parts.append("\n".join(["PARAMETERS = {", *entry_lines, "}\n"]))
    else:
        entries_text = ", ".join(f"{symbol.name!r}: …" for symbol in symbols)
        parts.append(f"# parameters = {{{entries_text}}}\n")
    parts += [_numpy_function(equations, routine(equations, name, names)) for name in FUNCTIONS]
    return "\n".join(parts)


def _numpy_function(equations: Equations, function: Routine) -> str:
    """Text of one function, which reads its arrays, evaluates intermediate results, and fills the array of results."""
    arrays, result_name, axis_count, meaning = FUNCTIONS[function.name]  # axes have n entries each
    n = len(equations.q)
    symbols = constants(equations)
    result_shape = ", ".join([str(n)] * axis_count)
    default = "=PARAMETERS" if len(symbols) == len(equations.parameters) else ""
    input_shapes = []
    batch_shapes = []
    for array in arrays:
        input_shapes.append(f"{array} (..., {n})")
        batch_shapes.append(f"{array}.shape[:-1]")
    targets = ", ".join(arrays)
    if len(arrays) == 1:
        targets += ","  # unpack a tuple of one
    lines = [
        f"\ndef {function.name}({', '.join(arrays)}, parameters{default}):",
        f'    """{meaning}; {", ".join(input_shapes)} -> (..., {result_shape})."""',
        f"    {targets} = (np.asarray(x, float) for x in ({', '.join(arrays)},))",
    ]
    for array in arrays:
        message = f'f"{array} has shape {{{array}.shape}}, wanted (..., {n})"'
        lines += [f"    if {array}.shape[-1:] != ({n},):", f"        raise ValueError({message})"]
    for array, index, name in function.inputs:
        if array == "p":  # a parameter
            lines.append(f"    {name} = parameters[{symbols[index].name!r}]")
        else:
            lines.append(f"    {name} = {array}[..., {index}]")
    for name, expr in function.lines:
        lines.append(f"    {name} = {expression_text(expr, _NUMPY_PATTERNS)}")
    lines.append(f"    {result_name} = np.zeros((*np.broadcast_shapes({', '.join(batch_shapes)}), {result_shape}))")
    for indices, expr in zip(np.ndindex((n,) * axis_count), function.results, strict=True):
        if expr != 0:  # the array is filled with zeros already
            index_text = ", ".join(map(str, indices))
            lines.append(f"    {result_name}[..., {index_text}] = {expression_text(expr, _NUMPY_PATTERNS)}")
    lines.append(f"    return {result_name}\n")
    return "\n".join(lines)


_NUMPY_PATTERNS = {
    "sin": "np.sin({})", "cos": "np.cos({})", "tan": "np.tan({})",
    "sinh": "np.sinh({})", "cosh": "np.cosh({})", "tanh": "np.tanh({})",
    "exp": "np.exp({})", "log": "np.log({})", "sqrt": "np.sqrt({})", "sign": "np.sign({})",
    "asin": "np.arcsin({})", "acos": "np.arccos({})", "atan": "np.arctan({})",
    "asinh": "np.arcsinh({})", "acosh": "np.arccosh({})", "atanh": "np.arctanh({})",
    "atan2": "np.arctan2({}, {})",
    "Abs": "np.abs({})",
    "pow": "np.power({}, {})",
}  # fmt: skip
"""NumPy's spelling of each function of SymPy."""
