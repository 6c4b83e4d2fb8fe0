"""Control laws of joints. Modern Robotics section 11.4."""

from __future__ import annotations

import numpy as np

from ..model.model import Model
from ..typing import Array
from .articulated import articulated_pays
from .inverse_dynamics import bias_forces, inverse_dynamics
from .mass_matrix import mass_matrix
from .recursion import zeros


def undriven(model: Model) -> tuple[str, ...]:
    """The joints of several degrees of freedom, which no law of one joint drives: ball, planar and floating ones."""
    return tuple(body.joint.name for body in model.leaders if body.joint.nv > 1)


def clipped(tau: Array, limits: Array) -> Array:
    """The torques, or the limits they are beyond; (nv,). On symbols; a torque that is a plain number is the 0 of no law."""
    return np.array([x.clip(-y, y) if hasattr(x, "clip") else x for x, y in zip(tau, limits, strict=True)], object)


def proportional_derivative(
    model: Model, q: Array, dq: Array, q_des: Array, dq_des: Array, kp: Array, kd: Array
) -> Array:
    """Kp e + Kd ė of every joint of one degree of freedom, 0 for others; (nv,). MR section 11.4."""
    u = zeros(model.nv)
    for body in model.leaders:
        if body.joint.nv == 1:
            i, k = body.q_index, body.v_index
            u[k] = kp[k] * (q_des[i] - q[i]) + kd[k] * (dq_des[k] - dq[k])
    return u


def computed_torque(model: Model, q: Array, dq: Array, ddq: Array) -> Array:
    """τ = M q̈ + h, for the acceleration that is wanted; (nv,). MR eq. 11.35.

    M and h are those that forward dynamics needs, where it goes by M.
    """
    if articulated_pays(model):
        return inverse_dynamics(model, q, dq, ddq)
    return mass_matrix(model, q) @ ddq + bias_forces(model, q, dq)
