"""Loads of joints from the wrenches across them: torques of followers with a motor, forces and moments on bearings."""

from __future__ import annotations

import numpy as np

from ...core.typing import Array
from .limits import BEARINGS
from .model import Model


def follower_torques(model: Model, F: Array) -> Array:
    """Torques of followers with an effort limit, (..., k) [N m or N], from wrenches across the joints (..., nbodies, 6).

    τ = S' F for each of ``model.limited_followers``: torque of a motor at the follower, without friction.
    """
    followers = model.limited_followers
    return np.stack([F[..., i, :] @ model.bodies[i].joint.axes[0] for i in followers], axis=-1)


def bearing_loads(model: Model, F: Array) -> dict[str, Array]:
    """Loads (..., nbodies) of the bearings by kind, from wrenches across the joints (..., nbodies, 6).

    NaN at joints with other than one degree of freedom, and for forces along the axes of sliding joints, which motors bear.
    """
    loads = {kind: np.full(F.shape[:-1], np.nan) for kind in BEARINGS}
    for i, body in enumerate(model.bodies):
        if body.joint.nv != 1 or not body.joint.moves_body:
            continue
        moment, force, S = F[..., i, :3], F[..., i, 3:], body.joint.axes[0]
        turns = bool(S[:3].any())
        axis = S[:3] if turns else S[3:]
        axis = np.asarray(axis / np.linalg.norm(axis), float)
        axial_force = force @ axis
        loads["radial"][..., i] = np.linalg.norm(force - axial_force[..., None] * axis, axis=-1)
        if turns:
            loads["axial"][..., i] = np.abs(axial_force)
            moment = moment - (moment @ axis)[..., None] * axis
        loads["tilting"][..., i] = np.linalg.norm(moment, axis=-1)
    return loads
