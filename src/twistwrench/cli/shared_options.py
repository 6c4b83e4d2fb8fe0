"""Options that several commands take, each with one name, one form and one text; and groups of options."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import click

Decorator: TypeAlias = Callable[[Any], Any]


def option_group(*options: Decorator) -> Decorator:
    """Options as one decorator; a command's help lists them from the last to the first."""

    def decorate(function: Any) -> Any:
        for option in options:
            function = option(function)
        return function

    return decorate


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
