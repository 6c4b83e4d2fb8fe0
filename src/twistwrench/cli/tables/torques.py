"""The torque report as text: peaks and limits, what the peaks are made of, remarks on the log, and a verdict."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console, ConsoleOptions, RenderableType, RenderResult
from rich.table import Table
from rich.text import Text

from ...core.text import cause_label, number, spread
from ...report.loaded_robot import TERMS
from ...report.torque_findings import NEGLIGIBLE, Excess, JointTorque, TorqueReport
from ...report.torque_verdict import because
from ...verdict import Word
from .motors import motors_table, motors_verdict
from .style import title_line
from .torque_notes import notes

_BAR = 12
_BAR_FROM = 104
"""Columns of the console from which there is room for bars."""
_STYLES = {Word.OK: "bold green", Word.UNSURE: "bold yellow", Word.OVER_LIMIT: "bold red", Word.LOOK_AGAIN: "bold red"}


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
        for note in notes(report):
            yield Text.assemble(("! ", "yellow"), note)


def _heading(report: TorqueReport) -> Text:
    load = report.load
    carried = [
        f"payload {p.mass:g} kg at {p.frame or load.bare.model.tip}" + (f" + {list(p.place)} m" if any(p.place) else "")
        for p in load.payloads
    ] or ["no payload"]
    pushed = [f"wrench on {frame} [{' '.join(f'{x:g}' for x in F)}]" for frame, F in load.wrenches.items()]
    step = f" at {1e3 * report.quality.step:.4g} ms" if report.rows > 1 else ""
    rows = "1 row" if report.rows == 1 else f"{report.rows:,} rows"
    motion = f"{Path(report.trajectory).name}: {report.end - report.begin:.4g} s, {rows}{step}"
    friction = [] if load.friction else ["without friction"]
    if load.friction and not load.bare.model.friction.any:
        friction = ["no friction, as its file gives none"]
    return Text.assemble((f"{report.robot}", "bold"), "  ", "  ·  ".join([motion, *carried, *pushed, *friction]))


def _table(report: TorqueReport, title: str) -> Table:
    table = Table(box=SIMPLE_HEAD, title=title_line(title), title_justify="left", pad_edge=False)
    table.add_column("joint", overflow="fold")
    if len(_units(report)) > 1:
        table.add_column("unit", style="dim")
    return table


def _units(report: TorqueReport) -> list[str]:
    return sorted({j.unit for j in report.joints})


def _title(report: TorqueReport, text: str) -> str:
    units = _units(report)
    return f"{text} [{units[0]}]" if len(units) == 1 else text


def _cells(report: TorqueReport, joint: JointTorque) -> list[RenderableType]:
    return [Text(joint.joint), *([joint.unit] if len(_units(report)) > 1 else [])]


def _peaks(report: TorqueReport, *, bars: bool) -> Table:
    table = _table(report, _title(report, "Torques"))
    raw = report.derived is not None
    for name in ("peak", *(["± 1σ"] if report.noisy else []), *(["raw\npeak"] if raw else []), "rms", "limit"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("share of limit" if bars else "of\nlimit", no_wrap=True, justify="left" if bars else "right")
    table.add_column("when \\[s]", justify="right", no_wrap=True)
    for j in report.joints:
        doubt = [spread(report.reach(j))] if report.noisy else []
        doubt += [report.label(j.raw)] if j.raw is not None else []
        limit = f"{j.limit:.4g}" if math.isfinite(j.limit) else "none"
        share = _bar(j, _BAR if bars else 0)
        table.add_row(*_cells(report, j), report.label(j.peak), *doubt, number(j.rms), limit, share, f"{j.time:.3f}")
    return table


def _bar(joint: JointTorque, length: int) -> Text:
    if not math.isfinite(joint.limit):
        return Text("-", style="dim")
    filled = min(length, round(joint.share * length))
    style = "red" if joint.share > 1 else "yellow" if joint.share > 0.8 else "green"
    found = Text()
    if length:
        found.append("━" * filled, style).append("─" * (length - filled), "dim").append(" ")
    return found.append(f"{100 * joint.share:.0f} %".rjust(6 if length else 0), style)


def _split(report: TorqueReport) -> Table:
    table = _table(report, _title(report, "What the peak is made of"))
    shown = [term for term in TERMS if any(not report.is_zero(j.terms[term]) for j in report.joints)]
    for term in shown:
        table.add_column(cause_label(term), justify="right", no_wrap=True)
    chance = any(abs(j.chance) > NEGLIGIBLE * report.reference(j) for j in report.joints)
    if chance:
        table.add_column("noise", justify="right", no_wrap=True)
    table.add_column("mostly", no_wrap=True)
    for j in report.joints:
        main, share = j.main_cause
        some = not report.is_zero(j.largest)
        cells = [Text(report.label(j.terms[term]), style="bold" if term == main and some else "") for term in shown]
        cells += [Text(report.label(j.chance))] if chance else []
        table.add_row(*_cells(report, j), *cells, f"{cause_label(main)} {100 * share:.0f} %" if some else "-")
    return table


def _beside_measured(report: TorqueReport) -> Table:
    """The torques that the file has, and those computed."""
    table = _table(report, _title(report, "The file's own torques"))
    for head in ("rms\ncomputed", "rms\nmeasured", "rms of\ndifference", "measured\npeak", "when \\[s]"):
        table.add_column(head, justify="right", no_wrap=True)
    for j, m in zip(report.joints, report.measured, strict=True):
        if not m.dead:
            style = "red" if m.contradicts else "yellow" if m.differs else ""
            cells = (number(m.computed), number(m.measured), Text(number(m.residual), style=style), number(m.peak))
            table.add_row(*_cells(report, j), *cells, f"{m.time:.3f}")
    return table


def _why(report: TorqueReport, k: int) -> Table:
    """The worst joint's peak, by link and by term."""
    joint, states = report.joints[k], report.around
    why = report.load.explain(states.at(int(np.argmin(np.abs(states.time - joint.time)))))
    if abs(joint.chance) > NEGLIGIBLE * report.reference(joint):
        why = why.and_also("noise", np.where(np.arange(len(report.joints)) == k, joint.chance, 0.0))
    heads, *rows, together = why.rows(why.joints[k])
    apart = ", what the payload adds under the term it is" if report.load.payloads else ""
    title = f"Why {joint.joint} at t = {joint.time:.3f} s{apart}"
    table = Table(box=SIMPLE_HEAD, pad_edge=False, title=title, title_justify="left", title_style="bold")
    table.add_column(heads[0], no_wrap=True)
    for head in heads[1:]:
        table.add_column(Text(head), justify="right", no_wrap=True)
    for row in rows:
        table.add_row(*map(Text, row))
    table.add_row(*together, style="bold")
    return table


def _motion_limits(excesses: list[Excess], *, degrees: bool) -> Table:
    table = Table(
        box=SIMPLE_HEAD, title=title_line("Motion limits passed", "bold red"), title_justify="left", pad_edge=False
    )
    for name, side in (
        ("joint", "left"),
        ("what", "left"),
        ("worst", "right"),
        ("limit", "right"),
        ("when \\[s]", "right"),
    ):
        table.add_column(name, justify="right" if side == "right" else "left", no_wrap=True)
    for e in excesses:
        factor, unit = (180 / math.pi, e.unit.replace("rad", "deg")) if degrees and e.angular else (1.0, e.unit)
        what = {"lower": "position, lower", "upper": "position, upper"}.get(e.kind, e.kind)
        table.add_row(
            Text(e.joint), f"{what} \\[{unit}]", number(e.value * factor), number(e.limit * factor), f"{e.time:.3f}"
        )
    return table


def verdict_view(report: TorqueReport) -> Text:
    """The verdict with its reasons, the first beside it and each other on a line of its own."""
    verdict = report.verdict
    reasons = verdict.reasons or (_nearest(report),)
    style = _STYLES[verdict.word]
    text = Text.assemble((str(verdict.word), style), f": {reasons[0]}.")
    for reason in reasons[1:]:
        text.append(f"\n  - {reason}.")
    for hint in report.hints:
        text.append("\nIS THE UNIT RIGHT?", "bold yellow").append(f" {hint}.")
    return text


def _nearest(report: TorqueReport) -> str:
    """What an OK says besides."""
    limited = [j for j in report.joints if math.isfinite(j.limit)]
    if not limited:
        return "no limit is passed; torque limits are not known"
    j = max(limited, key=lambda j: j.share)
    if report.is_zero(j.largest):
        return "no limit is passed, and no joint has a torque to give"
    return f"nearest to its limit is {j.joint}, {100 * j.share:.0f} % at t = {j.time:.3f} s{because(j)}"
