"""The two passes over the tree, and the doors between a robot's coordinates and its bodies'. Nowhere else.

An algorithm is the body of ``for i, p in outward(model)`` and of ``for i, p in inward(model)``; ``p`` is the parent's
number, ``BASE`` for bodies on the base. Parents come before children, so the passes are a count up and a count down.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from ..model.model import BASE, Body, Model
from ..typing import Array


def outward(model: Model) -> Iterator[tuple[int, int]]:
    """(body, parent) from the base to the leaves."""
    return ((i, body.parent) for i, body in enumerate(model.bodies))


def inward(model: Model) -> Iterator[tuple[int, int]]:
    """(body, parent) from the leaves to the base."""
    return ((i, model.bodies[i].parent) for i in reversed(range(len(model.bodies))))


def ancestors(model: Model, i: int) -> Iterator[int]:
    """The body itself, its parent, and so on to the base, which is left out."""
    while i != BASE:
        yield i
        i = model.bodies[i].parent


def joint_coordinates(model: Model, q: Array) -> list[Array]:
    """The coordinates of each body's joint, (nq,) of that joint; a follower's from its leader's."""
    mine = [q[body.places[0]] for body in model.bodies]
    return [body.ratio * x + body.offset if body.follows else x for body, x in zip(model.bodies, mine, strict=True)]


def joint_poses(model: Model, q: Array) -> list[Array]:
    """T[i], pose of body i in its parent's frame; (4, 4) each."""
    coordinates = joint_coordinates(model, q)
    return [body.placement @ body.joint.pose(x) for body, x in zip(model.bodies, coordinates, strict=True)]


def spread(model: Model, dq: Array) -> list[Array]:
    """The twist of each joint in its body's frame, A dq; (6,) each. Also its derivative, given ddq: A is constant."""
    twists = []
    for body in model.bodies:
        mine = dq[body.places[1]]
        twists.append(body.ratio * (mine @ body.joint.axes))
    return twists


def collect(model: Model, wrenches: Array) -> Array:
    """Joint torques (nv,) from the wrench on each body through its joint: A' F, summed over joints that share a coordinate."""
    tau = zeros(model.nv)
    for body, F in zip(model.bodies, wrenches, strict=True):
        torque = body.joint.axes @ F
        mine = body.places[1]
        tau[mine] = tau[mine] + body.ratio * torque
    return tau


def add_entry(matrix: Array, row: Body, a: int, column: Body, b: int, value: Any) -> None:
    """Add to what the velocities a of one joint and b of another have between them; of followers, by their ratios."""
    r, c = row.v_index + a, column.v_index + b
    matrix[r, c] = matrix[r, c] + row.ratio * column.ratio * value


def zeros(*shape: int) -> Array:
    """An array of zeros that can hold symbols."""
    return np.full(shape, 0.0, object)


def base_poses(model: Model, T: Sequence[Array]) -> list[Array]:
    """T_s,i: pose of every body in the base frame, from the poses in the parents' frames."""
    poses: list[Array] = []
    for i, p in outward(model):
        poses.append(T[i] if p == BASE else poses[p] @ T[i])
    return poses
