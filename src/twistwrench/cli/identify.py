"""The commands ``twistwrench identify`` and ``excite``: parameters from logs of any length, and exciting motions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, TypeAlias

import click

from ..core.errors import UnknownNameError, ValueRangeError
from ..core.third_party.workers import workers_of
from ..core.verdict import Word
from ..formats.actuators import read_log_side
from ..identification.actuator_text import OF_COUPLED_MOTORS
from ..identification.exciting_trajectory import ExcitingMotion, excite
from ..identification.identify import identify, log_paths
from ..identification.parameters import PARAMETER_UNITS
from ..identification.payload import motor_side
from ..identification.result import IdentifiedRobot
from ..identification.servos.identify_servos import identify_servos
from ..identification.servos.replay import SERVO_UNITS
from ..identification.servos.result import IdentifiedServos
from ..mechanics.model.couplings import with_couplings
from ..motion.motion import Motion
from ..motion.motion_file import joints_without_column, open_motion_file
from ..robot import Robot
from . import shared
from .main import note, option
from .parameters import REPEATED, Kind, Spelling, several
from .shared import RobotOptions
from .skin import Asked, OutputFile, Outputs, command_of, picture_file, table_file
from .terminal import progress_bar

CommandHold: TypeAlias = Literal["zero", "linear", "auto"]
Identified: TypeAlias = IdentifiedRobot | IdentifiedServos
_KNOWN_UNITS = SERVO_UNITS | PARAMETER_UNITS
"""Units of known values by kind of parameter."""
_SERVO_PARAMETERS = ("known",)
"""Parameters of ``identify`` that ``identify_servos`` has too, beside the logs."""
_AUTO = "auto"
"""Text of an option whose value is chosen by the program."""
_HINT_ALL_LOGS = "Write: twistwrench identify ROBOT day1.csv day2.csv"
_REMOVED = click.option("--add", "--information", "add", hidden=True, help="Give all logs at once.")
"""Options of earlier versions; for one version, an error names the new way."""
_FRICTION = Spelling(
    "--friction-model LAWS", text="Friction of each joint: viscous, coulomb, stribeck, offset, or none."
)


# ── Values of options


def parse_friction(text: str, _flag: str = "") -> tuple[str, ...]:
    """Friction laws from ``viscous,coulomb``; ``none`` gives an empty tuple.

    >>> parse_friction("viscous, offset"), parse_friction("none")
    (('viscous', 'offset'), ())
    """
    if text.strip() == "none":
        return ()
    return tuple(name.strip() for name in text.split(","))


def _number_or_auto(text: str, flag: str) -> float | None:
    """Number of the text; None for ``auto``."""
    if text == _AUTO:
        return None
    try:
        return float(text)
    except ValueError:
        raise ValueRangeError(f"{flag} {text!r} is neither a number nor {_AUTO}.") from None


def parse_known(texts: Sequence[str], flag: str = "--known") -> dict[str, float]:
    """Parameter values by name; ``.mass`` is short for ``.m``. Raises ValueRangeError.

    >>> parse_known(["link_3.mass=0.73 kg", "joint_2.viscous=1.2"])
    {'link_3.m': 0.73, 'joint_2.viscous': 1.2}
    """
    known = dict[str, float]()
    for text in texts:
        name, equals_sign, value = map(str.strip, text.rpartition("="))
        owner, _, kind = name.rpartition(".")  # link or joint, and kind of parameter
        if kind == "mass":
            kind = "m"
        number, _, unit = value.partition(" ")
        units = _KNOWN_UNITS.get(kind)
        if equals_sign and owner and units is None:
            raise UnknownNameError(f"{flag} {text!r}: {UnknownNameError.from_choices('parameter', kind, _KNOWN_UNITS)}")
        is_complete = bool(equals_sign and owner)
        try:
            if not is_complete or units is None:
                raise ValueError  # noqa: TRY301  the same message as for a text that is not a number
            known[f"{owner}.{kind}"] = float(number)
        except ValueError:
            raise ValueRangeError(
                f"{flag} {text!r} is not NAME=VALUE, for example link_3.m=0.73. Links and joints have: "
                f"{', '.join(_KNOWN_UNITS)}."
            ) from None
        if unit and unit.strip() not in units:
            raise ValueRangeError(f"{flag} {text!r}: the unit {unit.strip()!r} is not {' or '.join(units)}.")
    return known


# ── ``identify``


def _has_torques(found: Identified) -> bool:
    """True for a result from torques, False for servos."""
    return isinstance(found, IdentifiedRobot)


def _require_torque_result(found: Identified) -> IdentifiedRobot:
    """The result itself, which is from torques."""
    assert isinstance(found, IdentifiedRobot), "servos have no groups of parameters"
    return found


def _input_logs(logs: tuple[str, ...], test: tuple[str, ...], source: str) -> dict[str, str]:
    """Files of the logs, by argument."""
    return {f"LOG {path}": str(path) for path in log_paths([*logs, *test], source)}


@command_of(
    "identify",
    identify,
    click.argument("logs", metavar="LOG...", nargs=-1, required=True),
    shared.LOG_READING,
    option(
        "--from-commands",
        "Identify stiffness, damping, friction and armature of servos from commands, without torques.",
    ),
    option(
        "--command-hold",
        "Course of the commands between samples, with --from-commands.",
        choices=("zero", "linear", "auto"),
    ),
    option("--force", "Write all files even if the verdict is LOOK AGAIN."),
    shared.worker_options,
    _REMOVED,
    files=(
        table_file(
            lambda found, path: _require_torque_result(found).to_csv(path),
            "Write parameter groups with their intervals as a table",
            exists=_has_torques,
        ),
        picture_file("Draw measured and predicted torques, and parameter groups.", exists=_has_torques),
        OutputFile(
            "--out OUT", "Write the robot file with the identified parameters.", lambda found, path: found.write(path)
        ),
        OutputFile(
            "--out-actuators OUT.yaml",
            "Write friction and motor inertias as an actuator file.",
            lambda found, path: found.write(actuators=path),
        ),
    ),
    report=True,
    examples=(
        "identify my_arm.urdf log.csv --test other_log.csv --report report.html",
        "identify my_arm.urdf log.csv --from-commands --out arm.xml",
    ),
    left_out={"friction_speed", "motor_side", "client"},
    spellings={"method": Spelling("--weights"), "friction": _FRICTION},
    kinds={
        "Log | Sequence[Log]": Kind("LOG", several, REPEATED),
        "FrictionLaws": Kind("LAWS", parse_friction),
        "KnownValues": Kind("NAME=VALUE", parse_known, REPEATED),
        "LinkNames": Kind("LINK", several, REPEATED),
        "Hertz": Kind("HZ", _number_or_auto),
        "Seconds": Kind("SECONDS", _number_or_auto),
        "PriorWeight": Kind("STRENGTH", _number_or_auto),
        "ObserverGain": Kind("GAIN", settings={"type": float}),
    },
    reads=_input_logs,
)
def identify_command(
    robot: RobotOptions,
    asked: Asked,
    outputs: Outputs[Identified],
    logs: tuple[str, ...],
    test: tuple[str, ...],
    columns: tuple[str, ...],
    gain: tuple[str, ...],
    rate: float | None,
    topic: str | None,
    episode: int | None,
    lock_missing: bool,
    payload_only: str | None,
    from_commands: bool,
    command_hold: CommandHold | None,
    force: bool,
    workers: int | None,
    scheduler: str | None,
    add: str | None,
) -> Identified:
    """Estimate masses, inertias, friction and motor inertias from logs, with intervals, and check the logs.

    The first word is the verdict. Exit code: 0 for OK; 1 for UNSURE and LOOK AGAIN. After LOOK AGAIN only --json is written,
    unless --force is given. Several files of one log are written a.csv+b.csv.
    """
    if add is not None:
        raise ValueRangeError(f"--add and --information are gone: give all logs at once. {_HINT_ALL_LOGS}")
    _refuse_files_of_payload(payload_only, outputs.flags)
    fitted_logs = [str(path) for path in log_paths(logs, robot.source)]
    predicted_logs = [str(path) for path in log_paths(test, robot.source)]
    column_by_name = shared.parse_columns(columns, [*fitted_logs, *predicted_logs])
    if command_hold is not None and not from_commands:
        raise ValueRangeError("--command-hold belongs to --from-commands. Add it, or leave it out.")
    joints_to_lock = None
    if lock_missing:
        first_log = open_motion_file(fitted_logs[0], topic, episode)
        joints_to_lock = partial(joints_without_column, first_log, columns=column_by_name)
    arm, locked = replace(robot, actuators=None).load_and_locked(held=joints_to_lock)
    if from_commands:
        reading = {
            "columns": column_by_name, "rate": rate, "degrees": robot.degrees, "topic": topic, "episode": episode,
        }  # fmt: skip
        servos = _identify_servos(arm, fitted_logs, predicted_logs, command_hold or "auto", reading, asked)
        _plan_files(servos, outputs, robot, fitted_logs, force=force)
        return servos
    writes_actuators = bool(outputs.path_of("--out-actuators"))
    arm, gear_side = _with_motors(arm, locked, robot, writes_actuators=writes_actuators)
    gains = shared.current_gains(gain, arm.model, robot.drives, of_side=True)
    with progress_bar("identifying") as progress, workers_of(workers, scheduler) as team:
        found = identify(
            arm, fitted_logs, test=predicted_logs, motor_side=gear_side, payload_only=payload_only, columns=column_by_name,
            rate=rate, gain=gains, topic=topic, episode=episode, client=team.client, progress=progress, **asked,
        )  # fmt: skip
    _plan_files(found, outputs, robot, fitted_logs, force=force)
    return found


def _identify_servos(
    robot: Robot, logs: Sequence[str], test: Sequence[str], hold: CommandHold, reading: dict[str, Any], asked: Asked
) -> IdentifiedServos:
    """Servos from logs of commands and positions; ``asked`` are the options that the user has set."""
    options_for_torques = [name for name in asked if name not in _SERVO_PARAMETERS]
    if options_for_torques:
        flag = f"--{options_for_torques[0].replace('_', '-')}"
        raise ValueRangeError(f"{flag} is for torques. Leave it out with --from-commands.")
    fitted_motions = [Motion.from_file(path, robot, **reading) for path in logs]
    predicted_motions = [Motion.from_file(path, robot, **reading) for path in test]
    with progress_bar("identifying") as progress:
        return identify_servos(robot, fitted_motions, test=predicted_motions, hold=hold, progress=progress, **asked)


def _refuse_files_of_payload(frame: str | None, outputs: Sequence[str]) -> None:
    """Raise ValueRangeError if the payload at ``frame`` is fitted alone, and one of the outputs needs a robot."""
    robot_outputs = [name for name in outputs if name not in ("--json", "--csv")]
    if frame is not None and robot_outputs:
        raise ValueRangeError(f"{robot_outputs[0]} with --payload-only: a payload is not a robot. --json writes it.")


def _with_motors(
    robot: Robot, locked: Sequence[str], options: RobotOptions, *, writes_actuators: bool
) -> tuple[Robot, Any]:
    """Robot with the couplings of its motors, and the gear side of the logged quantities, by the actuator file.

    Without such a file, the side is None. ``locked`` are joints that the file may name, too.
    """
    actuator_file = options.drives
    if actuator_file is None:
        return robot, None
    couplings = read_log_side(robot.model, actuator_file).couplings
    drive_names = [*robot.model.velocity_names, *locked]
    for coupling in couplings:
        drive_names += coupling.motors
    for name in actuator_file.entries.get("actuators") or ():
        if name not in drive_names:
            raise UnknownNameError(f"{actuator_file}: {UnknownNameError.from_choices('joint', name, drive_names)}")
    gear_side = motor_side(robot.model, actuator_file)
    if couplings and writes_actuators:
        raise ValueRangeError(f"--out-actuators: {OF_COUPLED_MOTORS}; --json has the results.")
    if gear_side.names:  # the log has quantities of motors, so the robot stays one of joints
        return robot, gear_side
    return Robot(with_couplings(robot.model, couplings)), gear_side


def _plan_files(
    found: Identified,
    outputs: Outputs[Identified],
    robot: RobotOptions,
    logs: Sequence[str],
    *,
    force: bool,
) -> None:
    """Plan to write the robot and its actuators together, as each has notes on the other.

    After LOOK AGAIN neither is written, unless ``force`` is set.
    """
    robot_path = outputs.path_of("--out") or None
    actuators_path = outputs.path_of("--out-actuators") or None
    if found.verdict.word is Word.LOOK_AGAIN and not force:
        if robot_path or actuators_path or outputs.path_of("--csv"):
            click.echo("nothing else is written after LOOK AGAIN; --force writes all the same.", err=True)
        outputs.leave_out_all_but("--json", "--plot")
        return
    actuator_entries: Mapping[str, object] | None = None
    if robot.drives is not None:
        actuator_entries = robot.drives.entries
    log_names = []  # without folders
    for log in logs:
        file_names = [Path(part).name for part in log.split("+")]
        log_names.append("+".join(file_names))

    def write_both(found: Identified, path: str) -> None:
        first_path = robot_path or actuators_path
        if path != first_path:  # called for each of both paths; the first call writes both
            return
        options: dict[str, Any] = {}
        if isinstance(found, IdentifiedRobot):
            options = {"given": actuator_entries, "logs": log_names}
        for sentence in found.write(robot_path, actuators_path, force=force, **options):
            note(sentence)

    outputs.set_writer("--out", write_both)
    outputs.set_writer("--out-actuators", write_both)


# ── ``excite``: a motion whose log tells most


@command_of(
    "excite",
    excite,
    files=(
        table_file(ExcitingMotion.to_csv, "Write the motion, which torques and view read"),
        picture_file("Draw the motion with its limits."),
    ),
    report=True,
    examples=("excite panda --duration 20 --harmonics 5 --csv motion.csv",),
    left_out={"velocity", "effort", "clear", "friction_speed"},
    spellings={
        "friction": _FRICTION,
        "clear_of_itself": Spelling(
            "--ignore-self", {"": False}, "Ignore collisions between links; the verdict is then UNSURE."
        ),
        "noise": Spelling(
            "--torque-noise NM", text="Standard deviation of the torques [N m, N]; default: 1 % of each limit."
        ),
    },
    kinds={"FrictionLaws": Kind("LAWS", parse_friction), "ArrayLike": Kind("VALUE", settings={"type": float})},
)
def excite_command(robot: RobotOptions, asked: Asked) -> ExcitingMotion:
    """Plan an excitation trajectory for identify: at rest at both ends, and within all limits.

    Limits are those of positions, velocities, accelerations and torques, and the floor if given. Links keep a distance of
    20 mm from it and from each other, by capsules around the shapes of the robot file; capsules are assumed for links without
    shapes. The first word is the verdict. Exit code: 0 for OK; 1 for UNSURE, if capsules are assumed or a check was skipped,
    and for COLLISION and OVER LIMIT by --clearance. The motion is written in either case.
    """
    with progress_bar("looking for a motion") as progress:
        return excite(robot.load(), progress=progress, **asked)
