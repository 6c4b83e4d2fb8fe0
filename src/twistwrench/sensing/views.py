"""Answers about sensors as blocks: identified load, compensated readings, and proposed poses."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ..core.answers.blocks import Block, Headline, Line, Remark, Table, numbers, remarks, words
from ..core.colours import Style
from ..core.numbers import estimate, number, percent, quantity, seconds
from ..core.text import Argument, Placeholder, spell
from ..core.typing import Array
from ..core.verdict import Word
from ..mechanics.joints.units import heading_unit, unit_of
from ..mechanics.lie import so3
from ..mechanics.lie.labelled import WRENCH
from .compensation import Compensation, rms_residuals
from .contact_detection import CollisionThreshold
from .log import ReadingLog
from .poses import POSE, PoseProposal
from .result import Identification
from .static_poses import runs

MAX_LISTED_CONTACTS = 5
"""Largest number of contacts that the first line lists."""
MAX_POSES_IN_SHORT = 30
"""Largest number of poses in the short form of the report."""
_MILLI = 1e3
"""Factor of values in m and s for mm and ms."""


def identification_view(found: Identification) -> Iterator[Block]:
    """Identified parameters with their intervals, and the compensated readings."""
    log = found.log
    reasons, end_remarks = _reasons_and_remarks(found, log.notes)
    ending = ", which may be nothing."
    least_mass, _ = found.mass_interval
    if least_mass > 0:
        com = ", ".join(number(_MILLI * x, decimals=1) for x in found.sensor.load.com)
        ending = f" at ({com}) mm."
    yield Headline(found.verdict.word, f"{found.mass_text}{ending}")
    yield from reasons
    yield ""
    yield _heading(log, found.sensor.sign)
    names, units, values, half_widths = zip(*_parameter_rows(found), strict=True)
    all_units = ", ".join(dict.fromkeys(units))  # each once, in their order
    yield Table(
        "Load and sensor",
        words("quantity", names, fold=False),
        words("unit", units, fold=False),
        numbers("value", values, unit=all_units, headed=False),
        numbers(f"± ({percent(found.confidence, 3)})", half_widths, unit=all_units, headed=False),
    )
    yield _readings_table(log, found.rest(log), found.kept)
    moment_noise, force_noise = found.noise
    yield f"Noise of a reading: {number(moment_noise, 2)} N m, {number(force_noise, 2)} N (1 σ)."
    yield from end_remarks


def _parameter_rows(found: Identification) -> Iterator[tuple[Any, ...]]:
    """Name of each parameter, its unit, its value, and the half width of its interval; ``"given"`` without an interval."""
    load = found.sensor.load
    unknowns = found.fit.unknowns

    def half_width(name: str) -> float:
        """Half width of the interval of an unknown, in SI units."""
        return float(np.ptp(found.interval(name))) / 2

    low, high = found.mass_interval
    yield "mass", "kg", *_estimate_cells((high + low) / 2, (high - low) / 2)
    for axis, x, (low, high) in zip("xyz", load.com, found.com_intervals, strict=True):
        yield f"centre of mass {axis}", "mm", *_estimate_cells(_MILLI * x, 0.5 * _MILLI * (high - low))
    if unknowns.inertia:
        for i, j in ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2)):  # upper triangle, column by column
            name = f"I{'xyz'[i]}{'xyz'[j]}"
            cells = _estimate_cells(load.moment_about_origin[i, j], half_width(name))
            yield f"{name} about the origin", "kg m²", *cells
    for axis, value in zip(WRENCH, np.asarray(found.sensor.bias), strict=True):
        name = f"bias {axis}"
        if unknowns.bias:
            yield name, _unit(axis), *_estimate_cells(value, half_width(name))
        else:
            yield name, _unit(axis), value, "given"
    if unknowns.turn:
        for axis, turn in zip("xyz", found.turn, strict=True):
            angle = _estimate_cells(math.degrees(turn), math.degrees(half_width(f"turn {axis}")))
            yield f"mounting turned about {axis}", "°", *angle
    if unknowns.drift:
        step_unit = "s" if found.log.time is not None else "reading"
        for axis in WRENCH:
            low, high = found.interval(f"drift {axis}")
            yield f"drift {axis}", f"{_unit(axis)}/{step_unit}", *_estimate_cells((low + high) / 2, (high - low) / 2)
    if unknowns.tilt:
        rotation_vector = so3.log(found.fit.state.tilt)
        tilt = math.degrees(np.linalg.norm(rotation_vector))
        larger_half_width = max(half_width("tilt 1"), half_width("tilt 2"))
        yield "base tilted by", "°", *_estimate_cells(tilt, math.degrees(larger_half_width))
    if unknowns.delay:
        delay_cells = _estimate_cells(_MILLI * found.fit.state.delay, _MILLI * half_width("delay"))
        yield "readings are late by", "ms", *delay_cells


def _estimate_cells(value: float, half_width: float) -> tuple[Line, Line]:
    """Cells of a value and of the half width of its interval, rounded to the same digit."""
    value_text, half_width_text = estimate(value, half_width)
    return Line(value_text, value=value), Line(half_width_text, value=half_width)


def _reasons_and_remarks(
    found: Identification | Compensation, notes: tuple[str, ...]
) -> tuple[list[Remark], list[Remark]]:
    """Reasons of the verdict, and remarks at the end of the report, which are ``notes`` and all other doubts."""
    doubts = [str(doubt) for doubt in found.doubts]
    reasons = [doubt for doubt in doubts if doubt in found.verdict.reasons]
    other_doubts = [doubt for doubt in doubts if doubt not in reasons]
    return remarks(reasons), remarks([*notes, *other_doubts])


def compensation_view(found: Compensation) -> Iterator[Block]:
    """Readings before and after compensation, and contacts."""
    log = found.log
    reasons, end_remarks = _reasons_and_remarks(found, log.notes)
    yield Headline(found.verdict.word, _compensation_sentence(found))
    yield from reasons
    yield ""
    yield _heading(log, found.sensor.sign)
    yield _readings_table(log, found.rest, np.ones(len(log), bool))
    if found.threshold is not None:
        yield _threshold_sentence(found.threshold, forces_only=found.inertia is not None)
    yield from end_remarks


def _threshold_sentence(threshold: CollisionThreshold, *, forces_only: bool) -> str:
    """Sentence with the smallest moment and force that count as a contact; infinite ones are left out."""
    smallest_texts = []
    moment_thresholds, force_thresholds = threshold.per_axis[:3], threshold.per_axis[3:]
    for kind, thresholds in (("m", moment_thresholds), ("f", force_thresholds)):
        if np.isfinite(thresholds).all():
            smallest_texts.append(quantity(thresholds.min(), _unit(kind)))
    note = "; moments are not looked at" if forces_only else ""
    return (
        f"Contact is what noise alone reaches once in {number(1 / threshold.false_alarms)} readings: from "
        f"{' or '.join(smallest_texts)} on{note}."
    )


def _compensation_sentence(found: Compensation) -> str:
    """First line of the answer: contacts, or the number of readings that are explained."""
    log = found.log
    hits = found.hits  # mask of readings with contact
    if not found.explained:
        return "this sensor file does not explain this log."
    if hits.any():
        spans = [_span(log, first, last) for first, last in runs(hits)]
        contact_forces = found.rest[hits][:, 3:]
        peak_force = np.linalg.norm(contact_forces, axis=1).max()
        listed = "; ".join(spans[:MAX_LISTED_CONTACTS])
        if len(spans) > MAX_LISTED_CONTACTS:
            listed += "; …"
        return f"{hits.sum()} of {len(log)} readings, {listed}; up to {number(peak_force)} N."
    if found.threshold is not None:
        return "no contact force; moments were not looked at." if found.inertia else "no contact."
    is_explained = ~found.off
    moment, force = rms_residuals(found.rest[is_explained])
    moment_noise, force_noise = found.noise
    beside_noise = f"beside noise of {number(force_noise, 2)} N and {number(moment_noise, 2)} N m"
    if found.inertia and found.inertia.refuses:
        return f"the load's inertia is left in the moments, {number(moment, 2)} N m {beside_noise}."
    explained_count = int(is_explained.sum())
    sentence = (
        f"{explained_count} of {len(log)} readings are explained, with {number(force, 2)} N and {number(moment, 2)} N m "
        f"left {beside_noise}."
    )
    if explained_count == len(log):
        return sentence
    contacts = spell(Argument("false_alarms", Placeholder("1e-6"), option="contacts"))
    return f"{sentence} In the others something else acts; {contacts} lists when."


def _span(log: ReadingLog, first: int, last: int) -> str:
    """Text of a run of readings: times of its ``first`` and ``last`` reading, or their numbers in a log without times."""
    if log.time is not None:
        return f"{seconds(log.time[first])} to {seconds(log.time[last])} s"
    if first == last:
        return f"reading {first}"
    return f"readings {first} to {last}"


def _heading(log: ReadingLog, sign: str) -> Line:
    """File, number of readings, duration, motion and sign."""
    motion = "at rest" if log.V is None else "in motion"
    duration = ""
    if log.time is not None and len(log) > 1:
        duration = f" over {number(np.ptp(log.time))} s"
    return Line((Path(log.name).name, Style.STRONG), f"  {len(log)} readings{duration}, {motion}, sign {sign}")


def _readings_table(log: ReadingLog, compensated: Array, is_kept: Array) -> Table:
    """Root mean squares of the kept readings before and after compensation."""
    rms_before = np.sqrt(np.mean(log.readings[is_kept] ** 2, axis=0))
    rms_after = np.sqrt(np.mean(compensated[is_kept] ** 2, axis=0))
    columns = []
    show_number = partial(number, decimals=4)
    for axis, before, after in zip(WRENCH, rms_before, rms_after, strict=True):
        columns.append(numbers(axis, [before, after], show_number, _unit(axis), headed=False))
    return Table(
        "Readings",
        words("", ["before", "after"], fold=False),
        *columns,
        detail=", root mean square",
        unit=heading_unit("tau", (True, False)),
    )


def _unit(axis: str) -> str:
    """Unit of a row of a wrench: a moment if its name begins with m, otherwise a force."""
    return unit_of("tau", axis.startswith("m"))


def proposal_view(found: PoseProposal) -> Iterator[Block]:
    """Proposed orientations in measuring order; only the verdict if they do not determine the mass."""
    if found.doubts:
        yield Headline(found.verdict.word, str(found.doubts[0]))
        if not found.determines_mass:
            return
    else:
        mass_error, com_error = found.intervals[-1]  # with all poses
        com_text = number(_MILLI * com_error, 2)
        intervals = f"mass ± {number(mass_error, 2)} kg, centre of mass ± {com_text} mm (95 %)"
        load = f"a load of {number(found.mass)} kg"
        yield Headline(Word.OK, f"{len(found.poses)} orientations determine {load}: {intervals}.")
    yield ""
    show_coordinate = partial(number, decimals=3)
    show_interval = partial(number, digits=2)
    columns = [numbers(name, values, show_coordinate) for name, values in zip(POSE, found.poses.T, strict=True)]
    yield Table(
        "Next poses",
        words("no.", range(1, len(found.poses) + 1), fold=False),
        *columns,
        numbers("mass ±", found.intervals[:, 0], show_interval, "kg"),
        numbers("centre ±", _MILLI * found.intervals[:, 1], show_interval, "mm"),
        most=MAX_POSES_IN_SHORT,
        of_limits=False,
    )
    yield (
        "Orientations R_wf of the sensor's frame and gravity's direction in it; turns about the vertical are free.\n"
        f"± is what will be known (95 %) with all poses up to there, for a load of {number(found.mass)} kg; "
        "that of the centre\nis across the line to the sensor, along it add the share of the mass."
    )
