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

_DIGITS = 3
"""Digits of currents, voltages, speeds and powers."""
_MAX_DECIMALS = 6
"""Decimals of these beyond which they are rounding errors."""
_MAX_LISTED_MOTORS = 3


def motors_table(motors: Sequence[MotorUse]) -> Table:
    """Table with one row per motor; limits are shown behind the values, exceeding values are red."""
    columns = [words("joint", [use.joint for use in motors])]
    for k, demand in enumerate(motors[0].demands):  # each motor has the same kinds of demands, a column for each
        name = demand.what.replace(" current", "")  # the unit tells it
        demands = [use.demands[k] for use in motors]
        limits = [demand.limit for demand in demands]
        columns.append(numbers(name, map(_demand_cell, demands), unit=demand.unit, limits=limits))
    shares = np.array([use.tightest.share for use in motors])
    known_shares = np.where(shares == 0.0, np.nan, shares)  # without a limit a share is 0
    return Table(
        "Motors",
        *columns,
        numbers("power", [use.power for use in motors], _figure, "W", wide_only=True),
        numbers("heat", [use.heat for use in motors], _figure, "W", wide_only=True),
        numbers("used", known_shares.tolist(), share_cell),
        most=_MAX_ROWS,
        by=shares.tolist(),
    )


def _demand_cell(demand: Demand) -> Line:
    """Value, red beyond its limit, and the limit behind it."""
    limit, style = "", ""
    if math.isfinite(demand.limit):
        limit = f" / {number(demand.limit, _DIGITS)}"
    if over_limit(demand.share):
        style = Style.OVER
    return Line((_figure(demand.value), style), (limit, Style.QUIET), value=demand.value)


def _figure(value: float) -> str:
    return number(value, _DIGITS, decimals=_MAX_DECIMALS)


def motors_verdict(motors: Sequence[MotorUse]) -> Line:
    """Line on the motors that are too small, or on the motor nearest to its limits."""
    by_share = sorted(motors, key=lambda use: -use.tightest.share)
    too_small = [use.words for use in by_share if use.too_small]
    if too_small:
        text = listed(too_small, _MAX_LISTED_MOTORS, "; ")
        return Line(("MOTOR TOO SMALL", strong(Style.OVER)), f": {text}.")
    for use in by_share:
        if any(math.isfinite(demand.limit) for demand in use.demands):
            return Line(("MOTORS OK", strong(Style.GOOD)), f": all limits kept. Closest: {use.words}.")
    return Line(("MOTORS", Style.STRONG), ": their limits are not known.")


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
    motion = f"{Path(report.trajectory).name}: {number(report.end - report.begin)} s, "
    if report.rows == 1:
        motion += "1 row"
    else:
        motion += f"{report.rows:,} rows at {number(1e3 * report.quality.step)} ms"
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
_MAX_LIMIT_ROWS = 5
"""Rows of the table of exceeded limits of the motion, which is the last, in a short report."""


def _torque_column(
    report: TorqueReport, name: str, values: Iterable[float | Line | None], show: Callable[[Any], Cell]
) -> Column:
    """Column of torques of a table of joints; the unit is shown by the table."""
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
    if limited:
        ranks = [j.share for j in joints]
    else:
        ranks = [abs(j.peak) for j in joints]
    return Table(
        title,
        words("joint", [j.joint for j in joints]),
        unit_column,
        *columns,
        most=_MAX_ROWS,
        by=ranks,
        of_limits=limited,
    )


def _driven_joints(report: TorqueReport) -> list[JointTorque]:
    """Joints of the tables: all, or those that are driven if the ground bears the rest."""
    if report.held.support is None:
        return list(report.joints)
    borne_rows = base_velocities(report.load.robot.model)  # torques have a row for each velocity
    return [joint for row, joint in enumerate(report.joints) if row not in borne_rows]


def _peaks(report: TorqueReport) -> Table:
    joints, column = _driven_joints(report), partial(_torque_column, report)
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
    joints, column = _driven_joints(report), partial(_torque_column, report)
    columns = []
    for term in report.load.causes:
        torques = [j.terms[term] for j in joints]
        if not all(map(report.is_zero, torques)):
            cells = map(partial(_cause_cell, report, term), joints)
            columns.append(column(cause_label(term), cells, cell_text))
    if any(abs(j.chance) > MIN_NOISE_SHARE * report.reference(j) for j in joints):
        columns.append(column("noise", [j.chance for j in joints], report.label))
    columns.append(words("mostly", map(partial(_main_cause_text, report), joints), fold=False))
    return _joint_table("What the peak is made of", joints, *columns)


def _cause_cell(report: TorqueReport, term: str, j: JointTorque) -> Line:
    """Torque of one cause, strong if it is the main one."""
    style = ""
    if term == j.main_cause[0] and not report.is_zero(j.largest):
        style = Style.STRONG
    return Line((report.label(j.terms[term]), style), value=j.terms[term])


def _main_cause_text(report: TorqueReport, j: JointTorque) -> str:
    """Main cause of a peak and its share; a dash for a peak of zero."""
    if report.is_zero(j.largest):
        return MISSING
    term, share = j.main_cause
    return f"{cause_label(term)} {percent(share)}"


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
    column = partial(_torque_column, report)
    measured_of = {m.joint: m for m in report.measured if not m.dead}
    joints = [j for j in _driven_joints(report) if j.joint in measured_of]
    measured = [measured_of[j.joint] for j in joints]
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
    nearest = int(np.argmin(np.abs(states.time - joint.time)))
    why = report.load.explain(states[nearest])
    if abs(joint.chance) > MIN_NOISE_SHARE * report.reference(joint):
        noise = np.zeros(len(report.joints))
        noise[k] = joint.chance
        why = why.with_term("noise", noise)
    (first_head, *heads), *rows = why.rows(why.joints[k])
    links, *columns_of_texts = zip(*rows, strict=True)  # a column for each term and for the sum
    shown_causes = list(map(why.causes.index, links[:-1]))  # the last row is the sum
    parts = np.vstack([why.parts[:, shown_causes, k].T, why.by_term[:, k]])
    values = np.column_stack([parts, parts.sum(axis=1)])

    unit = why.units[k]
    columns = [words(first_head, links)]
    for head, texts, torques in zip(heads, columns_of_texts, values.T.tolist(), strict=True):
        if set(texts) != {NEGLIGIBLE_PART}:  # a term without effect has no column
            cells = map(_part_cell, texts, torques)
            columns.append(numbers(head.removesuffix(f" [{unit}]"), cells, unit=unit, headed=False))
    title = f"Why {joint.joint} at t = {seconds(joint.time)} s"
    if report.load.payloads:
        title += ", payload's part below each term"
    return Table(f"{title} [{unit}]", *columns, styles=[""] * (len(rows) - 1) + [Style.STRONG])


def _part_cell(text: str, value: float) -> Cell:
    if text == NEGLIGIBLE_PART:
        return Glyphs(text)
    return Line(torque(value), value=value)


_LIMIT_LABELS = KINDS | {"lower": "position, lower", "upper": "position, upper"}
"""Quantity of each kind of limit, and the side of a position's."""


def _motion_limits(excesses: list[Excess], *, degrees: bool) -> Table:
    """Exceeded limits of the motion and of bearings."""
    units, quantities, values, limits = [], [], [], []
    for e in excesses:
        coordinate, factor = "q", 1.0
        if e.kind == "velocity":
            coordinate = "dq"
        if degrees and e.angular:
            factor = math.degrees(1.0)
        unit = BEARING_UNITS.get(e.kind) or unit_of(coordinate, e.angular, degrees=degrees)
        units.append(unit)
        quantities.append(f"{_LIMIT_LABELS[e.kind]} [{unit}]")
        values.append(e.value * factor)
        limits.append(e.limit * factor)
    column = partial(numbers, show=lambda x: number(x, 5), unit=", ".join(dict.fromkeys(units)), headed=False)
    return Table(
        "Motion limits passed",
        words("joint", [e.joint for e in excesses], fold=False),
        words("what", quantities, fold=False),
        column("worst", values),
        column("limit", limits),
        numbers("when", [e.time for e in excesses], seconds, "s"),
        style=strong(Style.OVER),
        most=_MAX_LIMIT_ROWS,
    )
