"""The commands ``twistwrench info`` and ``robots``: contents of a robot, list of named robots."""

from __future__ import annotations

import warnings

import click

from .. import robots
from ..core.errors import ModelWarning
from ..reports.info import RobotReport, info
from .main import plain_command
from .shared import RobotOptions
from .skin import ALL, Asked, command_of, table_file
from .terminal import show


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


@plain_command("robots", click.argument("word", default=""), ALL, examples=("robots", "robots panda"))
def robots_command(word: str, whole_report: bool) -> None:  # noqa: ARG001  read by :func:`.terminal.show`
    """List the robots known by name, bundled or from installed packages; WORD selects names and descriptions."""
    show(*robots.known(word).blocks())
