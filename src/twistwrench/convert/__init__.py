"""States in the words of other libraries: the orders, signs and frames of Pinocchio and MuJoCo; SciPy's quaternions.

Joints are matched by name, so the other library must have read the same file. Theirs marked with a star, there is one
matrix P for each library with

    dq* = P dq        and so        τ = P' τ*,    M = P' M* P,    J = J* P.

Where a joint mimics another here and is independent there, P has a row for it all the same.

Pinocchio: children of one link in alphabetical order; floating joints ``(x, y, z, qx, qy, qz, qw)`` and body twists
``(v, omega)``; unbounded angles as (cos, sin). MuJoCo: children in document order; floating joints
``(x, y, z, qw, qx, qy, qz)``, their velocity the origin's along world axes, then omega in the body.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..errors import ShapeError
from ..typing import Array
from .mujoco_order import from_mujoco, mujoco_rates, to_mujoco
from .pinocchio_order import from_pinocchio, pinocchio_rates, to_pinocchio
from .scipy_order import from_scipy_quaternion, to_scipy_quaternion

__all__ = [
    "from_mujoco",
    "from_pinocchio",
    "from_scipy_quaternion",
    "mujoco_rates",
    "pinocchio_rates",
    "swap_halves",
    "to_mujoco",
    "to_pinocchio",
    "to_scipy_quaternion",
]


def swap_halves(rows: ArrayLike, axis: int | None = None) -> Array:
    """Twists, wrenches or Jacobians from linear part first to angular part first, or back.

    Parameters
    ----------
    rows : (..., 6) array_like twists or wrenches, (..., 6, n) array_like Jacobians
    axis : int, optional; which axis has the six rows; None: the only one of the last two that is 6 long

    Returns
    -------
    rows : array of the same shape

    Raises
    ------
    ShapeError
        No axis is 6 long, or two are and ``axis`` does not say which one.

    Examples
    --------
    >>> swap_halves([1, 2, 3, 4, 5, 6]).tolist()
    [4, 5, 6, 1, 2, 3]
    >>> import numpy as np
    >>> swap_halves(np.eye(6), axis=-2)[0].tolist()  # a Jacobian of six joints
    [0.0, 0.0, 0.0, 1.0, 0.0, 0.0]
    """
    x = arguments.plain(rows, "swap_halves: rows")
    allowed = range(-min(x.ndim, 2), 0) if axis is None else (axis,)
    found = [k for k in allowed if -x.ndim <= k < x.ndim and x.shape[k] == 6]
    if len(found) != 1:
        several = "both of the last two axes are 6 long: say axis=-1 for twists, axis=-2 for a Jacobian"
        raise ShapeError(
            f"swap_halves: rows has shape {x.shape}, and {several if found else 'no axis of 6 where they are wanted'}."
        )
    return np.roll(x, 3, axis=found[0])
