"""Kinds of measurement: residual of each reading, its derivative by the tip's twist, and the target's own unknowns.

The tip's point p moves with J_v, its axes turn with J_ω. With the target's frame X, R its rotation, and unit vectors u, n:
a position gives R J_v, a pose R J_ω too, a distance u' J_v, a pair u' (J_v1 - J_v2), a plane n' J_v, a sphere u' J_v.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple

import numpy as np

from ..core.typing import Array
from ..mechanics.lie import se3, so3
from .chain import ANGLES, LENGTHS, point_columns
from .measurements import Measurements

_MIN_DISTANCE = 1e-9
"""Least distance [m] by which a direction is divided."""
_SAME_TURN = 1e-2
"""Second eigenvalue of the turn's equations, as a share of the largest, below which several turns explain the rotations."""


class ReadingRows(NamedTuple):
    """Residuals of readings and their derivatives."""

    residual: Array
    """(m, r) in m and rad."""
    columns: Array
    """(m, r, p) derivatives by the chain's parameters."""
    own: Array
    """(m, r, k) derivatives by the target's unknowns."""


class MeasuredTarget(ABC):
    """Unknowns of a measurement."""

    given: Measurements
    names: tuple[str, ...] = ()
    angles: ClassVar[int] = 0
    """Number of rows of a reading in rad, which come first."""
    knows_length: ClassVar[bool] = True

    @abstractmethod
    def rows(self, T: Array, J: Array) -> ReadingRows:
        """Residuals for poses T (N, 4, 4) of the tip with twist columns J (N, 6, p)."""

    def step(self, _x: Array) -> MeasuredTarget:
        """Target after a step of its unknowns."""
        return self

    def length_row(self, _T: Array, _J: Array) -> tuple[float, Array, Array] | None:
        """Residual of the known length and its derivatives (p,), (k,); None without one."""
        return None

    def freedom(self, turning: int, sliding: int) -> int:
        """Rank of many different readings, in theory: shape of the arm, then place of the target."""
        return 4 * turning + 2 * sliding - 3 + len(self.names)

    def frame(self) -> Array:
        """(4, 4) pose of the base in the target's frame, or of its centre in the base."""
        return np.eye(4)


def _nearest_rotation(M: Array) -> Array:
    """Rotation R with the largest trace of R' M."""
    U, _, V = np.linalg.svd(M)
    return np.asarray(U @ np.diag([1.0, 1.0, np.linalg.det(U @ V)]) @ V)


def rigid_motion(points: Array, places: Array) -> Array:
    """Pose (4, 4) that brings points (n, 3) nearest to places (n, 3). Source: Kabsch, Acta Cryst. A32, 1976."""
    R = _nearest_rotation((places - places.mean(0)).T @ (points - points.mean(0)))
    return np.asarray(se3.pose(R, (places - points @ R.T).mean(axis=0)))


@dataclass(frozen=True, eq=False)
class FrameTarget(MeasuredTarget):
    """Tracker or camera with the pose X of the base in its frame."""

    given: Measurements
    X: Array
    names: tuple[str, ...] = (*ANGLES, *LENGTHS)

    @classmethod
    def from_tips(cls, given: Measurements, T: Array) -> FrameTarget:
        """Frame for poses T of the tip: by rotations, or by points (Kabsch)."""
        p, y = T[:, :3, 3], given.points
        if given.kind == "position":
            return cls(given, rigid_motion(p, y))
        R = _nearest_rotation((given.rotations @ np.swapaxes(T[:, :3, :3], 1, 2)).sum(axis=0))
        return cls(given, np.asarray(se3.pose(R, (y - p @ R.T).mean(axis=0))))

    def rows(self, T: Array, J: Array) -> ReadingRows:
        """Errors of position, and of rotation log(X R R_measured')."""
        R = self.X[:3, :3]
        E = self.X @ T
        p, linear = E[:, :3, 3], R @ point_columns(T, J)
        unit = np.broadcast_to(np.eye(3), (len(T), 3, 3))
        own = np.concatenate([-so3.hat(p), unit], axis=2)
        if self.given.kind == "position":
            return ReadingRows(p - self.given.points, linear, own)
        turn = np.asarray(so3.log(E[:, :3, :3] @ np.swapaxes(self.given.rotations, 1, 2)))
        bend = np.asarray(so3.left_jacobian_inverse(turn))
        turned = np.concatenate([bend, np.zeros((len(T), 3, 3))], axis=2)
        return ReadingRows(
            np.concatenate([turn, p - self.given.points], axis=1),
            np.concatenate([bend @ R @ J[:, :3], linear], axis=1),
            np.concatenate([turned, own], axis=1),
        )

    def step(self, x: Array) -> FrameTarget:
        """Frame turned and shifted by a twist."""
        return replace(self, X=np.asarray(se3.exp(x)) @ self.X)

    def freedom(self, turning: int, sliding: int) -> int:
        """A pose sees the tip's axes too."""
        return super().freedom(turning, sliding) + (3 if self.given.kind == "pose" else 0)

    def frame(self) -> Array:
        """Pose of the base in the tracker's frame."""
        return self.X


def turn_of_target(measured: Array, turned: Array) -> Array:
    """Rotation R (3, 3) of the target on the tip, from rotations M = X T R (n, 3, 3) measured and T of the tip, any X.

    M R' = X T is linear in R' and X. The identity if the rotations are about too few axes. Source: Shah, "Solving the
    robot-world/hand-eye calibration problem using the Kronecker product", J. Mechanisms and Robotics 5(3), 2013.
    """
    unit, A = np.eye(3), np.zeros((18, 18))
    for M, T in zip(measured, turned, strict=True):
        rows = np.c_[np.kron(M, unit), -np.kron(unit, T.T)]
        A += rows.T @ rows
    values, vectors = np.linalg.eigh(A)
    if values[1] < _SAME_TURN * values[-1]:
        return unit
    inverse = vectors[:9, 0].reshape(3, 3)
    return _nearest_rotation(inverse * np.sign(np.linalg.det(inverse))).T


@dataclass(frozen=True, eq=False)
class CentreTarget(MeasuredTarget):
    """Fixed end of a ball bar or of a string."""

    given: Measurements
    centre: Array
    names: tuple[str, ...] = LENGTHS

    @classmethod
    def from_tips(cls, given: Measurements, T: Array) -> CentreTarget:
        """Centre by trilateration."""
        p = T[:, :3, 3]
        A = np.c_[2.0 * p, np.ones(len(p))]
        found = np.linalg.lstsq(A, (p**2).sum(axis=1) - given.sizes**2, rcond=None)[0]
        return cls(given, found[:3])

    def rows(self, T: Array, J: Array) -> ReadingRows:
        """Distance of the tip from the centre, less the reading."""
        away = T[:, :3, 3] - self.centre
        far = np.linalg.norm(away, axis=1)
        u = (away / np.maximum(far, _MIN_DISTANCE)[:, None])[:, None]
        return ReadingRows((far - self.given.sizes)[:, None], u @ point_columns(T, J), -u)

    def step(self, x: Array) -> CentreTarget:
        """Centre moved by x."""
        return replace(self, centre=self.centre + x)

    def frame(self) -> Array:
        """Pose at the centre."""
        return np.asarray(se3.pose(np.eye(3), self.centre))


@dataclass(frozen=True, eq=False)
class PairTarget(MeasuredTarget):
    """Distance between the tips of two poses; it has no unknowns."""

    given: Measurements

    @classmethod
    def from_tips(cls, given: Measurements, _T: Array) -> PairTarget:
        """Nothing is estimated."""
        return cls(given)

    def rows(self, T: Array, J: Array) -> ReadingRows:
        """Distance between the two tips, less the reading."""
        first, second = np.asarray(self.given.pairs).T
        linear, p = point_columns(T, J), T[:, :3, 3]
        between = p[first] - p[second]
        far = np.linalg.norm(between, axis=1)
        u = (between / np.maximum(far, _MIN_DISTANCE)[:, None])[:, None]
        return ReadingRows(
            (far - self.given.sizes)[:, None], u @ (linear[first] - linear[second]), np.zeros((len(u), 1, 0))
        )


@dataclass(frozen=True, eq=False)
class TouchTarget(MeasuredTarget):
    """Points, planes or spheres that the tip touches: rows x (targets, unknowns)."""

    given: Measurements
    x: Array
    names: tuple[str, ...] = ()
    words: ClassVar[tuple[str, ...]] = ()
    knows_length: ClassVar[bool] = False

    @classmethod
    def from_tips(cls, given: Measurements, T: Array) -> TouchTarget:
        """Each target by a linear fit."""
        labels, place = given.target_names, given.target_index
        x = np.array([cls.start(T[place == k, :3, 3]) for k in range(len(labels))])
        one = len(labels) == 1
        return cls(given, x, tuple(word if one else f"{label}.{word}" for label in labels for word in cls.words))

    @staticmethod
    @abstractmethod
    def start(p: Array) -> Array:
        """Unknowns of one target from touched points (m, 3)."""

    def spread(self, own: Array) -> Array:
        """Derivatives (m, r, k) by all targets from those by each reading's own."""
        count, size = self.x.shape
        found = np.zeros((*own.shape[:2], count, size))
        found[np.arange(len(own)), :, self.given.target_index] = own
        return found.reshape(*own.shape[:2], -1)

    def step(self, x: Array) -> TouchTarget:
        """Targets moved by x."""
        return replace(self, x=self.x + x.reshape(self.x.shape))

    def freedom(self, turning: int, sliding: int) -> int:
        """Touches alone contain no length: one fewer."""
        return super().freedom(turning, sliding) - (self.given.length is None)


class PointTarget(TouchTarget):
    """Points."""

    words = LENGTHS

    @staticmethod
    def start(p: Array) -> Array:
        """Mean of the touched points."""
        return np.asarray(p.mean(axis=0))

    def rows(self, T: Array, J: Array) -> ReadingRows:
        """Tip less its point."""
        own = np.broadcast_to(-np.eye(3), (len(T), 3, 3))
        return ReadingRows(T[:, :3, 3] - self.x[self.given.target_index], point_columns(T, J), self.spread(own))

    def length_row(self, _T: Array, J: Array) -> tuple[float, Array, Array] | None:
        """Distance of the first two points."""
        if self.given.length is None:
            return None
        between = self.x[0] - self.x[1]
        far = float(np.linalg.norm(between))
        u = between / max(far, _MIN_DISTANCE)
        return far - self.given.length, np.zeros(J.shape[2]), np.concatenate([u, -u, np.zeros(self.x.size - 6)])


class PlaneTarget(TouchTarget):
    """Planes n' p = d, by d n' and two turns of n: the unknowns are a and b about the start's axes, and d."""

    words = ("nx", "ny", "d")

    @staticmethod
    def start(p: Array) -> Array:
        """Rotation vector of the normal from z, and distance."""
        centre = p.mean(axis=0)
        n = np.linalg.svd(p - centre)[2][2]
        n = n if n @ centre >= 0 else -n
        axis = np.asarray(so3.cross([0.0, 0.0, 1.0], n))
        size = float(np.linalg.norm(axis))
        turn = np.arctan2(size, n[2]) * (axis / size if size > 1e-12 else np.array([1.0, 0.0, 0.0]))
        return np.array([*turn[:2], n @ centre])

    def normals(self) -> tuple[Array, Array]:
        """Unit normals (targets, 3), and their derivatives (targets, 3, 2) by the two turns."""
        w = np.c_[self.x[:, :2], np.zeros(len(self.x))]
        n = np.asarray(so3.exp(w))[:, :, 2]
        return n, (-so3.hat(n) @ so3.left_jacobian(w))[:, :, :2]

    def rows(self, T: Array, J: Array) -> ReadingRows:
        """Height of the tip above its plane."""
        place, p = self.given.target_index, T[:, :3, 3]
        n, turned = self.normals()
        own = np.concatenate([np.einsum("ni,nij->nj", p, turned[place]), -np.ones((len(p), 1))], axis=1)
        height = (p * n[place]).sum(axis=1) - self.x[place, 2]
        return ReadingRows(height[:, None], n[place][:, None] @ point_columns(T, J), self.spread(own[:, None]))

    def length_row(self, T: Array, J: Array) -> tuple[float, Array, Array] | None:
        """Distance of the second plane's touched points, on average, from the first plane."""
        if self.given.length is None:
            return None
        second = self.given.target_index == 1
        centre, moving = T[second, :3, 3].mean(axis=0), point_columns(T[second], J[second]).mean(axis=0)
        n, turned = self.normals()
        height = float(n[0] @ centre - self.x[0, 2])
        sign = 1.0 if height > 0 else -1.0
        own = np.zeros(self.x.size)
        own[:3] = [*(centre @ turned[0]), -1.0]
        return abs(height) - self.given.length, sign * (n[0] @ moving), sign * own


class SphereTarget(TouchTarget):
    """Spheres with unknown radius."""

    words = (*LENGTHS, "radius")

    @staticmethod
    def start(p: Array) -> Array:
        """Centre and radius of the sphere through the points."""
        A = np.c_[2.0 * p, np.ones(len(p))]
        found = np.linalg.lstsq(A, (p**2).sum(axis=1), rcond=None)[0]
        return np.array([*found[:3], np.sqrt(max(found[3] + found[:3] @ found[:3], 1e-6))])

    def rows(self, T: Array, J: Array) -> ReadingRows:
        """Distance of the tip from its centre, less the radius."""
        x = self.x[self.given.target_index]
        away = T[:, :3, 3] - x[:, :3]
        far = np.linalg.norm(away, axis=1)
        u = (away / np.maximum(far, _MIN_DISTANCE)[:, None])[:, None]
        own = np.concatenate([-u, -np.ones((len(u), 1, 1))], axis=2)
        return ReadingRows((far - x[:, 3])[:, None], u @ point_columns(T, J), self.spread(own))

    def length_row(self, _T: Array, J: Array) -> tuple[float, Array, Array] | None:
        """Diameter of the first sphere."""
        if self.given.length is None:
            return None
        own = np.zeros(self.x.size)
        own[3] = 2.0
        return float(2.0 * self.x[0, 3] - self.given.length), np.zeros(J.shape[2]), own


TARGETS: dict[str, type[FrameTarget | CentreTarget | PairTarget | TouchTarget]] = {
    "pose": FrameTarget,
    "position": FrameTarget,
    "distance": CentreTarget,
    "pair": PairTarget,
    "point": PointTarget,
    "plane": PlaneTarget,
    "sphere": SphereTarget,
}
"""Target of each kind of measurement."""


def targets_from_tips(measured: Sequence[Measurements], tips: Sequence[Array]) -> list[MeasuredTarget]:
    """First estimate of each measurement's target for the poses of the tip."""
    return [TARGETS[str(m.kind)].from_tips(m, T) for m, T in zip(measured, tips, strict=True)]
