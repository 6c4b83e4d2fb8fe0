"""The command ``twistwrench calibrate``: geometry of an arm from measurements, written back into its file."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TypeAlias

import click

from ...calibration import CalibratedRobot, FactoryCalibration, calibrate
from ...core.errors import ValueRangeError
from ...core.verdict import Word
from ..main import option
from ..parameters import REPEATED, Kind, Spelling, several
from ..shared import RobotOptions
from ..skin import Asked, OutputFile, command_of, picture_file, table_file

_UNITS = {"": 1.0, "m": 1.0, "mm": 1e-3, "um": 1e-6, "rad": 1.0, "mrad": 1e-3, "deg": 0.017453292519943295}
_QUANTITY = re.compile(r"\s*([-+.\deE]+)\s*([a-z]*)\s*")
Calibration: TypeAlias = CalibratedRobot | FactoryCalibration


def _sizes(text: str, flag: str) -> list[float]:
    """Numbers with units, such as 1mm,0.1deg, in m and rad."""
    found = list[float]()
    for part in text.split(","):
        match = _QUANTITY.fullmatch(part)
        try:
            found.append(float(match[1]) * _UNITS[match[2]] if match else float("nan"))
        except (ValueError, KeyError):
            found.append(float("nan"))
    if not 1 <= len(found) <= 2 or not all(x > 0 for x in found):
        raise ValueRangeError(f"{flag} {text!r} is not a length and an angle above 0. Write for example 1mm,0.1deg.")
    return found


def _noise(text: str, flag: str) -> float | tuple[float, ...]:
    found = _sizes(text, flag)
    return found[0] if len(found) == 1 else tuple(found)


def _accuracy(text: str, flag: str) -> tuple[float, ...]:
    found = _sizes(text, flag)
    if len(found) != 2:
        raise ValueRangeError(f"{flag} {text!r} is not a length and an angle. Write for example 1mm,2mrad.")
    return tuple(found)


def _files(measurements: tuple[str, ...], test: tuple[str, ...], factory_file: str | None) -> dict[str, str | None]:
    read = {f"MEASUREMENTS {path}": path for path in (*measurements, *test) if path != "demo"}
    return {**read, "--from": factory_file}


def _fitted(found: Calibration) -> CalibratedRobot:
    assert isinstance(found, CalibratedRobot), "a factory calibration has no residuals"
    return found


def _is_fitted(found: Calibration) -> bool:
    return isinstance(found, CalibratedRobot)


def _objection(found: Calibration, path: str) -> str:
    """Reason why the robot's file is not written."""
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
        "--from FILE", "Start from a UR's factory calibration, calibration.conf, without measurements.", "factory_file"
    ),
    files=(
        OutputFile(
            "--out OUT",
            "Write the calibrated robot into its URDF or MJCF file; not after LOOK AGAIN.",
            lambda found, path: found.write(path),
            exists=lambda found: not _objection(found, ""),
            missing=_objection,
        ),
        table_file(
            lambda found, path: _fitted(found).to_csv(path),
            "Write the residuals, one row per reading",
            exists=_is_fitted,
        ),
        picture_file("Draw errors before and after, and groups with intervals.", exists=_is_fitted),
    ),
    report=True,
    examples=("calibrate ur5 demo", "calibrate ur5 demo --out mine.urdf"),
    left_out={"seed"},
    spellings={"outliers": Spelling("--keep-outliers", {"": "keep"}, "Use readings that contradict the others, too.")},
    kinds={
        "MeasurementsGiven | Sequence[MeasurementsGiven]": Kind("LOG", several, REPEATED),
        "NoiseGiven": Kind("M[,RAD]", _noise),
        "AccuracyGiven": Kind("M,RAD", _accuracy),
    },
    reads=_files,
)
def calibrate_command(
    robot: RobotOptions, asked: Asked, measurements: tuple[str, ...], factory_file: str | None
) -> Calibration:
    """Fit zeros, axes, lengths, tip and target of an arm to measurements of its tip, with intervals and held-out error.

    MEASUREMENTS are CSV files with the joints' positions and x,y,z (perhaps with qw,qx,qy,qz, or rx,ry,rz, or
    roll,pitch,yaw), or distance, or touches; 'demo' is bundled. --from takes none.
    Exit code: 1 for UNSURE and LOOK AGAIN.
    """
    if measurements and factory_file:
        raise ValueRangeError(
            "--from takes a UR's factory calibration in place of MEASUREMENTS. Leave one of them out."
        )
    if factory_file:
        return FactoryCalibration.from_file(robot.load(), Path(factory_file), robot.tip)
    if not measurements:
        raise ValueRangeError(
            "Missing MEASUREMENTS: a CSV file of readings, or 'demo'; or --from calibration.conf of a UR."
        )
    return calibrate(robot.load(), list(measurements), tip=robot.tip, **asked)
