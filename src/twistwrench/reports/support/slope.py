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
from .ground import SLOW

if TYPE_CHECKING:
    from ...motion.motion import Motion
    from .standing import StandingCase

_ROWS = 4096
"""States of one batch."""
_UNEVEN, _LEAST = 0.02, 0.002
"""Difference in height of contacts on level ground, as a share of their distance, and in any case [m]."""
_FLAT = 0.1
"""Distance from one plane, as a share of the difference in height, up to which contacts lie on a slope."""
_LEAVING = 0.1
"""Speed of a wheel along the normal of the ground from which it does not stay on it [m/s]."""
_SLOPE = math.radians(0.5)
"""Angle of a slope that is stated."""
_LISTED = 4


def samples(motion: Motion, rows: slice | Array) -> MotionSamples:
    """Some states of a motion."""
    time, q, dq, ddq = (getattr(motion, name)[rows] for name in ("time", "q", "dq", "ddq"))
    return MotionSamples(time, q, dq, ddq, q, np.zeros(dq.shape, bool), np.zeros((len(time), 0)))


def slope(load: StandingCase) -> float:
    """Angle between the normal of the ground and the vertical [rad]; 0 without gravity, and below half a degree."""
    gravity = load.robot.model.gravity
    strength = float(np.linalg.norm(gravity))
    if not strength:
        return 0.0
    angle = math.acos(min(1.0, max(-1.0, float(-gravity @ load.ground.normal) / strength)))
    return angle if angle > _SLOPE else 0.0


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
    worst: tuple[float, str] = (0.0, "")
    frames = [str(contact.frame) for contact in ground.contacts]
    wheels = ~np.array(ground.automatic) & ground.on_ground
    always = wheels if ground.schedule is None else ground.on_ground
    for start in range(0, len(motion), _ROWS):
        rows = slice(start, start + _ROWS)
        points, velocities = ground.points_and_velocities(load.robot, samples(motion, rows))
        if leaves := _leaving(frames, velocities @ ground.normal, wheels, motion.time[rows]):
            return leaves
        if ground.normal_given:
            continue
        carrying, slow = in_contact[rows] & always, (np.linalg.norm(velocities, axis=-1) < SLOW) & ground.on_ground
        asked = failing[rows] | (np.arange(start, start + len(points)) == 0)
        for k in np.flatnonzero(carrying.any(axis=1) | asked):
            mine = carrying[k] | slow[k] if asked[k] and ground.schedule is None else carrying[k]
            found = _uneven(points[k], mine, ground.normal)
            if found is None or found[0] <= worst[0]:
                continue
            spread, plane = found
            if plane is None and carrying[k].sum() != mine.sum():  # one foot is lifted
                continue
            worst = spread, _words(frames, points[k], mine, ground.normal, plane, float(motion.time[start + k]))
    return worst[1]


def _nothing_presses(gravity: Array, normal: Array) -> str:
    if not gravity.any():
        return "without gravity nothing presses the robot onto the ground"
    stated = _stated(-normal)
    return Reason(
        f"gravity, {vector(gravity)} m/s², points away from the ground, whose normal is {vector(normal)}: nothing "
        f"presses the robot on. If the ground is on the other side, give its normal, {stated}",
        stated,
    )


def _leaving(frames: list[str], speeds: Array, wheels: Array, time: Array) -> str:
    """Reason to doubt a log whose wheels move along the normal of the ground, by their speeds (n, c); empty if none does."""
    off = np.where(wheels, np.abs(speeds), 0.0)
    row, wheel = np.unravel_index(int(off.argmax()), off.shape)
    if off[row, wheel] <= _LEAVING:
        return ""
    return (
        f"{frames[wheel]} moves at {number(float(off[row, wheel]), 2)} m/s along the normal of the ground at t = "
        f"{seconds(float(time[row]))} s, where it should stay on it"
    )


def _stated(normal: Array) -> str:
    """Argument that states a normal, as the caller types it."""
    numbers = [round(float(x), 4) + 0.0 for x in normal]
    text = ",".join(number(x) for x in numbers)
    return spell(Argument("contact_normal", text if in_the_shell() else numbers))


def _uneven(points: Array, mine: Array, normal: Array) -> tuple[float, Array | None] | None:
    """Difference in height of some contacts, and the normal of their plane if they lie on one; None if they are level."""
    chosen = points[mine]
    heights = chosen @ normal
    spread = float(np.ptp(heights)) if len(chosen) else 0.0
    across = chosen - heights[:, None] * normal
    size = float(np.linalg.norm(np.ptp(across, axis=0))) if len(chosen) else 0.0
    if spread <= max(_LEAST, _UNEVEN * size):
        return None
    off = chosen - chosen.mean(axis=0)
    _, widths, axes = np.linalg.svd(off)
    flat = len(chosen) > 2 and widths[1] > _FLAT * widths[0] and float(np.abs(off @ axes[2]).max()) <= _FLAT * spread
    return spread, (axes[2] * np.sign(axes[2] @ normal) if flat else None)


def _words(frames: list[str], points: Array, mine: Array, level: Array, plane: Array | None, time: float) -> str:
    heights = points @ level
    heights = heights - heights[mine].min()
    by_frame = {frames[k]: number(float(heights[k]), 2) for k in np.flatnonzero(mine)}
    listed_heights = listed([f"{frame} {height} m" for frame, height in by_frame.items()], _LISTED)
    flat = _stated(level)
    what = f"contacts stand at different heights at t = {seconds(time)} s: {listed_heights}"
    if plane is None:
        return Reason(f"{what}. If the ground is level at each of them, state its normal, {flat}", flat)
    angle = math.degrees(math.acos(min(1.0, float(plane @ level))))
    sloped = _stated(plane)
    return Reason(
        f"{what}. Does the floor slope by {number(angle, 2)}°? Give its normal, {sloped}, or {flat} if it is level at each of "
        "them",
        sloped,
    )
