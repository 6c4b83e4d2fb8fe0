"""Joint: the interface of all joint types, and rotations in exact arithmetic."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ...core.glossary import complete
from ...core.typing import Array
from ..bodies.inertia import SpatialInertia
from ..lie import quaternion

CosineSine = Callable[[int], tuple[Any, Any]]
"""Function of a chart entry's number that returns cosine and sine of the angle, in any arithmetic."""


def exact(values: Any) -> Any:
    """Floats as Python numbers, whole numbers as integers, so that SymPy simplifies factors 0 and ±1 away."""
    if np.ndim(values) == 0:
        x = float(values)
        return int(x) if x.is_integer() else x
    array = np.empty(np.shape(values), object)
    for index in np.ndindex(array.shape):
        array[index] = exact(np.asarray(values)[index])
    return array


def exact_rodrigues(w: Array, cosine: Any, sine: Any) -> Array:
    """Rotation about a unit vector, w w' + (1 - w w') cos θ + [w] sin θ; MR eq. 3.51 with [w]² = w w' - 1.

    In this form a rotation about a coordinate axis reduces to four entries.
    """
    ww = np.outer(w, w)
    W = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
    return exact(ww) + exact(np.eye(3) - ww) * cosine + exact(W) * sine


def euler_rotation(first: int, cosine_sine: CosineSine) -> Array:
    """Rot(z, alpha) Rot(y, beta) Rot(x, gamma) with the angles in entries ``first`` to ``first`` + 2."""
    x, y, z = np.eye(3)
    alpha, beta, gamma = (cosine_sine(first + k) for k in range(3))  # cosine and sine of each
    return np.asarray(exact_rodrigues(z, *alpha) @ exact_rodrigues(y, *beta) @ exact_rodrigues(x, *gamma))


def euler_axis(k: int, first: int, cosine_sine: CosineSine) -> Array:
    """ω_b per unit rate of alpha, beta or gamma (k = 0, 1, 2), with the angles in entries ``first`` to ``first`` + 2."""
    cb, sb = cosine_sine(first + 1)  # of beta
    cg, sg = cosine_sine(first + 2)  # of gamma
    columns = [  # of E in euler_rates
        (-sb, cb * sg, cb * cg),  # alpha
        (0, cg, -sg),  # beta
        (1, 0, 0),  # gamma
    ]
    return np.array(columns[k], object)


def euler_rates(angles: Array, rates: Array) -> tuple[Array, Array, Array]:
    """Quaternion of ZYX Euler angles (alpha, beta, gamma), the matrix E in ω_b = E times their rates, and dE/dt."""
    # cb, sb: cosine and sine of beta; cg, sg: of gamma; db, dg: rates of both
    cb, cg = np.cos(angles[1:])
    sb, sg = np.sin(angles[1:])
    _, db, dg = rates
    E = np.array([[-sb, 0, 1], [cb * sg, cg, 0], [cb * cg, -sg, 0]])
    dE = np.array(
        [[-cb * db, 0, 0], [-sb * sg * db + cb * cg * dg, -sg * dg, 0], [-sb * cg * db - cb * sg * dg, -cg * dg, 0]]
    )
    quaternions = []
    for angle, axis in zip(angles, np.eye(3)[::-1], strict=True):  # about z, y and x
        quaternions.append(np.r_[np.cos(angle / 2), np.sin(angle / 2) * axis])
    Q_z, Q_y, Q_x = quaternions
    Q = quaternion.multiply(quaternion.multiply(Q_z, Q_y), Q_x)
    return Q, E, dE


# ── Interface of all joint types

# A joint moves the child's frame along screw axes that are constant in that frame: its twist there is ``axes.T @ dq``.
# Functions take the joint's own coordinates ``q``, (nq,) or (..., nq), and its own velocities ``dq``.


@dataclass(frozen=True)
class ChartEntry:
    """Independent coordinate of a joint for Lagrange's equations."""

    letter: str
    """First letter of the coordinate's symbol."""
    angle: bool
    """True if the coordinate is an angle."""
    meaning: str
    """Meaning in words."""


@dataclass(frozen=True)
class Slider:
    """Slider that moves one coordinate of a joint."""

    label: str
    """Label after the joint's name."""
    coordinate: int
    """Index of the coordinate among those of the joint, or of the first entry of the quaternion."""
    unit: str
    """``"°"`` or ``"m"``."""
    reach: float
    """Length of the range on each side of zero if there is no limit [rad or m]."""
    turn: int | None = None
    """0, 1, 2 for roll, pitch, yaw of the quaternion that begins at ``coordinate``; None without a quaternion."""


@dataclass(frozen=True, eq=False)
class Joint:
    """Joint: its screw axes and the operations of its type."""

    name: str
    """Name of the joint in its file."""
    axes: Array
    """Screw axes (nv, 6), one per row, constant in the child's frame."""

    kind: ClassVar[str]
    """Name of the type, as in files and tables."""
    coordinate_suffixes: ClassVar[tuple[str, ...]] = ("",)
    """Suffixes of the coordinate names, appended to the joint's name; one empty text for joints with one coordinate."""
    velocity_suffixes: ClassVar[tuple[str, ...]] = ("",)
    """Suffixes of the velocity names, appended to the joint's name."""
    quaternion: ClassVar[int | None] = None
    """Index of the first entry of a quaternion (w, x, y, z) among the joint's coordinates; None without a quaternion."""
    plain_rates: ClassVar[bool] = True
    """True if the velocities are the rates of the coordinates."""
    moves_body: ClassVar[bool] = True
    """True if the child's frame moves; False for a rotor, which is a body of revolution."""
    driven: ClassVar[bool] = True
    """True if an actuator may drive the joint; False for a free body."""
    wraps: ClassVar[tuple[int, ...]] = ()
    """Indices of coordinates that are unbounded angles, which logs may wrap at ±π."""
    pinocchio_order: ClassVar[tuple[int, ...]] = (0,)
    """Index of each of the joint's velocities, in Pinocchio's order."""

    @property
    def nv(self) -> int:
        """Number of velocities."""
        return int(self.axes.shape[0])

    @property
    def nq(self) -> int:
        """Number of coordinates."""
        return len(self.coordinate_suffixes)

    @property
    def neutral(self) -> Array:
        """Coordinates (nq,) at which the child's frame coincides with the joint's frame."""
        q = np.zeros(self.nq)
        if self.quaternion is not None:
            q[self.quaternion] = 1.0
        return q

    def is_configuration(self, q: Array) -> bool:
        """True if the coordinates are a configuration; a zero quaternion is not.

        Returns
        -------
        answer : bool
        """
        if self.quaternion is None:
            return True
        quaternions = q[..., self.quaternion : self.quaternion + 4]
        is_nonzero = np.any(quaternions, axis=-1)
        return bool(is_nonzero.all())

    @property
    def turning(self) -> tuple[bool, ...]:
        """(nv,) True for angular velocities [rad/s, N m], False for linear velocities [m/s, N]."""
        return tuple(bool(axis[:3].any()) for axis in self.axes)

    @property
    def coordinate_units(self) -> tuple[str, ...]:
        """Units of the coordinates: ``"rad"``, ``"m"``, or an empty text for quaternion entries."""
        return ("rad" if self.turning[0] else "m",)

    @property
    def angle(self) -> tuple[int, int] | None:
        """Index of the coordinate whose sine and cosine are used, and index of its velocity; None without an angle."""
        return 0, 0

    @classmethod
    def axes_from(cls, axis: ArrayLike, pitch: float, normalise: bool, who: str) -> Array:
        """Screw axes from a direction or a screw axis, and a pitch.

        Parameters
        ----------
        axis : (3,) or (6,) array_like, direction or screw axis in the child's frame
        pitch : float [m/rad]
        normalise : bool, scale axes to unit length
        who : str, name of the joint in messages

        Returns
        -------
        axes : (nv, 6) array

        Raises
        ------
        ModelError
            The axis is invalid.
        """
        raise NotImplementedError

    # ── pose and inertia ──

    def pose(self, q: Array) -> Array:
        """Pose T_jc of the child's frame in the joint's frame; works on symbols.

        Returns
        -------
        T : (4, 4) array
        """
        raise NotImplementedError

    def carry(self, G: SpatialInertia, q: Array) -> SpatialInertia:
        """Spatial inertia, in the joint's frame, of the body that the joint carries; works on symbols.

        Parameters
        ----------
        G : SpatialInertia, of the body in the child's frame

        Returns
        -------
        G : SpatialInertia
        """
        return G.in_frame(self.pose(q))

    # ── the configuration manifold ──

    def add(self, q: Array, dv: Array, angles: Array) -> Array:
        """Configuration plus joint twist, q ⊕ dv: the constant twist ``axes.T @ dv`` for unit time, branch-free.

        Parameters
        ----------
        dv : (nv,) array
        angles : (nq,) array, values of q for sines, cosines and rotations

        Returns
        -------
        q : (nq,) array
        """
        return q + dv

    def subtract(self, q1: Array, q0: Array) -> Array:
        """Difference of configurations, q1 ⊖ q0: the dv for which ``add(q0, dv)`` has the pose of q1, branch-free.

        Parameters
        ----------
        q1, q0 : (nq,) array

        Returns
        -------
        dv : (nv,) array
        """
        return q1 - q0

    def rates(self, q: Array) -> Array:
        """Matrix N in dq/dt = N dq, for symbols.

        Returns
        -------
        N : (nq, nv) array
        """
        return np.eye(1)

    def rotation_slopes(self, q: Array) -> Iterator[tuple[Array, Array]]:
        """Derivatives of a quaternion's rotation, for symbols; empty for joints without a quaternion.

        Returns
        -------
        slopes : iterator of (R (3, 3), its derivative along each velocity (3, 3, nv))
        """
        return iter(())

    def velocities(self, q: Array, q1: Array, q2: Array) -> tuple[Array, Array]:
        """Velocities and accelerations from the time derivatives of the coordinates.

        Parameters
        ----------
        q, q1, q2 : (n, nq) array, coordinates and their first and second time derivatives

        Returns
        -------
        dq : (n, nv) array
        ddq : (n, nv) array
        """
        return q1, q2

    def spread(self, sigma: Array) -> Array:
        """Standard deviations of ddq from those of the second derivatives of the coordinates.

        Parameters
        ----------
        sigma : (nq,) array

        Returns
        -------
        sigma : (nv,) array
        """
        return sigma

    def bound(self, error: Array) -> Array:
        """Bounds on the errors of the joint's pose, one for each velocity, for given errors of the coordinates.

        Parameters
        ----------
        error : (nq,) array

        Returns
        -------
        bounds : (nv,) array
        """
        return error

    def random(self, rng: np.random.Generator, shape: tuple[int, ...], lower: Array, upper: Array) -> Array:
        """Random coordinates.

        Parameters
        ----------
        rng : numpy Generator
        shape : tuple of int, batch shape
        lower, upper : (nv,) array, finite, in the order of the velocities

        Returns
        -------
        q : (*shape, nq) array
        """
        return rng.uniform(lower, upper, (*shape, self.nv))

    # ── other libraries ──

    def to_pinocchio(self, q: Array) -> Array:
        """Coordinates in Pinocchio's order.

        Returns
        -------
        q : (..., nq) array
        """
        return q

    def from_pinocchio(self, q: Array) -> Array:
        """Coordinates from Pinocchio's order.

        Returns
        -------
        q : (..., nq) array
        """
        return q

    def require_pinocchio(self) -> None:
        """Check that Pinocchio supports this joint.

        Raises
        ------
        ModelError
            Pinocchio has no such joint.
        """

    def to_mujoco(self, q: Array) -> Array:
        """Coordinates in MuJoCo's order.

        Returns
        -------
        q : (..., nq) array
        """
        return q

    def from_mujoco(self, q: Array) -> Array:
        """Coordinates from MuJoCo's order.

        Returns
        -------
        q : (..., nq) array
        """
        return q

    def mujoco_rates(self, q: Array) -> Array:
        """Matrix P of MuJoCo's velocities P dq at q.

        Returns
        -------
        P : (nv, nv) array
        """
        return np.eye(self.nv)

    def mujoco_turning(self, dq: Array) -> Array:
        """Difference of d(P dq)/dt and P ddq, in our axes.

        Parameters
        ----------
        dq : (nv,) array, its velocities

        Returns
        -------
        difference : (nv,) array
        """
        return np.zeros(self.nv)

    # ── Lagrange's equations ──

    @property
    def chart(self) -> tuple[ChartEntry, ...]:
        """Independent coordinates u of the joint (nv)."""
        raise NotImplementedError

    def from_chart(self, u: Array, du: Array) -> tuple[Array, Array, Array]:
        """Coordinates and velocities from those of the chart, for Lagrange's equations.

        Parameters
        ----------
        u, du : (nv,) array, coordinates of the chart and their rates

        Returns
        -------
        q : (nq,) array
        B : (nv, nv) array, with dq = B du
        dB : (nv, nv) array, its rate
        """
        return u, np.eye(1), np.zeros((1, 1))

    def chart_pose(self, cosine_sine: CosineSine, coordinate: Callable[[int], Any]) -> tuple[Array, Array]:
        """Rotation and position of the child, in any arithmetic.

        Parameters
        ----------
        coordinate : function that returns the value of a chart entry

        Returns
        -------
        R : (3, 3) array
        p : (3,) array
        """
        raise NotImplementedError

    def chart_column(
        self, k: int, into_child: Callable[[Array], Array], cosine_sine: CosineSine
    ) -> tuple[Array, Array]:
        """Twist of the child, in its axes, per unit rate of one chart entry.

        Parameters
        ----------
        k : int, number of the entry
        into_child : function that rotates vectors from the joint's axes to the child's

        Returns
        -------
        omega : (3,) array
        v : (3,) array
        """
        raise NotImplementedError

    # ── the viewer ──

    @property
    def sliders(self) -> tuple[Slider, ...]:
        """Sliders that move the joint's coordinates."""
        raise NotImplementedError


complete(globals())
