"""Rotations in the arithmetic of whole numbers and symbols, and the ZYX Euler angles of Modern Robotics appendix B.1.1."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..lie import quaternion
from ..typing import Array

CosineSine = Callable[[int], tuple[Any, Any]]


def exact(values: Any) -> Any:
    """Floats as Python numbers, whole ones as integers, so that 0 and ±1 leave nothing behind in SymPy."""
    if np.ndim(values) == 0:
        x = float(values)
        return int(x) if x.is_integer() else x
    array = np.empty(np.shape(values), object)
    for place in np.ndindex(array.shape):
        array[place] = exact(np.asarray(values)[place])
    return array


def exact_rodrigues(w: Array, cosine: Any, sine: Any) -> Array:
    """Rodrigues' formula about a unit vector, sorted so that axis-aligned ones fold to four entries; MR eq. 3.51."""
    along = np.outer(w, w)
    W = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
    return exact(along) + exact(np.eye(3) - along) * cosine + exact(W) * sine


def euler_rotation(first: int, cosine_sine: CosineSine) -> Array:
    """Rot(z, alpha) Rot(y, beta) Rot(x, gamma), the angles being entries ``first`` to ``first`` + 2."""
    x, y, z = np.eye(3)
    alpha, beta, gamma = (cosine_sine(first + k) for k in range(3))
    return np.asarray(exact_rodrigues(z, *alpha) @ exact_rodrigues(y, *beta) @ exact_rodrigues(x, *gamma))


def euler_axis(k: int, first: int, cosine_sine: CosineSine) -> Array:
    """ω_b per unit of the rate of alpha, beta or gamma (k = 0, 1, 2)."""
    (cb, sb), (cc, sc) = cosine_sine(first + 1), cosine_sine(first + 2)
    return np.array([(-sb, cb * sc, cb * cc), (0, cc, -sc), (1, 0, 0)][k], object)


def euler_rates(angles: Array, rates: Array) -> tuple[Array, Array, Array]:
    """The quaternion of ZYX Euler angles, E with ω_b = E times their rates, and dE/dt."""
    (cb, cc), (sb, sc) = np.cos(angles[1:]), np.sin(angles[1:])
    _, db, dc = rates
    E = np.array([[-sb, 0, 1], [cb * sc, cc, 0], [cb * cc, -sc, 0]])
    dE = np.array(
        [[-cb * db, 0, 0], [-sb * sc * db + cb * cc * dc, -sc * dc, 0], [-sb * cc * db - cb * sc * dc, -cc * dc, 0]]
    )
    turns = [np.r_[np.cos(a / 2), np.sin(a / 2) * e] for a, e in zip(angles, np.eye(3)[::-1], strict=True)]
    return quaternion.multiply(quaternion.multiply(turns[0], turns[1]), turns[2]), E, dE
