"""Rotors: bodies of revolution that an actuator turns on the link that carries them."""

from __future__ import annotations

import numpy as np

from ..bodies.inertia import SpatialInertia
from ..typing import Array
from .screw_joint import ScrewJoint


class RotorJoint(ScrewJoint):
    """Turns about its axis of symmetry. It looks the same however it has turned, so its frame stays behind."""

    kind = "rotor"
    moves_body = False

    def pose(self, q: Array) -> Array:
        """That of the carrier."""
        return np.eye(4)

    def carry(self, G: SpatialInertia, q: Array) -> SpatialInertia:
        """Unchanged."""
        return G
