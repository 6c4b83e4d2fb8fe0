"""The joints that ``--lock JOINT=VALUE`` holds still: by their names, or by patterns such as ``*wheel*``."""

from __future__ import annotations

import math
from collections.abc import Mapping
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING

from ..core.printed_numbers import number, printed, quantity
from ..errors import UnknownNameError, ValueRangeError
from ..joints.units import unit_of
from ..model.model import BASE

if TYPE_CHECKING:
    from ..model.model import Body, Model


def joints_held(model: Model, lock: Mapping[str, float], *, degrees: bool) -> dict[str, float]:
    """The positions [rad, m] of all joints that ``lock`` means; of turning joints it says degrees if ``degrees``.

    A name says more than a pattern. Raises :class:`~twistwrench.UnknownNameError` for a pattern that no joint has, and
    :class:`~twistwrench.ValueRangeError` for positions beyond a joint's limits and for patterns that contradict each other.
    """
    bodies = {b.joint.name: b for b in model.bodies}
    found: dict[str, float] = {}
    said: dict[str, str] = {}
    for name in sorted(lock, key=lambda n: not _is_pattern(n, bodies)):
        if not _is_pattern(name, bodies):
            matches = [name]
        else:
            leaders = [b.joint.name for b in model.leaders if b.joint.nv == 1]
            matches = [joint for joint in leaders if fnmatchcase(joint, name)]
            if not matches:
                raise UnknownNameError.of("joint that fits the pattern", name, leaders)
        for joint in matches:
            value = lock[name]
            if joint in bodies:
                turns = bodies[joint].joint.turning[0]
                value = math.radians(value) if degrees and turns else value
            if _is_pattern(name, bodies) and joint in found and found[joint] != value:
                raise ValueRangeError(
                    f"--lock {said[joint]!r} and --lock {name!r} both hold {joint!r}. Keep one of them."
                )
            found[joint], said[joint] = value, name
    for b in model.leaders:
        if b.joint.name in found and b.joint.nv == 1:
            _check(
                model,
                b,
                found[b.joint.name],
                f"--lock {said[b.joint.name]}={printed(lock[said[b.joint.name]])}",
                degrees=degrees,
            )
    return found


def joints_beside(model: Model, base: str, tip: str) -> tuple[str, ...]:
    """The joints whose coordinates move nothing between the frames ``base`` and ``tip``.

    Raises :class:`~twistwrench.UnknownNameError` for frames that are not there, and
    :class:`~twistwrench.ValueRangeError` where no joint is between them.
    """

    def above(frame: str) -> set[int]:
        found, k = set(), model.frame(frame).body
        while k != BASE:
            found.add(k)
            k = model.bodies[k].parent
        return found

    between = {model.bodies[k].q_index for k in above(base) ^ above(tip)}
    if not between:
        raise ValueRangeError(
            f"--chain {base} {tip}: no joint moves one of these frames from the other. Name two others."
        )
    return tuple(b.joint.name for b in model.leaders if b.q_index not in between)


def _is_pattern(name: str, joints: Mapping[str, object]) -> bool:
    return name not in joints and any(c in name for c in "*?[")


def _check(model: Model, body: Body, value: float, told: str, *, degrees: bool) -> None:
    low, high = float(model.limits.lower[body.v_index]), float(model.limits.upper[body.v_index])
    most = float(model.limits.tolerance[body.v_index])
    if low - most <= value <= high + most:
        return
    turns = body.joint.turning[0]
    unit, shown = math.degrees(1.0) if degrees and turns else 1.0, unit_of("q", turns, degrees=degrees)
    joint = "" if body.joint.name in told else f" {body.joint.name}"
    hint = ""
    if turns and not degrees and low <= math.radians(value) <= high:
        hint = f" If {printed(value)} are degrees, add --degrees, or write {number(math.radians(value), 6)}."
    raise ValueRangeError(
        f"{told} is outside the joint's limits,{joint} {quantity(unit * low, shown, 6)} to {quantity(unit * high, shown, 6)}. "
        f"Hold it within them.{hint}"
    )
