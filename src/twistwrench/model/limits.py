"""Limits of the joints, with their tolerance and the test for values beyond them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..typing import Array

TOLERANCE = 1e-6
"""Share of a joint's largest limit by which it may exceed one and still count as at it: rounding to float32, or to six
digits in a file, does not count as excess."""


def over_limit(share: Any) -> Any:
    """True if a magnitude exceeds its limit by more than rounding.

    Parameters
    ----------
    share : float or (...) array, the magnitude over its limit

    Returns
    -------
    over : bool or (...) array of bool; NaN is beyond no limit

    Examples
    --------
    >>> over_limit(1 + 0.5 * TOLERANCE), over_limit(1 + 2 * TOLERANCE)
    (False, True)
    """
    return share > 1 + TOLERANCE


def margin(limit: Any) -> Array:
    """Excess over a limit up to which a magnitude counts as at the limit.

    Parameters
    ----------
    limit : (...) array_like, inf where none is given

    Returns
    -------
    margin : (...) array, in the unit of the limit; finite everywhere

    Examples
    --------
    >>> margin([150.0, np.inf]).tolist()
    [0.00015, 1e-06]
    """
    limit = np.asarray(limit, float)
    return np.asarray(TOLERANCE * np.where(np.isfinite(limit), limit, 1.0))


@dataclass(frozen=True, eq=False)
class Limits:
    """Joint limits, one entry per velocity, (nv,) each; inf where none is given.

    Examples
    --------
    >>> limits = Limits(np.array([0.0]), np.array([1.5]), np.array([np.inf]), np.array([np.inf]))
    >>> limits.exceeded([[-1e-7], [-1e-5]])
    array([[False],
           [ True]])
    """

    lower: Array
    """Least positions [rad or m]."""
    upper: Array
    """Largest positions [rad or m]."""
    velocity: Array
    """Largest velocities [rad/s or m/s]."""
    effort: Array
    """Largest torques [N m or N]."""

    @property
    def tolerance(self) -> Array:
        """Excess over a position limit up to which a joint counts as at it, (nv,) [rad or m].

        :data:`TOLERANCE` of the larger of the joint's two limits, of those that are finite; of 1 where that is none or zero.
        """
        ends = np.abs(np.stack([self.lower, self.upper]))
        largest = np.max(np.where(np.isfinite(ends), ends, 0.0), axis=0)
        return np.asarray(TOLERANCE * np.where(largest > 0.0, largest, 1.0))

    def exceeded(self, positions: Any) -> Array:
        """True for each joint beyond a position limit by more than :attr:`tolerance`.

        Parameters
        ----------
        positions
            (..., nv) the coordinate of each velocity [rad or m], see :meth:`Model.positions`.

        Returns
        -------
        Array
            (..., nv) of bool. NaN is beyond no limit.

        Examples
        --------
        >>> limits = Limits(np.array([0.0]), np.array([1.5]), np.array([np.inf]), np.array([np.inf]))
        >>> limits.exceeded([1.6]).tolist()
        [True]
        """
        x, most = np.asarray(positions, float), self.tolerance
        return np.asarray((x < self.lower - most) | (x > self.upper + most))
