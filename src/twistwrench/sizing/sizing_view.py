"""Sizing as blocks: verdict, drives with their figures, supply and remarks."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from ..core.answers.blocks import (
    Block,
    Column,
    Headline,
    Line,
    Remark,
    Table,
    mark_style,
    numbers,
    remarks,
    share_cell,
    words,
)
from ..core.answers.page import MarkedJoint
from ..core.colours import Style
from ..core.numbers import number, over_limit, percent_of_limit, quantity, seconds
from ..core.typing import Array
from ..core.verdict import Verdict, Word
from ..motion.credible_values import placeholder_limits
from ..reports.motors import Demand
from ..reports.torque_verdict import notes_on_log
from .catalog import DIRECT
from .choice import SizedJoint, Sizing, drive_name, smallest_drives

_DIGITS = 3


def sizing_view(sizing: Sizing) -> Iterator[Block]:
    """Verdict, selected products, drives with their figures, supply and remarks; only the verdict of a log to look at again."""
    verdict = sizing.verdict
    if verdict.word is Word.LOOK_AGAIN:
        yield from _verdict_blocks(verdict)
        yield from _notes(sizing)
        return
    if verdict.word is Word.OK:
        closest = max(sizing.joints.values(), key=lambda joint: joint.tightest[1].share)
        part, demand = closest.tightest
        yield Headline(Word.OK, f"all ratings kept. Closest: {closest.joint}, {part}: {demand.words}.")
    else:
        yield from _verdict_blocks(verdict)
    if not sizing.choice and verdict.word is Word.OVER_LIMIT:
        for sentence in smallest_drives(sizing, sizing.choose()):
            yield Line(sentence, indent=2)
    yield ""
    if sizing.joints:
        yield drives_table(sizing, sizing.problem.ambient)
    for joint, chosen in sizing.choice.items():
        if chosen.smaller is not None:
            pair, reason = chosen.smaller
            yield f"{joint}: the next smaller ({drive_name(pair)}) fails: {reason.removeprefix(f'{joint}, ')}."
    supply = sizing.supply
    yield Line(
        f"Supply: peak {quantity(supply.peak, 'W')}, mean {quantity(supply.mean, 'W')}; a cycle draws "
        f"{quantity(supply.drawn, 'J')} and returns {quantity(supply.braked, 'J')}. Drives {quantity(sizing.mass, 'kg')}."
    )
    if sizing.left_out:
        yield Line((f"Not sized, for it does not turn or has no drive: {', '.join(sizing.left_out)}.", Style.QUIET))
    yield Line(("Electronics, iron losses and bearing moments of gears are not counted.", Style.QUIET))
    yield from _notes(sizing)


def _verdict_blocks(verdict: Verdict) -> Iterator[Headline | Remark]:
    first, *others = verdict.reasons or ("",)
    yield Headline(verdict.word, f"{first}.")
    yield from remarks(f"{reason}." for reason in others)


def _notes(sizing: Sizing) -> Iterator[Remark]:
    """Remarks on the payload, on the log, and on torque limits of the robot's file that are probably not those of motors."""
    report = sizing.report
    if report is None:
        return
    yield from remarks([*report.load.unit_hints, *notes_on_log(report)])
    limits = placeholder_limits(report.load.robot, report.limits)
    if limits:
        yield from remarks([f"The robot's file has {limits}. Drives are judged by their ratings, not by these."])


_NAME = 9
"""Least width of a joint's name in narrow terminals; names are folded at their separators."""
_CURRENT = 4
"""Decimals of a current; smaller ones are rounding errors of joints at rest."""


def drives_table(sizing: Sizing, ambient: float) -> Table:
    """Table with one row per joint; limits are shown behind the values."""
    joints = list(sizing.joints.values())
    names = [j.joint for j in joints]
    motors, gears = [j.drive[0] for j in joints], [j.drive[1] for j in joints]
    currents = [j.motor.rms_current for j in joints]
    shares = [j.tightest[1].share for j in joints]
    return Table(
        f"Drives at {number(ambient)} degC",
        words("joint", names, fold=False, narrow=replace(words("joint", names), min_width=_NAME)),
        words("motor", motors),
        words("gear", gears) if set(gears) - {DIRECT} else None,
        _demand_column("mean", joints, "average torque", "N m"),
        _demand_column("peak", joints, "peak torque", "N m"),
        _demand_column("input", joints, "input speed", "rpm"),
        numbers("rms", currents, partial(number, digits=_DIGITS, decimals=_CURRENT), "A"),
        numbers("winding", map(_largest_temperature, joints), _figure, "degC"),
        numbers("J ratio", [j.motor.inertia_ratio for j in joints], _figure),
        numbers("used", shares, share_cell),
        most=12,
        by=shares,
    )


def _largest_temperature(joint: SizedJoint) -> float:
    """Largest temperature of the winding [°C]; nan without thermal data."""
    temperature = joint.motor.temperature
    if not temperature.size:
        return math.nan
    return float(temperature[:, 0].max())


def _figure(value: float) -> str:
    return number(value, _DIGITS)


def _demand_column(name: str, joints: Sequence[SizedJoint], what: str, unit: str) -> Column:
    """Column of a gear figure with its limits, which stand below it in narrow terminals; exceeded limits are red."""
    demands = [_gear_demand(joint, what) for joint in joints]
    limits = [math.inf if demand is None else demand.limit for demand in demands]
    column = numbers(name, map(_cell, demands), unit=unit, limits=limits)
    return replace(column, narrow=numbers(name, map(partial(_cell, between="\n/ "), demands), unit=unit, limits=limits))


def _gear_demand(joint: SizedJoint, what: str) -> Demand | None:
    for demand in joint.gear.demands:
        if demand.what == what:
            return demand
    return None


def _cell(demand: Demand | None, between: str = " / ") -> Line | str:
    if demand is None:
        return number(None)
    limit = ""
    if math.isfinite(demand.limit):
        limit = f"{between}{_figure(demand.limit)}"
    red = Style.OVER if over_limit(demand.share) else ""
    return Line((_figure(demand.value), red), (limit, Style.QUIET), value=demand.value)


def worst_moment(sizing: Sizing) -> tuple[Array, MarkedJoint | None, str]:
    """Configuration in which a drive is nearest to a rating, its joint, and a title."""
    cycle = sizing.motion
    assert cycle is not None
    name, start = cycle.robot.name, "at the beginning of the motion"
    if not sizing.joints:
        return cycle.q[0], None, f"{name} {start}"
    joint = max(sizing.joints.values(), key=lambda j: j.tightest[1].share)
    demand = joint.tightest[1]
    label = f"{joint.joint}, {demand.what} {percent_of_limit(demand.share)} of its limit"
    marked = MarkedJoint(joint.joint, label, mark_style(demand.share))
    moment = cycle.time[0] + demand.time
    if not cycle.time[0] <= moment <= cycle.time[-1]:  # a rating of the whole cycle, or a time in the pause
        return cycle.q[0], marked, f"{name} {start}"
    return cycle.q[np.abs(cycle.time - moment).argmin()], marked, f"{name} at t = {seconds(moment)} s"
