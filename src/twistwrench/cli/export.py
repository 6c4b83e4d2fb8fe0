"""The commands ``twistwrench export`` and ``convert``: programs as source, robots in another format."""

from __future__ import annotations

import shlex
from typing import Any

import click

from ..core.verdict import ExitCode
from ..model.description import grouped
from ..reports.robot_summary import assignments
from ..robot.load import save
from .main import Given, option
from .shared import RobotOptions, robot_command, show_written

_LISTS = ("by", "parameters", "rows", "wrenches")


@robot_command(
    "export",
    option(
        "--c FOLDER|OUT.c",
        "Write C99: a header, a source and its test, into a folder or beside each other.",
        "path",
        required=True,
    ),
    option(
        "--quantity NAME[:OPTION=VALUE,…]",
        "A function, such as mass_matrix or jacobian:frame=tool0,kind=space; may be repeated. Several of "
        "wrenches=, rows=, by= and parameters= are joined by +.",
        "quantities",
        multiple=True,
        default=("inverse_dynamics",),
    ),
    option("--float", "Single precision.", "precision", flag_value="float", default="double", show_default=False),
    option("--prefix NAME", "What the functions' names begin with; the robot's name otherwise."),
    option("--no-test", "Leave out the program that checks the functions."),
    examples=("export panda --c . --quantity inverse_dynamics --quantity mass_matrix",),
)
def export_command(options: RobotOptions, given: Given) -> None:
    """The robot's quantities as C99 source that allocates nothing and needs math.h only, with a program that checks it."""
    from ..export.c99 import export_c

    written = export_c(
        options.load(),
        [_quantity(text) for text in given.quantities],
        given.path,
        precision=given.precision,
        prefix=given.prefix,
        test=not given.no_test,
        label="--c",
        inputs=options.files,
    )
    show_written(*written)
    if not given.no_test:
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
    option("--force", "Replace OUT if it is there.", "overwrite"),
    examples=("convert panda panda.xml",),
    robot_first=True,
)
def convert_command(options: RobotOptions, given: Given) -> ExitCode:
    """The robot as a file of another format: OUT.urdf, OUT.xml (MJCF) or OUT.sdf.

    Exit code 1 if the format cannot say something of the robot, which is listed; the file is written all the same.
    """
    given.check_files(options.files)
    robot = options.load()
    lost = save(robot, given.out, overwrite=given.overwrite)
    show_written(given.out)
    for sentence in grouped(lost):
        click.echo(f"lost: {sentence}")
    if shaped := len(robot.model.shaped):
        click.echo(
            f"note: the shapes of {shaped} link{'s' * (shaped > 1)} are not written: a robot keeps what moves and weighs.",
            err=True,
        )
    return ExitCode.NO if lost else ExitCode.FINE
