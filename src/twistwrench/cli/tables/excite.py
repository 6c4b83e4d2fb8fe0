"""What ``twistwrench excite`` prints: how sure a log of the motion will make the numbers, and what it asks of each joint."""

from __future__ import annotations

import math

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from ...identification import ExcitingMotion
from ...motion.coordinates import Coordinates
from ...typing import Array
from .style import title_line


def excitation_view(found: ExcitingMotion, *, degrees: bool) -> RenderableType:
    """Heading, a row per joint, a row per group, and what was not looked at."""
    deviations = found.predicted_deviations
    return Group(
        Text.assemble(
            (found.robot.name, "bold"),
            f"  ·  {found.duration:g} s, {found.series.harmonics} harmonics, at rest at both ends  ·  condition "
            f"{found.condition:.4g}  ·  log det {found.log_det:.4g}  ·  median deviation {np.median(deviations):.3g}",
        ),
        _joints(found, degrees=degrees),
        _groups(found),
        *_clearances(found),
    )


def _clearances(found: ExcitingMotion) -> list[Text]:
    """How far it stays from things, and what was not looked at."""
    words = {"itself": "of capsules around links from each other", "floor": "from the floor"}
    said = [f"{1000.0 * value:.3g} mm {words[name]}" for name, value in found.clearances.items()]
    lines = [Text(f"least distances: {', '.join(said)}")] if said else []
    if "itself" not in found.clearances:
        lines.append(Text("! Whether links touch each other was not looked at: twistwrench view shows the motion."))
    return lines + [Text(f"! not looked at: {sentence}.") for sentence in found.unwatched]


def _joints(found: ExcitingMotion, *, degrees: bool) -> Table:
    robot, peaks = found.robot, found.peaks
    turning = Coordinates.of(robot.model).angular_velocity
    unit = np.where(turning & degrees, math.degrees(1.0), 1.0)
    angle = ("°" if degrees else "rad") + ("" if turning.all() else ", m")
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    table.add_column("joint", no_wrap=True)
    torque = "N m" if turning.all() else "N m, N"
    for name in (
        f"from \\[{angle}]",
        "to",
        f"peak \\[{angle}/s]",
        "share",
        f"\\[{angle}/s²]",
        f"\\[{torque}]",
        "share",
    ):
        table.add_column(name, justify="right", no_wrap=True)
    speed, effort = (
        _share(peaks[k], x) for k, x in (("velocity", robot.limits.velocity), ("torque", robot.limits.effort))
    )
    for k, name in enumerate(robot.model.velocity_names):
        ends, rates = (
            [f"{float(peaks[key][k] * unit[k]):.4g}" for key in keys]
            for keys in (("lower", "upper"), ("velocity", "acceleration"))
        )
        table.add_row(Text(name), *ends, rates[0], speed[k], rates[1], f"{float(peaks['torque'][k]):.4g}", effort[k])
    return table


def _share(values: Array, limits: Array) -> list[str]:
    """Of the robot's own limits."""
    return [f"{100 * v / m:.0f} %" if math.isfinite(m) and m > 0 else "–" for v, m in zip(values, limits, strict=True)]


def _groups(found: ExcitingMotion) -> Table:
    base = found.information.base
    table = Table(
        box=SIMPLE_HEAD,
        title=title_line(f"{base.count} groups of parameters, and how sure a log of the motion makes them"),
        title_justify="left",
        pad_edge=False,
    )
    table.add_column("group", overflow="fold")
    for name in ("deviation", "file"):
        table.add_column(name, justify="right", no_wrap=True)
    file = base.project(base.unknown.file_values)
    for name, deviation, value in zip(found.groups, found.predicted_deviations, file, strict=True):
        table.add_row(Text(name), f"{deviation:.3g}", f"{value:.4g}")
    return table
