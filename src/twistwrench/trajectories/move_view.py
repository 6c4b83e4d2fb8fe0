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
from .fastest import Fastest
from .move_report import SAMPLES, MoveReport
from .trajectory import Trajectory, required_torques

_LISTED = 12
_MOST_PASSED = 6
"""Maximum number of listed exceeded limits."""


def move_view(report: MoveReport) -> Iterator[Block]:
    """Blocks of the report, verdict first."""
    moving = report.trajectory
    if report.refused is not None or moving is None:
        judged = report.verdict
        first, *others = judged.reasons
        further = [_spoken_line((judged.word, f"{each}.")) for each in others]
        yield Headline(judged.word, f"{first}.", further=further)
        yield from remarks(report.hints)
        return
    yield _headline(report, moving)
    if not report.violations:
        yield from remarks(_unknown_velocities(moving, report.limits))
    yield from [] if report.clearance is None else report.clearance.lines
    yield from _limits_of_files(report)
    yield from remarks(report.hints)
    yield ""
    yield from _planned(report, moving)


def _headline(report: MoveReport, moving: Trajectory) -> Headline:
    """First word with its reason; further words, exceeded limits, and what holds otherwise below it."""
    spoken: list[tuple[Word | None, str]] = []
    if report.early_end:
        spoken.append(
            (Word.STOPPED, f"{report.early_end} The motion below, and in the files, is the path until there.")
        )
    shown = [each.in_degrees() if report.degrees else each for each in report.violations[:_MOST_PASSED]]
    spoken += [(Word.OVER_LIMIT, f"{each}.") for each in shown]
    if len(report.violations) > _MOST_PASSED:
        spoken.append((None, f"and {len(report.violations) - _MOST_PASSED} more"))
    if not report.violations:
        within = _within(report, moving)
        if report.early_end:
            spoken.append((None, f"Until there: {within}."))
        elif report.near is not None:
            spoken.append((None, f"{within[0].upper()}{within[1:]}."))
        else:
            spoken.append((Word.UNSURE if report.doubts else Word.OK, f"{within}."))
    if report.near is not None:
        return Headline.from_verdict(report.near, further=list(map(_spoken_line, spoken)))
    (word, sentence), *others = spoken
    return Headline(word or Word.OK, sentence, further=list(map(_spoken_line, others)))


def _spoken_line(spoken: tuple[Word | None, str]) -> Line:
    word, sentence = spoken
    return Line(sentence) if word is None else Line((str(word), word_style(word)), f": {sentence}")


def _within(report: MoveReport, moving: Trajectory) -> str:
    """Sentence on a motion within the limits that are known, with its doubts or its assumptions."""
    unlimited = _unknown_velocities(moving, report.limits) or np.isinf(report.limits.effort).any()
    within = f"within {'the known' if unlimited else 'all'} limits"
    if isinstance(moving, Fastest):
        proven = ", the fastest timing on this path"
        within += proven if moving.time_optimal is None else f"; {moving.price_of_jerk}"
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


def _planned(report: MoveReport, trajectory: Trajectory) -> Iterator[Block]:
    """Heading, one row per joint, and the active limits of the fastest motion over time."""
    robot, uses, degrees = report.robot, report.uses, report.degrees
    carried = " and ".join(f"{number(p.mass)} kg" for p in report.load.payloads)
    turning = np.array(drive_turns(robot.model))
    factor = np.where(turning & degrees, math.degrees(1.0), 1.0)
    way, speed, force = (heading_unit(part, turning, degrees=degrees) for part in ("q", "dq", "tau"))
    most = [max((x for x in (u.velocity_share, u.torque_share) if not math.isnan(x)), default=0.0) for u in uses]
    fast = trajectory if isinstance(trajectory, Fastest) and trajectory.time_optimal is None else None
    yield Line(
        (robot.name, Style.STRONG),
        f"  ·  {trajectory.path.name}, {trajectory.scaling.name} timing: {number(trajectory.duration, 6)} s",
        f"  ·  carrying {carried}" if carried else "",
        f"  ·  {friction_words(robot.model, counted=report.load.friction)}",
    )
    yield Table(
        "",
        words("joint", [use.joint for use in uses]),
        numbers("way", [use.way for use in uses] * factor, _rounded, way),
        numbers("peak", [use.velocity for use in uses] * factor, _rounded, speed),
        numbers("share", [use.velocity_share for use in uses], percent_of_limit),
        numbers("peak", [use.peak for use in uses], torque, force),
        numbers("share", [use.torque_share for use in uses], percent_of_limit),
        numbers("at limit", [use.limiting for use in uses], percent) if fast else None,
        words("", map(Bar, most), fold=False),
        styles=[strong(Style.OVER) if over_limit(share) else "" for share in most],
        most=12,
        by=most,
    )
    if fast:
        yield from _timeline(fast)


def _rounded(value: float) -> str:
    return number(value, decimals=3)


def _timeline(trajectory: Fastest) -> Iterator[Block]:
    T, contacts = trajectory.duration, trajectory.limit_contacts
    shown = sorted(sorted(contacts, key=lambda t: t.begin - t.end)[:_LISTED], key=lambda t: t.begin)
    bars = []
    for t in shown:
        a, b = round(24 * t.begin / T), max(round(24 * t.end / T), round(24 * t.begin / T) + 1)
        bars.append("·" * min(a, 23) + "█" * (min(b, 24) - min(a, 23)) + "·" * (24 - min(b, 24)))
    yield Table(
        "What limits it when",
        numbers("from", [t.begin for t in shown], lambda t: seconds(t, 4), "s"),
        numbers("to", [t.end for t in shown], lambda t: seconds(t, 4), "s"),
        words("joint", [t.joint for t in shown], fold=False),
        words("limit", [f"{'+' if t.side > 0 else '-'} {t.kind}" for t in shown], fold=False),
        words("", [Glyphs(bar, Style.POINTED) for bar in bars], fold=False),
    )
    if rest := len(contacts) - len(shown):
        yield Line((f"and {rest} shorter parts", Style.QUIET))


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
