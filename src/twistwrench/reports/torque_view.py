"""Torque report as blocks: verdict, peaks, causes, measured torques, motors and exceeded limits."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ..core.answers.blocks import (
    Bar,
    Block,
    Cell,
    Column,
    Glyphs,
    Line,
    Table,
    cell_text,
    numbers,
    remarks,
    share_cell,
    words,
)
from ..core.colours import Style, strong
from ..core.numbers import MISSING, deviation, number, over_limit, percent, percent_of_limit, seconds, torque
from ..core.text import listed
from ..mechanics.joints.units import unit_of
from ..mechanics.model.limits import BEARING_UNITS
from ..motion.load_case import cause_label
from ..motion.model_doubts import base_velocities, friction_words
from ..robot.explanation import NEGLIGIBLE_PART
from .log_quality import MeasuredTorque
from .motors import Demand, MotorUse
from .spoken_verdict import verdict_view
from .support.view import contact_tables, imbalance
from .torque_report import NEGLIGIBLE, BearingUse, Excess, JointTorque, TorqueReport
from .torque_verdict import KINDS, notes_of

# ── Motors

_DIGITS, _ROUNDING = 3, 6
"""Digits of currents, voltages, speeds and powers, and decimals below which they are rounding errors."""


def motors_table(motors: Sequence[MotorUse]) -> Table:
    """Table with one row per motor; limits are shown behind the values, exceeding values are red."""
    demands = zip(*(use.demands for use in motors), strict=True)
    return Table(
        "Motors",
        words("joint", [use.joint for use in motors]),
        *(
            numbers(d[0].what.replace(" current", ""), map(_demand, d), unit=d[0].unit, limits=[one.limit for one in d])
            for d in demands
        ),
        numbers("power", [use.power for use in motors], _figure, "W", wide_only=True),
        numbers("heat", [use.heat for use in motors], _figure, "W", wide_only=True),
        numbers("used", [use.tightest.share or math.nan for use in motors], share_cell),
        most=_MOST,
        by=[use.tightest.share for use in motors],
    )


def _demand(demand: Demand) -> Line:
    limit = f" / {number(demand.limit, _DIGITS)}" if math.isfinite(demand.limit) else ""
    red = Style.OVER if over_limit(demand.share) else ""
    return Line((_figure(demand.value), red), (limit, Style.QUIET), value=demand.value)


def _figure(value: float) -> str:
    return number(value, _DIGITS, decimals=_ROUNDING)


def motors_verdict(motors: Sequence[MotorUse]) -> Line:
    """Line on the motors that are too small, or on the motor nearest to its limits."""
    small = sorted((use for use in motors if use.too_small), key=lambda use: -use.tightest.share)
    if small:
        return Line(("MOTOR TOO SMALL", strong(Style.OVER)), f": {listed((use.words for use in small), 3, '; ')}.")
    known = [use for use in motors if any(math.isfinite(d.limit) for d in use.demands)]
    if not known:
        return Line(("MOTORS", Style.STRONG), ": their limits are not known.")
    nearest = max(known, key=lambda use: use.tightest.share)
    return Line(("MOTORS OK", strong(Style.GOOD)), f": all limits kept. Closest: {nearest.words}.")


# ── The report


def report_view(report: TorqueReport) -> Iterator[Block]:
    """Blocks of the report, verdict first."""
    yield verdict_view(report)
    yield ""
    yield _heading(report)
    if report.held.support is not None:
        yield from imbalance(report.held.support)
    yield _peaks(report)
    yield _causes(report)
    if report.bearings:
        yield _bearings(report.bearings)
    if report.held.support is not None:
        yield from contact_tables(report.held.support)
    if report.held.mounting is not None:
        yield from report.held.mounting.blocks()
    if report.held.grip is not None:
        yield report.held.grip.table()
    if report.with_why and report.worst is not None:
        yield _why(report, report.worst)
    if any(not m.dead for m in report.measured):
        yield _beside_measured(report)
    if report.motors:
        yield motors_table(report.motors)
        yield motors_verdict(report.motors)
    if passed := [e for e in report.excesses if e.kind != "effort"]:
        yield _motion_limits(passed, degrees=report.in_degrees)
    yield from remarks(notes_of(report))


def _heading(report: TorqueReport) -> Line:
    load = report.load
    carried = [
        f"payload {number(p.mass)} kg at {p.frame or load.robot.model.tip}"
        + (f" + {list(p.place)} m" if any(p.place) else "")
        for p in load.payloads
    ] or ["no payload"]
    pushed = [f"wrench on {frame} [{' '.join(map(number, F))}]" for frame, F in load.wrenches.items()]
    step = f" at {number(1e3 * report.quality.step)} ms" if report.rows > 1 else ""
    rows = "1 row" if report.rows == 1 else f"{report.rows:,} rows"
    motion = f"{Path(report.trajectory).name}: {number(report.end - report.begin)} s, {rows}{step}"
    friction = friction_words(load.robot.model, counted=load.friction)
    return Line((report.robot, Style.STRONG), "  ", "  ·  ".join([motion, *carried, *pushed, friction]))


_MOST = 11
"""Rows of a table in a short report."""


def _torques(
    report: TorqueReport, name: str, values: Iterable[float | Line | None], show: Callable[[Any], Cell]
) -> Column:
    """Column of a table of joints; the unit is shown by the table."""
    units = sorted({j.unit for j in _shown(report)})
    return numbers(name, values, show, ", ".join(units), headed=False)


def _joint_table(title: str, joints: Sequence[JointTorque], *columns: Column | None) -> Table:
    """Table with one row per joint; units are in its title, or beside the joints if there are two."""
    units, limited = sorted({j.unit for j in joints}), any(math.isfinite(j.limit) for j in joints)
    return Table(
        f"{title} [{units[0]}]" if len(units) == 1 else title,
        words("joint", [j.joint for j in joints]),
        words("unit", [j.unit for j in joints], style=Style.QUIET) if len(units) > 1 else None,
        *columns,
        most=_MOST,
        by=[j.share for j in joints] if limited else [abs(j.peak) for j in joints],
        of_limits=limited,
    )


def _shown(report: TorqueReport) -> list[JointTorque]:
    """Joints of the tables: all, or those that are driven if the ground bears the rest."""
    borne = base_velocities(report.load.robot.model) if report.held.support is not None else []
    return [joint for k, joint in enumerate(report.joints) if k not in borne]


def _peaks(report: TorqueReport) -> Table:
    joints, column = _shown(report), partial(_torques, report)

    unknown = Line((MISSING, Style.QUIET))
    known = [math.isfinite(j.limit) for j in joints]
    bars: list[Cell] = [Bar(j.share, f"  {percent_of_limit(j.share):>5}") for j in joints]
    bars = [bar if limited else unknown for bar, limited in zip(bars, known, strict=True)]
    shares = [share_cell(j.share) if limited else unknown for j, limited in zip(joints, known, strict=True)]
    return _joint_table(
        "Torques",
        joints,
        column("peak", [j.peak for j in joints], report.label),
        column("± 1σ", [report.reach(j) for j in joints], deviation) if report.noisy else None,
        column("raw\npeak", [j.raw for j in joints], report.label) if report.derived is not None else None,
        column("rms", [j.rms for j in joints], torque),
        column("limit", [j.limit for j in joints], cell_text),
        words("share of limit", bars, fold=False, narrow=numbers("of\nlimit", shares)),
        numbers("when", [j.time for j in joints], seconds, "s"),
    )


def _causes(report: TorqueReport) -> Table:
    joints, column = _shown(report), partial(_torques, report)

    def cause(j: JointTorque, term: str) -> Line:
        main = term == j.main_cause[0] and not report.is_zero(j.largest)
        return Line((report.label(j.terms[term]), Style.STRONG if main else ""), value=j.terms[term])

    def mostly(j: JointTorque) -> str:
        term, share = j.main_cause
        return MISSING if report.is_zero(j.largest) else f"{cause_label(term)} {percent(share)}"

    terms = [term for term in report.load.causes if any(not report.is_zero(j.terms[term]) for j in joints)]
    chance = any(abs(j.chance) > NEGLIGIBLE * report.reference(j) for j in joints)
    return _joint_table(
        "What the peak is made of",
        joints,
        *(column(cause_label(term), [cause(j, term) for j in joints], cell_text) for term in terms),
        column("noise", [j.chance for j in joints], report.label) if chance else None,
        words("mostly", map(mostly, joints), fold=False),
    )


def _bearings(uses: Sequence[BearingUse]) -> Table:
    """Largest loads of bearings that have limits, with their shares."""
    return Table(
        "Bearings",
        words("joint", [use.joint for use in uses]),
        words("load", [f"{KINDS[use.kind]} [{BEARING_UNITS[use.kind]}]" for use in uses], fold=False),
        numbers("largest", [use.value for use in uses], torque),
        numbers("limit", [use.limit for use in uses]),
        numbers("of limit", [use.share for use in uses], share_cell),
        numbers("when", [use.time for use in uses], seconds, "s"),
        most=_MOST,
        by=[use.share for use in uses],
    )


def _beside_measured(report: TorqueReport) -> Table:
    """Table of measured and computed torques."""
    shown_joints = {j.joint for j in _shown(report)}
    both = zip(report.joints, report.measured, strict=True)
    pairs = [(j, m) for j, m in both if not m.dead and j.joint in shown_joints]
    measured, column = [m for _, m in pairs], partial(_torques, report)

    def difference(m: MeasuredTorque) -> Line:
        return Line(
            (torque(m.residual), Style.OVER if m.contradicts else Style.NEAR if m.differs else ""), value=m.residual
        )

    return _joint_table(
        "The file's own torques",
        [j for j, _ in pairs],
        column("rms\ncomputed", [m.computed for m in measured], torque),
        column("rms\nmeasured", [m.measured for m in measured], torque),
        column("rms of\ndifference", map(difference, measured), cell_text),
        column("measured\npeak", [m.peak for m in measured], torque),
        numbers("when", [m.time for m in measured], seconds, "s"),
    )


def _why(report: TorqueReport, k: int) -> Table:
    """Peak of the worst joint by link and by term."""
    joint, states = report.joints[k], report.around
    why = report.load.explain(states[int(np.argmin(np.abs(states.time - joint.time)))])
    if abs(joint.chance) > NEGLIGIBLE * report.reference(joint):
        why = why.with_term("noise", np.where(np.arange(len(report.joints)) == k, joint.chance, 0.0))
    heads, *rows = why.rows(why.joints[k])
    apart = ", payload's part below each term" if report.load.payloads else ""
    unit = heads[-1].partition("[")[2].rstrip("]")
    links, *terms = zip(*rows, strict=True)
    parts = np.array([why.parts[:, why.causes.index(link), k] for link in links[:-1]])
    parts = np.vstack([parts, why.by_term[:, k]])  # the last row and column are sums
    values = np.column_stack([parts, parts.sum(axis=1)])
    return Table(
        f"Why {joint.joint} at t = {seconds(joint.time)} s{apart} [{unit}]",
        words(heads[0], links),
        *(
            numbers(
                head.partition(" [")[0],
                [_part(cell, x) for cell, x in zip(cells, column, strict=True)],
                unit=unit,
                headed=False,
            )
            for head, cells, column in zip(heads[1:], terms, values.T.tolist(), strict=True)
            if set(cells) != {NEGLIGIBLE_PART}
        ),
        styles=[""] * (len(rows) - 1) + [Style.STRONG],
    )


def _part(text: str, value: float) -> Cell:
    return Glyphs(text) if text == NEGLIGIBLE_PART else Line(torque(value), value=value)


def _motion_limits(excesses: list[Excess], *, degrees: bool) -> Table:
    def value(e: Excess, x: float) -> float:
        return x * (math.degrees(1.0) if degrees and e.angular else 1.0)

    units = [unit_of("dq" if e.kind == "velocity" else "q", e.angular, degrees=degrees) for e in excesses]
    units = [BEARING_UNITS.get(e.kind, unit) for e, unit in zip(excesses, units, strict=True)]
    kinds = [{"lower": "position, lower", "upper": "position, upper"}.get(e.kind, KINDS[e.kind]) for e in excesses]
    column = partial(numbers, show=lambda x: number(x, 5), unit=", ".join(dict.fromkeys(units)), headed=False)

    return Table(
        "Motion limits passed",
        words("joint", [e.joint for e in excesses], fold=False),
        words("what", [f"{kind} [{unit}]" for kind, unit in zip(kinds, units, strict=True)], fold=False),
        column("worst", [value(e, e.value) for e in excesses]),
        column("limit", [value(e, e.limit) for e in excesses]),
        numbers("when", [e.time for e in excesses], seconds, "s"),
        style=strong(Style.OVER),
        most=_MOST // 2,
    )
