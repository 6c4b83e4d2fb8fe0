"""Doubts about the causes of a fit's residual: sentences with values and intervals, and laws that belong to the robot."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from ...core.doubts import Doubt, DoubtKind, Level, doubt, doubt_table
from ...core.numbers import number, percent, seconds
from ...core.text import Argument, Placeholder, listed, spell
from .cause_fit import CauseFit
from .diagnose import FoundCause, WantedCause

_LOOK_AGAIN_EFFECT = 0.05
"""Change of predicted torques, as a share of a joint's torque, above which a cause makes the verdict LOOK AGAIN."""
_UNSURE_EFFECT = 0.01
"""Change of predicted torques, as a share of a joint's torque, above which a cause makes the verdict UNSURE."""
_MIN_DELAY = 8e-3
"""Smallest reported delay [s]."""
_MAX_DELAY_DIFFERENCE = 2e-3
"""Difference [s] up to which two delays are equal."""
_MAX_RELATIVE_DELAY_DIFFERENCE = 0.1
"""Relative difference up to which two delays are equal."""
_MAX_LISTED_RIVALS = 3
"""Largest number of other causes that a sentence lists."""
_MAX_BUS_DELAY = 30e-3
"""Longest delay [s] of a bus or a filter; a longer one suggests that positions are commands."""


def cause_doubts(names: Sequence[str], causes: Iterable[FoundCause], taken_off: float) -> list[Doubt]:
    """Doubts about the causes of the residual, in the order in which the causes were found; short delays are left out.

    ``taken_off`` is the delay [s] that the fit has removed from the log.
    """
    doubts: list[Doubt] = []
    for cause in causes:
        if cause.kind == "late" and cause.value is not None:
            delay = float(cause.value[0])
            if abs(delay) < _MIN_DELAY:
                continue
        doubts.append(doubt_of_cause(names, cause, taken_off))
    return doubts


_ROBOT_LAWS = ("load-friction", "stribeck")
"""Causes that are laws of the robot, not faults of its log, in the order in which they are fitted."""
_MIN_DECREASE = 0.05
"""Relative decrease of the held-out residual from which a law is fitted."""
_MAX_LAWS = 2
"""Largest number of laws that are fitted."""


def laws_of_the_robot(causes: Iterable[FoundCause]) -> tuple[WantedCause, ...]:
    """At most two laws of the robot that lower the residual of held-out rows by at least 5 %."""
    laws: list[WantedCause] = []
    law_causes = [cause for cause in causes if cause.kind in _ROBOT_LAWS]
    for cause in sorted(law_causes, key=lambda cause: _ROBOT_LAWS.index(cause.kind)):
        is_of_all_joints = cause.kind == "stribeck" or len(cause.joints) == len(cause.fit.live)
        law = WantedCause(cause.kind, () if is_of_all_joints else cause.joints)
        max_squares = (1.0 - _MIN_DECREASE) ** 2 * _squared_residual(cause.before)
        if _squared_residual(cause.fit) <= max_squares and law not in laws:
            laws.append(law)
    return tuple(laws[:_MAX_LAWS])


def _squared_residual(fit: CauseFit) -> float:
    """Sum of the squared held-out residuals."""
    return float(((fit.left * fit.spread) ** 2).sum())


def doubt_of_cause(names: Sequence[str], cause: FoundCause, taken_off: float | None = None) -> Doubt:
    """Doubt about a cause.

    ``names`` are the joints' names. ``taken_off`` is the delay [s] that a fit of the log has removed; None without such a fit.
    """
    joints = [names[k] for k in cause.joints]
    is_of_several_joints = len(joints) > 1
    joints_text = listed(joints)
    if is_of_several_joints and len(joints) == len(names):
        joints_text = "all joints"
    row = doubt_table()[cause.kind]
    effect_level = _level_of_effect(cause.effect)
    level = _level_of_row(row, effect_level)
    if taken_off is not None and cause.kind in _ROBOT_LAWS:
        level = "note"  # the fit contains the law if held-out rows confirm it
    words = _words(names, cause)
    if cause.kind == "late" and taken_off is not None:
        sentence, level = _delay_taken_off(cause.fit.states.shift, taken_off, effect_level)
        words["taken"] = sentence
    value, interval = cause.value_and_interval
    _, largest_share = cause.most
    found = {
        "value": value,
        "interval": interval,
        "unit": cause.unit,
        "statistic": cause.S,
        "share": largest_share,
        "effect": cause.effect,
    }
    log_text = f"log {cause.log}" if cause.log else ""
    return doubt(cause.kind, joints, level=level, log=log_text, found=found, named=joints_text, **words)


def _level_of_effect(effect: float) -> Level:
    """Level of a cause by its effect on predicted torques."""
    if effect > _LOOK_AGAIN_EFFECT:
        return "refuse"
    if effect > _UNSURE_EFFECT:
        return "unsure"
    return "note"


def _level_of_row(row: DoubtKind, effect_level: Level) -> Level:
    """Level of a cause by its row in the table of doubts, and by the level of its effect."""
    if row.level == "effect" or (row.stage == 1 and effect_level == "note"):
        return effect_level
    return row.level


_UNIT_WORDS = {"deg": "degrees"}
"""Units that sentences spell out."""


def _words(names: Sequence[str], cause: FoundCause) -> dict[str, str]:
    """Words for the fields of the sentence about a cause; fields without a value are empty."""
    words = {
        "evidence": _evidence(names, cause),
        "gravity": ", ".join(number(x, 4) for x in cause.fit.states.gravity),
        "taken": "The command identify takes it off.",
        **dict.fromkeys(("value", "interval", "displacement", "from_", "to", "size", "way"), ""),
    }
    value, interval = cause.value_and_interval
    if value is not None:
        is_delay = cause.kind == "late"  # its sentence has a direction instead of a sign
        words["value"] = number(abs(value) if is_delay else value, 3)
        words["displacement"] = f"{words['value']} {_UNIT_WORDS.get(cause.unit, cause.unit)}"
        words["way"] = "after" if value > 0 else "before"
    if interval is not None:
        low, high = interval
        words["interval"] = f" (95 %: {number(low, 3)} to {number(high, 3)})"
    if cause.span is not None:
        begin, end = cause.span
        words["from_"], words["to"] = seconds(begin, 4), seconds(end, 4)
    if cause.size is not None:
        words["size"] = number(cause.size, 2)
    return words


def _evidence(names: Sequence[str], cause: FoundCause) -> str:
    """Text of the share of a joint's residual that a cause explains, and of other causes that explain the log as well."""
    joint, share = cause.most
    evidence = f"it takes away {percent(share, 2)} of the residual of {names[joint]}"
    if not cause.rivals:
        return evidence
    rival_texts: list[str] = []
    for rival in cause.rivals:
        if rival.joints:
            rival_texts.append(f"{rival.kind} of {listed([names[k] for k in rival.joints])}")
        elif rival.kind == cause.kind:
            rival_texts.append(f"another {rival.kind}")
        else:
            rival_texts.append(rival.kind)
    different_texts = dict.fromkeys(rival_texts)  # each once, in order
    return f"{evidence}; this log does not distinguish it from {listed(different_texts, _MAX_LISTED_RIVALS)}"


def _delay_taken_off(delay: float, taken_off: float, level: Level) -> tuple[str, Level]:
    """Sentence on a delay [s] of a log from which a fit has removed ``taken_off`` [s], and the level of the doubt.

    The level is the given one if another delay was removed.
    """
    max_difference = max(_MAX_DELAY_DIFFERENCE, _MAX_RELATIVE_DELAY_DIFFERENCE * abs(delay))
    is_other_delay = abs(delay - taken_off) > max_difference
    if is_other_delay:
        shift = spell(Argument("shift", Placeholder(seconds(delay, 3))))
        return f"The fit has {seconds(taken_off, 3)} s in its place: give {shift}.", level
    if abs(delay) > _MAX_BUS_DELAY:
        return "The offset is taken off. Are positions commands? Log those of the encoders.", "unsure"
    return "The offset is taken off.", "note"
