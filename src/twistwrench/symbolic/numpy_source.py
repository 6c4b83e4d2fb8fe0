"""Equations as a Python module that needs only NumPy."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .source_code import FUNCTIONS, WAVES, Routine, constants, expression_text, header, ordered_names, routine

if TYPE_CHECKING:
    from .equations import Equations


def numpy_source(equations: Equations) -> str:
    """Text of the Python module."""
    names = ordered_names(equations)
    values, symbols = equations.values, constants(equations)
    docstring = "\n".join(header(equations)).replace("\\", "").replace('"', "'")
    parts = [f'"""{docstring}\n"""\n\nimport numpy as np\n']
    if values.keys() >= set(symbols):
        rows = [f"    {symbol.name!r}: {float(values[symbol])!r}," for symbol in symbols]
        parts.append("\n".join(["PARAMETERS = {", *rows, "}\n"]))
    else:
        items = ", ".join(f"{symbol.name!r}: …" for symbol in symbols)
        parts.append(f"# parameters = {{{items}}}\n")
    parts += [_numpy_function(equations, routine(equations, name, names)) for name in FUNCTIONS]
    return "\n".join(parts)


def _numpy_function(equations: Equations, function: Routine) -> str:
    arrays, letter, axes, meaning = FUNCTIONS[function.name]
    n, symbols = len(equations.q), constants(equations)
    result_shape = ", ".join([str(n)] * axes)
    default = "=PARAMETERS" if len(symbols) == len(equations.parameters) else ""
    input_shapes = ", ".join(f"{array} (..., {n})" for array in arrays)
    targets = ", ".join(arrays)
    if len(arrays) == 1:
        targets += ","
    batch_shapes = ", ".join(f"{array}.shape[:-1]" for array in arrays)
    lines = [
        f"\ndef {function.name}({', '.join(arrays)}, parameters{default}):",
        f'    """{meaning}; {input_shapes} -> (..., {result_shape})."""',
        f"    {targets} = (np.asarray(x, float) for x in ({', '.join(arrays)},))",
    ]
    for name in arrays:
        message = f'f"{name} has shape {{{name}.shape}}, wanted (..., {n})"'
        lines += [f"    if {name}.shape[-1:] != ({n},):", f"        raise ValueError({message})"]
    for array, k, name in function.inputs:
        if array == "p":
            lines.append(f"    {name} = parameters[{symbols[k].name!r}]")
        else:
            lines.append(f"    {name} = {array}[..., {k}]")
    for name, expr in function.lines:
        lines.append(f"    {name} = {expression_text(expr, _NUMPY)}")
    lines.append(f"    {letter} = np.zeros((*np.broadcast_shapes({batch_shapes}), {result_shape}))")
    for place, expr in zip(np.ndindex((n,) * axes), function.results, strict=True):
        if expr != 0:
            lines.append(f"    {letter}[..., {', '.join(map(str, place))}] = {expression_text(expr, _NUMPY)}")
    lines.append(f"    return {letter}\n")
    return "\n".join(lines)


_NUMPY = {
    **{name: f"np.{name}({{}})" for name in (*WAVES, "exp", "log", "sqrt", "sign")},
    **{f"a{name}": f"np.arc{name}({{}})" for name in WAVES},
    "atan2": "np.arctan2({}, {})",
    "Abs": "np.abs({})",
    "pow": "np.power({}, {})",
}
