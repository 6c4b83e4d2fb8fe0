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
_CAUTION = "Counts joint torques at rest alone: structure, grip, warm motors and motion may limit it earlier."


def payload_view(report: PayloadReport) -> Iterator[Block]:
    """Blocks of the report, verdict first; without limits, only holding torques are listed."""
    yield _headline(report)
    hint = degrees_hint(report.robot, report.q)
    if hint:
        yield from remarks([hint])
    yield ""
    carried = carried_words(report)
    place = place_words(report.frame, report.com)
    already = f"  ·  carrying {carried} already" if carried else ""
    yield Line((report.robot.name, Style.STRONG), f"  ·  payload at {place}{already}")
    yield _holding_torques(report)
    if report.judged:
        yield from _forces(report)
    if report.map is not None:
        yield f"map, {report.map}"
    yield Line((_CAUTION, Style.QUIET))
    positions = {"com": report.com}
    for payload in report.load.payloads:
        positions[f"the centre of the tool of {number(payload.mass)} kg"] = np.array(payload.place)
    slips = unit_slips(report.robot, report.q, report.limits, positions, degrees=report.degrees)
    yield from remarks([*slips, *report.load.unit_hints])


def findings(report: PayloadReport) -> list[tuple[Word, tuple[str, ...]]]:
    """Words of the verdict with their reasons, sentences without a full stop; the first word is that of the verdict."""
    results: list[tuple[Word, tuple[str, ...]]] = []
    if report.contradictions:
        results.append((Word.LOOK_AGAIN, report.contradictions))
    if report.beyond:
        results.append((Word.OVER_LIMIT, (_stops_words(report.beyond, degrees=report.degrees),)))
    if report.doubts:
        results.append((Word.UNSURE, report.doubts))
    if report.judged and not report.largest.holds:
        results.append((Word.OVER_LIMIT, (_not_held(report),)))
    return results or [(Word.OK, (_largest(report),))]


def _headline(report: PayloadReport) -> Headline:
    """First word with its reasons; further words and the largest payload below it."""
    (first, reasons), *others = findings(report)
    further = [
        Line((str(word), word_style(word)), f": {'; '.join(reasons_of_word)}.") for word, reasons_of_word in others
    ]
    if first is not Word.OK and report.largest.holds and report.judged:
        sentence = _largest(report)
        further.append(Line(f"{sentence[0].upper()}{sentence[1:]}."))
    return Headline(first, f"{'; '.join(reasons)}.", further=further)


def _largest(report: PayloadReport) -> str:
    """Sentence on the largest payload and the joint that limits it."""
    largest = report.largest
    k = int(largest.joint)
    if k < 0:
        return f"the payload is not limited at this pose: no joint torque depends on it{report.assumed}"
    side = "upper" if largest.side > 0 else "lower"
    itself = "the robot and what it carries" if report.load.payloads else "the robot itself"
    return (
        f"largest payload at rest in this pose: {rounded_down(largest.mass)} kg at {place_words(report.frame, report.com)}. "
        f"Limited by {largest.joint_names[k]}, {side} limit: {torque(largest.torques[k])} {largest.units[k]}, of which "
        f"{torque(largest.unloaded[k])} carry {itself}{report.assumed}"
    )


def _not_held(report: PayloadReport) -> str:
    """Sentence on the joint that cannot hold the robot without a payload."""
    why = str(report.largest).removeprefix("no payload: ")
    if report.load.payloads:
        why = why.replace("the robot alone", "the robot and what it carries")
    return f"no payload. {why}"


def _stops_words(beyond: tuple[BeyondStop, ...], *, degrees: bool) -> str:
    """Sentence on joints beyond their position limits, with their excess; turning joints in degrees if ``degrees``."""
    clauses = []
    for joint in beyond:
        scale = 1.0
        if degrees and joint.turns:
            scale = math.degrees(1.0)
        unit = unit_of("q", joint.turns, degrees=degrees)
        side = "above its upper" if joint.value > joint.stop else "below its lower"
        figures = (joint.value, joint.by, joint.stop)
        value, excess, stop = (quantity(scale * x, unit, decimals=_ROUNDING) for x in figures)
        clauses.append(f"{joint.joint} at {value} is {excess} {side} position limit, {stop}")
    return f"the robot cannot be in this pose: {'; '.join(clauses)}"


def _holding_torques(report: PayloadReport) -> Table:
    """Table with a row for each joint, which shows the share of its limit only in a report with limits."""
    largest = report.largest
    turning = Coordinates.from_model(report.robot.model).angular_velocity
    shares = [float(x) for x in largest.share]
    unit = heading_unit("tau", turning)
    torque_column = partial(numbers, show=torque, unit=unit, headed=False)
    limit_column = numbers("limit", largest.limits, unit=unit, headed=False)
    position_column = numbers(
        "q",
        joint_positions(report),
        lambda x: number(x, decimals=_ROUNDING, missing=""),
        heading_unit("q", turning, degrees=report.degrees),
    )
    columns = [
        words("joint", largest.joint_names, fold=False),
        position_column,
        torque_column("alone", largest.unloaded),
        torque_column("per kg", largest.per_kilogram),
    ]
    styles = None
    if report.judged:
        columns += [torque_column("loaded", largest.torques), limit_column, *_limit_shares(report, shares)]
        styles = _row_styles(shares, int(largest.joint))
    else:
        columns.append(limit_column)
    return Table(f"Holding torques [{unit}]", *columns, styles=styles, most=12, by=shares)


def _limit_shares(report: PayloadReport, shares: list[float]) -> Iterator[Column]:
    """Columns of the mass that each joint holds, and of the share of its limit."""
    largest = report.largest
    masses = np.maximum(largest.per_joint, 0.0)
    yield numbers("up to", masses, lambda m: rounded_down(m) if math.isfinite(m) else MISSING, "kg")
    has_limit = np.isfinite(largest.limits)
    shown_shares = [share if limited else None for share, limited in zip(shares, has_limit, strict=True)]
    bars = [Bar(share or 0.0, f"  {percent_of_limit(share):>5}") for share in shown_shares]
    yield words("share of limit", bars, fold=False, narrow=numbers("share", shown_shares, percent_of_limit))


def _row_styles(shares: list[float], limiting: int) -> list[str]:
    """Style of each joint's row: over its limit, or limiting the payload."""
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
    tip = report.robot.tip
    texts = []
    for payload in report.load.payloads:
        place = place_words(str(payload.frame or tip), np.array(payload.place))
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
    both_ways = np.concatenate([np.eye(3), -np.eye(3)])
    along_axes = largest_wrench(robot, q, both_ways, frame=report.frame, limits=effort)
    texts = [_force_text(magnitude) for magnitude in along_axes.magnitude]
    pairs = [f"±{axis} {texts[k]} / {texts[k + 3]}" for k, axis in enumerate("xyz")]
    yield (
        f"Largest force [N] at the origin of {report.frame}, in place of the payload, along {', '.join(pairs)} (base axes)."
    )
    try:
        weakest = weakest_direction(robot, q, frame=report.frame, limits=effort)
    except ValueRangeError:
        return
    direction = ", ".join(number(x, 2, decimals=3) for x in weakest.wrench[3:])
    limiting = ""
    if weakest.joint >= 0:
        limiting = f", limited by {weakest.joint_names[int(weakest.joint)]}"
    yield f"Weakest along ({direction}): {_force_text(weakest.magnitude)} N{limiting}."
    yield ""


def _force_text(value: Any) -> str:
    return number(value, missing="unbounded")
