"""The shell. Commands read options, call one function of the library, and turn errors into one line and an exit code.

Exit codes: 0 done; 1 ran, and found a problem it was asked to look for; 2 bad input. Everything heavy is imported
inside the command that needs it, so that ``--help`` answers at once.
"""

from __future__ import annotations

import math
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .errors import ModelWarning, NotFoundError, TwistWrenchError, UnknownNameError, ValueRangeError
from .export.command import export_options
from .report.usage import Commands, in_shell_words
from .sensing.command import sensor_group
from .statics.command import payload_options
from .symbolic.command import derive_options

if TYPE_CHECKING:
    from rich.console import Console

    from .report.trajectory import Trajectory
    from .robot import Robot

__all__ = ["main"]

_FOUND_A_PROBLEM, _BAD_INPUT = 1, 2
_LONG_FILE = 1 << 23  # bytes from which a progress bar is worth its flicker
_DEMO = "demo"


@dataclass(frozen=True)
class RobotOptions:
    """What every command takes to know its robot."""

    source: str
    floating_base: bool
    lock: dict[str, float]
    tip: str | None
    mimic: str
    inertia: str
    actuators: str | None
    degrees: bool

    def load(self) -> Robot:
        """The robot meant: a bundled one by name, or a file by its path."""
        return self._load()[0]

    def load_and_locked(self, *, stiff: bool = False) -> tuple[Robot, tuple[str, ...]]:
        """The robot, and the names of all joints that the options hold still, those that follow them among them.

        ``stiff`` takes elastic gears to be rigid.
        """
        return self._load(stiff=stiff)

    @property
    def files(self) -> dict[str, str | None]:
        """The files read for the robot, by argument; None of bundled ones. No output may overwrite them."""
        given = {"ROBOT": self.source, "--actuators": self.actuators}
        return {name: path if path and Path(path).is_file() else None for name, path in given.items()}

    def _load(self, *, stiff: bool = False) -> tuple[Robot, tuple[str, ...]]:
        make = self._maker()
        options: dict[str, Any] = {"tip": self.tip, "mimic": self.mimic, "inertia": self.inertia}
        if self.floating_base:  # some bundled robots float of themselves
            options["floating_base"] = True
        if not self.lock:
            return self._driven(make(lock={}, **options), stiff=stiff), ()
        # Which locked joints turn and which slide, and their limits, are known only once the robot is.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ModelWarning)
            free = make(**{**options, "inertia": "accept"}).model
        kinds = {b.joint.name: b.joint.kind for b in free.bodies}
        degrees = {n: self.degrees and kinds.get(n) != "prismatic" for n in self.lock}
        lock = {n: math.radians(v) if degrees[n] else v for n, v in self.lock.items()}
        if self.actuators:
            robot = self._driven(make(lock={}, **options), stiff=stiff).lock(lock)
        else:
            robot = make(lock=lock, **options)
        for b in free.leaders:
            name = b.joint.name
            if name in lock and b.joint.nv == 1:
                low, high = float(free.limits.lower[b.v_index]), float(free.limits.upper[b.v_index])
                if not low - 1e-9 <= lock[name] <= high + 1e-9:
                    unit = math.degrees(1.0) if degrees[name] else 1.0
                    click.echo(
                        f"note: --lock {name}={self.lock[name]:g} is outside the joint's limits, "
                        f"{unit * low:.5g} to {unit * high:.5g}.",
                        err=True,
                    )
        moving = {b.joint.name for b in robot.model.bodies}
        return robot, tuple(b.joint.name for b in free.bodies if b.joint.name not in moving)

    def _driven(self, robot: Robot, *, stiff: bool) -> Robot:
        if self.actuators is None:
            return robot
        return robot.with_actuators(_bundled(self.actuators, self.source, ".yaml", "actuator file"), stiff=stiff)

    def _maker(self) -> Callable[..., Robot]:
        from . import robots
        from .robot import load

        if self.source in robots.names() and not Path(self.source).is_file():
            make: Callable[..., Robot] = getattr(robots, self.source)
            return make
        if not Path(self.source).exists():
            raise NotFoundError(
                f"no robot file {self.source!r}, and no bundled robot of that name. "
                f"Give a path, or one of: {', '.join(robots.names())}."
            )
        return partial(load, self.source)


def robot_command(function: Callable[..., None]) -> Callable[..., None]:
    """The ROBOT argument and the options shared by all commands; errors and warnings in a line each."""

    @click.argument("source", metavar="ROBOT")
    @click.option("--floating-base", is_flag=True, help="Let the base move freely.")
    @click.option("--lock", metavar="JOINT=VALUE", multiple=True, help="Hold a joint still there; may be repeated.")
    @click.option("--tip", metavar="FRAME", help="The frame meant where none is named.")
    @click.option("--mimic", type=click.Choice(["follow", "independent"]), default="follow", show_default=True)
    @click.option("--inertia", type=click.Choice(["error", "accept", "repair"]), default="error", show_default=True)
    @click.option("--actuators", metavar="FILE.yaml", help="Motors, gears, rotors and friction; 'demo' is bundled.")
    @click.option("--degrees", is_flag=True, help="Angles in files, options and reports are in degrees.")
    @wraps(function)
    def command(
        source: str,
        floating_base: bool,
        lock: tuple[str, ...],
        tip: str | None,
        mimic: str,
        inertia: str,
        actuators: str | None,
        degrees: bool,
        **rest: Any,
    ) -> None:
        with _plain_errors():
            held: dict[str, float] = {}
            for joint, value in map(_parse_lock, lock):
                if joint in held:
                    raise ValueRangeError(f"--lock {joint} is given twice. Keep one of them.")
                held[joint] = value
            function(RobotOptions(source, floating_base, held, tip, mimic, inertia, actuators, degrees), **rest)

    return command


@contextmanager
def _plain_errors() -> Iterator[None]:
    """Errors of the library end the program with one line on stderr; its warnings are a line each."""
    with warnings.catch_warnings():
        warnings.simplefilter("always", ModelWarning)
        warnings.showwarning = lambda message, *_args, **_rest: click.echo(
            f"note: {in_shell_words(str(message))}", err=True
        )
        try:
            yield
        except TwistWrenchError as error:
            click.echo(f"error: {' '.join(in_shell_words(str(error)).split())}", err=True)
            sys.exit(_BAD_INPUT)


def _parse_lock(text: str) -> tuple[str, float]:
    joint, equals, value = text.partition("=")
    try:
        if not equals or not math.isfinite(float(value)):
            raise ValueError  # noqa: TRY301  the same sentence answers all of it
        return joint.strip(), float(value)
    except ValueError:
        raise ValueRangeError(f"lock {text!r} is not JOINT=VALUE, for example gripper=0.02.") from None


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="twistwrench")
def main() -> None:
    """Robot dynamics from robot files. ROBOT is a path or the name of a bundled robot, such as ur5."""


@main.command()
@click.option(
    "--trajectory",
    "motion",
    metavar="FILE.csv",
    required=True,
    help="The motion; 'demo' is the one bundled with a robot.",
)
@click.option(
    "--payload",
    "payloads",
    metavar="MASS[,x,y,z][@FRAME]",
    multiple=True,
    help="A point mass carried; may be repeated.",
)
@click.option(
    "--wrench-on-robot", "wrenches", metavar="FRAME:m,m,m,f,f,f", multiple=True, help="What the world does to it there."
)
@click.option("--csv", "csv_path", metavar="OUT.csv", help="Write time and torques.")
@click.option("--split", is_flag=True, help="Write the causes of the torques too.")
@click.option("--plot", "plot_path", metavar="OUT.png", help="Draw torques, limits, and the split of the worst joint.")
@click.option(
    "--limits",
    "limits_path",
    metavar="FILE.csv",
    help="Limits in place of the robot's: joint,lower,upper,velocity,effort.",
)
@click.option("--motor-plot", metavar="OUT.png", help="Draw what each motor does in its speed–torque region.")
@click.option("--why", is_flag=True, help="Split the worst joint's peak by link, payload and rotor too.")
@click.option("--smooth", is_flag=True, help="Smooth a noisy log, as much as its noise asks, before deriving from it.")
@click.option("--no-friction", is_flag=True, help="Leave joint friction and damping out.")
@robot_command
def torques(
    options: RobotOptions,
    motion: str,
    payloads: tuple[str, ...],
    wrenches: tuple[str, ...],
    csv_path: str | None,
    split: bool,
    plot_path: str | None,
    limits_path: str | None,
    motor_plot: str | None,
    why: bool,
    smooth: bool,
    no_friction: bool,
) -> None:
    """Which torques a motion takes, which joint is over its limit, and what causes it.

    Exit code 1 if a limit of torque, velocity or position is passed. UNSURE, where noise reaches over a limit, ends
    with code 0.
    """
    from .outputs import check_outputs, picture_path

    if split and csv_path is None:
        raise ValueRangeError("--split adds columns to the file of --csv, and there is none. Add --csv OUT.csv.")
    path = _bundled(motion, options.source, ".csv", "motion")
    if options.degrees and path != Path(motion):
        raise ValueRangeError("the bundled motion 'demo' is in radians. Leave --degrees out.")
    _check_extra(plot_path or motor_plot)
    plot_path = None if plot_path is None else picture_path(plot_path)
    motor_plot = None if motor_plot is None else picture_path(motor_plot)
    if motor_plot is not None and options.actuators is None:
        raise ValueRangeError("--motor-plot draws the motors, and none are described. Add --actuators FILE.yaml.")
    check_outputs(
        {"--csv": csv_path, "--plot": plot_path, "--motor-plot": motor_plot},
        {"--trajectory": path, "--limits": limits_path, **options.files},
    )
    from .report.derivatives import Differentiation
    from .report.limits_file import read_limits
    from .report.load import LoadedRobot, parse_payload, parse_wrenches
    from .report.tables import report_view
    from .report.torques import analyse
    from .report.trajectory import Trajectory, moves_motors

    robot, locked = options.load_and_locked(stiff=not moves_motors(path))
    load = LoadedRobot(robot, tuple(map(parse_payload, payloads)), parse_wrenches(wrenches), friction=not no_friction)
    limits = (
        robot.model.limits if limits_path is None else read_limits(limits_path, robot.model, degrees=options.degrees)
    )
    trajectory = Trajectory.open(path, robot.model, degrees=options.degrees, locked=locked)
    differentiation = Differentiation.plan(trajectory, robot.model, smoothing=smooth)
    if smooth and not differentiation.derives:
        click.echo("note: --smooth changes nothing: the file gives velocities and accelerations.", err=True)
    with _progress(trajectory) as progress:
        report = analyse(load, differentiation, limits, csv=csv_path, split=split, progress=progress)
    _console().print(report_view(report, degrees=options.degrees, why=why))
    if plot_path is not None:
        from .report.plot import plot_report

        plot_report(report, plot_path)
    if motor_plot is not None:
        from .report.motors_plot import plot_motors

        if not report.motors:
            raise ValueRangeError(f"{options.actuators} describes no motor, so there is nothing to draw for --motor-plot.")
        plot_motors(report, motor_plot)
    for written in filter(None, (csv_path, plot_path, motor_plot)):
        click.echo(f"wrote {written}")
    if report.excesses or any(use.too_small for use in report.motors):
        sys.exit(_FOUND_A_PROBLEM)


@main.command()
@robot_command
def info(options: RobotOptions) -> None:
    """What the robot is made of: joints, limits, inertias, masses, frames, and its tree."""
    from .report.info import info_view

    with warnings.catch_warnings(record=True) as remarks:
        warnings.simplefilter("always", ModelWarning)
        robot = options.load()
    for remark in remarks:  # those of the model itself stand below its tree
        if not any(defect in str(remark.message) for defect in robot.defects):
            warnings.warn_explicit(remark.message, remark.category, remark.filename, remark.lineno)
    _console().print(info_view(robot, degrees=options.degrees))


@main.command()
@robot_command
def verify(options: RobotOptions) -> None:
    """Check the robot's dynamics against independent formulas and libraries; exit code 1 if any disagrees."""
    from .verify import render
    from .verify import verify as checked

    robot = options.load()
    if robot.nv == 0:
        raise ValueRangeError(f"nothing to check: {robot.name!r} has no joint that moves; load with --floating-base.")
    report = checked(robot)
    _console().print(render(report))
    if not report.passed:
        sys.exit(_FOUND_A_PROBLEM)


@main.command()
@payload_options
@robot_command
def payload(options: RobotOptions, **given: Any) -> None:
    """The largest payload held at rest at a pose, the joint that limits it, and the forces the robot can apply.

    Exit code 1 if the pose is outside the joints' position limits, or the robot cannot hold itself there.
    """
    from .outputs import check_outputs, picture_path
    from .statics.command import answer_payload

    _check_extra(given["plot_path"])
    if given["plot_path"] is not None:
        given["plot_path"] = picture_path(given["plot_path"])
    check_outputs(
        {"--csv": given["csv_path"], "--plot": given["plot_path"]},
        {"--limits": given["limits_path"], **options.files},
    )
    robot = options.load()
    if not answer_payload(robot, _console().print, degrees=options.degrees, **given):
        sys.exit(_FOUND_A_PROBLEM)


@main.command()
@derive_options
@robot_command
def derive(options: RobotOptions, **given: Any) -> None:
    """The robot's equations of motion in symbols, derived by Lagrange's method, as text, LaTeX, a page, C or NumPy."""
    from .symbolic.command import derive_answer

    for part in derive_answer(options.load(), options.files, **given):
        if isinstance(part, str):
            click.echo(part)
        else:
            _console().print(part)


@main.command()
@export_options
@robot_command
def export(options: RobotOptions, **given: Any) -> None:
    """The robot's quantities as C99 source that allocates nothing and needs math.h only, with a program that checks it."""
    from .export.command import export_answer

    for line in export_answer(options.load(), options.files, **given):
        click.echo(line)


def _check_extra(plot_path: str | None) -> None:
    """Say before the long run, not after it, that a picture cannot be drawn."""
    if plot_path is not None:
        from .figure import require_matplotlib

        require_matplotlib("Drawing the report (--plot)")


def _bundled(name: str, robot: str, suffix: str, what: str) -> Path:
    """The path given, or for ``demo`` the file of that kind bundled with that robot."""
    if name != _DEMO or Path(name).is_file():
        return Path(name)
    folder = Path(__file__).parent / "robots"
    path = folder / f"{robot}_{_DEMO}{suffix}"
    if not path.is_file():
        have = [p.stem.removesuffix(f"_{_DEMO}") for p in sorted(folder.glob(f"*_{_DEMO}{suffix}"))]
        raise UnknownNameError(
            f"no {what} is bundled with {robot!r}. With: {', '.join(have)}. Give the path of a {suffix[1:].upper()} file "
            "instead."
        )
    return path


def _console() -> Console:
    from rich.console import Console

    console = Console(highlight=False)
    # Files and pipes have no width of their own; 110 columns hold the tables without folding.
    return console if console.is_terminal else Console(highlight=False, width=110)


@contextmanager
def _progress(trajectory: Trajectory) -> Iterator[Callable[[int], None] | None]:
    """A bar over the bytes read, where a person watches and the file is long."""
    if trajectory.size < _LONG_FILE or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(trajectory.path.name, total=trajectory.size)
        yield lambda size: bar.advance(task, size)


main.add_command(sensor_group(_plain_errors, _console, _check_extra))
