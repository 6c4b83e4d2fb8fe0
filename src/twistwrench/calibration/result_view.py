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
"""Factor of values in m and rad for mm and mrad."""
_MAX_GROUPS = 12
"""Largest number of groups in the short form of the table."""
_MAX_PREDICTED_RATIO = 2.0
"""Ratio of the tip's predicted error to the held-out error, up to which the held-out error is given as the tip's."""
_MAX_ROUNDING_ERROR = 1e-6
"""Predicted error of the tip [m] that is negligible."""


def millimetres(value: float) -> str:
    """Text of a length [m] in mm, with three digits."""
    return quantity(_MILLI * value, "mm", 3, decimals=3)


def calibration_view(found: CalibratedRobot) -> Iterator[Block]:
    """Blocks of the report, verdict first."""
    yield _headline(found)
    yield ""
    frame = found.fit.problem.chain.frame
    _, _, readings = found.subject.partition(" · ")  # the robot's name stands before it
    yield Line((found.robot_name, Style.STRONG), f"  ·  {readings}, at {frame}")
    yield from _error_tables(found)
    yield from _group_tables(found)
    length_deviation, angle_deviation = found.fit.deviations[0]  # of the first measurement [m, rad]
    noise = millimetres(length_deviation)
    if angle_deviation:
        noise += f", {quantity(math.degrees(angle_deviation), '°', 2)}"
    parameter_count = len(found.fit.names)
    yield Line(
        f"{found.rank} groups of {parameter_count} parameters are determined, in theory {found.theory}. "
        f"Noise of a reading: {noise} (1 σ)."
    )
    notes = [str(doubt) for doubt in found.doubts if doubt.level == "note"]
    own_notes = (found.tip_note, found.held_out.note)
    notes += [note for note in own_notes if note]
    for measurement in found.fit.problem.measured:
        notes += measurement.notes
    yield from remarks(notes)


def noun_of_readings(found: CalibratedRobot) -> str:
    """Name of all readings: measured places, distances, touches, or readings."""
    kinds = {str(measurement.kind) for measurement in found.fit.problem.measured}
    if found.measures_tip:
        return "measured places"
    if kinds <= {"distance", "pair"}:
        return "distances"
    if kinds <= set(TOUCHES):
        return "touches"
    return "readings"


def figures(found: CalibratedRobot) -> str:
    """Text of the tip's error before and after the calibration.

    It is the measured error if places of the tip were measured over its reach. If not, it is the predicted error, with the
    error of the readings.
    """
    held_out = millimetres(found.held_out.rms)
    error_before = millimetres(found.before)
    max_predicted = max(_MAX_PREDICTED_RATIO * found.held_out.rms, _MAX_ROUNDING_ERROR)
    if found.measures_tip and found.remaining.rms <= max_predicted:
        return f"the tip is right to {held_out} (rms, held out), {error_before} before"
    remaining = millimetres(found.remaining.rms)
    remaining_before = millimetres(found.remaining_before)
    return (
        f"the tip is right to {remaining} (rms, predicted), {remaining_before} before; "
        f"{noun_of_readings(found)} to {held_out} (held out), {error_before} before"
    )


def _headline(found: CalibratedRobot) -> Headline:
    """Word of the verdict with its reasons, or with figures if it is OK; errors below the reasons."""
    if found.verdict.word is Word.OK:
        if found.needs_nothing:
            error = found.remaining_before
            if found.measures_tip:
                error = max(error, found.before)
            text = f"the file is already right to {millimetres(error)} (rms); nothing needs to be written."
            return Headline(Word.OK, text)
        return Headline(Word.OK, f"{figures(found)}{_largest_zero_text(found)}.")
    reason, *other_reasons = found.verdict.reasons
    held_out = millimetres(found.held_out.rms)
    before = millimetres(found.before)
    remaining = millimetres(found.remaining.rms)
    if found.measures_tip:
        errors = f"Held out: {held_out} rms, {before} before; predicted to remain: {remaining}"
    else:
        errors = (
            f"{noun_of_readings(found).capitalize()} held out: {held_out} rms, {before} before; predicted to remain at "
            f"the tip: {remaining}, {millimetres(found.remaining_before)} before"
        )
    further = [Line(f"{errors}{_largest_zero_text(found)}.")]
    return Headline(found.verdict.word, reason, reasons=other_reasons, further=further)


def _largest_zero_text(found: CalibratedRobot) -> str:
    """Text of the largest error of a zero; empty without zeros."""
    if not found.zeros:
        return ""
    size_by_joint = {name: abs(value) for name, (value, _) in found.zeros.items()}  # [rad or m]
    joint = max(size_by_joint, key=size_by_joint.__getitem__)
    value, half_width = found.zeros[joint]
    chain = found.fit.problem.chain
    factor = _MILLI
    unit = " mm"
    if chain.turning[chain.joints.index(joint)]:
        factor = math.degrees(1.0)
        unit = "°"
    value_text, half_width_text = estimate(factor * value, factor * half_width)
    return f"; largest: zero of {joint} off by {value_text} ± {half_width_text}{unit}"


def _error_tables(found: CalibratedRobot) -> Iterator[Table]:
    """Errors before and after: one table of the tip; two tables if the readings are not places of the tip."""
    measured = [  # name, rms, largest, number of poses
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
    """Table with the columns name, rms, largest [m] and number of poses, from its rows."""

    def millimetre_text(length: float | None) -> str:
        """Length [m] in mm, without the unit, which stands in the head of the column."""
        return number(None if length is None else _MILLI * length, 3, decimals=3)

    names, rms, largest, counts = zip(*rows, strict=True)
    return Table(
        title,
        words("", names, fold=False),
        numbers("rms", rms, millimetre_text, "mm"),
        numbers("largest", largest, millimetre_text, "mm"),
        numbers("poses", counts),
    )


def _group_figures(group: ParameterGroup) -> tuple[str, float, float]:
    """Unit of a group in the table, its value in this unit, and the half width of its interval."""
    if group.name.endswith(".gear"):
        unit, factor = "%", 100.0
    elif group.name.endswith(".sag"):
        unit, factor = "mrad/(N m)", _MILLI
    elif group.is_length:
        unit, factor = "mm", _MILLI
    else:
        unit, factor = "°", math.degrees(1.0)
    return unit, factor * group.value, factor * group.half_width()


def _group_tables(found: CalibratedRobot) -> Iterator[Block]:
    """Table of groups, and table of their sums. A short table has the groups that differ most from the file."""
    groups = found.parameter_groups.all
    units, value_lines, half_width_lines = [], [], []
    for group in groups:
        unit, value, half_width = _group_figures(group)
        value_text, half_width_text = estimate(value, half_width)
        units.append(unit)
        value_lines.append(Line(value_text, value=value))
        half_width_lines.append(Line(half_width_text, value=half_width))
    differences = []  # of each group from the file, in half widths
    for group in groups:
        half_width = max(group.half_width(), 1e-300)  # not divided by zero
        differences.append(abs(group.value) / half_width)
    yield Table(
        "Groups",
        words("group", [group.name for group in groups], fold=False),
        words("unit", units, fold=False),
        numbers("value", value_lines),
        numbers("± (95 %)", half_width_lines),
        most=_MAX_GROUPS,
        by=differences,
        of_limits=False,
    )
    names, sums = [], []
    for group in groups:
        if len(group.terms) > 1:
            names.append(group.name)
            sums.append(group.text)
    if names:
        yield Table("What a group contains", words("group", names, fold=False), words("sum", sums), level=Level.ALL)
