"""A simulation as text: why it stopped, where it ended, how fast it went, its energies, and what happened."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from rich.console import Group, RenderableType
from rich.text import Text

from ...core.printed_numbers import number, residual, seconds
from ...joints.units import heading_unit
from ...motion.bounds import bounds_of
from ...motion.coordinates import Coordinates
from ...motion.violations import LimitCheck
from ...typing import Array
from .plain_table import PlainTable, friction_words, remarks

if TYPE_CHECKING:
    from ...robot import Robot
    from ...simulation.result import SimulationResult

_MOST = 20
"""Events listed."""
_ROUNDING = 12
"""Decimals below which a coordinate, a velocity or an energy is zero."""


def simulation_view(
    robot: Robot, result: SimulationResult, *, degrees: bool = False, friction: bool = True
) -> RenderableType:
    """The verdict with what was not simulated, then rows for coordinates, velocities and energies, accuracy and events."""
    c = Coordinates.of(robot.model)
    word = ("DONE", "bold") if result.completed else ("STOPPED", "bold red")
    verdict = [
        Text.assemble(word, f": {result.stopped}."),
        *remarks(_limits_passed(robot, result)),
        Text(),
    ]
    heading = Text.assemble(
        (result.robot, "bold"),
        f"  ·  {result.method}  ·  {len(result)} states to {number(result.times[-1], 6)} s  ·  {result.steps} steps",
        f", {result.rejected} taken again" if result.rejected else "",
        f"  ·  {friction_words(robot.model, counted=friction)}",
    )
    parts: list[RenderableType] = [*verdict, heading, _coordinates(result, c, degrees=degrees)]
    parts += [_velocities(result, c, degrees=degrees), _energies(result), _accuracy(result)]
    parts += [Text(f"· {event}") for event in result.events[:_MOST]]
    if len(result.events) > _MOST:
        parts.append(Text(f"· … {len(result.events)} events in all"))
    return Group(*parts, *remarks(result.remarks))


_PASSED = {
    "position": ("Joints were not held at their limits", "--stop-at-limits ends where the first is reached."),
    "torque": (
        "The torques given are more than the motors have",
        "Give less, or raise the efforts in the robot's file.",
    ),
    "velocity": ("Joints are faster than their limits", "The robot's own drives would not let them."),
}
"""Of each kind of limit that a simulation does not keep: what it means that one is passed, and what to do."""


def _limits_passed(robot: Robot, result: SimulationResult) -> list[str]:
    """A sentence for each kind of limit that the states or the torques given pass."""
    check, said = LimitCheck(robot.model, bounds_of(robot)), []
    check.add(result.times, result.q, result.dq, None, result.tau)
    passed = check.violations()
    for kind, (meaning, remedy) in _PASSED.items():
        mine = [violation for violation in passed if violation.kind == kind]
        if not mine:
            continue
        more = len(mine) - 1
        others = f", and {more} more joint{'s pass' if more > 1 else ' passes'} theirs" if more else ""
        said.append(f"{meaning}: {mine[0]}{others}. {remedy}")
    return said


def _coordinates(result: SimulationResult, c: Coordinates, *, degrees: bool) -> PlainTable:
    table = PlainTable(f"Coordinates [{heading_unit('q', (True, False), degrees=degrees)}]")
    table.words("coordinate")
    table.numbers("start", "end", "lowest", "highest")
    for name, x, angular in zip(c.names, result.q.T, c.angular, strict=True):
        unit = math.degrees(1.0) if degrees and angular else 1.0
        table.row(name, *_cells(unit * np.array([x[0], x[-1], x.min(), x.max()])))
    return table


def _velocities(result: SimulationResult, c: Coordinates, *, degrees: bool) -> PlainTable:
    table = PlainTable(f"Velocities [{heading_unit('dq', (True, False), degrees=degrees)}]")
    table.words("velocity")
    table.numbers("start", "end", "fastest", "at [s]")
    for name, v, angular in zip(c.velocity_names, result.dq.T, c.angular_velocity, strict=True):
        unit, peak = math.degrees(1.0) if degrees and angular else 1.0, int(np.abs(v).argmax())
        table.row(name, *_cells(unit * v[[0, -1, peak]]), seconds(result.times[peak]))
    return table


def _energies(result: SimulationResult) -> PlainTable:
    table = PlainTable("Energies [J]")
    table.words("")
    table.numbers("start", "end", "largest")
    rows = {"kinetic": result.kinetic_energy, "potential": result.potential_energy, "both": result.energy}
    rows |= {f"work of {name}": work for name, work in result.work.items() if np.any(work)}
    for name, x in rows.items():
        table.row(name, *_cells(x[[0, -1, int(np.abs(x).argmax())]]))
    drift = result.drift
    table.row("drift", "0", residual(drift[-1]), residual(drift[np.abs(drift).argmax()]))
    return table


def _accuracy(result: SimulationResult) -> Text:
    """The drift and the error, each against what moved."""
    said = f"drift {residual(result.relative_drift)} of the energy that moved"
    if np.isfinite(result.relative_error):
        said += f"; error of the steps {residual(result.relative_error)} of the motion"
    return Text(said)


def _cells(values: Array) -> list[str]:
    return [number(x, decimals=_ROUNDING) for x in values]
