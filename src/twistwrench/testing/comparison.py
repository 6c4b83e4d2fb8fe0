"""Comparison of arrays by norm, with explained differences."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..core.glossary import complete
from ..core.numbers import printed


def relative_gap(actual: ArrayLike, desired: ArrayLike, scale: float | None = None) -> float:
    """Relative difference of two arrays by norm: the largest difference over the largest entry of ``desired``.

    Parameters
    ----------
    scale : float, optional, in place of the largest entry

    Returns
    -------
    gap : float

    Notes
    -----
    The norm is used because an entry near zero may be the difference of large terms, with the rounding error of these terms.
    An entry that is not finite, in one array or both, makes the gap infinite or NaN, so ``gap <= tolerance`` is false.

    Examples
    --------
    >>> relative_gap([100.0, 0.5], [100.0, 0.0])
    0.005
    """
    a = np.asarray(actual, float)
    b = np.asarray(desired, float)
    if a.size == 0:
        return 0.0
    with np.errstate(invalid="ignore", divide="ignore"):
        max_difference = np.abs(a - b).max()
        if max_difference == 0:  # also if the scale is 0
            return 0.0
        if scale is None:
            return float(max_difference / np.abs(b).max())
        return float(max_difference / np.float64(scale))  # infinite for 0, where a Python float would raise


def assert_close(
    actual: ArrayLike, desired: ArrayLike, rtol: float, what: str = "", *, scale: float | None = None
) -> None:
    """Assert that two arrays agree: equal shapes, and :func:`relative_gap` at most ``rtol``.

    Parameters
    ----------
    rtol : float, largest allowed gap
    what : str, name of the compared quantity
    scale : float, optional, in place of the largest entry of ``desired``
        For a small difference of large terms: the size of these terms, computed in the test.

    Raises
    ------
    AssertionError
        The arrays do not agree.

    Examples
    --------
    >>> assert_close([1.0, 2.0], [1.0, 2.1], 1e-3, "the torque of joint 2")
    Traceback (most recent call last):
    AssertionError: the torque of joint 2: off by 0.0476 of the largest entry, 2.1; allowed 0.001.
    Worst at (1,): actual 2.0, desired 2.1. Entries beyond the tolerance: 1 of 2.
    """
    a = np.asarray(actual, float)
    b = np.asarray(desired, float)
    name = what or "the arrays"  # in the message
    if a.shape != b.shape:
        raise AssertionError(f"{name}: actual has shape {a.shape}, desired {b.shape}.")
    gap = relative_gap(a, b, scale)
    if gap <= rtol:
        return
    size = scale
    size_name = "the scale"
    if size is None:
        size = float(np.abs(b).max())
        size_name = "the largest entry"
    differences = np.where(np.isfinite(a - b), np.abs(a - b), np.inf)
    worst_flat_index = int(np.argmax(differences))
    worst = tuple(int(i) for i in np.unravel_index(worst_flat_index, a.shape))
    raise AssertionError(
        f"{name}: off by {printed(gap, 3)} of {size_name}, {printed(size)}; allowed {printed(rtol)}.\n"
        f"Worst at {worst}: actual {a[worst]}, desired {b[worst]}. "
        f"Entries beyond the tolerance: {np.count_nonzero(differences > rtol * size)} of {a.size}."
    )


complete(globals())
