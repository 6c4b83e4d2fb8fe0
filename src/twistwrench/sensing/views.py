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

MAX_SPANS = 5
"""Number of contacts in the first line."""
MAX_POSES_IN_SHORT = 30
"""Number of rows of the short form."""


def identification_view(found: Identification) -> Iterator[Block]:
    """Identified parameters with their intervals, and the compensated readings."""
    log = found.log
    reasons, others = _remarks(found, log.notes)
    com = ", ".join(number(1e3 * x, decimals=1) for x in found.sensor.load.com)
    ending = f" at ({com}) mm." if found.mass_interval[0] > 0 else ", which may be nothing."
    yield Headline(found.verdict.word, f"{found.mass_text}{ending}")
    yield from reasons
    yield ""
    yield _heading(log, found.sensor.sign)
    names, units, values, halves = zip(*_parameters(found), strict=True)
    all_units = ", ".join(dict.fromkeys(units))
    yield Table(
        "Load and sensor",
        words("quantity", names, fold=False),
        words("unit", units, fold=False),
        numbers("value", values, unit=all_units, headed=False),
        numbers(f"± ({percent(found.confidence, 3)})", halves, unit=all_units, headed=False),
    )
    yield _readings_table(log, found.rest(log), found.kept)
    yield f"Noise of a reading: {number(found.noise[0], 2)} N m, {number(found.noise[1], 2)} N (1 σ)."
    yield from others


def _parameters(found: Identification) -> Iterator[tuple[Any, ...]]:
    """Name, unit, value and half-width of the interval of each parameter."""
    load, unknowns, state = found.sensor.load, found.fit.unknowns, found.fit.state

    def half(name: str) -> float:
        return float(np.ptp(found.interval(name))) / 2

    low, high = found.mass_interval
    yield "mass", "kg", *_estimate((high + low) / 2, (high - low) / 2)
    for axis, x, (low, high) in zip("xyz", load.com, found.com_intervals, strict=True):
        yield f"centre of mass {axis}", "mm", *_estimate(1e3 * x, 5e2 * (high - low))
    if unknowns.inertia:
        for i, j in ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2)):
            name = f"I{'xyz'[i]}{'xyz'[j]}"
            yield f"{name} about the origin", "kg m²", *_estimate(load.moment_about_origin[i, j], half(name))
    for axis, value in zip(WRENCH, np.asarray(found.sensor.bias), strict=True):
        name = f"bias {axis}"
        if unknowns.bias:
            yield name, _unit(axis), *_estimate(value, half(name))
        else:
            yield name, _unit(axis), value, "given"
    if unknowns.turn:
        for axis, turn in zip("xyz", found.turn, strict=True):
            angle = _estimate(math.degrees(turn), math.degrees(half(f"turn {axis}")))
            yield f"mounting turned about {axis}", "°", *angle
    per = "s" if found.log.time is not None else "reading"
    if unknowns.drift:
        for axis in WRENCH:
            low, high = found.interval(f"drift {axis}")
            yield f"drift {axis}", f"{_unit(axis)}/{per}", *_estimate((low + high) / 2, (high - low) / 2)
    if unknowns.tilt:
        largest_half = max(half("tilt 1"), half("tilt 2"))
        tilt = math.degrees(np.linalg.norm(so3.log(state.tilt)))
        yield "base tilted by", "°", *_estimate(tilt, math.degrees(largest_half))
    if unknowns.delay:
        yield "readings are late by", "ms", *_estimate(1e3 * state.delay, 1e3 * half("delay"))


def _estimate(value: float, sigma: float) -> tuple[Line, Line]:
    """Cells of a value and its half-width, rounded alike."""
    value_text, sigma_text = estimate(value, sigma)
    return Line(value_text, value=value), Line(sigma_text, value=sigma)


def _remarks(found: Identification | Compensation, notes: tuple[str, ...]) -> tuple[list[Remark], list[Remark]]:
    """Split doubts into reasons of the verdict and remarks at the end of the report, which include notes on the log."""
    texts = [str(each) for each in found.doubts]
    reasons = [text for text in texts if text in found.verdict.reasons]
    others = [text for text in texts if text not in reasons]
    return remarks(reasons), remarks([*notes, *others])


def compensation_view(found: Compensation) -> Iterator[Block]:
    """Readings before and after compensation, and contacts."""
    log = found.log
    reasons, others = _remarks(found, log.notes)
    yield Headline(found.verdict.word, _outcome(found))
    yield from reasons
    yield ""
    yield _heading(log, found.sensor.sign)
    yield _readings_table(log, found.rest, np.ones(len(log), bool))
    if found.threshold is not None:
        yield _threshold_sentence(found.threshold, forces_only=found.inertia is not None)
    yield from others


def _threshold_sentence(threshold: CollisionThreshold, *, forces_only: bool) -> str:
    """Smallest moment and force that count as a contact."""
    smallest = []
    for axis, x in (("m", threshold.per_axis[:3]), ("f", threshold.per_axis[3:])):
        if np.isfinite(x).all():
            smallest.append(quantity(x.min(), _unit(axis)))
    note = "; moments are not looked at" if forces_only else ""
    return (
        f"Contact is what noise alone reaches once in {number(1 / threshold.false_alarms)} readings: from "
        f"{' or '.join(smallest)} on{note}."
    )


def _outcome(found: Compensation) -> str:
    """First line of the answer: contacts, or the share of the readings that is explained."""
    log, hits = found.log, found.hits
    if not found.explained:
        return "this sensor file does not explain this log."
    moment, force = rms_residuals(found.rest[~found.off])
    noise = f"beside noise of {number(found.noise[1], 2)} N and {number(found.noise[0], 2)} N m"
    if hits.any():
        spans = [_span(log, first, last) for first, last in runs(hits)]
        peak = np.linalg.norm(found.rest[hits][:, 3:], axis=1).max()
        listed = "; ".join(spans[:MAX_SPANS])
        if len(spans) > MAX_SPANS:
            listed += "; …"
        return f"{hits.sum()} of {len(log)} readings, {listed}; up to {number(peak)} N."
    if found.threshold is not None:
        return "no contact force; moments were not looked at." if found.inertia else "no contact."
    if found.inertia and found.inertia.refuses:
        return f"the load's inertia is left in the moments, {number(moment, 2)} N m {noise}."
    explained = int((~found.off).sum())
    sentence = (
        f"{explained} of {len(log)} readings are explained, with {number(force, 2)} N and {number(moment, 2)} N m left "
        f"{noise}."
    )
    if explained == len(log):
        return sentence
    contacts = spell(Argument("false_alarms", Placeholder("1e-6"), option="contacts"))
    return f"{sentence} In the others something else acts; {contacts} lists when."


def _span(log: ReadingLog, first: int, last: int) -> str:
    if log.time is not None:
        return f"{seconds(log.time[first])} to {seconds(log.time[last])} s"
    return f"reading {first}" if first == last else f"readings {first} to {last}"


def _heading(log: ReadingLog, sign: str) -> Line:
    motion = "at rest" if log.V is None else "in motion"
    duration = ""
    if log.time is not None and len(log) > 1:
        duration = f" over {number(np.ptp(log.time))} s"
    return Line((Path(log.name).name, Style.STRONG), f"  {len(log)} readings{duration}, {motion}, sign {sign}")


def _readings_table(log: ReadingLog, compensated: Array, kept: Array) -> Table:
    """Root mean squares of the kept readings before and after compensation."""
    rms = [np.sqrt(np.mean(values**2, axis=0)) for values in (log.readings[kept], compensated[kept])]
    columns = []
    for axis, x in zip(WRENCH, np.transpose(rms), strict=True):
        columns.append(numbers(axis, x, partial(number, decimals=4), _unit(axis), headed=False))
    heading = f"Readings, root mean square [{heading_unit('tau', (True, False))}]"
    return Table(heading, words("", ["before", "after"], fold=False), *columns)


def _unit(axis: str) -> str:
    """Unit of a moment or a force."""
    return unit_of("tau", axis.startswith("m"))


def proposal_view(found: PoseProposal) -> Iterator[Block]:
    """Proposed orientations in measuring order; only the verdict if they do not determine the mass."""
    if found.doubts:
        yield Headline(found.verdict.word, str(found.doubts[0]))
        if not found.determines_mass:
            return
    else:
        mass, com = found.intervals[-1]
        intervals = f"mass ± {number(mass, 2)} kg, centre of mass ± {number(1e3 * com, 2)} mm (95 %)"
        load = f"a load of {number(found.mass)} kg"
        yield Headline(Word.OK, f"{len(found.poses)} orientations determine {load}: {intervals}.")
    yield ""
    show_coordinate, show_interval = partial(number, decimals=3), partial(number, digits=2)
    columns = [numbers(head, x, show_coordinate) for head, x in zip(POSE, found.poses.T, strict=True)]
    yield Table(
        "Next poses",
        words("no.", range(1, len(found.poses) + 1), fold=False),
        *columns,
        numbers("mass ±", found.intervals[:, 0], show_interval, "kg"),
        numbers("centre ±", 1e3 * found.intervals[:, 1], show_interval, "mm"),
        most=MAX_POSES_IN_SHORT,
        of_limits=False,
    )
    yield (
        "Orientations R_wf of the sensor's frame and gravity's direction in it; turns about the vertical are free.\n"
        f"± is what will be known (95 %) with all poses up to there, for a load of {number(found.mass)} kg; "
        "that of the centre\nis across the line to the sensor, along it add the share of the mass."
    )
