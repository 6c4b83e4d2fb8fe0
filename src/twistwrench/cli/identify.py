"""The commands ``twistwrench identify`` and ``excite``: parameters from logs of any length, and exciting motions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import click

from ..core.errors import UnknownNameError, ValueRangeError
from ..core.third_party import workers_of
from ..core.verdict import ExitCode, Word
from ..formats.actuators import read_log_side
from ..identification.exciting_trajectory import excite
from ..identification.identify import identify, log_paths
from ..identification.parameters import PARAMETER_UNITS
from ..identification.payload import motor_side
from ..identification.result import IdentifiedRobot
from ..identification.write import OF_COUPLED_MOTORS
from ..mechanics.model.couplings import with_couplings
from ..motion.motion_file import joints_without_column, open_motion_file
from ..robot import Robot
from . import shared
from .main import Given, note, option
from .report import REPORT, answer_report
from .shared import RobotOptions, robot_command
from .terminal import progress_bar, show_answer

_AUTO = "auto"
_ALL_LOGS = "Write: twistwrench identify ROBOT day1.csv day2.csv"
_REMOVED = click.option("--add", "--information", "add", hidden=True, help="Give all logs at once.")
"""Options of earlier versions, which are answered with the new way for one version."""
FRICTION_LAWS = option(
    "--friction-model LAWS",
    "Friction of each joint: viscous, coulomb, stribeck, offset, or none.",
    "friction",
    default="viscous,coulomb,offset",
)
NO_MOTOR_INERTIA = option("--no-motor-inertia", "Do not estimate motor inertias.")


def parse_friction(text: str) -> tuple[str, ...]:
    """Friction laws from ``viscous,coulomb``; ``none`` gives an empty tuple.

    >>> parse_friction("viscous, offset"), parse_friction("none")
    (('viscous', 'offset'), ())
    """
    return () if text.strip() == "none" else tuple(name.strip() for name in text.split(","))


@robot_command(
    "identify",
    click.argument("logs", metavar="LOG...", nargs=-1, required=True),
    option("--test LOG", "Log to predict, not to fit; may be repeated.", "tests", multiple=True),
    option("--without LINK", "Link that the robot of the logs lacks; may be repeated.", multiple=True),
    shared.LOG_READING,
    option("--cutoff HZ", "Cut-off frequency of the zero-phase low-pass filter.", default=_AUTO),
    option("--shift SECONDS", "Delay of torques relative to positions.", default=_AUTO),
    option(
        "--weights",
        "Weights of the least squares: robust (irls), of each joint (wls) or none (ols).",
        "method",
        choices=("irls", "wls", "ols"),
        default="irls",
    ),
    NO_MOTOR_INERTIA,
    option(
        "--known NAME=VALUE",
        "Fix a parameter: 'link_3.m=0.73 kg', joint_2.viscous=1.2 (SI units); may be repeated.",
        multiple=True,
    ),
    option(
        "--payload-only FRAME",
        "Estimate only a load attached to FRAME; all other parameters, also friction, are those of the robot file.",
    ),
    option(
        "--stribeck-speed SPEED",
        "Stribeck speed [rad/s, m/s], used with --friction-model stribeck.",
        default=0.1,
    ),
    FRICTION_LAWS,
    option(
        "--assume CAUSE",
        "Estimate this cause too, and correct the logs for it: gain:JOINT, position-scale:JOINT, zero:JOINT, tilt, late, "
        "load-friction or another name of the report; may be repeated.",
        multiple=True,
    ),
    shared.csv_option("Write parameter groups with their intervals as a table"),
    REPORT,
    option("--plot OUT.png", "Draw measured and predicted torques, and parameter groups."),
    shared.JSON,
    option("--force", "Write all files even if the verdict is LOOK AGAIN."),
    shared.worker_options,
    _REMOVED,
    option("--out OUT", "Write the robot file with the identified parameters."),
    option("--out-actuators OUT.yaml", "Write friction and motor inertias as an actuator file."),
    option("--keep-close STRENGTH", "Weight of the prior from the robot file, 0.01 to 100000.", default=_AUTO),
    examples=("identify my_arm.urdf log.csv --test other_log.csv --report report.html",),
    robot_first=True,
)
def identify_command(options: RobotOptions, given: Given) -> ExitCode:
    """Estimate masses, inertias, friction and motor inertias from logs, with intervals, and check the logs.

    The first word is the verdict. Exit code: 0 for OK; 1 for UNSURE and LOOK AGAIN. After LOOK AGAIN only --json is written,
    unless --force is given. Several files of one log are written a.csv+b.csv.
    """
    given.logs, given.tests = (tuple(map(str, log_paths(logs, options.source))) for logs in (given.logs, given.tests))
    inputs = {f"LOG {path}": path for path in (*given.logs, *given.tests)}
    if given.add is not None:
        raise ValueRangeError(f"--add and --information are gone: give all logs at once. {_ALL_LOGS}")
    outputs = given.check_files({**inputs, **options.files})
    check_payload(given.payload_only, outputs)
    given.columns = shared.parse_columns(given.columns, [*given.logs, *given.tests])
    fitting = _fitting(given)
    robot, side = _robot(options, given)
    gain = shared.current_gains(given.gain, robot.model, options.drives, of_side=True)
    with progress_bar("identifying") as progress, workers_of(given.workers, given.scheduler) as team:
        found = identify(
            robot, given.logs, test=given.tests, motor_side=side, gain=gain, degrees=options.degrees, client=team.client,
            progress=progress, **fitting,
        )  # fmt: skip
    notes = write_robot(found, given, options)
    show_answer(found)
    write_results(found, given, notes)
    if given.report is not None:
        answer_report(found, given.report, {**inputs, **options.files}, full_paths=given.full_paths)
        shared.show_written(given.report)
    return found.verdict.exit_code


def _fitting(given: Given) -> dict[str, Any]:
    """Options of the fit as keyword arguments of :func:`identify`."""
    return {
        "friction": parse_friction(given.friction),
        "known": parse_known(given.known),
        "motor_inertia": not given.no_motor_inertia,
        "cutoff": _number(given.cutoff, "--cutoff"),
        "shift": _number(given.shift, "--shift"),
        "keep_close": _number(given.keep_close, "--keep-close"),
        **given.pick("method", "payload_only", "stribeck_speed", "assume", "without"),
        **given.pick("columns", "rate", "topic", "episode"),
    }


def _robot(options: RobotOptions, given: Given) -> tuple[Robot, Any]:
    """Robot without its actuators, and the gear side of the logged quantities."""
    held = None
    if given.lock_missing:
        first = open_motion_file(given.logs[0], given.topic, given.episode)
        held = partial(joints_without_column, first, columns=given.columns)
    robot, locked = replace(options, actuators=None).load_and_locked(held=held)
    file = options.drives
    if file is None:
        return robot, None
    known = (*robot.model.velocity_names, *locked)
    couplings = read_log_side(robot.model, file).couplings
    known += tuple(motor for c in couplings for motor in c.motors)
    if others := [name for name in file.entries.get("actuators") or () if name not in known]:
        raise UnknownNameError(f"{file}: {UnknownNameError.from_choices('joint', others[0], known)}")
    side = motor_side(robot.model, file)
    if couplings and given.out_actuators is not None:
        raise ValueRangeError(f"--out-actuators: {OF_COUPLED_MOTORS}; --json has the results.")
    return robot if side.names else Robot(with_couplings(robot.model, couplings)), side


def _number(text: str, option: str) -> float | None:
    if text == _AUTO:
        return None
    try:
        return float(text)
    except ValueError:
        raise ValueRangeError(f"{option} {text!r} is neither a number nor {_AUTO}.") from None


# ── Known values of parameters, ``--known``


def parse_known(texts: Sequence[str]) -> dict[str, float]:
    """Parameter values by name; ``.mass`` is short for ``.m``. Raises ValueRangeError.

    >>> parse_known(["link_3.mass=0.73 kg", "joint_2.viscous=1.2"])
    {'link_3.m': 0.73, 'joint_2.viscous': 1.2}
    """
    found = dict[str, float]()
    for text in texts:
        name, equal, value = (part.strip() for part in text.rpartition("="))
        owner, _, kind = name.rpartition(".")
        kind = {"mass": "m"}.get(kind, kind)
        number, _, unit = value.partition(" ")
        allowed = PARAMETER_UNITS.get(kind)
        if equal and owner and allowed is None:
            raise UnknownNameError(
                f"--known {text!r}: {UnknownNameError.from_choices('parameter', kind, PARAMETER_UNITS)}"
            )
        try:
            if not equal or not owner or allowed is None:
                raise ValueError  # noqa: TRY301  the same sentence answers all of it
            found[f"{owner}.{kind}"] = float(number)
        except ValueError:
            raise ValueRangeError(
                f"--known {text!r} is not NAME=VALUE, for example link_3.m=0.73. Links and joints have: "
                f"{', '.join(PARAMETER_UNITS)}."
            ) from None
        if unit and unit.strip() not in allowed:
            raise ValueRangeError(f"--known {text!r}: the unit {unit.strip()!r} is not {' or '.join(allowed)}.")
    return found


def check_payload(frame: str | None, outputs: Sequence[str]) -> None:
    """Raise ValueRangeError if an output is requested that does not exist for a payload alone."""
    refused = [name for name in outputs if name not in ("--json", "--csv")]
    if frame is not None and refused:
        raise ValueRangeError(f"{refused[0]} with --payload-only: a payload is not a robot. --json writes it.")


# ── Files


def write_robot(found: IdentifiedRobot, given: Given, options: RobotOptions) -> list[str] | None:
    """Write the robot file and its actuators, and return notes; None if LOOK AGAIN prevents writing."""
    if found.verdict.word is Word.LOOK_AGAIN and not given.force:
        return None
    if given.out is None and given.out_actuators is None:
        return []
    before = None if options.drives is None else options.drives.entries
    names = ["+".join(Path(part).name for part in log.split("+")) for log in given.logs]
    return list(found.write(given.out, given.out_actuators, given=before, logs=names, force=given.force))


def write_results(found: IdentifiedRobot, given: Given, notes: list[str] | None) -> None:
    """Write all other files and print their paths; after LOOK AGAIN only JSON and pictures."""
    if given.plot is not None:
        shared.show_written(found.plot(path=given.plot))
    if notes is None:
        if any((given.out, given.out_actuators, given.csv)):
            click.echo("nothing else is written after LOOK AGAIN; --force writes all the same.", err=True)
        return
    for each in notes:
        note(each)
    shared.show_written(given.out, given.out_actuators)
    if given.csv is not None:
        shared.show_written(found.to_csv(given.csv))


# ── ``excite``: a motion whose log tells most


@robot_command(
    "excite",
    option("--duration SECONDS", "Duration, one period of the first harmonic.", default=20.0),
    option("--harmonics", "Number of harmonics of the Fourier series.", default=5),
    NO_MOTOR_INERTIA,
    FRICTION_LAWS,
    option("--share", "Fraction of each limit that may be used.", default=0.9),
    option("--acceleration VALUE", "Acceleration limit of every joint [rad/s², m/s²], used fully.", type=float),
    option(
        "--criterion",
        "Objective: log det of the information matrix, or median standard deviation.",
        choices=("log_det", "deviations"),
        default="log_det",
    ),
    option("--floor Z", "Lowest height of all links [m]. [default: none]", type=float),
    shared.CLEARANCE,
    option("--ignore-self", "Ignore collisions between links; the verdict is then UNSURE."),
    option("--seed N", "Seed of the random start motions.", default=0),
    option("--restarts", "Number of searches; the best result is kept.", default=3),
    option(
        "--torque-noise NM",
        "Standard deviation of the torques [N m, N]. [default: 1 % of each limit]",
        "noise",
        type=float,
    ),
    option("--step SECONDS", "Time between rows of --csv.", default=0.01),
    shared.csv_option("Write the motion, which torques and view read"),
    shared.JSON,
    examples=("excite panda --duration 20 --harmonics 5 --csv motion.csv",),
    robot_first=True,
)
def excite_command(options: RobotOptions, given: Given) -> ExitCode:
    """Plan an excitation trajectory for identify: at rest at both ends, and within all limits.

    Limits are those of positions, velocities, accelerations and torques, and the floor if given. Links keep a distance of
    20 mm from it and from each other, by capsules around the shapes of the robot file; capsules are assumed for links without
    shapes. The first word is the verdict. Exit code: 0 for OK; 1 for UNSURE, if capsules are assumed or a check was skipped,
    and for COLLISION and OVER LIMIT by --clearance. The motion is written in either case.
    """
    given.check_files({"--srdf": given.srdf, **options.files})
    robot = options.load()
    with progress_bar("looking for a motion") as progress:
        found = excite(
            robot, given.duration, given.harmonics, clear_of_itself=not given.ignore_self,
            motor_inertia=not given.no_motor_inertia, friction=parse_friction(given.friction), degrees=options.degrees,
            progress=progress, **given.pick(
                "share", "acceleration", "floor", "criterion", "noise", "seed", "restarts", "step", "clearance", "srdf"
            ),
        )  # fmt: skip
    show_answer(found)
    if given.csv is not None:
        shared.show_written(found.to_csv(given.csv))
    return found.verdict.exit_code
