"""The commands ``twistwrench info`` and ``robots``: contents of a robot, list of named robots."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping

import click

from .. import robots
from ..answers.blocks import Table, numbers, words
from ..core.colours import Style
from ..core.errors import ModelWarning, UnknownNameError
from ..reports.info import RobotReport, info
from ..robots.finding import FoundRobot, known_robots, plain_name
from .main import plain_command
from .shared import RobotOptions
from .skin import Asked, command_of, table_file
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


@plain_command("robots", click.argument("word", default=""), examples=("robots", "robots panda"))
def robots_command(word: str) -> None:
    """List the robots known by name, bundled or from installed packages; WORD selects names and descriptions."""
    show(*robot_tables(word))


_BUNDLED = "twistwrench"


def robot_tables(word: str = "") -> Iterator[Table]:
    """Tables of bundled robots with ``word`` in name or description, and of other robots with it in the name."""
    described = {name: (getattr(robots, name).__doc__ or "").strip().split("\n")[0] for name in robots.names()}
    chosen = [name for name, text in described.items() if word.lower() in f"{name} {text}".lower()]
    known = known_robots()
    others: dict[str, list[FoundRobot]] = {}
    for name, robot in sorted(known.items()):
        if robot.source != _BUNDLED and plain_name(word) in name:
            others.setdefault(robot.source, []).append(robot)
    if not chosen and not others:
        raise UnknownNameError.from_choices("robot", word, known)
    if chosen:
        yield _bundled(chosen, described)
    for source, found in others.items():
        yield _others(source, found)


def _bundled(chosen: list[str], described: Mapping[str, str]) -> Table:
    models = [getattr(robots, name)().model for name in chosen]
    return Table(
        "",
        words("robot", chosen, fold=False, style=Style.STRONG),
        numbers("q", [model.nq for model in models]),
        numbers("dq", [model.nv for model in models]),
        numbers("kg", [model.moving_mass for model in models]),
        words("what it is", [described[name].partition("; options as")[0].replace("``", "") for name in chosen]),
    )


def _others(source: str, found: list[FoundRobot]) -> Table:
    """Table with one row per file."""
    by_file: dict[str, list[str]] = {}
    for robot in found:
        by_file.setdefault("/".join(robot.path.parts[-3:]), []).append(robot.name)
    names = [", ".join(called) for called in by_file.values()]
    return Table("", words(f"of {source}", names, fold=False, style=Style.STRONG), words("file", by_file))
