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

from ...lie import so3
from ...sensing.compensation import Compensation, left_over
from ...sensing.identified import Identification
from ...sensing.log import AXES, ReadingLog
from ...sensing.outliers import runs
from ...sensing.poses import PoseProposal
from ...verdict import Word
from ..usage import in_shell_words

_WIDE = 0.1  # m; a centre of mass known no better is not told


def identification_view(found: Identification, log: ReadingLog) -> RenderableType:
    """Everything that was found, with its confidence, and what it makes of the readings."""
    load, percent = found.sensor.load, 100 * found.confidence
    table = _table("Load and sensor", ["quantity", "unit"], ["value", f"± ({percent:g} %)"])
    low, high = found.mass_interval
    table.add_row("mass", "kg", _number((high + low) / 2, 4), _number((high - low) / 2, 4))
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
    per, state = "s" if log.time is not None else "reading", found.fit.state
    for name in [n for n in names if n.startswith("drift")]:
        low, high = found.interval(name)
        unit = f"{'N m' if name[6] == 'm' else 'N'}/{per}"
        table.add_row(name, unit, f"{(low + high) / 2:.3g}".replace("-", "−"), f"{(high - low) / 2:.2g}")
    if found.fit.unknowns.tilt:
        half = max(np.ptp(found.interval(name)) / 2 for name in names if name.startswith("tilt"))
        tilt = math.degrees(np.linalg.norm(so3.log(state.tilt)))
        table.add_row("base tilted by", "°", _number(tilt, 3), _number(math.degrees(half), 3))
    if found.fit.unknowns.delay:
        half = np.ptp(found.interval("delay")) / 2
        table.add_row("readings are late by", "ms", _number(1e3 * state.delay, 2), _number(1e3 * half, 2))
    parts: list[RenderableType] = [_heading(log, found.sensor.sign), table]
    parts.append(_before_and_after(log, found.rest(log), found.kept))
    parts.append(Text(f"Noise of a reading: {found.noise[0]:.3g} N m, {found.noise[1]:.3g} N (1 σ)."))
    parts.extend(_remarks([*log.notes, *found.remarks, *found.doubts]))
    return Group(*parts, Text(), _verdict(found))


def _remarks(sentences: Sequence[str]) -> list[Text]:
    return [Text.assemble(("! ", "yellow"), in_shell_words(sentence)) for sentence in sentences]


def _verdict(found: Identification) -> Text:
    place = ", ".join(_number(1e3 * x, 1) for x in found.sensor.load.com)
    mass = found.mass_text.replace("-", "−")
    text = f": {mass} at ({place}) mm." if found.mass_interval[0] > 0 else f": {mass}, which may be nothing."
    word = found.verdict.word
    colour = {Word.OK: "bold green", Word.UNSURE: "bold yellow"}.get(word, "bold red")
    return Text.assemble((str(word), colour), text)


def compensation_view(found: Compensation) -> RenderableType:
    """Readings before and after, and where something else acted."""
    log = found.log
    parts: list[RenderableType] = [_heading(log, found.sensor.sign)]
    parts.append(_before_and_after(log, found.rest, np.ones(len(log), bool)))
    if found.threshold is not None:
        floor = found.threshold.per_axis
        least = [f"{x.min():.3g} {unit}" for x, unit in ((floor[:3], "N m"), (floor[3:], "N")) if np.isfinite(x).all()]
        parts.append(
            Text(
                f"Contact is what noise alone reaches once in {1 / found.threshold.false_alarms:,.0f} readings: from "
                f"{' or '.join(least)} on{'; moments are not looked at' if found.untold else ''}."
            )
        )
    parts.extend(_remarks([*log.notes, *([found.untold] if found.untold else []), *found.remarks, *found.doubts]))
    return Group(*parts, Text(), _outcome(found))


def _outcome(found: Compensation) -> Text:
    log, hits = found.log, found.hits
    verdict = found.verdict
    word = (str(verdict.word), "bold green" if verdict.ok else "bold red")
    if found.doubts:
        return Text.assemble(word, ": this sensor file does not explain this log.")
    moment, force = left_over(found.rest[~found.off])
    noise = f"beside noise of {found.noise[1]:.2g} N and {found.noise[0]:.2g} N m"
    if hits.any():
        spans = [_span(log, a, b) for a, b in runs(hits)]
        peak = np.linalg.norm(found.rest[hits][:, 3:], axis=1).max()
        shown = "; ".join(spans[:5]) + ("; …" if len(spans) > 5 else "")
        return Text.assemble(word, f": {hits.sum()} of {len(log)} readings, {shown}; up to {peak:.3g} N.")
    if found.threshold is not None:
        what = "no contact force; moments were not looked at" if found.untold else "no contact"
        return Text.assemble(word, f": {what}.")
    if found.untold_shows:
        return Text.assemble(word, f": the load's inertia is left in the moments, {moment:.2g} N m {noise}.")
    good = int((~found.off).sum())
    said = f": {good} of {len(log)} readings are explained, with {force:.2g} N and {moment:.2g} N m left {noise}."
    rest = "" if good == len(log) else " In the others something else acts; --contacts 1e-6 says when."
    return Text.assemble(word, said + rest)


def proposal_view(
    proposal: PoseProposal, quaternions: NDArray[np.float64], mass: float, untold: str | None
) -> RenderableType:
    """The orientations in the order to read them, unless they tell nothing."""
    verdict = Text.assemble(("LOOK AGAIN", "bold red"), f": {untold}") if untold else None
    table = _table("Next poses", ["no."], ["qw", "qx", "qy", "qz", "gx", "gy", "gz", "mass ± [kg]", "centre ± [mm]"])
    unit = proposal.gravity / np.linalg.norm(proposal.gravity, axis=1, keepdims=True)
    known = _known(proposal, mass)
    for k in range(len(unit)):
        cells = [_number(x, 3) for x in (*quaternions[k], *unit[k])]
        table.add_row(str(k + 1), *cells, _number(known[k, 0], 4), _number(1e3 * known[k, 1], 3))
    if verdict is not None and not known[-1, 0] < mass:
        return verdict
    return Group(
        table,
        Text(
            "Orientations R_wf of the sensor's frame and gravity's direction in it; turns about the vertical are free.\n"
            f"± is what will be known (95 %) with all poses up to there, for a load of {mass:g} kg; that of the centre\n"
            "is across the line to the sensor, along it add the share of the mass."
        ),
        *([Text(), verdict] if verdict else []),
    )


def cannot_tell(proposal: PoseProposal, mass: float, within: float | None) -> str | None:
    """Why all the poses together do not tell a load of about that mass [kg]; None if they do. ``within`` [°] if narrow."""
    heavy, out = _known(proposal, mass)[-1]
    if heavy < mass and out < _WIDE:
        return None
    what = "the centre of mass" + (f" (± {1e3 * out:.2g} mm)" if math.isfinite(out) else "")
    if not heavy < mass:  # a place is a first moment over the mass
        what = "the mass" + (f" (± {heavy:.2g} kg)" if math.isfinite(heavy) else "") + " or the centre of mass"
    count = len(proposal.gravity)
    those = f"{count} pose{'s' * (count > 1)}" + ("" if within is None else f" tilted by up to {within:g}°")
    way = "Ask for more of them" if within is None else "Allow larger tilts, such as --within 60"
    return f"{those} cannot tell {what} of a load of {mass:g} kg. {way}."


def _known(proposal: PoseProposal, mass: float) -> NDArray[np.float64]:
    """Half of the 95 % intervals (count, 2) of mass [kg] and centre of mass [m]."""
    return 1.96 * np.stack([proposal.mass_deviation, proposal.first_moment_deviation / mass], axis=1)


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
