"""Generalized coordinates of a robot: independent ones, so that Lagrange's equations hold for them, and their names.

Joints with one coordinate keep it. A planar joint has x, y and an angle; a floating one x, y, z and the ZYX Euler angles
of Modern Robotics appendix B.1.1, in place of a quaternion, whose four numbers are not independent.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..model.model import Body, Model
from ..typing import Array


@dataclass(frozen=True)
class Variable:
    """What sums are differentiated with respect to: a coordinate, its rate and acceleration, by their symbols."""

    name: str
    rate: str
    acceleration: str


@dataclass(frozen=True)
class Coordinate:
    """One coordinate: its symbol, whether it is an angle, and what it stands for."""

    name: str
    angle: bool
    meaning: str

    @property
    def rate(self) -> str:
        """The symbol of its rate."""
        return dotted(self.name)

    @property
    def acceleration(self) -> str:
        """The symbol of its second derivative."""
        return dotted(self.name, "ddot")


def dotted(name: str, mark: str = "dot") -> str:
    """The naming rule of rates: theta_1 → thetadot_1, x → xdot.

    >>> dotted("theta_1"), dotted("x", "ddot")
    ('thetadot_1', 'xddot')
    """
    stem, line, index = name.partition("_")
    return f"{stem}{mark}{line}{index}"


def coordinates_of(model: Model) -> tuple[Coordinate, ...]:
    """The coordinates, in the order of q; numbered by the joints that have coordinates of their own."""
    return tuple(c for n, body in enumerate(model.leaders, 1) for c in _of_joint(body, n))


def _of_joint(body: Body, n: int) -> list[Coordinate]:
    return [
        Coordinate(
            f"{entry.letter}_{n}",
            entry.angle,
            f"{entry.meaning.format(body.joint.name)} [{'rad' if entry.angle else 'm'}]",
        )
        for entry in body.joint.chart
    ]


def to_robot(model: Model, u: Array, du: Array, ddu: Array) -> tuple[Array, Array, Array, Array]:
    """One state in these coordinates, (nv,) each, as the robot's q (nq,), dq and ddq (nv,), and N (nv, nv) with dq = N du.

    Torques go the other way: those that belong to the coordinates are N' tau.
    """
    q, dq, ddq = model.neutral, np.zeros(model.nv), np.zeros(model.nv)
    N = np.zeros((model.nv, model.nv))
    for body in model.leaders:
        place, mine = body.places
        dx, ddx = du[mine], ddu[mine]
        q[place], B, dB = body.joint.from_chart(u[mine], dx)
        N[mine, mine] = B
        dq[mine], ddq[mine] = B @ dx, B @ ddx + dB @ dx
    return q, dq, ddq, N
