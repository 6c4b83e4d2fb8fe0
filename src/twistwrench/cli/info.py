"""The commands ``twistwrench info`` and ``robots``: contents of a robot, list of named robots."""

from __future__ import annotations

import warnings

import click

from .. import robots
from ..core.errors import ModelWarning
from ..reports.info import RobotReport, info
from ..robots.known_robots import KnownRobots
from .shared import RobotOptions
from .skin import Asked, command_of, table_file


@command_of(
    "info",
    info,
    files=(
        table_file(
            lambda report, path: report.to_csv(path, overwrite=True),
            "Write joints and limits in SI units and radians, for --limits",
        ),
    ),
    examples=("info panda", "info ur5 --json -"),
)
def info_command(robot: RobotOptions, asked: Asked) -> RobotReport:
    """Show joints, limits, inertias, masses, frames and the tree of a robot."""
    with warnings.catch_warnings(record=True) as notes:
        warnings.simplefilter("always", ModelWarning)
        loaded = robot.load()
    for note in notes:  # notes of the model are printed below its tree
        if not any(defect in str(note.message) for defect in loaded.defects):
            warnings.warn_explicit(note.message, note.category, note.filename, note.lineno)
    return info(loaded, **asked)


# ── ``robots``: bundled robots, and those of other packages


@command_of(
    "robots",
    robots.known,
    click.argument("word", default=""),
    with_robot=False,
    left_out=("word",),
    examples=("robots", "robots panda"),
)
def robots_command(word: str) -> KnownRobots:
    """List the robots known by name, bundled or from installed packages; WORD selects names and descriptions."""
    return robots.known(word)
