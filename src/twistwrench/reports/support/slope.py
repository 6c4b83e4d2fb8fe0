"""Slope of the ground, and reasons why contacts, or gravity, do not fit the normal along which the ground pushes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ...core.numbers import number, seconds, vector
from ...core.text import Argument, in_the_shell, listed, spell
from ...core.typing import Array
from ...core.verdict import Reason
from ...motion.differentiation import MotionSamples
from .ground import MAX_CARRYING_SPEED

if TYPE_CHECKING:
    from ...motion.motion import Motion
    from .standing import StandingCase

_STATES_PER_BATCH = 4096
"""Number of states that are evaluated at once."""
_MAX_UNEVENNESS = 0.02
"""Largest difference in height of contacts on level ground, as a share of their distance."""
_MIN_HEIGHT_DIFFERENCE = 0.002
"""Difference in height up to which contacts are level at any distance [m]."""
_MAX_DISTANCE_FROM_PLANE = 0.1
"""Largest distance from one plane, as a share of the difference in height, for which contacts lie on a slope."""
_MAX_NORMAL_SPEED = 0.1
"""Speed of a wheel along the normal of the ground above which it does not stay on the ground [m/s]."""
_MIN_SLOPE = math.radians(0.5)
"""Angle [rad] above which a slope is stated."""
_MAX_LISTED_FRAMES = 4
"""Largest number of frames that a sentence lists."""


def samples(motion: Motion, rows: slice | Array) -> MotionSamples:
    """States of a motion in these rows."""
    time, q, dq, ddq = motion.time[rows], motion.q[rows], motion.dq[rows], motion.ddq[rows]
    is_stationary = np.zeros(dq.shape, bool)
    no_outliers = np.zeros((len(time), 0))
    return MotionSamples(time, q, dq, ddq, q, is_stationary, no_outliers)


def slope(load: StandingCase) -> float:
    """Angle between the normal of the ground and the vertical [rad]; 0 without gravity, and below half a degree."""
    gravity = load.robot.model.gravity
    strength = float(np.linalg.norm(gravity))
    if not strength:
        return 0.0
    cosine = float(-gravity @ load.ground.normal) / strength
    angle = math.acos(min(1.0, max(-1.0, cosine)))  # rounding may take the cosine beyond 1
    return angle if angle > _MIN_SLOPE else 0.0


def ground_doubt(load: StandingCase, motion: Motion, in_contact: Array, failing: Array) -> str:
    """Reason why the ground is not as assumed; empty if it fits.

    Reasons are that nothing presses the robot onto the ground, that a wheel leaves it, or that contacts stand at different
    heights. Heights are compared among contacts that carry. In the first state, and in those that are ``failing`` (n,),
    feet at rest are compared as well: feet on a slope that is taken as level stand at different heights, so that not all
    seem to carry. A normal that the user states is not doubted.
    """
    ground = load.ground
    gravity = load.robot.model.gravity
    is_pulled = any(contact.pull > 0 for contact in ground.contacts)
    is_pressed = float(-gravity @ ground.normal) > 0.0
    if ground.on_ground.all() and not is_pulled and not is_pressed:
        return _doubt_of_gravity(gravity, ground.normal)
    doubt = ""
    largest_spread = 0.0  # of the heights in a state [m]
    frames = [str(contact.frame) for contact in ground.contacts]
    is_wheel = ~np.array(ground.automatic) & ground.on_ground
    for start in range(0, len(motion), _STATES_PER_BATCH):
        rows = slice(start, start + _STATES_PER_BATCH)
        time = motion.time[rows]
        points, velocities = ground.points_and_velocities(load.robot, samples(motion, rows))
        doubt_of_wheels = _doubt_of_wheel_speeds(frames, velocities @ ground.normal, is_wheel, time)
        if doubt_of_wheels:
            return doubt_of_wheels
        if ground.normal_given:
            continue
        always_on_ground = is_wheel if ground.schedule is None else ground.on_ground  # (contacts,)
        carries = in_contact[rows] & always_on_ground  # (states, contacts)
        is_first_state = np.arange(start, start + len(points)) == 0
        compares_resting_feet = failing[rows] | is_first_state
        is_compared = carries.copy()
        if ground.schedule is None:
            is_slow = np.linalg.norm(velocities, axis=-1) < MAX_CARRYING_SPEED
            is_compared |= is_slow & ground.on_ground & compares_resting_feet[:, None]
        has_heights = carries.any(axis=1) | compares_resting_feet
        for k in np.flatnonzero(has_heights):
            spread, plane_normal = _height_difference(points[k], is_compared[k], ground.normal)
            has_resting_feet = carries[k].sum() != is_compared[k].sum()
            may_be_lifted_foot = plane_normal is None and has_resting_feet
            if spread > largest_spread and not may_be_lifted_foot:
                largest_spread = spread
                doubt = _doubt_of_heights(
                    frames, points[k], is_compared[k], ground.normal, plane_normal, float(time[k])
                )
    return doubt


def _doubt_of_gravity(gravity: Array, normal: Array) -> str:
    """Doubt about a robot that nothing presses onto the ground."""
    if not gravity.any():
        return "without gravity nothing presses the robot onto the ground"
    opposite_normal = _normal_argument(-normal)
    return Reason(
        f"gravity, {vector(gravity)} m/s², points away from the ground, whose normal is {vector(normal)}: nothing "
        f"presses the robot on. If the ground is on the other side, give its normal, {opposite_normal}",
        opposite_normal,
    )


def _doubt_of_wheel_speeds(frames: list[str], normal_speeds: Array, is_wheel: Array, time: Array) -> str:
    """Doubt about the fastest wheel, by speeds (n, c) of contacts along the normal of the ground; empty if all are slow."""
    wheel_speeds = np.where(is_wheel, np.abs(normal_speeds), 0.0)
    row, wheel = np.unravel_index(int(wheel_speeds.argmax()), wheel_speeds.shape)
    speed = float(wheel_speeds[row, wheel])
    if speed <= _MAX_NORMAL_SPEED:
        return ""
    return (
        f"{frames[wheel]} moves at {number(speed, 2)} m/s along the normal of the ground at t = "
        f"{seconds(float(time[row]))} s, where it should stay on it"
    )


def _normal_argument(normal: Array) -> str:
    """Argument that states a normal, as the caller types it."""
    rounded_normal = [round(float(x), 4) + 0.0 for x in normal]  # + 0 turns -0 into 0
    if in_the_shell():
        text = ",".join(map(number, rounded_normal))
        return spell(Argument("contact_normal", text))
    return spell(Argument("contact_normal", rounded_normal))


def _height_difference(points: Array, is_compared: Array, normal: Array) -> tuple[float, Array | None]:
    """Difference in height [m] of the compared contacts (c,), and the normal of their plane.

    The difference is 0 if they are level. The normal is None if they are level or do not lie on one plane.
    """
    if not is_compared.any():
        return 0.0, None
    compared_points = points[is_compared]
    heights = compared_points @ normal
    spread = float(np.ptp(heights))
    horizontal = compared_points - heights[:, None] * normal
    distance = float(np.linalg.norm(np.ptp(horizontal, axis=0)))
    if spread <= max(_MIN_HEIGHT_DIFFERENCE, _MAX_UNEVENNESS * distance):
        return 0.0, None
    centred = compared_points - compared_points.mean(axis=0)
    _, widths, axes = np.linalg.svd(centred)  # widest direction first
    if len(compared_points) <= 2 or widths[1] <= _MAX_DISTANCE_FROM_PLANE * widths[0]:  # nearly on one line
        return spread, None
    plane_normal = axes[2]  # the narrowest direction
    max_distance_from_plane = float(np.abs(centred @ plane_normal).max())
    if max_distance_from_plane > _MAX_DISTANCE_FROM_PLANE * spread:
        return spread, None
    return spread, plane_normal * np.sign(plane_normal @ normal)  # upward


def _doubt_of_heights(
    frames: list[str], points: Array, is_compared: Array, normal: Array, plane_normal: Array | None, time: float
) -> str:
    """Doubt about contacts at different heights; ``plane_normal`` is the normal of their plane, None if they lie on none."""
    heights = points @ normal
    heights = heights - heights[is_compared].min()  # above the lowest compared contact
    height_by_frame = {frames[k]: number(float(heights[k]), 2) for k in np.flatnonzero(is_compared)}
    texts = [f"{frame} {height} m" for frame, height in height_by_frame.items()]
    level_argument = _normal_argument(normal)
    doubt = f"contacts stand at different heights at t = {seconds(time)} s: {listed(texts, _MAX_LISTED_FRAMES)}"
    if plane_normal is None:
        return Reason(
            f"{doubt}. If the ground is level at each of them, state its normal, {level_argument}", level_argument
        )
    cosine = min(1.0, float(plane_normal @ normal))
    angle = math.degrees(math.acos(cosine))
    slope_argument = _normal_argument(plane_normal)
    return Reason(
        f"{doubt}. Does the floor slope by {number(angle, 2)}°? Give its normal, {slope_argument}, or {level_argument} if it "
        "is level at each of them",
        slope_argument,
    )
