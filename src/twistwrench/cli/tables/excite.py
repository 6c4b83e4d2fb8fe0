"""What ``twistwrench excite`` prints: how sure a log of the motion will make the numbers, and what it asks of each joint."""

from __future__ import annotations

import math

import numpy as np
from rich.console import Group, RenderableType
from rich.text import Text

from ...core.printed_numbers import number, percent_of_limit
from ...identification import ExcitingMotion
from ...joints.units import heading_unit
from ...motion.coordinates import Coordinates
from .plain_table import PlainTable, verdict_word


def excitation_view(found: ExcitingMotion, *, degrees: bool) -> RenderableType:
    """The verdict, heading, a row per joint, and a row per group."""
    deviations = found.predicted_deviations
    return Group(
        *_verdict(found),
        Text(),
        Text.assemble(
            (found.robot.name, "bold"),
            f"  ·  {number(found.duration)} s, {found.series.harmonics} harmonics, at rest at both ends  ·  condition "
            f"{number(found.condition)}  ·  log det {number(found.log_det)}  ·  median deviation "
            f"{number(np.median(deviations), 2)}",
        ),
        _joints(found, degrees=degrees),
        _groups(found),
    )


def _verdict(found: ExcitingMotion) -> list[Text]:
    """The first word, with the least distances or what makes it unsure, a line each."""
    words = {"itself": "of capsules around links from each other", "floor": "from the floor"}
    least = [f"{number(1000.0 * value)} mm {words[name]}" for name, value in found.clearances.items()]
    distances = f"least distances: {', '.join(least)}" if least else "nothing can touch"
    reasons = found.verdict.reasons or (distances,)
    lines = [Text.assemble(verdict_word(found.verdict.word), f": {reasons[0]}.")]
    lines += [Text(f"  - {reason}.") for reason in reasons[1:]]
    return lines + ([Text(f"{distances[0].upper()}{distances[1:]}.")] if found.verdict.reasons and least else [])


def _joints(found: ExcitingMotion, *, degrees: bool) -> PlainTable:
    robot, peaks = found.robot, found.peaks
    turning = Coordinates.of(robot.model).angular_velocity
    unit = np.where(turning & degrees, math.degrees(1.0), 1.0)
    place, speed, rate, torque = (heading_unit(part, turning, degrees=degrees) for part in ("q", "dq", "ddq", "tau"))
    table = PlainTable()
    table.words("joint", fold=False)
    table.numbers(f"from [{place}]", "to", f"peak [{speed}]", "share", f"[{rate}]", f"[{torque}]", "share")
    shares = [
        [
            percent_of_limit(v / m if math.isfinite(m) and m > 0 else None)
            for v, m in zip(peaks[part], limits, strict=True)
        ]
        for part, limits in (("velocity", robot.limits.velocity), ("torque", robot.limits.effort))
    ]
    for k, name in enumerate(robot.model.velocity_names):
        lower, upper, velocity, acceleration = (
            peaks[part][k] * unit[k] for part in ("lower", "upper", "velocity", "acceleration")
        )
        table.row(name, lower, upper, velocity, shares[0][k], acceleration, peaks["torque"][k], shares[1][k])
    return table


def _groups(found: ExcitingMotion) -> PlainTable:
    base = found.information.base
    table = PlainTable(f"{base.count} groups of parameters, and how sure a log of the motion makes them")
    table.words("group")
    table.numbers("file", "deviation")
    file = base.project(base.unknown.file_values)
    for name, deviation, value in zip(found.groups, found.predicted_deviations, file, strict=True):
        table.row(name, value, number(deviation, 2))
    return table
