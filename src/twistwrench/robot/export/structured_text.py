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
"""Types of numbers, by precision."""
STYLES = ("function_block", "codesys")
"""Interfaces of the blocks: their own, or the interface of CODESYS."""
STATES = 10
"""Number of states in the program that checks the blocks."""
_LINE_WIDTH = 76
"""Largest length of a line of wrapped items, without its indent."""
_DIGEST_LETTERS = 12
"""Number of letters of a program's hash in the header."""

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
        """Unused identifier for a name: the type ``dt`` becomes ``dt_value``, and ``m`` becomes ``m_2`` if ``M`` is used."""
        base = identifier(wanted)
        if not base[:1].isalpha():
            base = f"x_{base}".strip("_")
        if base.lower() in RESERVED:
            base = f"{base}_value"
        name = base
        number = 2
        while name.lower() in self._used:
            name = f"{base}_{number}"
            number += 1
        self._used.add(name.lower())
        return name


def real_literal(x: float, precision: str = "double") -> str:
    """Real literal with digits on both sides of the point; negative ones in parentheses. KernelError if not finite.

    Examples
    --------
    >>> real_literal(1e-05), real_literal(-2.0), real_literal(0.1, "float")
    ('1.0E-05', '(-2.0)', '0.1')
    """
    mantissa, _, exponent = literal(abs(x), precision).rstrip("f").partition("e")
    text = mantissa if "." in mantissa else f"{mantissa}.0"
    if exponent:
        text += f"E{exponent}"
    return f"(-{text})" if x < 0 else text


def function_block(name: str, request: Request, description: Sequence[str]) -> str:
    """Declaration and statements of one block, below a comment with its ``description``."""
    program = request.function.program
    precision = request.function.precision
    real_type = TYPES[precision]
    scope = Names([name])
    parameters = [scope.free(parameter) for parameter in request.function.parameters]
    input_count = len(program.inputs)
    inputs = parameters[:input_count]
    outputs = parameters[input_count:]
    statements: list[str] = []
    local_names: list[str] = []

    def operand_text(operand: Any) -> str:
        """Name of a variable, or literal of a number."""
        return operand if isinstance(operand, str) else real_literal(operand, precision)

    def operation(pattern: str) -> Any:
        """Function that assigns an expression to a new local variable and returns the variable's name."""

        def write(*operands: Any) -> str:
            local_name = scope.free(f"t{len(local_names)}")
            local_names.append(local_name)
            statements.append(f"{local_name} := {pattern.format(*map(operand_text, operands))};")
            return local_name

        return write

    functions = {op: operation(pattern) for op, pattern in _OPERATIONS.items()}
    input_elements = element_names(inputs, program.inputs)
    results = evaluated(program, input_elements, functions)  # adds a statement for each operation
    output_elements = element_names(outputs, program.outputs)
    for element, result in zip(output_elements, results, strict=True):
        statements.append(f"{element} := {operand_text(result)};")
    declarations = []
    for parameter, port in zip(parameters, (*program.inputs, *program.outputs), strict=True):
        declarations.append(f"    {parameter} : {_array_type(port.size, real_type)};")
    local_declarations: list[str] = []
    if local_names:
        local_declarations = ["VAR", *_wrap(local_names, f" : {real_type};"), "END_VAR"]
    lines = [
        _comment(description),
        f"FUNCTION_BLOCK {name}",
        "VAR_INPUT",
        *declarations[:input_count],
        "END_VAR",
        "VAR_OUTPUT",
        *declarations[input_count:],
        "END_VAR",
        *local_declarations,
        *statements,
        "END_FUNCTION_BLOCK",
    ]
    return "\n".join(lines)


def _fused_pattern(product_sign: float, sum_sign: float) -> str:
    """Pattern of the expression ±(a b) ± c of a fused operation, from the signs of product and c."""
    product = "({0} * {1})" if product_sign > 0 else "-({0} * {1})"
    operator = "+" if sum_sign > 0 else "-"
    return product + f" {operator} {{2}}"


_OPERATIONS: Mapping[str, str] = {
    "add": "{0} + {1}", "sub": "{0} - {1}", "mul": "{0} * {1}", "div": "{0} / {1}", "neg": "-{0}",
    "min": "MIN({0}, {1})", "max": "MAX({0}, {1})",
    "sign": "SEL({0} > 0.0, SEL({0} < 0.0, 0.0, (-1.0)), 1.0)",
    "sqrt": "SQRT({0})", "sin": "SIN({0})", "cos": "COS({0})", "exp": "EXP({0})",
    **{op: _fused_pattern(*signs) for op, signs in FUSED.items()},
}  # fmt: skip
"""Expressions of the operations; MIN, MAX and SEL evaluate all operands, which have no side effects."""


def _array_type(size: int, real_type: str) -> str:
    """Type of an array with ``size`` entries of the type ``real_type``."""
    return f"ARRAY[0..{size - 1}] OF {real_type}"


def _wrap(items: Sequence[str], end: str, *, each: bool = True) -> Iterator[str]:
    """Items wrapped into lines, with commas between them.

    ``end`` follows each line if ``each`` is true. If not, ``end`` follows the last line, and a comma each other line.
    """
    end_of_line = end if each else ","
    line = ""
    for item in items:
        extended_width = len(line) + len(", ") + len(item) + len(end)
        if line and extended_width > _LINE_WIDTH:
            yield f"    {line}{end_of_line}"
            line = ""
        line += f", {item}" if line else item
    yield f"    {line}{end}"


def _comment(lines: Sequence[str]) -> str:
    """Comment with these lines, in which names from robot files cannot end or begin a comment."""
    safe_lines = [line.replace("*)", "* )").replace("(*", "( *") for line in lines]
    c_comment = comment(safe_lines)
    text = c_comment.removeprefix("/*").removesuffix("*/")
    return f"(*{text}*)"


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
    prefix = prefix_of(robot, prefix)
    file = Path(path)
    if file.is_dir():
        file = file / f"{prefix}.st"
    if file.suffix.lower() not in (".st", ".exp", ".txt", ".scl"):
        raise ValueRangeError(
            f"{label} {str(path)!r} is neither a folder that exists nor a name that ends in .st. Name it {prefix}.st."
        )
    check_outputs({label: file}, {"the robot": file_of(robot), **(inputs or {})})
    pairs = list(name_option_pairs(quantities))
    if style == "codesys":
        names = [name for name, _ in pairs]
        if names != ["inverse_dynamics"]:
            raise KernelError(
                f"{argument('style', 'codesys')} writes inverse_dynamics alone, which its interface is about."
            )
        pairs = [(name, {**options, "gravity": "input"}) for name, options in pairs]
    exports = requests(robot, pairs, precision, prefix)
    if torque == "motor":
        exports = [with_motor_torques(robot, request) for request in exports]
    scope = Names()
    blocks = [(scope.free(request.function.name), request) for request in exports]
    texts = [_header(robot, exports, torque)]
    for name, request in blocks:
        description = _description(robot, request, torque)
        texts.append(function_block(name, request, description))
    if style == "codesys":
        ((block, request),) = blocks  # inverse_dynamics alone
        texts.append(_codesys_wrapper(scope.free(f"{prefix}_dynamics"), block, request))
    if test:
        texts.append(_test_program(robot, scope.free(f"{prefix}_TEST"), blocks))
    with replacing(file) as temporary_file:
        temporary_file.write_text("\n\n".join(texts) + "\n", encoding="ascii", newline="\n")
    return Written([file], file, robot.name)


def _header(robot: Robot, exports: Sequence[Request], torque: str) -> str:
    """Comment at the beginning of the file: conventions, and entries of q and dq."""
    digests = ", ".join(request.function.program.digest[:_DIGEST_LETTERS] for request in exports)
    real_type = TYPES[exports[0].function.precision]
    gx, gy, gz = map(file_number, robot.gravity)
    torque_lines = []
    if torque == "motor":
        order = "order of the joints"
        if robot.model.couplings:
            order = f"order {', '.join(robot.model.drive_names)}"
        torque_lines = [f"tau of motor_torques: N m at the shafts of the motors, in the {order}."]
    return _comment(
        [
            f"Dynamics of the robot {robot.name} in Structured Text (IEC 61131-3), numbers of type {real_type}.",
            f"Written by twistwrench {version('twistwrench')}. Hash of the equations: {digests}.",
            "",
            *_CONVENTIONS.split("\n"),
            f"Gravity is ({gx}, {gy}, {gz}) m/s^2 in the base frame, unless it is an input.",
            *torque_lines,
            "",
            *entries(robot),
        ]
    )


def _description(robot: Robot, request: Request, torque: str) -> list[str]:
    """Comment lines of one block."""
    lines = comment_lines(robot, request)
    if torque == "motor":
        lines[0] = (  # in place of the title of inverse dynamics
            "Motor torques: inverse dynamics at the shafts of the motors, (torque through the gear at its efficiency + rotor) "
            "/ ratio."
        )
    return lines


def _test_program(robot: Robot, name: str, blocks: Sequence[tuple[str, Request]]) -> str:
    """Program that compares every block with the results of twistwrench; its output is ``Passed``."""
    block_names = [block for block, _ in blocks]
    scope = Names([name, *block_names, "Passed", "Worst"])
    _, first_request = blocks[0]
    real_type = TYPES[first_request.function.precision]
    k, i, difference = map(scope.free, ("k", "i", "apart"))
    declarations = [f"    {k}, {i} : DINT;", f"    {difference} : {real_type};"]
    statements = ["Passed := TRUE;", "Worst := 0.0;"]
    for block, request in blocks:
        block_declarations, block_statements = _block_test(robot, block, request, scope, (k, i, difference))
        declarations += block_declarations
        statements += block_statements
    return "\n".join(
        [
            _comment([
                f"Run once: Passed is TRUE if all blocks return the numbers of twistwrench at {STATES} states.",
                "Worst is the largest difference, as a share of the difference that rounding explains.",
            ]),
            f"PROGRAM {name}",
            "VAR_OUTPUT",
            "    Passed : BOOL;",
            f"    Worst : {real_type};",
            "END_VAR",
            "VAR",
            *declarations,
            "END_VAR",
            *statements,
            "END_PROGRAM",
        ]
    )  # fmt: skip


def _block_test(
    robot: Robot, block: str, request: Request, scope: Names, variables: tuple[str, str, str]
) -> tuple[list[str], list[str]]:
    """Declarations and statements for one block.

    ``variables`` are the names of the state's index, of the entry's index, and of the difference.
    """
    program = request.function.program
    precision = request.function.precision
    k, i, difference = variables
    real_type = TYPES[precision]
    instance = scope.free(f"{block}_1")
    block_scope = Names([block])
    parameters = [block_scope.free(parameter) for parameter in request.function.parameters]
    dtype = np.float32 if precision == "float" else np.float64
    inputs = inputs_at_states(robot, request, dtype, STATES)
    results, tolerances = results_at_states(robot, request, inputs, NumpyKernel(program, block, ""))
    input_count = len(program.inputs)
    declarations = [f"    {instance} : {block};"]
    loads: list[str] = []  # statements that fill the inputs
    checks: list[str] = []  # statements that compare the outputs
    assignments: list[str] = []  # of the call
    ports = (*program.inputs, *program.outputs)
    port_values = (*inputs, *results)
    for port_index, (parameter, port, values) in enumerate(zip(parameters, ports, port_values, strict=True)):
        table = scope.free(f"{block}_{parameter}_data")
        # Only in expressions do negative numbers need parentheses.
        literals = [real_literal(float(x), precision).strip("()") for x in np.ravel(values)]
        declarations.append(f"    {table} : {_array_type(STATES * port.size, real_type)} := [")
        declarations += _wrap(literals, "];", each=False)
        loop = f"    FOR {i} := 0 TO {port.size - 1} DO"
        entry = f"{table}[{port.size} * {k} + {i}]"
        if port_index < input_count:
            array = scope.free(f"{block}_{parameter}")
            assignments.append(f"{parameter} := {array}")
            declarations.append(f"    {array} : {_array_type(port.size, real_type)};")
            loads += [loop, f"        {array}[{i}] := {entry};", "    END_FOR;"]
            continue
        allowed_difference = largest_entry(np.asarray(values)) * tolerances[port_index - input_count]
        allowed = real_literal(allowed_difference, precision)
        checks += [
            loop,
            f"        {difference} := ABS({instance}.{parameter}[{i}] - {entry}) / {allowed};",
            f"        IF NOT ({difference} <= 1.0) THEN",  # true for NaN
            "            Passed := FALSE;",
            "        END_IF;",
            f"        Worst := MAX(Worst, {difference});",
            "    END_FOR;",
        ]
    call = f"    {instance}({', '.join(assignments)});"
    return declarations, [f"FOR {k} := 0 TO {STATES - 1} DO", *loads, call, *checks, "END_FOR;"]


def _codesys_wrapper(name: str, block: str, request: Request) -> str:
    """Wrapper for CODESYS' SM3_Dynamics, to be completed by the user."""
    program = request.function.program
    inputs = request.function.parameters[: len(program.inputs)]
    declarations = []
    for parameter, port in zip(inputs, program.inputs, strict=True):
        declarations.append(f"    {parameter} : {_array_type(port.size, 'LREAL')};")
    assignments = ", ".join(f"{parameter} := {parameter}" for parameter in inputs)
    (output,) = program.outputs  # tau
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
            "VAR_INPUT",
            *declarations,
            "END_VAR",
            "VAR_OUTPUT",
            f"    tau : {_array_type(output.size, 'LREAL')};",
            "END_VAR",
            f"block({assignments});",
            "tau := block.tau;",
            "END_METHOD",
        ]
    )  # fmt: skip
