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
from .measured_torque import MeasuredTorque
from .motors import Demand, MotorUse
from .spoken_verdict import verdict_view
from .support.view import contact_tables, imbalance
from .torque_report import MIN_NOISE_SHARE, BearingUse, Excess, JointTorque, TorqueReport
from .torque_verdict import KINDS, notes_of

_DIGITS, _ROUNDING = 3, 6
"""Digits of currents, voltages, speeds and powers, and decimals below which they are rounding errors."""


def motors_table(motors: Sequence[MotorUse]) -> Table:
    """Table with one row per motor; limits are shown behind the values, exceeding values are red."""
    columns = [words("joint", [use.joint for use in motors])]
    for demands in zip(*(use.demands for use in motors), strict=True):
        name = demands[0].what.replace(" current", "")
        limits = [demand.limit for demand in demands]
        columns.append(numbers(name, map(_demand, demands), unit=demands[0].unit, limits=limits))
    shares = [use.tightest.share for use in motors]
    return Table(
        "Motors",
        *columns,
        numbers("power", [use.power for use in motors], _figure, "W", wide_only=True),
        numbers("heat", [use.heat for use in motors], _figure, "W", wide_only=True),
        numbers("used", [share or math.nan for share in shares], share_cell),
        most=_MAX_ROWS,
        by=shares,
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
        yield _measured_table(report)
    if report.motors:
        yield motors_table(report.motors)
        yield motors_verdict(report.motors)
    motion_excesses = [e for e in report.excesses if e.kind != "effort"]
    if motion_excesses:
        yield _motion_limits(motion_excesses, degrees=report.in_degrees)
    yield from remarks(notes_of(report))


def _heading(report: TorqueReport) -> Line:
    load = report.load
    rows = "1 row" if report.rows == 1 else f"{report.rows:,} rows"
    motion = f"{Path(report.trajectory).name}: {number(report.end - report.begin)} s, {rows}"
    if report.rows > 1:
        motion += f" at {number(1e3 * report.quality.step)} ms"
    parts = [motion]
    for payload in load.payloads:
        carried = f"payload {number(payload.mass)} kg at {payload.frame or load.robot.model.tip}"
        if any(payload.place):
            carried += f" + {list(payload.place)} m"
        parts.append(carried)
    if not load.payloads:
        parts.append("no payload")
    for frame, wrench in load.wrenches.items():
        parts.append(f"wrench on {frame} [{' '.join(map(number, wrench))}]")
    parts.append(friction_words(load.robot.model, counted=load.friction))
    return Line((report.robot, Style.STRONG), "  ", "  ·  ".join(parts))


_MAX_ROWS = 11
"""Rows of a table in a short report."""


def _torques(
    report: TorqueReport, name: str, values: Iterable[float | Line | None], show: Callable[[Any], Cell]
) -> Column:
    """Column of a table of joints; the unit is shown by the table."""
    units = sorted({j.unit for j in _driven_joints(report)})
    return numbers(name, values, show, ", ".join(units), headed=False)


def _joint_table(title: str, joints: Sequence[JointTorque], *columns: Column | None) -> Table:
    """Table with one row per joint; units are in its title, or beside the joints if there are two."""
    units = [j.unit for j in joints]
    unit_column = None
    if len(set(units)) == 1:
        title = f"{title} [{units[0]}]"
    elif units:
        unit_column = words("unit", units, style=Style.QUIET)
    limited = any(math.isfinite(j.limit) for j in joints)
    return Table(
        title,
        words("joint", [j.joint for j in joints]),
        unit_column,
        *columns,
        most=_MAX_ROWS,
        by=[j.share if limited else abs(j.peak) for j in joints],
        of_limits=limited,
    )


def _driven_joints(report: TorqueReport) -> list[JointTorque]:
    """Joints of the tables: all, or those that are driven if the ground bears the rest."""
    if report.held.support is None:
        return list(report.joints)
    borne = base_velocities(report.load.robot.model)
    return [joint for k, joint in enumerate(report.joints) if k not in borne]


def _peaks(report: TorqueReport) -> Table:
    joints, column = _driven_joints(report), partial(_torques, report)
    bars, shares = list[Cell](), list[Cell]()
    for j in joints:
        if math.isfinite(j.limit):
            bars.append(Bar(j.share, f"  {percent_of_limit(j.share):>5}"))
            shares.append(share_cell(j.share))
        else:
            bars.append(Line((MISSING, Style.QUIET)))
            shares.append(Line((MISSING, Style.QUIET)))
    noisy_columns = list[Column]()
    if report.noisy:
        noisy_columns.append(column("± 1σ", [report.reach(j) for j in joints], deviation))
    if report.derived is not None:
        noisy_columns.append(column("raw\npeak", [j.raw for j in joints], report.label))
    return _joint_table(
        "Torques",
        joints,
        column("peak", [j.peak for j in joints], report.label),
        *noisy_columns,
        column("rms", [j.rms for j in joints], torque),
        column("limit", [j.limit for j in joints], cell_text),
        words("share of limit", bars, fold=False, narrow=numbers("of\nlimit", shares)),
        numbers("when", [j.time for j in joints], seconds, "s"),
    )


def _causes(report: TorqueReport) -> Table:
    joints, column = _driven_joints(report), partial(_torques, report)

    def cause_cell(j: JointTorque, term: str) -> Line:
        main = term == j.main_cause[0] and not report.is_zero(j.largest)
        return Line((report.label(j.terms[term]), Style.STRONG if main else ""), value=j.terms[term])

    def main_cause_text(j: JointTorque) -> str:
        if report.is_zero(j.largest):
            return MISSING
        term, share = j.main_cause
        return f"{cause_label(term)} {percent(share)}"

    def term_column(term: str) -> Column:
        return column(cause_label(term), [cause_cell(j, term) for j in joints], cell_text)

    def matters(term: str) -> bool:
        return not all(report.is_zero(j.terms[term]) for j in joints)

    columns = [term_column(term) for term in report.load.causes if matters(term)]
    if any(abs(j.chance) > MIN_NOISE_SHARE * report.reference(j) for j in joints):
        columns.append(column("noise", [j.chance for j in joints], report.label))
    columns.append(words("mostly", map(main_cause_text, joints), fold=False))
    return _joint_table("What the peak is made of", joints, *columns)


def _bearings(uses: Sequence[BearingUse]) -> Table:
    """Largest loads of bearings that have limits, with their shares."""
    shares = [use.share for use in uses]
    return Table(
        "Bearings",
        words("joint", [use.joint for use in uses]),
        words("load", [f"{KINDS[use.kind]} [{BEARING_UNITS[use.kind]}]" for use in uses], fold=False),
        numbers("largest", [use.value for use in uses], torque),
        numbers("limit", [use.limit for use in uses]),
        numbers("of limit", shares, share_cell),
        numbers("when", [use.time for use in uses], seconds, "s"),
        most=_MAX_ROWS,
        by=shares,
    )


def _measured_table(report: TorqueReport) -> Table:
    """Table of measured and computed torques."""
    driven, column = {j.joint for j in _driven_joints(report)}, partial(_torques, report)
    joints, measured = [], []
    for j, m in zip(report.joints, report.measured, strict=True):
        if not m.dead and j.joint in driven:
            joints.append(j)
            measured.append(m)
    return _joint_table(
        "The file's own torques",
        joints,
        column("rms\ncomputed", [m.computed for m in measured], torque),
        column("rms\nmeasured", [m.measured for m in measured], torque),
        column("rms of\ndifference", map(_difference_cell, measured), cell_text),
        column("measured\npeak", [m.peak for m in measured], torque),
        numbers("when", [m.time for m in measured], seconds, "s"),
    )


def _difference_cell(m: MeasuredTorque) -> Line:
    style = ""
    if m.contradicts:
        style = Style.OVER
    elif m.differs:
        style = Style.NEAR
    return Line((torque(m.residual), style), value=m.residual)


def _why(report: TorqueReport, k: int) -> Table:
    """Peak of the worst joint by link and by term."""
    joint, states = report.joints[k], report.around
    why = report.load.explain(states[int(np.argmin(np.abs(states.time - joint.time)))])
    if abs(joint.chance) > MIN_NOISE_SHARE * report.reference(joint):
        why = why.with_term("noise", np.where(np.arange(len(report.joints)) == k, joint.chance, 0.0))
    heads, *rows = why.rows(why.joints[k])
    links, *terms = zip(*rows, strict=True)
    parts = np.array([why.parts[:, why.causes.index(link), k] for link in links[:-1]])
    parts = np.vstack([parts, why.by_term[:, k]])  # the last row and column are sums
    values = np.column_stack([parts, parts.sum(axis=1)])

    unit = heads[-1].partition("[")[2].rstrip("]")
    columns = [words(heads[0], links)]
    for head, texts, torques in zip(heads[1:], terms, values.T.tolist(), strict=True):
        if set(texts) != {NEGLIGIBLE_PART}:
            cells = map(_part, texts, torques)
            columns.append(numbers(head.partition(" [")[0], cells, unit=unit, headed=False))
    title = f"Why {joint.joint} at t = {seconds(joint.time)} s"
    if report.load.payloads:
        title += ", payload's part below each term"
    return Table(f"{title} [{unit}]", *columns, styles=[""] * (len(rows) - 1) + [Style.STRONG])


def _part(text: str, value: float) -> Cell:
    if text == NEGLIGIBLE_PART:
        return Glyphs(text)
    return Line(torque(value), value=value)


def _motion_limits(excesses: list[Excess], *, degrees: bool) -> Table:
    units, quantities, factors = [], [], []
    for e in excesses:
        coordinate = "dq" if e.kind == "velocity" else "q"
        unit = BEARING_UNITS.get(e.kind) or unit_of(coordinate, e.angular, degrees=degrees)
        units.append(unit)
        quantities.append(f"{_LIMIT_LABELS.get(e.kind, KINDS[e.kind])} [{unit}]")
        factors.append(math.degrees(1.0) if degrees and e.angular else 1.0)
    column = partial(numbers, show=lambda x: number(x, 5), unit=", ".join(dict.fromkeys(units)), headed=False)
    values = np.array([e.value for e in excesses]) * factors
    limits = np.array([e.limit for e in excesses]) * factors
    return Table(
        "Motion limits passed",
        words("joint", [e.joint for e in excesses], fold=False),
        words("what", quantities, fold=False),
        column("worst", values.tolist()),
        column("limit", limits.tolist()),
        numbers("when", [e.time for e in excesses], seconds, "s"),
        style=strong(Style.OVER),
        most=_MAX_ROWS // 2,
    )


_LIMIT_LABELS = {"lower": "position, lower", "upper": "position, upper"}
