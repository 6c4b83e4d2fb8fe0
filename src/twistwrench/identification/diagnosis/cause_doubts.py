"""Doubts about the causes of a fit's residual: sentences with values and intervals, and laws that belong to the robot."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from ...core.doubts import Doubt, DoubtKind, Level, doubt, doubt_table
from ...core.numbers import number, percent, seconds
from ...core.text import Argument, Placeholder, listed, spell
from .cause_fit import CauseFit
from .diagnose import FoundCause, WantedCause

_LOOK_AGAIN_EFFECT, _UNSURE_EFFECT = 0.05, 0.01
"""Changes of predicted torques, as shares of a joint's torque, from which a cause makes the verdict LOOK AGAIN or UNSURE."""
_LEAST_DELAY, _SAME_DELAY = 8e-3, (2e-3, 0.1)
"""Minimum reported delay [s]; absolute [s] and relative difference below which two delays are equal."""
_MAX_BUS_DELAY = 30e-3
"""Longest delay [s] of a bus or a filter; a longer one suggests that positions are commands."""


def cause_doubts(names: Sequence[str], causes: Iterable[FoundCause], taken_off: float) -> list[Doubt]:
    """Doubts about the causes of the residual, in the order in which the causes were found."""
    return [
        doubt_of_cause(names, cause, taken_off)
        for cause in causes
        if cause.kind != "late" or cause.value is None or abs(float(cause.value[0])) >= _LEAST_DELAY
    ]


_OF_THE_ROBOT = ("load-friction", "stribeck")
"""Laws that belong to the robot, not to a fault of its log, in the order in which they are fitted."""
_MIN_DECREASE, _MOST_LAWS = 0.05, 2


def laws_of_the_robot(causes: Iterable[FoundCause]) -> tuple[WantedCause, ...]:
    """At most two laws of the robot that lower the residual of held-out rows by 5 % of itself."""
    laws: list[WantedCause] = []
    of_robot = [one for one in causes if one.kind in _OF_THE_ROBOT]
    for one in sorted(of_robot, key=lambda one: _OF_THE_ROBOT.index(one.kind)):
        all_joints = one.kind == "stribeck" or len(one.joints) == len(one.fit.live)
        law = WantedCause(one.kind, () if all_joints else one.joints)
        is_large = _weighted_squares(one.fit) <= (1.0 - _MIN_DECREASE) ** 2 * _weighted_squares(one.before)
        if is_large and law not in laws:
            laws.append(law)
    return tuple(laws[:_MOST_LAWS])


def _weighted_squares(fit: CauseFit) -> float:
    """Sum of the squared held-out residuals."""
    return float(((fit.left * fit.spread) ** 2).sum())


def doubt_of_cause(names: Sequence[str], cause: FoundCause, taken_off: float | None = None) -> Doubt:
    """Doubt for a cause; ``names`` are the joints' names, ``taken_off`` is the delay [s] that a fit has removed."""
    joints = [names[k] for k in cause.joints]
    named = "all joints" if len(joints) == len(names) > 1 else listed(joints)
    row = doubt_table()[cause.kind]
    effect_level = _level_of_effect(cause.effect)
    level = _level_of_row(row, effect_level)
    if taken_off is not None and cause.kind in _OF_THE_ROBOT:
        level = "note"  # a law that rows held out confirm is fitted
    words = _words(names, cause)
    if cause.kind == "late" and taken_off is not None:
        words["taken"], level = _delay_taken_off(cause.fit.states.shift, taken_off, effect_level)
    value, interval = cause.value_and_interval
    found = {
        "value": value,
        "interval": interval,
        "unit": row.unit,
        "statistic": cause.S,
        "share": cause.most[1],
        "effect": cause.effect,
    }
    log = f"log {cause.log}" if cause.log else ""
    return doubt(cause.kind, joints, level=level, log=log, found=found, named=named, **words)


def _level_of_effect(effect: float) -> Level:
    """Level of a cause by its effect on predicted torques."""
    if effect > _LOOK_AGAIN_EFFECT:
        return "refuse"
    if effect > _UNSURE_EFFECT:
        return "unsure"
    return "note"


def _level_of_row(row: DoubtKind, of_effect: Level) -> Level:
    """Level of a cause with a row of the table of doubts."""
    if row.level == "effect" or (row.stage == 1 and of_effect == "note"):
        return of_effect
    return row.level


def _words(names: Sequence[str], cause: FoundCause) -> dict[str, str]:
    """Words of the sentence about a cause."""
    words = {
        "evidence": _evidence(names, cause),
        "gravity": ", ".join(number(x, 4) for x in cause.fit.states.gravity),
        "taken": "The command identify takes it off.",
        **dict.fromkeys(("value", "interval", "from_", "to", "size", "way"), ""),
    }
    value, interval = cause.value_and_interval
    if value is not None:
        words["value"] = number(abs(value) if cause.kind == "late" else value, 3)
        words["way"] = "after" if value > 0 else "before"
    if interval is not None:
        words["interval"] = f" (95 %: {number(interval[0], 3)} to {number(interval[1], 3)})"
    if cause.span is not None:
        words["from_"], words["to"] = seconds(cause.span[0], 4), seconds(cause.span[1], 4)
    if cause.size is not None:
        words["size"] = number(cause.size, 2)
    return words


def _evidence(names: Sequence[str], cause: FoundCause) -> str:
    """Share of a joint's residual that a cause explains, and the causes that explain the log as well."""
    worst, share = cause.most
    evidence = f"it takes away {percent(share, 2)} of the residual of {names[worst]}"
    if not cause.rivals:
        return evidence
    rivals: list[str] = []
    for one in cause.rivals:
        if one.joints:
            rivals.append(f"{one.kind} of {listed([names[k] for k in one.joints])}")
        elif one.kind == cause.kind:
            rivals.append(f"another {one.kind}")
        else:
            rivals.append(one.kind)
    return f"{evidence}; this log does not distinguish it from {listed(dict.fromkeys(rivals), 3)}"


def _delay_taken_off(delay: float, taken_off: float, level: Level) -> tuple[str, Level]:
    """Sentence on a delay [s] of which a fit has removed ``taken_off`` [s], and the level of the doubt."""
    if abs(delay - taken_off) > max(_SAME_DELAY[0], _SAME_DELAY[1] * abs(delay)):
        shift = spell(Argument("shift", Placeholder(seconds(delay, 3))))
        return f"The fit has {seconds(taken_off, 3)} s in its place: give {shift}.", level
    if abs(delay) > _MAX_BUS_DELAY:
        return "The offset is taken off. Are positions commands? Log those of the encoders.", "unsure"
    return "The offset is taken off.", "note"
