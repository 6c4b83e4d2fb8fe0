"""Independent generalized coordinates of a robot, and their names.

Joints with one coordinate keep it. A planar joint has x, y and an angle. A floating joint has x, y, z and the ZYX
Euler angles of Modern Robotics appendix B.1.1, because the four numbers of a quaternion are not independent.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ..core.typing import Array
from ..mechanics.model.model import Model


@dataclass(frozen=True)
class Variable:
    """Variable of differentiation: symbols of a coordinate, its rate and acceleration."""

    name: str
    """Symbol of the coordinate."""
    rate: str
    """Symbol of its rate."""
    acceleration: str
    """Symbol of its second derivative."""


@dataclass(frozen=True)
class Coordinate:
    """Generalized coordinate of a robot."""

    name: str
    """Symbol, such as theta_1."""
    angle: bool
    """True for an angle."""
    meaning: str
    """Noun with the name of the joint and the unit."""

    @property
    def rate(self) -> str:
        """Symbol of the rate."""
        return rate_symbol(self.name)

    @property
    def acceleration(self) -> str:
        """Symbol of the second derivative."""
        return rate_symbol(self.name, "ddot")


def rate_symbol(name: str, mark: str = "dot") -> str:
    """Symbol of a derivative: of the rate, theta_1 → thetadot_1, x → xdot, or with another ``mark``, as ddot.

    >>> rate_symbol("theta_1"), rate_symbol("x", "ddot")
    ('thetadot_1', 'xddot')
    """
    stem, separator, index = name.partition("_")
    return f"{stem}{mark}{separator}{index}"


def variable_names(coordinates: Iterable[Coordinate | Variable]) -> tuple[list[str], list[str], list[str]]:
    """Symbols of coordinates, of their rates, and of their accelerations."""
    names, rates, accelerations = [], [], []
    for coordinate in coordinates:
        names.append(coordinate.name)
        rates.append(coordinate.rate)
        accelerations.append(coordinate.acceleration)
    return names, rates, accelerations


def coordinates_of(model: Model) -> tuple[Coordinate, ...]:
    """Coordinates in the order of q. Their symbols have the number of the joint, counted from 1 without followers."""
    coordinates = []
    for number, body in enumerate(model.leaders, 1):
        for entry in body.joint.chart:
            unit = "rad" if entry.angle else "m"
            noun = entry.meaning.format(body.joint.name)
            symbol = f"{entry.letter}_{number}"
            coordinates.append(Coordinate(symbol, entry.angle, f"{noun} [{unit}]"))
    return tuple(coordinates)


def to_robot(model: Model, u: Array, du: Array, ddu: Array) -> tuple[Array, Array, Array, Array]:
    """State q (nq,), dq and ddq (nv,) of the robot from coordinates u, du and ddu (nv,), and N (nv, nv) with dq = N du.

    Torques in the coordinates u are N' tau.
    """
    q = model.neutral
    dq = np.zeros(model.nv)
    ddq = np.zeros(model.nv)
    N = np.zeros((model.nv, model.nv))
    for body in model.leaders:
        q_slice, v_slice = body.places
        du_joint, ddu_joint = du[v_slice], ddu[v_slice]
        q_joint, B, dB = body.joint.from_chart(u[v_slice], du_joint)
        q[q_slice] = q_joint
        N[v_slice, v_slice] = B
        dq[v_slice] = B @ du_joint
        ddq[v_slice] = B @ ddu_joint + dB @ du_joint
    return q, dq, ddq, N
