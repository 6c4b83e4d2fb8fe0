"""How every command reads a motion: its options, and the robot and the file that they give."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..errors import ValueRangeError
from .bundled_files import bundled
from .robot_options import RobotOptions
from .shared_options import COLUMNS, LOCK_MISSING, NO_FRICTION, PAYLOADS, RATE, WRENCHES, Decorator, option_group

if TYPE_CHECKING:
    from ..model.model import Model
    from ..motion.motion import Motion
    from ..motion.motion_log import MotionLog
    from ..robot import Robot

Load = Callable[..., "tuple[Robot, tuple[str, ...]]"]
"""Loads the robot meant, and tells the joints held still; ``stiff`` takes elastic gears to be rigid, ``held`` names joints of
the robot's model that are to be held at neutral besides."""


def motion_options(*, required: bool) -> Decorator:
    """The options that say which motion is meant, and how its file is read."""
    return option_group(
        click.option(
            "--smooth", is_flag=True, help="Smooth a noisy log, as much as its noise asks, before deriving from it."
        ),
        LOCK_MISSING,
        RATE,
        COLUMNS,
        click.option(
            "--trajectory",
            metavar="FILE.csv",
            required=required,
            help="The motion; 'demo' is the one bundled with a robot.",
        ),
    )


def loaded_motion_options(*, required: bool) -> Decorator:
    """The motion, what the robot carries in it, and what pushes on it."""
    return option_group(NO_FRICTION, WRENCHES, PAYLOADS, motion_options(required=required))


def open_motion(
    load: Load, path: Path, *, degrees: bool, columns: Iterable[str], rate: float | None, lock_missing: bool
) -> tuple[Robot, MotionLog]:
    """The robot, and the motion in the file as a motion of it; raises what :meth:`MotionLog.open` raises."""
    from ..motion.motion_file import joints_without_column, moves_motors, open_motion_file
    from ..motion.motion_log import MotionLog

    told = parse_columns(columns)
    file = open_motion_file(path)
    missing: list[str] = []

    def held(model: Model) -> list[str]:
        missing[:] = joints_without_column(file, model, columns=told)
        return missing

    options: dict[str, Any] = {"stiff": not moves_motors(file)} | ({"held": held} if lock_missing else {})
    robot, locked = load(**options)
    still = [name for name in missing if name in locked]
    return robot, MotionLog.open(file, robot.model, degrees=degrees, locked=locked, columns=told, rate=rate, held=still)


def refuse_motor_side(options: RobotOptions, robot: Robot, command: str) -> None:
    """Raise ValueRangeError where the actuator file says that logs have the motors' positions: joints' are read."""
    from ..formats.log_entry import read_log_side

    if options.actuators is None:
        return
    source = bundled(options.actuators, options.source, ".yaml", "actuator file")
    if read_log_side(robot.model, source).of_motors:
        raise ValueRangeError(
            f"{source} says that logs have the motors' positions (log: side: motor), and {command} reads those of the joints. "
            "Write them first: tw.identification.read_motion(log, robot, side=tw.identification.motor_side(robot.model, "
            "file)).to_csv(path); twistwrench identify reads either."
        )


def parse_columns(texts: Iterable[str]) -> dict[str, str]:
    """Read ``JOINT=COLUMN`` each; raises :class:`~twistwrench.ValueRangeError`, which shows the form.

    >>> parse_columns(["elbow=pos3", "time=Time [ms]"])
    {'elbow': 'pos3', 'time': 'Time [ms]'}
    """
    found: dict[str, str] = {}
    for text in texts:
        name, equals, column = (part.strip() for part in text.partition("="))
        if not equals or not name or not column:
            raise ValueRangeError(f"--columns {text!r} is not JOINT=COLUMN, for example elbow=pos3 or elbow.vel=w3.")
        if name in found:
            raise ValueRangeError(f"--columns says twice what {name!r} is. Keep one of them.")
        found[name] = column
    return found


def with_torques(path: str, motion: Motion) -> Motion:
    """The motion, if it has torques; else ValueRangeError says what to name."""
    if motion.tau is None:
        raise ValueRangeError(
            f"{path}: no torque for every joint. Name the columns JOINT.torque, or say which they are, --columns "
            f"'{motion.robot.model.velocity_names[0]}.tau=COLUMN'."
        )
    return motion
