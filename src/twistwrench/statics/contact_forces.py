"""Contact forces alone, for the torques of a motion: without margins."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..core.typing import Array
from .balance import Balance
from .contacts import Contact, contact_maps
from .torque_limits import floating_entries

if TYPE_CHECKING:
    from ..robot import Robot


class ContactForces(NamedTuple):
    """Contact forces of n instants, without margins."""

    forces: Array
    """(n, c, 3): forces on the robot in the base frame [N]; where no forces balance, those of contacts that stick."""
    maps: Array
    """(n, nv, c, 3): maps of contact forces to torques."""
    holds: Array
    """(n,) of bool: True where forces within the cones balance."""


def contact_forces(
    robot: Robot,
    q: Array,
    tau: Array,
    contacts: tuple[Contact, ...],
    in_contact: Array,
    limits: Array | None = None,
) -> ContactForces:
    """Forces of :func:`support` that balance torques (n, nv) at the free base; ``tau`` are torques without contacts."""
    maps, balance = _maps_and_balance(robot, q, tau, contacts, in_contact)
    forces, least_norm, holds = balance.forces()
    if limits is not None:
        joint_limits = np.where(floating_entries(robot), np.inf, limits)
        forces, _ = balance.forces_within(forces, least_norm, maps, tau, joint_limits)
    if not holds.all():  # contacts stick there: forces of least norm without cones
        is_unbalanced = ~holds
        active_maps = (
            balance.maps[is_unbalanced] * in_contact[is_unbalanced][:, None, :, None]
        )  # (instants, entries, contacts, 3)
        G = active_maps.reshape(*active_maps.shape[:2], -1)
        load_columns = balance.load[is_unbalanced][..., None]
        sticking_forces = np.linalg.pinv(G) @ load_columns
        forces[is_unbalanced] = sticking_forces.reshape(-1, len(contacts), 3)
    return ContactForces(forces, maps, holds)


def friction_within(
    robot: Robot, q: Array, tau: Array, contacts: tuple[Contact, ...], in_contact: Array, friction: Array, limits: Array,
    most: float,
) -> Array:  # fmt: skip
    """Least coefficients of friction (n,), up to ``most``, with which the torques are within limits (nv,).

    ``friction`` (n,) are the least coefficients for the balance alone. They stay where they suffice for the limits, and where
    no friction up to ``most`` suffices.
    """
    maps, balance = _maps_and_balance(robot, q, tau, contacts, in_contact)
    joint_limits = np.where(floating_entries(robot), np.inf, limits)
    return balance.friction_within(friction, maps, tau, joint_limits, most)


def _maps_and_balance(
    robot: Robot, q: Array, tau: Array, contacts: tuple[Contact, ...], in_contact: Array
) -> tuple[Array, Balance]:
    """Maps (n, nv, c, 3) of the contacts, and the balance of torques (n, nv) at the free base."""
    is_free = floating_entries(robot)
    is_moment = np.array([S[:3].any() for body in robot.model.leaders for S in body.joint.axes], bool)
    maps, _ = contact_maps(robot, q, contacts)
    balance = Balance(contacts, maps[:, is_free], tau[:, is_free], None, None, is_moment[is_free], in_contact)
    return maps, balance
