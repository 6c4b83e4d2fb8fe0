"""Torque limits and load margins, with argument checks of ``statics``."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import ShapeError, ValueRangeError
from ..core.numbers import margin, number, printed
from ..core.text import Argument, spell
from ..core.typing import Array
from ..robot.task_space_methods import require_robot

if TYPE_CHECKING:
    from ..mechanics.model.limits import Limits
    from ..robot import Robot

_NO_LEVER = 1e-12
"""Levers below this [m], or below this share of the longest, are rounding errors: their load does not affect the joint."""
_MAX_LISTED_NAMES = 12


def effort_limits(robot: Robot, limits: ArrayLike | None = None) -> Array:
    """Largest torque of each joint, (nv,) N m or N: ``limits`` if given, otherwise the robot's own limits.

    Entries of floating joints are zero, and joints without a limit have inf. At rest an elastic joint transmits its
    motor's torque, so the motor's limit applies to the joint. Raises :class:`~twistwrench.ShapeError`, and
    :class:`~twistwrench.ValueRangeError` if a limit is negative or no joint of the robot has a limit.
    """
    names = require_robot(robot, "statics").model.drive_names
    try:
        efforts = robot.limits.effort if limits is None else limits
        effort = arguments.one(efforts, "limits", robot.nv, names=names).copy()
    except ShapeError as problem:
        listed = ", ".join(names[:_MAX_LISTED_NAMES])
        if len(names) > _MAX_LISTED_NAMES:
            listed += ", …"
        raise ShapeError(
            f"{problem} Robot {robot.name!r} wants the largest torque or force of each of {listed}."
        ) from None
    free = floating_entries(robot)
    effort[free] = 0.0
    v_index = {body.joint.name: body.v_index for body in robot.model.leaders}
    for motor, actuator in robot.actuators.items():
        joint = actuator.joint
        if motor != joint and joint in v_index:  # an elastic joint
            effort[v_index[joint]] = min(effort[v_index[joint]], effort[v_index[motor]])
    if np.isnan(effort).any() or (effort < 0).any():
        k = int(np.argmax(~(effort >= 0)))
        raise ValueRangeError(
            f"the limit of {names[k]!r} is {printed(effort[k])}. Give a torque or force of at least zero."
        )
    if limits is None and robot.nv and not free.all() and np.isinf(effort[~free]).all():
        raise ValueRangeError(
            f"robot {robot.name!r} has no effort limits, so its holding torques are unbounded. "
            f"Pass {spell(Argument('limits'))} with {robot.nv} numbers [N m or N], one for each of "
            f"{', '.join(names[:_MAX_LISTED_NAMES])}."
        )
    return effort


def resting_torques(robot: Robot, q: ArrayLike, wrench_on_robot: Mapping[str, ArrayLike] | None = None) -> Array:
    """Torques that hold the robot at rest, (..., nv), against gravity, springs and wrenches on the robot.

    Torques of elastic transmissions are left out. At rest their deflection balances the load, so motor positions in
    ``q`` have no effect: see :func:`effort_limits`.
    """
    require_robot(robot, "statics")
    tau = np.asarray(robot.holding_torques(q, wrench_on_robot=wrench_on_robot))
    motors = {name for name, actuator in robot.actuators.items() if name != actuator.joint}
    gears = [spring for spring in robot.model.springs if not motors.isdisjoint(dict(spring.terms))]
    if not gears:
        return tau
    x, tau = np.asarray(robot.subtract(q, robot.neutral)), tau.copy()
    v_index = {body.joint.name: body.v_index for body in robot.model.leaders}
    for spring in gears:
        stretch = sum(weight * x[..., v_index[joint]] for joint, weight in spring.terms) - spring.rest
        for joint, weight in spring.terms:
            tau[..., v_index[joint]] -= weight * spring.stiffness * stretch
    return tau


def floating_entries(robot: Robot) -> Array:
    """Mask (nv,), True for entries of τ that belong to floating joints."""
    return np.array([not b.joint.driven for b in robot.model.leaders for _ in range(b.joint.nv)], bool)


def span(values: Array) -> str:
    """Text of the minimum and maximum of an array, and the number of NaN values."""
    known = values[~np.isnan(values)]
    text = "none known"
    if known.size:
        text = f"{number(known.min())} to {number(known.max())}"
    unknown = values.size - known.size
    if unknown:
        text += f"; {unknown} unknown, as q is not a number there"
    return text


def require_fixed_base(robot: Robot, what: str) -> None:
    """Raise ValueRangeError for a robot with a floating base or without joints, whose torques cannot hold it."""
    if robot.nv == 0:
        raise ValueRangeError(
            f"{what} needs a robot with moving joints, but {robot.name!r} has none. If joints are locked, lock fewer of them."
        )
    if floating_entries(robot).any():
        raise ValueRangeError(
            f"{what} of {robot.name!r} needs a fixed base, since a floating base is not driven. "
            f"With {spell(Argument('floating_base', False, option='fixed-base'))} the answer is that of a robot whose base"
            " a stand holds. What contacts with the ground carry is not part of it: in Python, "
            "statics.robot_equilibrium checks whether given contacts hold the robot."
        )


@dataclass(frozen=True, eq=False)
class Growth:
    """Interval of s in which start + s · step stays within the limits."""

    least: Array
    """(...): smallest s; greater than ``most`` if the interval is empty."""
    most: Array
    """(...): largest s, inf if the load does not act on any joint."""
    per_joint: Array
    """(..., nv): largest s of each joint alone."""
    joint: Array
    """(...) of int: joint that bounds ``most``; -1 if none."""
    side: Array
    """(...): +1 if the bound is the joint's upper limit, -1 if its lower limit, 0 if none."""


def growth(start: Array, step: Array, limits: Array) -> Growth:
    """Range of s with abs(start + s · step) ≤ limits, in closed form; (..., nv), (..., nv), (nv) → (...).

    For each joint, s lies between (∓L - sign(a) τ₀) / abs(a), with a the step and τ₀ the start.
    """
    start, step = np.broadcast_arrays(start, step)
    size = np.abs(step)
    felt = size > _NO_LEVER * np.maximum(1.0, size.max(axis=-1, initial=0.0, keepdims=True))
    lever = np.where(felt, size, 1.0)
    within = np.abs(start) <= limits + margin(limits)
    largest_s = np.where(felt, (limits - np.sign(step) * start) / lever, np.where(within, np.inf, -np.inf))
    least_s = np.where(felt, (-limits - np.sign(step) * start) / lever, np.where(within, -np.inf, np.inf))
    joint = np.argmin(largest_s, axis=-1)
    bound = np.take_along_axis(largest_s, joint[..., None], axis=-1)[..., 0]
    side = np.take_along_axis(np.where(step > 0, 1, -1), joint[..., None], axis=-1)[..., 0]
    free = ~np.isfinite(bound)
    return Growth(least_s.max(axis=-1), bound, largest_s, np.where(free, -1, joint), np.where(free, 0, side))


# ── Argument checks of ``statics``: poses and directions


def one_configuration(robot: Robot, q: ArrayLike, what: str, why: str) -> Array:
    """Check that ``q`` is one finite configuration (nq,). ShapeError and ValueRangeError quote ``what`` and ``why``."""
    require_robot(robot, what)
    array = np.asarray(arguments.real(q, f"{what}: q", robot.nq, names=robot.coordinate_names), float)
    if array.ndim != 1:
        raise ShapeError(
            f"{what} takes one q ({robot.nq},) of robot {robot.name!r}, got shape {array.shape}: {why}. "
            f"Call it pose by pose: [{what}(robot, x, …) for x in q.reshape(-1, {robot.nq})]."
        )
    if not np.isfinite(array).all():
        k = int(np.argmin(np.isfinite(array)))
        raise ValueRangeError(f"{what}: {robot.coordinate_names[k]!r} is {printed(array[k])}. Give finite coordinates.")
    return array


def unit_vectors(direction: ArrayLike, *sizes: int) -> Array:
    """Scale ``direction`` (..., n) to unit length; n must be one of ``sizes``. Raises ShapeError, ValueRangeError."""
    try:
        last_axis = np.shape(direction)[-1:]
    except ValueError:  # ragged; rejected below
        last_axis = ()
    n = last_axis[0] if last_axis and last_axis[0] in sizes else sizes[0]
    try:
        d = np.asarray(arguments.real(direction, "direction", n), float)
    except ShapeError as problem:
        more = "".join(f" Or give {k} numbers." for k in sizes[1:])
        raise ShapeError(f"{problem}{more}") from None
    length = np.linalg.norm(d, axis=-1, keepdims=True)
    if not (np.isfinite(length).all() and (length > 0).all()):
        raise ValueRangeError("a direction of zero or not finite length points nowhere. Give one with a finite length.")
    return d / length


def same_batch(**arrays: Array) -> None:
    """Check that batch shapes (all axes but the last) broadcast. Raises ShapeError."""
    try:
        np.broadcast_shapes(*(x.shape[:-1] for x in arrays.values()))
    except ValueError:
        raise arguments.mismatch(**arrays) from None


# ── Unit checks: millimetres for metres, degrees for radians

_SUSPECT_LENGTH = 1.0
"""m: lever or excess of a sliding joint above which a wrong unit is suspected."""


def unit_slips(
    robot: Robot, q: Array, limits: Limits, positions: Mapping[str, Array], *, degrees: bool = False
) -> Iterator[str]:
    """Warnings about values that suggest a wrong unit, in the named ``positions`` (3,) [m] and in q (nq,).

    Suspect values are a position beyond 1 m and a sliding joint more than 1 m beyond its limits. Unless angles are in
    ``degrees``, so is a revolute joint more than one turn beyond its limits, or beyond ±2 turns if it has none.
    """
    for name, position in positions.items():
        distance = float(np.linalg.norm(position))
        if distance > _SUSPECT_LENGTH:
            metres = ",".join(f"{printed(x / 1000)}" for x in position)
            yield f"{name} is {printed(distance)} m from its frame: lengths are in metres. If those are mm, write {metres}."
    for b in robot.model.leaders:
        if b.joint.nq != 1:
            continue
        name, value = b.joint.name, float(q[b.q_index])
        turns = bool(b.joint.axes[0][:3].any())
        bound = 2 * math.pi if turns else math.inf
        low, high = max(float(limits.lower[b.v_index]), -bound), min(float(limits.upper[b.v_index]), bound)
        beyond = max(low - value, value - high)
        if turns and not degrees and beyond > 2 * math.pi:
            yield (
                f"{name} at {printed(value)} rad is more than a turn beyond its limits: angles are in radians. If those "
                f"are degrees, add {spell(Argument('degrees', True))}."
            )
        elif not turns and beyond > _SUSPECT_LENGTH:
            yield (
                f"{name} at {printed(value)} m is more than 1 m beyond its limits: lengths are in metres. If those are mm, "
                f"write {printed(value / 1000)}."
            )
