"""Distances between capsules that move, and their slopes by the joints.

Of segments p + s d and q + t e, s and t from 0 to 1, the nearest points are those of the lines where these are within, else one
of them is an end. What is left when the joints move is n · (dp_B - dp_A), with n from A to B and the nearest points fixed to
their links: nearest points slide along the segments, and that changes the distance in second order only.

Source: Ericson, "Real-Time Collision Detection", 2005, 5.1.9.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..model.model import BASE
from ..robot import Robot
from ..typing import Array
from .link_capsules import LinkCapsules

MARGIN = 0.02
"""m: what capsules stay away from each other and from the floor."""
_SAMPLES = 200
_ALWAYS = 0.95
"""Share of random configurations from which on a pair of capsules, or one and the floor, is near by how the robot is built."""
_STILL = 1e-9
_POINT = 1e-14
"""m²: segments that are points."""
_PARALLEL = 1e-12


def nearest_points(a: Array, b: Array) -> tuple[Array, Array]:
    """Where segments come nearest to each other, as shares of their lengths.

    Parameters
    ----------
    a, b : (2, 3, ...) arrays, ends

    Returns
    -------
    s, t : (...) arrays, from 0 to 1

    Examples
    --------
    >>> s, t = nearest_points(np.array([[0, 0, 0], [2, 0, 0.0]]), np.array([[1, 1, 0], [1, 3, 0.0]]))
    >>> float(s), float(t)
    (0.5, 0.0)
    """
    d, e, r = a[1] - a[0], b[1] - b[0], a[0] - b[0]
    dd, ee, de, dr, er = _dot(d, d), _dot(e, e), _dot(d, e), _dot(d, r), _dot(e, r)
    det = dd * ee - de**2
    with np.errstate(divide="ignore", invalid="ignore"):
        s = np.where(det > _PARALLEL * dd * ee, np.clip((de * er - dr * ee) / det, 0.0, 1.0), 0.0)
        t = np.where(ee > _POINT, np.clip((de * s + er) / ee, 0.0, 1.0), 0.0)
        s = np.where(dd > _POINT, np.clip((de * t - dr) / dd, 0.0, 1.0), 0.0)
    return s, t


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


def _between(a: Array, b: Array, s: Array, t: Array) -> Array:
    """From the points at s of segments a to those at t of b, (3, ...)."""
    return np.asarray(b[0] + t * (b[1] - b[0]) - a[0] - s * (a[1] - a[0]))


@dataclass(frozen=True, eq=False)
class CapsuleRoom:
    """Distances of a robot's capsules from each other and from the floor.

    Attributes
    ----------
    robot : Robot
    capsules : LinkCapsules
    pairs : (m, 2) array, capsules that are looked at together
    above : (k,) array, capsules that are looked at together with the floor: those whose heights change
    floor : float or None, height [m]
    overlapping : tuple of pairs of str, links whose capsules are too near by how the robot is built, and that are not looked at
    itself : bool, whether links are looked at together
    margins : (m,) array, what pairs stay away from each other [m]; None: MARGIN
    low : tuple of str, links fixed at a height that are not looked at, as the floor is too near wherever the joints are
    """

    robot: Robot
    capsules: LinkCapsules
    pairs: Array
    above: Array
    floor: float | None
    overlapping: tuple[tuple[str, str], ...] = ()
    itself: bool = True
    low: tuple[str, ...] = ()
    margins: Array | None = None

    @classmethod
    def of(cls, robot: Robot, capsules: LinkCapsules, *, floor: float | None, itself: bool) -> CapsuleRoom:
        """The pairs that can touch: of links that no joint connects, and that are not always near each other.

        The capsules of a link whose origin stays at one height, and that are always near the floor, are left out likewise.

        Parameters
        ----------
        robot : Robot
        capsules : LinkCapsules
        floor : float or None, height [m]
        itself : bool, whether links are kept clear of each other

        Returns
        -------
        room : CapsuleRoom
        """
        names = robot.link_names
        bodies = np.array([robot.model.frames[names[k]].body for k in capsules.links], int)
        parents = np.array([BASE if b == BASE else robot.model.bodies[b].parent for b in bodies], int)
        i, j = np.triu_indices(len(bodies), 1) if itself else (np.zeros(0, int), np.zeros(0, int))
        apart = (bodies[i] != bodies[j]) & (parents[i] != bodies[j]) & (parents[j] != bodies[i])
        apart &= (capsules.radii[i] > 0) & (capsules.radii[j] > 0)
        pairs = np.stack([i, j], axis=1)[apart]
        q = robot.random_configuration(0, _SAMPLES)
        every = cls(robot, capsules, pairs, np.zeros(0, int), None)
        apart = every.distances(q)
        near = (apart < MARGIN).mean(axis=0) >= _ALWAYS
        built = near if capsules.assumed else (apart <= 0.0).mean(axis=0) >= _ALWAYS
        margins = np.where(near, 0.0, MARGIN)[~built]  # true shapes that are near by design must not touch
        poses = robot.link_poses(q)
        heights = capsules.placed(poses)[:, 2].min(axis=0)
        above, low = np.zeros(0, int), np.zeros(0, int)
        if floor is not None:
            moves = np.ptp(heights, axis=0) > _STILL
            fixed = np.ptp(poses[:, capsules.links, 2, 3], axis=0) <= _STILL
            near = (heights - capsules.radii - floor < MARGIN).mean(axis=0) >= _ALWAYS
            moving = bodies != BASE
            above, low = np.flatnonzero(moves & ~(fixed & near)), np.flatnonzero(moving & fixed & near)
        over = sorted({(names[capsules.links[a]], names[capsules.links[b]]) for a, b in pairs[built]})
        under = tuple(dict.fromkeys(names[capsules.links[k]] for k in low))
        return cls(robot, capsules, pairs[~built], above, floor, tuple(over), itself, under, margins)

    @property
    def unwatched(self) -> tuple[str, ...]:
        """What is not looked at, in sentences."""
        found = [
            f"capsules around {a} and {b} are near each other wherever the joints are" for a, b in self.overlapping
        ]
        if self.low:
            found.append(f"the floor is too near {', '.join(self.low)} wherever the joints are, at a fixed height")
        return tuple(found)

    @property
    def count(self) -> int:
        """How many distances there are: m + 2 k."""
        return len(self.pairs) + 2 * len(self.above)

    def distances(self, q: Array, near: float = np.inf) -> Array:
        """(n, m + 2 k) distances of the pairs, and of the ends above the floor [m]; below 0 where capsules overlap.

        Parameters
        ----------
        q : (n, nq) array
        near : float, beyond which a bound from below will do [m]

        Returns
        -------
        distances : (n, m + 2 k) array
        """
        ends = self.capsules.placed(self.robot.link_poses(q))
        i, j = self.pairs.T
        middle, r = 0.5 * (ends[0] + ends[1]), self.capsules.radii
        half = r + 0.5 * np.linalg.norm(self.capsules.ends[:, 1] - self.capsules.ends[:, 0], axis=1)
        d = middle[..., j] - middle[..., i]
        found = np.sqrt(_dot(d, d)) - half[i] - half[j]
        rows, which = np.nonzero(found < near)
        a, b = ends[:, :, rows, i[which]], ends[:, :, rows, j[which]]
        d = _between(a, b, *nearest_points(a, b))
        found[rows, which] = np.sqrt(_dot(d, d)) - r[i[which]] - r[j[which]]
        if self.floor is None:
            return np.asarray(found)
        heights = ends[:, 2][..., self.above] - r[self.above] - self.floor
        return np.concatenate([found, *heights], axis=1)

    def slopes(self, q: Array, weights: Array) -> Array:
        """Derivative by the joints of a weighted sum of the distances.

        Parameters
        ----------
        q : (n, nq) array, of joints of one degree of freedom
        weights : (n, m + 2 k) array

        Returns
        -------
        slopes : (n, nq) array
        """
        found = np.zeros(q.shape)
        rows = np.flatnonzero(weights.any(axis=1))
        if not rows.size:
            return found
        q, weights = q[rows], weights[rows]
        m, k = len(self.pairs), len(self.above)
        used = np.flatnonzero(weights[:, :m].any(axis=0))
        i, j = self.pairs[used].T
        ends = self.capsules.placed(self.robot.link_poses(q))
        a, b = ends[..., i], ends[..., j]
        s, t = nearest_points(a, b)
        n = _between(a, b, s, t)
        n *= weights[:, used] / np.maximum(np.sqrt(_dot(n, n)), 1e-12)
        along_z = np.zeros((2, 3, len(q), k))
        along_z[0, 2], along_z[1, 2] = weights[:, m : m + k], weights[:, m + k :]
        points = np.concatenate([a[0] + s * (a[1] - a[0]), b[0] + t * (b[1] - b[0]), *ends[..., self.above]], axis=2)
        forces = np.concatenate([-n, n, *along_z], axis=2)
        wrenches = np.concatenate([np.cross(points, forces, axis=0), forces])  # about the base's origin, (6, n, points)
        links = self.capsules.links[np.concatenate([i, j, self.above, self.above])]
        for link in np.unique(links):
            total = wrenches[:, :, links == link].sum(axis=2)
            J = self.robot.jacobian(q, frame=self.robot.link_names[link], kind="space")
            found[rows] += np.einsum("niv,in->nv", J, total)
        return found
