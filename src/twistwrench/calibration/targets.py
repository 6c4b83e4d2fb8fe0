"""Kinds of measurement: residual of each reading, its derivative by the tip's twist, and the target's own unknowns.

The tip's point p moves with J_v, and its axes turn with J_ω. With the rotation R of the target's frame X, and unit vectors
u towards the tip and n normal to a plane, the derivatives are

    position R J_v,   pose R J_ω and R J_v,   distance u' J_v,   pair u' (J_v1 - J_v2),   plane n' J_v,   sphere u' J_v.
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
"""Least divisor [m] of a difference of points that becomes a unit vector."""
_MIN_EIGENVALUE_RATIO = 1e-2
"""Second smallest eigenvalue of the equations for the target's rotation, over the largest, below which many solutions fit."""


class ReadingRows(NamedTuple):
    """Residuals of readings and their derivatives."""

    residual: Array
    """(m, r) residuals [m, rad]."""
    columns: Array
    """(m, r, p) derivatives by the chain's parameters."""
    own: Array
    """(m, r, k) derivatives by the target's unknowns."""


class MeasuredTarget(ABC):
    """Unknowns of a measurement."""

    given: Measurements
    names: tuple[str, ...] = ()
    """Names of the target's unknowns."""
    angles: ClassVar[int] = 0
    """Number of rows of a reading in rad, which come first."""
    knows_length: ClassVar[bool] = True
    """True if the readings contain lengths."""

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
        """Rank of many different readings, in theory: independent parameters of the arm's shape, and the target's unknowns."""
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
    p = (places - points @ R.T).mean(axis=0)
    return np.asarray(se3.pose(R, p))


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
        rotations_of_base = given.rotations @ np.swapaxes(T[:, :3, :3], 1, 2)  # of each reading
        R = _nearest_rotation(rotations_of_base.sum(axis=0))
        return cls(given, np.asarray(se3.pose(R, (y - p @ R.T).mean(axis=0))))

    def rows(self, T: Array, J: Array) -> ReadingRows:
        """Errors of position, and of rotation log(X R R_measured')."""
        R = self.X[:3, :3]
        E = self.X @ T  # predicted poses of the tip in the target's frame
        p = E[:, :3, 3]
        position_error = p - self.given.points
        position_columns = R @ point_columns(T, J)
        unit = np.broadcast_to(np.eye(3), (len(T), 3, 3))
        position_own = np.concatenate([-so3.hat(p), unit], axis=2)  # twist of X: ω × p + v
        if self.given.kind == "position":
            return ReadingRows(position_error, position_columns, position_own)
        rotation_error = np.asarray(so3.log(E[:, :3, :3] @ np.swapaxes(self.given.rotations, 1, 2)))
        J_inverse = np.asarray(so3.left_jacobian_inverse(rotation_error))
        rotation_columns = J_inverse @ R @ J[:, :3]
        rotation_own = np.concatenate([J_inverse, np.zeros((len(T), 3, 3))], axis=2)
        return ReadingRows(
            np.concatenate([rotation_error, position_error], axis=1),
            np.concatenate([rotation_columns, position_columns], axis=1),
            np.concatenate([rotation_own, position_own], axis=1),
        )

    def step(self, x: Array) -> FrameTarget:
        """Frame turned and shifted by a twist."""
        return replace(self, X=np.asarray(se3.exp(x)) @ self.X)

    def freedom(self, turning: int, sliding: int) -> int:
        """Rank in theory; poses determine the three axes of the tip too."""
        tip_axes = 3 if self.given.kind == "pose" else 0
        return super().freedom(turning, sliding) + tip_axes

    def frame(self) -> Array:
        """Pose of the base in the tracker's frame."""
        return self.X


def turn_of_target(measured: Array, tip_rotations: Array) -> Array:
    """Rotation R (3, 3) of the target on the tip, from measured rotations M = X T R (n, 3, 3) and T (n, 3, 3) of the tip.

    X is any rotation. M R' = X T is linear in R' and X, which together are the null vector of A. The result is the identity
    if the rotations are about too few axes. Source: Shah, "Solving the robot-world/hand-eye calibration problem using the
    Kronecker product", J. Mechanisms and Robotics 5(3), 2013.
    """
    unit, A = np.eye(3), np.zeros((18, 18))
    for M, T in zip(measured, tip_rotations, strict=True):
        rows = np.c_[np.kron(M, unit), -np.kron(unit, T.T)]
        A += rows.T @ rows
    values, vectors = np.linalg.eigh(A)
    if values[1] < _MIN_EIGENVALUE_RATIO * values[-1]:
        return unit
    inverse = vectors[:9, 0].reshape(3, 3)  # R' times an unknown factor, of either sign
    return _nearest_rotation(inverse * np.sign(np.linalg.det(inverse))).T


@dataclass(frozen=True, eq=False)
class CentreTarget(MeasuredTarget):
    """Fixed end of a ball bar or of a string."""

    given: Measurements
    centre: Array
    names: tuple[str, ...] = LENGTHS

    @classmethod
    def from_tips(cls, given: Measurements, T: Array) -> CentreTarget:
        """Centre c by trilateration: |p - c|² = d² is linear in c and |c|², 2 p' c - |c|² = |p|² - d²."""
        p = T[:, :3, 3]
        A = np.c_[2.0 * p, np.ones(len(p))]
        solution = np.linalg.lstsq(A, (p**2).sum(axis=1) - given.sizes**2, rcond=None)[0]
        return cls(given, solution[:3])

    def rows(self, T: Array, J: Array) -> ReadingRows:
        """Distance of the tip from the centre, less the reading."""
        distance, u = _distances_and_directions(T[:, :3, 3] - self.centre)
        return ReadingRows((distance - self.given.sizes)[:, None], u @ point_columns(T, J), -u)

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
        first, second = np.asarray(self.given.pairs).T  # indices of the poses of each pair
        linear, p = point_columns(T, J), T[:, :3, 3]
        distance, u = _distances_and_directions(p[first] - p[second])
        no_unknowns = np.zeros((len(u), 1, 0))
        return ReadingRows((distance - self.given.sizes)[:, None], u @ (linear[first] - linear[second]), no_unknowns)


def _distances_and_directions(differences: Array) -> tuple[Array, Array]:
    """Lengths (m,) of differences (m, 3) of points, and their unit vectors as rows (m, 1, 3)."""
    distances = np.linalg.norm(differences, axis=1)
    return distances, (differences / np.maximum(distances, _MIN_DISTANCE)[:, None])[:, None]


@dataclass(frozen=True, eq=False)
class TouchTarget(MeasuredTarget):
    """Points, planes or spheres that the tip touches."""

    given: Measurements
    x: Array
    """(targets, unknowns) values of the unknowns."""
    names: tuple[str, ...] = ()
    words: ClassVar[tuple[str, ...]] = ()
    """Names of the unknowns of one target."""
    knows_length: ClassVar[bool] = False

    @classmethod
    def from_tips(cls, given: Measurements, T: Array) -> TouchTarget:
        """Each target by a linear fit."""
        labels = given.target_names
        x = np.array([cls.start(T[given.target_index == k, :3, 3]) for k in range(len(labels))])
        if len(labels) == 1:
            return cls(given, x, cls.words)
        return cls(given, x, tuple(f"{label}.{word}" for label in labels for word in cls.words))

    @staticmethod
    @abstractmethod
    def start(p: Array) -> Array:
        """Unknowns of one target from touched points (m, 3)."""

    def spread(self, own: Array) -> Array:
        """Derivatives (m, r, k) by the unknowns of all targets, from those by the unknowns of each reading's target."""
        target_count, unknown_count = self.x.shape
        by_targets = np.zeros((*own.shape[:2], target_count, unknown_count))
        by_targets[np.arange(len(own)), :, self.given.target_index] = own
        return by_targets.reshape(*own.shape[:2], -1)

    def step(self, x: Array) -> TouchTarget:
        """Targets moved by x."""
        return replace(self, x=self.x + x.reshape(self.x.shape))

    def freedom(self, turning: int, sliding: int) -> int:
        """Rank in theory; without a known length, touches leave the scale open."""
        is_scale_open = self.given.length is None
        return super().freedom(turning, sliding) - int(is_scale_open)


class PointTarget(TouchTarget):
    """Points."""

    words = LENGTHS

    @staticmethod
    def start(p: Array) -> Array:
        """Mean of the touched points."""
        return np.asarray(p.mean(axis=0))

    def rows(self, T: Array, J: Array) -> ReadingRows:
        """Position of the tip less its point."""
        own = np.broadcast_to(-np.eye(3), (len(T), 3, 3))
        return ReadingRows(T[:, :3, 3] - self.x[self.given.target_index], point_columns(T, J), self.spread(own))

    def length_row(self, _T: Array, J: Array) -> tuple[float, Array, Array] | None:
        """Distance of the first two points, less the known length."""
        if self.given.length is None:
            return None
        difference = self.x[0] - self.x[1]
        distance = float(np.linalg.norm(difference))
        u = difference / max(distance, _MIN_DISTANCE)
        other_targets = np.zeros(self.x.size - 6)
        return distance - self.given.length, np.zeros(J.shape[2]), np.concatenate([u, -u, other_targets])


class PlaneTarget(TouchTarget):
    """Planes n' p = d; the unknowns are x and y of the rotation vector that turns the z axis to n, and d."""

    words = ("nx", "ny", "d")

    @staticmethod
    def start(p: Array) -> Array:
        """Rotation vector of the normal from z, and distance."""
        centre = p.mean(axis=0)
        _, _, directions = np.linalg.svd(p - centre)
        n = directions[2]  # in which the points vary least
        if n @ centre < 0:
            n = -n
        axis = np.asarray(so3.cross([0.0, 0.0, 1.0], n))
        sine = float(np.linalg.norm(axis))
        unit_axis = np.array([1.0, 0.0, 0.0])  # of any half turn, if n is along z
        if sine > 1e-12:
            unit_axis = axis / sine
        rotation = np.arctan2(sine, n[2]) * unit_axis
        return np.array([*rotation[:2], n @ centre])

    def normals(self) -> tuple[Array, Array]:
        """Unit normals (targets, 3), and their derivatives (targets, 3, 2) by the two components of the rotation."""
        w = np.c_[self.x[:, :2], np.zeros(len(self.x))]
        n = np.asarray(so3.exp(w))[:, :, 2]
        return n, (-so3.hat(n) @ so3.left_jacobian(w))[:, :, :2]

    def rows(self, T: Array, J: Array) -> ReadingRows:
        """Height of the tip above its plane."""
        plane, p = self.given.target_index, T[:, :3, 3]
        n, n_by_rotation = self.normals()
        height_by_rotation = np.einsum("ni,nij->nj", p, n_by_rotation[plane])
        own = np.concatenate([height_by_rotation, -np.ones((len(p), 1))], axis=1)
        height = (p * n[plane]).sum(axis=1) - self.x[plane, 2]
        return ReadingRows(height[:, None], n[plane][:, None] @ point_columns(T, J), self.spread(own[:, None]))

    def length_row(self, T: Array, J: Array) -> tuple[float, Array, Array] | None:
        """Mean distance of the second plane's touched points from the first plane, less the known length."""
        if self.given.length is None:
            return None
        is_second = self.given.target_index == 1
        centre = T[is_second, :3, 3].mean(axis=0)
        centre_columns = point_columns(T[is_second], J[is_second]).mean(axis=0)
        n, n_by_rotation = self.normals()
        height = float(n[0] @ centre - self.x[0, 2])
        sign = 1.0 if height > 0 else -1.0
        own = np.zeros(self.x.size)
        own[:3] = [*(centre @ n_by_rotation[0]), -1.0]
        return abs(height) - self.given.length, sign * (n[0] @ centre_columns), sign * own


class SphereTarget(TouchTarget):
    """Spheres with unknown radius."""

    words = (*LENGTHS, "radius")

    @staticmethod
    def start(p: Array) -> Array:
        """Centre c and radius r of the sphere through the points: 2 p' c + (r² - |c|²) = |p|²."""
        A = np.c_[2.0 * p, np.ones(len(p))]
        solution = np.linalg.lstsq(A, (p**2).sum(axis=1), rcond=None)[0]
        centre = solution[:3]
        squared_radius = solution[3] + centre @ centre
        return np.array([*centre, np.sqrt(max(squared_radius, 1e-6))])

    def rows(self, T: Array, J: Array) -> ReadingRows:
        """Distance of the tip from the centre of its sphere, less the radius."""
        x = self.x[self.given.target_index]
        distance, u = _distances_and_directions(T[:, :3, 3] - x[:, :3])
        own = np.concatenate([-u, -np.ones((len(u), 1, 1))], axis=2)
        return ReadingRows((distance - x[:, 3])[:, None], u @ point_columns(T, J), self.spread(own))

    def length_row(self, _T: Array, J: Array) -> tuple[float, Array, Array] | None:
        """Diameter of the first sphere, less the known length."""
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
