"""The commands ``twistwrench export`` and ``convert``: programs as source, robots in another format."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import click

from ..core.arguments import assignments
from ..core.errors import ValueRangeError
from ..motion.load_case import LoadCase, payloads_of
from ..robot import Robot
from ..robot.export.written import Saved, Written
from ..robot.save import save, writer_of
from ..robots.cell import RobotCell, join
from .main import note, option
from .parameters import Question, Spelling
from .shared import PAYLOADS, RobotOptions
from .skin import Asked, OutputFile, Outputs, command_of

# Options of a quantity whose values are lists.
_LIST_OPTIONS = ("by", "parameters", "rows", "wrenches")
# Options of export_c, which export_st has too.
_C_OPTIONS = ("precision", "prefix", "test")


@command_of(
    "export",
    Robot.export_c,
    option(
        "--c FOLDER|OUT.c", "Write C99: a header, a source and a test program, into a folder or beside OUT.c.", "path"
    ),
    option("--st FOLDER|OUT.st", "Write Structured Text (IEC 61131-3) for PLCs, with a test; it was not run on a PLC."),
    option("--ros2 DIR", "Write a ROS 2 package, a plug-in of inverse_dynamics_solver; DIR is made and names it."),
    option(
        "--quantity NAME[:OPTION=VALUE,…]",
        "Function to export, such as mass_matrix or jacobian:frame=tool0,kind=space; may be repeated. Join several values "
        "of wrenches=, rows=, by= and parameters= by +. [default: inverse_dynamics]",
        "quantities",
        multiple=True,
    ),
    PAYLOADS,
    option("--gravity-input", "Make gravity an input of each function."),
    further_questions=(
        Question(
            Robot.export_st,
            left_out=("quantities", "path", *_C_OPTIONS),
            spellings={"torque": Spelling("--torque-side", {"joint": "joint", "motor": "motor"})},
        ),
        Question(Robot.export_ros2, left_out=("path",)),
    ),
    left_out=("quantities", "path"),
    spellings={
        "precision": Spelling("--float", {"": "float"}),
        "test": Spelling("--no-test-program", {"": False}),
    },
    examples=(
        "export panda --c . --quantity inverse_dynamics --quantity mass_matrix",
        "export ur5 --st ur5.st --payload 3 --actuators demo --torque-side motor",
        "export panda --ros2 panda_dynamics --payload 2",
    ),
)
def export_command(
    robot: RobotOptions,
    asked: Asked,
    path: str | None,
    st: str | None,
    ros2: str | None,
    quantities: Sequence[str],
    payloads: tuple[str, ...],
    gravity_input: bool,
) -> Written:
    """Write dynamics functions of a robot as C99, Structured Text or a ROS 2 package, with a test program."""
    from ..robot.export.c99 import export_c
    from ..robot.export.ros2 import export_ros2
    from ..robot.export.structured_text import export_st

    if path is None and st is None and ros2 is None:
        raise ValueRangeError("nothing is to be written. Add --c OUT.c, --st OUT.st or --ros2 DIR.")
    st_options = _selected(asked, "style", "torque")
    ros2_options = _selected(asked, "license")
    if st is None and st_options:
        raise ValueRangeError("--style and --torque-side apply to Structured Text. Add --st OUT.st, or leave them out.")
    if ros2 is not None and (gravity_input or "precision" in asked or "prefix" in asked):
        raise ValueRangeError("--gravity-input, --float and --prefix do not apply to --ros2. Leave them out.")
    load_case = LoadCase(robot.load(), payloads_of(list(payloads), robot.tip))
    loaded_robot = load_case.with_load
    requests = [_quantity(text) for text in quantities or ("inverse_dynamics",)]  # names with their options
    if gravity_input:
        requests = [(name, {**options, "gravity": "input"}) for name, options in requests]
    common_options = _selected(asked, *_C_OPTIONS) | {"inputs": robot.files}
    written: list[Written] = []
    if ros2 is not None:
        written.append(export_ros2(loaded_robot, ros2, label="--ros2", **ros2_options))
    if st is not None:
        written.append(export_st(loaded_robot, requests, st, label="--st", **common_options, **st_options))
    if path is not None:
        written.append(export_c(loaded_robot, requests, path, label="--c", **common_options))
    return Written.joined(written)


def _selected(asked: Asked, *names: str) -> dict[str, Any]:
    """Typed options that have one of the names."""
    return {name: value for name, value in asked.items() if name in names}


def _quantity(text: str) -> tuple[str, dict[str, Any]]:
    """Parse ``name:option=value,…`` into name and options."""
    name, colon, options_text = text.partition(":")
    form = "OPTION=VALUE, as in jacobian:frame=tool0,kind=space"
    entries = options_text.split(",") if colon else []
    options: dict[str, Any] = dict(assignments(entries, f"--quantity {text!r}:", form))
    for option_name in options.keys() & set(_LIST_OPTIONS):
        options[option_name] = tuple(options[option_name].split("+"))
    return name.strip(), options


# ── ``convert``: a robot into a file of another format


@command_of(
    "convert",
    save,
    click.argument("path", metavar="OUT"),
    left_out=("path",),
    examples=("convert panda panda.xml",),
)
def convert_command(robot: RobotOptions, asked: Asked, outputs: Outputs[Saved], path: str, overwrite: bool) -> Saved:
    """Write a robot file in another format: OUT.urdf, OUT.xml (MJCF) or OUT.sdf.

    Properties that the format cannot represent are listed. With --strict they make the verdict UNSURE and the exit code 1.
    """
    outputs.check(overwrite=overwrite, function_files={"OUT": path})
    loaded_robot = robot.load()
    saved = save(loaded_robot, Path(path), overwrite=overwrite, **asked)
    _note_shapes(len(loaded_robot.model.shaped))
    return saved


# ── ``join``: several robots into one


@command_of(
    "join",
    join,
    click.argument("path", metavar="OUT"),
    click.argument("parts", metavar="PART...", nargs=-1, required=True),
    left_out=("parts",),
    with_robot=False,
    reads=lambda parts: {f"PART {part}": Path(part) for part in parts if Path(part).is_file()},
    examples=(
        "join cell.urdf ur5 planar_2r@tool0:hand_",
        "join two_arms.urdf ur5@floor:left_ ur5@floor+0,1,0,0,0,0:right_",
    ),
)
def join_command(
    outputs: Outputs[RobotCell], path: str, parts: tuple[str, ...], asked: Asked, overwrite: bool
) -> RobotCell:
    """Join robots to one file: a rail, an arm on it, a gripper at its tip, a second arm beside it.

    PART is FILE@FRAME+x,y,z,roll,pitch,yaw:PREFIX; all but FILE may be left out. The first part stands at the origin, a later
    one at a FRAME of the cell so far, by default its tip; parts on the frame 'floor' stand side by side. Lengths are in m,
    angles in rad, or as 30deg. PREFIX is put before the names of the part.
    """
    outputs.check(overwrite=overwrite, function_files={"OUT": path})
    writer_of(path)
    cell = join(*parts, **{"name": Path(path).stem, **asked})
    outputs.add(OutputFile("OUT", "", partial(_write_cell, overwrite=overwrite)), path)
    return cell


def _write_cell(cell: RobotCell, path: str, *, overwrite: bool) -> None:
    """Write the cell, and print a note on each property that its file cannot represent."""
    for sentence in cell.write(path, overwrite=overwrite):
        note(f"lost: {sentence}")
    _note_shapes(sum(len(part.robot.model.shaped) for part in cell.parts))


def _note_shapes(count: int) -> None:
    """Print a note on the number of links whose shapes are not written."""
    if count:
        noun = "link" if count == 1 else "links"
        note(f"the shapes of {count} {noun} are not written: a robot keeps what moves and weighs.")
