"""What loggers call their columns: which joint's position, velocity, acceleration or torque a name means."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

PARTS = ("q", "dq", "ddq", "tau")
"""Coordinates, velocities, accelerations and torques, as a motion names them."""

_WORDS = {
    "q": ("q", "pos", "position", "positions", "angle", "angles", "jointposition"),
    "dq": ("dq", "qd", "qdot", "vel", "velocity", "velocities", "speed", "jointvelocity"),
    "ddq": ("ddq", "qdd", "qddot", "acc", "accel", "acceleration", "accelerations", "jointacceleration"),
    "tau": ("tau", "torque", "torques", "effort", "efforts", "force", "jointtorque"),
}
PART_OF = {word: part for part, words in _WORDS.items() for word in words}
"""Which part of a motion a word means."""
_NEUTRAL = frozenset(("joint", "joints", "jointstate", "jointstates", "state", "states", "actual", "act", "measured"))
_NEUTRAL |= frozenset(("meas", "msr", "feedback", "sensor", "value", "values", "data"))
_JOINT = frozenset(("joint", "joints", "axis", "j"))
_UNITS = frozenset(("rad", "deg"))
ROS_TIME = "%time"
"""What ``rostopic echo -p`` calls its time, in whole nanoseconds; other programs write seconds under the same name."""
_TIMES = ("time", "t")
_STAMPS = ("timestamp", "timestamps", "stamp", "time_stamp", "elapsed", "elapsed_time", "seconds", "secs", "clock")


@dataclass(frozen=True)
class Meaning:
    """What a column is of a joint."""

    name: int
    """Which of the names."""
    part: str
    """One of :data:`PARTS`."""
    unit: str | None = None
    """That the name ends in, as ``elbow_pos_deg`` does."""


class NamedJoints:
    """The names that columns may contain, each once; capitals count only where two names differ in nothing else."""

    def __init__(self, names: Sequence[str]) -> None:
        folded = [name.casefold() for name in names]
        self._fold = len(set(folded)) == len(folded)
        known = {self._key(name): k for k, name in enumerate(names)}
        for k, name in enumerate(names):  # elbow for elbow_joint, where that is no other joint
            short = re.sub(r"(_joint$|^joint_)", "", name, flags=re.IGNORECASE)
            others = [
                n for n in names if n != name and re.sub(r"(_joint$|^joint_)", "", n, flags=re.IGNORECASE) == short
            ]
            if len(short) > 2 and not short.isdigit() and not others:
                known.setdefault(self._key(short), k)
        self._known = sorted(known.items(), key=lambda item: -len(item[0]))

    def meaning(self, text: str) -> Meaning | None:
        """Of a column's name without its unit in brackets; None where it is not of these joints for certain.

        >>> joints = NamedJoints(["arm_1_joint", "arm_10_joint"])
        >>> joints.meaning("- arm_1_joint_position")
        Meaning(name=0, part='q', unit=None)
        >>> joints.meaning("/joint_states/effort/arm_10_joint").part
        'tau'
        >>> joints.meaning("arm_1_joint_temperature") is None
        True
        """
        key = self._key(text)
        for name, k in self._known:
            at = _place(name, key)
            if at is None:
                continue
            rest = key[:at] + " " + key[at + len(name) :]
            found = _part_of(_words(rest))
            if found is not None:
                return Meaning(k, *found)
        return None

    def _key(self, text: str) -> str:
        return text.casefold() if self._fold else text


def numbered(text: str) -> tuple[str, int | None, str | None] | None:
    """Part, number and unit of a column such as ``pos1``, ``actual_q_0`` or ``Joint_3``; the number None in ``position``.

    >>> numbered("vel2"), numbered("actual_q_0"), numbered("Joint_3"), numbered("torque"), numbered("target_q_0")
    (('dq', 2, None), ('q', 0, None), ('q', 3, None), ('tau', None, None), None)
    """
    words = _words(text)
    numbers = [w for w in words if w.isdigit()]
    others = [w for w in words if not w.isdigit()]
    if len(numbers) > 1 or (numbers and len(numbers[0]) > 3) or not others:
        return None
    if numbers and all(w in _JOINT for w in others):
        return "q", int(numbers[0]), None
    found = _part_of([w for w in others if w not in _JOINT])
    return None if found is None else (found[0], int(numbers[0]) if numbers else None, found[1])


def time_meaning(text: str) -> tuple[int, str | None] | None:
    """How surely a name means time (0 most), and the unit that it ends in; None for all other names.

    >>> time_meaning("Time"), time_meaning("timestamp_ns"), time_meaning("elbow")
    ((0, None), (1, 'ns'), None)
    """
    name = text.casefold().strip("%_ ")
    if name in _TIMES and text.strip() != ROS_TIME:
        return 0, None
    if name in (*_STAMPS, "time"):
        return 1, None
    name, _, unit = name.rpartition("_")
    return (1, unit) if unit in ("s", "sec", "ms", "us", "ns") and name in (*_TIMES, *_STAMPS) else None


def time_column(names: Sequence[str]) -> str:
    """What the column of time is called in a file of ours, beside columns of these names.

    >>> time_column(["elbow"]), time_column(["time", "elbow"])
    ('time', 'time [s]')
    """
    return next(name for name in ("time", "time [s]", "timestamp [s]", "seconds [s]") if name not in names)


def _place(name: str, text: str) -> int | None:
    """Where the name stands in the text as a word of its own."""
    at = text.find(name)
    while at >= 0:
        before, after = text[at - 1 : at] if at else "", text[at + len(name) : at + len(name) + 1]
        if not (before.isalnum() or after.isalnum()):
            return at
        at = text.find(name, at + 1)
    return None


def _words(text: str) -> list[str]:
    return re.findall(r"[^\W\d_]+|\d+", text.casefold())


def _part_of(words: list[str]) -> tuple[str, str | None] | None:
    """The quantity that the words beside a joint's name say, and their unit; none at all say its position."""
    units = [w for w in words if w in _UNITS]
    kinds = [w for w in words if w not in _UNITS and w not in _NEUTRAL]
    if units and kinds[-1:] == ["s"]:  # deg_s
        kinds = kinds[:-1]
        units = [f"{units[0]}/s"]
    if not words:
        return "q", None
    if len(kinds) != 1 or kinds[0] not in PART_OF or len(units) > 1:
        return None
    return PART_OF[kinds[0]], units[0] if units else None
