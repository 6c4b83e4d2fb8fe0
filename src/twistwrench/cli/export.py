"""The commands ``twistwrench export`` and ``convert``: programs as source, robots in another format."""

from __future__ import annotations

import shlex
from typing import Any

import click

from ..core.files import check_outputs
from ..core.verdict import ExitCode
from ..errors import ValueRangeError
from ..model.description import grouped
from ..robot.load import save
from .console import show_written
from .robot_options import RobotOptions, robot_command
from .usage import Given, option_group

_LISTS = ("by", "parameters", "rows", "wrenches")


export_options = option_group(
    click.option("--no-test", is_flag=True, help="Leave out the program that checks the functions."),
    click.option("--prefix", metavar="NAME", help="What the functions' names begin with; the robot's name otherwise."),
    click.option("--float", "precision", flag_value="float", default="double", help="Single precision."),
    click.option(
        "--quantity",
        "quantities",
        metavar="NAME[:OPTION=VALUE,…]",
        multiple=True,
        default=("inverse_dynamics",),
        show_default=True,
        help="A function, such as mass_matrix or jacobian:frame=tool0,kind=space; may be repeated. Several of "
        "wrenches=, rows=, by= and parameters= are joined by +.",
    ),
    click.option(
        "--c",
        "path",
        metavar="FOLDER|OUT.c",
        required=True,
        help="Write C99: a header, a source and its test, into a folder or beside each other.",
    ),
)
"""The options of the command, all but the robot's own."""


@robot_command(
    "export", export_options, examples=("export panda --c . --quantity inverse_dynamics --quantity mass_matrix",)
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
    options: dict[str, Any] = {}
    for part in rest.split(",") if colon else ():
        option, equals, value = (word.strip() for word in part.partition("="))
        if not (option and equals and value):
            raise ValueRangeError(
                f"--quantity {text!r}: {part!r} is not OPTION=VALUE, as in jacobian:frame=tool0,kind=space."
            )
        if option in options:
            raise ValueRangeError(f"--quantity {text!r} gives {option} twice. Keep one of them.")
        options[option] = tuple(value.split("+")) if option in _LISTS else value
    return name.strip(), options


# ── ``convert``: a robot into a file of another format

convert_options = option_group(
    click.option("--force", "overwrite", is_flag=True, help="Replace OUT if it is there."),
    click.argument("out", metavar="OUT"),
)
"""The arguments and options of the command, all but the robot's own."""


@robot_command("convert", convert_options, examples=("convert panda panda.xml",), robot_first=True)
def convert_command(options: RobotOptions, given: Given) -> ExitCode:
    """The robot as a file of another format: OUT.urdf, OUT.xml (MJCF) or OUT.sdf.

    Exit code 1 if the format cannot say something of the robot, which is listed; the file is written all the same.
    """
    check_outputs({"OUT": given.out}, options.files)
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
