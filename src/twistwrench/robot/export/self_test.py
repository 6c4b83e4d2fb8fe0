"""Self-test of an export: every function at a few states, compared with kernel results."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...compiler.ir.program import TensorSpec
from ...compiler.printers.c99 import PRECISIONS
from ...core.errors import KernelError
from ...core.gravity import STRENGTH
from ...core.text import argument
from ...core.typing import Array
from .comments import comment
from .request import Request

if TYPE_CHECKING:
    from .. import Robot

STATES = 3

_MARGIN = 16.0
"""Factor on the kernel's rounding error allowed for C, which has other sines and two roundings without fma."""

_EPS = {"double": float(np.finfo(np.float64).eps), "float": float(np.finfo(np.float32).eps)}

_CHECK = """\
/* The largest difference over the largest entry; NaN, which no comparison allows, where a result is not a number. */
static {type} gap(const {type} *found, const {type} *wanted, int n, {type} size)
{{
    {type} worst = {zero};
    for (int k = 0; k < n; k++) {{
        const {type} apart = fabs{f}(found[k] - wanted[k]) / size;
        if (worst >= {zero} && !(apart <= worst)) /* once it is NaN, it stays so */
            worst = apart;
    }}
    return worst;
}}

static int check(const char *what, {type} worst, {type} allowed)
{{
    const int passed = worst <= allowed;
    printf("%s %s: off by %.2g of the largest entry, allowed %.2g\\n", passed ? "ok  " : "FAIL", what,
           (double)worst, (double)allowed);
    return passed;
}}"""


def self_test(robot: Robot, requests: Sequence[Request], stem: str) -> str:
    """Text of the .c file with ``main``: exit status 0 if every function reproduces the kernels' results, else 1.

    Raises KernelError for a quantity that is not finite at the test states.
    """
    precision = requests[0].function.precision
    f = PRECISIONS[precision]
    about = [
        f"Checks {stem}.c: each function at {STATES} states, against the numbers twistwrench has for them.",
        f"Build it together with {stem}.c, and link the mathematical library (-lm).",
        "Exit status 0: all agree to rounding. 1: some do not.",
    ]
    parts = [
        comment(about),
        f'#include "{stem}.h"\n\n#include <math.h>\n#include <stdio.h>',
        _CHECK.format(type=precision, f=f, zero=f"0.0{f}"),
    ]
    calls = []
    for request in requests:
        parts += _test_of(robot, request)
        calls.append(f"    passed &= test_{request.function.name}();")
    parts.append("\n".join(["int main(void)", "{", "    int passed = 1;", *calls, "    return passed ? 0 : 1;", "}"]))
    return "\n\n".join(parts) + "\n"


def _test_of(robot: Robot, request: Request) -> tuple[str, str]:
    """Data and test code of one function."""
    function = request.function
    program, precision = function.program, function.precision
    dtype = np.float32 if precision == "float" else np.float64
    count = len(program.inputs)
    inputs = inputs_at_states(robot, request, dtype)
    expected, tolerances = results_at_states(robot, request, inputs, robot.kernel(request.quantity, **request.options))
    ports = (*program.inputs, *program.outputs)
    tables = [f"{function.name}_{name}" for name in function.parameters]
    numbers = [np.reshape(x, (STATES, port.size)) for port, x in zip(ports, (*inputs, *expected), strict=True)]
    data = "\n".join(_array(table, values, precision) for table, values in zip(tables, numbers, strict=True))
    f = PRECISIONS[precision]
    lines = [f"static int test_{function.name}(void)", "{", "    int passed = 1;"]
    results = function.parameters[count:]
    for name, port in zip(results, program.outputs, strict=True):
        lines += [f"    {precision} {name}[{port.size}];", f"    {precision} worst_{name} = 0.0{f};"]
    arguments = ", ".join([*(f"{table}[k]" for table in tables[:count]), *results])
    lines += [f"    for (int k = 0; k < {STATES}; k++) {{", f"        {function.name}({arguments});"]
    for name, table, values in zip(results, tables[count:], numbers[count:], strict=True):
        size = _hex(largest_entry(values), precision)
        lines += [
            "        {",
            f"            const {precision} apart = gap({name}, {table}[k], {values.shape[1]}, {size});",
            f"            if (worst_{name} >= 0.0{f} && !(apart <= worst_{name}))",
            f"                worst_{name} = apart;",
            "        }",
        ]
    lines.append("    }")
    for name, tolerance in zip(results, tolerances, strict=True):
        lines.append(f'    passed &= check("{function.name}, {name}", worst_{name}, {_hex(tolerance, precision)});')
    return data, "\n".join([*lines, "    return passed;", "}"])


def inputs_at_states(robot: Robot, request: Request, dtype: type, count: int = STATES) -> list[Array]:
    """Reproducible inputs: configurations inside the limits, everything else of order 1."""
    rng = np.random.default_rng(0)

    def values(port: TensorSpec) -> Array:
        if port.name == "q":
            return robot.random_configuration(rng, count)
        return rng.standard_normal((count, *port.shape)) * (STRENGTH if port.name == "gravity" else 1.0)

    return [values(port).astype(dtype) for port in request.function.program.inputs]


def results_at_states(
    robot: Robot, request: Request, inputs: list[Array], kernel: Callable[..., Any]
) -> tuple[list[Array], list[float]]:
    """Kernel results, and for each output the deviation by another order of rounding, relative to the largest entry.

    The deviation is the difference of single- and double-precision kernels, which grows with the condition of the
    state. In double precision it is smaller by the ratio of the precisions.
    """
    ports, precision = request.function.program.outputs, request.function.precision

    def results(arrays: Sequence[Array]) -> list[Array]:
        returned = kernel(*arrays)
        if len(ports) == 1:
            returned = (returned,)
        return list(map(np.asarray, returned))

    float32_inputs = [a.astype(np.float32) for a in inputs]
    with np.errstate(all="ignore"):
        single = results(float32_inputs)
        double = results([a.astype(np.float64) for a in float32_inputs])
        expected = results(inputs)
    tolerances = []
    for port, in_single, in_double, values in zip(ports, single, double, expected, strict=True):
        if not (np.isfinite(values).all() and np.isfinite(in_single).all()):
            raise KernelError(
                f"{request.quantity}: {port.name} is not finite at every configuration of robot {robot.name!r}, so no "
                "number can be checked. Ask for a quantity that is, or pass "
                f"{argument('test', False, option='no-test-program')}."
            )
        rounding = float(np.abs(in_single - in_double).max()) / largest_entry(in_double)
        tolerances.append(_MARGIN * max(rounding, _EPS["float"]) * _EPS[precision] / _EPS["float"])
    return expected, tolerances


def largest_entry(values: Array) -> float:
    """Largest absolute value of an entry; 1 if all are zero."""
    return float(np.abs(values).max()) or 1.0


def _array(name: str, values: Array, precision: str) -> str:
    rows = []
    for row in values:
        literals = ", ".join(_hex(x, precision) for x in row)
        rows.append(f"    {{{literals}}}")
    data = ",\n".join(rows)
    return f"static const {precision} {name}[{STATES}][{values.shape[1]}] = {{\n{data}\n}};"


def _hex(value: float, precision: str) -> str:
    """Exact hexadecimal literal of a number."""
    exact = float(np.float32(value)) if precision == "float" else float(value)
    return f"{exact.hex()}{PRECISIONS[precision]}"
