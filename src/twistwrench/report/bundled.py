"""The bundled robots as a table."""

from __future__ import annotations

from rich.box import SIMPLE_HEAD
from rich.table import Table

from .. import robots
from ..errors import UnknownNameError

__all__ = ["bundled_table"]


def bundled_table(word: str = "") -> Table:
    """Name, joints, moving mass and a description of every bundled robot that has ``word`` in its name or description.

    Raises
    ------
    UnknownNameError
        If there is none; the message lists all names.
    """
    described = {name: (getattr(robots, name).__doc__ or "").strip().split("\n")[0] for name in robots.names()}
    chosen = [name for name, text in described.items() if word.lower() in f"{name} {text}".lower()]
    if not chosen:
        raise UnknownNameError.of("bundled robot", word, robots.names())
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    table.add_column("robot", no_wrap=True, style="bold")
    for head in ("q", "dq", "kg"):
        table.add_column(head, justify="right", no_wrap=True)
    table.add_column("what it is")
    for name in chosen:
        robot = getattr(robots, name)()
        mass = sum(body.inertia.mass for body in robot.model.bodies)
        table.add_row(name, str(robot.nq), str(robot.nv), f"{mass:.4g}", described[name].partition("; options as")[0])
    return table
