"""Answers about sensors as blocks: identified load, compensated readings, and proposed poses."""

from __future__ import annotations

import math
from collections.abc import Iterator
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
from .compensation import Compensation, left_over
from .log import ReadingLog
from .outliers import runs
from .poses import POSE, PoseProposal
from .result import Identification

_MOST_SPANS = 5
"""Number of contacts in the first line."""
_MOST_POSES = 30
"""Number of rows of the short form."""


def identification_view(found: Identification) -> Iterator[Block]:
    """Identified parameters with their intervals, and the compensated readings."""
    log = found.log
    reasons, others = _remarks(found, log.notes)
    place = ", ".join(number(1e3 * x, decimals=1) for x in found.sensor.load.com)
    where = f" at ({place}) mm." if found.mass_interval[0] > 0 else ", which may be nothing."
    yield Headline(found.verdict.word, f"{found.mass_text}{where}")
    yield from reasons
    yield ""
    yield _heading(log, found.sensor.sign)
    names, units, values, halves = zip(*_parameters(found), strict=True)
    every = ", ".join(dict.fromkeys(units))
    yield Table(
        "Load and sensor",
        words("quantity", names, fold=False),
        words("unit", units, fold=False),
        numbers("value", values, unit=every, headed=False),
        numbers(f"± ({percent(found.confidence, 3)})", halves, unit=every, headed=False),
    )
    yield _before_and_after(log, found.rest(log), found.kept)
    yield f"Noise of a reading: {number(found.noise[0], 2)} N m, {number(found.noise[1], 2)} N (1 σ)."
    yield from others


def _parameters(found: Identification) -> Iterator[tuple[Any, ...]]:
    """Name, unit, value and half-width of the interval of each parameter."""
    load, unknowns, state = found.sensor.load, found.fit.unknowns, found.fit.state

    def half(name: str) -> float:
        return float(np.ptp(found.interval(name))) / 2

    low, high = found.mass_interval
    yield "mass", "kg", *_estimate((high + low) / 2, (high - low) / 2)
    for axis, place, (low, high) in zip("xyz", load.com, found.com_intervals, strict=True):
        yield f"centre of mass {axis}", "mm", *_estimate(1e3 * place, 5e2 * (high - low))
    for name in [n for n in unknowns.names if unknowns.inertia and n.startswith("I")]:
        i, j = ("xyz".index(a) for a in name[1:])
        yield f"{name} about the origin", "kg m²", *_estimate(load.moment_about_origin[i, j], half(name))
    for axis, value in zip(WRENCH, np.asarray(found.sensor.bias), strict=True):
        name = f"bias {axis}"
        yield name, _unit(axis), *(_estimate(value, half(name)) if name in unknowns.names else (value, "given"))
    for k, axis in enumerate("xyz" if unknowns.turn else ""):
        turn = _estimate(math.degrees(found.turn[k]), math.degrees(half(f"turn {axis}")))
        yield f"mounting turned about {axis}", "°", *turn
    per = "s" if found.log.time is not None else "reading"
    for name in [n for n in unknowns.names if n.startswith("drift")]:
        low, high = found.interval(name)
        yield name, f"{_unit(name[6])}/{per}", *_estimate((low + high) / 2, (high - low) / 2)
    if unknowns.tilt:
        most = max(half(name) for name in unknowns.names if name.startswith("tilt"))
        tilt = math.degrees(np.linalg.norm(so3.log(state.tilt)))
        yield "base tilted by", "°", *_estimate(tilt, math.degrees(most))
    if unknowns.delay:
        yield "readings are late by", "ms", *_estimate(1e3 * state.delay, 1e3 * half("delay"))


def _estimate(value: float, sigma: float) -> Iterator[Line]:
    return (Line(text, value=x) for text, x in zip(estimate(value, sigma), (value, sigma), strict=True))


def _remarks(found: Identification | Compensation, notes: tuple[str, ...]) -> tuple[list[Remark], list[Remark]]:
    """Split doubts into reasons of the verdict and remarks at the end of the report, which include notes on the log."""
    reasons = [str(each) for each in found.doubts if str(each) in found.verdict.reasons]
    others = [*notes, *(str(each) for each in found.doubts if str(each) not in reasons)]
    return remarks(reasons), remarks(others)


# ── Compensated readings


def compensation_view(found: Compensation) -> Iterator[Block]:
    """Readings before and after compensation, and contacts."""
    log = found.log
    reasons, others = _remarks(found, log.notes)
    yield Headline(found.verdict.word, _outcome(found))
    yield from reasons
    yield ""
    yield _heading(log, found.sensor.sign)
    yield _before_and_after(log, found.rest, np.ones(len(log), bool))
    if found.threshold is not None:
        moment, force = found.threshold.per_axis[:3], found.threshold.per_axis[3:]
        least = [quantity(x.min(), _unit(axis)) for axis, x in (("m", moment), ("f", force)) if np.isfinite(x).all()]
        yield (
            f"Contact is what noise alone reaches once in {number(1 / found.threshold.false_alarms)} readings: from "
            f"{' or '.join(least)} on{'; moments are not looked at' if found.inertia else ''}."
        )
    yield from others


def _outcome(found: Compensation) -> str:
    log, hits = found.log, found.hits
    if not found.explained:
        return "this sensor file does not explain this log."
    moment, force = left_over(found.rest[~found.off])
    noise = f"beside noise of {number(found.noise[1], 2)} N and {number(found.noise[0], 2)} N m"
    if hits.any():
        spans = [_span(log, a, b) for a, b in runs(hits)]
        peak = np.linalg.norm(found.rest[hits][:, 3:], axis=1).max()
        shown = "; ".join(spans[:_MOST_SPANS]) + ("; …" if len(spans) > _MOST_SPANS else "")
        return f"{hits.sum()} of {len(log)} readings, {shown}; up to {number(peak)} N."
    if found.threshold is not None:
        return "no contact force; moments were not looked at." if found.inertia else "no contact."
    if found.inertia and found.inertia.refuses:
        return f"the load's inertia is left in the moments, {number(moment, 2)} N m {noise}."
    good = int((~found.off).sum())
    contacts = spell(Argument("false_alarms", Placeholder("1e-6"), option="contacts"))
    rest = "" if good == len(log) else f" In the others something else acts; {contacts} lists when."
    left = f"{number(force, 2)} N and {number(moment, 2)} N m left {noise}"
    return f"{good} of {len(log)} readings are explained, with {left}.{rest}"


def _span(log: ReadingLog, first: int, last: int) -> str:
    if log.time is not None:
        return f"{seconds(log.time[first])} to {seconds(log.time[last])} s"
    return f"reading {first}" if first == last else f"readings {first} to {last}"


def _heading(log: ReadingLog, sign: str) -> Line:
    motion = "at rest" if log.V is None else "in motion"
    lasting = "" if log.time is None or len(log) < 2 else f" over {number(np.ptp(log.time))} s"
    return Line((Path(log.name).name, Style.STRONG), f"  {len(log)} readings{lasting}, {motion}, sign {sign}")


def _before_and_after(log: ReadingLog, compensated: Array, kept: Array) -> Table:
    rms = [np.sqrt(np.mean(values**2, axis=0)) for values in (log.readings[kept], compensated[kept])]
    return Table(
        f"Readings, root mean square [{heading_unit('tau', (True, False))}]",
        words("", ["before", "after"], fold=False),
        *(
            numbers(axis, x, lambda value: number(value, decimals=4), _unit(axis), headed=False)
            for axis, x in zip(WRENCH, np.transpose(rms), strict=True)
        ),
    )


def _unit(axis: str) -> str:
    """Unit of a moment or a force."""
    return unit_of("tau", axis.startswith("m"))


# ── Proposed poses


def proposal_view(found: PoseProposal) -> Iterator[Block]:
    """Proposed orientations in measuring order; only the verdict if they do not determine the mass."""
    if found.doubts:
        yield Headline(found.verdict.word, str(found.doubts[0]))
        if not found.determines_mass:
            return
    else:
        mass, place = found.intervals[-1]
        sure = f"mass ± {number(mass, 2)} kg, centre of mass ± {number(1e3 * place, 2)} mm (95 %)"
        yield Headline(Word.OK, f"{len(found.poses)} orientations determine a load of {number(found.mass)} kg: {sure}.")
    yield ""
    yield Table(
        "Next poses",
        words("no.", range(1, len(found.poses) + 1), fold=False),
        *(
            numbers(head, x, lambda value: number(value, decimals=3))
            for head, x in zip(POSE, found.poses.T, strict=True)
        ),
        numbers("mass ±", found.intervals[:, 0], lambda value: number(value, 2), "kg"),
        numbers("centre ±", 1e3 * found.intervals[:, 1], lambda value: number(value, 2), "mm"),
        most=_MOST_POSES,
        of_limits=False,
    )
    yield (
        "Orientations R_wf of the sensor's frame and gravity's direction in it; turns about the vertical are free.\n"
        f"± is what will be known (95 %) with all poses up to there, for a load of {number(found.mass)} kg; "
        "that of the centre\nis across the line to the sensor, along it add the share of the mass."
    )
