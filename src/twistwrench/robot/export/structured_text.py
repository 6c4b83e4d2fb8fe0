"""Export as Structured Text (IEC 61131-3): a function block for each quantity, and a program that checks the blocks.

Writes one assignment a line, with names and literals of the standard's second edition. Not run on a PLC: the tests
interpret the text with the tree of an independent parser.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...compiler.ir.program import FUSED
from ...compiler.lowering.numpy_kernels import NumpyKernel
from ...compiler.lowering.reference_interpreter import evaluated
from ...compiler.printers.c99 import identifier, literal
from ...core import arguments
from ...core.errors import KernelError, ValueRangeError
from ...core.files import check_outputs, replacing
from ...core.numbers import file_number
from ...core.text import argument
from .c99 import file_of
from .comments import comment, comment_lines, entries
from .motor_torques import with_motor_torques
from .request import Quantities, Request, element_names, name_option_pairs, prefix_of, requests
from .self_test import inputs_at_states, largest_entry, results_at_states
from .written import Written

if TYPE_CHECKING:
    from .. import Robot

TYPES = {"double": "LREAL", "float": "REAL"}
STYLES = ("function_block", "codesys")
STATES = 10
"""Number of states in the program that checks the blocks."""
_WIDTH = 76

RESERVED = frozenset("""
    abs acos action add and any any_bit any_date any_elementary any_int any_magnitude any_num any_real any_string array
    asin at atan atan2 bool by byte cal calc case char concat configuration constant continue cos ctd ctu ctud date
    date_and_time delete delta dint div do dt dword else elsif en eno eq exit exp expt extends f_edge f_trig false final
    find for from function function_block ge get goto gt if implements in initial_step insert int interface internal
    interval is jmp le left len limit lint ln log lreal lt lword max method mid min mod move mul mux ne neg nil non_retain
    not null of on or out overlap override pi pointer private program property protected public r r_edge r_trig read_only
    read_write ready real ref ref_to reference rem repeat replace resource retain return right rol ror rs rtc s sel sema
    set shl shr sin single sint size sizeof sqrt sr step string struct sub super t tan task then this time time_of_day to
    tod tof ton tp transition true trunc type udint uint ulint union until usint using var var_access var_config
    var_external var_global var_in_out var_input var_output var_temp while with word wstring xor
""".split())  # noqa: SIM905  # fmt: skip
"""Keywords, types, standard functions and function blocks, in lower case, including names of CODESYS and Siemens."""

_CONVENTIONS = """\
Not run on a PLC: check it with the program below, and at low power, before a machine moves by it.
SI units, radians. The angular part comes first: twists are (omega, v), wrenches (m, f). A wrench input is what the robot
applies to the world at that frame, expressed in it. Joint friction is included only where a block names it.
Matrices are stored row by row: entry (i, j) of an m x n matrix is element n * i + j.
Zero positions, signs of rotation, gears and units of the axes are the machine's: convert them before and after the call.
The blocks keep no state, do not branch and call SIN, COS, SQRT, EXP, MIN, MAX and SEL only; their local variables are
memory of the instance, not of the stack. Products and sums are rounded apart."""


class Names:
    """Names in one scope: unique regardless of case, and not reserved."""

    def __init__(self, names: Sequence[str] = ()) -> None:
        self._used = set(map(str.lower, names))

    def free(self, wanted: str) -> str:
        """Unused identifier for a name: ``dt``, a type, becomes ``dt_value``, and a second ``m`` beside ``M`` ``m_2``."""
        base = identifier(wanted)
        if not base[:1].isalpha():
            base = f"x_{base}".strip("_")
        if base.lower() in RESERVED:
            base = f"{base}_value"
        name, k = base, 2
        while name.lower() in self._used:
            name, k = f"{base}_{k}", k + 1
        self._used.add(name.lower())
        return name


def real_literal(value: float, precision: str = "double") -> str:
    """Real literal with digits on both sides of the point; negative ones in parentheses. KernelError if not finite.

    Examples
    --------
    >>> real_literal(1e-05), real_literal(-2.0), real_literal(0.1, "float")
    ('1.0E-05', '(-2.0)', '0.1')
    """
    mantissa, _, exponent = literal(abs(value), precision).rstrip("f").partition("e")
    text = f"{mantissa}{'' if '.' in mantissa else '.0'}"
    if exponent:
        text += f"E{exponent}"
    return f"(-{text})" if np.signbit(value) and value else text


def function_block(name: str, request: Request, about: Sequence[str]) -> str:
    """Declaration and statements of one block."""
    program, precision = request.function.program, request.function.precision
    real, count = TYPES[precision], len(program.inputs)
    scope = Names([name])
    ports = (*program.inputs, *program.outputs)
    names = [scope.free(parameter) for parameter in request.function.parameters]
    lines: list[str] = []
    locals_: list[str] = []

    def operand_text(value: Any) -> str:
        return value if isinstance(value, str) else real_literal(value, precision)

    def operation(pattern: str) -> Any:
        def write(*operands: Any) -> str:
            locals_.append(scope.free(f"t{len(locals_)}"))
            lines.append(f"{locals_[-1]} := {pattern.format(*map(operand_text, operands))};")
            return locals_[-1]

        return write

    functions = {op: operation(pattern) for op, pattern in _OPERATIONS.items()}
    values = evaluated(program, element_names(names[:count], program.inputs), functions)
    for element, value in zip(element_names(names[count:], program.outputs), values, strict=True):
        lines.append(f"{element} := {operand_text(value)};")
    declarations = [f"    {name} : {_type(port.size, real)};" for name, port in zip(names, ports, strict=True)]
    local_variables = ["VAR", *_wrap(locals_, f" : {real};"), "END_VAR"] if locals_ else []
    return "\n".join(
        [
            _comment(about),
            f"FUNCTION_BLOCK {name}",
            *("VAR_INPUT", *declarations[:count], "END_VAR", "VAR_OUTPUT", *declarations[count:], "END_VAR"),
            *local_variables,
            *lines,
            "END_FUNCTION_BLOCK",
        ]
    )


_OPERATIONS: Mapping[str, str] = {
    "add": "{0} + {1}", "sub": "{0} - {1}", "mul": "{0} * {1}", "div": "{0} / {1}", "neg": "-{0}",
    "min": "MIN({0}, {1})", "max": "MAX({0}, {1})",
    "sign": "SEL({0} > 0.0, SEL({0} < 0.0, 0.0, (-1.0)), 1.0)",
    "sqrt": "SQRT({0})", "sin": "SIN({0})", "cos": "COS({0})", "exp": "EXP({0})",
    **{op: f"{'' if a > 0 else '-'}({{0}} * {{1}}) {'+' if b > 0 else '-'} {{2}}" for op, (a, b) in FUSED.items()},
}  # fmt: skip
"""Expressions of the operations; MIN, MAX and SEL evaluate all operands, which have no side effects."""


def _type(size: int, real: str) -> str:
    return f"ARRAY[0..{size - 1}] OF {real}"


def _wrap(items: Sequence[str], end: str, *, each: bool = True) -> Iterator[str]:
    """Items wrapped into lines; ``end`` follows each line or, with commas between lines, only the last."""
    line = ""
    for item in items:
        if line and len(line) + len(item) + 2 + len(end) > _WIDTH:
            yield f"    {line}{end if each else ','}"
            line = ""
        line += f", {item}" if line else item
    yield f"    {line}{end}"


def _comment(lines: Sequence[str]) -> str:
    """Comment that names from robot files cannot end."""
    plain = comment([line.replace("*)", "* )").replace("(*", "( *") for line in lines])
    return f"(*{plain[2:-2]}*)"


def export_st(
    robot: Robot,
    quantities: Quantities,
    path: str | Path,
    *,
    precision: str = "double",
    prefix: str | None = None,
    test: bool = True,
    style: str = "function_block",
    torque: str = "joint",
    label: str = "path",
    inputs: Mapping[str, str | Path | None] | None = None,
) -> Written:
    """Structured Text export; see :meth:`twistwrench.Robot.export_st`.

    Parameters
    ----------
    path : str or Path, a folder, or the file
    label : str, name of ``path`` in messages
    inputs : {name in messages: path}, optional, input files, which outputs must not overwrite

    Returns
    -------
    files : Written, a tuple with the Path

    Raises
    ------
    UnknownNameError, KernelError, ModelError, SingularMassMatrixError, ValueRangeError
        As :meth:`twistwrench.Robot.export_st`.

    Examples
    --------
    >>> import tempfile, twistwrench as tw
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     export_st(tw.robots.pendulum(), "gravity_forces", folder).path.name
    'pendulum.st'
    """
    arguments.choice(style, "export_st: style", STYLES)
    arguments.choice(torque, "export_st: torque", ("joint", "motor"))
    prefix, file = prefix_of(robot, prefix), Path(path)
    if file.is_dir():
        file = file / f"{prefix}.st"
    if file.suffix.lower() not in (".st", ".exp", ".txt", ".scl"):
        raise ValueRangeError(
            f"{label} {str(path)!r} is neither a folder that exists nor a name that ends in .st. Name it {prefix}.st."
        )
    check_outputs({label: file}, {"the robot": file_of(robot), **(inputs or {})})
    pairs = list(name_option_pairs(quantities))
    if style == "codesys":
        if [name for name, _ in pairs] != ["inverse_dynamics"]:
            raise KernelError(
                f"{argument('style', 'codesys')} writes inverse_dynamics alone, which its interface is about."
            )
        pairs = [(name, {**options, "gravity": "input"}) for name, options in pairs]
    exports = requests(robot, pairs, precision, prefix)
    if torque == "motor":
        exports = [with_motor_torques(robot, request) for request in exports]
    scope = Names()
    blocks = [(scope.free(request.function.name), request) for request in exports]
    parts = [_header(robot, exports, torque)]
    parts += [function_block(name, request, _about(robot, request, torque)) for name, request in blocks]
    if style == "codesys":
        parts.append(_codesys(scope.free(f"{prefix}_dynamics"), *blocks[0]))
    if test:
        parts.append(_test(robot, scope.free(f"{prefix}_TEST"), blocks))
    with replacing(file) as scratch:
        scratch.write_text("\n\n".join(parts) + "\n", encoding="ascii", newline="\n")
    return Written([file], file, robot.name)


def _header(robot: Robot, exports: Sequence[Request], torque: str) -> str:
    digests = ", ".join(f"{request.function.program.digest[:12]}" for request in exports)
    gx, gy, gz = map(file_number, robot.gravity)
    shafts = []
    if torque == "motor":
        order = f"order {', '.join(robot.model.drive_names)}" if robot.model.couplings else "order of the joints"
        shafts = [f"tau of motor_torques: N m at the shafts of the motors, in the {order}."]
    return _comment(
        [
            f"Dynamics of the robot {robot.name} in Structured Text (IEC 61131-3), numbers of type "
            f"{TYPES[exports[0].function.precision]}.",
            f"Written by twistwrench {version('twistwrench')}. Hash of the equations: {digests}.",
            "",
            *_CONVENTIONS.split("\n"),
            f"Gravity is ({gx}, {gy}, {gz}) m/s^2 in the base frame, unless it is an input.",
            *shafts,
            "",
            *entries(robot),
        ]
    )


def _about(robot: Robot, request: Request, torque: str) -> list[str]:
    lines = comment_lines(robot, request)
    if torque == "motor":
        lines[0] = (
            "Motor torques: inverse dynamics at the shafts of the motors, (torque through the gear at its efficiency + rotor) "
            "/ ratio."
        )
    return lines


def _test(robot: Robot, name: str, blocks: Sequence[tuple[str, Request]]) -> str:
    """Program that compares every block with the results of twistwrench; its output is ``Passed``."""
    scope = Names([name, *(block for block, _ in blocks), "Passed", "Worst"])
    real = TYPES[blocks[0][1].function.precision]
    k, i, apart = map(scope.free, ("k", "i", "apart"))
    declarations = [f"    {k}, {i} : DINT;", f"    {apart} : {real};"]
    lines = ["Passed := TRUE;", "Worst := 0.0;"]
    for block, request in blocks:
        own_declarations, statements = _test_of(robot, block, request, scope, (k, i, apart))
        declarations += own_declarations
        lines += statements
    return "\n".join(
        [
            _comment([
                f"Run once: Passed is TRUE if all blocks return the numbers of twistwrench at {STATES} states.",
                "Worst is the largest difference, as a share of the difference that rounding explains.",
            ]),
            f"PROGRAM {name}",
            *("VAR_OUTPUT", "    Passed : BOOL;", f"    Worst : {real};", "END_VAR"),
            *("VAR", *declarations, "END_VAR"),
            *lines,
            "END_PROGRAM",
        ]
    )  # fmt: skip


def _test_of(
    robot: Robot, block: str, request: Request, scope: Names, counters: tuple[str, str, str]
) -> tuple[list[str], list[str]]:
    """Declarations and statements for one block."""
    program, precision = request.function.program, request.function.precision
    k, i, apart = counters
    real, parameters = TYPES[precision], request.function.parameters
    instance, own = scope.free(f"{block}_1"), Names([block])
    ports = [own.free(parameter) for parameter in parameters]
    inputs = inputs_at_states(robot, request, np.float32 if precision == "float" else np.float64, STATES)
    results, tolerances = results_at_states(robot, request, inputs, NumpyKernel(program, block, ""))
    remaining_tolerances = iter(tolerances)
    declarations, loads, checks = [f"    {instance} : {block};"], [], []
    arrays: list[str] = []
    for port, spec, values in zip(ports, (*program.inputs, *program.outputs), (*inputs, *results), strict=True):
        table = scope.free(f"{block}_{port}_data")
        numbers = [real_literal(float(x), precision).strip("()") for x in np.ravel(values)]
        declarations += [f"    {table} : {_type(STATES * spec.size, real)} := [", *_wrap(numbers, "];", each=False)]
        loop, entry = f"    FOR {i} := 0 TO {spec.size - 1} DO", f"{table}[{spec.size} * {k} + {i}]"
        if len(arrays) < len(program.inputs):
            arrays.append(scope.free(f"{block}_{port}"))
            declarations.append(f"    {arrays[-1]} : {_type(spec.size, real)};")
            loads += [loop, f"        {arrays[-1]}[{i}] := {entry};", "    END_FOR;"]
            continue
        allowed = real_literal(largest_entry(np.asarray(values)) * next(remaining_tolerances), precision)
        checks += [
            loop,
            f"        {apart} := ABS({instance}.{port}[{i}] - {entry}) / {allowed};",
            f"        IF NOT ({apart} <= 1.0) THEN",
            "            Passed := FALSE;",
            "        END_IF;",
            f"        Worst := MAX(Worst, {apart});",
            "    END_FOR;",
        ]
    assignments = ", ".join(f"{port} := {array}" for port, array in zip(ports, arrays, strict=False))
    call = f"    {instance}({assignments});"
    return declarations, [f"FOR {k} := 0 TO {STATES - 1} DO", *loads, call, *checks, "END_FOR;"]


def _codesys(name: str, block: str, request: Request) -> str:
    """Wrapper for CODESYS' SM3_Dynamics, to be completed by the user."""
    inputs = [
        f"    {parameter} : {_type(port.size, 'LREAL')};"
        for parameter, port in zip(request.function.parameters, request.function.program.inputs, strict=False)
    ]
    assignments = ", ".join(f"{x} := {x}" for x in request.function.parameters[: len(inputs)])
    (output,) = request.function.program.outputs
    return "\n".join(
        [
            _comment([
                "To be completed in CODESYS: let it implement ISMDynamics of the library SM3_Dynamics, which declares the",
                "parameters of AxesStateToTorque and of the interface's other methods. Those below are stand-ins, since the",
                "library's own could not be read: fill q, dq, ddq and gravity from them, and return tau.",
                "SMC_GroupSetDynamics(Dynamics, GravitationalAcceleration) gives the block to an axis group; it has gravity",
                "in units of the group per s^2. SMC_SetTorque expects torques at the shafts of the motors by default.",
            ]),
            f"FUNCTION_BLOCK {name} IMPLEMENTS ISMDynamics",
            "VAR",
            f"    block : {block};",
            "END_VAR",
            "END_FUNCTION_BLOCK",
            "",
            "(* Method of the block above. *)",
            "METHOD AxesStateToTorque",
            *("VAR_INPUT", *inputs, "END_VAR"),
            *("VAR_OUTPUT", f"    tau : {_type(output.size, 'LREAL')};", "END_VAR"),
            f"block({assignments});",
            "tau := block.tau;",
            "END_METHOD",
        ]
    )  # fmt: skip
