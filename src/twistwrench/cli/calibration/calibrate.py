"""The command ``twistwrench calibrate``: geometry of an arm from measurements, written back into its file."""

from __future__ import annotations

import re
from pathlib import Path

import click
import numpy as np

from ...answers.blocks import Headline
from ...calibration import CalibratedRobot, calibrate, factory
from ...calibration.result_view import millimetres
from ...calibration.write import write_geometry
from ...core.errors import ValueRangeError
from ...core.verdict import ExitCode, Word
from .. import shared
from ..main import Given, note, option
from ..report import REPORT, answer_report
from ..shared import RobotOptions, robot_command
from ..terminal import show, show_answer

_UNITS = {"": 1.0, "m": 1.0, "mm": 1e-3, "um": 1e-6, "rad": 1.0, "mrad": 1e-3, "deg": 0.017453292519943295}
_CONFIGURATIONS = 500
_QUANTITY = re.compile(r"\s*([-+.\deE]+)\s*([a-z]*)\s*")


def _sizes(text: str | None, flag: str) -> tuple[float, ...] | None:
    """Numbers with units, such as 1mm,0.1deg, in m and rad."""
    if text is None:
        return None
    found = list[float]()
    for part in text.split(","):
        match = _QUANTITY.fullmatch(part)
        try:
            found.append(float(match[1]) * _UNITS[match[2]] if match else float("nan"))
        except (ValueError, KeyError):
            found.append(float("nan"))
    if not 1 <= len(found) <= 2 or not all(x > 0 for x in found):
        raise ValueRangeError(f"{flag} {text!r} is not a length and an angle above 0. Write for example 1mm,0.1deg.")
    return tuple(found)


@robot_command(
    "calibrate",
    click.argument("measurements", metavar="[MEASUREMENTS]...", nargs=-1),
    option(
        "--kind", "Kind of the readings. [default: by the columns; touches need it]",
        choices=("pose", "position", "distance", "pair", "point", "plane", "sphere"),
    ),
    option(
        "--assume CAUSE", "Estimate this cause too: sag under gravity, or errors of gears; may be repeated.",
        choices=("sag", "gears"), multiple=True,
    ),
    option("--test LOG", "Log to predict, not to fit; may be repeated. [default: six folds]", "tests", multiple=True),
    option("--length", "Known length of touches [m].", type=float),
    option("--noise M[,RAD]", "Standard deviation of a reading: 0.05mm, or 0.05mm,0.01deg. [default: estimated]"),
    option("--file-accuracy M,RAD", "Standard deviations of lengths and axes in the robot's file.", default="1mm,2mrad"),
    option("--keep-outliers", "Use readings that contradict the others, too."),
    option("--from FILE", "Start from a UR's factory calibration, calibration.conf, without measurements.", "factory_file"),
    option("--out OUT", "Write the calibrated robot into its URDF or MJCF file; not after LOOK AGAIN."),
    shared.csv_option("Write the residuals, one row per reading"),
    shared.JSON,
    option("--plot OUT.png", "Draw errors before and after, and groups with intervals."),
    REPORT,
    examples=("calibrate ur5 demo", "calibrate ur5 demo --out mine.urdf"),
    robot_first=True,
)  # fmt: skip
def calibrate_command(options: RobotOptions, given: Given) -> ExitCode:
    """Fit zeros, axes, lengths, tip and target of an arm to measurements of its tip, with intervals and held-out error.

    MEASUREMENTS are CSV files with the joints' positions and x,y,z (perhaps with qw,qx,qy,qz, or rx,ry,rz, or
    roll,pitch,yaw), or distance, or touches; 'demo' is bundled. --from takes none.
    Exit code: 1 for UNSURE and LOOK AGAIN.
    """
    if given.measurements and given.factory_file:
        raise ValueRangeError(
            "--from takes a UR's factory calibration in place of MEASUREMENTS. Leave one of them out."
        )
    if not given.measurements and not given.factory_file:
        raise ValueRangeError(
            "Missing MEASUREMENTS: a CSV file of readings, or 'demo'; or --from calibration.conf of a UR."
        )
    files = {
        f"MEASUREMENTS {path}": path for path in (*given.measurements, *given.tests) if path != "demo"
    } | options.files
    given.check_files({**files, "--from": given.factory_file})
    if given.factory_file:
        return _from_factory(options, given)
    noise, accuracy = _sizes(given.noise, "--noise"), _sizes(given.file_accuracy, "--file-accuracy") or ()
    if len(accuracy) != 2:
        raise ValueRangeError(
            f"--file-accuracy {given.file_accuracy!r} is not a length and an angle. Write for example 1mm,2mrad."
        )
    found = calibrate(
        options.load(), list(given.measurements), kind=given.kind, tip=options.tip, assume=given.assume,
        test=list(given.tests) or None, length=given.length,
        noise=None if noise is None else noise[0] if len(noise) == 1 else (noise[0], noise[1]),
        file_accuracy=(accuracy[0], accuracy[1]), outliers="keep" if given.keep_outliers else "trim", degrees=options.degrees,
    )  # fmt: skip
    show_answer(found)
    written = _write(found, given)
    if given.csv is not None:
        found.to_csv(given.csv)
    if given.plot is not None:
        found.plot(path=given.plot)
    shared.show_written(written, given.csv, given.plot)
    if given.report is not None:
        answer_report(found, given.report, files, full_paths=given.full_paths)
        shared.show_written(given.report)
    return found.verdict.exit_code


def _from_factory(options: RobotOptions, given: Given) -> ExitCode:
    """Write the factory calibration of a UR into its file."""
    robot = options.load()
    calibrated = factory(robot, given.factory_file)
    frame = str(options.tip or robot.tip)
    q = robot.random_configuration(0, _CONFIGURATIONS)
    before, after = (np.asarray(one.forward_kinematics(q, frame=frame))[:, :3, 3] for one in (robot, calibrated))
    rms = millimetres(float(np.sqrt(((after - before) ** 2).sum(axis=1).mean())))
    show(Headline(Word.DONE, f"the factory calibration moves {frame} by {rms} (rms over the reach)."))
    if given.out is not None:
        write_geometry(robot, calibrated, frame, given.out, f"factory calibration of {Path(given.factory_file).name}")
    shared.show_written(given.out)
    return ExitCode.FINE


def _write(found: CalibratedRobot, given: Given) -> str | None:
    """Write the robot's file unless the answer is against it; returns its path."""
    if given.out is None:
        return None
    if found.verdict.word is Word.LOOK_AGAIN:
        note(f"{given.out} is not written, since the measurements contradict the robot.")
        return None
    if found.verdict.ok and found.needs_nothing:
        note(f"{given.out} is not written, since the file is already right.")
        return None
    found.write(given.out)
    return str(given.out)
