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
"""Significant digits of figures in the table."""
_MAX_ROWS = 12
"""Largest number of rows of the table; the others are counted."""


def sizing_view(sizing: Sizing) -> Iterator[Block]:
    """Verdict, selected products, drives with their figures, supply and remarks.

    For LOOK AGAIN, only the verdict and the remarks: the log contradicts itself, so nothing was sized.
    """
    verdict = sizing.verdict
    if verdict.word is Word.LOOK_AGAIN:
        yield from _verdict_blocks(verdict)
        yield from _notes(sizing)
        return
    if verdict.word is Word.OK:
        closest = max(sizing.joints.values(), key=_largest_share)
        part, demand = closest.tightest
        yield Headline(Word.OK, f"all ratings kept. Closest: {closest.joint}, {part}: {demand.words}.")
    else:
        yield from _verdict_blocks(verdict)
    if not sizing.choice and verdict.word is Word.OVER_LIMIT:  # the given drives do not suffice
        for sentence in smallest_drives(sizing, sizing.choose()):
            yield Line(sentence, indent=2)
    yield ""
    if sizing.joints:
        yield drives_table(sizing, sizing.problem.ambient)
    for joint, choice in sizing.choice.items():
        if choice.smaller is not None:
            smaller_drive, reason = choice.smaller
            shortened_reason = reason.removeprefix(f"{joint}, ")  # the joint is named already
            yield f"{joint}: the next smaller ({drive_name(smaller_drive)}) fails: {shortened_reason}."
    supply = sizing.supply
    yield Line(
        f"Supply: peak {quantity(supply.peak, 'W')}, mean {quantity(supply.mean, 'W')}; a cycle draws "
        f"{quantity(supply.drawn, 'J')} and returns {quantity(supply.braked, 'J')}. Drives {quantity(sizing.mass, 'kg')}."
    )
    if sizing.left_out:
        yield Line((f"Not sized, for it does not turn or has no drive: {', '.join(sizing.left_out)}.", Style.QUIET))
    yield Line(
        ("Electronics and iron losses are not counted, nor bearings without limits in the catalogue.", Style.QUIET)
    )
    yield from _notes(sizing)


def _verdict_blocks(verdict: Verdict) -> Iterator[Headline | Remark]:
    """Headline with the first reason, and the other reasons as remarks."""
    first_reason, *other_reasons = verdict.reasons or ("",)
    yield Headline(verdict.word, f"{first_reason}.")
    yield from remarks(f"{reason}." for reason in other_reasons)


def _notes(sizing: Sizing) -> Iterator[Remark]:
    """Remarks on the payload, on the log, and on torque limits of the robot's file that are probably placeholders."""
    report = sizing.report
    if report is None:
        return
    yield from remarks([*report.load.unit_hints, *notes_on_log(report)])
    placeholders = placeholder_limits(report.load.robot, report.limits)  # empty text if there are none
    if placeholders:
        yield from remarks([f"The robot's file has {placeholders}. Drives are judged by their ratings, not by these."])


def _largest_share(joint: SizedJoint) -> float:
    """Share of the rating to which a joint's drive is nearest."""
    _, demand = joint.tightest
    return demand.share


_MIN_NAME_WIDTH = 9
"""Least width of a joint's name in narrow terminals, in characters; names are folded at their separators."""
_CURRENT_DECIMALS = 4
"""Decimals of a current; smaller currents are rounding errors of joints at rest."""


def drives_table(sizing: Sizing, ambient: float) -> Table:
    """Table with one row per joint; limits are shown behind the values."""
    joints = list(sizing.joints.values())
    names = [joint.joint for joint in joints]
    narrow_names = replace(words("joint", names), min_width=_MIN_NAME_WIDTH)
    drives = [joint.drive for joint in joints]
    gears = [gear for _, gear in drives]
    gear_column = None
    if any(gear != DIRECT for gear in gears):
        gear_column = words("gear", gears)
    currents = [joint.motor.rms_current for joint in joints]
    current_text = partial(number, digits=_DIGITS, decimals=_CURRENT_DECIMALS)
    shares = [_largest_share(joint) for joint in joints]
    return Table(
        f"Drives at {number(ambient)} degC",
        words("joint", names, fold=False, narrow=narrow_names),
        words("motor", [motor for motor, _ in drives]),
        gear_column,
        _demand_column("mean", joints, "average torque", "N m"),
        _demand_column("peak", joints, "peak torque", "N m"),
        _demand_column("input", joints, "input speed", "rpm"),
        numbers("rms", currents, current_text, "A"),
        numbers("winding", map(_max_winding_temperature, joints), _figure, "degC"),
        numbers("J ratio", [j.motor.inertia_ratio for j in joints], _figure),
        numbers("used", shares, share_cell),
        most=_MAX_ROWS,
        by=shares,  # the rows with the largest shares are shown
    )


def _max_winding_temperature(joint: SizedJoint) -> float:
    """Largest temperature of the winding [°C]; nan without thermal data."""
    temperature = joint.motor.temperature
    if not temperature.size:
        return math.nan
    winding_temperature = temperature[:, 0]
    return float(winding_temperature.max())


def _figure(value: float) -> str:
    """Number with the digits of the table."""
    return number(value, _DIGITS)


def _demand_column(header: str, joints: Sequence[SizedJoint], demand_name: str, unit: str) -> Column:
    """Column of a demand on gears with its limits. In narrow terminals, the limits stand below the demands."""
    demands = [_gear_demand(joint, demand_name) for joint in joints]
    limits = [math.inf if demand is None else demand.limit for demand in demands]
    column = numbers(header, map(_demand_cell, demands), unit=unit, limits=limits)
    narrow_cells = [_demand_cell(demand, separator="\n/ ") for demand in demands]
    return replace(column, narrow=numbers(header, narrow_cells, unit=unit, limits=limits))


def _gear_demand(joint: SizedJoint, demand_name: str) -> Demand | None:
    """Demand on the gear of a joint by its name; None if the gear has no such rating."""
    for demand in joint.gear.demands:
        if demand.what == demand_name:
            return demand
    return None


def _demand_cell(demand: Demand | None, separator: str = " / ") -> Line | str:
    """Cell with a demand, red if it exceeds its limit, and the limit if it is finite; a dash without a demand."""
    if demand is None:
        return number(None)
    limit_text = ""
    if math.isfinite(demand.limit):
        limit_text = f"{separator}{_figure(demand.limit)}"
    style = Style.OVER if over_limit(demand.share) else ""
    return Line((_figure(demand.value), style), (limit_text, Style.QUIET), value=demand.value)


def worst_moment(sizing: Sizing) -> tuple[Array, MarkedJoint | None, str]:
    """Configuration in which a drive is nearest to a rating, its joint, and a title.

    Without joints, or if the rating belongs to no time of the motion, it is the first configuration.
    """
    cycle = sizing.motion
    assert cycle is not None  # a caller checks it
    name = cycle.robot.name
    title_at_start = f"{name} at the beginning of the motion"
    if not sizing.joints:
        return cycle.q[0], None, title_at_start
    joint = max(sizing.joints.values(), key=_largest_share)
    _, demand = joint.tightest
    label = f"{joint.joint}, {demand.what} {percent_of_limit(demand.share)} of its limit"
    marked = MarkedJoint(joint.joint, label, mark_style(demand.share))
    time = cycle.time[0] + demand.time
    is_in_motion = cycle.time[0] <= time <= cycle.time[-1]
    if not is_in_motion:  # a rating of the whole cycle, whose time is nan, or a time in the pause
        return cycle.q[0], marked, title_at_start
    nearest_row = np.abs(cycle.time - time).argmin()
    return cycle.q[nearest_row], marked, f"{name} at t = {seconds(time)} s"
