"""Generalized coordinates of a robot: independent ones, so that Lagrange's equations hold for them, and their names.

Joints with one coordinate keep it. A planar joint has x, y and an angle; a floating one x, y, z and the ZYX Euler angles
of Modern Robotics appendix B.1.1, in place of a quaternion, whose four numbers are not independent.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..model.model import Body, Model

Array = NDArray[Any]

__all__ = ["Coordinate", "Variable", "coordinates_of", "dotted", "to_robot"]

_FLOATING = (("x", 0), ("y", 0), ("z", 0), ("alpha", 1), ("beta", 1), ("gamma", 1))
_PLANAR = (("x", 0), ("y", 0), ("theta", 1))


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
    joint = body.joint
    if joint.nv == 1:
        turns = bool(joint.axes[0, :3].any())
        unit = "rad" if turns else "m"
        return [Coordinate(f"{'theta' if turns else 'x'}_{n}", turns, f"joint {joint.name} [{unit}]")]
    parts = _FLOATING if joint.kind == "floating" else _PLANAR
    what = {"alpha": "yaw", "beta": "pitch", "gamma": "roll", "theta": "angle"}
    return [
        Coordinate(
            f"{letter}_{n}",
            bool(angle),
            f"{what.get(letter, letter)} of joint {joint.name} [{'rad' if angle else 'm'}]",
        )
        for letter, angle in parts
    ]


def to_robot(model: Model, u: Array, du: Array, ddu: Array) -> tuple[Array, Array, Array, Array]:
    """One state in these coordinates, (nv,) each, as the robot's q (nq,), dq and ddq (nv,), and N (nv, nv) with dq = N du.

    Torques go the other way: those that belong to the coordinates are N' tau.
    """
    q, dq, ddq = model.neutral, np.zeros(model.nv), np.zeros(model.nv)
    N = np.zeros((model.nv, model.nv))
    for body in model.leaders:
        mine = slice(body.v_index, body.v_index + body.joint.nv)
        place = slice(body.q_index, body.q_index + body.joint.nq)
        x, dx, ddx = u[mine], du[mine], ddu[mine]
        if body.joint.kind == "floating":
            q[place], B, dB = _euler(x, dx)
        elif body.joint.kind == "planar":
            q[place], B, dB = x, *_planar(x, dx)
        else:
            q[place], B, dB = x, np.eye(1), np.zeros((1, 1))
        N[mine, mine] = B
        dq[mine], ddq[mine] = B @ dx, B @ ddx + dB @ dx
    return q, dq, ddq, N


def _planar(x: Array, dx: Array) -> tuple[Array, Array]:
    """(omega, v_1, v_2) = B (dx, dy, dtheta), and dB/dt."""
    c, s, w = np.cos(x[2]), np.sin(x[2]), dx[2]
    B = np.array([[0, 0, 1], [c, s, 0], [-s, c, 0]])
    return B, w * np.array([[0, 0, 0], [-s, c, 0], [-c, -s, 0]])


def _euler(x: Array, dx: Array) -> tuple[Array, Array, Array]:
    """The quaternion and place, B with (omega_b, v_b) = B du, and dB/dt."""
    (ca, cb, cc), (sa, sb, sc) = np.cos(x[3:]), np.sin(x[3:])
    _, db, dc = dx[3:]
    R = np.array(
        [
            [ca * cb, ca * sb * sc - sa * cc, ca * sb * cc + sa * sc],
            [sa * cb, sa * sb * sc + ca * cc, sa * sb * cc - ca * sc],
            [-sb, cb * sc, cb * cc],
        ]
    )
    E = np.array([[-sb, 0, 1], [cb * sc, cc, 0], [cb * cc, -sc, 0]])
    dE = np.array(
        [[-cb * db, 0, 0], [-sb * sc * db + cb * cc * dc, -sc * dc, 0], [-sb * cc * db - cb * sc * dc, -cc * dc, 0]]
    )
    w = E @ dx[3:]
    W = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
    B, dB = np.zeros((6, 6)), np.zeros((6, 6))
    B[:3, 3:], B[3:, :3] = E, R.T
    dB[:3, 3:], dB[3:, :3] = dE, -W @ R.T
    (ha, hb, hc) = x[3:] / 2
    turns = [np.array([np.cos(hb_), *(np.sin(hb_) * e)]) for hb_, e in zip((ha, hb, hc), np.eye(3)[::-1], strict=True)]
    quat = _times(_times(turns[0], turns[1]), turns[2])
    return np.concatenate([quat, x[:3]]), B, dB


def _times(a: Array, b: Array) -> Array:
    from ..lie import quaternion

    return np.asarray(quaternion.multiply(a, b))
