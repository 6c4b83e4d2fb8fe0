"""Samples of a motion as a curve: without jumps that are no motion, its derivatives, and configurations between samples."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..model.model import Model
from ..typing import Array
from .coordinates import Coordinates

if TYPE_CHECKING:
    from ..robot import Robot

DEGREE = 5
"""Of the spline."""
FEWEST = DEGREE + 1
"""Samples that velocities and accelerations can be derived from."""


class Between(NamedTuple):
    """Configurations between two samples, and where that is."""

    q: Array
    """(..., nq)."""
    before: Array
    after: Array
    """(...) numbers of the samples."""
    share: Array
    """(..., 1) of the way from one to the other, 0 to 1."""


def continuous(model: Model, q: Array) -> Array:
    """q (n, nq) without the jumps that are no motion: of angles by a turn, of quaternions to their negatives."""
    coordinates, q = Coordinates.of(model), q.astype(float)
    q[:, coordinates.endless] = np.unwrap(q[:, coordinates.endless], axis=0)
    for place in coordinates.quaternions:
        turned = np.einsum("ij,ij->i", q[1:, place], q[:-1, place]) < 0
        q[1:, place] *= np.where(np.cumsum(turned) % 2, -1.0, 1.0)[:, None]
    return q


def spline_rates(t: Array, x: Array) -> tuple[Array, Array]:
    """First and second derivatives at the samples of the quintic spline through them; (n,), (n, k) → (n, k) twice."""
    from scipy.interpolate import make_interp_spline

    # Time from the window's middle, so that large clock readings (seconds since 1970) cost no digits.
    local = t - t[len(t) // 2]
    spline = make_interp_spline(local, x, k=DEGREE)
    return spline(local, 1), spline(local, 2)


def between(robot: Robot, time: Array, q: Array, t: Array) -> Between:
    """Configurations at times t (...), along the constant joint twists that lead from one sample (n, nq) to the next."""
    k = np.clip(np.searchsorted(time, t, side="right") - 1, 0, max(0, len(time) - 2))
    after = np.minimum(k + 1, len(time) - 1)
    step = time[after] - time[k]
    share = np.clip((t - time[k]) / np.where(step > 0, step, 1.0), 0.0, 1.0)[..., None]
    way = robot.subtract(q[after], q[k])
    endless = [b.v_index for b in robot.model.leaders if b.joint.nv == 1 and b.joint.wraps]
    way[..., endless] -= 2 * np.pi * np.round(way[..., endless] / (2 * np.pi))  # a log may jump by a turn
    return Between(robot.add(q[k], share * way), k, after, share)
