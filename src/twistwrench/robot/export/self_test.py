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
"""Number of test states."""

_ROUNDING_MARGIN = 16.0
"""Allowed ratio of C's rounding error to the kernel's: C has other sines, and two roundings where it has no fma."""

_EPS = {"double": float(np.finfo(np.float64).eps), "float": float(np.finfo(np.float32).eps)}
"""Relative rounding error of a number, by the name of its C type."""

_C_FUNCTIONS = """\
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
    suffix = PRECISIONS[precision]  # of literals and functions: f for float
    description = [
        f"Checks {stem}.c: each function at {STATES} states, against the numbers twistwrench has for them.",
        f"Build it together with {stem}.c, and link the mathematical library (-lm).",
        "Exit status 0: all agree to rounding. 1: some do not.",
    ]
    sections = [
        comment(description),
        f'#include "{stem}.h"\n\n#include <math.h>\n#include <stdio.h>',
        _C_FUNCTIONS.format(type=precision, f=suffix, zero=f"0.0{suffix}"),
    ]
    calls = []
    for request in requests:
        sections += _data_and_test(robot, request)
        calls.append(f"    passed &= test_{request.function.name}();")
    main_lines = ["int main(void)", "{", "    int passed = 1;", *calls, "    return passed ? 0 : 1;", "}"]
    sections.append("\n".join(main_lines))
    return "\n\n".join(sections) + "\n"


def _data_and_test(robot: Robot, request: Request) -> tuple[str, str]:
    """C texts of one function: data of the states with expected results, and a function that tests it."""
    function = request.function
    program = function.program
    precision = function.precision
    dtype = np.float32 if precision == "float" else np.float64
    inputs = inputs_at_states(robot, request, dtype)
    kernel = robot.kernel(request.quantity, **request.options)
    expected, tolerances = results_at_states(robot, request, inputs, kernel)
    ports = (*program.inputs, *program.outputs)
    table_names = [f"{function.name}_{parameter}" for parameter in function.parameters]
    arrays = (*inputs, *expected)
    tables = [
        np.reshape(array, (STATES, port.size)) for port, array in zip(ports, arrays, strict=True)
    ]  # a row a state
    data = "\n".join(_table_text(name, table, precision) for name, table in zip(table_names, tables, strict=True))
    input_count = len(program.inputs)
    outputs = function.parameters[input_count:]
    zero = f"0.0{PRECISIONS[precision]}"
    lines = [f"static int test_{function.name}(void)", "{", "    int passed = 1;"]
    for output, port in zip(outputs, program.outputs, strict=True):
        lines += [f"    {precision} {output}[{port.size}];", f"    {precision} worst_{output} = {zero};"]
    input_rows = [f"{name}[k]" for name in table_names[:input_count]]
    arguments = ", ".join([*input_rows, *outputs])
    lines += [f"    for (int k = 0; k < {STATES}; k++) {{", f"        {function.name}({arguments});"]
    for output, name, table in zip(outputs, table_names[input_count:], tables[input_count:], strict=True):
        largest_text = _hex(largest_entry(table), precision)
        lines += [
            "        {",
            f"            const {precision} apart = gap({output}, {name}[k], {table.shape[1]}, {largest_text});",
            f"            if (worst_{output} >= {zero} && !(apart <= worst_{output}))",
            f"                worst_{output} = apart;",
            "        }",
        ]
    lines.append("    }")
    for output, tolerance in zip(outputs, tolerances, strict=True):
        allowed = _hex(tolerance, precision)
        lines.append(f'    passed &= check("{function.name}, {output}", worst_{output}, {allowed});')
    return data, "\n".join([*lines, "    return passed;", "}"])


def inputs_at_states(robot: Robot, request: Request, dtype: type, count: int = STATES) -> list[Array]:
    """Reproducible inputs at ``count`` states: configurations inside the limits, all other numbers of order 1."""
    rng = np.random.default_rng(0)

    def values_at_states(port: TensorSpec) -> Array:
        if port.name == "q":
            return robot.random_configuration(rng, count)
        size = STRENGTH if port.name == "gravity" else 1.0
        return rng.standard_normal((count, *port.shape)) * size

    return [values_at_states(port).astype(dtype) for port in request.function.program.inputs]


def results_at_states(
    robot: Robot, request: Request, inputs: list[Array], kernel: Callable[..., Any]
) -> tuple[list[Array], list[float]]:
    """Kernel results, and for each output the allowed deviation, relative to the largest entry.

    A deviation by other rounding grows with the condition of the state. It is estimated by the difference of the kernels of
    single and double precision. In double precision, it is smaller by the ratio of the precisions.
    """
    ports = request.function.program.outputs
    precision = request.function.precision

    def kernel_results(arrays: Sequence[Array]) -> list[Array]:
        returned = kernel(*arrays)
        if len(ports) == 1:
            returned = (returned,)
        return list(map(np.asarray, returned))

    float32_inputs = [array.astype(np.float32) for array in inputs]
    with np.errstate(all="ignore"):  # numbers that are not finite are reported below
        single_results = kernel_results(float32_inputs)
        double_results = kernel_results([array.astype(np.float64) for array in float32_inputs])
        expected = kernel_results(inputs)
    tolerances = []
    for port, in_single, in_double, expected_values in zip(
        ports, single_results, double_results, expected, strict=True
    ):
        if not (np.isfinite(expected_values).all() and np.isfinite(in_single).all()):
            raise KernelError(
                f"{request.quantity}: {port.name} is not finite at every configuration of robot {robot.name!r}, so no "
                "number can be checked. Ask for a quantity that is, or pass "
                f"{argument('test', False, option='no-test-program')}."
            )
        rounding_in_single = float(np.abs(in_single - in_double).max()) / largest_entry(in_double)
        single_tolerance = _ROUNDING_MARGIN * max(rounding_in_single, _EPS["float"])
        tolerances.append(single_tolerance * _EPS[precision] / _EPS["float"])
    return expected, tolerances


def largest_entry(array: Array) -> float:
    """Largest absolute value of an entry; 1 if all are zero, so that it can be divided by."""
    return float(np.abs(array).max()) or 1.0


def _table_text(name: str, table: Array, precision: str) -> str:
    """C array with a row for each test state."""
    row_texts = []
    for row in table:
        literals = ", ".join(_hex(x, precision) for x in row)
        row_texts.append(f"    {{{literals}}}")
    data = ",\n".join(row_texts)
    return f"static const {precision} {name}[{STATES}][{table.shape[1]}] = {{\n{data}\n}};"


def _hex(x: float, precision: str) -> str:
    """Exact hexadecimal literal of a number, after rounding to the precision."""
    rounded = float(np.float32(x)) if precision == "float" else float(x)
    return f"{rounded.hex()}{PRECISIONS[precision]}"
