"""The program that checks an export where it runs: every function at a few states, against the numbers of the kernels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..core.gravity import STRENGTH
from ..errors import KernelError
from ..program.port import Port
from ..targets.c import PRECISIONS
from ..typing import Array
from .document import comment
from .request import Request

if TYPE_CHECKING:
    from ..robot import Robot

STATES = 3

_MARGIN = 16.0
"""How much more than the kernel the C function may round: it has other sines, and two roundings without fma."""

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
    """The .c file with ``main``: exit status 0 if every function gives what the kernels give, else 1.

    Raises KernelError for a quantity that is not finite at the states it is tested at.
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
        data, function = _function(robot, request)
        parts += [data, function]
        calls.append(f"    passed &= test_{request.function.name}();")
    parts.append("\n".join(["int main(void)", "{", "    int passed = 1;", *calls, "    return passed ? 0 : 1;", "}"]))
    return "\n\n".join(parts) + "\n"


@dataclass(frozen=True)
class _Numbers:
    """Arrays of one port at all states, (STATES, size)."""

    name: str
    values: Array


def _function(robot: Robot, request: Request) -> tuple[str, str]:
    function = request.function
    program, precision = function.program, function.precision
    dtype = np.float32 if precision == "float" else np.float64
    made = len(program.inputs)
    inputs = _inputs(robot, request, dtype)
    wanted, allowed = _results(robot, request, inputs)
    ports = (*program.inputs, *program.outputs)
    numbers = [
        _Numbers(f"{function.name}_{name}", np.reshape(values, (STATES, port.size)))
        for name, port, values in zip(function.parameters, ports, (*inputs, *wanted), strict=True)
    ]
    data = "\n".join(_array(n, precision) for n in numbers)
    f = PRECISIONS[precision]
    lines = [f"static int test_{function.name}(void)", "{", "    int passed = 1;"]
    outputs = list(zip(function.parameters[made:], program.outputs, numbers[made:], allowed, strict=True))
    for name, port, _, _ in outputs:
        lines += [f"    {precision} {name}[{port.size}];", f"    {precision} worst_{name} = 0.0{f};"]
    arguments = ", ".join([*(f"{n.name}[k]" for n in numbers[:made]), *function.parameters[made:]])
    lines += [f"    for (int k = 0; k < {STATES}; k++) {{", f"        {function.name}({arguments});"]
    for name, port, n, _ in outputs:
        size = _size(n.values)
        lines += [
            "        {",
            f"            const {precision} apart = gap({name}, {n.name}[k], {port.size}, {_hex(size, precision)});",
            f"            if (worst_{name} >= 0.0{f} && !(apart <= worst_{name}))",
            f"                worst_{name} = apart;",
            "        }",
        ]
    lines.append("    }")
    for name, _, _, tolerance in outputs:
        what = f"{function.name}, {name}"
        lines.append(f'    passed &= check("{what}", worst_{name}, {_hex(tolerance, precision)});')
    return data, "\n".join([*lines, "    return passed;", "}"])


def _inputs(robot: Robot, request: Request, dtype: type) -> list[Array]:
    """Configurations inside the limits, everything else of order 1; the same ones every time."""
    rng = np.random.default_rng(0)

    def values(port: Port) -> Array:
        if port.name == "q":
            return robot.random_configuration(rng, STATES)
        return rng.standard_normal((STATES, *port.shape)) * (STRENGTH if port.name == "gravity" else 1.0)

    return [values(port).astype(dtype) for port in request.function.program.inputs]


def _results(robot: Robot, request: Request, inputs: list[Array]) -> tuple[list[Array], list[float]]:
    """What the kernel gives, and how far off the largest entry another order of rounding may be; one for each output.

    The kernel in single precision is off the one in double by its rounding, which grows with the condition of the state;
    that of double precision is as much smaller as its numbers are finer.
    """
    kernel = robot.kernel(request.quantity, **request.options)
    several = len(request.function.program.outputs) > 1
    with np.errstate(all="ignore"):
        single, double, given = (
            found if several else (found,)
            for found in (
                kernel(*(a.astype(np.float32) for a in inputs)),
                kernel(*(a.astype(np.float32).astype(np.float64) for a in inputs)),
                kernel(*inputs),
            )
        )
    wanted, allowed = [np.asarray(a) for a in given], []
    for name, port_single, port_double, port in zip(
        request.function.program.outputs, single, double, wanted, strict=True
    ):
        if not (np.isfinite(port).all() and np.isfinite(port_single).all()):
            raise KernelError(
                f"{request.quantity}: {name.name} is not finite at every configuration of robot {robot.name!r}, so no "
                "number can be checked. Ask for a quantity that is, or pass test=False."
            )
        size = _size(np.asarray(port_double))
        rounding = float(np.abs(port_single - port_double).max()) / size
        precision = request.function.precision
        allowed.append(_MARGIN * max(rounding, _EPS["float"]) * _EPS[precision] / _EPS["float"])
    return wanted, allowed


def _size(values: Array) -> float:
    return float(np.abs(values).max()) or 1.0


def _array(numbers: _Numbers, precision: str) -> str:
    rows = ",\n".join("    {" + ", ".join(_hex(x, precision) for x in row) + "}" for row in numbers.values)
    return f"static const {precision} {numbers.name}[{STATES}][{numbers.values.shape[1]}] = {{\n{rows}\n}};"


def _hex(value: float, precision: str) -> str:
    """A number by its bits."""
    exact = float(np.float32(value)) if precision == "float" else float(value)
    return f"{exact.hex()}{PRECISIONS[precision]}"
