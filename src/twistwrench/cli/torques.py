"""The command ``twistwrench torques``: one motion to the report, many motions to a line each."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields, replace
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console, ConsoleOptions, RenderableType, RenderResult
from rich.text import Text

from ..core.files import check_outputs, picture_path, replacing
from ..core.numbers import MISSING, deviation, number, percent, percent_of_limit, quantity, seconds, torque
from ..core.text import listed
from ..core.third_party import Failure, workers_of
from ..core.verdict import ExitCode, Word
from ..errors import ValueRangeError
from ..joints.units import unit_of
from ..model.limits import Limits, over_limit
from ..motion.differentiation import Differentiation
from ..reports.load_case import (
    TERMS,
    LoadCase,
    PayloadMargin,
    cause_label,
    parse_payload,
    parse_wrenches,
)
from ..reports.motors import Demand, MotorUse, Steps
from ..reports.robot_summary import read_limits
from ..reports.statistics import INTERVAL
from ..reports.torque_report import NEGLIGIBLE, Excess, JointTorque, TorqueReport, analyse
from ..reports.torque_verdict import assumed_words, assumptions, because, force_remark, notes_of
from .console import check_matplotlib, expand_paths, progress_bar, show, show_written, worker_options
from .motion_options import LIMITS, loaded_motion_options, open_motion, refuse_motor_side
from .plain_table import PlainTable, friction_words, limit_style, remarks, share_bar, share_cell, verdict_word
from .robot_options import RobotOptions, motion_path, robot_command
from .usage import Given, option_group

_PLANNING, _PLANNING_AND_SMOOTHING = 0.25, 3.0
"""Time to estimate the noise of a motion, and to fit the smoothing, relative to the analysis."""


torques_options = option_group(
    click.option("--why", is_flag=True, help="Split the worst joint's peak by link, payload and rotor too."),
    click.option("--motor-plot", metavar="OUT.png", help="Draw what each motor does in its speed–torque region."),
    LIMITS,
    click.option(
        "--plot", "plot_path", metavar="OUT.png", help="Draw torques, limits, and the split of the worst joint."
    ),
    click.option("--split", is_flag=True, help="Write the causes of the torques too."),
    click.option("--csv", "csv_path", metavar="OUT.csv", help="Write time and torques."),
    worker_options,
    loaded_motion_options(required=True),
)
"""The options of the command, all but the robot's own."""


@robot_command(
    "torques",
    torques_options,
    examples=(
        "torques ur5 --trajectory demo --payload 10 --why",
        "torques ur5 --trajectory demo --payload 5 --csv torques.csv --plot torques.png",
    ),
)
def torques_command(options: RobotOptions, given: Given) -> ExitCode:
    """Torques of a motion: which joint is over its limit, and what causes it.

    The first word is the verdict. OK ends with exit code 0; OVER LIMIT, UNSURE and LOOK AGAIN with 1.
    """
    if given.split and given.csv_path is None:
        raise ValueRangeError("--split adds columns to the file of --csv, and there is none. Add --csv OUT.csv.")
    path = motion_path(options, given.trajectory)
    paths = expand_paths(path, given.trajectory)
    if paths != [str(path)] or given.workers is not None or given.scheduler is not None:
        if given.plot_path or given.motor_plot or given.split or given.why:
            raise ValueRangeError(
                "--plot, --motor-plot, --split and --why are of one motion. Give one file, and no --workers."
            )
        return run_batch(BatchTorques(options, given), paths)
    check_matplotlib(given.plot_path or given.motor_plot)
    given.plot_path = None if given.plot_path is None else picture_path(given.plot_path)
    given.motor_plot = None if given.motor_plot is None else picture_path(given.motor_plot)
    if given.motor_plot is not None and options.actuators is None:
        raise ValueRangeError("--motor-plot draws the motors, and none are described. Add --actuators FILE.yaml.")
    check_outputs(
        {"--csv": given.csv_path, "--plot": given.plot_path, "--motor-plot": given.motor_plot},
        {"--trajectory": path, "--limits": given.limits_path, **options.files},
    )
    with progress_bar(path.name) as progress:
        steps = Steps(progress, (_PLANNING_AND_SMOOTHING if given.smooth else _PLANNING, 1.0))
        report = analysis(options, given, path, steps, csv=given.csv_path, split=given.split)
    if given.smooth and not report.differentiation.derives:
        click.echo("note: --smooth changes nothing: the file gives velocities and accelerations.", err=True)
    show(report_view(report, degrees=options.degrees, why=given.why))
    _draw(report, given.plot_path, given.motor_plot, options.actuators)
    show_written(given.csv_path, given.plot_path, given.motor_plot)
    return report.verdict.exit_code


def _draw(report: TorqueReport, plot_path: str | None, motor_plot: str | None, actuators: object) -> None:
    """Draw the requested pictures."""
    if plot_path is not None:
        from ..plotting.torques import plot_report

        plot_report(report, plot_path)
    if motor_plot is not None:
        from ..plotting.torques import plot_motors

        if not report.motors:
            raise ValueRangeError(f"{actuators} describes no motor, so there is nothing to draw for --motor-plot.")
        plot_motors(report, motor_plot)


# ── Many motions: a folder or a pattern, on processes or a cluster


@dataclass(frozen=True)
class FileTorques:
    """Verdict on one motion, and the joint nearest to its limit or with the largest torque."""

    file: str
    verdict: str
    joint: str = ""
    peak: float = math.nan
    limit: float = math.nan
    unit: str = ""
    """Unit of peak and limit."""
    time: float = math.nan
    """Time of the peak [s]."""
    rows: int = 0
    reason: str = ""


@dataclass(frozen=True)
class BatchTorques:
    """The work on one file; it travels to other processes."""

    options: RobotOptions
    given: Given

    def evaluate(self, path: str) -> FileTorques:
        """Torques of the motion in that file."""
        report = analysis(self.options, self.given, Path(path), Steps(None, (1.0, 1.0)))
        found = FileTorques(path, str(report.verdict.word), rows=report.rows, reason="; ".join(report.verdict.reasons))
        if report.worst is None:
            return found
        worst = report.joints[report.worst]
        return replace(found, joint=worst.joint, peak=worst.peak, limit=worst.limit, unit=worst.unit, time=worst.time)


def analysis(
    options: RobotOptions, given: Given, path: Path, steps: Steps, *, csv: str | None = None, split: bool = False
) -> TorqueReport:
    """Report of one motion."""
    reading: dict[str, Any] = {"columns": given.columns, "rate": given.rate, "lock_missing": given.lock_missing}
    robot, read = open_motion(options.load_and_locked, path, degrees=options.degrees, **reading)
    refuse_motor_side(options, robot, "torques")
    carried = tuple(parse_payload(text, options.tip) for text in given.payloads)
    load = LoadCase(robot, carried, parse_wrenches(given.wrenches), friction=not given.no_friction)
    limits: Limits = robot.model.limits
    if given.limits_path is not None:
        limits = read_limits(given.limits_path, robot.model, degrees=options.degrees)
    plan = Differentiation.plan(read, robot.model, smoothing=given.smooth, progress=steps.next())
    return analyse(load, plan, limits, csv=csv, split=split, progress=steps.next())


def run_batch(work: BatchTorques, paths: Sequence[str]) -> ExitCode:
    """Print a line for each file, those that failed among them, and write the same as a table; 0 where all are OK."""
    check_outputs({"--csv": work.given.csv_path}, {**{f"MOTION {p}": p for p in paths}, **work.options.files})
    with (
        progress_bar(f"{len(paths)} motions") as progress,
        workers_of(work.given.workers, work.given.scheduler) as team,
    ):
        found = [
            FileTorques(path, "failed", reason=result.reason) if isinstance(result, Failure) else result
            for path, result in zip(paths, team.results(work.evaluate, paths, progress), strict=True)
        ]
    show(many_view(found))
    if work.given.csv_path is not None:
        with replacing(work.given.csv_path) as scratch, scratch.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file)
            writer.writerow([field.name for field in fields(FileTorques)])
            writer.writerows(astuple(one) for one in found)
    if all(one.verdict == "failed" for one in found):
        raise ValueRangeError(f"none of the {len(found)} motions can be read. The first: {found[0].reason}")
    return ExitCode.FINE if all(one.verdict == Word.OK for one in found) else ExitCode.NO


# ── The report


# ── Motors

_SHORT = {"peak current": "peak", "rms current": "rms"}
_DIGITS, _ROUNDING = 3, 6
"""Digits of currents, voltages, speeds and powers, and decimals below which they are rounding."""


def motors_table(motors: Sequence[MotorUse]) -> PlainTable:
    """A row per motor; limits stand behind the values, what passes one is red."""
    table = PlainTable("Motors")
    table.words("joint")
    table.numbers(
        *(f"{_SHORT.get(d.what, d.what)} [{d.unit}]" for d in motors[0].demands), "power [W]", "heat [W]", "used"
    )
    for use in motors:
        used = share_cell(use.tightest.share or math.nan)
        table.row(use.joint, *map(_cell, use.demands), _figure(use.power), _figure(use.heat), used)
    return table


def _cell(demand: Demand) -> Text:
    limit = f" / {number(demand.limit, _DIGITS)}" if math.isfinite(demand.limit) else ""
    return Text.assemble((_figure(demand.value), "red" if over_limit(demand.share) else ""), (limit, "dim"))


def _figure(value: float) -> str:
    return number(value, _DIGITS, decimals=_ROUNDING)


def motors_verdict(motors: Sequence[MotorUse]) -> Text:
    """One line: which motors are too small, by what; or which is nearest to its limits."""
    small = sorted((use for use in motors if use.too_small), key=lambda use: -use.tightest.share)
    if small:
        return Text.assemble(("MOTOR TOO SMALL", "bold red"), f": {listed((use.words for use in small), 3, '; ')}.")
    known = [use for use in motors if any(math.isfinite(d.limit) for d in use.demands)]
    if not known:
        return Text.assemble(("MOTORS", "bold"), ": their limits are not known.")
    return Text.assemble(
        ("MOTORS OK", "bold green"),
        f": nearest to its limits is {max(known, key=lambda use: use.tightest.share).words}.",
    )


# ── The report

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
        yield from remarks(notes_of(report))


def _heading(report: TorqueReport) -> Text:
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
    why = report.load.explain(states[int(np.argmin(np.abs(states.time - joint.time)))])
    if abs(joint.chance) > NEGLIGIBLE * report.reference(joint):
        why = why.with_term("noise", np.where(np.arange(len(report.joints)) == k, joint.chance, 0.0))
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
        said = assumed_words(assumptions(load.robot.model, load.payloads, held=held, friction=load.friction))
    text = Text.assemble(verdict_word(verdict.word), f": {reasons[0]}{said}.")
    for reason in reasons[1:]:
        text.append(f"\n  - {reason}.")
    if (margin := _payload_margin(report)) is not None:
        text.append(f"\n{margin.words}")
    for hint in report.hints:
        text.append("\nIS THE UNIT RIGHT?", "bold yellow").append(f" {hint}.")
    if remark := force_remark(report.load.with_load.model, report.joints):
        text.append("\nIS A CONTACT MISSING?", "bold yellow").append(f" {remark}")
    return text


def _payload_margin(report: TorqueReport) -> PayloadMargin | None:
    """Largest payload, if the verdict is certain and consistent with the peaks of a noisy log."""
    if report.payload_margin is None or report.verdict.word not in (Word.OK, Word.OVER_LIMIT):
        return None
    fits = report.payload_margin.mass >= report.load.payloads[0].mass
    return report.payload_margin if fits != any(e.kind == "effort" for e in report.excesses) else None


def _nearest(report: TorqueReport) -> str:
    """Joint nearest to its limit, for an OK."""
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
    """Reservations of an OK: noise that would decide, and motion during pauses."""
    said = []
    if report.derived is not None and report.derived.excesses:
        count = len({e.joint for e in report.derived.excesses})
        said.append(f"noise is smoothed away, which as logged would take {count} joint{'s' * (count > 1)} over a limit")
    if report.gaps.hidden:
        said.append(report.gaps.hidden_words)
    return said


# ── Many motions


def many_view(found: Sequence[FileTorques]) -> RenderableType:
    """Verdict, worst joint and why, of each file."""
    table = PlainTable()
    table.words("motion", "verdict", "joint")
    table.numbers("peak", "limit", "at")
    table.words("")
    for one in found:
        table.row(
            Path(one.file).name,
            verdict_word(one.verdict),
            one.joint,
            *(quantity(x, unit) for x, unit in ((one.peak, one.unit), (one.limit, one.unit), (one.time, "s"))),
            one.reason,
        )
    return table
