"""A simulation as text: where it ended, how fast it went, its energies, what happened, and why it stopped."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from ...motion.coordinates import Coordinates

if TYPE_CHECKING:
    from ...robot import Robot
    from ...simulation.result import SimulationResult

_MOST = 20
"""Events listed."""


def simulation_view(robot: Robot, result: SimulationResult, *, degrees: bool = False) -> RenderableType:
    """Heading, a row for each coordinate and for each velocity, energies, how exact it is, events, and the verdict."""
    c = Coordinates.of(robot.model)
    heading = Text.assemble(
        (result.robot, "bold"),
        f"  ·  {result.method}  ·  {len(result)} states to {result.times[-1]:.6g} s  ·  {result.steps} steps",
        f", {result.rejected} taken again" if result.rejected else "",
    )
    parts: list[RenderableType] = [heading, _coordinates(result, c, degrees=degrees)]
    parts += [_velocities(result, c, degrees=degrees), _energies(result), _accuracy(result)]
    parts += [Text(f"· {event}") for event in result.events[:_MOST]]
    if len(result.events) > _MOST:
        parts.append(Text(f"· … {len(result.events)} events in all"))
    parts += [Text.assemble(("! ", "yellow"), remark) for remark in result.remarks]
    parts.append(
        Text.assemble((" STOPPED " if not result.completed else " DONE ", "bold reverse"), f"  {result.stopped}")
    )
    return Group(*parts)


def _coordinates(result: SimulationResult, c: Coordinates, *, degrees: bool) -> Table:
    table = _table(f"Coordinates \\[{'°' if degrees else 'rad'}, m]", "coordinate", "start", "end", "lowest", "highest")
    for name, x, angular in zip(c.names, result.q.T, c.angular, strict=True):
        unit = math.degrees(1.0) if degrees and angular else 1.0
        table.add_row(Text(name), *(_number(unit * v) for v in (x[0], x[-1], x.min(), x.max())))
    return table


def _velocities(result: SimulationResult, c: Coordinates, *, degrees: bool) -> Table:
    table = _table(
        f"Velocities \\[{'°' if degrees else 'rad'}/s, m/s]", "velocity", "start", "end", "fastest", "at \\[s]"
    )
    for name, v, angular in zip(c.velocity_names, result.dq.T, c.angular_velocity, strict=True):
        unit, peak = math.degrees(1.0) if degrees and angular else 1.0, int(np.abs(v).argmax())
        row = (unit * v[0], unit * v[-1], unit * v[peak])
        table.add_row(Text(name), *map(_number, row), f"{result.times[peak]:.4g}")
    return table


def _energies(result: SimulationResult) -> Table:
    table = _table("Energies \\[J]", "", "start", "end", "largest")
    rows = {"kinetic": result.kinetic_energy, "potential": result.potential_energy, "both": result.energy}
    rows |= {f"work of {name}": work for name, work in result.work.items() if np.any(work)}
    for name, x in rows.items():
        table.add_row(Text(name), _number(x[0]), _number(x[-1]), _number(x[np.abs(x).argmax()]))
    drift = result.drift
    table.add_row(Text("drift"), "0", f"{drift[-1]:.1e}", f"{drift[np.abs(drift).argmax()]:.1e}")
    return table


def _accuracy(result: SimulationResult) -> Text:
    """The drift and the error, each against what moved."""
    said = f"drift {result.relative_drift:.1e} of the energy that moved"
    if np.isfinite(result.relative_error):
        said += f"; error of the steps {result.relative_error:.1e} of the motion"
    return Text(said)


def _table(title: str, name: str, *numbers: str) -> Table:
    """A column of names, which fold where there is no room, and columns of numbers, which are never cut."""
    table = Table(box=SIMPLE_HEAD, title=title, title_justify="left", title_style="bold", pad_edge=False)
    table.add_column(name, overflow="fold")
    for heading in numbers:
        table.add_column(heading, justify="right", no_wrap=True)
    return table


def _number(x: float) -> str:
    return f"{x:.5g}" if abs(x) > 1e-12 else "0"
