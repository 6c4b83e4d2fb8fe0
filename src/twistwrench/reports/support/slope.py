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

_ROWS = 4096
"""States of one batch."""
_MAX_UNEVENNESS, _MIN_HEIGHT_DIFFERENCE = 0.02, 0.002
"""Difference in height of contacts on level ground, as a share of their distance, and in any case [m]."""
_MAX_DISTANCE_FROM_PLANE = 0.1
"""Distance from one plane, as a share of the difference in height, up to which contacts lie on a slope."""
_MAX_NORMAL_SPEED = 0.1
"""Speed of a wheel along the normal of the ground from which it does not stay on it [m/s]."""
_MIN_SLOPE = math.radians(0.5)
"""Angle from which a slope is stated."""
_MAX_LISTED = 4


def samples(motion: Motion, rows: slice | Array) -> MotionSamples:
    """Some states of a motion."""
    time, q, dq, ddq = motion.time[rows], motion.q[rows], motion.dq[rows], motion.ddq[rows]
    return MotionSamples(time, q, dq, ddq, q, np.zeros(dq.shape, bool), np.zeros((len(time), 0)))


def slope(load: StandingCase) -> float:
    """Angle between the normal of the ground and the vertical [rad]; 0 without gravity, and below half a degree."""
    gravity = load.robot.model.gravity
    strength = float(np.linalg.norm(gravity))
    if not strength:
        return 0.0
    angle = math.acos(min(1.0, max(-1.0, float(-gravity @ load.ground.normal) / strength)))
    return angle if angle > _MIN_SLOPE else 0.0


def ground_doubt(load: StandingCase, motion: Motion, in_contact: Array, failing: Array) -> str:
    """Reason why the ground is not as assumed; empty if it fits.

    Nothing presses the robot on, a wheel leaves the ground, or contacts stand at different heights. Heights are those of
    contacts that carry; of feet that rest too, in the first state and in those that are ``failing``, since the feet of a
    robot on a slope stand at different heights. A normal that the user states is not doubted.
    """
    ground, gravity = load.ground, load.robot.model.gravity
    pulled = any(contact.pull > 0 for contact in ground.contacts)
    if not pulled and ground.on_ground.all() and not float(-gravity @ ground.normal) > 0.0:
        return _nothing_presses(gravity, ground.normal)
    doubt, largest_spread = "", 0.0
    frames = [str(contact.frame) for contact in ground.contacts]
    wheels = ~np.array(ground.automatic) & ground.on_ground
    for start in range(0, len(motion), _ROWS):
        rows = slice(start, start + _ROWS)
        time = motion.time[rows]
        points, velocities = ground.points_and_velocities(load.robot, samples(motion, rows))
        leaving = _leaving(frames, velocities @ ground.normal, wheels, time)
        if leaving:
            return leaving
        if ground.normal_given:
            continue
        carrying = in_contact[rows] & (wheels if ground.schedule is None else ground.on_ground)
        standing = carrying.copy()  # with the feet that rest, where these are asked for
        with_resting_feet = failing[rows] | (np.arange(start, start + len(points)) == 0)
        if ground.schedule is None:
            slow = (np.linalg.norm(velocities, axis=-1) < MAX_CARRYING_SPEED) & ground.on_ground
            standing |= slow & with_resting_feet[:, None]
        for k in np.flatnonzero(carrying.any(axis=1) | with_resting_feet):
            spread, plane = _height_difference(points[k], standing[k], ground.normal)
            lifted = carrying[k].sum() != standing[k].sum()  # one foot, if no plane fits
            if spread > largest_spread and not (plane is None and lifted):
                largest_spread = spread
                doubt = _words(frames, points[k], standing[k], ground.normal, plane, float(time[k]))
    return doubt


def _nothing_presses(gravity: Array, normal: Array) -> str:
    if not gravity.any():
        return "without gravity nothing presses the robot onto the ground"
    stated = _normal_argument(-normal)
    return Reason(
        f"gravity, {vector(gravity)} m/s², points away from the ground, whose normal is {vector(normal)}: nothing "
        f"presses the robot on. If the ground is on the other side, give its normal, {stated}",
        stated,
    )


def _leaving(frames: list[str], speeds: Array, wheels: Array, time: Array) -> str:
    """Reason to doubt a log whose wheels move along the normal of the ground, by their speeds (n, c); empty if none does."""
    wheel_speeds = np.where(wheels, np.abs(speeds), 0.0)
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
    numbers = [round(float(x), 4) + 0.0 for x in normal]
    if in_the_shell():
        return spell(Argument("contact_normal", ",".join(map(number, numbers))))
    return spell(Argument("contact_normal", numbers))


def _height_difference(points: Array, standing: Array, normal: Array) -> tuple[float, Array | None]:
    """Difference in height of some contacts, 0 if they are level, and the normal of their plane if they lie on one."""
    if not standing.any():
        return 0.0, None
    chosen = points[standing]
    heights = chosen @ normal
    spread = float(np.ptp(heights))
    across = chosen - heights[:, None] * normal
    size = float(np.linalg.norm(np.ptp(across, axis=0)))
    if spread <= max(_MIN_HEIGHT_DIFFERENCE, _MAX_UNEVENNESS * size):
        return 0.0, None
    centred = chosen - chosen.mean(axis=0)
    _, widths, axes = np.linalg.svd(centred)
    if len(chosen) <= 2 or widths[1] <= _MAX_DISTANCE_FROM_PLANE * widths[0]:
        return spread, None
    if float(np.abs(centred @ axes[2]).max()) > _MAX_DISTANCE_FROM_PLANE * spread:
        return spread, None
    return spread, axes[2] * np.sign(axes[2] @ normal)


def _words(frames: list[str], points: Array, standing: Array, level: Array, plane: Array | None, time: float) -> str:
    heights = points @ level
    heights = heights - heights[standing].min()
    by_frame = {frames[k]: number(float(heights[k]), 2) for k in np.flatnonzero(standing)}
    heights_of_frames = listed([f"{frame} {height} m" for frame, height in by_frame.items()], _MAX_LISTED)
    flat = _normal_argument(level)
    doubt = f"contacts stand at different heights at t = {seconds(time)} s: {heights_of_frames}"
    if plane is None:
        return Reason(f"{doubt}. If the ground is level at each of them, state its normal, {flat}", flat)
    angle = math.degrees(math.acos(min(1.0, float(plane @ level))))
    sloped = _normal_argument(plane)
    return Reason(
        f"{doubt}. Does the floor slope by {number(angle, 2)}°? Give its normal, {sloped}, or {flat} if it is level at each of "
        "them",
        sloped,
    )
