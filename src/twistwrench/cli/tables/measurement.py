"""Tables of measurements: ``identify``, ``excite``, and the commands of the sensor."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Group, RenderableType
from rich.text import Text

from ...core.numbers import estimate, number, percent, percent_of_limit, plus_minus, quantity, seconds
from ...core.text import listed
from ...identification import ExcitingMotion, IdentifiedRobot
from ...joints.units import heading_unit, unit_of
from ...lie import so3
from ...lie.labelled import WRENCH
from ...motion.coordinates import Coordinates
from ...sensing.compensation import Compensation, left_over
from ...sensing.log import ReadingLog
from ...sensing.outliers import runs
from ...sensing.poses import PoseProposal
from ...sensing.result import Identification
from ..usage import with_option_names
from .plain_table import PlainTable, remarks, verdict_word

_KINDS = {"test": "in the logs of --test", "five-fold": "in fifths of the time, each predicted from the others"}
_VAGUE = 5


def identification_view(found: IdentifiedRobot, *, essential: bool = False) -> RenderableType:
    """The verdict first, then what it rests on; the essential groups where they are asked for."""
    return Group(*_parts(found), *(_essential(found) if essential else ()))


def _parts(found: IdentifiedRobot) -> Iterator[RenderableType]:
    verdict = found.verdict
    yield Text.assemble(
        verdict_word(verdict.word),
        f"  {found.original.name}: {percent(found.held_out.all, 3)} of the torques left {_KINDS[found.held_out.kind]}",
    )
    for doubt in found.doubts:
        yield Text(f"• {doubt.sentence}", "" if not doubt.refuses else "red")
    for note in found.notes:
        yield Text(note)
    yield Text(
        f"{found.settings}; weights {found.method}; deviations from blocks of {number(found.covariance.block)} s"
    )
    yield _residuals(found)
    yield from _payload(found)
    yield _groups(found)
    if found.base.held.any():
        yield Text(f"{int(found.base.held.sum())} parameters were held at known values")
    if vague := found.vague:
        names = listed((name.split(" ")[0] for name in vague), _VAGUE, "; ")
        yield Text(f"vague, deviation beyond 30 %: {names}")


def _payload(found: IdentifiedRobot) -> Iterator[Text]:
    payload = found.payload
    if payload is None:
        return
    com = ", ".join(plus_minus(x, d) for x, d in zip(payload.com, payload.com_deviations, strict=True))
    yield Text(
        f"payload at {payload.frame}: {plus_minus(payload.mass, payload.mass_deviation)} kg, centre of mass "
        f"({com}) m in its frame"
    )
    if payload.untold:
        yield Text(f"no torque of this robot tells {', '.join(payload.untold)}: taken as the file has it")


def _essential(found: IdentifiedRobot) -> Iterator[Text]:
    one = found.essential
    names = "; ".join(
        f"{name.split(' ')[0]} {number(value)}" for name, value in zip(one.names, one.values, strict=True)
    )
    yield Text(
        f"{len(one.names)} essential groups of {int((~found.base.held).sum())} predict rows held out to "
        f"{percent(one.held_out, 3)}, all to {percent(one.curve[0][1], 3)} (in units of each joint's residuals): {names}"
    )


def _residuals(found: IdentifiedRobot) -> PlainTable:
    table = PlainTable("Residuals of rows held out")
    table.words("joint")
    table.numbers("held out", f"size [{heading_unit('tau', Coordinates.of(found.original.model).angular_velocity)}]")
    for (name, share), sigma in zip(found.held_out.joints.items(), found.sigma, strict=True):
        table.row(name, percent(share, 3), sigma)
    return table


def _groups(found: IdentifiedRobot) -> PlainTable:
    table = PlainTable(f"{int((~found.base.held).sum())} groups of parameters")
    table.words("group")
    table.numbers("value", "deviation", "95 % from", "to", "file")
    rows = zip(found.groups, found.values, found.standard_deviations, found.interval(), found.prior.mean, strict=True)
    for held, (name, value, deviation, (low, high), before) in zip(found.base.held, rows, strict=True):
        if held:
            continue
        table.row(name, *estimate(value, deviation), low, high, before)
    return table


# ── ``excite``


def excitation_view(found: ExcitingMotion, *, degrees: bool) -> RenderableType:
    """The verdict, heading, a row per joint, and a row per group."""
    deviations = found.predicted_deviations
    return Group(
        *_verdict(found),
        Text(),
        Text.assemble(
            (found.robot.name, "bold"),
            f"  ·  {number(found.duration)} s, {found.series.harmonics} harmonics, at rest at both ends  ·  condition "
            f"{number(found.condition)}  ·  log det {number(found.log_det)}  ·  median deviation "
            f"{number(np.median(deviations), 2)}",
        ),
        _joints(found, degrees=degrees),
        _excited_groups(found),
    )


def _verdict(found: ExcitingMotion) -> list[Text]:
    """The first word, with the least distances or what makes it unsure, a line each."""
    words = {"itself": "of capsules around links from each other", "floor": "from the floor"}
    least = [f"{number(1000.0 * value)} mm {words[name]}" for name, value in found.clearances.items()]
    distances = f"least distances: {', '.join(least)}" if least else "nothing can touch"
    reasons = found.verdict.reasons or (distances,)
    lines = [Text.assemble(verdict_word(found.verdict.word), f": {reasons[0]}.")]
    lines += [Text(f"  - {reason}.") for reason in reasons[1:]]
    return lines + ([Text(f"{distances[0].upper()}{distances[1:]}.")] if found.verdict.reasons and least else [])


def _joints(found: ExcitingMotion, *, degrees: bool) -> PlainTable:
    robot, peaks = found.robot, found.peaks
    turning = Coordinates.of(robot.model).angular_velocity
    unit = np.where(turning & degrees, math.degrees(1.0), 1.0)
    place, speed, rate, torque = (heading_unit(part, turning, degrees=degrees) for part in ("q", "dq", "ddq", "tau"))
    table = PlainTable()
    table.words("joint", fold=False)
    table.numbers(f"from [{place}]", "to", f"peak [{speed}]", "share", f"[{rate}]", f"[{torque}]", "share")
    shares = [
        [
            percent_of_limit(v / m if math.isfinite(m) and m > 0 else None)
            for v, m in zip(peaks[part], limits, strict=True)
        ]
        for part, limits in (("velocity", robot.limits.velocity), ("torque", robot.limits.effort))
    ]
    for k, name in enumerate(robot.model.velocity_names):
        lower, upper, velocity, acceleration = (
            peaks[part][k] * unit[k] for part in ("lower", "upper", "velocity", "acceleration")
        )
        table.row(name, lower, upper, velocity, shares[0][k], acceleration, peaks["torque"][k], shares[1][k])
    return table


def _excited_groups(found: ExcitingMotion) -> PlainTable:
    base = found.information.base
    table = PlainTable(f"{base.count} groups of parameters, and how sure a log of the motion makes them")
    table.words("group")
    table.numbers("file", "deviation")
    file = base.project(base.unknown.file_values)
    for name, deviation, value in zip(found.groups, found.predicted_deviations, file, strict=True):
        table.row(name, value, number(deviation, 2))
    return table


# ── The commands of the sensor

_WIDE = 0.1  # m; a centre of mass known no better is not told


def sensor_identification_view(found: Identification, log: ReadingLog) -> RenderableType:
    """Everything that was found, with its confidence, and what it makes of the readings."""
    load = found.sensor.load
    table = PlainTable("Load and sensor")
    table.words("quantity", "unit", fold=False)
    table.numbers("value", f"± ({percent(found.confidence, 3)})")
    low, high = found.mass_interval
    table.row("mass", "kg", *estimate((high + low) / 2, (high - low) / 2))
    for axis, place, (low, high) in zip("xyz", load.com, found.com_intervals, strict=True):
        table.row(f"centre of mass {axis}", "mm", *estimate(1e3 * place, 5e2 * (high - low)))
    names = found.fit.unknowns.names
    if found.fit.unknowns.inertia:
        about = load.moment_about_origin
        for name in [n for n in names if n.startswith("I")]:
            i, j = ("xyz".index(a) for a in name[1:])
            low, high = found.interval(name)
            table.row(f"{name} about the origin", "kg m²", *estimate(about[i, j], (high - low) / 2))
    for axis, value in zip(WRENCH, np.asarray(found.sensor.bias), strict=True):
        name = f"bias {axis}"
        cells = estimate(value, np.ptp(found.interval(name)) / 2) if name in names else (value, "given")
        table.row(name, _unit(axis), *cells)
    if found.fit.unknowns.turn:
        for k, axis in enumerate("xyz"):
            half = math.degrees(np.ptp(found.interval(f"turn {axis}")) / 2)
            table.row(f"mounting turned about {axis}", "°", *estimate(math.degrees(found.turn[k]), half))
    per, state = "s" if log.time is not None else "reading", found.fit.state
    for name in [n for n in names if n.startswith("drift")]:
        low, high = found.interval(name)
        table.row(name, f"{_unit(name[6])}/{per}", *estimate((low + high) / 2, (high - low) / 2))
    if found.fit.unknowns.tilt:
        half = max(np.ptp(found.interval(name)) / 2 for name in names if name.startswith("tilt"))
        tilt = math.degrees(np.linalg.norm(so3.log(state.tilt)))
        table.row("base tilted by", "°", *estimate(tilt, math.degrees(half)))
    if found.fit.unknowns.delay:
        half = np.ptp(found.interval("delay")) / 2
        table.row("readings are late by", "ms", *estimate(1e3 * state.delay, 1e3 * half))
    reasons, others = _told(found, log.notes, found.remarks, found.doubts)
    parts: list[RenderableType] = [_verdict_of_sensor(found), *reasons, Text()]
    parts += [_heading(log, found.sensor.sign), table, _before_and_after(log, found.rest(log), found.kept)]
    parts.append(Text(f"Noise of a reading: {number(found.noise[0], 2)} N m, {number(found.noise[1], 2)} N (1 σ)."))
    return Group(*parts, *others)


def _told(found: Identification | Compensation, *sentences: tuple[str, ...]) -> tuple[list[Text], list[Text]]:
    """The reasons of the verdict, which stand below it, and all other sentences, which end the report."""
    said = [sentence for group in sentences for sentence in group]
    reasons = [sentence for sentence in said if sentence in found.verdict.reasons]
    others = [sentence for sentence in said if sentence not in reasons]
    return remarks(map(with_option_names, reasons)), remarks(map(with_option_names, others))


def _verdict_of_sensor(found: Identification) -> Text:
    place = ", ".join(number(1e3 * x, decimals=1) for x in found.sensor.load.com)
    mass = found.mass_text
    text = f": {mass} at ({place}) mm." if found.mass_interval[0] > 0 else f": {mass}, which may be nothing."
    return Text.assemble(verdict_word(found.verdict.word), text)


def compensation_view(found: Compensation) -> RenderableType:
    """Readings before and after, and where something else acted."""
    log = found.log
    missing = (found.missing_signals,) if found.missing_signals else ()
    reasons, others = _told(found, log.notes, missing, found.remarks, found.doubts)
    parts: list[RenderableType] = [_outcome(found), *reasons, Text()]
    parts += [_heading(log, found.sensor.sign), _before_and_after(log, found.rest, np.ones(len(log), bool))]
    if found.threshold is not None:
        floor = found.threshold.per_axis
        least = [
            quantity(x.min(), unit)
            for x, unit in ((floor[:3], _unit("m")), (floor[3:], _unit("f")))
            if np.isfinite(x).all()
        ]
        parts.append(
            Text(
                f"Contact is what noise alone reaches once in {number(1 / found.threshold.false_alarms)} readings: from "
                f"{' or '.join(least)} on{'; moments are not looked at' if found.missing_signals else ''}."
            )
        )
    return Group(*parts, *others)


def _outcome(found: Compensation) -> Text:
    log, hits = found.log, found.hits
    word = verdict_word(found.verdict.word)
    if found.doubts:
        return Text.assemble(word, ": this sensor file does not explain this log.")
    moment, force = left_over(found.rest[~found.off])
    noise = f"beside noise of {number(found.noise[1], 2)} N and {number(found.noise[0], 2)} N m"
    if hits.any():
        spans = [_span(log, a, b) for a, b in runs(hits)]
        peak = np.linalg.norm(found.rest[hits][:, 3:], axis=1).max()
        shown = "; ".join(spans[:5]) + ("; …" if len(spans) > 5 else "")
        return Text.assemble(word, f": {hits.sum()} of {len(log)} readings, {shown}; up to {number(peak)} N.")
    if found.threshold is not None:
        what = "no contact force; moments were not looked at" if found.missing_signals else "no contact"
        return Text.assemble(word, f": {what}.")
    if found.missing_signals_show:
        return Text.assemble(word, f": the load's inertia is left in the moments, {number(moment, 2)} N m {noise}.")
    good = int((~found.off).sum())
    said = f": {good} of {len(log)} readings are explained, with {number(force, 2)} N and {number(moment, 2)} N m left {noise}."
    rest = "" if good == len(log) else " In the others something else acts; --contacts 1e-6 says when."
    return Text.assemble(word, said + rest)


def proposal_view(
    proposal: PoseProposal, quaternions: NDArray[np.float64], mass: float, untold: str | None
) -> RenderableType:
    """The orientations in the order to read them, unless they tell nothing."""
    verdict = Text.assemble(("LOOK AGAIN", "bold red"), f": {untold}") if untold else None
    table = PlainTable("Next poses")
    table.words("no.", fold=False)
    table.numbers("qw", "qx", "qy", "qz", "gx", "gy", "gz", "mass ± [kg]", "centre ± [mm]")
    unit = proposal.gravity / np.linalg.norm(proposal.gravity, axis=1, keepdims=True)
    known = _known(proposal, mass)
    for k in range(len(unit)):
        cells = [number(x, decimals=3) for x in (*quaternions[k], *unit[k])]
        table.row(k + 1, *cells, number(known[k, 0], 2), number(1e3 * known[k, 1], 2))
    if verdict is not None and not known[-1, 0] < mass:
        return verdict
    return Group(
        *([verdict, Text()] if verdict else []),
        table,
        Text(
            "Orientations R_wf of the sensor's frame and gravity's direction in it; turns about the vertical are free.\n"
            f"± is what will be known (95 %) with all poses up to there, for a load of {number(mass)} kg; that of the centre\n"
            "is across the line to the sensor, along it add the share of the mass."
        ),
    )


def cannot_tell(proposal: PoseProposal, mass: float, within: float | None) -> str | None:
    """Why all the poses together do not tell a load of about that mass [kg]; None if they do. ``within`` [°] if narrow."""
    heavy, out = _known(proposal, mass)[-1]
    if heavy < mass and out < _WIDE:
        return None
    what = "the centre of mass" + (f" (± {number(1e3 * out, 2)} mm)" if math.isfinite(out) else "")
    if not heavy < mass:  # a place is a first moment over the mass
        what = "the mass" + (f" (± {number(heavy, 2)} kg)" if math.isfinite(heavy) else "") + " or the centre of mass"
    count = len(proposal.gravity)
    those = f"{count} pose{'s' * (count > 1)}" + ("" if within is None else f" tilted by up to {number(within)}°")
    way = "Ask for more of them" if within is None else "Allow larger tilts, such as --within 60"
    return f"{those} cannot tell {what} of a load of {number(mass)} kg. {way}."


def _known(proposal: PoseProposal, mass: float) -> NDArray[np.float64]:
    """Half of the 95 % intervals (count, 2) of mass [kg] and centre of mass [m]."""
    return 1.96 * np.stack([proposal.mass_deviation, proposal.first_moment_deviation / mass], axis=1)


def _span(log: ReadingLog, first: int, last: int) -> str:
    if log.time is not None:
        return f"{seconds(log.time[first])} to {seconds(log.time[last])} s"
    return f"reading {first}" if first == last else f"readings {first} to {last}"


def _heading(log: ReadingLog, sign: str) -> Text:
    motion = "at rest" if log.V is None else "in motion"
    lasting = "" if log.time is None or len(log) < 2 else f" over {number(np.ptp(log.time))} s"
    return Text.assemble((Path(log.name).name, "bold"), f"  {len(log)} readings{lasting}, {motion}, sign {sign}")


def _before_and_after(log: ReadingLog, compensated: NDArray[np.float64], kept: NDArray[np.bool_]) -> PlainTable:
    table = PlainTable(f"Readings, root mean square [{heading_unit('tau', (True, False))}]")
    table.words("", fold=False)
    table.numbers(*WRENCH)
    for name, values in (("before", log.readings[kept]), ("after", compensated[kept])):
        table.row(name, *(number(x, decimals=4) for x in np.sqrt(np.mean(values**2, axis=0))))
    return table


def _unit(axis: str) -> str:
    """Of a moment or a force."""
    return unit_of("tau", axis.startswith("m"))
