"""Options that several commands share: groups, the motion with its columns, and known parameters."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..errors import UnknownNameError, ValueRangeError
from ..joints.units import units_of
from .robot_options import RobotOptions, bundled
from .usage import Decorator, option_group

if TYPE_CHECKING:
    from ..model.model import Model
    from ..motion.motion import Motion
    from ..motion.motion_log import MotionLog
    from ..robot import Robot

LIMITS = click.option(
    "--limits",
    "limits_path",
    metavar="FILE.csv",
    help="Limits in place of the robot's: joint,lower,upper,velocity,effort.",
)
PAYLOADS = click.option(
    "--payload",
    "payloads",
    metavar="MASS[,x,y,z][@FRAME]",
    multiple=True,
    help="A point mass carried, such as the gripper; may be repeated.",
)
WRENCHES = click.option(
    "--wrench-on-robot",
    "wrenches",
    metavar="FRAME:m,m,m,f,f,f",
    multiple=True,
    help="What the world does to it there.",
)
NO_FRICTION = click.option("--no-friction", is_flag=True, help="Leave joint friction and damping out.")
CONFIGURATION = click.option(
    "--configuration", metavar="v,v,…|NAME", help="All coordinates at once, or a configuration of the file by its name."
)
AT = click.option(
    "--at",
    metavar="JOINT=VALUE|v,v,…",
    multiple=True,
    help="A joint's place, others at zero or as --configuration says, or all coordinates; may be repeated.",
)
COLUMNS = click.option(
    "--columns",
    metavar="JOINT=COLUMN",
    multiple=True,
    help="Which column is which: elbow=pos3, elbow.vel=w3, elbow.tau=i3, time=stamp; may be repeated.",
)
RATE = click.option("--rate", type=float, metavar="HZ", help="Rows a second, where the log has no column of time.")
LOCK_MISSING = click.option(
    "--lock-missing", is_flag=True, help="Hold joints still, at neutral, that the log has no column for."
)
FRICTION_LAWS = click.option(
    "--friction",
    metavar="LAWS",
    default="viscous,coulomb,offset",
    show_default=True,
    help="What each joint has besides its bodies: viscous, coulomb, stribeck, offset; 'none' for nothing.",
)
NO_MOTOR_INERTIA = click.option(
    "--no-motor-inertia", is_flag=True, help="Joints have no motor's inertia besides their bodies."
)


def parse_friction(text: str) -> tuple[str, ...]:
    """Laws of friction, ``viscous,coulomb``; ``none`` is none of them.

    >>> parse_friction("viscous, offset"), parse_friction("none")
    (('viscous', 'offset'), ())
    """
    return () if text.strip() == "none" else tuple(name.strip() for name in text.split(","))


# ── The motion: its options, its robot and its file

Load = Callable[..., "tuple[Robot, tuple[str, ...]]"]
"""Function that loads the robot and returns it with its locked joints. ``stiff`` treats elastic gears as rigid; ``held`` names
further joints to lock at neutral."""


def motion_options(*, required: bool) -> Decorator:
    """Options for the file of a motion and how it is read."""
    return option_group(
        click.option(
            "--smooth", is_flag=True, help="Smooth a noisy log, as much as its noise asks, before deriving from it."
        ),
        LOCK_MISSING,
        RATE,
        COLUMNS,
        click.option(
            "--trajectory",
            metavar="FILE.csv",
            required=required,
            help="The motion; 'demo' is the one bundled with a robot.",
        ),
    )


def loaded_motion_options(*, required: bool) -> Decorator:
    """Options for the motion, its payloads and its wrenches."""
    return option_group(NO_FRICTION, WRENCHES, PAYLOADS, motion_options(required=required))


def open_motion(
    load: Load, path: Path, *, degrees: bool, columns: Iterable[str], rate: float | None, lock_missing: bool
) -> tuple[Robot, MotionLog]:
    """Load the robot and open its motion; raises the errors of :meth:`MotionLog.open`."""
    from ..motion.motion_file import joints_without_column, moves_motors, open_motion_file
    from ..motion.motion_log import MotionLog

    told = parse_columns(columns)
    file = open_motion_file(path)
    missing: list[str] = []

    def held(model: Model) -> list[str]:
        missing[:] = joints_without_column(file, model, columns=told)
        return missing

    options: dict[str, Any] = {"stiff": not moves_motors(file)} | ({"held": held} if lock_missing else {})
    robot, locked = load(**options)
    still = [name for name in missing if name in locked]
    return robot, MotionLog.open(file, robot.model, degrees=degrees, locked=locked, columns=told, rate=rate, held=still)


def refuse_motor_side(options: RobotOptions, robot: Robot, command: str) -> None:
    """Raise ValueRangeError if the actuator file declares logs of motor positions; only joint positions are read."""
    from ..formats.actuators import read_log_side

    if options.actuators is None:
        return
    source = bundled(options.actuators, options.source, ".yaml", "actuator file")
    if read_log_side(robot.model, source).of_motors:
        raise ValueRangeError(
            f"{source} says that logs have the motors' positions (log: side: motor), and {command} reads those of the joints. "
            "Write them first: tw.identification.read_motion(log, robot, side=tw.identification.motor_side(robot.model, "
            "file)).to_csv(path); twistwrench identify reads either."
        )


def parse_columns(texts: Iterable[str]) -> dict[str, str]:
    """Read ``JOINT=COLUMN`` each; raises :class:`~twistwrench.ValueRangeError`, which shows the form.

    >>> parse_columns(["elbow=pos3", "time=Time [ms]"])
    {'elbow': 'pos3', 'time': 'Time [ms]'}
    """
    found: dict[str, str] = {}
    for text in texts:
        name, equals, column = (part.strip() for part in text.partition("="))
        if not equals or not name or not column:
            raise ValueRangeError(f"--columns {text!r} is not JOINT=COLUMN, for example elbow=pos3 or elbow.vel=w3.")
        if name in found:
            raise ValueRangeError(f"--columns says twice what {name!r} is. Keep one of them.")
        found[name] = column
    return found


def with_torques(path: str, motion: Motion) -> Motion:
    """Return the motion if it has torques; otherwise raise ValueRangeError."""
    if motion.tau is None:
        raise ValueRangeError(
            f"{path}: no torque for every joint. Name the columns JOINT.torque, or say which they are, --columns "
            f"'{motion.robot.model.velocity_names[0]}.tau=COLUMN'."
        )
    return motion


# ── Known values of parameters, ``--known``

_UNITS = {
    "m": ("kg",),
    **dict.fromkeys(("mcx", "mcy", "mcz"), ("kg m",)),
    **dict.fromkeys(("Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz"), ("kg m^2",)),
    "motor_inertia": ("kg m^2", "kg"),
    "viscous": ("N m s/rad", "N s/m"),
    **dict.fromkeys(("coulomb", "stribeck", "offset"), units_of("tau", (True, False))),
}
"""SI units of each kind of parameter: that of turning joints first."""


def parse_known(texts: Sequence[str]) -> dict[str, float]:
    """Values by the names of parameters; ``.mass`` is ``.m``. Raises ValueRangeError.

    >>> parse_known(["link_3.mass=0.73 kg", "joint_2.viscous=1.2"])
    {'link_3.m': 0.73, 'joint_2.viscous': 1.2}
    """
    found = dict[str, float]()
    for text in texts:
        name, equal, value = (part.strip() for part in text.rpartition("="))
        owner, _, kind = name.rpartition(".")
        kind = {"mass": "m"}.get(kind, kind)
        number, _, unit = value.partition(" ")
        allowed = _UNITS.get(kind)
        if equal and owner and allowed is None:
            raise UnknownNameError(f"--known {text!r}: {UnknownNameError.from_choices('parameter', kind, _UNITS)}")
        try:
            if not equal or not owner or allowed is None:
                raise ValueError  # noqa: TRY301  the same sentence answers all of it
            found[f"{owner}.{kind}"] = float(number)
        except ValueError:
            raise ValueRangeError(
                f"--known {text!r} is not NAME=VALUE, for example link_3.m=0.73. Links and joints have: "
                f"{', '.join(_UNITS)}."
            ) from None
        if unit and unit.strip() not in allowed:
            raise ValueRangeError(f"--known {text!r}: the unit {unit.strip()!r} is not {' or '.join(allowed)}.")
    return found


def check_payload(frame: str | None, outputs: Sequence[str]) -> None:
    """Raise ValueRangeError if an output is requested that a payload alone does not have."""
    refused = [name for name in outputs if name not in ("--json", "--csv")]
    if frame is not None and refused:
        raise ValueRangeError(f"{refused[0]} with --payload-only: a payload is no robot. --json writes it.")
