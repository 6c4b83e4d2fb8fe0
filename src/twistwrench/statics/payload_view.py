"""Payload report as blocks: verdict, holding torques of each joint, largest forces and remarks."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

from ..core.answers.blocks import Bar, Block, Column, Headline, Line, Table, numbers, remarks, words
from ..core.colours import Style, strong, word_style
from ..core.errors import ValueRangeError
from ..core.numbers import MISSING, number, over_limit, percent_of_limit, quantity, rounded_down, torque
from ..core.typing import Array
from ..core.verdict import Word
from ..mechanics.joints.units import heading_unit, unit_of
from ..motion.coordinates import Coordinates, degrees_hint
from .arguments import unit_slips
from .equilibrium import BeyondStop
from .force_capability import largest_wrench, weakest_direction
from .payload_report import PayloadReport

_ROUNDING = 12
"""Decimals of a coordinate; smaller values are rounding errors."""
_MAX_JOINTS = 12
"""Largest number of joints in the short form of the table."""
_CAUTION = "Counts joint torques at rest alone: structure, grip, warm motors and motion may limit it earlier."
"""Line of the report on what it leaves out."""


def payload_view(report: PayloadReport) -> Iterator[Block]:
    """Blocks of the report, verdict first; without limits, only holding torques are listed."""
    yield _headline(report)
    hint = degrees_hint(report.robot, report.q)
    if hint:
        yield from remarks([hint])
    yield ""
    heading = f"  ·  payload at {place_words(report.frame, report.com)}"
    carried_tools = carried_words(report)
    if carried_tools:
        heading += f"  ·  carrying {carried_tools} already"
    yield Line((report.robot.name, Style.STRONG), heading)
    yield _holding_torques(report)
    if report.judged:
        yield from _forces(report)
    if report.map is not None:
        yield f"map, {report.map}"
    yield Line((_CAUTION, Style.QUIET))
    position_by_name = {"com": report.com}
    for payload in report.load.payloads:
        name = f"the centre of the tool of {number(payload.mass)} kg"
        position_by_name[name] = np.array(payload.place)
    slips = unit_slips(report.robot, report.q, report.limits, position_by_name, degrees=report.degrees)
    yield from remarks([*slips, *report.load.unit_hints])


def findings(report: PayloadReport) -> list[tuple[Word, tuple[str, ...]]]:
    """Pairs of a word and its reasons, which are sentences without a full stop; the first word is the verdict."""
    words_and_reasons: list[tuple[Word, tuple[str, ...]]] = []
    if report.contradictions:
        words_and_reasons.append((Word.LOOK_AGAIN, report.contradictions))
    if report.beyond:
        reason = _stops_words(report.beyond, degrees=report.degrees)
        words_and_reasons.append((Word.OVER_LIMIT, (reason,)))
    if report.doubts:
        words_and_reasons.append((Word.UNSURE, report.doubts))
    if report.judged and not report.largest.holds:
        words_and_reasons.append((Word.OVER_LIMIT, (_not_held_sentence(report),)))
    if not words_and_reasons:
        words_and_reasons.append((Word.OK, (_largest_payload_sentence(report),)))
    return words_and_reasons


def _headline(report: PayloadReport) -> Headline:
    """Verdict with its reasons; further words and the largest payload below it."""
    first_finding, *other_findings = findings(report)
    verdict, reasons = first_finding
    further_lines = []
    for word, reasons_of_word in other_findings:
        further_lines.append(Line((str(word), word_style(word)), f": {'; '.join(reasons_of_word)}."))
    if verdict is not Word.OK and report.largest.holds and report.judged:
        sentence = _largest_payload_sentence(report)
        further_lines.append(Line(f"{sentence[0].upper()}{sentence[1:]}."))
    return Headline(verdict, f"{'; '.join(reasons)}.", further=further_lines)


def _largest_payload_sentence(report: PayloadReport) -> str:
    """Sentence on the largest payload and the joint that limits it."""
    largest_payload = report.largest
    k = int(largest_payload.joint)  # index of the limiting joint; -1 without one
    if k < 0:
        return f"the payload is not limited at this pose: no joint torque depends on it{report.assumed}"
    side = "upper" if largest_payload.side > 0 else "lower"
    carried = "the robot and what it carries" if report.load.payloads else "the robot itself"
    mass = rounded_down(largest_payload.mass)  # [kg]
    joint = largest_payload.joint_names[k]
    unit = largest_payload.units[k]
    loaded_torque = torque(largest_payload.torques[k])
    unloaded_torque = torque(largest_payload.unloaded[k])
    return (
        f"largest payload at rest in this pose: {mass} kg at {place_words(report.frame, report.com)}. "
        f"Limited by {joint}, {side} limit: {loaded_torque} {unit}, of which "
        f"{unloaded_torque} carry {carried}{report.assumed}"
    )


def _not_held_sentence(report: PayloadReport) -> str:
    """Sentence on the joint that cannot hold the robot without a payload."""
    reason = str(report.largest).removeprefix("no payload: ")
    if report.load.payloads:
        reason = reason.replace("the robot alone", "the robot and what it carries")
    return f"no payload. {reason}"


def _stops_words(joints_beyond: tuple[BeyondStop, ...], *, degrees: bool) -> str:
    """Sentence on joints beyond their position limits, with their excess; ``degrees``: angles in degrees."""
    clauses = []
    for joint in joints_beyond:
        scale = 1.0
        if degrees and joint.turns:
            scale = math.degrees(1.0)
        unit = unit_of("q", joint.turns, degrees=degrees)
        side = "above its upper" if joint.value > joint.stop else "below its lower"
        value = quantity(scale * joint.value, unit, decimals=_ROUNDING)
        excess = quantity(scale * joint.by, unit, decimals=_ROUNDING)
        stop = quantity(scale * joint.stop, unit, decimals=_ROUNDING)
        clauses.append(f"{joint.joint} at {value} is {excess} {side} position limit, {stop}")
    return f"the robot cannot be in this pose: {'; '.join(clauses)}"


def _holding_torques(report: PayloadReport) -> Table:
    """Table with a row for each joint; shares of limits are shown only in a report with limits."""
    largest_payload = report.largest
    is_angular = Coordinates.from_model(report.robot.model).angular_velocity
    shares = [float(x) for x in largest_payload.share]
    unit = heading_unit("tau", is_angular)
    torque_column = partial(numbers, show=torque, unit=unit, headed=False)
    limit_column = numbers("limit", largest_payload.limits, unit=unit, headed=False)
    show_position = partial(number, decimals=_ROUNDING, missing="")
    position_unit = heading_unit("q", is_angular, degrees=report.degrees)
    position_column = numbers("q", joint_positions(report), show_position, position_unit)
    columns = [
        words("joint", largest_payload.joint_names, fold=False),
        position_column,
        torque_column("alone", largest_payload.unloaded),
        torque_column("per kg", largest_payload.per_kilogram),
    ]
    styles = None
    if report.judged:
        columns += [torque_column("loaded", largest_payload.torques), limit_column, *_limit_shares(report, shares)]
        styles = _row_styles(shares, int(largest_payload.joint))
    else:
        columns.append(limit_column)
    return Table("Holding torques", *columns, unit=unit, styles=styles, most=_MAX_JOINTS, by=shares)


def _limit_shares(report: PayloadReport, shares: list[float]) -> Iterator[Column]:
    """Column of the mass that each joint holds, and column of the share of its limit."""
    largest_payload = report.largest

    def mass_text(mass: float) -> str:
        """Mass [kg], rounded down; a dash if no mass exceeds the limit."""
        return rounded_down(mass) if math.isfinite(mass) else MISSING

    yield numbers("up to", np.maximum(largest_payload.per_joint, 0.0), mass_text, "kg")
    bars = []
    shown_shares: list[float | None] = []  # None without a limit
    for share, limit in zip(shares, largest_payload.limits, strict=True):
        if math.isfinite(limit):
            shown_shares.append(share)
            bars.append(Bar(share, f"  {percent_of_limit(share):>5}"))
        else:
            shown_shares.append(None)
            bars.append(Bar(0.0, f"  {percent_of_limit(None):>5}"))
    yield words("share of limit", bars, fold=False, narrow=numbers("share", shown_shares, percent_of_limit))


def _row_styles(shares: list[float], limiting: int) -> list[str]:
    """Style of each joint's row; ``limiting`` is the index of the joint that limits the payload, -1 without one."""
    styles: list[str] = []
    for k, share in enumerate(shares):
        if over_limit(share):
            styles.append(strong(Style.OVER))
        elif k == limiting:
            styles.append(Style.STRONG)
        else:
            styles.append("")
    return styles


def place_words(frame: str, com: Array) -> str:
    """Text of a point of a frame: tool0 + [0, 0, 0.1] m."""
    if not np.any(com):
        return frame
    return f"{frame} + [{', '.join(map(number, com))}] m"


def carried_words(report: PayloadReport) -> str:
    """Text of the tools with their positions: 1.2 kg at tool0 + [0, 0, 0.05] m."""
    texts = []
    for payload in report.load.payloads:
        frame = str(payload.frame or report.robot.tip)
        place = place_words(frame, np.array(payload.place))
        texts.append(f"{number(payload.mass)} kg at {place}")
    return " and ".join(texts)


def joint_positions(report: PayloadReport) -> Array:
    """Positions of the joints [rad or m, or degrees]; nan for joints of more than one degree of freedom."""
    position_by_joint = dict.fromkeys(report.largest.joint_names, math.nan)
    for body in report.robot.model.bodies:
        joint = body.joint
        if joint.nq == joint.nv == 1:
            position = body.ratio * report.q[body.q_index] + body.offset  # of a mimic joint by its leader's
            if report.degrees and joint.turning[0]:
                position = position * math.degrees(1.0)
            position_by_joint[joint.name] = position
    return np.array([position_by_joint[name] for name in report.largest.joint_names])


def _forces(report: PayloadReport) -> Iterator[str]:
    """Largest forces that the robot can apply at the frame, along the base axes and in the weakest direction."""
    robot = report.robot
    q = report.q
    effort = report.limits.effort
    directions = np.concatenate([np.eye(3), -np.eye(3)])  # x, y, z, -x, -y, -z
    along_axes = largest_wrench(robot, q, directions, frame=report.frame, limits=effort)
    forward_forces, backward_forces = np.split(along_axes.magnitude, 2)
    texts = []
    for axis, forward, backward in zip("xyz", forward_forces, backward_forces, strict=True):
        texts.append(f"±{axis} {_force_text(forward)} / {_force_text(backward)}")
    yield (
        f"Largest force [N] at the origin of {report.frame}, in place of the payload, along {', '.join(texts)} (base axes)."
    )
    try:
        weakest = weakest_direction(robot, q, frame=report.frame, limits=effort)
    except ValueRangeError:
        return
    force = weakest.wrench[3:]  # without its moment
    direction = ", ".join(number(x, 2, decimals=3) for x in force)
    limiting = ""
    if weakest.joint >= 0:
        limiting = f", limited by {weakest.joint_names[int(weakest.joint)]}"
    yield f"Weakest along ({direction}): {_force_text(weakest.magnitude)} N{limiting}."
    yield ""


def _force_text(value: Any) -> str:
    """Text of a force [N] without its unit; "unbounded" if it is infinite."""
    return number(value, missing="unbounded")
