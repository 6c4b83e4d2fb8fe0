"""The command ``twistwrench size``: motors and gears of a catalogue under a cyclic motion, as text, table and picture."""

from __future__ import annotations

from ..core.errors import ValueRangeError
from ..sizing.choice import Sizing
from ..sizing.sizing import size_drives
from .shared import LogOptions, RobotOptions, motion_path, open_motion
from .skin import Asked, OutputFile, command_of, picture_file, table_file


def _is_sized(found: Sizing) -> bool:
    return found.motion is not None and found.report is not None


@command_of(
    "size",
    size_drives,
    files=(
        table_file(Sizing.to_csv, "Write each figure with its limit as a table", exists=_is_sized),
        picture_file("Draw each motor's speed–torque region with the cycle, and its temperature.", exists=_is_sized),
        OutputFile(
            "--out-actuators OUT.yaml",
            "Write the drives as an actuator file.",
            Sizing.write_actuators,
            exists=_is_sized,
        ),
    ),
    report=True,
    examples=("size ur5 demo --catalog demo --pause 0.8 --ambient 40 --masses-included",),
)
def size_command(robot: RobotOptions, log: LogOptions, asked: Asked, emergency: str | None) -> Sizing:
    """Size motors and gears for a cyclic motion: loads against ratings, winding temperature, gear life, supply.

    The first word is the verdict. Exit code: 0 for OK; 1 for OVER LIMIT, UNSURE and LOOK AGAIN.
    """
    if robot.actuators is not None:
        raise ValueRangeError(
            "the catalogue describes the drives, and --actuators describes others. Leave --actuators out."
        )
    arm, motion = open_motion(robot, log, log.path(robot))
    stop = None
    if emergency is not None:
        _, stop = open_motion(robot, log, motion_path(robot, emergency))
    return size_drives(arm, motion, emergency=stop, **asked)
