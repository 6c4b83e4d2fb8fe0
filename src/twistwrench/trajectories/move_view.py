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
"""Maximum number of listed parts of the motion with an active limit."""
_MAX_LISTED_VIOLATIONS = 6
"""Maximum number of listed exceeded limits."""
_MAX_LISTED_JOINTS = 6
"""Maximum number of listed joints without a velocity limit."""
_MAX_ROWS = 12
"""Maximum number of rows of the table of joints in a short answer."""
_TIME_BAR_WIDTH = 24
"""Characters of a bar over the duration of the motion."""


def move_view(report: MoveReport) -> Iterator[Block]:
    """Blocks of the report, verdict first."""
    trajectory = report.trajectory
    if report.refused is not None or trajectory is None:
        verdict = report.verdict
        first_reason, *other_reasons = verdict.reasons
        further_lines = [_sentence_line(verdict.word, f"{reason}.") for reason in other_reasons]
        yield Headline(verdict.word, f"{first_reason}.", further=further_lines)
        yield from remarks(report.hints)
        return
    yield _headline(report, trajectory)
    if not report.violations:
        yield from remarks(_missing_velocity_limits(trajectory, report.limits))
    if report.clearance is not None:
        yield from report.clearance.lines
    yield from _lines_on_limits_of_files(report)
    yield from remarks(report.hints)
    yield ""
    yield from _tables(report, trajectory)


def _headline(report: MoveReport, trajectory: Trajectory) -> Headline:
    """Verdict with its first sentence; below it an early end, exceeded limits, and the limits that are kept."""
    sentences: list[tuple[Word | None, str]] = []
    if report.early_end:
        sentences.append(
            (Word.STOPPED, f"{report.early_end} The motion below, and in the files, is the path until there.")
        )
    for violation in report.violations[:_MAX_LISTED_VIOLATIONS]:
        if report.degrees:
            violation = violation.in_degrees()
        sentences.append((Word.OVER_LIMIT, f"{violation}."))
    unlisted_violations = len(report.violations) - _MAX_LISTED_VIOLATIONS
    if unlisted_violations > 0:
        sentences.append((None, f"and {unlisted_violations} more"))
    if not report.violations:
        text = _within_limits_text(report, trajectory)
        if report.early_end:
            sentences.append((None, f"Until there: {text}."))
        elif report.near is not None:
            sentences.append((None, f"{text[0].upper()}{text[1:]}."))
        elif report.doubts:
            sentences.append((Word.UNSURE, f"{text}."))
        else:
            sentences.append((Word.OK, f"{text}."))
    lines = [_sentence_line(word, sentence) for word, sentence in sentences]
    if report.near is not None:
        return Headline.from_verdict(report.near, further=lines)
    first_word, first_sentence = sentences[0]
    if first_word is None:
        first_word = Word.OK
    return Headline(first_word, first_sentence, further=lines[1:])


def _sentence_line(word: Word | None, sentence: str) -> Line:
    """Line of a verdict and a sentence, or of the sentence alone."""
    if word is None:
        return Line(sentence)
    return Line((str(word), word_style(word)), f": {sentence}")


def _within_limits_text(report: MoveReport, trajectory: Trajectory) -> str:
    """Sentence, without a period, on a motion that keeps the known limits, with its doubts or its assumptions."""
    lacks_velocity_limits = bool(_missing_velocity_limits(trajectory, report.limits))
    lacks_limits = lacks_velocity_limits or np.isinf(report.limits.effort).any()
    text = "within the known limits" if lacks_limits else "within all limits"
    if isinstance(trajectory, Fastest):
        if trajectory.time_optimal is None:
            text += ", the fastest timing on this path"
        else:
            text += f"; {trajectory.price_of_jerk}"
    if report.doubts:
        return "; ".join([*report.doubts, f"otherwise {text}"])
    return f"{number(trajectory.duration, 6)} s, {text}{report.assumed}"


def _lines_on_limits_of_files(report: MoveReport) -> Iterator[Block]:
    """Lines on acceleration and jerk limits from files, which are limits that no option gave as one number."""
    source = "the robot's file"
    if report.limits_file:
        source += f" and {report.limits_file}"
    limits_by_kind = {"acceleration": report.limits.acceleration, "jerk": report.limits.jerk}
    for kind, limits in limits_by_kind.items():
        limited_joint_count = int(np.isfinite(limits).sum())
        if limited_joint_count and kind not in report.asked:
            yield f"{kind.capitalize()} limits of {limited_joint_count} of {len(limits)} joints are from {source}."


def _missing_velocity_limits(trajectory: Trajectory, limits: Limits) -> list[str]:
    """Sentence on the joints without a velocity limit, as a list; empty if all have one."""
    names = np.array(trajectory.robot.model.velocity_names)
    unlimited = names[~np.isfinite(limits.velocity)]
    if not len(unlimited):
        return []
    joints = "any joint" if len(unlimited) == len(names) else listed(unlimited, _MAX_LISTED_JOINTS)
    option = spell(Argument("limits", "FILE.csv"))
    return [f"No velocity limit of {joints} is known, so none was applied. Give them with {option} (column velocity)."]


# ── Tables


def _tables(report: MoveReport, trajectory: Trajectory) -> Iterator[Block]:
    """Heading, one row per joint, and the active limits of the fastest motion over time."""
    robot = report.robot
    uses = report.uses
    payload_masses = " and ".join(f"{number(payload.mass)} kg" for payload in report.load.payloads)
    is_angular = np.array(drive_turns(robot.model))
    factor = np.where(is_angular & report.degrees, math.degrees(1.0), 1.0)
    distance_unit = heading_unit("q", is_angular, degrees=report.degrees)
    speed_unit = heading_unit("dq", is_angular, degrees=report.degrees)
    torque_unit = heading_unit("tau", is_angular, degrees=report.degrees)
    # Shares of unknown limits are NaN; 0 stands in if both are.
    largest_shares = [np.nanmax([use.velocity_share, use.torque_share, 0.0]).item() for use in uses]
    limit_times = None
    timeline = None
    if isinstance(trajectory, Fastest) and trajectory.time_optimal is None:
        limit_times = numbers("at limit", [use.limiting for use in uses], percent)
        timeline = _timeline(trajectory)
    yield Line(
        (robot.name, Style.STRONG),
        f"  ·  {trajectory.path.name}, {trajectory.scaling.name} timing: {number(trajectory.duration, 6)} s",
        f"  ·  carrying {payload_masses}" if payload_masses else "",
        f"  ·  {friction_words(robot.model, counted=report.load.friction)}",
    )
    yield Table(
        "",
        words("joint", [use.joint for use in uses]),
        numbers("way", [use.way for use in uses] * factor, _three_decimals, distance_unit),
        numbers("peak", [use.velocity for use in uses] * factor, _three_decimals, speed_unit),
        numbers("share", [use.velocity_share for use in uses], percent_of_limit),
        numbers("peak", [use.peak for use in uses], torque, torque_unit),
        numbers("share", [use.torque_share for use in uses], percent_of_limit),
        limit_times,
        words("", map(Bar, largest_shares), fold=False),
        styles=[strong(Style.OVER) if over_limit(share) else "" for share in largest_shares],
        most=_MAX_ROWS,
        by=largest_shares,
    )
    if timeline is not None:
        yield from timeline


def _three_decimals(value: float) -> str:
    return number(value, decimals=3)


def _timeline(trajectory: Fastest) -> Iterator[Block]:
    """Table of the longest active limits in the order of time."""
    contacts = trajectory.limit_contacts
    longest_first = sorted(contacts, key=lambda contact: contact.begin - contact.end)  # minus the duration
    shown = sorted(longest_first[:_MAX_LISTED_CONTACTS], key=lambda contact: contact.begin)
    limit_texts = []
    for contact in shown:
        sign = "+" if contact.side > 0 else "-"  # side of the limit
        limit_texts.append(f"{sign} {contact.kind}")
    yield Table(
        "What limits it when",
        numbers("from", [contact.begin for contact in shown], lambda t: seconds(t, 4), "s"),
        numbers("to", [contact.end for contact in shown], lambda t: seconds(t, 4), "s"),
        words("joint", [contact.joint for contact in shown], fold=False),
        words("limit", limit_texts, fold=False),
        words("", [_time_bar(contact, trajectory.duration) for contact in shown], fold=False),
    )
    remaining = len(contacts) - len(shown)
    if remaining:
        yield Line((f"and {remaining} shorter parts", Style.QUIET))


def _time_bar(contact: LimitContact, duration: float) -> Glyphs:
    """Bar over the duration of the motion, filled while a limit is active, with at least one filled character."""
    begin = round(_TIME_BAR_WIDTH * contact.begin / duration)
    end = round(_TIME_BAR_WIDTH * contact.end / duration)
    end = min(max(end, begin + 1), _TIME_BAR_WIDTH)
    begin = min(begin, _TIME_BAR_WIDTH - 1)
    return Glyphs("·" * begin + "█" * (end - begin) + "·" * (_TIME_BAR_WIDTH - end), Style.POINTED)


def worst_moment(report: MoveReport, trajectory: Trajectory) -> tuple[Array, MarkedJoint, str]:
    """Configuration in which a joint is nearest to a torque or velocity limit, this joint, and a title of the picture."""
    robot = trajectory.robot
    t = np.linspace(0.0, trajectory.duration, SAMPLES)
    q, dq, ddq = trajectory(t)
    joint_tau = required_torques(robot, t, q, dq, ddq, friction=report.friction)
    tau = motor_torques(robot.model, joint_tau)
    # Entries of coupled joints belong to motors, whose speeds are not in dq, so velocities are not compared there.
    velocity_limits = np.where(coupled_entries(robot.model), np.inf, report.limits.velocity)
    shares = np.maximum(np.abs(tau) / report.limits.effort, np.abs(dq) / velocity_limits)
    row, k = np.unravel_index(int(np.argmax(shares)), shares.shape)
    share = float(shares[row, k])
    joint = report.uses[k].joint
    marked_joint = MarkedJoint(joint, f"{joint}, {percent_of_limit(share)} of a limit", mark_style(share))
    return q[row], marked_joint, f"{robot.name} at t = {seconds(t[row])} s"
