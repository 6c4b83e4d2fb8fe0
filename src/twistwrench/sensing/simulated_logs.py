"""Simulated logs of a known sensor, at rest or in a lively motion."""

from __future__ import annotations

import math
import operator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import ValueRangeError
from ..core.glossary import complete
from ..core.gravity import GRAVITY
from ..core.typing import Array
from ..mechanics.lie import se3
from .contact_detection import checked_noise
from .log import ReadingLog
from .poses import propose_poses
from .sensor import ForceTorqueSensor, checked_sensor, gravity_in_frame, plain_arrays, sign_factor

# Unit screws, three translations and three rotations: a basis of all twists.
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
    """Simulated log: readings of a sensor at rest in some orientations, or in a lively motion.

    Parameters
    ----------
    poses : int, (n, 3, 3) or (n, 4, 4) array_like, number of poses, or R_wf or T_wf
    noise : (moment [N m], force [N]), standard deviations
    motion : float, optional, duration of a lively motion [s], sampled at ``poses`` (a number) times
    touch : {index: (6,)}, optional, contact wrench on the load for each touched reading, in the sensor's axes

    Examples
    --------
    >>> sensor = ForceTorqueSensor(bias=[0, 0, 0, 1, 2, 3])
    >>> simulate(sensor, 2, noise=(0, 0)).readings.tolist()
    [[0.0, 0.0, 0.0, 1.0, 2.0, 3.0], [0.0, 0.0, 0.0, 1.0, 2.0, 3.0]]
    """
    checked_sensor(sensor, "simulate")
    rng = arguments.generator(rng)
    sigma = checked_noise(noise, none_at_all=True)
    V = dV = time = None
    counted = isinstance(poses, float | np.number) or (hasattr(poses, "__index__") and not np.shape(poses))
    if motion is not None:
        if not counted:
            raise ValueRangeError("a motion makes its own poses. Give their number, such as poses=500.")
        if not isinstance(motion, int | float | np.number) or not 0 < motion < math.inf:
            raise ValueRangeError(
                f"motion {motion!r} is not a valid duration. Give how many seconds it lasts, such as 10.0."
            )
        time = np.linspace(0.0, float(motion), arguments.integer(poses, "poses"))
        T, V, dV = lively_motion(time)
        gravity = gravity_in_frame(T)
    elif counted:
        gravity = propose_poses(arguments.integer(poses, "poses")).gravity
    else:
        gravity = np.atleast_2d(gravity_in_frame(plain_arrays({"pose": poses}, sensor.frame)["pose"], GRAVITY))
    exact = sensor.predict(np.eye(3), V, dV, gravity=gravity)
    readings = exact + rng.normal(size=exact.shape) * np.repeat(sigma, 3)
    if touch is not None and not isinstance(touch, dict):
        raise ValueRangeError(f"touch is {arguments.value_text(touch)}: give {{number of a reading: wrench (6,)}}.")
    for index, wrench in (touch or {}).items():
        what = f"touch of reading {index}"
        F = arguments.finite(arguments.one(wrench, what, 6), what)
        readings[_row(index, len(readings))] += sign_factor(sensor.sign) * F
    return ReadingLog.from_arrays(readings, gravity=gravity, V=V, dV=dV, time=time, name="simulated log")


def _row(index: Any, count: int) -> int:
    try:
        row = operator.index(index)
    except TypeError:
        row = count
    if not -count <= row < count:
        raise ValueRangeError(f"touch: there is no reading {index!r}. They are 0 to {count - 1}.")
    return row


def lively_motion(time: ArrayLike) -> tuple[Array, Array, Array]:
    """Motion of a waving hand: poses, body twists and their exact rates.

    Returns
    -------
    T : (n, 4, 4) array, poses T_wf
    V, dV : (n, 6) array, body twists and their rates

    Examples
    --------
    >>> T, V, dV = lively_motion([0.0, 0.1])
    >>> T.shape, V.shape, dV.shape
    ((2, 4, 4), (2, 6), (2, 6))
    """
    t = np.asarray(time, float)[..., None]
    amplitude = np.array([0.2, 0.15, 0.1, 1.2, 1.0, 1.4])  # m, rad
    rate = np.array([2.1, 2.9, 3.7, 1.7, 2.3, 3.1])  # rad/s, all different
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


complete(globals())
