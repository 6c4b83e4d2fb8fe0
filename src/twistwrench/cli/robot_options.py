"""What every command of the shell takes to know its robot."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..core.printed_numbers import printed
from ..errors import ModelWarning, ValueRangeError
from ..report.locks import joints_beside, joints_held
from .bundled_files import bundled
from .help import RobotOption
from .plain_errors import plain_errors
from .robot_argument import robot_source

if TYPE_CHECKING:
    from ..model.model import Model
    from ..robot import Robot


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
    chain: tuple[str, str] | None = None
    """Two frames; joints that are not between them are held at neutral."""
    keep: str | None = None
    """Of an MJCF scene, the body to read."""
    model: str | None = None
    """Of an SDF world, the model to read."""

    def load(self) -> Robot:
        """The robot meant: a bundled one by name, or a file by its path."""
        return self._load()[0]

    def load_and_locked(
        self, *, stiff: bool = False, held: Callable[[Model], Iterable[str]] | None = None
    ) -> tuple[Robot, tuple[str, ...]]:
        """The robot, and the names of all joints that the options hold still, those that follow them among them.

        ``stiff`` takes elastic gears to be rigid. ``held`` names joints of the model that are held at neutral besides.
        """
        return self._load(stiff=stiff, held=held)

    @property
    def files(self) -> dict[str, str | None]:
        """The files read for the robot, by argument; None of bundled ones. No output may overwrite them."""
        given = {"ROBOT": self.source, "--actuators": self.actuators}
        return {name: path if path and Path(path).is_file() else None for name, path in given.items()}

    def _load(
        self, *, stiff: bool = False, held: Callable[[Model], Iterable[str]] | None = None
    ) -> tuple[Robot, tuple[str, ...]]:
        make = self._maker()
        options: dict[str, Any] = {"tip": self.tip, "mimic": self.mimic, "inertia": self.inertia}
        if self.floating_base:  # some bundled robots float of themselves
            options["floating_base"] = True
        options |= {name: value for name, value in (("keep", self.keep), ("model", self.model)) if value is not None}
        if not self.lock and held is None and self.chain is None:
            return self._driven(make(lock={}, **options), stiff=stiff), ()
        # Which locked joints turn and which slide, and their limits, are known only once the robot is.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ModelWarning)
            whole = make(**{**options, "inertia": "accept"})
        free = whole.model
        lock = joints_held(free, self.lock, degrees=self.degrees)
        if self.chain is not None:
            single = {b.joint.name: float(whole.neutral[b.q_index]) for b in free.leaders if b.joint.nv == 1}
            lock = {name: single[name] for name in joints_beside(free, *self.chain) if name in single} | lock
        if held is not None:
            lock |= self._missing(whole, [name for name in held(free) if name not in lock])
        if self.actuators:
            robot = self._driven(make(lock={}, **options), stiff=stiff).lock(lock)
        else:
            robot = make(lock=lock, **options)
        moving = {b.joint.name for b in robot.model.bodies}
        return robot, tuple(b.joint.name for b in free.bodies if b.joint.name not in moving)

    def _missing(self, robot: Robot, names: list[str]) -> dict[str, float]:
        """The neutral positions of joints that a motion leaves out; none where it leaves out all, as then it is misread."""
        single = {b.joint.name: b for b in robot.model.leaders if b.joint.nv == 1}
        if len(names) == len(robot.model.leaders):
            return {}
        found = {name: float(robot.neutral[single[name].q_index]) for name in names if name in single}
        if found:
            click.echo(
                "note: held still, as the motion has no column for them: "
                f"{', '.join(f'{n}={printed(v)}' for n, v in found.items())}.",
                err=True,
            )
        return found

    def _driven(self, robot: Robot, *, stiff: bool) -> Robot:
        if self.actuators is None:
            return robot
        return robot.with_actuators(bundled(self.actuators, self.source, ".yaml", "actuator file"), stiff=stiff)

    def _maker(self) -> Callable[..., Robot]:
        from .. import robots
        from ..robot import load
        from ..robots.finding import plain_name

        if self._bundled:
            make: Callable[..., Robot] = getattr(robots, plain_name(self.source))
            return make
        return partial(load, robot_source(self.source))

    @property
    def _bundled(self) -> bool:
        from .. import robots
        from ..robots.finding import plain_name

        return plain_name(self.source) in robots.names() and not Path(self.source).is_file()


def robot_command(function: Callable[..., None]) -> Callable[..., None]:
    """The ROBOT argument and the options shared by all commands; errors and warnings in a line each."""

    @click.argument("source", metavar="ROBOT")
    @click.option("--floating-base", cls=RobotOption, is_flag=True, help="Let the base move freely.")
    @click.option(
        "--lock",
        cls=RobotOption,
        metavar="JOINT=VALUE",
        multiple=True,
        help="Hold a joint still there, or all of '*wheel*'; may be repeated.",
    )
    @click.option(
        "--chain",
        cls=RobotOption,
        nargs=2,
        metavar="BASE TIP",
        help="Hold all joints still that are not between these frames.",
    )
    @click.option(
        "--keep", cls=RobotOption, metavar="BODY", help="Of an MJCF scene: this body and all that it carries."
    )
    @click.option("--model", cls=RobotOption, metavar="NAME", help="Of an SDF world: this model.")
    @click.option("--tip", cls=RobotOption, metavar="FRAME", help="The frame meant where none is named.")
    @click.option(
        "--mimic",
        cls=RobotOption,
        type=click.Choice(["follow", "independent"]),
        default="follow",
        show_default=True,
        help="Whether mimic joints follow their leader.",
    )
    @click.option(
        "--inertia",
        cls=RobotOption,
        type=click.Choice(["error", "accept", "repair"]),
        default="error",
        show_default=True,
        help="What becomes of an inertia that no body can have.",
    )
    @click.option(
        "--actuators",
        cls=RobotOption,
        metavar="FILE.yaml",
        help="Motors, gears, rotors and friction; 'demo' is bundled.",
    )
    @click.option(
        "--degrees", cls=RobotOption, is_flag=True, help="Angles in files, options and reports are in degrees."
    )
    @wraps(function)
    def command(
        source: str,
        floating_base: bool,
        lock: tuple[str, ...],
        chain: tuple[str, str] | None,
        keep: str | None,
        model: str | None,
        tip: str | None,
        mimic: str,
        inertia: str,
        actuators: str | None,
        degrees: bool,
        **rest: Any,
    ) -> None:
        with plain_errors():
            held: dict[str, float] = {}
            for joint, value in map(_parse_lock, lock):
                if joint in held:
                    raise ValueRangeError(f"--lock {joint} is given twice. Keep one of them.")
                held[joint] = value
            options = RobotOptions(
                source, floating_base, held, tip, mimic, inertia, actuators, degrees, chain, keep, model
            )
            function(options, **rest)

    return command


def _parse_lock(text: str) -> tuple[str, float]:
    joint, equals, value = text.partition("=")
    try:
        if not equals or not math.isfinite(float(value)):
            raise ValueError  # noqa: TRY301  the same sentence answers all of it
        return joint.strip(), float(value)
    except ValueError:
        raise ValueRangeError(f"lock {text!r} is not JOINT=VALUE, for example gripper=0.02.") from None
