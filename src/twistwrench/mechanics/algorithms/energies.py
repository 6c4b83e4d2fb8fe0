"""Energies, momentum and centre of mass of a robot. Modern Robotics sections 8.1 and 8.2."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...core.typing import Array
from ..lie import so3
from ..lie.adjoint import Ad
from ..model.couplings import motor_velocities
from ..model.model import BASE, Model
from .mass_matrix import composite_inertias
from .recursion import (
    base_poses,
    joint_poses,
    outward,
    spread,
    spring_energy,
    zeros,
)


def body_velocities(model: Model, T: Sequence[Array], dq: Array) -> list[Array]:
    """Twist V_i of each body in its own frame; (6,) each. MR eq. 8.51."""
    Adq = spread(model, dq)  # A_i dq_i: twist of each body relative to its parent
    V: list[Array] = []
    for i, p in outward(model):
        if p == BASE:
            V.append(Adq[i])
        else:
            V.append(Ad(T[i]).inverse @ V[p] + Adq[i])
    return V


def kinetic_energy(model: Model, q: Array, dq: Array) -> Any:
    """½ Σ V' G V plus the energy of the drives' armature [J]. MR section 8.1.2."""
    T = joint_poses(model, q)
    twists = body_velocities(model, T, dq)
    motor_dq = motor_velocities(model, dq)
    energy = 0.5 * (motor_dq @ (model.armature * motor_dq))
    for body, V in zip(model.bodies, twists, strict=True):
        energy = energy + 0.5 * (V @ (body.inertia @ V))
    return energy


def _mass_and_first_moment(model: Model, q: Array) -> tuple[float, Array]:
    """Mass and first moment (3,) of all moving bodies together, in the base frame."""
    mass = 0.0
    h = zeros(3)  # first moment
    T_s = base_poses(model, joint_poses(model, q))
    for body, T in zip(model.bodies, T_s, strict=True):
        mass += body.inertia.mass
        h = h + T[:3, :3] @ body.inertia.first_moment + body.inertia.mass * T[:3, 3]
    return mass, h


def potential_energy(model: Model, q: Array) -> Any:
    """-Σ m g·c plus the energy of springs [J]. The sum is zero if every centre of mass c is at the base origin."""
    _, h = _mass_and_first_moment(model, q)
    return -(model.gravity @ h) + spring_energy(model, q)


def center_of_mass(model: Model, q: Array) -> Array:
    """Centre of mass (3,) of the moving bodies in the base frame; NaN if their mass is zero."""
    mass, h = _mass_and_first_moment(model, q)
    return h * _mass_inverse(mass)


def _mass_inverse(mass: Any) -> Any:
    """1 / mass, NaN for zero mass; symbolic masses count as nonzero."""
    if isinstance(mass, int | float) and mass == 0:
        return np.nan
    return 1.0 / mass


def com_jacobian(model: Model, q: Array) -> Array:
    """J (3, nv) with d(center_of_mass)/dt = J dq. Each joint moves all bodies that it carries as one composite body."""
    T_s = base_poses(model, joint_poses(model, q))
    G = composite_inertias(model, q)
    J = zeros(3, model.nv)
    for i, body in enumerate(model.bodies):
        R = T_s[i][:3, :3]
        for k, S in enumerate(body.joint.axes):
            column = body.v_index + k
            composite_momentum = G[i] @ S  # at unit rate, in the body's frame
            J[:, column] = J[:, column] + body.ratio * (R @ composite_momentum[3:])
    mass = sum(body.inertia.mass for body in model.bodies)
    return J * _mass_inverse(mass)


def momentum(model: Model, q: Array, dq: Array) -> Array:
    """Spatial momentum P of the moving bodies at the base origin; (6,)."""
    T = joint_poses(model, q)
    V = body_velocities(model, T, dq)
    T_s = base_poses(model, T)
    P = zeros(6)
    for i, body in enumerate(model.bodies):
        P = P + Ad(T_s[i]).inverse.T @ (body.inertia @ V[i])
    return P


def momentum_about_com(model: Model, q: Array, dq: Array) -> Array:
    """Centroidal momentum (6,): the momentum about the centre of mass, in the axes of {s}."""
    P = momentum(model, q, dq)
    angular, linear = P[:3], P[3:]
    angular_about_com = angular - so3.cross(center_of_mass(model, q), linear)
    return np.concatenate([angular_about_com, linear])
