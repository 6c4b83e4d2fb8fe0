"""Calibrated robot as blocks: verdict, error before and after, groups of parameters, remarks."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from ..core.answers.blocks import Block, Headline, Level, Line, Table, numbers, remarks, words
from ..core.colours import Style
from ..core.numbers import estimate, number, quantity
from ..core.verdict import Word
from .groups import ParameterGroup
from .measurements import TOUCHES
from .result import CalibratedRobot

_MILLI = 1e3
_MAX_GROUPS = 12
_MAX_PREDICTED_RATIO = 2.0
"""Ratio of the predicted error to the held-out one up to which the held-out one stands for the tip."""
_ROUNDING = 1e-6
"""Predicted error of the tip [m] that does not matter."""


def millimetres(value: float) -> str:
    """Length with three digits [mm]."""
    return quantity(_MILLI * value, "mm", 3, decimals=3)


def calibration_view(found: CalibratedRobot) -> Iterator[Block]:
    """Blocks of the report, verdict first."""
    yield _headline(found)
    yield ""
    frame = found.fit.problem.chain.frame
    yield Line((found.robot_name, Style.STRONG), f"  ·  {found.subject.partition(' · ')[2]}, at {frame}")
    yield from _errors(found)
    yield from _groups(found)
    noise = millimetres(found.fit.deviations[0][0])
    angle = found.fit.deviations[0][1]
    if angle:
        noise += f", {quantity(math.degrees(angle), '°', 2)}"
    count = len(found.fit.names)
    yield Line(
        f"{found.rank} groups of {count} parameters are determined, in theory {found.theory}. "
        f"Noise of a reading: {noise} (1 σ)."
    )
    notes = [str(doubt) for doubt in found.doubts if doubt.level == "note"]
    notes += [note for note in (found.tip_note, found.held_out.note) if note]
    for m in found.fit.problem.measured:
        notes += m.notes
    yield from remarks(notes)


def noun_of_readings(found: CalibratedRobot) -> str:
    """Name of all readings: measured places, distances, touches, or readings."""
    kinds = {str(m.kind) for m in found.fit.problem.measured}
    if found.measures_tip:
        return "measured places"
    if kinds <= {"distance", "pair"}:
        return "distances"
    return "touches" if kinds <= set(TOUCHES) else "readings"


def figures(found: CalibratedRobot) -> str:
    """Error of the tip before and after: measured, or predicted beside that of the readings.

    Readings that are not places of the tip, and places at similar poses, do not show its error over the reach.
    """
    held_out, before = millimetres(found.held_out.rms), millimetres(found.before)
    if found.measures_tip and found.remaining.rms <= max(_MAX_PREDICTED_RATIO * found.held_out.rms, _ROUNDING):
        return f"the tip is right to {held_out} (rms, held out), {before} before"
    remaining, remaining_before = millimetres(found.remaining.rms), millimetres(found.remaining_before)
    return (
        f"the tip is right to {remaining} (rms, predicted), {remaining_before} before; "
        f"{noun_of_readings(found)} to {held_out} (held out), {before} before"
    )


def _headline(found: CalibratedRobot) -> Headline:
    """Word and reasons; below it the figures."""
    if found.verdict.word is Word.OK:
        if found.needs_nothing:
            right = millimetres(max(found.remaining_before, found.before if found.measures_tip else 0.0))
            return Headline(Word.OK, f"the file is already right to {right} (rms); nothing needs to be written.")
        return Headline(Word.OK, f"{figures(found)}{_largest(found)}.")
    first, *others = found.verdict.reasons
    held_out, before = millimetres(found.held_out.rms), millimetres(found.before)
    remaining = millimetres(found.remaining.rms)
    if found.measures_tip:
        left = f"Held out: {held_out} rms, {before} before; predicted to remain: {remaining}"
    else:
        left = (
            f"{noun_of_readings(found).capitalize()} held out: {held_out} rms, {before} before; predicted to remain at "
        )
        left += f"the tip: {remaining}, {millimetres(found.remaining_before)} before"
    return Headline(found.verdict.word, first, reasons=others, further=[Line(f"{left}{_largest(found)}.")])


def _largest(found: CalibratedRobot) -> str:
    """Text of the zero that is off most."""
    if not found.zeros:
        return ""
    joint, (value, half) = max(found.zeros.items(), key=lambda item: abs(item[1][0]))
    chain = found.fit.problem.chain
    turns = chain.turning[chain.joints.index(joint)]
    if turns:
        value, half, unit = math.degrees(value), math.degrees(half), "°"
    else:
        value, half, unit = 1e3 * value, 1e3 * half, " mm"
    return f"; largest: zero of {joint} off by {' ± '.join(estimate(value, half))}{unit}"


def _errors(found: CalibratedRobot) -> Iterator[Table]:
    """Errors before and after: one table of the tip; two if the readings are not its places."""
    measured = [
        ("before, with the file", found.before, None, found.fit.problem.count),
        ("after, held out", found.held_out.rms, found.held_out.max, found.held_out.poses),
    ]
    remaining = ("predicted to remain", found.remaining.rms, found.remaining.worst, len(found.reference))
    if found.measures_tip:
        yield _error_table("Error of the tip", [*measured, remaining])
        return
    yield _error_table(f"Error of the {noun_of_readings(found)}", measured)
    before = ("predicted, with the file", found.remaining_before, None, len(found.reference))
    yield _error_table("Error of the tip", [before, remaining])


def _error_table(title: str, rows: Sequence[tuple[str, float, float | None, int]]) -> Table:
    """Rows of a name, rms, largest [m] and number of poses."""

    def millimetre_text(value: float | None) -> str:
        return number(None if value is None else _MILLI * value, 3, decimals=3)

    names, rms, largest, counts = zip(*rows, strict=True)
    return Table(
        title,
        words("", names, fold=False),
        numbers("rms", rms, millimetre_text, "mm"),
        numbers("largest", largest, millimetre_text, "mm"),
        numbers("poses", counts),
    )


def _group_figures(group: ParameterGroup) -> tuple[str, float, float]:
    """Unit, value and half width of a group as it is read: mm, °, mrad/(N m), %."""
    if group.name.endswith(".gear"):
        unit, factor = "%", 100.0
    elif group.name.endswith(".sag"):
        unit, factor = "mrad/(N m)", _MILLI
    elif group.is_length:
        unit, factor = "mm", _MILLI
    else:
        unit, factor = "°", math.degrees(1.0)
    return unit, factor * group.value, factor * group.half_width()


def _groups(found: CalibratedRobot) -> Iterator[Block]:
    """Table of groups; those that differ most from the file stand in the short form."""
    groups = found.parameter_groups.all
    units, values, halves = zip(*(_group_figures(group) for group in groups), strict=True)
    value_lines, half_lines = [], []
    for value, half in zip(values, halves, strict=True):
        value_text, half_text = estimate(value, half)
        value_lines.append(Line(value_text, value=value))
        half_lines.append(Line(half_text, value=half))
    yield Table(
        "Groups",
        words("group", [group.name for group in groups], fold=False),
        words("unit", units, fold=False),
        numbers("value", value_lines),
        numbers("± (95 %)", half_lines),
        most=_MAX_GROUPS,
        by=[abs(group.value) / max(group.half_width(), 1e-300) for group in groups],
        of_limits=False,
    )
    names, sums = [], []
    for group in groups:
        if len(group.terms) > 1:
            names.append(group.name)
            sums.append(group.text)
    if names:
        yield Table("What a group contains", words("group", names, fold=False), words("sum", sums), level=Level.ALL)
