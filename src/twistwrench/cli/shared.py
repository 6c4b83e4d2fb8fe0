"""Options shared by commands: robot, motion and its columns, loads, files and batches."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..core.arguments import assignments, parse_numbers
from ..core.errors import ModelWarning, ValueRangeError
from ..core.files import replacing
from ..core.numbers import number, printed
from ..core.tables import csv_table
from ..core.text import listed
from ..motion.load_case import joints_beside, joints_held
from ..robot import load
from ..robots.finding import bundled_file
from .main import Decorator, RobotOption, note, option, option_group
from .parameters import Question

if TYPE_CHECKING:
    from ..formats.actuators import ActuatorFile
    from ..mechanics.model.model import Model
    from ..motion.motion_log import MotionLog
    from ..robot import Robot


def robot_source(source: str) -> str | Path:
    """Path of the file of ROBOT, a path or a robot's name; text of the file if ROBOT is a pipe.

    Raises :class:`~twistwrench.NotFoundError` with similar names.
    """
    from ..core.files import is_stream
    from ..formats.source import read_robot_text, standard_input_text
    from ..robots.finding import robot_file

    if source == "-":  # a pipe is read once, but may be loaded twice
        return standard_input_text()
    if is_stream(Path(source)):
        text, _ = read_robot_text(source)
        return text
    return robot_file(source)


# ── Files of bundled robots, called ``demo``


def motion_path(options: RobotOptions, motion: str) -> Path:
    """Path of the motion file. Raises ValueRangeError for a bundled motion, which is in radians, with --degrees."""
    path = bundled_file(motion, options.source, ".csv", "motion")
    if options.degrees and path != Path(motion):
        raise ValueRangeError("the bundled motion 'demo' is in radians. Leave --degrees out.")
    return path


# ── The options


LOADING = Question(load, left_out=("source", "format", "max_bodies", "snap", "gravity"), kept=("lock", "tip"))
"""Parameters of :func:`~twistwrench.load` that are options of all commands."""


@dataclass(frozen=True)
class RobotOptions:
    """Options for reading the robot."""

    source: str
    """Argument ROBOT: name of a bundled robot, path of a file, or ``-``."""
    loading: Mapping[str, Any]
    """Options of :func:`~twistwrench.load` that are given, by parameter."""
    actuators: str | None = None
    """Path of the actuator file, or ``demo``; None without one."""
    degrees: bool = False
    """True if angles are in degrees."""
    chain: tuple[str, str] | None = None
    """Two frames; joints outside their chain are locked at neutral."""

    @classmethod
    def of(cls, given: Mapping[str, Any]) -> RobotOptions:
        """Options of the command line by parameter."""
        degrees = bool(given.get("degrees"))
        return cls(given["source"], LOADING.values(given), given["actuators"], degrees, given["chain"])

    @property
    def tip(self) -> str | None:
        """Frame given with ``--tip``."""
        return self.loading.get("tip")

    def load(self) -> Robot:
        """Load a bundled robot by name, or a file by path."""
        robot, _ = self.load_and_locked()
        return robot

    @property
    def files(self) -> dict[str, str | None]:
        """Input files of the robot by argument; None for bundled files. Outputs must not overwrite them."""
        files: dict[str, str | None] = {}
        for name, path in (("ROBOT", self.source), ("--actuators", self.actuators)):
            is_file = path is not None and path != "" and Path(path).is_file()
            files[name] = path if is_file else None
        return files

    @property
    def actuator_file(self) -> Path | None:
        """Path of the actuator file; for ``demo`` the bundled one."""
        if self.actuators is None:
            return None
        return bundled_file(self.actuators, self.source, ".yaml", "actuator file")

    @cached_property
    def drives(self) -> ActuatorFile | None:
        """Content of the actuator file, read once."""
        from ..formats.actuators import ActuatorFile

        if self.actuator_file is None:
            return None
        return ActuatorFile.from_source(self.actuator_file)

    def load_and_locked(
        self, *, stiff: bool = False, held: Callable[[Model], Iterable[str]] | None = None
    ) -> tuple[Robot, tuple[str, ...]]:
        """Load the robot; returns it with the names of all locked joints, including mimic joints.

        ``stiff`` treats elastic gears as rigid. ``held`` names further joints to lock at neutral.
        """
        load_robot = self._loader()
        options = {name: value for name, value in self.loading.items() if name != "lock"}
        lock_option = self.loading.get("lock", {})
        if not lock_option and held is None and self.chain is None:
            return self._with_actuators(load_robot(**options), stiff=stiff), ()
        # Units and limits of locked joints require the loaded robot.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ModelWarning)  # the robot is loaded again below, with its warnings
            unlocked_robot = load_robot(**{**options, "inertia": "accept"})
        unlocked_model = unlocked_robot.model
        lock = joints_held(unlocked_model, lock_option, degrees=self.degrees)
        if self.chain is not None:
            neutral = _neutral_positions(unlocked_robot)
            joints_outside = joints_beside(unlocked_model, *self.chain)
            lock = {name: neutral[name] for name in joints_outside if name in neutral} | lock  # --lock has precedence
        if held is not None:
            other_names = [name for name in held(unlocked_model) if name not in lock]
            lock |= self._hold_joints_without_column(unlocked_robot, other_names)
        if self.actuators:
            robot = self._with_actuators(load_robot(**options), stiff=stiff).lock(lock)
        else:
            robot = load_robot(lock=lock, **options)
        moving_joints = {body.joint.name for body in robot.model.bodies}
        all_joints = [body.joint.name for body in unlocked_model.bodies]
        return robot, tuple(name for name in all_joints if name not in moving_joints)

    def _hold_joints_without_column(self, robot: Robot, names: list[str]) -> dict[str, float]:
        """Neutral positions of joints without a column, of which a note is printed.

        Empty if all joints lack a column: the file is then read wrongly, and the reader's error says how.
        """
        if len(names) == len(robot.model.leaders):
            return {}
        neutral = _neutral_positions(robot)
        held_positions = {name: neutral[name] for name in names if name in neutral}
        if held_positions:
            positions_text = ", ".join(f"{name}={printed(position)}" for name, position in held_positions.items())
            note(f"held still, as the motion has no column for them: {positions_text}.")
        return held_positions

    def _with_actuators(self, robot: Robot, *, stiff: bool) -> Robot:
        """Robot with the drives of the actuator file, if there is one."""
        from ..formats.actuators import add_actuators
        from ..robot import Robot

        if self.drives is None:
            return robot
        return Robot(add_actuators(robot.model, self.drives, stiff=stiff))

    def _loader(self) -> Callable[..., Robot]:
        """Function that loads the robot with options of :func:`~twistwrench.load`; its file is read once."""
        from .. import robots
        from ..formats import usd_path
        from ..formats.robot_file import RobotFile
        from ..formats.source import is_text
        from ..robots.finding import plain_name

        name = plain_name(self.source)
        if name in robots.names() and not Path(self.source).is_file():
            load_bundled: Callable[..., Robot] = getattr(robots, name)
            return load_bundled
        source = robot_source(self.source)
        if is_text(source) or usd_path(source) is not None:
            return partial(load, source)
        return partial(load, RobotFile.from_path(source))


ROBOT = option_group(
    click.argument("source", metavar="ROBOT"),
    *LOADING.declarations(RobotOption),
    option("--chain BASE TIP", "Lock all joints that are not between these two frames.", nargs=2, cls=RobotOption),
    option(
        "--actuators FILE.yaml", "File of motors, gears, rotors and friction; 'demo': the bundled one.", cls=RobotOption
    ),
)
"""The ROBOT argument and the options shared by all commands."""
DEGREES = option("--degrees", "Use degrees for angles in files, options and reports.", cls=RobotOption)


# ── Options of several commands

PAYLOADS = option(
    "--payload MASS[,x,y,z][@FRAME]",
    "Mass attached to the robot's tip, or to FRAME, at x,y,z there [kg, m]; may be repeated.",
    "payloads",
    multiple=True,
)
WRENCHES = option(
    "--wrench-on-robot FRAME:m,m,m,f,f,f",
    "Constant wrench exerted on the robot at FRAME, in its axes: moments [N m], forces [N]; may be repeated.",
    "wrenches",
    multiple=True,
)
CLEARANCE = option_group(
    option(
        "--clearance [DISTANCE]",
        "Check the least distance between links [m].  [default without a number: 0]",
        type=float,
        is_flag=False,
        flag_value=0.0,
    ),
    option("--srdf FILE", "Ignore the pairs of links of <disable_collisions> in the check of the clearance."),
)
NO_FRICTION = option("--no-friction", "Do not count joint friction and damping.")
AT = option(
    "--at v,v,…|NAME|JOINT=VALUE",
    "Configuration: all coordinates, a configuration of the file by its name, or the position of a joint, the others at "
    "zero; may be repeated.",
    multiple=True,
)
JSON = option("--json OUT.json", "Write the results as JSON; '-' prints them in place of the report.")


COLUMNS = option(
    "--columns JOINT=COLUMN,…",
    "Columns of the log: elbow=pos3, elbow.vel=w3, elbow.tau=i3, time=stamp; LOG:elbow=pos3 for the file LOG only; "
    "pos1,pos2,… in the order of the joints; or @MAP.csv with the columns name,column; may be repeated.",
    multiple=True,
)
GAIN = option(
    "--gain JOINT=VALUE",
    "Torque per ampere [N m/A, N/A] for a column of currents; may be repeated. [default: from --actuators]",
    multiple=True,
)
RATE = option("--rate HZ", "Sampling rate of a log without a time column.", type=float)
CHOICE = option_group(
    option(
        "--topic NAME[:reference]",
        "Topic of a ROS recording; NAME:reference reads the reference of a controller state.",
    ),
    option("--episode N", "Episode of a LeRobot dataset. [default: the only one]", type=int),
)
"""Selected part of a file with several motions."""
LOG_READING = option_group(
    COLUMNS,
    GAIN,
    RATE,
    CHOICE,
    option("--lock-missing", "Lock joints without a column at their neutral position."),
)
"""Options for how logs are read."""


PLAN = option(
    "--plan", "Plan, not a log: steps that no robot makes are excesses of the motion, not errors of a recording."
)


# ── The motion: its options, its robot and its file


def _neutral_positions(robot: Robot) -> dict[str, float]:
    """Neutral position of each joint with one degree of freedom that follows no other."""
    leaders = [body for body in robot.model.leaders if body.joint.nv == 1]
    return {body.joint.name: float(robot.neutral[body.q_index]) for body in leaders}


def motion_argument(*, required: bool) -> Decorator:
    """Argument MOTION and the option --trajectory, which is another way to give it."""

    def store_motion(context: click.Context, argument: click.Parameter, motion: str | None) -> None:
        trajectory = context.params.get("trajectory")  # parsed before the argument, as the option is eager
        if motion is not None and trajectory is not None:
            raise click.UsageError(
                f"the motion is given twice, {motion} and --trajectory {trajectory}. Leave one of them out.", context
            )
        if motion is None and trajectory is None and required:
            raise click.MissingParameter(ctx=context, param=argument)
        context.params["trajectory"] = trajectory if motion is None else motion

    return option_group(
        click.argument("motion", metavar="[MOTION]", required=False, callback=store_motion, expose_value=False),
        option(
            "--trajectory FILE.csv", "Motion to read, as MOTION; 'demo': the one bundled with the robot.", is_eager=True
        ),
    )


@dataclass(frozen=True)
class LogOptions:
    """Options for reading the file of a motion."""

    trajectory: str | None
    columns: tuple[str, ...] = ()
    gain: tuple[str, ...] = ()
    rate: float | None = None
    topic: str | None = None
    episode: int | None = None
    lock_missing: bool = False
    plan: bool = False

    @classmethod
    def of(cls, given: Mapping[str, Any]) -> LogOptions:
        """Options of the command line by parameter."""
        return cls(**{field.name: given[field.name] for field in fields(cls)})

    @property
    def given(self) -> list[str]:
        """Names of the options that differ from their defaults, without ``trajectory``, the file itself."""
        _, *option_fields = fields(self)
        return [field.name for field in option_fields if getattr(self, field.name) != field.default]

    def path(self, robot: RobotOptions) -> Path:
        """Path of the motion; ``demo`` is bundled with the robot."""
        assert self.trajectory is not None, "the commands that need a motion require it"
        return motion_path(robot, self.trajectory)


def open_motion(
    options: RobotOptions, log: LogOptions, path: Path, logs: Sequence[str] = (), *, stands: bool = False
) -> tuple[Robot, MotionLog]:
    """Load the robot and open a motion of it; raises the errors of :meth:`MotionLog.open`.

    ``logs`` are the names of logs that ``--columns`` may use; default: the path. If the robot ``stands``, the file may lack
    the pose of its base.
    """
    from ..motion.motion_file import joints_without_column, moves_motors, open_motion_file
    from ..motion.motion_log import MotionLog

    columns = parse_columns(log.columns, logs or [str(path)])
    file = open_motion_file(path, log.topic, log.episode)
    held = None
    if log.lock_missing:
        held = partial(joints_without_column, file, columns=columns)
    robot, _ = options.load_and_locked(stiff=not moves_motors(file), held=held)
    if stands:
        from ..reports.support.standing_log import robot_of_log

        robot = robot_of_log(robot, file, columns)
    gains = current_gains(log.gain, robot.model, options.drives)
    return robot, MotionLog.open(
        file, robot.model, plan=log.plan, degrees=options.degrees, columns=columns, rate=log.rate, gain=gains
    )


def refuse_motor_side(options: RobotOptions, robot: Robot, command: str) -> None:
    """Raise ValueRangeError if the actuator file declares logs of motor positions, which are not supported."""
    from ..formats.actuators import read_log_side

    actuators = options.drives
    if actuators is not None and read_log_side(robot.model, actuators).of_motors:
        raise ValueRangeError(
            f"by {actuators}, logs have the motors' positions (log: side: motor), and {command} reads those of the joints. "
            "Write them first: tw.identification.read_motion(log, robot, side=tw.identification.motor_side(robot.model, "
            "file)).to_csv(path); twistwrench identify reads either."
        )


def parse_columns(texts: Iterable[str], logs: Sequence[str]) -> dict[str, str]:
    """Parse lists of ``JOINT=COLUMN`` or ``LOG:JOINT=COLUMN``, lists of columns, and ``@MAP.csv``, for these logs.

    Names with a comma or an equals sign are quoted. Lists of columns have the keys ``#1``, ``#2`` … in joint order.
    Raises ValueRangeError with the expected form.

    >>> parse_columns(["elbow=pos3,time=Time [ms]", 'b.csv:elbow="a, b"'], ["logs/a.csv", "logs/b.csv"])
    {'elbow': 'pos3', 'time': 'Time [ms]', 'b.csv:elbow': 'a, b'}
    >>> parse_columns(["pos1,pos2"], [])
    {'#1': 'pos1', '#2': 'pos2'}
    """
    form = "JOINT=COLUMN, for example elbow=pos3 or elbow.vel=w3, or a list of these, or of columns in the order of the joints"
    pairs: list[tuple[str, str]] = []
    for text in texts:
        if text.startswith("@"):
            pairs += _column_map(text[1:])
            continue
        entries = [""]
        if text.strip():
            entries = [match[0] for match in _ENTRY.finditer(text)]
        named_columns: list[tuple[str, str]] = []  # from JOINT=COLUMN
        numbered_columns: list[tuple[str, str]] = []  # from COLUMN alone
        for k, entry in enumerate(entries, start=1):
            sides = _SIDES.fullmatch(entry)
            if sides is None:
                numbered_columns.append((f"#{k}", _unquoted(entry)))
            else:
                named_columns.append((_unquoted(sides[1]), _unquoted(sides[2])))
        is_single_word = len(entries) == 1 and not _is_quoted(text)  # rather a forgotten JOINT= than a list
        if numbered_columns and (named_columns or "" in entries or is_single_word):
            raise ValueRangeError(f"--columns {text!r} is not {form}.")
        pairs += named_columns or numbered_columns
    log_prefixes: list[str] = []
    for name in logs:
        log_prefixes += (f"{name}:", f"{Path(name).name}:")
    columns: dict[str, str] = {}
    for key, column in pairs:
        log, _, _ = key.rpartition(":")
        if not (key and column):
            raise ValueRangeError(f"--columns '{key}={column}' is not {form}.")
        if key in columns:
            raise ValueRangeError(f"--columns {key} is given twice. Keep one of them.")
        names_a_file = "." in log  # the name of a joint may have a colon, too
        if names_a_file and not key.startswith(tuple(log_prefixes)):
            raise ValueRangeError(f"--columns {key}={column}: there is no log {log!r}. Logs: {listed(logs)}.")
        columns[key] = column
    return columns


_CHARACTER_OR_QUOTED = r'(?:[^",]|"(?:[^"]|"")*")'
_ENTRY = re.compile(rf"(?:(?<=,)|^){_CHARACTER_OR_QUOTED}*")
"""Entry of a list: text up to a comma that is not between quotation marks; a doubled mark stands for itself."""
_SIDES = re.compile(r'((?:[^"=]|"(?:[^"]|"")*")*)=(.*)', re.DOTALL)
"""Texts before and after the first equals sign that is not between quotation marks."""


def _is_quoted(text: str) -> bool:
    """True if a text begins with a quotation mark."""
    return text.strip().startswith('"')


def _unquoted(text: str) -> str:
    """Text without blanks and quotation marks around it."""
    stripped_text = text.strip()
    if len(stripped_text) > 1 and stripped_text[0] == stripped_text[-1] == '"':
        return stripped_text[1:-1].replace('""', '"')
    return stripped_text


def _column_map(path: str) -> list[tuple[str, str]]:
    """Entries of a CSV file with the columns ``name`` and ``column``."""
    from ..motion.readers.csv_reader import CsvFile, table_errors

    with table_errors(path, "map of columns", "name,column, then a line for each, such as elbow,pos3"):
        file = CsvFile.open(path)
        rows = list(file.rows())
    if [cell.casefold() for cell in file.header] != ["name", "column"]:
        raise ValueRangeError(f"--columns @{path}: the header is {','.join(file.header)!r}, and not 'name,column'.")
    return [(name, column) for _, (name, column) in rows]


_MAX_GAIN_DIFFERENCE = 0.01
"""Relative difference below which two rounded gains are equal."""


def current_gains(
    texts: Iterable[str], model: Model, source: ActuatorFile | None, *, of_side: bool = False
) -> dict[str, float]:
    """Current gains of ``--gain``, and of the actuator file for ``joint.current``; raises ValueRangeError if they differ.

    If ``of_side``, gains below ``log:`` in that file are 1, because the conversion from motor side to joints applies them.
    """
    from ..formats.actuators import read_log_side

    gain_texts = assignments(texts, "--gain", "JOINT=VALUE, for example elbow=11.1")
    option_gains: dict[str, float] = {}
    for joint, text in gain_texts.items():
        (option_gains[joint],) = parse_numbers(text, f"--gain {joint}", "a number", 1)
    if source is None:
        return option_gains
    side = read_log_side(model, source)
    for joint, gain in option_gains.items():
        file_gain = side.of_currents.get(joint, gain)
        if abs(gain - file_gain) > _MAX_GAIN_DIFFERENCE * abs(file_gain):
            raise ValueRangeError(
                f"--gain {joint}={number(gain)}, and {source} gives {number(file_gain, 4)} N m/A (torque constant times "
                "ratio, or log: gain:). Leave out one of them."
            )
    gains = dict(option_gains)
    joint_names = {*model.velocity_names, *model.drive_names}
    for name, gain in side.of_currents.items():
        if name in joint_names:
            gains[f"{name}.current"] = gain
    if of_side:
        for name in gains:
            if name.removesuffix(".current") in side.gain:
                gains[name] = 1.0
    return gains


# ── Batches: the files of folders and patterns

worker_options = option_group(
    option("--workers N", "Use N processes of this machine (Dask).", type=int),
    option("--scheduler ADDRESS", "Use the Dask cluster of this scheduler, tcp://10.0.0.1:8786."),
)
"""``--workers`` and ``--scheduler``."""


# ── Files


def show_written(*paths: object, to_error: bool = False) -> None:
    """Print a line for each written file that is not None; ``to_error`` if data are on standard output."""
    for path in filter(None, paths):
        click.echo(f"wrote {path}", err=to_error)


def write_text(path: str | Path, text: str) -> None:
    """Write a file, and print a line for it."""
    with replacing(path) as scratch:
        scratch.write_text(text, encoding="utf-8", newline="")
    show_written(path)


def write_csv(path: str | Path | None, columns: Mapping[str, Iterable[str | float | None]]) -> None:
    """Write columns with a header to a CSV file if there is a path; None is an empty cell."""
    if path is None:
        return
    with csv_table(path, columns) as table:
        for row in zip(*columns.values(), strict=True):
            table.row(str(cell) if isinstance(cell, int) else cell for cell in row)  # integers without a decimal point
