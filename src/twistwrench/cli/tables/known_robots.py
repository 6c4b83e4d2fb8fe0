"""Robots by name, as tables: the bundled ones with what they are, those of other packages with their files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from ... import robots
from ...errors import UnknownNameError
from ...robots.finding import FoundRobot, known_robots, plain_name
from .plain_table import PlainTable

_BUNDLED = "twistwrench"


def robot_tables(word: str = "") -> Iterator[PlainTable]:
    """The bundled robots that have ``word`` in their name or description, and the others that have it in their name.

    Raises
    ------
    UnknownNameError
        If there is none; the message lists names.
    """
    described = {name: (getattr(robots, name).__doc__ or "").strip().split("\n")[0] for name in robots.names()}
    chosen = [name for name, text in described.items() if word.lower() in f"{name} {text}".lower()]
    known = known_robots()
    others: dict[str, list[FoundRobot]] = {}
    for name, robot in sorted(known.items()):
        if robot.source != _BUNDLED and plain_name(word) in name:
            others.setdefault(robot.source, []).append(robot)
    if not chosen and not others:
        raise UnknownNameError.of("robot", word, known)
    if chosen:
        yield _bundled(chosen, described)
    for source, found in others.items():
        yield _others(source, found)


def _bundled(chosen: list[str], described: Mapping[str, str]) -> PlainTable:
    table = PlainTable()
    table.words("robot", fold=False, style="bold")
    table.numbers("q", "dq", "kg")
    table.words("what it is")
    for name in chosen:
        robot = getattr(robots, name)()
        mass = sum(body.inertia.mass for body in robot.model.bodies)
        table.row(name, robot.nq, robot.nv, mass, described[name].partition("; options as")[0].replace("``", ""))
    return table


def _others(source: str, found: list[FoundRobot]) -> PlainTable:
    """One row a file, whatever it is called."""
    table = PlainTable()
    table.words(f"of {source}", fold=False, style="bold")
    table.words("file")
    by_file: dict[str, list[str]] = {}
    for robot in found:
        by_file.setdefault("/".join(robot.path.parts[-3:]), []).append(robot.name)
    for file, called in by_file.items():
        table.row(", ".join(called), file)
    return table
