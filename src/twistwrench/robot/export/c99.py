"""Export as C99 or CUDA source: header, functions with comments, self-test and files."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any

import numpy as np

from ...compiler.ir.program import FUSED, Program, TensorSpec
from ...compiler.printers.c99 import FUSED_MACROS, PRECISIONS, identifier
from ...compiler.printers.cuda import CudaFunction
from ...core.errors import KernelError, ValueRangeError
from ...core.files import check_outputs, replacing_together
from ...core.glossary import complete
from ...core.gravity import STRENGTH
from ...core.numbers import file_number
from ...core.text import argument
from ...core.typing import Array
from ...mechanics.joints.units import unit_of
from ...mechanics.model.parameters import nominal
from ..quantities import QUANTITIES
from .request import Quantities, Request, prefix_of, requests
from .written import Written

if TYPE_CHECKING:
    from .. import Robot

_COUNTED = {
    "multiplications": ("mul",),
    "additions": ("add", "sub"),
    "fused multiply-adds": tuple(FUSED),
    "divisions": ("div",),
    "sines and cosines": ("sin", "cos"),
    "square roots": ("sqrt",),
    "exponentials": ("exp",),
    "minima and maxima": ("min", "max"),
}

_CONVENTIONS = """\
SI units, radians. The angular part comes first: twists are (omega, v), wrenches (m, f). A pose is a 4 x 4 matrix that maps
points of the frame to the base frame. Kinds of frame quantities: body, seen in the frame itself; space, at the origin of the
base; world_aligned, at the frame's origin along the axes of the base. A wrench input is what the robot applies to the world
at that frame, expressed in it. Joint friction is included only where a function names it.
Arrays of several axes are stored row by row: entry (i, j) of an m x n matrix is element n i + j.
The functions allocate nothing, keep no state, do not branch, and call nothing but math.h. They read their inputs before they
write, so an output may be an input's array; two outputs must not overlap."""


def header(robot: Robot, requests: Sequence[Request], stem: str, prefix: str) -> str:
    """Text of the .h file: conventions, joint order, and a prototype with meaning and cost for each function."""
    precision = requests[0].function.precision
    gx, gy, gz = map(file_number, robot.gravity)
    about = [
        f"Dynamics of the robot {robot.name} in C99, numbers of type {precision}.",
        f"Written by twistwrench {version('twistwrench')}.",
        "",
        *_CONVENTIONS.split("\n"),
        f"Gravity is ({gx}, {gy}, {gz}) m/s^2 in the base frame.",
        "",
        *entries(robot),
    ]
    guard = f"{identifier(stem) or prefix}_H".upper()
    guard = guard if guard[0].isalpha() else f"H_{guard}"
    parts = [
        comment(about),
        f"#ifndef {guard}\n#define {guard}",
        '#ifdef __cplusplus\nextern "C" {\n#endif',
        f"/* Entries of q, and of dq, ddq and tau. */\n"
        f"#define {prefix.upper()}_NQ {robot.nq}\n#define {prefix.upper()}_NV {robot.nv}",
        *(f"{comment(comment_lines(robot, request))}\n{request.function.prototype};" for request in requests),
        f"#ifdef __cplusplus\n}}\n#endif\n\n#endif /* {guard} */",
    ]
    return "\n\n".join(parts) + "\n"


def source(robot: Robot, requests: Sequence[Request], stem: str) -> str:
    """Text of the .c file."""
    precision = requests[0].function.precision
    about = f"Dynamics of the robot {robot.name} in C99, one operation a line. See {stem}.h for the interface."
    parts = [
        comment([about]),
        f'#include "{stem}.h"\n\n#include <math.h>',
        # GCC has -ffp-contract=off for the same.
        "#ifdef __clang__\n#pragma STDC FP_CONTRACT OFF\n#endif",
    ]
    if any(request.function.fuses for request in requests):
        parts.append(FUSED_MACROS.format(fma=f"fma{PRECISIONS[precision]}").rstrip())
    return "\n\n".join([*parts, *(request.function.definition for request in requests)]) + "\n"


def comment(lines: Sequence[str]) -> str:
    """Block comment; names from robot files cannot end it or hide in it."""
    safe = "\n".join(lines).replace("*/", "* /").replace("/*", "/ *").replace("??", "? ?")
    printable = "".join(c if c.isprintable() or c == "\n" else "?" for c in safe)
    plain = printable.encode("ascii", "backslashreplace").decode()
    body = "\n".join(f" * {line}".rstrip() for line in plain.split("\n"))
    return f"/*\n{body}\n */"


def entries(robot: Robot) -> Iterator[str]:
    """Entries of q and dq, with their units."""
    yield "Entries of q:"
    names = robot.coordinate_names
    width = max(map(len, names))
    units = [unit for b in robot.model.leaders for unit in b.joint.coordinate_units]
    for k, (name, unit) in enumerate(zip(names, units, strict=True)):
        yield f"  {k:3}  {name:{width}}  {unit}"
    yield "Entries of dq, ddq and tau (a joint of several: its twist in the frame of its child, angular part first):"
    k = 0
    for b in robot.model.leaders:
        for turns in b.joint.turning:
            units_text = ", ".join(unit_of(part, turns) for part in ("dq", "ddq", "tau"))
            yield f"  {k:3}  {b.joint.name:{width}}  {units_text.replace('²', '^2')}"  # ASCII, as C is
            k += 1
    if robot.model.quaternions:
        yield "A quaternion (qw, qx, qy, qz) may have any length but zero."


def comment_lines(robot: Robot, request: Request) -> list[str]:
    """Comment lines of one function."""
    function, full = request.function, request.full
    program = function.program
    lines = [f"{request.quantity}: {QUANTITIES[request.quantity].meaning}."]
    if "frame" in full:
        lines.append(f"Frame: {full['frame']}.")
    if "kind" in full:
        lines.append(f"Kind: {full['kind']}.")
    if full.get("friction"):
        lines.append("With the friction of the joints.")
    if on_robot := full.get("on_robot"):
        lines.append(f"The world applies the wrenches at: {', '.join(on_robot)}.")
    if derivative := full.get("derivative"):
        lines.append(f"Not itself: its derivative ({derivative.form}) by {', '.join(derivative.by)}.")
    if constraints := full.get("constraints"):
        lines.append(f"Constraints: {', '.join(c.name for c in constraints)}.")
    parameters = []
    for name, port in zip(function.parameters, (*program.inputs, *program.outputs), strict=True):
        parameters.append(f"{name} {' x '.join(map(str, port.shape)) or '1'}")
    count = len(program.inputs)
    lines.append(f"In: {', '.join(parameters[:count])}. Out: {', '.join(parameters[count:])}.")
    lines.append(f"{_operations_text(program)}.")
    if names := full.get("parameters"):
        values, width = nominal(robot.model), max(map(len, names))
        lines.append("Entries of parameters, and the robot's own numbers:")
        lines += [f"  {k:3}  {name:{width}}  {file_number(values[name])}" for k, name in enumerate(names)]
    return lines


def _operations_text(program: Program) -> str:
    """Numbers of operations of each kind."""
    counts = program.counts()
    parts = []
    for label, operations in _COUNTED.items():
        total = sum(counts.get(operation, 0) for operation in operations)
        if total:
            parts.append(f"{total} {label}")
    return ", ".join(parts) or "No operation"


# ── Export of quantities as C99 (header, source and test) and as CUDA source; files are written together

_LONGEST_CUDA = 40_000
"""Maximum number of instructions of a program exported as one CUDA kernel."""


def export_c(
    robot: Robot,
    quantities: Quantities,
    path: str | Path,
    *,
    precision: str = "double",
    prefix: str | None = None,
    test: bool = True,
    label: str = "path",
    inputs: Mapping[str, str | Path | None] | None = None,
) -> Written:
    """C code export; see :meth:`twistwrench.Robot.export_c`.

    Parameters
    ----------
    path : str or Path, a folder, or the .c file
    test : bool, also write a program that compares the functions with the kernels
    label : str, name of ``path`` in messages
    inputs : {name in messages: path}, optional, input files, which outputs must not overwrite

    Returns
    -------
    files : Written, a tuple of Path: header, source, and test program

    Raises
    ------
    UnknownNameError, KernelError, SingularMassMatrixError, ValueRangeError
        As :meth:`twistwrench.Robot.export_c`.

    Examples
    --------
    >>> import tempfile, twistwrench as tw
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     [path.name for path in export_c(tw.robots.pendulum(), ["gravity_forces"], folder)]
    ['pendulum.h', 'pendulum.c', 'pendulum_test.c']
    """
    prefix = prefix_of(robot, prefix)
    plain = _source_path(path, prefix, label)
    paths = {".h": plain.with_suffix(".h"), ".c": plain}
    if test:
        paths["_test.c"] = plain.with_name(f"{plain.stem}_test.c")
    outputs = {label: plain}
    outputs |= {f"{label} (its {end})": file for end, file in paths.items() if file is not plain}
    check_outputs(outputs, {"the robot": file_of(robot), **(inputs or {})})
    exports = requests(robot, quantities, precision, prefix)
    texts = {".h": header(robot, exports, plain.stem, prefix), ".c": source(robot, exports, plain.stem)}
    if test:
        texts["_test.c"] = self_test(robot, exports, plain.stem)
    with replacing_together(list(paths.values())) as scratch:
        for end, file in zip(paths, scratch, strict=True):
            file.write_text(texts[end], encoding="utf-8", newline="\n")
    check = f"cc -O2 {quote(str(plain))} {quote(str(paths['_test.c']))} -lm && ./a.out" if test else ""
    return Written(paths.values(), plain, robot.name, check)


def export_cuda(
    robot: Robot, quantities: Quantities, path: str | Path, *, precision: str = "double", prefix: str | None = None
) -> tuple[Path, ...]:
    """CUDA source export; see :meth:`twistwrench.Robot.export_cuda`.

    Parameters
    ----------
    path : str or Path, a folder for one file per kernel; or the .cu file of one kernel

    Raises
    ------
    UnknownNameError, KernelError, SingularMassMatrixError, ValueRangeError
        As :meth:`twistwrench.Robot.export_cuda`.

    Examples
    --------
    >>> import tempfile, twistwrench as tw
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     [path.name for path in export_cuda(tw.robots.pendulum(), ["mass_matrix", "gravity_forces"], folder)]
    ['pendulum_mass_matrix.cu', 'pendulum_gravity_forces.cu']
    """
    exports = requests(robot, quantities, precision, prefix_of(robot, prefix))
    target = Path(path)
    if target.is_dir():
        files = [target / f"{request.function.name}.cu" for request in exports]
    elif target.suffix == ".cu" and len(exports) == 1:
        files = [target]
    else:
        raise ValueRangeError(
            f"path {str(path)!r} is neither a folder that exists nor a name that ends in .cu, for one kernel. "
            "Make the folder first: each kernel is a file of its own."
        )
    check_outputs({f"path ({file.name})": file for file in files}, {"the robot": file_of(robot)})
    texts = [_cuda_source(robot, request) for request in exports]
    with replacing_together(files) as scratch:
        for file, text in zip(scratch, texts, strict=True):
            file.write_text(text, encoding="utf-8", newline="\n")
    return tuple(files)


def _cuda_source(robot: Robot, request: Request) -> str:
    """Text of the .cu file of one request. Raises KernelError for programs that are too long for NVIDIA's compiler."""
    function = request.function
    if (length := len(function.program.instructions)) > _LONGEST_CUDA:
        raise KernelError(
            f"{request.quantity} takes {length} instructions, more than the {_LONGEST_CUDA} that NVIDIA's compiler handles "
            "in reasonable time. Export parts of it."
        )
    about = [
        f"{request.quantity} of the robot {robot.name} as a CUDA kernel, numbers of type {function.precision}. By twistwrench "
        f"{version('twistwrench')}.",
        "A thread computes a sample, a block THREADS of them; blocks: (samples + THREADS - 1) / THREADS.",
        "An input has a pointer and the number of elements from one sample to the next, 0 if one serves all.",
        "Compile with -std=c++17 -fmad=false: products that are fused are fused here. As C++ (-ffp-contract=off) the",
        "function of the same name runs all blocks on the processor.",
    ]
    return f"{comment(about)}\n{CudaFunction(function.name, function.program, function.precision).source}"


def _source_path(path: str | Path, prefix: str, label: str) -> Path:
    """Path of the .c file: the given one, or one with the robot's name in a folder."""
    file = Path(path)
    if file.is_dir():
        return file / f"{prefix}.c"
    if file.suffix != ".c":
        raise ValueRangeError(
            f"{label} {str(path)!r} is neither a folder that exists nor a name that ends in .c. "
            f"Make the folder first, or name the source, such as {prefix}.c; the header goes beside it."
        )
    if not file.name.isprintable() or any(c in file.name for c in '"\\'):
        raise ValueRangeError(
            f"{label} {str(path)!r} cannot stand in an #include. Give a name without quotes and backslashes."
        )
    return file


def file_of(robot: Robot) -> str | None:
    """File that the robot was read from, or None."""
    source = robot.model.source
    try:
        return source if source and Path(source).is_file() else None
    except OSError:  # XML text is not a path
        return None


# ── Self-test of an export: every function at a few states, compared with kernel results

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
    for request in requests:
        parts += _test_of(robot, request)
    calls = [f"    passed &= test_{request.function.name}();" for request in requests]
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
        return [np.asarray(a) for a in returned]

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


complete(globals())
