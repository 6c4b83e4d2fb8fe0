"""Equations as a Python module that needs NumPy only."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .printed_code import FUNCTIONS, Routine, constants, header, ordered_names, routine
from .source_expression import written

if TYPE_CHECKING:
    from .equations import Equations


def numpy_source(equations: Equations) -> str:
    """The Python module."""
    names = ordered_names(equations)
    values = {s: p.value for s, p in zip(equations.values, equations.parameters, strict=True)}
    symbols = constants(equations)
    parts = ['"""' + "\n".join(header(equations)).replace("\\", "").replace('"', "'") + '\n"""\n\nimport numpy as np\n']
    if all(s in values for s in symbols):
        rows = [f"    {s.name!r}: {float(values[s])!r}," for s in symbols]
        parts.append("\n".join(["PARAMETERS = {", *rows, "}\n"]))
    else:
        parts.append(f"# parameters = {{{', '.join(f'{s.name!r}: …' for s in symbols)}}}\n")
    parts += [_numpy_function(equations, routine(equations, name, names)) for name in FUNCTIONS]
    return "\n".join(parts)


def _numpy_function(equations: Equations, made: Routine) -> str:
    arrays, letter, axes, meaning = FUNCTIONS[made.name]
    n = len(equations.q)
    shape = ", ".join([str(n)] * axes)
    symbols = constants(equations)
    known = len(symbols) == len(equations.parameters)
    lines = [f"\ndef {made.name}({', '.join(arrays)}, parameters{'=PARAMETERS' if known else ''}):"]
    ins = ", ".join(f"{a} (..., {n})" for a in arrays)
    lines.append(f'    """{meaning}; {ins} -> (..., {shape})."""')
    lines.append(
        f"    {', '.join(arrays)}{',' if len(arrays) == 1 else ''} = (np.asarray(x, float) for x in ({', '.join(arrays)},))"
    )
    for name in arrays:
        wanted = f'f"{name} has shape {{{name}.shape}}, wanted (..., {n})"'
        lines += [f"    if {name}.shape[-1:] != ({n},):", f"        raise ValueError({wanted})"]
    for array, k, name in made.inputs:
        lines.append(
            f"    {name} = parameters[{symbols[k].name!r}]" if array == "p" else f"    {name} = {array}[..., {k}]"
        )
    lines += [f"    {name} = {written(expr, _NUMPY)}" for name, expr in made.lines]
    batch = ", ".join(f"{a}.shape[:-1]" for a in arrays)
    lines.append(f"    {letter} = np.zeros((*np.broadcast_shapes({batch}), {shape}))")
    for place, expr in zip(np.ndindex((n,) * axes), made.results, strict=True):
        if expr != 0:
            lines.append(f"    {letter}[..., {', '.join(map(str, place))}] = {written(expr, _NUMPY)}")
    lines.append(f"    return {letter}\n")
    return "\n".join(lines)


_NUMPY = {
    **{
        name: f"np.{name}({{}})" for name in ("sin", "cos", "tan", "sinh", "cosh", "tanh", "exp", "log", "sqrt", "sign")
    },
    **{f"a{name}": f"np.arc{name}({{}})" for name in ("sin", "cos", "tan", "sinh", "cosh", "tanh")},
    "atan2": "np.arctan2({}, {})",
    "Abs": "np.abs({})",
    "pow": "np.power({}, {})",
}
