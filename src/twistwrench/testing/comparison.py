"""Comparison of arrays by norm, and derivatives by differences to about 1e-12."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from ..core.numbers import printed
from ..robot import Robot
from ..typing import Array


def relative_gap(actual: ArrayLike, desired: ArrayLike, scale: float | None = None) -> float:
    """Relative difference of two arrays by norm: the largest difference over the largest entry of ``desired``.

    Parameters
    ----------
    actual, desired : array_like of one shape
    scale : float, optional, in place of the largest entry

    Returns
    -------
    gap : float

    Notes
    -----
    By norm, not entry by entry: an entry near zero is the difference of large terms and carries their rounding. Entries
    that are not finite in both arrays make the gap infinite or NaN, so ``gap <= tolerance`` is false.

    Examples
    --------
    >>> relative_gap([100.0, 0.5], [100.0, 0.0])
    0.005
    """
    a, b = np.asarray(actual, float), np.asarray(desired, float)
    if a.size == 0:
        return 0.0
    with np.errstate(invalid="ignore", divide="ignore"):
        gap = np.abs(a - b).max()
        size = np.abs(b).max() if scale is None else scale
        return 0.0 if gap == 0 else float(gap / size)


def assert_close(
    actual: ArrayLike, desired: ArrayLike, rtol: float, what: str = "", *, scale: float | None = None
) -> None:
    """Assert that two arrays agree: :func:`relative_gap` is at most ``rtol``, and shapes are the same.

    Parameters
    ----------
    actual, desired : array_like of one shape
    rtol : float, the largest gap
    what : str, what is compared
    scale : float, optional, in place of the largest entry of ``desired``
        Where that is the small difference of large terms; give these terms in the test.

    Raises
    ------
    AssertionError
        They do not agree.

    Examples
    --------
    >>> assert_close([1.0, 2.0], [1.0, 2.1], 1e-3, "the torque of joint 2")
    Traceback (most recent call last):
    AssertionError: the torque of joint 2: off by 0.0476 of the largest entry, 2.1; allowed 0.001.
    Worst at (1,): actual 2.0, desired 2.1. Entries beyond the tolerance: 1 of 2.
    """
    a, b = np.asarray(actual, float), np.asarray(desired, float)
    name = what or "the arrays"
    if a.shape != b.shape:
        raise AssertionError(f"{name}: actual has shape {a.shape}, desired {b.shape}.")
    gap = relative_gap(a, b, scale)
    if gap <= rtol:
        return
    size = np.abs(b).max() if scale is None else scale
    apart = np.where(np.isfinite(a - b), np.abs(a - b), np.inf)
    worst = tuple(int(i) for i in np.unravel_index(int(np.argmax(apart)), a.shape))
    whose = "the largest entry" if scale is None else "the scale"
    raise AssertionError(
        f"{name}: off by {printed(gap, 3)} of {whose}, {printed(size)}; allowed {printed(rtol)}.\n"
        f"Worst at {worst}: actual {a[worst]}, desired {b[worst]}. "
        f"Entries beyond the tolerance: {np.count_nonzero(apart > rtol * size)} of {a.size}."
    )


# ── Derivatives by differences, to about 1e-12, independent of the formula under test

_PLACES = np.array([-3.0, -2.0, -1.0, 1.0, 2.0, 3.0])
_WEIGHTS = np.array([-1.0, 9.0, -45.0, 45.0, -9.0, 1.0]) / 60.0
STEP = 0.01
"""Step of differences. For a function that varies with rate 1, such as sin t, the error of order six is STEP⁶/140 = 1e-14, and
the rounding of six values divided by STEP about 1e-14 too. Dynamics depends on sums of joint angles, twice over:
hence some 1e-12."""


def derivative(function: Callable[[Array], ArrayLike], rate: float = 1.0) -> Array:
    """Numerical derivative df/dt at t = 0 by central differences of order six.

    Parameters
    ----------
    function : takes t of shape (6,), returns (6, ...)
    rate : float, how fast the function varies: the sum of the speeds of what it depends on [rad/s, m/s]

    Returns
    -------
    slope : (...) array

    Examples
    --------
    >>> round(float(derivative(np.sin)), 13)
    1.0
    """
    h = STEP / rate
    return np.tensordot(_WEIGHTS, np.asarray(function(h * _PLACES), float), axes=1) / h


def derivative_along(robot: Robot, function: Callable[[Array], ArrayLike], q: ArrayLike, v: ArrayLike) -> Array:
    """Numerical derivative along the configuration manifold: df/dt at t = 0 of ``function(q ⊕ t v)``.

    Parameters
    ----------
    robot : Robot
    function : takes batches of q
    q : (nq,) array_like, configuration
    v : (..., nv) array_like, directions; the identity (nv, nv) gives the derivatives along each joint, first axis

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
    return derivative(lambda t: function(robot.add(q, np.multiply.outer(t, v))), rate)
