"""Verdict on a simulation, exceeded limits in words, and the moment of its picture."""

from __future__ import annotations

import math
from itertools import chain
from typing import TYPE_CHECKING, Protocol

import numpy as np

from ..core.answers.page import MarkedJoint
from ..core.colours import Style
from ..core.numbers import number, seconds
from ..core.text import Argument, spell
from ..core.typing import Array
from ..core.verdict import Verdict, Word
from ..mechanics.joints.units import unit_of
from ..motion.bounds import LimitCheck, Violation, bounds_of
from ..motion.coordinates import Coordinates

if TYPE_CHECKING:
    from .result import SimulationResult


class MotionClearance(Protocol):
    """Least distance between links along the motion, judged above this package."""

    @property
    def verdict(self) -> Verdict:
        """OK, or what comes too near."""

    @property
    def lines(self) -> list[str]:
        """Sentences on the nearest links."""


VERBS_AND_MEANINGS = {  # kind: (verb, meaning)
    "position": ("is at", "Nothing held the joint: {stop} ends where a limit is reached"),
    "torque": (
        "is given",
        "The robot's drives cannot give it: reduce {tau}, or raise the efforts in the robot's file",
    ),
    "velocity": ("moves at", "The robot's drives would not let it"),
}
"""For each kind of exceeded limit: verb between the joint and its value, and meaning with the remedy."""


def _meaning(kind: str) -> str:
    """Meaning of an exceeded limit of this kind, and what to do."""
    _, meaning = VERBS_AND_MEANINGS[kind]
    stop = spell(Argument("limits", "stop", option="stop-at-limits", alone=True))
    return meaning.format(stop=stop, tau=spell(Argument("tau", option="torque")))


def verdict_with_clearance(result: SimulationResult) -> Verdict:
    """Verdict on the motion, and on the distance between links if it was checked."""
    verdict = simulation_verdict(result)
    clearance = result.clearance
    if clearance is None:
        return verdict
    if not clearance.verdict.ok:
        return Verdict(clearance.verdict.word, clearance.verdict.reasons + verdict.reasons)
    if verdict.ok:
        return Verdict(Word.OK)  # not DONE, since distances were judged
    return verdict


def simulation_verdict(result: SimulationResult) -> Verdict:
    """Verdict on a simulation: STOPPED if it ended early, OVER LIMIT if given torques pass a limit, otherwise DONE.

    A passive fall is not judged by limits: it is DONE whatever it passes. A result without its robot has no limits.
    """
    if not result.completed:
        return Verdict(Word.STOPPED, (_reason_of_end(result),))
    violations_by_kind = _violations(result)
    violations = list(chain.from_iterable(violations_by_kind.values()))
    if not result.driven or not violations:
        return Verdict(Word.DONE)
    worst = violations[0]
    other_count = len(violations) - 1
    sentence = _violation_text(worst, degrees=result.degrees)
    if other_count:
        sentence += f"; {other_count} more limit{'s are' if other_count > 1 else ' is'} passed"
    return Verdict(Word.OVER_LIMIT, (f"{sentence}. {_meaning(worst.kind)}",))


def _reason_of_end(result: SimulationResult) -> str:
    """Reason for an early end; a position limit is in degrees if ``result`` is."""
    joint_index = _joint_at_limit(result)
    robot = result.simulated
    if joint_index is None or robot is None:
        return result.stopped
    positions = robot.model.positions(result.events[-1].q)
    position = positions[joint_index]
    lower = robot.limits.lower[joint_index]
    upper = robot.limits.upper[joint_index]
    if upper - position < position - lower:
        side = "upper"
        limit = upper
    else:
        side = "lower"
        limit = lower
    turns = bool(Coordinates.from_model(robot.model).angular_velocity[joint_index])
    if result.degrees and turns:
        limit *= math.degrees(1.0)
    unit = unit_of("q", turns, degrees=result.degrees)
    return f"{robot.model.velocity_names[joint_index]} reached its {side} position limit, {number(limit, 5)} {unit}"


def _joint_at_limit(result: SimulationResult) -> int | None:
    """Index in dq of the joint whose position limit ended the simulation; None if it ended otherwise."""
    robot = result.simulated
    if result.completed or not result.events or robot is None:
        return None
    limits = robot.limits
    positions = robot.model.positions(result.events[-1].q)
    distances = np.minimum(limits.upper - positions, positions - limits.lower)  # to the nearer limit
    margins = distances / limits.tolerance  # at most 1: the joint is at its limit
    finite_margins = np.where(np.isfinite(margins), margins, np.inf)
    joint_index = int(np.argmin(finite_margins))
    return joint_index if margins[joint_index] <= 1.0 else None


def _violation_text(violation: Violation, *, degrees: bool) -> str:
    """Text with joint, value, time and limit of an exceeded limit."""
    if degrees:
        violation = violation.in_degrees()
    verb, _ = VERBS_AND_MEANINGS[violation.kind]
    value = f"{number(violation.value, 5)} {violation.unit}"
    limit = violation.limit if violation.kind == "position" else abs(violation.limit)
    return f"{violation.joint} {verb} {value} at t = {seconds(violation.time)} s, limit {number(limit, 5)}"


def _violations(result: SimulationResult) -> dict[str, list[Violation]]:
    """Limits exceeded by states or given torques, by kind in the order of :data:`VERBS_AND_MEANINGS`; the worst first."""
    if result.simulated is None:
        return {}
    check = LimitCheck(result.simulated.model, bounds_of(result.simulated))
    check.add(result.times, result.q, result.dq, None, result.tau)
    violations_by_kind: dict[str, list[Violation]] = {kind: [] for kind in VERBS_AND_MEANINGS}
    for violation in check.violations():
        if violation.kind in violations_by_kind:
            violations_by_kind[violation.kind].append(violation)
    return {kind: violations for kind, violations in violations_by_kind.items() if violations}


def worst_moment(result: SimulationResult) -> tuple[Array, MarkedJoint | None, str]:
    """Configuration of the picture, joint to mark, and title.

    The joint is the one that stopped the motion, or the one that exceeds its limit most; None if there is neither.
    """
    end_time = number(result.times[-1], 6)
    title_of_end = f"{result.robot} at the end, t = {end_time} s"
    joint_index = _joint_at_limit(result)
    if joint_index is not None:
        joint = result.velocity_names[joint_index]
        return result.q[-1], MarkedJoint(joint, f"{joint}, at its limit", Style.NEAR), title_of_end
    violations_by_kind = _violations(result)
    violations = list(chain.from_iterable(violations_by_kind.values()))
    if not violations:
        return result.q[-1], None, title_of_end
    worst = violations[0]
    row = int(np.abs(result.times - worst.time).argmin())
    mark = MarkedJoint(worst.joint, f"{worst.joint}, {worst.kind} over its limit", Style.OVER)
    title = f"{result.robot} at t = {seconds(worst.time)} s"
    return result.q[row], mark, title


def limits_passed(result: SimulationResult) -> list[str]:
    """Sentences on exceeded limits, one per kind."""
    sentences = []
    for kind, violations in _violations(result).items():
        sentence = _violation_text(violations[0], degrees=result.degrees)
        other_count = len(violations) - 1
        if other_count:
            sentence += f", and {other_count} more joint{'s pass' if other_count > 1 else ' passes'} theirs"
        sentences.append(f"{sentence}. {_meaning(kind)}.")
    return sentences
