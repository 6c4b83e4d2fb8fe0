"""How a configuration moves: the derivatives of q ⊕ v by v at v = 0, and what is left of a bracket of two motions.

Along robot.add the pose of each joint goes as T exp([A v]), so with dR = R [w] and dp = R v

    dq = N(q) v,      N of a quaternion Q:  dQ = ½ Q (0, w),

which is along Q's own direction-free part: functions that do not depend on its length have the derivative of robot.add's
normalised one. Modern Robotics sections 3.2.2 and 3.3.2; quaternions: Appendix B.3.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..lie.adjoint import ad
from ..model.model import Model
from ..typing import Array
from .recursion import zeros


def coordinate_rates(model: Model, q: Array) -> Array:
    """N with dq/dt = N dq along robot.add; (nq, nv)."""
    N = zeros(model.nq, model.nv)
    for body in model.leaders:
        rows, columns = body.places
        N[rows, columns] = body.joint.rates(q[rows])
    return N


def velocity_map(model: Model, q: Array) -> Array:
    """B with dq = B dq/dt, the other way; (nv, nq). Rates that stretch a quaternion give no velocity.

    The columns of N are at right angles, so the rows of B are these, scaled.
    """
    return np.stack([column / (column @ column) for column in coordinate_rates(model, q).T])


def rates_of_coordinates(model: Model, q: Array, dq: Array) -> Array:
    """dq/dt = N dq of the coordinates; (nq,)."""
    return np.asarray(coordinate_rates(model, q) @ dq)


def moving_parts(model: Model, q: Array) -> Iterator[tuple[Array, Array]]:
    """(x, its derivative along each velocity (*x.shape, nv)) of q, and of each rotation by a quaternion.

    dR = R [w] is short, and half of it zeros; through the quaternion it is neither.
    """
    yield q, coordinate_rates(model, q)
    for body in model.leaders:
        place, mine = body.places
        for R, slopes in body.joint.rotation_slopes(q[place]):
            dR = zeros(3, 3, model.nv)
            dR[:, :, mine] = slopes
            yield R, dR


def brackets(model: Model) -> Array:
    """c with [S_a, S_b] = Σ c_abd S_d for the screw axes of one joint, which make a group; (nv, nv, nv)."""
    c = np.zeros((model.nv, model.nv, model.nv))
    for body in model.leaders:
        mine = body.places[1]
        axes = body.joint.axes
        both = np.array([[ad(S_a) @ S_b for S_b in axes] for S_a in axes], float)
        c[mine, mine, mine] = np.round(both @ np.linalg.pinv(axes), 12)  # orthonormal axes: 0, 1 and -1
    return c
