"""Outward and inward passes over the kinematic tree; maps between robot and body coordinates; armature and springs of joints.

An algorithm is a loop ``for i, p in outward(model)`` or ``for i, p in inward(model)``; ``p`` is the parent's number,
``BASE`` for bodies on the base. Parents have lower numbers than their children, so an outward pass counts up, an inward pass
down.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from ...core.typing import Array
from ..lie.adjoint import ad
from ..model.couplings import joint_torques, motor_velocities
from ..model.model import BASE, Body, Model, Spring


def outward(model: Model) -> Iterator[tuple[int, int]]:
    """(body, parent) from the base to the leaves."""
    return ((i, body.parent) for i, body in enumerate(model.bodies))


def inward(model: Model) -> Iterator[tuple[int, int]]:
    """(body, parent) from the leaves to the base."""
    return ((i, model.bodies[i].parent) for i in reversed(range(len(model.bodies))))


def ancestors(model: Model, i: int) -> Iterator[int]:
    """The body itself, its parent, and so on up to the base, excluded."""
    while i != BASE:
        yield i
        i = model.bodies[i].parent


def joint_coordinates(model: Model, q: Array) -> list[Array]:
    """Coordinates of each body's joint, (nq,) of that joint; coordinates of a follower come from its leader."""
    return [body.coordinates(q) for body in model.bodies]


def joint_poses(model: Model, q: Array) -> list[Array]:
    """T[i], pose of body i in its parent's frame; (4, 4) each."""
    poses = []
    for body, q_joint in zip(model.bodies, joint_coordinates(model, q), strict=True):
        poses.append(body.placement @ body.joint.pose(q_joint))
    return poses


def spread(model: Model, dq: Array) -> list[Array]:
    """Twist A dq of each joint in its body's frame; (6,) each. As A is constant, ``spread(model, ddq)`` is its derivative."""
    twists = []
    for body in model.bodies:
        _, columns = body.places
        twists.append(body.ratio * (dq[columns] @ body.joint.axes))
    return twists


def collect(model: Model, wrenches: Array) -> Array:
    """Joint torques A' F (nv,) from the wrench on each body through its joint; torques of followers are added to leaders."""
    tau = zeros(model.nv)
    for body, F in zip(model.bodies, wrenches, strict=True):
        torque = body.joint.axes @ F
        _, columns = body.places
        tau[columns] = tau[columns] + body.ratio * torque
    return tau


def add_entry(matrix: Array, row_body: Body, m: int, column_body: Body, k: int, value: Any) -> None:
    """Add a value for velocity m of one joint (row) and velocity k of another (column), scaled by the ratios of followers."""
    row = row_body.v_index + m
    column = column_body.v_index + k
    matrix[row, column] = matrix[row, column] + row_body.ratio * column_body.ratio * value


def zeros(*shape: int) -> Array:
    """Array of zeros that can hold symbols."""
    return np.full(shape, 0.0, object)


def base_poses(model: Model, T: Sequence[Array]) -> list[Array]:
    """T_s,i: pose of each body in the base frame, from the poses in the parents' frames."""
    poses: list[Array] = []
    for i, p in outward(model):
        poses.append(T[i] if p == BASE else poses[p] @ T[i])
    return poses


# ── Armature: inertia A = diag(a) of drives, with kinetic energy ½ u' A u in the joint velocities u

# The velocities of planar, ball and floating joints are not coordinate rates, but components of the joint's twist V along its
# axes S_k. Lagrange's equations become Hamel's, and an armature has velocity products like any inertia of that twist:
#
#     τ = A du/dt - [V, ·]' A u = A du/dt + C u,     C = L u,     L_abc = a_c S_c·[S_a, S_b]     (axes of unit length).
#
# C is skew, as required by dM/dt = 0. L is zero for joints of one degree of freedom. For a ball joint with equal armatures C u
# is zero. For a floating joint a (ω × v) remains: the velocity of its origin is expressed in a moving frame.
# Source: Hamel, "Die Lagrange-Eulerschen Gleichungen der Mechanik", 1904; Modern Robotics section 8.2.2.


def armature_symbols(model: Model) -> Iterator[tuple[slice, Array]]:
    """Slice of dq and L (n, n, n) of each joint that has n > 1 velocities and an armature."""
    for body in model.leaders:
        _, columns = body.places
        S = body.joint.axes
        n = body.joint.nv
        a = model.armature[columns]
        if n > 1 and a.any():
            L = np.empty((n, n, n), a.dtype)
            for i, j in np.ndindex(n, n):
                L[i, j] = a * (S @ (ad(S[i]) @ S[j]))  # a_c S_c·[S_a, S_b] for all c
            yield columns, L


def armature_forces(model: Model, dq: Array, ddq: Array) -> Array:
    """Torques of the armature, A ddq + C u with u = dq; (..., nv)."""
    tau = joint_torques(model, model.armature * motor_velocities(model, ddq))
    for columns, L in armature_symbols(model):
        u = dq[..., columns]
        # each product of two velocities once; squares have zero coefficients
        coefficients = np.triu(L + L.swapaxes(1, 2))
        products = u[..., None, :, None] * u[..., None, None, :]  # of velocities b and c, for any a
        tau[..., columns] = tau[..., columns] + (coefficients * products).sum(axis=(-2, -1))
    return tau


# ── Springs between joint coordinates: energy and torques. Modern Robotics section 8.9.5


def spring_energy(model: Model, q: Array) -> Any:
    """½ Σ k x² with the elongation x of each spring [J]."""
    energy: Any = 0.0
    for spring in model.springs:
        x = _elongation(model, spring, q)
        energy = energy + 0.5 * spring.stiffness * (x * x)
    return energy


def spring_forces(model: Model, q: Array) -> Array:
    """Torques that hold the springs, the gradient of their energy; (nv,)."""
    tau = zeros(model.nv)
    for spring in model.springs:
        force = spring.stiffness * _elongation(model, spring, q)
        for body, weight in _bodies_with_weights(model, spring):
            tau[body.v_index] = tau[body.v_index] + weight * force
    return tau


def spring_stiffness(model: Model) -> Array:
    """Second derivative of the springs' energy; (nv, nv)."""
    K = zeros(model.nv, model.nv)
    for spring in model.springs:
        for row_body, row_weight in _bodies_with_weights(model, spring):
            for column_body, column_weight in _bodies_with_weights(model, spring):
                row, column = row_body.v_index, column_body.v_index
                K[row, column] = K[row, column] + spring.stiffness * row_weight * column_weight
    return K


def _elongation(model: Model, spring: Spring, q: Array) -> Any:
    """Elongation of a spring: Σ weight · coordinate - rest."""
    elongation: Any = -spring.rest
    for body, weight in _bodies_with_weights(model, spring):
        elongation = elongation + weight * q[body.q_index]
    return elongation


def _bodies_with_weights(model: Model, spring: Spring) -> Iterator[tuple[Body, float]]:
    """Body and weight of each joint on which a spring acts."""
    return ((model.leaders_by_name[joint], weight) for joint, weight in spring.terms)
