"""Torque limits, resting torques and load margins."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import ShapeError, ValueRangeError
from ..core.numbers import margin, number, printed
from ..core.text import Argument, spell
from ..core.typing import Array
from ..robot.base import require_robot

if TYPE_CHECKING:
    from ..robot import Robot

_MAX_ROUNDING_OF_LEVER = 1e-12
"""Levers up to this [m], or this share of the longest, are rounding errors: their load does not affect the joint."""
_MAX_LISTED_NAMES = 12
"""Number of joints that a message names."""


def effort_limits(robot: Robot, limits: ArrayLike | None = None) -> Array:
    """Largest torque of each joint, (nv,) N m or N: ``limits`` if given, otherwise the robot's own limits.

    Entries of floating joints are zero, and joints without a limit have inf. At rest an elastic joint transmits its
    motor's torque, so the motor's limit applies to the joint. Raises :class:`~twistwrench.ShapeError`, and
    :class:`~twistwrench.ValueRangeError` if a limit is negative or no joint of the robot has a limit.
    """
    names = require_robot(robot, "statics").model.drive_names
    chosen_limits = robot.limits.effort if limits is None else limits
    try:
        effort = arguments.one(chosen_limits, "limits", robot.nv, names=names).copy()  # changed below
    except ShapeError as problem:
        listed = ", ".join(names[:_MAX_LISTED_NAMES])
        if len(names) > _MAX_LISTED_NAMES:
            listed += ", …"
        raise ShapeError(
            f"{problem} Robot {robot.name!r} wants the largest torque or force of each of {listed}."
        ) from None
    is_floating = floating_entries(robot)
    effort[is_floating] = 0.0
    v_indices = {body.joint.name: body.v_index for body in robot.model.leaders}
    for motor, actuator in robot.actuators.items():
        joint = actuator.joint
        if motor != joint and joint in v_indices:  # an elastic joint, whose motor has a coordinate of its own
            joint_entry = v_indices[joint]
            motor_limit = effort[v_indices[motor]]
            effort[joint_entry] = min(effort[joint_entry], motor_limit)
    is_invalid = ~(effort >= 0)  # negative or NaN
    if is_invalid.any():
        first_invalid = int(np.flatnonzero(is_invalid)[0])
        raise ValueRangeError(
            f"the limit of {names[first_invalid]!r} is {printed(effort[first_invalid])}. "
            "Give a torque or force of at least zero."
        )
    driven_limits = effort[~is_floating]
    if limits is None and driven_limits.size and np.isinf(driven_limits).all():
        raise ValueRangeError(
            f"robot {robot.name!r} has no effort limits, so its holding torques are unbounded. "
            f"Pass {spell(Argument('limits'))} with {robot.nv} numbers [N m or N], one for each of "
            f"{', '.join(names[:_MAX_LISTED_NAMES])}."
        )
    return effort


def resting_torques(robot: Robot, q: ArrayLike, wrench_on_robot: Mapping[str, ArrayLike] | None = None) -> Array:
    """Torques that hold the robot at rest, (..., nv), against gravity, springs and wrenches on the robot.

    Torques of elastic transmissions are left out: at rest, their deflection balances the load. Motor positions in
    ``q`` therefore have no effect.
    """
    require_robot(robot, "statics")
    tau = np.asarray(robot.holding_torques(q, wrench_on_robot=wrench_on_robot))
    motors_of_elastic_joints = {name for name, actuator in robot.actuators.items() if name != actuator.joint}
    transmissions = []  # springs between a motor and its joint
    for spring in robot.model.springs:
        joints_of_spring = {joint for joint, _ in spring.terms}
        if motors_of_elastic_joints & joints_of_spring:
            transmissions.append(spring)
    if not transmissions:
        return tau
    displacement = np.asarray(robot.subtract(q, robot.neutral))
    tau = tau.copy()
    v_indices = {body.joint.name: body.v_index for body in robot.model.leaders}
    for spring in transmissions:
        length = sum(weight * displacement[..., v_indices[joint]] for joint, weight in spring.terms)
        stretch = length - spring.rest
        for joint, weight in spring.terms:
            tau[..., v_indices[joint]] -= weight * spring.stiffness * stretch
    return tau


def floating_entries(robot: Robot) -> Array:
    """Mask (nv,), True for entries of τ that belong to floating joints."""
    is_floating = [not body.joint.driven for body in robot.model.leaders]
    velocity_counts = [body.joint.nv for body in robot.model.leaders]
    return np.repeat(np.array(is_floating, bool), velocity_counts)


def span(values: Array) -> str:
    """Text of the minimum and maximum of an array, and the number of NaN values."""
    known_values = values[~np.isnan(values)]
    text = "none known"
    if known_values.size:
        text = f"{number(known_values.min())} to {number(known_values.max())}"
    unknown_count = values.size - known_values.size
    if unknown_count:
        text += f"; {unknown_count} unknown, as q is not a number there"
    return text


def require_fixed_base(robot: Robot, what: str) -> None:
    """Raise ValueRangeError if a robot has no moving joints, or a floating base, which torques cannot hold.

    The message begins with ``what``, the requested quantity.
    """
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
    """(..., nv): largest s by the limit of each joint alone."""
    joint: Array
    """(...) of int: index of the joint that bounds ``most``; -1 if none."""
    side: Array
    """(...): +1 if the bound is the joint's upper limit, -1 if its lower limit, 0 if none."""


def growth(start: Array, step: Array, limits: Array) -> Growth:
    """Range of s with abs(start + s · step) ≤ limits, in closed form; (..., nv), (..., nv), (nv) → (...).

    For each joint, s lies between (-L - sign(a) τ₀) / abs(a) and (L - sign(a) τ₀) / abs(a), with a the step, τ₀ the
    start and L the limit. With a step of zero, any s stays within the limit if τ₀ does, and otherwise none.
    """
    start, step = np.broadcast_arrays(start, step)
    step_size = np.abs(step)
    max_step_size = step_size.max(axis=-1, initial=0.0, keepdims=True)
    is_loaded = step_size > _MAX_ROUNDING_OF_LEVER * np.maximum(1.0, max_step_size)
    divisor = np.where(is_loaded, step_size, 1.0)
    signed_start = np.sign(step) * start
    starts_within = np.abs(start) <= limits + margin(limits)
    s_if_unloaded = np.where(starts_within, np.inf, -np.inf)
    largest_s = np.where(is_loaded, (limits - signed_start) / divisor, s_if_unloaded)
    least_s = np.where(is_loaded, (-limits - signed_start) / divisor, -s_if_unloaded)
    joint = np.argmin(largest_s, axis=-1)
    most = largest_s.min(axis=-1)
    sides = np.where(step > 0, 1, -1)  # of each joint
    side = np.take_along_axis(sides, joint[..., None], axis=-1)[..., 0]
    is_unbounded = ~np.isfinite(most)
    return Growth(
        least=least_s.max(axis=-1),
        most=most,
        per_joint=largest_s,
        joint=np.where(is_unbounded, -1, joint),
        side=np.where(is_unbounded, 0, side),
    )
