"""The command ``twistwrench excite``: from the robot to the exciting motion, its report and its file."""

from __future__ import annotations

import math

import click
import numpy as np
from rich.console import Group, RenderableType
from rich.text import Text

from ..core.files import check_outputs
from ..core.numbers import number, percent_of_limit
from ..core.verdict import ExitCode
from ..identification import ExcitingMotion, exciting_trajectory
from ..joints.units import heading_unit
from ..motion.coordinates import Coordinates
from .console import progress_bar, show
from .motion_options import FRICTION_LAWS, NO_MOTOR_INERTIA, parse_friction
from .plain_table import PlainTable, verdict_word
from .robot_options import RobotOptions, robot_command
from .usage import Given, option_group

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


@robot_command(
    "excite", excite_options, examples=("excite panda --seconds 20 --harmonics 5 --out motion.csv",), robot_first=True
)
def excite_command(options: RobotOptions, given: Given) -> ExitCode:
    """A motion whose log tells the robot's masses, inertias and friction best, at rest at both ends and within all limits.

    The limits are those of positions, velocities, accelerations and torques, and the floor if one is given. Links stay 20 mm
    away from it and from each other, by capsules around the shapes of the robot's file; of links without shapes capsules are
    assumed. The first word is the verdict: OK ends with exit code 0; UNSURE with 1 where capsules are assumed or something was
    not looked at. The motion is written in either case.
    """
    check_outputs({"--out": given.out_path}, options.files)
    robot = options.load()
    with progress_bar("looking for a motion") as progress:
        found = exciting_trajectory(
            robot,
            given.duration,
            given.harmonics,
            share=given.share,
            acceleration=given.acceleration,
            floor=given.floor,
            clear_of_itself=not given.ignore_self,
            criterion=given.criterion,
            motor_inertia=not given.no_motor_inertia,
            friction=parse_friction(given.friction),
            noise=given.noise,
            seed=given.seed,
            restarts=given.restarts,
            step=given.step,
            progress=progress,
        )
    show(excitation_view(found, degrees=options.degrees))
    if given.out_path is not None:
        click.echo(f"wrote {found.to_csv(given.out_path, degrees=options.degrees)}")
    return found.verdict.exit_code


# ── The report


def excitation_view(found: ExcitingMotion, *, degrees: bool) -> RenderableType:
    """The verdict, heading, a row per joint, and a row per group."""
    deviations = found.predicted_deviations
    return Group(
        *_verdict(found),
        Text(),
        Text.assemble(
            (found.robot.name, "bold"),
            f"  ·  {number(found.duration)} s, {found.series.harmonics} harmonics, at rest at both ends  ·  condition "
            f"{number(found.condition)}  ·  log det {number(found.log_det)}  ·  median deviation "
            f"{number(np.median(deviations), 2)}",
        ),
        _joints(found, degrees=degrees),
        _excited_groups(found),
    )


def _verdict(found: ExcitingMotion) -> list[Text]:
    """Verdict with the least distances or its reasons, a line each."""
    words = {"itself": "of capsules around links from each other", "floor": "from the floor"}
    least = [f"{number(1000.0 * value)} mm {words[name]}" for name, value in found.clearances.items()]
    distances = f"least distances: {', '.join(least)}" if least else "nothing can touch"
    reasons = found.verdict.reasons or (distances,)
    lines = [Text.assemble(verdict_word(found.verdict.word), f": {reasons[0]}.")]
    lines += [Text(f"  - {reason}.") for reason in reasons[1:]]
    return lines + ([Text(f"{distances[0].upper()}{distances[1:]}.")] if found.verdict.reasons and least else [])


def _joints(found: ExcitingMotion, *, degrees: bool) -> PlainTable:
    robot, peaks = found.robot, found.peaks
    turning = Coordinates.from_model(robot.model).angular_velocity
    unit = np.where(turning & degrees, math.degrees(1.0), 1.0)
    place, speed, rate, torque = (heading_unit(part, turning, degrees=degrees) for part in ("q", "dq", "ddq", "tau"))
    table = PlainTable()
    table.words("joint", fold=False)
    table.numbers(f"from [{place}]", "to", f"peak [{speed}]", "share", f"[{rate}]", f"[{torque}]", "share")
    shares = [
        [
            percent_of_limit(v / m if math.isfinite(m) and m > 0 else None)
            for v, m in zip(peaks[part], limits, strict=True)
        ]
        for part, limits in (("velocity", robot.limits.velocity), ("torque", robot.limits.effort))
    ]
    for k, name in enumerate(robot.model.velocity_names):
        lower, upper, velocity, acceleration = (
            peaks[part][k] * unit[k] for part in ("lower", "upper", "velocity", "acceleration")
        )
        table.row(name, lower, upper, velocity, shares[0][k], acceleration, peaks["torque"][k], shares[1][k])
    return table


def _excited_groups(found: ExcitingMotion) -> PlainTable:
    base = found.information.base
    table = PlainTable(f"{base.count} groups of parameters, and how sure a log of the motion makes them")
    table.words("group")
    table.numbers("file", "deviation")
    file = base.project(base.unknown.file_values)
    for name, deviation, value in zip(found.groups, found.predicted_deviations, file, strict=True):
        table.row(name, value, number(deviation, 2))
    return table
