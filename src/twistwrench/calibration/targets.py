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
    """Residuals of m readings with r rows each, and their derivatives."""

    residual: Array
    """(m, r) residuals [m, rad]."""
    columns: Array
    """(m, r, p) derivatives of the residuals by the chain's parameters."""
    own: Array
    """(m, r, k) derivatives of the residuals by the target's own unknowns."""


class MeasuredTarget(ABC):
    """Unknowns of a measurement."""

    given: Measurements
    """Readings and the configurations of the robot."""
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
        """Target after a step of its unknowns; the target itself if it has none."""
        return self

    def length_row(self, _T: Array, _J: Array) -> tuple[float, Array, Array] | None:
        """Residual of the known length [m], and its derivatives (p,) and (k,); None without a known length."""
        return None

    def freedom(self, turning: int, sliding: int) -> int:
        """Rank of many different readings, in theory: independent parameters of the arm's shape, and the target's unknowns.

        ``turning`` and ``sliding`` are numbers of joints.
        """
        return 4 * turning + 2 * sliding - 3 + len(self.names)

    def frame(self) -> Array:
        """(4, 4) pose of the base in the target's frame, or of the target's centre in the base; the identity by default."""
        return np.eye(4)


def _nearest_rotation(M: Array) -> Array:
    """Rotation R with the largest trace of R' M."""
    U, _, V = np.linalg.svd(M)
    determinant = np.linalg.det(U @ V)  # -1 if U V mirrors; then the least singular direction is reversed
    return np.asarray(U @ np.diag([1.0, 1.0, determinant]) @ V)


def rigid_motion(points: Array, places: Array) -> Array:
    """Pose (4, 4) that brings points (n, 3) nearest to places (n, 3). Source: Kabsch, Acta Cryst. A32, 1976."""
    centred_places = places - places.mean(0)
    centred_points = points - points.mean(0)
    covariance = centred_places.T @ centred_points
    R = _nearest_rotation(covariance)
    p = (places - points @ R.T).mean(axis=0)
    return np.asarray(se3.pose(R, p))


@dataclass(frozen=True, eq=False)
class FrameTarget(MeasuredTarget):
    """Frame of a tracker or camera."""

    given: Measurements
    X: Array
    """(4, 4) pose of the base in the frame."""
    names: tuple[str, ...] = (*ANGLES, *LENGTHS)

    @classmethod
    def from_tips(cls, given: Measurements, T: Array) -> FrameTarget:
        """Frame for poses T of the tip: by rotations if they are measured, else by points (Kabsch)."""
        p = T[:, :3, 3]
        if given.kind == "position":
            return cls(given, rigid_motion(p, given.points))
        rotations_of_base = given.rotations @ np.swapaxes(T[:, :3, :3], 1, 2)  # by each reading
        R = _nearest_rotation(rotations_of_base.sum(axis=0))
        position_of_base = (given.points - p @ R.T).mean(axis=0)
        return cls(given, np.asarray(se3.pose(R, position_of_base)))

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
        """Frame whose pose X is moved by a twist x (6,)."""
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

    X is any rotation. M R' = X T is linear in the 18 entries of R' and X, which are the null vector of A. The result is the
    identity if the rotations are about too few axes. Source: Shah, "Solving the robot-world/hand-eye calibration problem using
    the Kronecker product", J. Mechanisms and Robotics 5(3), 2013.
    """
    identity = np.eye(3)
    A = np.zeros((18, 18))
    for M, T in zip(measured, tip_rotations, strict=True):
        equations = np.c_[np.kron(M, identity), -np.kron(identity, T.T)]
        A += equations.T @ equations
    eigenvalues, eigenvectors = np.linalg.eigh(A)  # from the smallest up
    if eigenvalues[1] < _MIN_EIGENVALUE_RATIO * eigenvalues[-1]:
        return identity
    scaled_inverse = eigenvectors[:9, 0].reshape(3, 3)  # R' times an unknown factor, of either sign
    sign = np.sign(np.linalg.det(scaled_inverse))  # of the factor, as rotations have the determinant 1
    inverse = _nearest_rotation(scaled_inverse * sign)
    return inverse.T


@dataclass(frozen=True, eq=False)
class CentreTarget(MeasuredTarget):
    """Fixed end of a ball bar or of a string."""

    given: Measurements
    centre: Array
    """(3,) position in the base [m]."""
    names: tuple[str, ...] = LENGTHS

    @classmethod
    def from_tips(cls, given: Measurements, T: Array) -> CentreTarget:
        """Centre c by trilateration: |p - c|² = d² is linear in c and |c|², 2 p' c - |c|² = |p|² - d²."""
        p = T[:, :3, 3]
        A = np.c_[2.0 * p, np.ones(len(p))]
        solution, *_ = np.linalg.lstsq(A, (p**2).sum(axis=1) - given.sizes**2, rcond=None)
        return cls(given, solution[:3])

    def rows(self, T: Array, J: Array) -> ReadingRows:
        """Distance of the tip from the centre, less the reading."""
        distances, u = _distances_and_directions(T[:, :3, 3] - self.centre)
        residual = distances - self.given.sizes
        return ReadingRows(residual[:, None], u @ point_columns(T, J), -u)

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
        """Target without unknowns."""
        return cls(given)

    def rows(self, T: Array, J: Array) -> ReadingRows:
        """Distance between the two tips, less the reading."""
        i, j = np.asarray(self.given.pairs).T  # indices of the two poses of each pair
        p = T[:, :3, 3]
        J_v = point_columns(T, J)
        distances, u = _distances_and_directions(p[i] - p[j])
        residual = distances - self.given.sizes
        no_unknowns = np.zeros((len(u), 1, 0))
        return ReadingRows(residual[:, None], u @ (J_v[i] - J_v[j]), no_unknowns)


def _distances_and_directions(differences: Array) -> tuple[Array, Array]:
    """Lengths (m,) of differences (m, 3) of points, and their unit vectors as rows (m, 1, 3)."""
    distances = np.linalg.norm(differences, axis=1)
    directions = differences / np.maximum(distances, _MIN_DISTANCE)[:, None]
    return distances, directions[:, None]


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
        p = T[:, :3, 3]
        starts = []
        for k in range(len(labels)):
            touched_points = p[given.target_index == k]
            starts.append(cls.start(touched_points))
        x = np.array(starts)
        names = cls.words
        if len(labels) > 1:
            names = tuple(f"{label}.{word}" for label in labels for word in cls.words)
        return cls(given, x, names)

    @staticmethod
    @abstractmethod
    def start(p: Array) -> Array:
        """Unknowns of one target from touched points (m, 3)."""

    def spread(self, own: Array) -> Array:
        """Derivatives (m, r, k) by the unknowns of all targets.

        ``own`` (m, r, unknowns) are derivatives of each reading by the unknowns of its own target.
        """
        target_count, unknown_count = self.x.shape
        by_targets = np.zeros((*own.shape[:2], target_count, unknown_count))
        by_targets[np.arange(len(own)), :, self.given.target_index] = own
        return by_targets.reshape(*own.shape[:2], -1)

    def step(self, x: Array) -> TouchTarget:
        """Targets whose unknowns change by x (k,)."""
        return replace(self, x=self.x + x.reshape(self.x.shape))

    def freedom(self, turning: int, sliding: int) -> int:
        """Rank in theory; without a known length, touches do not determine the scale."""
        is_scale_open = self.given.length is None
        return super().freedom(turning, sliding) - int(is_scale_open)


class PointTarget(TouchTarget):
    """Points; the unknowns of each are its x, y and z."""

    words = LENGTHS

    @staticmethod
    def start(p: Array) -> Array:
        """Mean of the touched points."""
        return np.asarray(p.mean(axis=0))

    def rows(self, T: Array, J: Array) -> ReadingRows:
        """Position of the tip less its point."""
        residual = T[:, :3, 3] - self.x[self.given.target_index]
        own = np.broadcast_to(-np.eye(3), (len(T), 3, 3))
        return ReadingRows(residual, point_columns(T, J), self.spread(own))

    def length_row(self, _T: Array, J: Array) -> tuple[float, Array, Array] | None:
        """Distance of the first two points, less the known length."""
        if self.given.length is None:
            return None
        difference = self.x[0] - self.x[1]
        distance = float(np.linalg.norm(difference))
        u = difference / max(distance, _MIN_DISTANCE)
        by_other_targets = np.zeros(self.x.size - 6)  # 6 unknowns of the two points
        own = np.concatenate([u, -u, by_other_targets])
        return distance - self.given.length, np.zeros(J.shape[2]), own


class PlaneTarget(TouchTarget):
    """Planes n' p = d; the unknowns are x and y of the rotation vector that turns the z axis to n, and d."""

    words = ("nx", "ny", "d")

    @staticmethod
    def start(p: Array) -> Array:
        """x and y of the rotation vector from z to the normal, and the distance d from the origin."""
        centre = p.mean(axis=0)
        _, _, directions = np.linalg.svd(p - centre)
        n = directions[2]  # in which the points vary least
        if n @ centre < 0:  # the normal points away from the origin
            n = -n
        axis = np.asarray(so3.cross([0.0, 0.0, 1.0], n))
        sine = float(np.linalg.norm(axis))
        unit_axis = np.array([1.0, 0.0, 0.0])  # of any half turn, if n is along z
        if sine > 1e-12:  # above rounding errors
            unit_axis = axis / sine
        rotation = np.arctan2(sine, n[2]) * unit_axis
        return np.array([*rotation[:2], n @ centre])

    def normals(self) -> tuple[Array, Array]:
        """Unit normals (targets, 3), and their derivatives (targets, 3, 2) by the two components of the rotation."""
        w = np.c_[self.x[:, :2], np.zeros(len(self.x))]
        R = np.asarray(so3.exp(w))
        n = R[:, :, 2]
        n_by_w = -so3.hat(n) @ so3.left_jacobian(w)
        return n, n_by_w[:, :, :2]

    def rows(self, T: Array, J: Array) -> ReadingRows:
        """Height of the tip above its plane."""
        k = self.given.target_index  # plane of each reading
        p = T[:, :3, 3]
        n_of_planes, n_by_rotation = self.normals()
        n = n_of_planes[k]
        height_by_rotation = np.einsum("ni,nij->nj", p, n_by_rotation[k])
        own = np.concatenate([height_by_rotation, -np.ones((len(p), 1))], axis=1)
        heights = (p * n).sum(axis=1) - self.x[k, 2]
        return ReadingRows(heights[:, None], n[:, None] @ point_columns(T, J), self.spread(own[:, None]))

    def length_row(self, T: Array, J: Array) -> tuple[float, Array, Array] | None:
        """Mean distance of the second plane's touched points from the first plane, less the known length."""
        if self.given.length is None:
            return None
        on_second_plane = self.given.target_index == 1
        centre = T[on_second_plane, :3, 3].mean(axis=0)
        centre_columns = point_columns(T[on_second_plane], J[on_second_plane]).mean(axis=0)
        n, n_by_rotation = self.normals()
        height = float(n[0] @ centre - self.x[0, 2])
        side = 1.0 if height > 0 else -1.0  # 1 if the second plane is above the first
        own = np.zeros(self.x.size)
        own[:3] = [*(centre @ n_by_rotation[0]), -1.0]  # by the unknowns of the first plane
        return abs(height) - self.given.length, side * (n[0] @ centre_columns), side * own


class SphereTarget(TouchTarget):
    """Spheres; the unknowns of each are its centre and its radius."""

    words = (*LENGTHS, "radius")

    @staticmethod
    def start(p: Array) -> Array:
        """Centre c and radius r of the sphere through the points: 2 p' c + (r² - |c|²) = |p|²."""
        A = np.c_[2.0 * p, np.ones(len(p))]
        solution, *_ = np.linalg.lstsq(A, (p**2).sum(axis=1), rcond=None)
        centre = solution[:3]
        squared_radius = max(solution[3] + centre @ centre, 1e-6)  # [m²]; noise may make the fitted one negative
        return np.array([*centre, np.sqrt(squared_radius)])

    def rows(self, T: Array, J: Array) -> ReadingRows:
        """Distance of the tip from the centre of its sphere, less the radius."""
        sphere_of_reading = self.x[self.given.target_index]
        centres = sphere_of_reading[:, :3]
        radii = sphere_of_reading[:, 3]
        distances, u = _distances_and_directions(T[:, :3, 3] - centres)
        own = np.concatenate([-u, -np.ones((len(u), 1, 1))], axis=2)
        return ReadingRows((distances - radii)[:, None], u @ point_columns(T, J), self.spread(own))

    def length_row(self, _T: Array, J: Array) -> tuple[float, Array, Array] | None:
        """Diameter of the first sphere, less the known length."""
        if self.given.length is None:
            return None
        own = np.zeros(self.x.size)
        own[3] = 2.0  # by the radius of the first sphere
        residual = float(2.0 * self.x[0, 3] - self.given.length)
        return residual, np.zeros(J.shape[2]), own


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
