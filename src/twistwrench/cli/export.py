"""The commands ``twistwrench export`` and ``convert``: programs as source, robots in another format."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, Literal

import click

from ..errors import ValueRangeError
from .motion_options import option_group
from .robot_options import RobotOptions

if TYPE_CHECKING:
    from ..robot import Robot

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


def run_export(
    robot: Robot,
    inputs: Mapping[str, str | None],
    *,
    path: str,
    quantities: tuple[str, ...],
    precision: Literal["double", "float"],
    prefix: str | None,
    no_test: bool,
) -> Iterator[str]:
    """Write the files, and say so; ``inputs`` maps what the user calls the files that were read to them."""
    from ..export.c99 import export_c

    written = export_c(
        robot,
        [_quantity(text) for text in quantities],
        path,
        precision=precision,
        prefix=prefix,
        test=not no_test,
        label="--c",
        inputs=inputs,
    )
    for file in written:
        yield f"wrote {file}"
    if not no_test:
        _, source, test = written
        yield f"to check it: cc -O2 {shlex.quote(str(source))} {shlex.quote(str(test))} -lm && ./a.out"


def _quantity(text: str) -> tuple[str, dict[str, Any]]:
    """(name, options) of ``name:option=value,…``."""
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


def run_convert(options: RobotOptions, say: Callable[[str], Any], *, out: str, overwrite: bool) -> bool:
    """Write the file, and say what is not in it; whether all is."""
    from ..core.files import check_outputs
    from ..model.notes import grouped
    from ..robot.load import save

    check_outputs({"OUT": out}, options.files)
    robot = options.load()
    lost = save(robot, out, overwrite=overwrite)
    say(f"wrote {out}")
    for sentence in grouped(lost):
        say(f"lost: {sentence}")
    if shaped := len(robot.model.shaped):
        click.echo(
            f"note: the shapes of {shaped} link{'s' * (shaped > 1)} are not written: a robot keeps what moves and weighs.",
            err=True,
        )
    return not lost
