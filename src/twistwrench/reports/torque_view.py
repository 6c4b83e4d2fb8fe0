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

_FIGURE_DIGITS = 3
"""Digits of currents, voltages, speeds and powers."""
_MAX_FIGURE_DECIMALS = 6
"""Largest number of decimals of currents, voltages, speeds and powers; further decimals are rounding errors."""
_MAX_LISTED_MOTORS = 3
"""Largest number of motors that are listed as too small."""


def motors_table(motors: Sequence[MotorUse]) -> Table:
    """Table with one row per motor; limits are shown behind the values, exceeding values are red."""
    columns = [words("joint", [use.joint for use in motors])]
    # All motors have the same kinds of demands, in the same order. Each kind has a column.
    for k, first_demand in enumerate(motors[0].demands):
        name = first_demand.what.replace(" current", "")  # the unit says that it is a current
        demands = [use.demands[k] for use in motors]
        limits = [demand.limit for demand in demands]
        columns.append(numbers(name, map(_demand_cell, demands), unit=first_demand.unit, limits=limits))
    shares = np.array([use.tightest.share for use in motors])
    known_shares = np.where(shares == 0.0, np.nan, shares)  # without a limit a share is 0
    return Table(
        "Motors",
        *columns,
        numbers("power", [use.power for use in motors], _figure_text, "W", wide_only=True),
        numbers("heat", [use.heat for use in motors], _figure_text, "W", wide_only=True),
        numbers("used", known_shares.tolist(), share_cell),
        most=_MAX_ROWS,
        by=shares.tolist(),
    )


def _demand_cell(demand: Demand) -> Line:
    """Cell with a value, red beyond its limit, and the limit behind it; infinite limits are left out."""
    limit_text = ""
    if math.isfinite(demand.limit):
        limit_text = f" / {number(demand.limit, _FIGURE_DIGITS)}"
    style = Style.OVER if over_limit(demand.share) else ""
    return Line((_figure_text(demand.value), style), (limit_text, Style.QUIET), value=demand.value)


def _figure_text(value: float) -> str:
    """Text of a current, voltage, speed or power without its unit."""
    return number(value, _FIGURE_DIGITS, decimals=_MAX_FIGURE_DECIMALS)


def motors_verdict(motors: Sequence[MotorUse]) -> Line:
    """Line on the motors that are too small, or on the motor nearest to its limits."""
    uses_by_share = sorted(motors, key=lambda use: -use.tightest.share)  # the largest share first
    too_small = [use.words for use in uses_by_share if use.too_small]
    if too_small:
        text = listed(too_small, _MAX_LISTED_MOTORS, "; ")
        return Line(("MOTOR TOO SMALL", strong(Style.OVER)), f": {text}.")
    for use in uses_by_share:
        has_limit = any(math.isfinite(demand.limit) for demand in use.demands)
        if has_limit:
            return Line(("MOTORS OK", strong(Style.GOOD)), f": all limits kept. Closest: {use.words}.")
    return Line(("MOTORS", Style.STRONG), ": their limits are not known.")


def report_view(report: TorqueReport) -> Iterator[Block]:
    """Blocks of the report, verdict first."""
    yield verdict_view(report)
    yield ""
    yield _heading(report)
    if report.held.support is not None:
        yield from imbalance(report.held.support)
    yield _peaks_table(report)
    yield _causes_table(report)
    if report.bearings:
        yield _bearings_table(report.bearings)
    if report.held.support is not None:
        yield from contact_tables(report.held.support)
    if report.held.mounting is not None:
        yield from report.held.mounting.blocks()
    if report.held.grip is not None:
        yield report.held.grip.table()
    if report.with_why and report.worst is not None:
        yield _explanation_table(report, report.worst)
    if any(not m.dead for m in report.measured):  # dead: a sensor that reads the same value throughout
        yield _measured_table(report)
    if report.motors:
        yield motors_table(report.motors)
        yield motors_verdict(report.motors)
    motion_excesses = [excess for excess in report.excesses if excess.kind != "effort"]
    if motion_excesses:
        yield _motion_limits_table(motion_excesses, degrees=report.in_degrees)
    yield from remarks(notes_of(report))


def _heading(report: TorqueReport) -> Line:
    """Robot, motion, payloads, wrenches, and whether friction is counted."""
    load = report.load
    row_text = "1 row"
    if report.rows != 1:
        step_in_ms = 1e3 * report.quality.step
        row_text = f"{report.rows:,} rows at {number(step_in_ms)} ms"
    parts = [f"{Path(report.trajectory).name}: {number(report.end - report.begin)} s, {row_text}"]
    for payload in load.payloads:
        frame = payload.frame or load.robot.model.tip
        payload_text = f"payload {number(payload.mass)} kg at {frame}"
        if any(payload.place):
            payload_text += f" + {list(payload.place)} m"
        parts.append(payload_text)
    if not load.payloads:
        parts.append("no payload")
    for wrench_frame, wrench in load.wrenches.items():
        components = " ".join(map(number, wrench))
        parts.append(f"wrench on {wrench_frame} [{components}]")
    parts.append(friction_words(load.robot.model, counted=load.friction))
    return Line((report.robot, Style.STRONG), "  ", "  ·  ".join(parts))


_MAX_ROWS = 11
"""Largest number of rows of a table in a short report."""
_MAX_LIMIT_ROWS = 5
"""Largest number of rows of the table of exceeded limits of the motion, the last one, in a short report."""


def _torque_column(
    report: TorqueReport, name: str, values: Iterable[float | Line | None], show: Callable[[Any], Cell]
) -> Column:
    """Column of torques in a table with one row per joint. Its heading has no unit, since the table shows the unit."""
    units = sorted({j.unit for j in _driven_joints(report)})
    return numbers(name, values, show, ", ".join(units), headed=False)


def _joint_table(title: str, joints: Sequence[JointTorque], *columns: Column | None) -> Table:
    """Table with one row per joint. Its heading has the unit of the torques; if there are two units, a column has them.

    A short report shows the joints with the largest shares of their limits, or without limits those with the largest peaks.
    """
    units = [j.unit for j in joints]
    unit_column = None
    common_unit = ""
    if len(set(units)) == 1:
        common_unit = units[0]
    elif units:
        unit_column = words("unit", units, style=Style.QUIET)
    has_limits = any(math.isfinite(j.limit) for j in joints)
    ranks = [j.share if has_limits else abs(j.peak) for j in joints]
    return Table(
        title,
        words("joint", [j.joint for j in joints]),
        unit_column,
        *columns,
        unit=common_unit,
        most=_MAX_ROWS,
        by=ranks,
        of_limits=has_limits,
    )


def _driven_joints(report: TorqueReport) -> list[JointTorque]:
    """Joints of the tables: all, or without the floating base if the ground supports it."""
    if report.held.support is None:
        return list(report.joints)
    base_indices = base_velocities(report.load.robot.model)  # the report has a joint for each velocity
    return [joint for k, joint in enumerate(report.joints) if k not in base_indices]


def _peaks_table(report: TorqueReport) -> Table:
    """Table of the peak torques with their limits and times."""
    joints = _driven_joints(report)
    column = partial(_torque_column, report)
    share_bars: list[Cell] = []
    share_cells: list[Cell] = []  # in place of the bars in a narrow terminal
    for j in joints:
        if math.isfinite(j.limit):
            share_bars.append(Bar(j.share, f"  {percent_of_limit(j.share):>5}"))
            share_cells.append(share_cell(j.share))
        else:
            share_bars.append(Line((MISSING, Style.QUIET)))
            share_cells.append(Line((MISSING, Style.QUIET)))
    noise_columns: list[Column] = []
    if report.noisy:
        deviations = [report.reach(j) for j in joints]
        noise_columns.append(column("± 1σ", deviations, deviation))
    if report.derived is not None:  # of the unsmoothed log
        noise_columns.append(column("raw\npeak", [j.raw for j in joints], report.label))
    return _joint_table(
        "Torques",
        joints,
        column("peak", [j.peak for j in joints], report.label),
        *noise_columns,
        column("rms", [j.rms for j in joints], torque),
        column("limit", [j.limit for j in joints], cell_text),
        words("share of limit", share_bars, fold=False, narrow=numbers("of\nlimit", share_cells)),
        numbers("when", [j.time for j in joints], seconds, "s"),
    )


def _causes_table(report: TorqueReport) -> Table:
    """Table of the causes of the peak torques; causes that are zero in all joints have no column."""
    joints = _driven_joints(report)
    column = partial(_torque_column, report)
    columns = []
    for term in report.load.causes:
        if all(report.is_zero(j.terms[term]) for j in joints):
            continue
        cells = [_cause_cell(report, term, j) for j in joints]
        columns.append(column(cause_label(term), cells, cell_text))
    has_noise = any(abs(j.chance) > MIN_NOISE_SHARE * report.reference(j) for j in joints)
    if has_noise:
        columns.append(column("noise", [j.chance for j in joints], report.label))
    main_causes = [_main_cause_text(report, j) for j in joints]
    columns.append(words("mostly", main_causes, fold=False))
    return _joint_table("What the peak is made of", joints, *columns)


def _cause_cell(report: TorqueReport, term: str, j: JointTorque) -> Line:
    """Torque at a joint's peak by one cause, strong if it is the main cause."""
    main_term, _ = j.main_cause
    is_main = term == main_term and not report.is_zero(j.largest)
    torque_of_cause = j.terms[term]
    return Line((report.label(torque_of_cause), Style.STRONG if is_main else ""), value=torque_of_cause)


def _main_cause_text(report: TorqueReport, j: JointTorque) -> str:
    """Main cause of a peak and its share; a dash for a peak of zero."""
    if report.is_zero(j.largest):
        return MISSING
    main_term, share = j.main_cause
    return f"{cause_label(main_term)} {percent(share)}"


def _bearings_table(uses: Sequence[BearingUse]) -> Table:
    """Largest loads of bearings that have limits, with their shares."""
    shares = [use.share for use in uses]
    load_names = [f"{KINDS[use.kind]} [{BEARING_UNITS[use.kind]}]" for use in uses]
    return Table(
        "Bearings",
        words("joint", [use.joint for use in uses]),
        words("load", load_names, fold=False),
        numbers("largest", [use.value for use in uses], torque),
        numbers("limit", [use.limit for use in uses]),
        numbers("of limit", shares, share_cell),
        numbers("when", [use.time for use in uses], seconds, "s"),
        most=_MAX_ROWS,
        by=shares,
    )


def _measured_table(report: TorqueReport) -> Table:
    """Table of measured and computed torques, for joints whose sensor is not dead."""
    column = partial(_torque_column, report)
    measured_by_joint = {m.joint: m for m in report.measured if not m.dead}
    joints = [j for j in _driven_joints(report) if j.joint in measured_by_joint]
    measured = [measured_by_joint[j.joint] for j in joints]
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
    """Root mean square of the difference, coloured if the torques differ or contradict each other."""
    style = ""
    if m.contradicts:
        style = Style.OVER
    elif m.differs:
        style = Style.NEAR
    return Line((torque(m.residual), style), value=m.residual)


def _explanation_table(report: TorqueReport, k: int) -> Table:
    """Table of the torque of joint k at its peak, by link and by term."""
    joint = report.joints[k]
    states = report.around  # around the worst joint's peak
    peak_row = int(np.argmin(np.abs(states.time - joint.time)))
    explanation = report.load.explain(states[peak_row])
    if abs(joint.chance) > MIN_NOISE_SHARE * report.reference(joint):
        noise = np.zeros(len(report.joints))
        noise[k] = joint.chance
        explanation = explanation.with_term("noise", noise)
    (link_heading, *_), *rows = explanation.rows(explanation.joints[k])
    links, *columns_of_texts = zip(*rows, strict=True)  # a column for each term and for the sum
    link_indices = [explanation.causes.index(link) for link in links[:-1]]  # the last row is the sum
    torques = np.vstack([explanation.parts[:, link_indices, k].T, explanation.by_term[:, k]])  # (rows, terms)
    torques_and_sums = np.column_stack([torques, torques.sum(axis=1)])

    unit = explanation.units[k]
    columns = [words(link_heading, links)]
    names = [*explanation.terms, "together"]
    for name, texts, column_torques in zip(names, columns_of_texts, torques_and_sums.T.tolist(), strict=True):
        if set(texts) == {NEGLIGIBLE_PART}:  # a term without effect has no column
            continue
        columns.append(numbers(name, map(_part_cell, texts, column_torques), unit=unit, headed=False))
    detail = ""
    if report.load.payloads:
        detail = ", payload's part below each term"
    row_styles = [""] * (len(rows) - 1) + [Style.STRONG]  # the sum is strong
    title = f"Why {joint.joint} at t = {seconds(joint.time)} s"
    return Table(title, *columns, detail=detail, unit=unit, styles=row_styles)


def _part_cell(text: str, part: float) -> Cell:
    """Part of a torque; a negligible part has the mark of the explanation instead of its number."""
    if text == NEGLIGIBLE_PART:
        return Glyphs(text)
    return Line(torque(part), value=part)


_LIMIT_DIGITS = 5
"""Digits of values and limits of the motion."""
_LIMIT_LABELS = KINDS | {"lower": "position, lower", "upper": "position, upper"}
"""Quantity of each kind of limit; for position limits also the side."""


def _motion_limits_table(excesses: list[Excess], *, degrees: bool) -> Table:
    """Table of exceeded limits of the motion and of bearings."""
    units, labels, values, limits = [], [], [], []
    for excess in excesses:
        quantity = "dq" if excess.kind == "velocity" else "q"
        factor = math.degrees(1.0) if degrees and excess.angular else 1.0
        unit = BEARING_UNITS.get(excess.kind) or unit_of(quantity, excess.angular, degrees=degrees)
        units.append(unit)
        labels.append(f"{_LIMIT_LABELS[excess.kind]} [{unit}]")
        values.append(excess.value * factor)
        limits.append(excess.limit * factor)
    all_units = ", ".join(dict.fromkeys(units))
    column = partial(numbers, show=partial(number, digits=_LIMIT_DIGITS), unit=all_units, headed=False)
    return Table(
        "Motion limits passed",
        words("joint", [excess.joint for excess in excesses], fold=False),
        words("what", labels, fold=False),
        column("worst", values),
        column("limit", limits),
        numbers("when", [excess.time for excess in excesses], seconds, "s"),
        style=strong(Style.OVER),
        most=_MAX_LIMIT_ROWS,
    )
