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

_SCREWS = np.roll(np.eye(6), 3, axis=0)
"""Unit screws as rows, three translations and then three rotations: a basis of all twists."""
_AMPLITUDES = np.array([0.2, 0.15, 0.1, 1.2, 1.0, 1.4])
"""Amplitudes of a lively motion along the unit screws, three in m, then three in rad."""
_FREQUENCIES = np.array([2.1, 2.9, 3.7, 1.7, 2.3, 3.1])
"""Their angular frequencies [rad/s]; all differ, so that motions do not repeat."""
_PHASES = np.array([0.0, 1.0, 2.0, 0.5, 1.5, 2.5])
"""Their phases [rad]."""


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
    poses : int, (n, 3, 3) or (n, 4, 4) array_like, number of poses, or the rotations R_wf or poses T_wf themselves
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
    V = None
    dV = None
    time = None
    is_integer = hasattr(poses, "__index__") and not np.shape(poses)
    is_number = is_integer or isinstance(poses, float | np.number)
    if motion is not None:
        if not is_number:
            raise ValueRangeError("a motion makes its own poses. Give their number, such as poses=500.")
        if not isinstance(motion, int | float | np.number) or not 0 < motion < math.inf:
            raise ValueRangeError(
                f"motion {motion!r} is not a valid duration. Give how many seconds it lasts, such as 10.0."
            )
        time = np.linspace(0.0, float(motion), arguments.integer(poses, "poses"))
        T, V, dV = lively_motion(time)
        gravity = gravity_in_frame(T)
    elif is_number:
        gravity = propose_poses(arguments.integer(poses, "poses")).gravity
    else:
        plain_poses = plain_arrays({"pose": poses}, sensor.frame)["pose"]
        gravity = np.atleast_2d(gravity_in_frame(plain_poses, GRAVITY))
    exact_readings = sensor.predict(np.eye(3), V, dV, gravity=gravity)  # gravity is in {f} already: R = 1
    readings = exact_readings + rng.normal(size=exact_readings.shape) * np.repeat(sigma, 3)
    if touch is None:
        touch = {}
    if not isinstance(touch, dict):
        raise ValueRangeError(f"touch is {arguments.value_text(touch)}: give {{number of a reading: wrench (6,)}}.")
    for index, wrench in touch.items():
        label = f"touch of reading {index}"
        F = arguments.finite(arguments.one(wrench, label, 6), label)
        row = _touched_row(index, len(readings))
        readings[row] += sign_factor(sensor.sign) * F
    return ReadingLog.from_arrays(readings, gravity=gravity, V=V, dV=dV, time=time, name="simulated log")


def _touched_row(index: Any, count: int) -> int:
    """Index of a touched reading as an integer; raises ValueRangeError unless it is one of ``count`` readings."""
    try:
        row = operator.index(index)
    except TypeError:
        row = count  # not an integer; rejected like an integer beyond the end
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
    # coordinates of a chain with one joint for each screw, all of which oscillate
    q = _AMPLITUDES * np.sin(_FREQUENCIES * t + _PHASES)
    dq = _AMPLITUDES * _FREQUENCIES * np.cos(_FREQUENCIES * t + _PHASES)
    ddq = -(_FREQUENCIES**2) * q
    T = np.broadcast_to(np.eye(4), (*t.shape[:-1], 4, 4))
    V = np.zeros((*t.shape[:-1], 6))
    dV = np.zeros_like(V)
    for k, S in enumerate(_SCREWS):  # from the base outward
        T_joint = se3.exp(S * q[..., k : k + 1])
        Ad_back = se3.Ad(se3.inverse(T_joint))  # to the frame after the joint
        V_joint = S * dq[..., k : k + 1]
        T = T @ T_joint
        V = Ad_back @ V + V_joint
        dV = Ad_back @ dV + se3.ad(V) @ V_joint + S * ddq[..., k : k + 1]
    return T, V, dV


complete(globals())
