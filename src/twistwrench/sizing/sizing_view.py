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


def sizing_view(found: Sizing) -> Iterator[Block]:
    """Verdict, selected products, drives with their figures, supply and remarks; only the verdict of a log to look at again."""
    judged = found.verdict
    if judged.word is Word.LOOK_AGAIN:
        yield from _spoken(judged)
        yield from _notes(found)
        return
    if judged.word is Word.OK:
        one = max(found.joints.values(), key=lambda j: j.tightest[1].share)
        part, demand = one.tightest
        yield Headline(Word.OK, f"all ratings kept. Closest: {one.joint}, {part}: {demand.words}.")
    else:
        yield from _spoken(judged)
    if not found.choice and judged.word is Word.OVER_LIMIT:
        yield from (Line(sentence, indent=2) for sentence in smallest_drives(found, found.choose()))
    yield ""
    if found.joints:
        yield drives_table(found, found.problem.ambient)
    for joint, chosen in found.choice.items():
        if chosen.smaller is not None:
            pair, reason = chosen.smaller
            yield f"{joint}: the next smaller ({drive_name(pair)}) fails: {reason.removeprefix(f'{joint}, ')}."
    s = found.supply
    yield Line(
        f"Supply: peak {quantity(s.peak, 'W')}, mean {quantity(s.mean, 'W')}; a cycle draws {quantity(s.drawn, 'J')} and "
        f"returns {quantity(s.braked, 'J')}. Drives {quantity(found.mass, 'kg')}."
    )
    if found.left_out:
        yield Line((f"Not sized, for it does not turn or has no drive: {', '.join(found.left_out)}.", Style.QUIET))
    yield Line(("Electronics, iron losses and bearing moments of gears are not counted.", Style.QUIET))
    yield from _notes(found)


def _spoken(judged: Verdict) -> Iterator[Headline | Remark]:
    first, *rest = judged.reasons or ("",)
    yield Headline(judged.word, f"{first}.")
    yield from remarks(f"{reason}." for reason in rest)


def _notes(found: Sizing) -> Iterator[Remark]:
    """Remarks on the payload, on the log, and on torque limits of the robot's file that are probably not those of motors."""
    report = found.report
    if report is None:
        return
    yield from remarks([*report.load.unit_hints, *notes_on_log(report)])
    if limits := placeholder_limits(report.load.robot, report.limits):
        yield from remarks([f"The robot's file has {limits}. Drives are judged by their ratings, not by these."])


_NAME = 9
"""Least width of a joint's name in narrow terminals; names are folded at their separators."""
_CURRENT = 4
"""Decimals of a current; smaller ones are rounding errors of joints at rest."""


def drives_table(found: Sizing, ambient: float) -> Table:
    """Table with one row per joint; limits are shown behind the values."""
    joints = list(found.joints.values())
    names = [j.joint for j in joints]
    warm = [j.motor.temperature[:, 0].max() if j.motor.temperature.size else math.nan for j in joints]
    return Table(
        f"Drives at {number(ambient)} degC",
        words("joint", names, fold=False, narrow=replace(words("joint", names), min_width=_NAME)),
        words("motor", [j.drive[0] for j in joints]),
        words("gear", [j.drive[1] for j in joints]) if any(j.drive[1] != DIRECT for j in joints) else None,
        _rated("mean", joints, "average torque", "N m"),
        _rated("peak", joints, "peak torque", "N m"),
        _rated("input", joints, "input speed", "rpm"),
        numbers("rms", [j.motor.rms_current for j in joints], partial(number, digits=_DIGITS, decimals=_CURRENT), "A"),
        numbers("winding", warm, _figure, "degC"),
        numbers("J ratio", [j.motor.inertia_ratio for j in joints], _figure),
        numbers("used", [j.tightest[1].share for j in joints], share_cell),
        most=12,
        by=[j.tightest[1].share for j in joints],
    )


def _figure(value: float) -> str:
    return number(value, _DIGITS)


def _rated(name: str, joints: Sequence[SizedJoint], what: str, unit: str) -> Column:
    """Column of a gear figure with its limits, which stand below it in narrow terminals; exceeded limits are red."""
    demands = [next((d for d in j.gear.demands if d.what == what), None) for j in joints]
    limits = [math.inf if d is None else d.limit for d in demands]
    column = numbers(name, map(_cell, demands), unit=unit, limits=limits)
    return replace(column, narrow=numbers(name, map(partial(_cell, between="\n/ "), demands), unit=unit, limits=limits))


def _cell(demand: Demand | None, between: str = " / ") -> Line | str:
    if demand is None:
        return number(None)
    limit = f"{between}{_figure(demand.limit)}" if math.isfinite(demand.limit) else ""
    red = Style.OVER if over_limit(demand.share) else ""
    return Line((_figure(demand.value), red), (limit, Style.QUIET), value=demand.value)


def worst_moment(found: Sizing) -> tuple[Array, MarkedJoint | None, str]:
    """Configuration in which a drive is nearest to a rating, its joint, and a title."""
    cycle = found.motion
    assert cycle is not None
    name, start = cycle.robot.name, "at the beginning of the motion"
    if not found.joints:
        return cycle.q[0], None, f"{name} {start}"
    joint = max(found.joints.values(), key=lambda j: j.tightest[1].share)
    demand = joint.tightest[1]
    label = f"{joint.joint}, {demand.what} {percent_of_limit(demand.share)} of its limit"
    marked = MarkedJoint(joint.joint, label, mark_style(demand.share))
    moment = cycle.time[0] + demand.time
    if not cycle.time[0] <= moment <= cycle.time[-1]:  # a rating of the whole cycle, or a time in the pause
        return cycle.q[0], marked, f"{name} {start}"
    return cycle.q[np.abs(cycle.time - moment).argmin()], marked, f"{name} at t = {seconds(moment)} s"
