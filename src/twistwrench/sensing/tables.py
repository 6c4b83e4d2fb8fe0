"""What the sensor commands print."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.box import SIMPLE_HEAD
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from ..report.usage import in_shell_words
from .contact import CollisionThreshold
from .identified import Identification
from .log import AXES, ReadingLog
from .outliers import runs
from .poses import PoseProposal

__all__ = ["compensation_view", "identification_view", "proposal_view"]


def identification_view(found: Identification, log: ReadingLog) -> RenderableType:
    """Everything that was found, with its confidence, and what it makes of the readings."""
    load, percent = found.sensor.load, 100 * found.confidence
    table = _table("Load and sensor", ["quantity", "unit"], ["value", f"± ({percent:g} %)"])
    low, high = found.mass_interval
    table.add_row("mass", "kg", _number(load.mass, 4), _number((high - low) / 2, 4))
    for axis, place, (low, high) in zip("xyz", load.com, found.com_intervals, strict=True):
        table.add_row(f"centre of mass {axis}", "mm", _number(1e3 * place, 2), _number(5e2 * (high - low), 2))
    names = found.fit.unknowns.names
    if found.fit.unknowns.inertia:
        about = load.moment_about_origin
        for name in [n for n in names if n.startswith("I")]:
            i, j = ("xyz".index(a) for a in name[1:])
            low, high = found.interval(name)
            table.add_row(f"{name} about the origin", "kg m²", _number(about[i, j], 5), _number((high - low) / 2, 5))
    for axis, value in zip(AXES, np.asarray(found.sensor.bias), strict=True):
        name, digits = f"bias {axis}", 4 if axis.startswith("m") else 3
        known = name in names
        half = np.ptp(found.interval(name)) / 2 if known else 0.0
        table.add_row(
            name, "N m" if axis[0] == "m" else "N", _number(value, digits), _number(half, digits) if known else "given"
        )
    if found.fit.unknowns.turn:
        for k, axis in enumerate("xyz"):
            half = math.degrees(np.ptp(found.interval(f"turn {axis}")) / 2)
            table.add_row(
                f"mounting turned about {axis}", "°", _number(math.degrees(found.turn[k]), 3), _number(half, 3)
            )
    parts: list[RenderableType] = [_heading(log, found.sensor.sign), table]
    parts.append(_before_and_after(log, log.compensated(found.sensor), found.kept))
    parts.append(Text(f"Noise of a reading: {found.noise[0]:.3g} N m, {found.noise[1]:.3g} N (1 σ)."))
    parts.extend(_remarks([*found.remarks, *found.doubts]))
    return Group(*parts, Text(), _verdict(found))


def _remarks(sentences: Sequence[str]) -> list[Text]:
    return [Text.assemble(("! ", "yellow"), in_shell_words(sentence)) for sentence in sentences]


def _verdict(found: Identification) -> Text:
    load = found.sensor.load
    low, high = found.mass_interval
    place = ", ".join(_number(1e3 * x, 1) for x in load.com)
    text = f": {load.mass:.4g} ± {(high - low) / 2:.2g} kg at ({place}) mm."
    if found.mass_interval[0] <= 0:
        text = f": {load.mass:.4g} ± {(high - low) / 2:.2g} kg, which may be nothing."
    return Text.assemble(("LOOK AGAIN", "bold red") if found.doubtful else ("OK", "bold green"), text)


def compensation_view(
    log: ReadingLog,
    sign: str,
    compensated: NDArray[np.float64],
    threshold: CollisionThreshold | None,
    doubts: Sequence[str] = (),
) -> RenderableType:
    """Readings before and after, and where something else acted."""
    parts: list[RenderableType] = [_heading(log, sign), _before_and_after(log, compensated, np.ones(len(log), bool))]
    parts.extend(_remarks(doubts))
    look = Text.assemble(("LOOK AGAIN", "bold red"), ": the log seems not to be of this sensor in these units.")
    if threshold is None:
        return Group(*parts, *([Text(), look] if doubts else []))
    hits = threshold(compensated)
    floor = threshold.per_axis
    parts.append(
        Text(
            f"Contact is what noise alone reaches once in {1 / threshold.false_alarms:,.0f} readings: from "
            f"{floor[:3].min():.3g} N m or {floor[3:].min():.3g} N on."
        )
    )
    if doubts:
        return Group(*parts, Text(), look)
    if not hits.any():
        return Group(*parts, Text(), Text.assemble(("OK", "bold green"), ": no contact."))
    spans = [_span(log, a, b) for a, b in runs(hits)]
    peak = np.linalg.norm(compensated[hits][:, 3:], axis=1).max()
    shown = "; ".join(spans[:5]) + ("; …" if len(spans) > 5 else "")
    text = f": {hits.sum()} of {len(log)} readings, {shown}; up to {peak:.3g} N."
    return Group(*parts, Text(), Text.assemble(("CONTACT", "bold red"), text))


def proposal_view(proposal: PoseProposal, quaternions: NDArray[np.float64], mass: float) -> RenderableType:
    """The orientations in the order to read them."""
    table = _table("Next poses", ["no."], ["qw", "qx", "qy", "qz", "gx", "gy", "gz", "mass ± [kg]", "centre ± [mm]"])
    unit = proposal.gravity / np.linalg.norm(proposal.gravity, axis=1, keepdims=True)
    for k in range(len(unit)):
        cells = [_number(x, 3) for x in (*quaternions[k], *unit[k])]
        known = (1.96 * proposal.mass_deviation[k], 1.96e3 * proposal.first_moment_deviation[k] / mass)
        table.add_row(str(k + 1), *cells, _number(known[0], 4), _number(known[1], 3))
    return Group(
        table,
        Text(
            "Orientations R_wf of the sensor's frame and gravity's direction in it; turns about the vertical are free.\n"
            f"± is what will be known (95 %) with all poses up to there, for a load of {mass:g} kg; that of the centre\n"
            "is across the line to the sensor, along it add the share of the mass."
        ),
    )


def _span(log: ReadingLog, first: int, last: int) -> str:
    if log.time is not None:
        return f"{log.time[first]:.3f} to {log.time[last]:.3f} s"
    return f"reading {first}" if first == last else f"readings {first} to {last}"


def _heading(log: ReadingLog, sign: str) -> Text:
    motion = "at rest" if log.V is None else "in motion"
    lasting = "" if log.time is None or len(log) < 2 else f" over {np.ptp(log.time):.4g} s"
    return Text.assemble((Path(log.name).name, "bold"), f"  {len(log)} readings{lasting}, {motion}, sign {sign}")


def _before_and_after(log: ReadingLog, compensated: NDArray[np.float64], kept: NDArray[np.bool_]) -> Table:
    table = _table("Readings, root mean square [N m, N]", [""], list(AXES))
    for name, values in (("before", log.readings[kept]), ("after", compensated[kept])):
        table.add_row(name, *(_number(x, 4 if k < 3 else 3) for k, x in enumerate(np.sqrt(np.mean(values**2, axis=0)))))
    return table


def _table(title: str, left: list[str], right: list[str]) -> Table:
    table = Table(box=SIMPLE_HEAD, title=title, title_justify="left", title_style="bold", pad_edge=False)
    for name in left:
        table.add_column(name, no_wrap=True)
    for name in right:
        table.add_column(name.replace("[", "\\["), justify="right", no_wrap=True)
    return table


def _number(value: float, digits: int) -> str:
    if not math.isfinite(value):
        return "unknown"
    text = f"{value:.{digits}f}"
    return (text[1:] if text.strip("-0.") == "" and text.startswith("-") else text).replace("-", "−")
