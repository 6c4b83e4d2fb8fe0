"""Forces of compliant contacts, by the law of Hunt and Crossley: points that run into a plane, and joints into their stops.

Where a point is a depth d > 0 inside, and sinks in at the rate d', it is pushed out with f = k dⁿ max(0, 1 + c d').
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import reduce
from typing import Any

import numpy as np

from ..lie import so3
from ..model.model import Model
from ..typing import Array
from .forward_kinematics import forward_kinematics
from .jacobians import frame_velocity, wrench_torques
from .recursion import zeros

_LEAST = 1e-300
"""m: what has a logarithm, where powers that are no halves are asked for."""


def largest(values: Iterable[Any]) -> Any:
    """The largest of some symbols."""
    return reduce(lambda a, b: a.clip(b, np.inf), values)


def pushed(depth: Any, sinking: Any, k: Any, n: float, c: Any) -> Any:
    """f = k dⁿ max(0, 1 + c d'), of one point; exactly 0 where d is not above 0."""
    inside = depth.clip(0.0, np.inf)
    power = inside**n if 2 * n == int(2 * n) else inside.sign() * depth.clip(_LEAST, np.inf) ** n
    return k * power * (1.0 + c * sinking).clip(0.0, np.inf)


def plane_contact(
    model: Model, q: Array, dq: Array, frame: str, exponent: float, points: Array, normal: Array, law: Array
) -> tuple[Array, Array]:
    """J'F of what a plane does to points (n, 3) of a frame, (nv,), and how deep each is inside, (n,).

    ``law`` is (height, k, c, μ, slip): along the plane a point at v is held back by μ f v / √(|v|² + slip²).
    """
    height, k, c, mu, slip = law
    T, V = forward_kinematics(model, q, frame), frame_velocity(model, q, dq, frame)
    R, n = T[:3, :3], normal
    F, depths = zeros(6), zeros(len(points))
    for i, p in enumerate(points):
        depths[i] = height - n @ (R @ p + T[:3, 3])
        v = R @ (V[3:] + so3.cross(V[:3], p))  # of the point, in the base frame
        sinking = -(n @ v)
        f = pushed(depths[i], sinking, k, exponent, c)
        slide = v + sinking * n
        held = mu * f / (slide @ slide + slip * slip).sqrt()
        force = R.T @ (f * n - held * slide)  # on the point, in the frame
        F = F + np.concatenate([so3.cross(p, force), force])
    return wrench_torques(model, q, F, frame), depths


def stop_contact(
    q: Array, dq: Array, places: Sequence[tuple[int, int]], exponent: float, lower: Array, upper: Array, law: Array
) -> tuple[Array, Array]:
    """What stops do to joints at ``places`` in q and in dq, (nv,), and how far each is beyond the nearer one, (m,).

    ``law`` is (k, c).
    """
    (k, c), tau, depths = law, zeros(len(dq)), zeros(len(places))
    for j, (i, v) in enumerate(places):
        over, under = q[i] - upper[j], lower[j] - q[i]
        tau[v] = pushed(under, -dq[v], k, exponent, c) - pushed(over, dq[v], k, exponent, c)
        depths[j] = largest([over, under])
    return tau, depths
