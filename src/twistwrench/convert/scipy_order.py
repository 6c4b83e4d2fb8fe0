"""Quaternions in SciPy's order, and from it."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..typing import Array


def to_scipy_quaternion(Q: ArrayLike) -> Array:
    """Quaternions as SciPy's ``Rotation.from_quat`` takes them, scalar last.

    Parameters
    ----------
    Q : (..., 4) array_like, (w, x, y, z)

    Returns
    -------
    Q : (..., 4) array, (x, y, z, w)

    Examples
    --------
    >>> to_scipy_quaternion([1, 0, 0, 0]).tolist()
    [0.0, 0.0, 0.0, 1.0]
    """
    return np.roll(np.asarray(arguments.real(Q, "to_scipy_quaternion: Q", 4), float), -1, axis=-1)


def from_scipy_quaternion(Q: ArrayLike) -> Array:
    """Quaternions as SciPy's ``Rotation.as_quat`` gives them, scalar first then.

    Parameters
    ----------
    Q : (..., 4) array_like, (x, y, z, w)

    Returns
    -------
    Q : (..., 4) array, (w, x, y, z)

    Examples
    --------
    >>> from_scipy_quaternion([0, 0, 0, 1]).tolist()
    [1.0, 0.0, 0.0, 0.0]
    """
    return np.roll(np.asarray(arguments.real(Q, "from_scipy_quaternion: Q", 4), float), 1, axis=-1)
