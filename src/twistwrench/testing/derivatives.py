"""Numerical derivatives to about 1e-12, independent of the formula under test."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from ..core.glossary import complete
from ..core.typing import Array
from ..robot import Robot

_STEPS_FROM_ZERO = np.array([-3.0, -2.0, -1.0, 1.0, 2.0, 3.0])
"""Times t / h of the six values of central differences of order six."""
_STEP_WEIGHTS = np.array([-1.0, 9.0, -45.0, 45.0, -9.0, 1.0]) / 60.0
"""Weights of these values in h df/dt."""
STEP = 0.01
"""Step of finite differences, for functions that vary with rate 1.

For sin t, the error of order six is STEP⁶/140 = 1e-14. The rounding error of six values divided by STEP is also about 1e-14.
Dynamics depends on sums of joint angles, which raises the error to about 1e-12."""


def derivative(function: Callable[[Array], ArrayLike], rate: float = 1.0) -> Array:
    """Numerical derivative df/dt at t = 0 by central differences of order six.

    Parameters
    ----------
    function : takes t of shape (6,), returns (6, ...)
    rate : float, sum of the speeds of the function's arguments [rad/s, m/s]

    Returns
    -------
    slope : (...) array

    Examples
    --------
    >>> round(float(derivative(np.sin)), 13)
    1.0
    """
    h = STEP / rate  # a fast function takes a small step
    values = np.asarray(function(h * _STEPS_FROM_ZERO), float)
    return np.tensordot(_STEP_WEIGHTS, values, axes=1) / h


def derivative_along(robot: Robot, function: Callable[[Array], ArrayLike], q: ArrayLike, v: ArrayLike) -> Array:
    """Numerical derivative along the configuration manifold: df/dt at t = 0 of ``function(q ⊕ t v)``.

    Parameters
    ----------
    function : takes batches of q
    v : (..., nv) array_like, directions; for the identity (nv, nv), the first axis of the slope counts the joints

    Returns
    -------
    slope : (..., *shape of f) array

    Examples
    --------
    >>> import twistwrench as tw
    >>> arm = tw.robots.planar_2r()
    >>> derivative_along(arm, arm.potential_energy, [0, 0], np.eye(2)).round(6).tolist()
    [29.43, 9.81]
    """
    v = np.asarray(v, float)
    rate = max(1.0, float(np.abs(v).sum(axis=-1).max(initial=0.0)))

    def function_of_time(t: Array) -> ArrayLike:
        return function(robot.add(q, np.multiply.outer(t, v)))

    return derivative(function_of_time, rate)


complete(globals())
