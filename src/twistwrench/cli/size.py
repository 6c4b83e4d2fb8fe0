"""The command ``twistwrench size``: motors and gears of a catalogue under a cyclic motion, as text, table and picture."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ..answers.blocks import (
    Block,
    Column,
    Headline,
    Line,
    Remark,
    Table,
    mark_style,
    numbers,
    remarks,
    share_cell,
    words,
)
from ..answers.page import MarkedJoint
from ..core.colours import Style
from ..core.errors import ValueRangeError
from ..core.numbers import number, percent_of_limit, quantity, seconds
from ..core.typing import Array
from ..core.verdict import ExitCode, Verdict, Word
from ..mechanics.model.limits import over_limit
from ..motion.credible_values import placeholder_limits
from ..motion.differentiation import Differentiation
from ..motion.motion import Motion
from ..motion.motion_log import MotionLog
from ..reports.load_states import LoadStates
from ..reports.motors import Demand
from ..reports.torque_analysis import analyse
from ..reports.torque_report import TorqueReport
from ..reports.torque_verdict import as_it_stands, contradictions, log_doubts, notes_on_log, rows_in_doubt
from ..robots.finding import bundled_file
from ..sizing.catalog import DIRECT
from ..sizing.choice import SizedJoint, Sizing, drive_name, size_drives, smallest_drives
from . import shared
from .main import Given, option
from .report import PAGE, REPORT, write_report, write_viewer
from .shared import RobotOptions, robot_command
from .terminal import show

if TYPE_CHECKING:
    from ..robot import Robot

_DIGITS = 3


@robot_command(
    "size",
    shared.motion_argument(required=True),
    option(
        "--catalog FILE.yaml",
        "Catalogue of motors and gears; 'demo': bundled with the robot, 'servos': a table of servos.",
        required=True,
    ),
    option("--choose", "Choose the smallest drives of the catalogue, also for joints that have drives."),
    option("--pause SECONDS", "Pause after the motion, in which the motors hold the robot.", type=float, default=0.0),
    option("--brake", "Hold the robot with brakes during the pause."),
    option("--ambient CELSIUS", "Ambient temperature.", type=float, default=25.0),
    option("--life HOURS", "Required L10 life of strain-wave gears. [default: none]", type=float),
    option("--emergency FILE", "Motion of an emergency stop, for the momentary peak torque of gears."),
    option(
        "--regeneration",
        "Braking energy feeds other drives, or a resistor.",
        choices=("shared", "none"),
        default="shared",
    ),
    option("--masses-included", "Do not add masses of drives; the links include them."),
    shared.reading_options(),
    shared.PAYLOADS,
    shared.NO_FRICTION,
    shared.csv_option("Write each figure with its limit as a table"),
    shared.JSON,
    option("--plot OUT.png", "Draw each motor's speed–torque region with the cycle, and its temperature."),
    REPORT,
    PAGE,
    option("--out-actuators OUT.yaml", "Write the drives as an actuator file."),
    examples=("size ur5 demo --catalog demo --pause 0.8 --ambient 40 --masses-included",),
    robot_first=True,
)
def size_command(options: RobotOptions, given: Given) -> ExitCode:
    """Size motors and gears for a cyclic motion: loads against ratings, winding temperature, gear life, supply.

    The first word is the verdict. Exit code: 0 for OK; 1 for OVER LIMIT, UNSURE and LOOK AGAIN.
    """
    path = shared.motion_path(options, given.trajectory)
    source = (
        "servos"
        if given.catalog == "servos"
        else bundled_file(given.catalog, options.source, ".drives.yaml", "catalogue")
    )
    read = {"MOTION": path, "--catalog": source if source != "servos" else None, "--emergency": given.emergency}
    files = {**read, **options.files}
    given.check_files(files)
    if options.actuators is not None:
        raise ValueRangeError(
            "the catalogue describes the drives, and --actuators describes others. Leave --actuators out."
        )
    robot, log = shared.open_motion(options, given, path)
    report = _analysed(options, given, robot, log, smoothing=given.smooth)
    notes = [*remarks([*report.load.unit_hints, *notes_on_log(report)]), *remarks(_unused_limits(report))]
    if refused := contradictions(report):
        judged = Verdict.from_reasons(look_again=refused)
        show(*_spoken(judged), *notes)
        return judged.exit_code
    states, robot = LoadStates.from_report(report), report.load.with_load
    emergency = None
    if given.emergency is not None:
        stop = shared.open_motion(options, given, shared.motion_path(options, given.emergency))
        emergency = LoadStates.from_report(_analysed(options, given, *stop)).motion.with_robot(robot)
    found = size_drives(
        robot, states.motion.with_robot(robot), source, emergency=emergency, friction=not given.no_friction,
        add_masses=not given.masses_included, shared_supply=given.regeneration == "shared",
        draws=[one.with_robot(robot) for one in states.draws], **given.pick("pause", "ambient", "life", "brake"),
    )  # fmt: skip
    found = found.choose() if given.choose and not found.choice else found
    judged = _judged(found.verdict, report)
    blocks = [*size_view(found, judged, ambient=given.ambient), *notes]
    show(*blocks)
    _write_figures(given.csv, found)
    from ..viz.plots.torques import plot_sizing

    if given.plot is not None:
        plot_sizing(found, given.plot)
    if given.out_actuators is not None:
        found.write_actuators(given.out_actuators)
    shared.show_written(given.csv, given.plot, given.out_actuators)
    q, marked, title, state = _worst_moment(found, states.motion)
    link = ""
    if given.html is not None:
        from ..reports.drawn_motion import reported_motion

        link = write_viewer(given, report.load.robot, state, motion=reported_motion(report))
    if given.report is not None:
        from ..viz.pictures import drawn, robot_picture

        pictures = [
            robot_picture(robot, q, marked, title, link=link),
            drawn("Drives", lambda path: plot_sizing(found, path)),
        ]
        write_report(given, "size", f"{robot.name} · {path.name}", blocks, files=files, pictures=pictures, robot=robot)
    return judged.exit_code


def _judged(own: Verdict, report: TorqueReport) -> Verdict:
    """Verdict on drives, with doubts about the log; ratings exceeded by a log whose rows are in doubt are not certain."""
    rows, others = rows_in_doubt(report), log_doubts(report)
    if rows and own.word is Word.OVER_LIMIT:
        own = Verdict.from_reasons(unsure=[f"{as_it_stands(report)} {Word.OVER_LIMIT}: {own.reasons[0]}"])
    doubts = Verdict.from_reasons(unsure=[*rows, *(text for text in others if text not in rows)])
    return doubts.joined(own)


def _unused_limits(report: TorqueReport) -> list[str]:
    """Sentence on torque limits of the robot's file that are probably not those of motors: drives have ratings instead."""
    found = placeholder_limits(report.load.robot, report.limits)
    return [f"The robot's file has {found}. Drives are judged by their ratings, not by these."] if found else []


def _analysed(
    options: RobotOptions, given: Given, robot: Robot, log: MotionLog, *, smoothing: bool = False
) -> TorqueReport:
    """Analysis of a motion by the command ``torques``."""
    load = shared.load_case(robot, options, given)
    return analyse(load, Differentiation.plan(log, robot.model, smoothing=smoothing), robot.limits)


def _worst_moment(found: Sizing, cycle: Motion) -> tuple[Array, MarkedJoint | None, str, str]:
    """Configuration in which a drive is nearest to a rating, its joint, a title, and the state of the page."""
    name, start = cycle.robot.name, "at the beginning of the motion"
    if not found.joints:
        return cycle.q[0], None, f"{name} {start}", ""
    joint = max(found.joints.values(), key=lambda j: j.tightest[1].share)
    demand = joint.tightest[1]
    label = f"{joint.joint}, {demand.what} {percent_of_limit(demand.share)} of its limit"
    marked = MarkedJoint(joint.joint, label, mark_style(demand.share))
    moment = cycle.time[0] + demand.time
    if not cycle.time[0] <= moment <= cycle.time[-1]:  # a rating of the whole cycle, or a time in the pause
        return cycle.q[0], marked, f"{name} {start}", ""
    q, when = cycle.q[np.abs(cycle.time - moment).argmin()], number(moment, 6)
    return q, marked, f"{name} at t = {seconds(moment)} s", f"#t={when}"


def _spoken(judged: Verdict) -> Iterator[Headline | Remark]:
    first, *rest = judged.reasons or ("",)
    yield Headline(judged.word, f"{first}.")
    yield from remarks(f"{reason}." for reason in rest)


def size_view(found: Sizing, judged: Verdict, *, ambient: float) -> Iterator[Block]:
    """Verdict, selected products, drives with their figures, and supply."""
    if judged.word is Word.OK:
        one = max(found.joints.values(), key=lambda j: j.tightest[1].share)
        part, demand = one.tightest
        yield Headline(Word.OK, f"all ratings kept. Closest: {one.joint}, {part}: {demand.words}.")
    else:
        yield from _spoken(judged)
    if not found.choice and judged.word is Word.OVER_LIMIT:
        yield from (Line(sentence, indent=2) for sentence in smallest_drives(found, found.choose()))
    yield ""
    if found.joints:
        yield drives_table(found, ambient)
    for joint, chosen in found.choice.items():
        if chosen.smaller is not None:
            pair, reason = chosen.smaller
            yield f"{joint}: the next smaller ({drive_name(pair)}) fails: {reason.removeprefix(f'{joint}, ')}."
    s = found.supply
    yield Line(
        f"Supply: peak {quantity(s.peak, 'W')}, mean {quantity(s.mean, 'W')}; a cycle draws {quantity(s.drawn, 'J')} and "
        f"returns {quantity(s.braked, 'J')}. Drives {quantity(found.mass, 'kg')}."
    )
    if found.left_out:
        yield Line((f"Not sized, for it does not turn or has no drive: {', '.join(found.left_out)}.", Style.QUIET))
    yield Line(("Electronics, iron losses and bearing moments of gears are not counted.", Style.QUIET))


_NAME = 9
"""Least width of a joint's name in narrow terminals; names are folded at their separators."""
_CURRENT = 4
"""Decimals of a current; smaller ones are rounding errors of joints at rest."""


def drives_table(found: Sizing, ambient: float) -> Table:
    """Table with one row per joint; limits are shown behind the values."""
    joints = list(found.joints.values())
    names = [j.joint for j in joints]
    warm = [j.motor.temperature[:, 0].max() if j.motor.temperature.size else math.nan for j in joints]
    return Table(
        f"Drives at {number(ambient)} degC",
        words("joint", names, fold=False, narrow=replace(words("joint", names), min_width=_NAME)),
        words("motor", [j.drive[0] for j in joints]),
        words("gear", [j.drive[1] for j in joints]) if any(j.drive[1] != DIRECT for j in joints) else None,
        _rated("mean", joints, "average torque", "N m"),
        _rated("peak", joints, "peak torque", "N m"),
        _rated("input", joints, "input speed", "rpm"),
        numbers("rms", [j.motor.rms_current for j in joints], partial(number, digits=_DIGITS, decimals=_CURRENT), "A"),
        numbers("winding", warm, _figure, "degC"),
        numbers("J ratio", [j.motor.inertia_ratio for j in joints], _figure),
        numbers("used", [j.tightest[1].share for j in joints], share_cell),
    )


def _figure(value: float) -> str:
    return number(value, _DIGITS)


def _rated(name: str, joints: Sequence[SizedJoint], what: str, unit: str) -> Column:
    """Column of a gear figure with its limits, which stand below it in narrow terminals; exceeded limits are red."""
    demands = [next((d for d in j.gear.demands if d.what == what), None) for j in joints]
    limits = [math.inf if d is None else d.limit for d in demands]
    column = numbers(name, map(_cell, demands), unit=unit, limits=limits)
    return replace(column, narrow=numbers(name, map(partial(_cell, between="\n/ "), demands), unit=unit, limits=limits))


def _cell(demand: Demand | None, between: str = " / ") -> Line | str:
    if demand is None:
        return number(None)
    limit = f"{between}{_figure(demand.limit)}" if math.isfinite(demand.limit) else ""
    red = Style.OVER if over_limit(demand.share) else ""
    return Line((_figure(demand.value), red), (limit, Style.QUIET), value=demand.value)


def _write_figures(path: str | None, found: Sizing) -> None:
    """Table with one row per figure and its limit."""
    rows: list[tuple[str, str, str, Demand]] = [
        (j.joint, part, use.name, d)
        for j in found.joints.values()
        for part, use in (("gear", j.gear), ("motor", j.motor))
        for d in use.demands
    ]
    shared.write_csv(path, {
        "joint": [r[0] for r in rows], "part": [r[1] for r in rows], "name": [r[2] for r in rows],
        "figure": [r[3].what for r in rows], "value": [r[3].value for r in rows],
        "limit": [_known(r[3].limit) for r in rows], "unit": [r[3].unit for r in rows],
        "share": [_known(r[3].share) for r in rows],
    })  # fmt: skip


def _known(value: float) -> float | None:
    return value if np.isfinite(value) else None
