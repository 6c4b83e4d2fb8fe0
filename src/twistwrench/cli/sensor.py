"""The commands ``twistwrench sensor identify``, ``compensate`` and ``poses``."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import click

from ..core.arguments import parse_numbers
from ..core.errors import ValueRangeError
from ..core.gravity import STRENGTH
from ..sensing import Compensation, Identification, PoseProposal, compensate, identify, propose_poses
from ..sensing.files import log_path, readings_of, sensor_path
from ..sensing.log import ReadingLog
from .main import option
from .parameters import Kind, Spelling
from .skin import Asked, OutputFile, command_of, picture_file, table_file

_LOG_ARGUMENT = click.argument("readings", metavar="LOG")
_PICTURE_HELP = "Draw the readings before and after."
_TABLE_HELP = "Write the readings without bias and load as a table"

# Options of logs that have joint positions in place of orientations.
_ROBOT_OPTIONS = (
    option("--robot ROBOT", "Robot whose joint positions are in the log in place of orientations.", "arm"),
    option("--frame FRAME", "Frame of the sensor on the robot. [default: its tip]"),
    option("--degrees", "Use degrees for joint positions without a unit."),
)


def _readings(
    readings: str, arm: str | None, frame: str | None, degrees: bool, asked: Asked, function: str
) -> str | ReadingLog:
    """Path of the log; if a robot is given, the log with orientations from its joint positions.

    ``function`` is named in errors.
    """
    if arm is None and (frame is not None or degrees):
        raise ValueRangeError(
            "--frame and --degrees are about joint positions. Give the robot that has them, --robot ROBOT."
        )
    if arm is None:
        return readings
    gravity = asked.get("gravity", STRENGTH)
    return readings_of(readings, gravity, function, robot=arm, frame=frame, degrees=degrees)


def _log_file(readings: str | None) -> dict[str, Path | None]:
    """File that the command reads, by argument; None if no log is given."""
    return {"LOG": None if readings is None else log_path(readings)}


def _numbers(*counts: int) -> Callable[[str, str], list[float]]:
    """Parser of comma-separated numbers, as many as one of the counts."""
    allowed_counts = " or ".join(map(str, counts))
    form = f"{allowed_counts} numbers separated by commas"
    return lambda text, flag: parse_numbers(text, flag, form, *counts)


@command_of(
    "compensate",
    compensate,
    _LOG_ARGUMENT,
    *_ROBOT_OPTIONS,
    files=(table_file(Compensation.to_csv, _TABLE_HELP), picture_file(_PICTURE_HELP)),
    report=True,
    examples=("sensor compensate demo --sensor demo",),
    summary="Subtract weight, inertial load and bias from a log; detect contacts.",
    with_robot=False,
    left_out={"noise", "uncertainty"},
    spellings={"false_alarms": Spelling("--contacts RATE")},
    kinds={"SensorGiven": Kind("SENSOR.json", lambda text, _flag: sensor_path(text), is_file=True)},
    reads=_log_file,
)
def compensate_command(readings: str, arm: str | None, frame: str | None, degrees: bool, asked: Asked) -> Compensation:
    """Subtract bias, weight and inertial load from the readings of a sensor.

    Exit code: 1 if --contacts finds one, or, LOOK AGAIN, if the sensor file does not explain the log: another tool, unit,
    sign or orientation, or a log in motion whose moments hold an inertia that was not identified.
    """
    return compensate(_readings(readings, arm, frame, degrees, asked, "compensate"), **asked)


@command_of(
    "identify",
    identify,
    _LOG_ARGUMENT,
    *_ROBOT_OPTIONS,
    files=(
        OutputFile("--save OUT.json", "Write the sensor file for `compensate`.", Identification.write),
        table_file(Identification.to_csv, _TABLE_HELP),
        picture_file(_PICTURE_HELP),
    ),
    report=True,
    examples=("sensor identify demo", "sensor identify demo --save hand.json"),
    summary="Estimate mass, centre of mass and bias from a log.",
    with_robot=False,
    left_out={"confidence"},
    spellings={
        "inertia": Spelling("--with-inertia", {"": True}),
        "outliers": Spelling("--keep-outliers", {"": "keep"}, "Use readings that contradict the others, too."),
    },
    kinds={"BiasGiven": Kind("m,m,m,f,f,f", _numbers(6)), "NoiseGiven": Kind("M,F", _numbers(2, 6))},
    reads=_log_file,
)
def identify_command(readings: str, arm: str | None, frame: str | None, degrees: bool, asked: Asked) -> Identification:
    """Estimate bias, mass and centre of mass of the load of a sensor, with intervals.

    Exit code: 1 for LOOK AGAIN, if readings contradict the others, if units, sign, mounting, gain or poses look wrong, or if
    the inertia found is impossible; 1 for UNSURE, if orientations are few, if residuals are not white, or if --assume with
    one of its causes would explain them.
    """
    return identify(_readings(readings, arm, frame, degrees, asked, "identify"), **asked)


@command_of(
    "poses",
    propose_poses,
    click.argument("readings", metavar="[LOG]", required=False),
    option("--within DEGREES", "Largest tilt.", "degrees", default=180.0),
    files=(
        table_file(PoseProposal.to_csv, "Write the poses as a table"),
        picture_file(
            "Draw the tilts of the sensor, and what is known after each pose.",
            exists=lambda found: found.determines_mass,
            missing="These poses determine nothing, so no picture is written.",
        ),
    ),
    report=True,
    examples=("sensor poses", "sensor poses demo --count 3"),
    summary="Propose the orientations to read next.",
    with_robot=False,
    left_out={"candidates", "within"},
    kinds={"NoisePair": Kind("M,F", _numbers(2))},
    reads=_log_file,
)
def poses_command(readings: str | None, degrees: float, asked: Asked) -> PoseProposal:
    """Propose the most informative orientations to read next, given the readings of LOG, if any.

    Exit code: 1 for LOOK AGAIN, if they cannot determine the mass or the centre of mass.
    """
    return propose_poses(log=readings, within=math.radians(degrees), **asked)


@click.group("sensor", cls=click.Group)
def sensor_command() -> None:
    """Calibrate a six-axis force-torque sensor: estimate the tool's mass, subtract its load, propose poses.

    LOG is a CSV file with mx,my,mz,fx,fy,fz and an orientation (qw,qx,qy,qz or r11…r33 or gx,gy,gz),
    or 'demo' or 'demo-motion', which are bundled.
    """


for _command in (identify_command, compensate_command, poses_command):
    sensor_command.add_command(_command)
