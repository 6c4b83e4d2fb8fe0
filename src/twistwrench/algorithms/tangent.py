"""How a configuration moves: the derivatives of q ⊕ v by v at v = 0, and what is left of a bracket of two motions.

Along robot.add the pose of each joint goes as T exp([A v]), so with dR = R [w] and dp = R v

    dq = N(q) v,      N of a quaternion Q:  dQ = ½ Q (0, w),

which is along Q's own direction-free part: functions that do not depend on its length have the derivative of robot.add's
normalised one. Modern Robotics sections 3.2.2 and 3.3.2; quaternions: Appendix B.3.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..lie import quaternion, so3
from ..lie.adjoint import ad
from ..model.model import Body, Model
from .recursion import zeros

Array = NDArray[Any]

__all__ = ["brackets", "coordinate_rates", "moving_parts"]


def coordinate_rates(model: Model, q: Array) -> Array:
    """N with dq/dt = N dq along robot.add; (nq, nv)."""
    N = zeros(model.nq, model.nv)
    for body in model.leaders:
        rows, columns = _places(body)
        N[rows, columns] = _joint_rates(body, q[rows])
    return N


def moving_parts(model: Model, q: Array) -> Iterator[tuple[Array, Array]]:
    """(x, its derivative along each velocity (*x.shape, nv)) of q, and of the rotation of each floating joint.

    dR = R [w] is short, and half of it zeros; through the quaternion it is neither.
    """
    yield q, coordinate_rates(model, q)
    for body in model.leaders:
        if body.joint.kind == "floating":
            R = quaternion.rotation(q[_places(body)[0]][:4])
            dR = zeros(3, 3, model.nv)
            for k, e in enumerate(np.eye(3).astype(object)):
                dR[:, :, body.v_index + k] = R @ so3.hat(e)
            yield R, dR


def brackets(model: Model) -> Array:
    """c with [S_a, S_b] = Σ c_abd S_d for the screw axes of one joint, which make a group; (nv, nv, nv)."""
    c = np.zeros((model.nv, model.nv, model.nv))
    for body in model.leaders:
        _, mine = _places(body)
        axes = body.joint.axes
        both = np.array([[ad(S_a) @ S_b for S_b in axes] for S_a in axes], float)
        c[mine, mine, mine] = np.round(both @ np.linalg.pinv(axes), 12)  # orthonormal axes: 0, 1 and -1
    return c


def _places(body: Body) -> tuple[slice, slice]:
    """Where the joint is in q and in dq."""
    q_index, v_index = body.q_index, body.v_index
    return slice(q_index, q_index + body.joint.nq), slice(v_index, v_index + body.joint.nv)


def _joint_rates(body: Body, q: Array) -> Array:
    if body.joint.kind == "planar":
        c, s = np.cos(q[2]), np.sin(q[2])
        return np.array([[0.0, c, -s], [0.0, s, c], [1.0, 0.0, 0.0]], object)
    if body.joint.kind == "floating":
        w, x, y, z = 0.5 * q[:4]
        N = zeros(7, 6)
        N[:4, :3] = [[-x, -y, -z], [w, -z, y], [z, w, -x], [-y, x, w]]
        N[4:, 3:] = quaternion.rotation(q[:4])
        return N
    return np.eye(1)
