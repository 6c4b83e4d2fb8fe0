"""Chapter 9: time scalings, and point-to-point motions in joint space and in SE(3)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..algorithms.time_scalings import PosePath, cubic_share, quintic_share
from ..core import arguments
from ..core.glossary import complete
from ..errors import ShapeError, ValueRangeError
from ..lie import se3
from ..typing import Array
from . import matrix_arguments
from .matrices import log6


def CubicTimeScaling(Tf: float, t: ArrayLike) -> Any:
    """Cubic time scaling s(t) = 3 (t/Tf)² - 2 (t/Tf)³, from rest to rest (MR eq. 9.10).

    Returns
    -------
    s : (...) array

    Examples
    --------
    >>> round(float(CubicTimeScaling(2, 0.6)), 12)
    0.216
    """
    return cubic_share(_fraction(Tf, t))


def QuinticTimeScaling(Tf: float, t: ArrayLike) -> Any:
    """Quintic time scaling s(t) = 10 (t/Tf)³ - 15 (t/Tf)⁴ + 6 (t/Tf)⁵, accelerations zero at both ends too (MR section 9.2.1).

    Returns
    -------
    s : (...) array

    Examples
    --------
    >>> round(float(QuinticTimeScaling(2, 0.6)), 12)
    0.16308
    """
    return quintic_share(_fraction(Tf, t))


def _fraction(Tf: Any, t: Any) -> Any:
    if type(t) is float and type(Tf) in (float, int) and Tf > 0:  # NumPy takes ten times as long for one number
        return t / Tf
    duration, instants = arguments.together(Tf=matrix_arguments.array(Tf, "Tf"), t=matrix_arguments.array(t, "t"))
    if not np.all(duration > 0):
        raise ValueRangeError(f"Tf is {Tf!r}: a motion takes more than no time.")
    return (instants / duration)[()]


def JointTrajectory(thetastart: ArrayLike, thetaend: ArrayLike, Tf: float, N: float, method: int) -> Array:
    """Joint trajectory: points on the straight line between two joint vectors, equally spaced in time (MR section 9.2).

    Returns
    -------
    trajectory : (N, n) array

    Examples
    --------
    >>> JointTrajectory([1, 0], [2, 4], 4, 3, 3).tolist()
    [[1.0, 0.0], [1.5, 2.0], [2.0, 4.0]]
    """
    start, end = matrix_arguments.array(thetastart, "thetastart"), matrix_arguments.array(thetaend, "thetaend")
    if start.ndim != 1 or start.shape != end.shape:
        raise ShapeError(f"thetastart {start.shape}, thetaend {end.shape}: expected two vectors of the same length.")
    s = _scaling(Tf, N, method)[:, None]
    return np.asarray(s * end + (1.0 - s) * start)


def ScrewTrajectory(Xstart: ArrayLike, Xend: ArrayLike, Tf: float, N: float, method: int) -> list[Array]:
    """Screw trajectory: poses along the constant screw from one pose to another (MR eq. 9.23).

    Returns
    -------
    poses : list of N (4, 4) arrays

    Examples
    --------
    >>> X = se3.exp([0, 0, np.pi / 2, 1, 0, 0])
    >>> len(ScrewTrajectory(np.eye(4), X, 5, 4, 3))
    4
    """
    X, end = _ends(Xstart, Xend)
    V = log6(se3.inverse(X) @ end)
    return list(PosePath(X, end, straight=False, twist=V)(_scaling(Tf, N, method)))


def CartesianTrajectory(Xstart: ArrayLike, Xend: ArrayLike, Tf: float, N: float, method: int) -> list[Array]:
    """Cartesian trajectory: origin on a straight line, rotation about a constant axis (MR eq. 9.24, 9.25).

    Returns
    -------
    poses : list of N (4, 4) arrays

    Examples
    --------
    >>> X = se3.exp([0, 0, np.pi / 2, 1, 0, 0])
    >>> CartesianTrajectory(np.eye(4), X, 5, 3, 5)[1][:3, 3].round(9).tolist()
    [0.318309886, 0.318309886, 0.0]
    """
    X, end = _ends(Xstart, Xend)
    still = se3.pose(np.swapaxes(X[:3, :3], -1, -2) @ end[:3, :3], np.zeros(3))
    twist = np.concatenate([log6(still)[:3], end[:3, 3] - X[:3, 3]])
    return list(PosePath(X, end, straight=True, twist=twist)(_scaling(Tf, N, method)))


def _ends(Xstart: ArrayLike, Xend: ArrayLike) -> tuple[Array, Array]:
    X, end = matrix_arguments.pose(Xstart, "Xstart"), matrix_arguments.pose(Xend, "Xend")
    if X.shape != (4, 4) or end.shape != (4, 4):
        raise ShapeError(f"Xstart has shape {X.shape}, Xend {end.shape}: expected two poses, (4, 4).")
    return X, end


def _scaling(Tf: float, N: float, method: int) -> Array:
    """s at N instants from 0 to Tf, both ends exact."""
    n = arguments.whole(N, "N", 2)
    scalings = {3: CubicTimeScaling, 5: QuinticTimeScaling}
    if method not in tuple(scalings):
        raise ValueRangeError(f"method is {method!r}; choose 3, cubic, or 5, quintic time scaling.")
    _fraction(arguments.number(Tf, "Tf"), 0.0)
    return np.asarray(scalings[method](1.0, np.arange(n) / (n - 1.0)))


complete(globals())
