"""Logs of a known sensor, for tests and demonstrations."""

from __future__ import annotations

import math
import operator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import ShapeError, ValueRangeError
from ..lie import se3
from .directions import GRAVITY, gravity_in_frame
from .frames import unlabelled
from .log import ReadingLog
from .noise import checked_noise
from .poses import checked_count, propose_poses
from .sensor import ForceTorqueSensor, sign_factor

Array = NDArray[Any]

__all__ = ["lively_motion", "simulate"]

# Three slides, then three turns, each a unit screw: together any motion of a hand.
_SCREWS = np.roll(np.eye(6), 3, axis=0)


def simulate(
    sensor: ForceTorqueSensor,
    poses: int | ArrayLike,
    *,
    noise: tuple[float, float] = (0.01, 0.3),
    motion: float | None = None,
    touch: dict[int, ArrayLike] | None = None,
    rng: np.random.Generator | int = 0,
) -> ReadingLog:
    """What that sensor would log: at rest in ``poses`` (how many, or R_wf (n, 3, 3), or T_wf (n, 4, 4)).

    ``noise`` is the standard deviation of moments [N m] and forces [N]. With ``motion``, a duration [s], the ``poses`` (a
    number) are samples of a lively motion instead. ``touch`` adds wrenches (6,) on the load, in the sensor's axes, to the
    readings of these indices. Raises :class:`~twistwrench.ValueRangeError` for anything else.

    >>> sensor = ForceTorqueSensor(bias=[0, 0, 0, 1, 2, 3])
    >>> simulate(sensor, 2, noise=(0, 0)).readings.tolist()
    [[0.0, 0.0, 0.0, 1.0, 2.0, 3.0], [0.0, 0.0, 0.0, 1.0, 2.0, 3.0]]
    """
    if not isinstance(sensor, ForceTorqueSensor):
        raise ShapeError(f"simulate takes a ForceTorqueSensor, got a {type(sensor).__name__}.")
    rng = np.random.default_rng(rng)
    sigma = checked_noise(noise, none_at_all=True)
    V = dV = time = None
    counted = isinstance(poses, float | np.number) or (hasattr(poses, "__index__") and not np.shape(poses))
    if motion is not None:
        if not counted:
            raise ValueRangeError("a motion makes its own poses. Give their number, such as poses=500.")
        if not isinstance(motion, int | float | np.number) or not 0 < motion < math.inf:
            raise ValueRangeError(f"motion {motion!r} is no duration. Give how many seconds it lasts, such as 10.0.")
        time = np.linspace(0.0, float(motion), checked_count(poses))
        T, V, dV = lively_motion(time)
        gravity = gravity_in_frame(T)
    elif counted:
        gravity = propose_poses(checked_count(poses)).gravity
    else:
        gravity = np.atleast_2d(gravity_in_frame(unlabelled({"pose": poses}, sensor.frame)["pose"], GRAVITY))
    exact = sensor.predict(np.eye(3), V, dV, gravity=gravity)
    readings = exact + rng.normal(size=exact.shape) * np.repeat(sigma, 3)
    for index, wrench in (touch or {}).items():
        readings[_row(index, len(readings))] += sign_factor(sensor.sign) * _touch(index, wrench)
    return ReadingLog.of(readings, gravity=gravity, V=V, dV=dV, time=time, name="simulated log")


def _row(index: Any, count: int) -> int:
    try:
        row = operator.index(index)
    except TypeError:
        row = count
    if not -count <= row < count:
        raise ValueRangeError(f"touch: there is no reading {index!r}. They are 0 to {count - 1}.")
    return row


def _touch(index: Any, wrench: ArrayLike) -> Array:
    try:
        F = np.asarray(wrench, float)
    except (TypeError, ValueError):
        F = np.empty(0)
    if F.shape != (6,) or not np.isfinite(F).all():
        raise ValueRangeError(
            f"touch of reading {index} is no wrench: give six finite numbers, mx, my, mz, fx, fy, fz."
        )
    return F


def lively_motion(time: ArrayLike) -> tuple[Array, Array, Array]:
    """A hand waving at times (n,) [s]: poses T_wf (n, 4, 4), body twists (n, 6) and their exact rates (n, 6)."""
    t = np.asarray(time, float)[..., None]
    amplitude = np.array([0.2, 0.15, 0.1, 1.2, 1.0, 1.4])  # m, rad
    rate = np.array([2.1, 2.9, 3.7, 1.7, 2.3, 3.1])  # rad/s, no two in step
    phase = np.array([0.0, 1.0, 2.0, 0.5, 1.5, 2.5])
    q = amplitude * np.sin(rate * t + phase)
    dq, ddq = amplitude * rate * np.cos(rate * t + phase), -(rate**2) * q
    T = np.broadcast_to(np.eye(4), (*t.shape[:-1], 4, 4))
    V = dV = np.zeros((*t.shape[:-1], 6))
    for k, S in enumerate(_SCREWS):
        step = se3.exp(S * q[..., k : k + 1])
        back = se3.Ad(se3.inverse(step))
        own = S * dq[..., k : k + 1]
        T, V = T @ step, back @ V + own
        dV = back @ dV + se3.ad(V) @ own + S * ddq[..., k : k + 1]
    return T, V, dV
