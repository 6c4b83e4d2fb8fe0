"""The torque report as text: peaks and limits, what the peaks are made of, remarks on the log, and a verdict."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console, ConsoleOptions, RenderableType, RenderResult
from rich.table import Table
from rich.text import Text

from ..model.model import BASE
from ..verdict import Word
from .coordinates import Coordinates
from .figures import cause_label, number, spread, title_line
from .findings import NEGLIGIBLE, Excess, JointTorque, TorqueReport
from .load import TERMS
from .motors_text import motors_table, motors_verdict
from .reasons import because

__all__ = ["notes", "report_view", "torque_label", "verdict_view"]

_BAR = 12
_BAR_FROM = 104
"""Columns of the console from which there is room for bars."""
_NOISY = 0.02
"""Share of a peak from which its noise is a reason to smooth."""
_MOST_LISTED = 4
_MANY_TURNS, _LONG_STEP = 4 * math.pi, 1.0
"""Angles [rad] and time steps [s] beyond which the unit is in doubt."""
_STYLES = {Word.OK: "bold green", Word.UNSURE: "bold yellow", Word.OVER_LIMIT: "bold red", Word.LOOK_AGAIN: "bold red"}


def report_view(report: TorqueReport, *, degrees: bool = False, why: bool = False) -> RenderableType:
    """The whole report, the verdict first; angles in degrees if ``degrees``, and what each link does to the worst joint if
    ``why``."""
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
    unsure = report.smoothed is not None
    for name in ("peak", *(["less\nnoise", "± 1σ"] if unsure else []), "rms", "limit"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("share of limit" if bars else "of\nlimit", no_wrap=True, justify="left" if bars else "right")
    table.add_column("when \\[s]", justify="right", no_wrap=True)
    for j in report.joints:
        likely = [torque_label(report, j.likely), spread(report.reach(j))] if unsure else []
        limit = f"{j.limit:.4g}" if math.isfinite(j.limit) else "none"
        share = _bar(j, _BAR if bars else 0)
        table.add_row(
            *_cells(report, j), torque_label(report, j.peak), *likely, number(j.rms), limit, share, f"{j.when:.3f}"
        )
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
    table.add_column("mostly", no_wrap=True)
    for j in report.joints:
        main, share = j.main_cause
        some = not report.is_zero(j.peak)
        cells = [
            Text(torque_label(report, j.terms[term]), style="bold" if term == main and some else "") for term in shown
        ]
        table.add_row(*_cells(report, j), *cells, f"{cause_label(main)} {100 * share:.0f} %" if some else "-")
    return table


def _why(report: TorqueReport, k: int) -> Table:
    """The worst joint's peak, by link and by term."""
    joint, states = report.joints[k], report.around
    why = report.load.explain(states.at(int(np.argmin(np.abs(states.time - joint.time)))))
    table = why.table(why.joints[k])
    table.box, table.pad_edge = SIMPLE_HEAD, False
    table.title, table.title_justify, table.title_style = f"Why {joint.joint} at t = {joint.time:.3f} s", "left", "bold"
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


def notes(report: TorqueReport) -> Iterator[str]:
    """Remarks on the log that bear on how far the figures can be trusted, a sentence or two each."""
    d, q = report.differentiation, report.quality
    derived = {"positions": "accelerations", "velocities": "accelerations (from the velocity columns)", "given": ""}[
        d.source
    ]
    what = " and ".join(x for x in ("velocities" if d.derives_velocities else "", derived) if x)
    if what:
        smoothed = ", after smoothing to the noise found" if d.strengths.any() else ""
        yield f"The file has no {what.split(' (')[0]}: derived by a quintic spline{smoothed}."
        yield from _quality_notes(report)
    if report.gaps.count:
        times = "time" if report.gaps.count == 1 else "times"
        yield (
            f"Time jumps {report.gaps.count} {times} by more than {report.gaps.threshold / q.step:.0f} usual steps; "
            f"the longest gap is {report.gaps.longest:.4g} s, after t = {report.gaps.longest_at:.4f} s."
            + (" Derived rates near gaps are guesses." if d.derives else "")
        )
    floating = {b.joint.name for b in report.load.bare.model.bodies if b.joint.kind == "floating"}
    if floating:
        yield f"Nothing drives {', '.join(floating)}: its rows are the wrench that contacts would have to give."
    unlimited = [
        j.joint for j in report.joints if not math.isfinite(j.limit) and j.joint.rpartition(".")[0] not in floating
    ]
    if unlimited:
        asked = report.limits is not report.load.bare.model.limits
        yield f"No torque limit is known for {', '.join(unlimited)}." + ("" if asked else " Give one with --limits.")
    if resting := [
        f"{p.frame or report.load.bare.model.tip}"
        for p in report.load.payloads
        if report.load.bare.model.frame(p.frame or report.load.bare.model.tip).body == BASE
    ]:
        yield f"The payload at {', '.join(resting)} rests on the fixed base and loads no joint."
    yield from _friction_notes(report)
    yield from _stray_notes(report)
    yield from _column_notes(report)
    yield from _unit_hints(report)


def _friction_notes(report: TorqueReport) -> Iterator[str]:
    friction = report.load.bare.model.friction.static
    found = [
        f"{j.joint} (±{friction[k]:.3g} {j.unit}, {100 * report.still[k]:.3g} % of the rows)"
        for k, j in enumerate(report.joints)
        if friction[k] > 0 and report.still[k] > 0
    ]
    if found and report.load.friction:
        yield (
            "Coulomb friction is undetermined for joints at rest within the noise of their derived velocities, and "
            f"left out there: {', '.join(found)}."
        )


def _stray_notes(report: TorqueReport) -> Iterator[str]:
    d = report.differentiation
    shown = []
    for s in report.strays[:_MOST_LISTED]:
        place = int(d.places[s.column])
        size = s.off / d.trajectory.columns.factors["dq" if d.source == "velocities" else "q"][s.column]
        count = f", {s.count} samples, the farthest" if s.count > 1 else ""
        shown.append(
            f"{d.trajectory.columns.header[place]}{count} at t = {s.time:.4f} s off by {size:.3g} "
            f"({abs(s.sigmas):.0f} σ)"
        )
    if shown:
        more = f"; and {len(report.strays) - len(shown)} columns more" if len(report.strays) > len(shown) else ""
        what = (
            "--smooth flattened samples"
            if d.strengths.any()
            else "the peaks less noise leave out samples, as --smooth would,"
        )
        yield (
            f"WARNING: {what} that noise does not explain: {'; '.join(shown)}{more}, in the file's "
            "unit. If the robot did move so, the torques there are far too low; if the log is wrong, remove the samples."
        )


def _column_notes(report: TorqueReport) -> Iterator[str]:
    yield from report.differentiation.trajectory.notes


def _unit_hints(report: TorqueReport) -> Iterator[str]:
    c = Coordinates.of(report.load.bare.model)
    if report.differentiation.trajectory.columns.in_radians and c.angular.any():
        at = c.position_of
        bounded = [
            c.velocity_names[k]
            for k in range(len(at))
            if at[k] >= 0 and c.angular[at[k]] and np.isfinite([report.limits.lower[k], report.limits.upper[k]]).any()
        ]
        over = {e.joint for e in report.excesses if e.kind in ("lower", "upper")} & set(bounded)
        far = int((report.largest[c.angular] > _MANY_TURNS).sum())
        if 2 * len(over) > len(bounded) or 2 * far > int(c.angular.sum()):
            yield "Most angles are far out. Is the file in degrees? Did you mean --degrees?"
    if report.quality.step > _LONG_STEP and not report.differentiation.trajectory.columns.time_stated:
        yield f"The usual time step is {report.quality.step:.4g} s. Is time in ms? It is taken to be in seconds."


def _quality_notes(report: TorqueReport) -> Iterator[str]:
    d, q = report.differentiation, report.quality
    if d.source == "given":
        return
    if report.smoothed is None:
        yield f"Noise of the log moves no torque by more than {100 * NEGLIGIBLE:g} % of its peak."
        return
    worst = int(q.noise.argmax())
    grid = f", on a grid of {q.quantum[worst]:.3g}" if q.quantum[worst] else ""
    joint = report.joints[int(d.sigma_ddq.argmax())]
    unit = "rad/s²" if joint.unit == "N m" else "m/s²"
    loudest = max(report.joints, key=lambda j: j.noise)
    late = report.smoothed.errors.stamp
    stamps = f", and stamps that are off by {1e3 * np.median(late[late > 0]):.2g} ms" if _stamps_matter(report) else ""
    yield (
        f"The log has noise of {q.noise[worst]:.2g} (1 σ, {d.trajectory.columns.header[d.places[worst]]}, "
        f"in the file's unit{grid}){stamps}. It makes accelerations unsure by {d.sigma_ddq.max():.2g} {unit} "
        f"({joint.joint}) and single torques by up to {spread(loudest.noise)} {loudest.unit} ({loudest.joint})."
    )
    yield (
        "The column less noise is the peak after smoothing to the noise found, less what noise adds to a largest value; "
        "± 1σ is its standard deviation. Shares of limits, and the verdict, are about it."
    )
    if ends := [j.joint for j in report.joints if report.at_an_end(j)]:
        yield (
            f"The peak of {', '.join(ends)} lies at an end of the log, where derived accelerations are several times "
            "as uncertain, for want of neighbours. Log a little more before and after."
        )
    if not d.strengths.any() and any(j.noise > _NOISY * report.reference(j) for j in report.joints):
        yield (
            f"Noise makes more than {100 * _NOISY:.0f} % of a peak as derived. Try --smooth, which also cleans the split, "
            "the CSV and the plot, or log velocities and accelerations as well."
        )


def _stamps_matter(report: TorqueReport) -> bool:
    """Whether most columns that move show that stamps are off, by more than their noise."""
    assert report.smoothed is not None
    errors = report.smoothed.errors
    moving = report.quality.noise > 0
    shows = errors.stamp > 0
    return bool(moving.any() and (shows & moving).sum() > 0.5 * moving.sum())


def verdict_view(report: TorqueReport) -> Text:
    """The verdict with its reasons, the first beside it and each other on a line of its own."""
    verdict = report.verdict
    reasons = verdict.reasons or (_nearest(report),)
    style = _STYLES[verdict.word]
    text = Text.assemble((str(verdict.word), style), f": {reasons[0]}.")
    for reason in reasons[1:]:
        text.append(f"\n  - {reason}.")
    return text


def _nearest(report: TorqueReport) -> str:
    """What an OK says besides."""
    limited = [j for j in report.joints if math.isfinite(j.limit)]
    if not limited:
        return "no limit is passed; torque limits are not known"
    j = max(limited, key=lambda j: j.share)
    if report.is_zero(j.peak):
        return "no limit is passed, and no joint has a torque to give"
    return f"nearest to its limit is {j.joint}, {100 * j.share:.0f} % at t = {j.when:.3f} s{because(j)}"


def torque_label(report: TorqueReport, value: float) -> str:
    """A torque with four digits; 0 for what is but rounding of the others."""
    return "0" if report.is_zero(value) else number(value)
