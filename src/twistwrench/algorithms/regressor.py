"""The regressor: inverse dynamics is linear in the inertial parameters. Atkeson, An and Hollerbach, 1986."""

from __future__ import annotations

import numpy as np

from ..bodies.inertia import SpatialInertia
from ..lie.adjoint import Ad
from ..model.model import Model
from ..typing import Array
from .inverse_dynamics import body_motions, inertial_wrench
from .recursion import ancestors, joint_poses, zeros

PARAMETER_NAMES = ("m", "mcx", "mcy", "mcz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
"""The ten parameters of a body about its frame's origin, in the order of ``SpatialInertia.parameters``."""

_UNITS = [SpatialInertia.from_parameters(e) for e in np.eye(10)]


def regressor(model: Model, q: Array, dq: Array, ddq: Array) -> Array:
    """Y with τ = Y π, π the ten parameters of each body in turn; springs and armature apart; (nv, 10 nbodies)."""
    T = joint_poses(model, q)
    up = [Ad(X).inverse.T for X in T]
    Y = zeros(model.nv, 10 * len(model.bodies))
    for i, motion in body_motions(model, T, dq, ddq):
        for k, unit in enumerate(_UNITS):
            F, column = inertial_wrench(unit, motion), 10 * i + k
            for j in ancestors(model, i):
                body = model.bodies[j]
                rows = body.places[1]
                Y[rows, column] = Y[rows, column] + body.ratio * (body.joint.axes @ F)
                F = up[j] @ F
    return Y
