"""A simulation as text: where it ended, how fast it went, its energies, what happened, and why it stopped."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from ..report.coordinates import Coordinates

if TYPE_CHECKING:
    from ..robot import Robot
    from .result import SimulationResult

__all__ = ["simulation_view"]

_MOST = 20
"""Events listed."""


def simulation_view(robot: Robot, result: SimulationResult, *, degrees: bool = False) -> RenderableType:
    """Heading, a row for each coordinate and one for each velocity's peak, energies, events, and the verdict."""
    heading = Text.assemble(
        (result.robot, "bold"),
        f"  ·  {result.method}  ·  {len(result)} states to {result.times[-1]:.6g} s  ·  {result.steps} steps",
        f", {result.rejected} taken again" if result.rejected else "",
    )
    parts: list[RenderableType] = [heading, _coordinates(robot, result, degrees=degrees), _energies(result)]
    parts += [Text(f"· {event}") for event in result.events[:_MOST]]
    if len(result.events) > _MOST:
        parts.append(Text(f"· … {len(result.events)} events in all"))
    parts += [Text.assemble(("! ", "yellow"), remark) for remark in result.remarks]
    parts.append(
        Text.assemble((" STOPPED " if not result.completed else " DONE ", "bold reverse"), f"  {result.stopped}")
    )
    return Group(*parts)


def _coordinates(robot: Robot, result: SimulationResult, *, degrees: bool) -> Table:
    c = Coordinates.of(robot.model)
    angle = "°" if degrees else "rad"
    table = _table(f"Coordinates \\[{angle}, m] and velocities \\[{angle}/s, m/s]")
    for name in ("coordinate", "start", "end", "lowest", "highest"):
        table.add_column(name, justify="left" if name == "coordinate" else "right", no_wrap=True)
    for name in ("velocity", "end", "fastest", "at [s]"):
        table.add_column(name.replace("[", "\\["), justify="left" if name == "velocity" else "right", no_wrap=True)
    rows = max(robot.nq, robot.nv)
    for k in range(rows):
        left, right = [""] * 5, [""] * 4
        if k < robot.nq:
            x = result.q[:, k] * (math.degrees(1.0) if degrees and c.angular[k] else 1.0)
            left = [c.names[k], *map(_number, (x[0], x[-1], x.min(), x.max()))]
        if k < robot.nv:
            v = result.dq[:, k] * (math.degrees(1.0) if degrees and c.angular_velocity[k] else 1.0)
            peak = int(np.abs(v).argmax())
            name = c.velocity_names[k]
            right = [
                name if robot.nq != robot.nv else "",
                _number(v[-1]),
                _number(v[peak]),
                f"{result.times[peak]:.4g}",
            ]
        table.add_row(*(Text(x) for x in (*left, *right)))
    return table


def _energies(result: SimulationResult) -> Table:
    table = _table("Energies \\[J]")
    for name in ("", "start", "end", "largest"):
        table.add_column(name, justify="left" if not name else "right", no_wrap=True)
    rows = {"kinetic": result.kinetic_energy, "potential": result.potential_energy, "both": result.energy}
    rows |= {f"work of {name}": work for name, work in result.work.items() if np.any(work)}
    for name, x in rows.items():
        table.add_row(Text(name), _number(x[0]), _number(x[-1]), _number(x[np.abs(x).argmax()]))
    share = f"{result.relative_drift:.1e} of the kinetic energy"
    table.add_row(
        Text("drift"), "0", f"{result.drift[-1]:.1e}", f"{result.drift[np.abs(result.drift).argmax()]:.1e}, {share}"
    )
    return table


def _table(title: str) -> Table:
    return Table(box=SIMPLE_HEAD, title=title, title_justify="left", title_style="bold", pad_edge=False)


def _number(x: float) -> str:
    return f"{x:.5g}" if abs(x) > 1e-12 else "0"
