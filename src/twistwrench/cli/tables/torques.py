"""The torque report as text: peaks and limits, what the peaks are made of, remarks on the log, and a verdict."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console, ConsoleOptions, RenderableType, RenderResult
from rich.text import Text

from ...core.printed_numbers import MISSING, deviation, number, percent, percent_of_limit, seconds, torque
from ...joints.units import unit_of
from ...report.base_force import force_remark
from ...report.estimates import INTERVAL
from ...report.loaded_robot import TERMS, cause_label
from ...report.model_doubts import assumed_words, assumptions
from ...report.payload_room import PayloadRoom
from ...report.torque_findings import NEGLIGIBLE, Excess, JointTorque, TorqueReport
from ...report.torque_verdict import because
from ...verdict import Word
from .motors import motors_table, motors_verdict
from .plain_table import PlainTable, friction_words, limit_style, remarks, share_bar, verdict_word
from .torque_notes import notes

_BAR = 12
_BAR_FROM = 80
"""Columns of the console from which there is room for bars."""


def report_view(report: TorqueReport, *, degrees: bool = False, why: bool = False) -> RenderableType:
    """The whole report, the verdict first.

    Angles in degrees if ``degrees``, and what each link does to the worst joint if ``why``.
    """
    return _View(report, degrees, why)


@dataclass(frozen=True, eq=False)
class _View:
    """The report, once the width it is printed in is known."""

    report: TorqueReport
    degrees: bool
    why: bool

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        report = self.report
        yield verdict_view(report)
        yield Text()
        yield _heading(report)
        yield _peaks(report, bars=options.max_width >= _BAR_FROM)
        yield _split(report)
        if self.why and report.worst is not None:
            yield _why(report, report.worst)
        if any(not m.dead for m in report.measured):
            yield _beside_measured(report)
        if report.motors:
            yield motors_table(report.motors)
            yield motors_verdict(report.motors)
        if moved := [e for e in report.excesses if e.kind != "effort"]:
            yield _motion_limits(moved, degrees=self.degrees)
        yield from remarks(notes(report))


def _heading(report: TorqueReport) -> Text:
    load = report.load
    carried = [
        f"payload {number(p.mass)} kg at {p.frame or load.bare.model.tip}"
        + (f" + {list(p.place)} m" if any(p.place) else "")
        for p in load.payloads
    ] or ["no payload"]
    pushed = [f"wrench on {frame} [{' '.join(map(number, F))}]" for frame, F in load.wrenches.items()]
    step = f" at {number(1e3 * report.quality.step)} ms" if report.rows > 1 else ""
    rows = "1 row" if report.rows == 1 else f"{report.rows:,} rows"
    motion = f"{Path(report.trajectory).name}: {number(report.end - report.begin)} s, {rows}{step}"
    friction = friction_words(load.bare.model, counted=load.friction)
    return Text.assemble((f"{report.robot}", "bold"), "  ", "  ·  ".join([motion, *carried, *pushed, friction]))


def _table(report: TorqueReport, title: str) -> PlainTable:
    units = _units(report)
    table = PlainTable(f"{title} [{units[0]}]" if len(units) == 1 else title)
    table.words("joint")
    if len(units) > 1:
        table.words("unit", style="dim")
    return table


def _units(report: TorqueReport) -> list[str]:
    return sorted({j.unit for j in report.joints})


def _names(report: TorqueReport, joint: JointTorque) -> list[str]:
    return [joint.joint, *([joint.unit] if len(_units(report)) > 1 else [])]


def _peaks(report: TorqueReport, *, bars: bool) -> PlainTable:
    table = _table(report, "Torques")
    raw = report.derived is not None
    table.numbers("peak", *(["± 1σ"] if report.noisy else []), *(["raw\npeak"] if raw else []), "rms", "limit")
    if bars:
        table.words("share of limit", fold=False)
    else:
        table.numbers("of\nlimit")
    table.numbers("when [s]")
    for j in report.joints:
        doubt = [deviation(report.reach(j))] if report.noisy else []
        doubt += [report.label(j.raw)] if j.raw is not None else []
        share = _share(j, _BAR if bars else 0)
        table.row(*_names(report, j), report.label(j.peak), *doubt, torque(j.rms), j.limit, share, seconds(j.time))
    return table


def _share(joint: JointTorque, length: int) -> Text:
    if not math.isfinite(joint.limit):
        return Text(MISSING, style="dim")
    said = f"{'  ' if length else ''}{percent_of_limit(joint.share):>{5 if length else 0}}"
    return share_bar(joint.share, length).append(said, limit_style(joint.share))


def _split(report: TorqueReport) -> PlainTable:
    table = _table(report, "What the peak is made of")
    shown = [term for term in TERMS if any(not report.is_zero(j.terms[term]) for j in report.joints)]
    chance = any(abs(j.chance) > NEGLIGIBLE * report.reference(j) for j in report.joints)
    table.numbers(*map(cause_label, shown), *(["noise"] if chance else []))
    table.words("mostly", fold=False)
    for j in report.joints:
        main, share = j.main_cause
        some = not report.is_zero(j.largest)
        cells = [Text(report.label(j.terms[term]), style="bold" if term == main and some else "") for term in shown]
        cells += [Text(report.label(j.chance))] if chance else []
        table.row(*_names(report, j), *cells, f"{cause_label(main)} {percent(share)}" if some else MISSING)
    return table


def _beside_measured(report: TorqueReport) -> PlainTable:
    """The torques that the file has, and those computed."""
    table = _table(report, "The file's own torques")
    table.numbers("rms\ncomputed", "rms\nmeasured", "rms of\ndifference", "measured\npeak", "when [s]")
    for j, m in zip(report.joints, report.measured, strict=True):
        if not m.dead:
            style = "red" if m.contradicts else "yellow" if m.differs else ""
            cells = (torque(m.computed), torque(m.measured), Text(torque(m.residual), style=style), torque(m.peak))
            table.row(*_names(report, j), *cells, seconds(m.time))
    return table


def _why(report: TorqueReport, k: int) -> PlainTable:
    """The worst joint's peak, by link and by term."""
    joint, states = report.joints[k], report.around
    why = report.load.explain(states.at(int(np.argmin(np.abs(states.time - joint.time)))))
    if abs(joint.chance) > NEGLIGIBLE * report.reference(joint):
        why = why.and_also("noise", np.where(np.arange(len(report.joints)) == k, joint.chance, 0.0))
    heads, *rows, together = why.rows(why.joints[k])
    apart = ", what the payload adds under the term it is" if report.load.payloads else ""
    unit = heads[-1].partition("[")[2].rstrip("]")
    told = [k for k, cells in enumerate(zip(*rows, together, strict=True)) if set(cells) != {"·"}]
    table = PlainTable(f"Why {joint.joint} at t = {seconds(joint.time)} s{apart} [{unit}]")
    table.words(heads[0])
    table.numbers(*(heads[k].partition(" [")[0] for k in told[1:]))
    for row in rows:
        table.row(*(row[k] for k in told))
    table.row(*(together[k] for k in told), style="bold")
    return table


def _motion_limits(excesses: list[Excess], *, degrees: bool) -> PlainTable:
    table = PlainTable("Motion limits passed", "bold red")
    table.words("joint", "what", fold=False)
    table.numbers("worst", "limit", "when [s]")
    for e in excesses:
        factor = math.degrees(1.0) if degrees and e.angular else 1.0
        what = {"lower": "position, lower", "upper": "position, upper"}.get(e.kind, e.kind)
        unit = unit_of("dq" if e.kind == "velocity" else "q", e.angular, degrees=degrees)
        table.row(
            e.joint, f"{what} [{unit}]", number(e.value * factor, 5), number(e.limit * factor, 5), seconds(e.time)
        )
    return table


def verdict_view(report: TorqueReport) -> Text:
    """The verdict with its reasons, the first beside it and each other on a line of its own."""
    verdict = report.verdict
    reasons = verdict.reasons or (_nearest(report),)
    said = ""
    if verdict.ok:
        held = report.differentiation.trajectory.held
        load = report.load
        said = assumed_words(assumptions(load.bare.model, load.payloads, held=held, friction=load.friction))
    text = Text.assemble(verdict_word(verdict.word), f": {reasons[0]}{said}.")
    for reason in reasons[1:]:
        text.append(f"\n  - {reason}.")
    if (room := _room(report)) is not None:
        text.append(f"\n{room.words}")
    for hint in report.hints:
        text.append("\nIS THE UNIT RIGHT?", "bold yellow").append(f" {hint}.")
    if remark := force_remark(report.load.loaded.model, report.joints):
        text.append("\nIS A CONTACT MISSING?", "bold yellow").append(f" {remark}")
    return text


def _room(report: TorqueReport) -> PayloadRoom | None:
    """How heavy the payload may be, where the verdict stands, and the peaks of a noisy log say no other."""
    if report.room is None or report.verdict.word not in (Word.OK, Word.OVER_LIMIT):
        return None
    fits = report.room.mass >= report.load.payloads[0].mass
    return report.room if fits != any(e.kind == "effort" for e in report.excesses) else None


def _nearest(report: TorqueReport) -> str:
    """What an OK says besides."""
    limited = [j for j in report.joints if math.isfinite(j.limit)]
    if not limited:
        return "no limit is passed, and no motor has a torque to give"
    j = max(limited, key=lambda j: j.share)
    if report.is_zero(j.largest):
        return "no limit is passed, and no joint has a torque to give"
    decides = report.derived is not None and report.derived.excesses
    sure = f" ± {percent(INTERVAL * report.reach(j) / j.limit, 2)} (95 %)" if decides else ""
    nearest = (
        f"nearest to its limit is {j.joint}, {percent_of_limit(j.share)}{sure} at t = {seconds(j.time)} s{because(j)}"
    )
    return "; ".join([nearest, *_left_aside(report)])


def _left_aside(report: TorqueReport) -> list[str]:
    """What an OK leaves aside of the log: its noise where that decides, and pauses in which the robot moves."""
    said = []
    if report.derived is not None and report.derived.excesses:
        count = len({e.joint for e in report.derived.excesses})
        said.append(f"noise is smoothed away, which as logged would take {count} joint{'s' * (count > 1)} over a limit")
    if report.gaps.hidden:
        said.append(report.gaps.hidden_words)
    return said
