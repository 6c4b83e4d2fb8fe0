"""The command ``twistwrench excite``: its options, and its run from the robot to the file of the motion."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import click

from ..core.verdict import ExitCode
from .console import progress_bar
from .motion_options import FRICTION_LAWS, NO_MOTOR_INERTIA, option_group, parse_friction
from .robot_options import RobotOptions

if TYPE_CHECKING:
    from rich.console import RenderableType


excite_options = option_group(
    click.option(
        "--out", "out_path", metavar="OUT.csv", help="Write the motion, as 'torques', 'view' and 'plot' read it."
    ),
    click.option(
        "--step", type=float, default=0.01, show_default=True, metavar="SECONDS", help="Between rows of --out."
    ),
    click.option(
        "--noise", type=float, metavar="NM", help="Of the torques [N m, N]; a hundredth of each limit if not given."
    ),
    click.option("--restarts", type=int, default=3, show_default=True, help="How often the search begins anew."),
    click.option("--seed", type=int, default=0, show_default=True, help="Of the motions it begins with."),
    click.option(
        "--ignore-self", is_flag=True, help="Do not keep links clear of each other; the answer is then UNSURE."
    ),
    click.option("--floor", type=float, metavar="Z", help="Height that no link goes below [m]."),
    click.option(
        "--criterion",
        type=click.Choice(["log_det", "deviations"]),
        default="log_det",
        show_default=True,
        help="What is sought: the largest log det of the information, or the least median of the deviations.",
    ),
    click.option(
        "--acceleration", type=float, metavar="A", help="Limit every joint to it, used wholly [rad/s², m/s²]."
    ),
    click.option(
        "--share", type=float, default=0.9, show_default=True, help="Of the robot's limits that the motion uses."
    ),
    FRICTION_LAWS,
    NO_MOTOR_INERTIA,
    click.option("--harmonics", type=int, default=5, show_default=True, help="Of the Fourier series."),
    click.option(
        "--seconds", "duration", type=float, default=20.0, show_default=True, help="How long, the first harmonic."
    ),
)
"""The options of the command, all but the robot's own."""


def run_excite(
    options: RobotOptions,
    show: Callable[[RenderableType], None],
    *,
    duration: float,
    harmonics: int,
    share: float,
    acceleration: float | None,
    floor: float | None,
    ignore_self: bool,
    criterion: Any,
    friction: str,
    no_motor_inertia: bool,
    noise: float | None,
    seed: int,
    restarts: int,
    step: float,
    out_path: str | None,
) -> ExitCode:
    """Print what the motion will tell with ``show``, and write it; 0 where the verdict is OK. Raises errors of the library."""
    from ..core.files import check_outputs
    from ..identification import exciting_trajectory
    from .tables.measurement import excitation_view

    check_outputs({"--out": out_path}, options.files)
    robot = options.load()
    with progress_bar("looking for a motion") as progress:
        found = exciting_trajectory(
            robot,
            duration,
            harmonics,
            share=share,
            acceleration=acceleration,
            floor=floor,
            clear_of_itself=not ignore_self,
            criterion=criterion,
            motor_inertia=not no_motor_inertia,
            friction=parse_friction(friction),
            noise=noise,
            seed=seed,
            restarts=restarts,
            step=step,
            progress=progress,
        )
    show(excitation_view(found, degrees=options.degrees))
    if out_path is not None:
        click.echo(f"wrote {found.to_csv(out_path, degrees=options.degrees)}")
    return found.verdict.exit_code
