"""Equations as C99: functions of plain arrays, no allocation, nothing but math.h.

:mod:`..targets.c` prints recorded programs, one operation a line under a number, with the bits of the kernels. Equations are
printed here as they are read: a formula a line under its own names, which no program keeps.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

from ..core.arguments import visible
from ..errors import ValueRangeError
from .printed_code import FUNCTIONS, Routine, constants, header, ordered_names, routine, unused
from .source_expression import written

if TYPE_CHECKING:
    from .equations import Equations


def c_source(equations: Equations, prefix: str | None = None) -> str:
    """One file. ``prefix`` begins the names of its functions; without it, the name of the robot.

    Raises ValueRangeError for a prefix that is no C identifier, and for functions that math.h does not have.
    """
    if prefix is None:
        prefix = re.sub(r"\W", "_", equations.name, flags=re.ASCII)
        prefix = prefix if re.match(r"[A-Za-z]", prefix) else f"robot_{prefix}"
    if not isinstance(prefix, str) or not re.fullmatch(r"[A-Za-z]\w*", prefix, flags=re.ASCII):
        raise ValueRangeError(f"prefix={prefix!r} cannot begin a name in C. Use letters, digits and underscores.")
    names, symbols = ordered_names(equations), constants(equations)
    n = len(equations.q)
    about = [*header(equations)]
    if symbols:
        about.append(f"p = ({', '.join(s.name for s in symbols)})")
    comment = "\n".join(
        f" * {line}" for line in visible("\n".join(about)).replace("*/", "* /").replace("/*", "/ *").splitlines()
    )
    parts = [f"/*\n{comment}\n * Matrices are stored row by row.\n */", "#include <math.h>"]
    signatures = {name: _signature(name, prefix, n, len(symbols)) for name in FUNCTIONS}
    parts.append("\n".join(f"{signature};" for signature in signatures.values()))
    values = {s: p.value for s, p in zip(equations.values, equations.parameters, strict=True)}
    if symbols and all(s in values for s in symbols):
        rows = "\n".join(f"    {float(values[s])!r}, /* {s.name} */" for s in symbols)
        parts.append(
            f"extern const double {prefix}_parameters[{len(symbols)}];\n"
            f"const double {prefix}_parameters[{len(symbols)}] = {{\n{rows}\n}};"
        )
    parts += [_function(routine(equations, name, names), signatures[name], n, bool(symbols)) for name in FUNCTIONS]
    return "\n\n".join(parts) + "\n"


def _signature(name: str, prefix: str, n: int, parameters: int) -> str:
    arrays, letter, axes, _ = FUNCTIONS[name]
    inputs = [f"const double {a}[{n}]" for a in arrays]
    inputs += [f"const double p[{parameters}]"] if parameters else []
    return f"void {prefix}_{name}({', '.join(inputs)}, double {letter}[{n**axes}])"


def _function(made: Routine, signature: str, n: int, has_parameters: bool) -> str:
    arrays, letter, axes, meaning = FUNCTIONS[made.name]
    lines = [f"/* {meaning}. */", signature, "{"]
    lines += [f"    (void){name};" for name in unused((*arrays, *(["p"] if has_parameters else [])), made)]
    lines += [f"    const double {name} = {array}[{k}];" for array, k, name in made.inputs]
    lines += [f"    const double {name} = {written(expr, _C)};" for name, expr in made.lines]
    for k, (_, expr) in enumerate(zip(np.ndindex((n,) * axes), made.results, strict=True)):
        lines.append(f"    {letter}[{k}] = {written(expr, _C)};")
    return "\n".join([*lines, "}"])


_C = {
    **{name: f"{name}({{}})" for name in ("sin", "cos", "tan", "sinh", "cosh", "tanh", "exp", "log", "sqrt")},
    **{f"a{name}": f"a{name}({{}})" for name in ("sin", "cos", "tan", "sinh", "cosh", "tanh")},
    "atan2": "atan2({}, {})",
    "Abs": "fabs({})",
    "sign": "(double)((({0}) > 0.0) - (({0}) < 0.0))",
    "pow": "pow({}, {})",
}
