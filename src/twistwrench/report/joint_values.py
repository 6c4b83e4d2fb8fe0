"""Numbers for joints as typed in a shell: ``JOINT=VALUE`` each, all at once, or a configuration of the file by name."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from ..core.printed_numbers import number, printed
from ..errors import UnknownNameError, ValueRangeError
from ..motion.coordinates import Coordinates
from ..typing import Array

if TYPE_CHECKING:
    from ..model.model import Body
    from ..robot import Robot


_PLAINLY_DEGREES = 3 * math.tau
"""rad: three turns, which hardly any joint makes, and 19 degrees, which any does."""


def parse_configuration(
    robot: Robot,
    at: Iterable[str],
    whole: str | None = None,
    *,
    degrees: bool,
    option: str = "--at",
    start: Array | None = None,
) -> Array:
    """Configuration (nq,) that the texts of an option say: each ``JOINT=VALUE``, or one of them all coordinates.

    All coordinates are ``v,v,…`` or the name of a configuration of the robot, as are those of ``--configuration``,
    ``whole``. Joints that are not named are as in ``start`` (nq,), else neutral. Raises ValueRangeError and
    UnknownNameError, which say what was wrong.
    """
    q = np.array(robot.neutral if start is None else start)
    single = [text for text in at if "=" in text]
    wholes = [("--configuration", whole)] if whole is not None else []
    wholes += [(option, text) for text in at if "=" not in text]
    if len(wholes) > 1:
        said = " and ".join(f"{name} {text!r}" for name, text in wholes[:2])
        raise ValueRangeError(f"{said} both say all coordinates. Keep one of them; others are JOINT=VALUE.")
    unit = np.where(Coordinates.of(robot.model).angular & degrees, math.radians(1.0), 1.0)
    for name, text in wholes:
        q = _all_coordinates(robot, text, name, unit)
    for body, numbers in _named(robot, single, option, velocities=False):
        here = body.places[0]
        q[here] = np.array(numbers) * unit[here]
    return q


def _all_coordinates(robot: Robot, text: str, option: str, unit: Array) -> Array:
    known = robot.configurations
    if text in known:
        return np.array(known[text])
    names, first = robot.coordinate_names, next(iter(b.joint.name for b in robot.model.leaders), "joint1")
    form = f"{robot.nq} numbers, {','.join(names[:8])}{',…' if len(names) > 8 else ''}; or JOINT=VALUE, as {first}=0.5"
    if known:
        form += f"; or a configuration of the file: {', '.join(list(known)[:8])}{', …' if len(known) > 8 else ''}"
    return np.array(parse_numbers(text, option, form, robot.nq)) * unit


def degrees_hint(robot: Robot, q: Array) -> str:
    """What to say of coordinates q (nq,) [rad] that are plainly degrees; empty if they are not.

    >>> import twistwrench as tw
    >>> degrees_hint(tw.robots.planar_2r(), np.array([90.0, 0.0]))[:45]
    'joint1 is at 90 rad, 14.3 turns. For degrees '
    >>> degrees_hint(tw.robots.planar_2r(), np.array([-6.5, 0.0]))
    ''
    """
    angular = np.where(Coordinates.of(robot.model).angular, np.abs(q), 0.0)
    if angular.max(initial=0.0) < _PLAINLY_DEGREES:
        return ""
    k = int(np.argmax(angular))
    name = robot.coordinate_names[k]
    return f"{name} is at {printed(q[k])} rad, {number(angular[k] / math.tau, 3)} turns. For degrees add --degrees."


def parse_rates(robot: Robot, texts: Iterable[str], option: str, *, degrees: bool) -> Array:
    """Velocities or torques (nv,) from ``JOINT=VALUE`` each, others zero; in degrees only what turns. Raises as above."""
    found = np.zeros(robot.nv)
    for body, numbers in _named(robot, texts, option, velocities=True):
        here = body.places[1]
        turning = np.any(body.joint.axes[:, :3] != 0, axis=1)
        found[here] = np.where(turning & degrees, np.radians(numbers), numbers)
    return found


def parse_numbers(text: str, what: str, form: str, count: int) -> list[float]:
    """That many finite numbers, separated by commas; ValueRangeError shows the form."""
    try:
        numbers = [float(x) for x in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        raise ValueRangeError(f"{what} {text!r}: expected {form}.")
    return numbers


def _named(robot: Robot, texts: Iterable[str], option: str, *, velocities: bool) -> list[tuple[Body, list[float]]]:
    known = {b.joint.name: b for b in robot.model.leaders}
    found: dict[str, tuple[Body, list[float]]] = {}
    for text in texts:
        joint, equals, value = (part.strip() for part in text.partition("="))
        if not equals:
            raise ValueRangeError(
                f"{option} {text!r} is not JOINT=VALUE, for example {next(iter(known), 'joint1')}=0.5."
            )
        if joint not in known:
            raise UnknownNameError.of("joint", joint, known)
        if joint in found:
            raise ValueRangeError(f"{option} {joint} is given twice. Keep one of them.")
        count = known[joint].joint.nv if velocities else known[joint].joint.nq
        form = f"{count} number{'s' if count > 1 else ''}"
        found[joint] = known[joint], parse_numbers(value, f"{option} {joint}", form, count)
    return list(found.values())
