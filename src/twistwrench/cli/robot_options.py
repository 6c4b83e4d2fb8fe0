"""The argument ROBOT and the options for reading it, with the files of bundled robots."""

from __future__ import annotations

import difflib
import math
import warnings
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from functools import partial, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..core.numbers import printed
from ..errors import ModelWarning, NotFoundError, UnknownNameError, ValueRangeError
from ..reports.load_case import joints_beside, joints_held
from .usage import Decorator, Given, RobotOption, command, option_group

if TYPE_CHECKING:
    from ..model.model import Model
    from ..robot import Robot

_STANDARD_INPUT = "-"


def robot_source(source: str) -> str | Path:
    """Resolve ROBOT: the path of a file, of a robot known by name, or the text of a pipe.

    Raises :class:`~twistwrench.NotFoundError`, with near names.
    """
    from ..core.files import is_stream
    from ..formats.source import read_robot_text, standard_input_text
    from ..robots.finding import known_robots, plain_name

    if source == _STANDARD_INPUT:  # read once, and perhaps loaded twice
        return standard_input_text()
    if is_stream(Path(source)):
        return read_robot_text(source)[0]
    with suppress(OSError):  # a name too long for a file
        if Path(source).exists():
            return source
    known, wanted = known_robots(), plain_name(source)
    if wanted in known:
        return known[wanted].path
    near = difflib.get_close_matches(wanted, known, n=3, cutoff=0.6)
    hint = f" Did you mean {' or '.join(map(repr, near))}?" if near else ""
    raise NotFoundError(
        f"no robot file {source!r}, and no bundled robot of that name, nor one of another package.{hint} "
        "Give a path, or a name that `twistwrench robots` lists."
    )


# ── Files of bundled robots, called ``demo``

_DEMO = "demo"


def bundled(name: str, robot: str, suffix: str, what: str) -> Path:
    """Path as given, or for ``demo`` the file of that kind bundled with the robot."""
    if name != _DEMO or Path(name).is_file():
        return Path(name)
    folder = Path(__file__).parents[1] / "robots"
    path = folder / f"{robot}_{_DEMO}{suffix}"
    if not path.is_file():
        have = [p.name.removesuffix(f"_{_DEMO}{suffix}") for p in sorted(folder.glob(f"*_{_DEMO}{suffix}"))]
        near = difflib.get_close_matches(robot.lower(), have, n=1, cutoff=0.8)
        hint = f" Did you mean {near[0]!r}?" if near else ""
        raise UnknownNameError(
            f"no {what} is bundled with {robot!r}.{hint} With: {', '.join(have)}. "
            f"Give the path of a {suffix.rpartition('.')[2].upper()} file instead."
        )
    return path


def motion_path(options: RobotOptions, motion: str) -> Path:
    """The motion's file; the bundled ones are in radians."""
    path = bundled(motion, options.source, ".csv", "motion")
    if options.degrees and path != Path(motion):
        raise ValueRangeError("the bundled motion 'demo' is in radians. Leave --degrees out.")
    return path


# ── The options


@dataclass(frozen=True)
class RobotOptions:
    """Options for reading the robot."""

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
    """Body to read from an MJCF scene."""
    model: str | None = None
    """Model to read from an SDF world."""

    def load(self) -> Robot:
        """Load the robot, a bundled one by name or a file by its path."""
        return self._load()[0]

    def load_and_locked(
        self, *, stiff: bool = False, held: Callable[[Model], Iterable[str]] | None = None
    ) -> tuple[Robot, tuple[str, ...]]:
        """Load the robot, and return it with the names of all locked joints, mimic joints included.

        ``stiff`` treats elastic gears as rigid. ``held`` names further joints to lock at neutral.
        """
        return self._load(stiff=stiff, held=held)

    @property
    def files(self) -> dict[str, str | None]:
        """Files read for the robot, by argument; None for bundled files. No output may overwrite them."""
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
        """Neutral positions of joints without a column; empty if all lack one, since the file is then misread."""
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


_MIMIC, _INERTIA = click.Choice(["follow", "independent"]), click.Choice(["error", "accept", "repair"])
_option = partial(click.option, cls=RobotOption)

_ROBOT = option_group(
    _option("--degrees", is_flag=True, help="Angles in files, options and reports are in degrees."),
    _option("--actuators", metavar="FILE.yaml", help="Motors, gears, rotors and friction; 'demo' is bundled."),
    _option(
        "--inertia", type=_INERTIA, default="error", show_default=True, help="What becomes of one no body can have."
    ),
    _option(
        "--mimic", type=_MIMIC, default="follow", show_default=True, help="Whether mimic joints follow their leader."
    ),
    _option("--tip", metavar="FRAME", help="The frame meant where none is named."),
    _option("--model", metavar="NAME", help="Of an SDF world: this model."),
    _option("--keep", metavar="BODY", help="Of an MJCF scene: this body and all that it carries."),
    _option("--chain", nargs=2, metavar="BASE TIP", help="Hold all joints still that are not between these frames."),
    _option(
        "--lock",
        metavar="JOINT=VALUE",
        multiple=True,
        help="Hold a joint still there, or all of '*wheel*'; may be repeated.",
    ),
    _option("--floating-base", is_flag=True, help="Let the base move freely."),
    click.argument("source", metavar="ROBOT"),
)
"""The ROBOT argument and the options shared by all commands."""


def robot_command(name: str, *options: Decorator, examples: Sequence[str], robot_first: bool = False) -> Decorator:
    """A command with ROBOT and the options for reading it, from a function of those and of its own options.

    ROBOT stands before the command's own arguments if ``robot_first``.
    """

    def decorate(function: Callable[[RobotOptions, Given], int | None]) -> click.Command:
        @wraps(function)
        def run(given: Given) -> int | None:
            values = vars(given)
            own = {field.name: values.pop(field.name) for field in fields(RobotOptions)}
            return function(RobotOptions(**{**own, "lock": _parse_locks(own["lock"])}), given)

        order = (*options, _ROBOT) if robot_first else (_ROBOT, *options)
        made: click.Command = command(name, *order, examples_=examples)(run)
        return made

    return decorate


def _parse_locks(texts: Iterable[str]) -> dict[str, float]:
    held: dict[str, float] = {}
    for joint, value in map(_parse_lock, texts):
        if joint in held:
            raise ValueRangeError(f"--lock {joint} is given twice. Keep one of them.")
        held[joint] = value
    return held


def _parse_lock(text: str) -> tuple[str, float]:
    joint, equals, value = text.partition("=")
    try:
        if not equals or not math.isfinite(float(value)):
            raise ValueError  # noqa: TRY301  the same sentence answers all of it
        return joint.strip(), float(value)
    except ValueError:
        raise ValueRangeError(f"lock {text!r} is not JOINT=VALUE, for example gripper=0.02.") from None
