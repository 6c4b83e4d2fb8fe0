"""Coordinates that are no vectors: how fast they change at given joint velocities, and how they are kept on their manifold.

Steps of Runge–Kutta methods go through the numbers of q themselves, whose rates are N(q) dq, and quaternions are then put
back to unit length. The flow keeps that length, so what is put back is of the size of the step's error, and every method has
its full order. Source: Hairer, Lubich and Wanner, Geometric Numerical Integration, section IV.4.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ..algorithms.coordinate_rates import brackets
from ..typing import Array

if TYPE_CHECKING:
    from ..robot import Robot


class Manifold:
    """The configurations of one robot, one state at a time."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self.model = robot, robot.model
        self.flat = all(body.joint.plain_rates for body in self.model.leaders)
        """Whether the rates of all coordinates are the velocities themselves."""

    @cached_property
    def _rates(self) -> Any:
        return self.robot.kernel("coordinate_rates")

    @cached_property
    def _add(self) -> Any:
        return self.robot.kernel("add")

    def rates(self, q: Array, dq: Array, out: Array) -> None:
        """Write dq/dt of the coordinates, (nq,), at the joint velocities (nv,), into ``out``."""
        if self.flat:
            out[:] = dq
        else:
            self._rates(q, dq, out=out)

    def move(self, q: Array, dv: Array) -> Array:
        """q ⊕ dv, (nq,), (nv,) → (nq,)."""
        return q + dv if self.flat else np.asarray(self._add(q, dv))

    def normalise(self, q: Array) -> None:
        """Bring the quaternions to unit length, in place."""
        for mine in self.model.quaternions:
            q[mine] /= np.linalg.norm(q[mine])

    def errors(self, off: Array) -> Array:
        """Errors of the joints (nv,) [rad or m] that errors of the coordinates (nq,) can make."""
        found = np.zeros(self.model.nv)
        for body in self.model.leaders:
            place, mine = body.places
            found[mine] = body.joint.bound(off[place])
        return found

    @cached_property
    def groups(self) -> tuple[tuple[slice, Array, Array], ...]:
        """Joints whose directions do not commute: their velocities, which of them turn, and c (n, n²) with ad(V) = V c."""
        constants = brackets(self.model)
        found = []
        for body in self.model.leaders:
            mine = body.places[1]
            c = constants[mine, mine, mine]
            if c.any():
                turning = np.array(body.joint.turning, bool)
                found.append((mine, turning, c.transpose(0, 2, 1).reshape(len(c), -1).copy()))
        return tuple(found)
