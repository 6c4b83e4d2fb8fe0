"""Calibrated robot as blocks: verdict, error before and after, groups of parameters, remarks."""

from __future__ import annotations

import math
from collections.abc import Iterator

from ..core.answers.blocks import Block, Headline, Level, Line, Table, numbers, remarks, words
from ..core.colours import Style
from ..core.numbers import estimate, number, quantity
from ..core.verdict import Word
from .groups import ParameterGroup
from .result import CalibratedRobot

_MILLI = 1e3
_MOST = 12


def millimetres(value: float) -> str:
    """Length with three digits [mm]."""
    return quantity(_MILLI * value, "mm", 3, decimals=3)


def calibration_view(found: CalibratedRobot) -> Iterator[Block]:
    """Blocks of the report, verdict first."""
    yield _headline(found)
    yield ""
    frame = found.fit.problem.chain.frame
    yield Line((found.robot_name, Style.STRONG), f"  ·  {found.subject.partition(' · ')[2]}, at {frame}")
    yield _errors(found)
    yield from _groups(found)
    noise = millimetres(found.fit.deviations[0][0])
    if angle := found.fit.deviations[0][1]:
        noise += f", {quantity(math.degrees(angle), '°', 2)}"
    count = len(found.fit.names)
    yield Line(
        f"{found.rank} groups of {count} parameters are determined, in theory {found.theory}. "
        f"Noise of a reading: {noise} (1 σ)."
    )
    notes = [str(doubt) for doubt in found.doubts if doubt.level == "note"]
    notes += [found.held_out.note] if found.held_out.note else []
    yield from remarks([*notes, *(note for m in found.fit.problem.measured for note in m.notes)])


def _headline(found: CalibratedRobot) -> Headline:
    """Word and reasons; below it the figures."""
    figures = (
        f"the tip is right to {millimetres(found.held_out.rms)} (rms, held out), {millimetres(found.before)} before"
    )
    if found.verdict.word is Word.OK:
        if found.needs_nothing:
            return Headline(
                Word.OK, f"the file is already right to {millimetres(found.before)} (rms); nothing needs to be written."
            )
        return Headline(Word.OK, f"{figures}{_largest(found)}.")
    first, *others = found.verdict.reasons
    left = f"Held out: {millimetres(found.held_out.rms)} rms, {millimetres(found.before)} before; "
    left += f"predicted to remain: {millimetres(found.remaining.rms)}{_largest(found)}."
    return Headline(found.verdict.word, first, reasons=others, further=[Line(left)])


def _largest(found: CalibratedRobot) -> str:
    """Text of the zero that is off most."""
    if not found.zeros:
        return ""
    joint, (value, half) = max(found.zeros.items(), key=lambda item: abs(item[1][0]))
    chain = found.fit.problem.chain
    turns = chain.turning[chain.joints.index(joint)]
    value, half, unit = (math.degrees(value), math.degrees(half), "°") if turns else (1e3 * value, 1e3 * half, " mm")
    return f"; largest: zero of {joint} off by {' ± '.join(estimate(value, half))}{unit}"


def _errors(found: CalibratedRobot) -> Table:
    """Errors before and after."""
    rms = [found.before, found.held_out.rms, found.remaining.rms]
    most = [None, found.held_out.max, found.remaining.worst]
    names = ["before, with the file", "after, held out", "predicted to remain"]
    counts = [sum(m.count for m in found.fit.problem.measured), found.held_out.poses, len(found.reference)]

    def shown(value: float | None) -> str:
        return number(None if value is None else _MILLI * value, 3, decimals=3)

    return Table(
        "Error of the tip",
        words("", names, fold=False),
        numbers("rms", rms, shown, "mm"),
        numbers("largest", most, shown, "mm"),
        numbers("poses", counts),
    )


def _shown(group: ParameterGroup) -> tuple[str, float, float]:
    """Unit, value and half width of a group as it is read: mm, °, mrad/(N m), %."""
    if group.name.endswith(".gear"):
        unit, factor = "%", 100.0
    elif group.name.endswith(".sag"):
        unit, factor = "mrad/(N m)", _MILLI
    else:
        unit, factor = ("mm", _MILLI) if group.is_length else ("°", math.degrees(1.0))
    return unit, factor * group.value, factor * group.half_width()


def _groups(found: CalibratedRobot) -> Iterator[Block]:
    """Table of groups; those that differ most from the file stand in the short form."""
    groups = found.parameter_groups.all
    units, values, halves = zip(*(_shown(group) for group in groups), strict=True)
    texts = [estimate(value, half) for value, half in zip(values, halves, strict=True)]
    yield Table(
        "Groups",
        words("group", [group.name for group in groups], fold=False),
        words("unit", units, fold=False),
        numbers("value", [Line(text, value=x) for (text, _), x in zip(texts, values, strict=True)]),
        numbers("± (95 %)", [Line(text, value=x) for (_, text), x in zip(texts, halves, strict=True)]),
        most=_MOST,
        by=[abs(group.value) / max(group.half_width(), 1e-300) for group in groups],
        of_limits=False,
    )
    more = [(group.name, group.text) for group in groups if len(group.terms) > 1]
    if more:
        yield Table(
            "What a group contains", words("group", [name for name, _ in more], fold=False),
            words("sum", [text for _, text in more]), level=Level.ALL,
        )  # fmt: skip
