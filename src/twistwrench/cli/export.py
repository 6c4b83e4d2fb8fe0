"""The commands ``twistwrench export`` and ``convert``: programs as source, robots in another format."""

from __future__ import annotations

import shlex
from typing import Any

import click

from ..answers.data import plain
from ..core.arguments import assignments
from ..core.errors import ValueRangeError
from ..core.verdict import ExitCode
from ..robot.load import save
from .main import Given, keep_answer, note, option
from .shared import JSON, PAYLOADS, RobotOptions, load_case, robot_command, show_written
from .terminal import show

_LISTS = ("by", "parameters", "rows", "wrenches")


@robot_command(
    "export",
    option(
        "--c FOLDER|OUT.c", "Write C99: a header, a source and a test program, into a folder or beside OUT.c.", "path"
    ),
    option("--st FOLDER|OUT.st", "Write Structured Text (IEC 61131-3) for PLCs, with a test; it was not run on a PLC."),
    option("--ros2 DIR", "Write a ROS 2 package, a plug-in of inverse_dynamics_solver; DIR is made and names it."),
    option("--license NAME", "License in the ROS 2 package.", default="Apache-2.0"),
    option(
        "--quantity NAME[:OPTION=VALUE,…]",
        "Function to export, such as mass_matrix or jacobian:frame=tool0,kind=space; may be repeated. Join several values "
        "of wrenches=, rows=, by= and parameters= by +.",
        "quantities",
        multiple=True,
        default=("inverse_dynamics",),
    ),
    PAYLOADS,
    option("--gravity-input", "Make gravity an input of each function."),
    option(
        "--float",
        "Use single precision. [default: double]",
        "precision",
        flag_value="float",
        default="double",
        show_default=False,
    ),
    option("--prefix NAME", "Prefix of function names. [default: the robot's name]"),
    option(
        "--style",
        "Structured Text only; 'codesys' adds a block for its interface, to complete by hand.",
        choices=("function_block", "codesys"),
        default="function_block",
    ),
    option(
        "--torque-side",
        "Structured Text only: torques at the joints, or at the motor shafts of --actuators.",
        "torque",
        choices=("joint", "motor"),
        default="joint",
    ),
    option("--test-program/--no-test-program", "Write a program that tests the functions.", "test", default=True),
    examples=(
        "export panda --c . --quantity inverse_dynamics --quantity mass_matrix",
        "export ur5 --st ur5.st --payload 3 --actuators demo --torque-side motor",
        "export panda --ros2 panda_dynamics --payload 2",
    ),
    angles=False,
)
def export_command(options: RobotOptions, given: Given) -> None:
    """Write dynamics functions of a robot as C99, Structured Text or a ROS 2 package, with a test program."""
    from ..robot.export.c99 import export_c
    from ..robot.export.ros2 import export_ros2
    from ..robot.export.structured_text import export_st

    if given.path is None and given.st is None and given.ros2 is None:
        raise ValueRangeError("nothing is to be written. Add --c OUT.c, --st OUT.st or --ros2 DIR.")
    if given.st is None and (given.style, given.torque) != ("function_block", "joint"):
        raise ValueRangeError("--style and --torque-side apply to Structured Text. Add --st OUT.st, or leave them out.")
    robot = load_case(options.load(), options, given).with_load
    wanted = [_quantity(text) for text in given.quantities]
    if given.gravity_input:
        wanted = [(name, {**own, "gravity": "input"}) for name, own in wanted]
    common = given.pick("precision", "prefix", "test") | {"inputs": options.files}
    if given.ros2 is not None:
        if given.gravity_input or given.precision != "double" or given.prefix is not None:
            raise ValueRangeError("--gravity-input, --float and --prefix do not apply to --ros2. Leave them out.")
        export_ros2(robot, given.ros2, license=given.license, label="--ros2")
        show_written(given.ros2)
    if given.st is not None:
        show_written(*export_st(robot, wanted, given.st, label="--st", **given.pick("style", "torque"), **common))
    if given.path is not None:
        written = export_c(robot, wanted, given.path, label="--c", **common)
        show_written(*written)
        if given.test:
            _, source, test = written
            click.echo(f"to check it: cc -O2 {shlex.quote(str(source))} {shlex.quote(str(test))} -lm && ./a.out")


def _quantity(text: str) -> tuple[str, dict[str, Any]]:
    """Parse ``name:option=value,…`` into name and options."""
    name, colon, rest = text.partition(":")
    form = "OPTION=VALUE, as in jacobian:frame=tool0,kind=space"
    options = assignments(rest.split(",") if colon else (), f"--quantity {text!r}:", form)
    return name.strip(), {k: tuple(value.split("+")) if k in _LISTS else value for k, value in options.items()}


# ── ``convert``: a robot into a file of another format


@robot_command(
    "convert",
    click.argument("out", metavar="OUT"),
    JSON,
    option("--strict", "Count properties that the format cannot represent against the verdict."),
    examples=("convert panda panda.xml",),
    robot_first=True,
    angles=False,
)
def convert_command(options: RobotOptions, given: Given) -> ExitCode:
    """Write a robot file in another format: OUT.urdf, OUT.xml (MJCF) or OUT.sdf.

    Properties that the format cannot represent are listed. With --strict they make the verdict UNSURE and the exit code 1.
    """
    given.check_files(options.files)
    robot = options.load()
    saved = save(robot, given.out, overwrite=given.overwrite, strict=given.strict)
    keep_answer(saved)
    line, *lost = saved.blocks()
    click.echo(plain(line))  # not wrapped, so that the path stays whole
    show(*lost)
    if shaped := len(robot.model.shaped):
        note(f"the shapes of {shaped} link{'s' * (shaped > 1)} are not written: a robot keeps what moves and weighs.")
    return saved.verdict.exit_code
