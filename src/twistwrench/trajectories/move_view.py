"""Planned motion as blocks: verdict, peaks of each joint, limits over time and remarks."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from ..core.answers.blocks import Bar, Block, Glyphs, Headline, Line, Table, mark_style, numbers, remarks, words
from ..core.answers.page import MarkedJoint
from ..core.colours import Style, strong, word_style
from ..core.numbers import number, over_limit, percent, percent_of_limit, seconds, torque
from ..core.text import Argument, listed, spell
from ..core.typing import Array
from ..core.verdict import Word
from ..mechanics.joints.units import heading_unit
from ..mechanics.model.couplings import coupled_entries, drive_turns, motor_torques
from ..mechanics.model.limits import Limits
from ..motion.model_doubts import friction_words
from .fastest import Fastest, LimitContact
from .move_report import MoveReport
from .move_timing import SAMPLES
from .trajectory import Trajectory, required_torques

_MAX_LISTED_CONTACTS = 12
_MAX_LISTED_VIOLATIONS = 6
"""Maximum number of listed exceeded limits."""


def move_view(report: MoveReport) -> Iterator[Block]:
    """Blocks of the report, verdict first."""
    moving = report.trajectory
    if report.refused is not None or moving is None:
        judged = report.verdict
        first, *others = judged.reasons
        further = [_sentence_line((judged.word, f"{each}.")) for each in others]
        yield Headline(judged.word, f"{first}.", further=further)
        yield from remarks(report.hints)
        return
    yield _headline(report, moving)
    if not report.violations:
        yield from remarks(_unknown_velocities(moving, report.limits))
    if report.clearance is not None:
        yield from report.clearance.lines
    yield from _limits_of_files(report)
    yield from remarks(report.hints)
    yield ""
    yield from _tables(report, moving)


def _headline(report: MoveReport, moving: Trajectory) -> Headline:
    """First word with its reason; further words, exceeded limits, and what holds otherwise below it."""
    sentences: list[tuple[Word | None, str]] = []
    if report.early_end:
        sentences.append(
            (Word.STOPPED, f"{report.early_end} The motion below, and in the files, is the path until there.")
        )
    for violation in report.violations[:_MAX_LISTED_VIOLATIONS]:
        if report.degrees:
            violation = violation.in_degrees()
        sentences.append((Word.OVER_LIMIT, f"{violation}."))
    if len(report.violations) > _MAX_LISTED_VIOLATIONS:
        sentences.append((None, f"and {len(report.violations) - _MAX_LISTED_VIOLATIONS} more"))
    if not report.violations:
        within = _within(report, moving)
        if report.early_end:
            sentences.append((None, f"Until there: {within}."))
        elif report.near is not None:
            sentences.append((None, f"{within[0].upper()}{within[1:]}."))
        elif report.doubts:
            sentences.append((Word.UNSURE, f"{within}."))
        else:
            sentences.append((Word.OK, f"{within}."))
    if report.near is not None:
        return Headline.from_verdict(report.near, further=list(map(_sentence_line, sentences)))
    (word, sentence), *others = sentences
    return Headline(word or Word.OK, sentence, further=list(map(_sentence_line, others)))


def _sentence_line(word_and_sentence: tuple[Word | None, str]) -> Line:
    word, sentence = word_and_sentence
    return Line(sentence) if word is None else Line((str(word), word_style(word)), f": {sentence}")


def _within(report: MoveReport, moving: Trajectory) -> str:
    """Sentence on a motion within the limits that are known, with its doubts or its assumptions."""
    unlimited = _unknown_velocities(moving, report.limits) or np.isinf(report.limits.effort).any()
    within = "within the known limits" if unlimited else "within all limits"
    if isinstance(moving, Fastest):
        if moving.time_optimal is None:
            within += ", the fastest timing on this path"
        else:
            within += f"; {moving.price_of_jerk}"
    if report.doubts:
        return "; ".join([*report.doubts, f"otherwise {within}"])
    return f"{number(moving.duration, 6)} s, {within}{report.assumed}"


def _limits_of_files(report: MoveReport) -> Iterator[Block]:
    """Lines on acceleration and jerk limits that were not given as one number."""
    bounds = report.limits
    source = f"the robot's file and {report.limits_file}" if report.limits_file else "the robot's file"
    for kind in ("acceleration", "jerk"):
        count = int(np.isfinite(getattr(bounds, kind)).sum())
        if count and kind not in report.asked:
            yield f"{kind.capitalize()} limits of {count} of {len(bounds.jerk)} joints are from {source}."


def _unknown_velocities(trajectory: Trajectory, bounds: Limits) -> list[str]:
    """Sentence on the joints without a velocity limit."""
    names = np.array(trajectory.robot.model.velocity_names)
    missing = names[~np.isfinite(bounds.velocity)]
    if not len(missing):
        return []
    of = "any joint" if len(missing) == len(names) else listed(missing, 6)
    file = spell(Argument("limits", "FILE.csv"))
    return [f"No velocity limit of {of} is known, so none was applied. Give them with {file} (column velocity)."]


# ── Tables


def _tables(report: MoveReport, trajectory: Trajectory) -> Iterator[Block]:
    """Heading, one row per joint, and the active limits of the fastest motion over time."""
    robot, uses, degrees = report.robot, report.uses, report.degrees
    carried = " and ".join(f"{number(p.mass)} kg" for p in report.load.payloads)
    turning = np.array(drive_turns(robot.model))
    factor = np.where(turning & degrees, math.degrees(1.0), 1.0)
    way, speed, force = (heading_unit(part, turning, degrees=degrees) for part in ("q", "dq", "tau"))
    shares = [np.nanmax([use.velocity_share, use.torque_share, 0.0]).item() for use in uses]
    fast = isinstance(trajectory, Fastest) and trajectory.time_optimal is None
    limiting_shares = None
    if fast:
        limiting_shares = numbers("at limit", [use.limiting for use in uses], percent)
    yield Line(
        (robot.name, Style.STRONG),
        f"  ·  {trajectory.path.name}, {trajectory.scaling.name} timing: {number(trajectory.duration, 6)} s",
        f"  ·  carrying {carried}" if carried else "",
        f"  ·  {friction_words(robot.model, counted=report.load.friction)}",
    )
    yield Table(
        "",
        words("joint", [use.joint for use in uses]),
        numbers("way", [use.way for use in uses] * factor, _three_decimals, way),
        numbers("peak", [use.velocity for use in uses] * factor, _three_decimals, speed),
        numbers("share", [use.velocity_share for use in uses], percent_of_limit),
        numbers("peak", [use.peak for use in uses], torque, force),
        numbers("share", [use.torque_share for use in uses], percent_of_limit),
        limiting_shares,
        words("", map(Bar, shares), fold=False),
        styles=[strong(Style.OVER) if over_limit(share) else "" for share in shares],
        most=12,
        by=shares,
    )
    if isinstance(trajectory, Fastest) and fast:
        yield from _timeline(trajectory)


def _three_decimals(value: float) -> str:
    return number(value, decimals=3)


def _timeline(trajectory: Fastest) -> Iterator[Block]:
    T, contacts = trajectory.duration, trajectory.limit_contacts
    longest = sorted(contacts, key=lambda contact: contact.begin - contact.end)[:_MAX_LISTED_CONTACTS]
    shown = sorted(longest, key=lambda contact: contact.begin)
    yield Table(
        "What limits it when",
        numbers("from", [contact.begin for contact in shown], lambda t: seconds(t, 4), "s"),
        numbers("to", [contact.end for contact in shown], lambda t: seconds(t, 4), "s"),
        words("joint", [contact.joint for contact in shown], fold=False),
        words("limit", [f"{'+' if contact.side > 0 else '-'} {contact.kind}" for contact in shown], fold=False),
        words("", [_time_bar(contact, T) for contact in shown], fold=False),
    )
    remaining = len(contacts) - len(shown)
    if remaining:
        yield Line((f"and {remaining} shorter parts", Style.QUIET))


def _time_bar(contact: LimitContact, duration: float) -> Glyphs:
    """Bar of 24 characters for the duration, filled while a limit is active; at least one character."""
    begin = round(24 * contact.begin / duration)
    first, last = min(begin, 23), min(max(round(24 * contact.end / duration), begin + 1), 24)
    return Glyphs("·" * first + "█" * (last - first) + "·" * (24 - last), Style.POINTED)


def worst_moment(report: MoveReport, trajectory: Trajectory) -> tuple[Array, MarkedJoint, str]:
    """Configuration in which a joint is nearest to a torque or velocity limit, the joint, and a title."""
    uses, bounds, friction = report.uses, report.limits, report.friction
    robot, t = trajectory.robot, np.linspace(0.0, trajectory.duration, SAMPLES)
    q, dq, ddq = trajectory(t)
    tau = motor_torques(robot.model, required_torques(robot, t, q, dq, ddq, friction=friction))
    speed = np.where(coupled_entries(robot.model), np.inf, bounds.velocity)
    shares = np.maximum(np.abs(tau) / bounds.effort, np.abs(dq) / speed)
    row, k = np.unravel_index(int(np.argmax(shares)), shares.shape)
    label = f"{uses[k].joint}, {percent_of_limit(shares[row, k])} of a limit"
    marked = MarkedJoint(uses[k].joint, label, mark_style(float(shares[row, k])))
    return q[row], marked, f"{robot.name} at t = {seconds(t[row])} s"
