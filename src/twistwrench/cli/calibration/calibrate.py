"""The command ``twistwrench calibrate``: geometry of an arm from measurements, written back into its file."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TypeAlias

import click

from ...calibration import CalibratedRobot, FactoryCalibration, MeasuringPoses, calibrate, measuring_poses
from ...core.arguments import parse_numbers
from ...core.errors import ValueRangeError
from ...core.verdict import Word
from ..main import option
from ..parameters import REPEATED, Kind, Spelling, several
from ..shared import RobotOptions
from ..skin import Asked, OutputFile, command_of, picture_file, table_file

_SI_FACTORS = {"": 1.0, "m": 1.0, "mm": 1e-3, "um": 1e-6, "rad": 1.0, "mrad": 1e-3, "deg": 0.017453292519943295}
"""Value of each unit in m or rad; a bare number has the empty unit."""
_PLAN_PARAMETERS = ("kind", "degrees", "assume", "noise", "file_accuracy")
"""Parameters of ``calibrate`` that a plan of readings has too."""
_QUANTITY = re.compile(r"\s*([-+.\deE]+)\s*([a-z]*)\s*")
"""Number, perhaps with an exponent, and unit, which may be empty."""
Calibration: TypeAlias = CalibratedRobot | FactoryCalibration | MeasuringPoses


def _positive_sizes(text: str, flag: str) -> list[float]:
    """One or two sizes above 0 [m or rad] from a text such as 1mm,0.1deg."""
    # One error for each way in which the text is wrong:
    problem = ValueRangeError(f"{flag} {text!r} is not a length and an angle above 0. Write for example 1mm,0.1deg.")
    sizes = list[float]()
    for part in text.split(","):
        match = _QUANTITY.fullmatch(part)
        if match is None:
            raise problem
        try:
            size = float(match[1]) * _SI_FACTORS[match[2]]
        except (ValueError, KeyError):
            raise problem from None
        if not size > 0:  # also for NaN
            raise problem
        sizes.append(size)
    if len(sizes) > 2:
        raise problem
    return sizes


def _parse_noise(text: str, flag: str) -> float | tuple[float, ...]:
    """Standard deviation of all readings [m or rad], or a pair: of lengths [m], and of angles [rad]."""
    sizes = _positive_sizes(text, flag)
    if len(sizes) == 1:
        return sizes[0]
    return tuple(sizes)


def _parse_accuracy(text: str, flag: str) -> tuple[float, ...]:
    """Accuracy of the robot's file: length [m] and angle [rad]."""
    sizes = _positive_sizes(text, flag)
    if len(sizes) != 2:
        raise ValueRangeError(f"{flag} {text!r} is not a length and an angle. Write for example 1mm,2mrad.")
    return tuple(sizes)


def _input_files(
    measurements: tuple[str, ...], test: tuple[str, ...], factory_file: str | None
) -> dict[str, str | None]:
    """Paths that outputs must not overwrite, by argument; None if it is not given."""
    readings = [path for path in (*measurements, *test) if path != "demo"]
    files: dict[str, str | None] = {f"MEASUREMENTS {path}": path for path in readings}
    files["--from"] = factory_file
    return files


def _require_readings(found: Calibration) -> CalibratedRobot | MeasuringPoses:
    """Result of the command, for the type checker: the files of readings are written only if there are readings."""
    assert not isinstance(found, FactoryCalibration), "a factory calibration has no readings"
    return found


def _has_readings(found: Calibration) -> bool:
    """True for a result with measured or planned readings."""
    return not isinstance(found, FactoryCalibration)


def _require_robot(found: Calibration) -> CalibratedRobot | FactoryCalibration:
    """Result of the command, for the type checker: the robot is written only if there is one."""
    assert not isinstance(found, MeasuringPoses), "a plan of readings has no robot to write"
    return found


def _reason_not_to_write(found: Calibration, path: str) -> str:
    """Reason why the robot's file is not written; empty if it is written."""
    if isinstance(found, MeasuringPoses):
        return f"{path} is not written, since nothing is measured yet; --csv writes the configurations."
    if found.verdict.word is Word.LOOK_AGAIN:
        return f"{path} is not written, since the measurements contradict the robot."
    if isinstance(found, CalibratedRobot) and found.verdict.ok and found.needs_nothing:
        return f"{path} is not written, since the file is already right."
    return ""


@command_of(
    "calibrate",
    calibrate,
    click.argument("measurements", metavar="[MEASUREMENTS]...", nargs=-1),
    option(
        "--from FILE",
        "Start from a UR's factory calibration, calibration.conf or YAML, without measurements.",
        "factory_file",
    ),
    option("--plan N", "Plan N readings: configurations to measure. MEASUREMENTS are what exists already.", type=int),
    option("--towards X,Y,Z", "Place of the tracker, or of the distances' fixed end, for --plan [m]."),
    option("--floor VALUE", "Lowest height of the moving links in the base frame, for --plan [m].", type=float),
    files=(
        OutputFile(
            "--out OUT",
            "Write the calibrated robot into its URDF or MJCF file; not after LOOK AGAIN.",
            lambda found, path: _require_robot(found).write(path),
            exists=lambda found: not _reason_not_to_write(found, path=""),  # only whether there is a reason
            missing=_reason_not_to_write,
        ),
        table_file(
            lambda found, path: _require_readings(found).to_csv(path),
            "Write the residuals, one row per reading; with --plan the configurations",
            exists=_has_readings,
        ),
        picture_file("Draw errors before and after, and groups with intervals.", exists=_has_readings),
    ),
    report=True,
    examples=("calibrate ur5 demo", "calibrate ur5 demo --out mine.urdf", "calibrate ur5 --plan 25 --csv poses.csv"),
    left_out={"seed"},  # a parameter of calibrate that is not an option
    # The flag, which takes no text, gives outliers="keep":
    spellings={"outliers": Spelling("--keep-outliers", {"": "keep"}, "Use readings that contradict the others, too.")},
    kinds={
        "MeasurementsGiven | Sequence[MeasurementsGiven]": Kind("LOG", several, REPEATED),
        "NoiseGiven": Kind("M[,RAD]", _parse_noise),
        "AccuracyGiven": Kind("M,RAD", _parse_accuracy),
    },
    reads=_input_files,
)
def calibrate_command(
    robot: RobotOptions,
    asked: Asked,
    measurements: tuple[str, ...],
    factory_file: str | None,
    plan: int | None,
    towards: str | None,
    floor: float | None,
) -> Calibration:
    """Fit zeros, axes, lengths, tip and target of an arm to measurements of its tip, with intervals and held-out error.

    MEASUREMENTS are CSV files with the joints' positions and x,y,z (perhaps with qw,qx,qy,qz, or rx,ry,rz, or
    roll,pitch,yaw), or distance, or touches; 'demo' is bundled. --from and --plan need none.
    Exit code: 1 for UNSURE and LOOK AGAIN.
    """
    if measurements and factory_file:
        raise ValueRangeError(
            "--from takes a UR's factory calibration in place of MEASUREMENTS. Leave one of them out."
        )
    if plan is None and (towards is not None or floor is not None):
        raise ValueRangeError("--towards and --floor belong to --plan N. Add it, or leave them out.")
    if plan is not None:
        return _plan_readings(robot, asked, measurements, plan, towards, floor)
    if factory_file:
        return FactoryCalibration.from_file(robot.load(), Path(factory_file), robot.tip)
    if not measurements:
        raise ValueRangeError(
            "Missing MEASUREMENTS: a CSV file of readings, or 'demo'; or --from calibration.conf of a UR, or --plan N."
        )
    return calibrate(robot.load(), list(measurements), tip=robot.tip, **asked)


def _plan_readings(
    robot: RobotOptions,
    asked: Asked,
    measurements: tuple[str, ...],
    plan: int,
    towards: str | None,
    floor: float | None,
) -> MeasuringPoses:
    """Plan configurations to measure; at most one file has existing readings, which the plan completes."""
    if len(measurements) > 1:
        raise ValueRangeError(f"--plan takes one file of existing readings, and {len(measurements)} are given.")
    for name in ("test", "length"):  # the other options of measurements change nothing in a plan
        if asked.get(name):
            raise ValueRangeError(f"--{name} belongs to measurements. Leave it out with --plan.")
    plan_options = {name: asked[name] for name in _PLAN_PARAMETERS if name in asked}
    if towards is not None:
        plan_options["towards"] = parse_numbers(towards, "--towards", "X,Y,Z in m", 3)
    existing_readings = measurements[0] if measurements else None
    return measuring_poses(robot.load(), plan, tip=robot.tip, after=existing_readings, floor=floor, **plan_options)
