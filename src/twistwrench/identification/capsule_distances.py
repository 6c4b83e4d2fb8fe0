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

_STEP = 1e-6
_SAMPLES = 500
_ALWAYS = 0.95
"""Share of random configurations, from which on a pair of capsules overlaps by how the robot is built."""
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
    above : (k,) array, capsules whose heights change
    floor : float or None, height [m]
    overlapping : tuple of pairs of str, links whose capsules overlap by how the robot is built, and that are not looked at
    """

    robot: Robot
    capsules: LinkCapsules
    pairs: Array
    above: Array
    floor: float | None
    overlapping: tuple[tuple[str, str], ...] = ()

    @classmethod
    def of(cls, robot: Robot, capsules: LinkCapsules, *, floor: float | None, itself: bool) -> CapsuleRoom:
        """The pairs that can touch: of links that no joint connects, and that do not overlap always.

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
        built = (every.distances(q) <= 0).mean(axis=0) >= _ALWAYS
        heights = capsules.placed(robot.link_poses(q))[:, 2].min(axis=0)
        moves = np.flatnonzero((np.ptp(heights, axis=0) > _STILL) & (floor is not None))
        over = sorted({(names[capsules.links[a]], names[capsules.links[b]]) for a, b in pairs[built]})
        return cls(robot, capsules, pairs[~built], moves, floor, tuple(over))

    @property
    def unwatched(self) -> tuple[str, ...]:
        """What is not looked at, in sentences."""
        found = list[str]()
        if self.capsules.bare:
            found.append(
                f"no shape is known of {', '.join(self.capsules.bare)}: of them only the origins stay above the floor"
            )
        found += [f"capsules around {a} and {b} overlap wherever the joints are" for a, b in self.overlapping]
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
        middle, r = ends.mean(axis=0), self.capsules.radii
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
        of_heights = np.stack([weights[:, m : m + k], weights[:, m + k :]])
        for c, step in enumerate(_STEP * np.eye(q.shape[1])):
            ahead, behind = (self.capsules.placed(self.robot.link_poses(q + sign * step)) for sign in (1, -1))
            moved = (ahead - behind) / (2.0 * _STEP)
            found[rows, c] = _dot(n, _between(moved[..., i], moved[..., j], s, t)).sum(axis=1)
            found[rows, c] += (of_heights * moved[:, 2][..., self.above]).sum(axis=(0, 2))
        return found
