"""The command ``twistwrench convert``: a robot into a file of another format."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import click

from .robot_options import RobotOptions
from .shared_options import option_group

convert_options = option_group(
    click.option("--force", "overwrite", is_flag=True, help="Replace OUT if it is there."),
    click.argument("out", metavar="OUT"),
)
"""The arguments and options of the command, all but the robot's own."""


def answer_convert(options: RobotOptions, say: Callable[[str], Any], *, out: str, overwrite: bool) -> bool:
    """Write the file, and say what is not in it; whether all is."""
    from ..model.remark import grouped
    from ..outputs import check_outputs
    from ..robot.save import save

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
