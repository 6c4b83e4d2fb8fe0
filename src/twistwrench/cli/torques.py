"""The command ``twistwrench torques``: report of one motion, one line each for many motions."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..answers.blocks import (
    Bar,
    Block,
    Cell,
    Column,
    Glyphs,
    Line,
    Table,
    mark_style,
    numbers,
    remarks,
    share_cell,
    shown,
    word_cell,
    words,
)
from ..core.colours import Style, strong
from ..core.doubts import Doubt
from ..core.errors import ValueRangeError
from ..core.files import picture_path
from ..core.numbers import MISSING, deviation, number, percent, percent_of_limit, quantity, seconds, torque
from ..core.text import listed
from ..core.third_party import Failure, workers_of
from ..core.verdict import ExitCode, Word
from ..mechanics.joints.units import unit_of
from ..mechanics.model.limits import over_limit
from ..motion.differentiation import Differentiation
from ..motion.limits_file import read_limits
from ..motion.load_case import TERMS, cause_label
from ..motion.log_table import excerpts
from ..motion.motion_log import MotionLog
from ..reports.log_quality import MeasuredTorque
from ..reports.motors import Demand, MotorUse, Steps
from ..reports.spoken_verdict import verdict_view
from ..reports.torque_report import NEGLIGIBLE, Excess, JointTorque, TorqueReport, analyse
from ..reports.torque_verdict import friction_words, notes_of, verdict_of
from ..robot.explanation import NEGLIGIBLE_PART
from . import shared
from .main import Given, check_matplotlib, note, option
from .report import PAGE, REPORT, MarkedJoint, drawn, robot_picture, write_report, write_viewer
from .shared import RobotOptions, robot_command
from .terminal import progress_bar, show

if TYPE_CHECKING:
    from ..reports.drawn_motion import DrawnMotion

_PLANNING, _PLANNING_AND_SMOOTHING = 0.25, 3.0
"""Durations of noise estimation and smoothing relative to the analysis."""


_PLOTS = ("torques", "causes", "power", "phase", "motors")


@robot_command(
    "torques",
    shared.loaded_motion_options(required=True),
    shared.worker_options,
    shared.csv_option("Write time and torques as a table"),
    shared.JSON,
    option("--split", "Add the causes of the torques to the table of --csv."),
    option(
        "--plot [KIND=]OUT.png",
        f"Draw the motion (.png, .pdf or .svg); KIND: {', '.join(_PLOTS)}; may be repeated. [default KIND: torques]",
        "plots",
        multiple=True,
    ),
    option(
        "--joint JOINT",
        "Joint to draw in --plot causes= and phase=; may be repeated. [default: all]",
        "joints",
        multiple=True,
    ),
    shared.LIMITS,
    shared.CLEARANCE,
    option("--mcap OUT.mcap", "Write states, torques, causes and limits as a ROS 2 recording, for Foxglove."),
    option("--rerun OUT.rrd", "Write the same for rerun."),
    REPORT,
    PAGE,
    shared.VERBOSE,
    option("--why", "Split the peak of the worst joint by link, payload and rotor."),
    examples=(
        "torques ur5 --trajectory demo --payload 10 --why",
        "torques ur5 --trajectory demo --payload 5 --csv torques.csv --plot torques.png",
    ),
)
def torques_command(options: RobotOptions, given: Given) -> ExitCode:
    """Compute the torques of a motion, compare them with the limits, and split them by cause.

    The first word is the verdict. Exit code: 0 for OK; 1 for OVER LIMIT, COLLISION, UNSURE and LOOK AGAIN.
    """
    if given.split and given.csv is None:
        raise ValueRangeError("--split adds columns to the file of --csv, and there is none. Add --csv OUT.csv.")
    path = shared.motion_path(options, given.trajectory)
    given.logs = paths = shared.expand_paths(path, given.trajectory)
    if paths != [str(path)] or given.workers is not None or given.scheduler is not None:
        if any((given.plots, given.split, given.why, given.mcap, given.rerun, given.report, given.html)):
            raise ValueRangeError(
                "--plot, --split, --why, --mcap, --rerun, --report and --html are of one motion. Give one file, and no "
                "--workers."
            )
        return run_batch(BatchTorques(options, given), paths)
    plots = _parse_plots(given.plots)
    if "motors" in plots and options.actuators is None:
        raise ValueRangeError("--plot motors=… draws the motors, and none are described. Add --actuators FILE.yaml.")
    if given.joints and not {"causes", "phase"} & plots.keys():
        raise ValueRangeError("--joint selects panels of --plot causes=… and phase=…. Add one of them.")
    files = {"--trajectory": path, "--limits": given.limits, "--srdf": given.srdf, **options.files}
    given.check_files(files, **{f"plot {kind}": picture for kind, picture in plots.items()})
    if given.mcap is not None or given.rerun is not None:
        from ..reports.recording import require_mcap, require_rerun

        for out, require in ((given.mcap, require_mcap), (given.rerun, require_rerun)):
            if out is not None:
                require()
    with progress_bar(path.name) as progress:
        steps = Steps(progress, (_PLANNING_AND_SMOOTHING if given.smooth else _PLANNING, 1.0))
        report = analysis(options, given, path, steps, csv=given.csv, split=given.split)
    if given.smooth and not report.differentiation.derives:
        note("--smooth changes nothing: the file gives velocities and accelerations.")
    if "motors" in plots and not report.motors:
        raise ValueRangeError("--plot motors=…: the actuator file describes no motor.")
    degrees = options.degrees or report.in_degrees
    blocks = list(report_view(report, degrees=degrees, why=given.why))
    show(*blocks)
    link, motion = "", None
    if given.html is not None or not plots.keys() <= {"torques", "motors"}:
        from ..reports.drawn_motion import reported_motion

        motion = reported_motion(report)
    for kind, picture in plots.items():
        _plot(report, motion, kind, picture, given.joints)
    for out, write in ((given.mcap, report.to_mcap), (given.rerun, report.to_rerun)):
        if out is not None:
            write(out)
    shared.show_written(given.csv, *plots.values(), given.mcap, given.rerun)
    if given.html is not None:
        time = f"#t={number(report.joints[report.worst].time, 6)}" if report.worst is not None else ""
        link = write_viewer(given, report.load.robot, time, motion=motion)
    if given.report is not None:
        write_torque_report(report, blocks, given, files, link, degrees=degrees)
    return report.verdict.exit_code


def _parse_plots(texts: Sequence[str]) -> dict[str, str]:
    """Pictures by kind; raises if one cannot be drawn, before a long run."""
    found: dict[str, str] = {}
    for text in texts:
        kind, sign, path = text.partition("=")
        kind, path = (kind, path) if sign else ("torques", text)
        if kind not in _PLOTS or not path:
            raise ValueRangeError(f"--plot {text!r} is not KIND=OUT.png. Kinds: {', '.join(_PLOTS)}.")
        if kind in found:
            raise ValueRangeError(f"--plot {kind} is given twice. Keep one of them.")
        found[kind] = picture_path(path)
    if found:
        check_matplotlib()
    return found


def _plot(report: TorqueReport, motion: DrawnMotion | None, kind: str, path: str, joints: Sequence[str]) -> None:
    """Draw a report or its motors; causes, power and phase use its motion."""
    from ..viz.plots import motion as of_motion
    from ..viz.plots.torques import plot_motors, plot_report

    if motion is None or kind in ("torques", "motors"):
        (plot_motors if kind == "motors" else plot_report)(report, path)
    elif kind == "power":
        of_motion.plot_power(motion, path)
    else:
        (of_motion.plot_split if kind == "causes" else of_motion.plot_phase)(motion, path, joints)


def write_torque_report(
    report: TorqueReport,
    blocks: Sequence[Block],
    given: Given,
    files: Mapping[str, str | Path | None],
    link: str,
    *,
    degrees: bool,
) -> None:
    """Write the page of one motion: worst moment, plots, and effects included in the torques."""
    from ..viz.plots.torques import plot_motors, plot_report

    load, facts, pictures = report.load, [], [drawn("Torques and limits", lambda path: plot_report(report, path))]
    if report.worst is not None:
        joint, states = report.joints[report.worst], report.around
        share = f"{percent_of_limit(joint.share)} of its limit" if math.isfinite(joint.limit) else "no limit"
        facts = [
            (f"peak of {joint.joint}", f"{report.label(joint.peak)} {joint.unit}"),
            ("limit", quantity(joint.limit, joint.unit)),
            ("share of limit", percent_of_limit(joint.share) if math.isfinite(joint.limit) else MISSING),
            ("time", f"{seconds(joint.time)} s"),
        ]
        q = states.q[int(np.argmin(np.abs(states.time - joint.time)))]
        marked = MarkedJoint(joint.joint, f"{joint.joint}, {share}", mark_style(joint.share))
        title = f"{report.robot} at t = {seconds(joint.time)} s"
        pictures.append(robot_picture(load.with_load, q, marked, title, link=link))
    if report.motors:
        pictures.append(drawn("Motors", lambda path: plot_motors(report, path)))
    friction = friction_words(load.robot.model, counted=load.friction)
    subject = f"{report.robot} · {Path(report.trajectory).name}"
    write_report(
        given, "torques", subject, blocks, files=files, facts=facts, pictures=pictures, robot=load.robot,
        limits=report.limits, degrees=degrees, used=[("torques", friction)],
    )  # fmt: skip


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
    """Work on one file; it is sent to other processes."""

    options: RobotOptions
    given: Given

    def evaluate(self, path: str) -> FileTorques:
        """Torque report of the motion in this file."""
        report = analysis(self.options, self.given, Path(path), Steps(None, (1.0, 1.0)))
        judged = verdict_of(report, degrees=self.options.degrees or report.in_degrees)
        found = FileTorques(path, str(judged.word), rows=report.rows, reason="; ".join(judged.reasons))
        if report.worst is None:
            return found
        worst = report.joints[report.worst]
        return replace(found, joint=worst.joint, peak=worst.peak, limit=worst.limit, unit=worst.unit, time=worst.time)


def analysis(
    options: RobotOptions, given: Given, path: Path, steps: Steps, *, csv: str | None = None, split: bool = False
) -> TorqueReport:
    """Report of one motion."""
    robot, log = shared.open_motion(options, given, path)
    shared.refuse_motor_side(options, robot, "torques")
    load = shared.load_case(robot, options, given)
    limits = read_limits(given.limits, robot.model, degrees=options.degrees)
    plan = Differentiation.plan(log, robot.model, smoothing=given.smooth, progress=steps.next())
    report = analyse(load, plan, limits, csv=csv, split=split, progress=steps.next())
    rows = ((s.time, s.q) for s in report.differentiation.states(_ROWS))
    clearance = shared.clearance_along(given, robot, rows)
    return replace(report, causes=measured_causes(report, log), clearance=clearance)


_IN_ROWS = ("repeated", "buffered")
"""Doubts about rows that could be mistaken for causes."""
_RUNS, _ROWS = 4, 8192
"""Number of blocks of a long log searched for causes, and rows of each block."""


def measured_causes(report: TorqueReport, log: MotionLog) -> tuple[Doubt, ...]:
    """Causes of measured torques that the robot's equations do not explain; empty with wrenches or defective rows."""
    wrong = any(m.cut and m.matters for m in report.measured) or any(d.kind in _IN_ROWS for d in report.doubts)
    if not report.measured or report.load.wrenches or wrong:
        return ()
    from .. import identification
    from ..motion.motion import Motion

    robot, motions, read = report.load.robot, [], tuple(report.doubts)
    for table in excerpts(log.table, _RUNS, _ROWS):
        rows = log.motion(table)
        still = np.zeros((len(rows.time), robot.nv))  # the search differentiates positions with its own cut-off
        motions.append(Motion(rows.time, rows.q, still, still, rows.tau, robot, read=read))
    return identification.measured_causes(robot, motions)


def run_batch(work: BatchTorques, paths: Sequence[str]) -> ExitCode:
    """Print a line for each file, including failed ones, and write a table; returns 0 if all are OK."""
    work.given.check_files({**{f"MOTION {p}": p for p in paths}, **work.options.files})
    with (
        progress_bar(f"{len(paths)} motions") as progress,
        workers_of(work.given.workers, work.given.scheduler) as team,
    ):
        found = [
            FileTorques(path, "failed", reason=result.reason) if isinstance(result, Failure) else result
            for path, result in zip(paths, team.results(work.evaluate, paths, progress), strict=True)
        ]
    show(many_table(found))
    columns = {field.name: [getattr(one, field.name) for one in found] for field in fields(FileTorques)}
    shared.write_csv(work.given.csv, columns)
    if all(one.verdict == "failed" for one in found):
        raise ValueRangeError(f"none of the {len(found)} motions can be read. The first: {found[0].reason}")
    return ExitCode.FINE if all(one.verdict == Word.OK for one in found) else ExitCode.NO


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
        numbers("power", [use.power for use in motors], _figure, "W"),
        numbers("heat", [use.heat for use in motors], _figure, "W"),
        numbers("used", [use.tightest.share or math.nan for use in motors], share_cell),
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


def report_view(report: TorqueReport, *, degrees: bool = False, why: bool = False) -> Iterator[Block]:
    """Blocks of the report, verdict first.

    Angles are in degrees if ``degrees``; contributions of links to the worst joint's peak are added if ``why``.
    """
    yield verdict_view(report, degrees=degrees)
    yield ""
    yield _heading(report)
    yield _peaks(report)
    yield _causes(report)
    if why and report.worst is not None:
        yield _why(report, report.worst)
    if any(not m.dead for m in report.measured):
        yield _beside_measured(report)
    if report.motors:
        yield motors_table(report.motors)
        yield motors_verdict(report.motors)
    if passed := [e for e in report.excesses if e.kind != "effort"]:
        yield _motion_limits(passed, degrees=degrees)
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


def _torques(
    report: TorqueReport, name: str, values: Iterable[float | Line | None], show: Callable[[Any], Cell]
) -> Column:
    """Column of a table of joints; the unit is shown by the table."""
    units = sorted({j.unit for j in report.joints})
    return numbers(name, values, show, ", ".join(units), headed=False)


def _joint_table(report: TorqueReport, title: str, joints: Sequence[JointTorque], *columns: Column | None) -> Table:
    """Table with one row per joint; units are in its title, or beside the joints if there are two."""
    units = sorted({j.unit for j in report.joints})
    return Table(
        f"{title} [{units[0]}]" if len(units) == 1 else title,
        words("joint", [j.joint for j in joints]),
        words("unit", [j.unit for j in joints], style=Style.QUIET) if len(units) > 1 else None,
        *columns,
    )


def _peaks(report: TorqueReport) -> Table:
    joints, column = report.joints, partial(_torques, report)

    unknown = Line((MISSING, Style.QUIET))
    known = [math.isfinite(j.limit) for j in joints]
    bars: list[Cell] = [Bar(j.share, f"  {percent_of_limit(j.share):>5}") for j in joints]
    bars = [bar if limited else unknown for bar, limited in zip(bars, known, strict=True)]
    shares = [share_cell(j.share) if limited else unknown for j, limited in zip(joints, known, strict=True)]
    return _joint_table(
        report,
        "Torques",
        joints,
        column("peak", [j.peak for j in joints], report.label),
        column("± 1σ", [report.reach(j) for j in joints], deviation) if report.noisy else None,
        column("raw\npeak", [j.raw for j in joints], report.label) if report.derived is not None else None,
        column("rms", [j.rms for j in joints], torque),
        column("limit", [j.limit for j in joints], shown),
        words("share of limit", bars, fold=False, narrow=numbers("of\nlimit", shares)),
        numbers("when", [j.time for j in joints], seconds, "s"),
    )


def _causes(report: TorqueReport) -> Table:
    joints, column = report.joints, partial(_torques, report)

    def cause(j: JointTorque, term: str) -> Line:
        main = term == j.main_cause[0] and not report.is_zero(j.largest)
        return Line((report.label(j.terms[term]), Style.STRONG if main else ""), value=j.terms[term])

    def mostly(j: JointTorque) -> str:
        term, share = j.main_cause
        return MISSING if report.is_zero(j.largest) else f"{cause_label(term)} {percent(share)}"

    terms = [term for term in TERMS if any(not report.is_zero(j.terms[term]) for j in joints)]
    chance = any(abs(j.chance) > NEGLIGIBLE * report.reference(j) for j in joints)
    return _joint_table(
        report,
        "What the peak is made of",
        joints,
        *(column(cause_label(term), [cause(j, term) for j in joints], shown) for term in terms),
        column("noise", [j.chance for j in joints], report.label) if chance else None,
        words("mostly", map(mostly, joints), fold=False),
    )


def _beside_measured(report: TorqueReport) -> Table:
    """Table of measured and computed torques."""
    pairs = [(j, m) for j, m in zip(report.joints, report.measured, strict=True) if not m.dead]
    measured, column = [m for _, m in pairs], partial(_torques, report)

    def difference(m: MeasuredTorque) -> Line:
        return Line(
            (torque(m.residual), Style.OVER if m.contradicts else Style.NEAR if m.differs else ""), value=m.residual
        )

    return _joint_table(
        report,
        "The file's own torques",
        [j for j, _ in pairs],
        column("rms\ncomputed", [m.computed for m in measured], torque),
        column("rms\nmeasured", [m.measured for m in measured], torque),
        column("rms of\ndifference", map(difference, measured), shown),
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
    return Glyphs(text) if text == NEGLIGIBLE_PART else Line(text, value=value)


def _motion_limits(excesses: list[Excess], *, degrees: bool) -> Table:
    def value(e: Excess, x: float) -> float:
        return x * (math.degrees(1.0) if degrees and e.angular else 1.0)

    units = [unit_of("dq" if e.kind == "velocity" else "q", e.angular, degrees=degrees) for e in excesses]
    kinds = [{"lower": "position, lower", "upper": "position, upper"}.get(e.kind, e.kind) for e in excesses]
    column = partial(numbers, show=lambda x: number(x, 5), unit=", ".join(dict.fromkeys(units)), headed=False)

    return Table(
        "Motion limits passed",
        words("joint", [e.joint for e in excesses], fold=False),
        words("what", [f"{kind} [{unit}]" for kind, unit in zip(kinds, units, strict=True)], fold=False),
        column("worst", [value(e, e.value) for e in excesses]),
        column("limit", [value(e, e.limit) for e in excesses]),
        numbers("when", [e.time for e in excesses], seconds, "s"),
        style=strong(Style.OVER),
    )


# ── Many motions


def many_table(found: Sequence[FileTorques]) -> Table:
    """Verdict, worst joint and reason of each file."""
    units = ", ".join(dict.fromkeys(one.unit for one in found if one.unit))
    column = partial(numbers, unit=units, headed=False)
    return Table(
        "",
        words("motion", [Path(one.file).name for one in found]),
        words("verdict", [word_cell(one.verdict) for one in found]),
        words("joint", [one.joint for one in found]),
        column("peak", [Line(quantity(one.peak, one.unit), value=one.peak) for one in found]),
        column("limit", [Line(quantity(one.limit, one.unit), value=one.limit) for one in found]),
        numbers("at", [Line(quantity(one.time, "s"), value=one.time) for one in found], unit="s", headed=False),
        words("", [one.reason for one in found]),
    )
