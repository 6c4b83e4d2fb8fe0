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


VERBS_AND_MEANINGS = {
    "position": ("is at", "Nothing held the joint: {stop} ends where a limit is reached"),
    "torque": (
        "is given",
        "The robot's drives cannot give it: reduce {tau}, or raise the efforts in the robot's file",
    ),
    "velocity": ("moves at", "The robot's drives would not let it"),
}
"""Verb and meaning for each kind of exceeded limit."""


def _meaning(kind: str) -> str:
    """Meaning of an exceeded limit, and what to do."""
    stop = Argument("limits", "stop", option="stop-at-limits", alone=True)
    return VERBS_AND_MEANINGS[kind][1].format(stop=spell(stop), tau=spell(Argument("tau", option="torque")))


def verdict_with_clearance(result: SimulationResult) -> Verdict:
    """Verdict on the motion, and on the distance between links if it was checked."""
    verdict, clearance = simulation_verdict(result), result.clearance
    if clearance is None:
        return verdict
    if not clearance.verdict.ok:
        return Verdict(clearance.verdict.word, clearance.verdict.reasons + verdict.reasons)
    return Verdict(Word.OK) if verdict.ok else verdict


def simulation_verdict(result: SimulationResult) -> Verdict:
    """Verdict on a simulation: STOPPED if it ended early, OVER LIMIT if given torques pass a limit, otherwise DONE.

    A passive fall is not judged by limits: it is DONE whatever it passes. A result without its robot has no limits.
    """
    if not result.completed:
        return Verdict(Word.STOPPED, (_reason_of_end(result),))
    violations = list(chain.from_iterable(_violations(result).values()))
    if not result.driven or not violations:
        return Verdict(Word.DONE)
    first, others = violations[0], len(violations) - 1
    sentence = _violation_text(first, degrees=result.degrees)
    if others:
        sentence += f"; {others} more limit{'s are' if others > 1 else ' is'} passed"
    return Verdict(Word.OVER_LIMIT, (f"{sentence}. {_meaning(first.kind)}",))


def _reason_of_end(result: SimulationResult) -> str:
    """Reason for an early end; a position limit is in degrees if the answer is."""
    k, robot = _joint_at_limit(result), result.simulated
    if k is None or robot is None:
        return result.stopped
    limits, x = robot.limits, robot.model.positions(result.events[-1].q)[k]
    side = "upper" if limits.upper[k] - x < x - limits.lower[k] else "lower"
    turns = bool(Coordinates.from_model(robot.model).angular_velocity[k])
    limit = getattr(limits, side)[k]
    if result.degrees and turns:
        limit *= math.degrees(1.0)
    unit = unit_of("q", turns, degrees=result.degrees)
    return f"{robot.model.velocity_names[k]} reached its {side} position limit, {number(limit, 5)} {unit}"


def _joint_at_limit(result: SimulationResult) -> int | None:
    """Index in dq of the joint whose position limit ended the simulation; None if it ended otherwise."""
    robot = result.simulated
    if result.completed or not result.events or robot is None:
        return None
    limits, x = robot.limits, robot.model.positions(result.events[-1].q)
    margins = np.minimum(limits.upper - x, x - limits.lower) / limits.tolerance
    k = int(np.argmin(np.where(np.isfinite(margins), margins, np.inf)))
    return k if margins[k] <= 1.0 else None


def _violation_text(violation: Violation, *, degrees: bool) -> str:
    """Joint, value, time and limit of an exceeded limit."""
    if degrees:
        violation = violation.in_degrees()
    verb, value = VERBS_AND_MEANINGS[violation.kind][0], f"{number(violation.value, 5)} {violation.unit}"
    limit = violation.limit if violation.kind == "position" else abs(violation.limit)
    return f"{violation.joint} {verb} {value} at t = {seconds(violation.time)} s, limit {number(limit, 5)}"


def _violations(result: SimulationResult) -> dict[str, list[Violation]]:
    """Limits exceeded by states or given torques, by kind."""
    if result.simulated is None:
        return {}
    check = LimitCheck(result.simulated.model, bounds_of(result.simulated))
    check.add(result.times, result.q, result.dq, None, result.tau)
    violations_of: dict[str, list[Violation]] = {kind: [] for kind in VERBS_AND_MEANINGS}
    for violation in check.violations():
        if violation.kind in violations_of:
            violations_of[violation.kind].append(violation)
    return {kind: violations for kind, violations in violations_of.items() if violations}


def worst_moment(result: SimulationResult) -> tuple[Array, MarkedJoint | None, str]:
    """Configuration of the picture, the joint that stopped the motion or exceeds its limit most, and a title."""
    end = f"{result.robot} at the end, t = {number(result.times[-1], 6)} s"
    k = _joint_at_limit(result)
    if k is not None:
        joint = result.velocity_names[k]
        return result.q[-1], MarkedJoint(joint, f"{joint}, at its limit", Style.NEAR), end
    violations_of = _violations(result)
    if not violations_of:
        return result.q[-1], None, end
    worst = next(iter(violations_of.values()))[0]
    row, label = int(np.abs(result.times - worst.time).argmin()), f"{worst.joint}, {worst.kind} over its limit"
    return result.q[row], MarkedJoint(worst.joint, label, Style.OVER), f"{result.robot} at t = {seconds(worst.time)} s"


def limits_passed(result: SimulationResult) -> list[str]:
    """Sentences on exceeded limits, one per kind."""
    sentences = []
    for kind, violations in _violations(result).items():
        sentence, others = _violation_text(violations[0], degrees=result.degrees), len(violations) - 1
        if others:
            sentence += f", and {others} more joint{'s pass' if others > 1 else ' passes'} theirs"
        sentences.append(f"{sentence}. {_meaning(kind)}.")
    return sentences
