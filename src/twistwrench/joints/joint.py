"""What every joint type says of itself. The rest of the library asks the joint, and never which type it is.

A joint carries a child's frame along screw axes that are constant there: its twist, in the child's frame, is ``axes.T @ dq``.
Functions that take ``q`` are given the joint's own coordinates, (nq,) or (..., nq); ``dq`` its own velocities.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ..bodies.inertia import SpatialInertia
from ..typing import Array
from .chart import CosineSine


@dataclass(frozen=True)
class ChartEntry:
    """Independent coordinate of a joint for Lagrange's equations."""

    letter: str
    """What its symbol begins with."""
    angle: bool
    """Whether it is an angle."""
    meaning: str
    """In words."""


@dataclass(frozen=True)
class Slider:
    """A slider that moves one coordinate of a joint."""

    label: str
    """What follows the joint's name."""
    coordinate: int
    """Number of the coordinate, or of the quaternion's first."""
    unit: str
    """``"°"`` or ``"m"``."""
    reach: float
    """How far it goes either way where there is no limit [rad or m]."""
    turn: int | None = None
    """0, 1, 2: roll, pitch, yaw of the quaternion that begins at ``coordinate``."""


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint: its screw axes, and everything the library asks of its type."""

    name: str
    """The joint's name in its file."""
    axes: Array
    """Screw axes (nv, 6), one a row, constant in the child's frame."""

    kind: ClassVar[str]
    """The name of the type, as in files and tables."""
    coordinate_suffixes: ClassVar[tuple[str, ...]] = ("",)
    """What is appended to the joint's name to name its coordinates; one empty text for joints of one degree."""
    velocity_suffixes: ClassVar[tuple[str, ...]] = ("",)
    quaternion: ClassVar[int | None] = None
    """Where among its coordinates a quaternion (w, x, y, z) begins."""
    plain_rates: ClassVar[bool] = True
    """Whether the rates of the coordinates are the velocities."""
    moves_body: ClassVar[bool] = True
    """Whether the child's frame moves: that of a rotor, a body of revolution, stays behind."""
    driven: ClassVar[bool] = True
    """Whether something drives it: a free body has no motor."""
    wraps: ClassVar[tuple[int, ...]] = ()
    """The coordinates that are angles without end, which logs may wrap at ±π."""
    pinocchio_order: ClassVar[tuple[int, ...]] = (0,)
    """Its velocities in Pinocchio's order."""

    @property
    def nv(self) -> int:
        """Velocities of the joint."""
        return int(self.axes.shape[0])

    @property
    def nq(self) -> int:
        """Coordinates of the joint."""
        return len(self.coordinate_suffixes)

    @property
    def neutral(self) -> Array:
        """Coordinates at which the child's frame coincides with the joint's; (nq,)."""
        q = np.zeros(self.nq)
        if self.quaternion is not None:
            q[self.quaternion] = 1.0
        return q

    def is_configuration(self, q: Array) -> bool:
        """Whether coordinates stand for a configuration: a quaternion of zeros is no rotation.

        Parameters
        ----------
        q : (..., nq) array

        Returns
        -------
        answer : bool
        """
        first = self.quaternion
        return first is None or bool(np.any(q[..., first : first + 4], axis=-1).all())

    @property
    def turning(self) -> tuple[bool, ...]:
        """Of each velocity: whether it turns [rad/s, N m], as opposed to slides [m/s, N]."""
        return tuple(bool(axis[:3].any()) for axis in self.axes)

    @property
    def coordinate_units(self) -> tuple[str, ...]:
        """``"rad"``, ``"m"``, or an empty text for the numbers of a quaternion."""
        return ("rad" if self.turning[0] else "m",)

    @property
    def angle(self) -> tuple[int, int] | None:
        """The coordinate whose sine and cosine are taken, and its velocity; None for joints without an angle."""
        return 0, 0

    @classmethod
    def axes_from(cls, axis: ArrayLike, pitch: float, normalise: bool, who: str) -> Array:
        """Screw axes from a direction or a screw axis, and a pitch.

        Parameters
        ----------
        axis : (3,) or (6,) array_like, direction or screw axis in the child's frame
        pitch : float [m/rad]
        normalise : bool, make axes of unit length
        who : str, what messages call the joint

        Returns
        -------
        axes : (nv, 6) array

        Raises
        ------
        ModelError
            There is no such axis.
        """
        raise NotImplementedError

    # ── pose and inertia ──

    def pose(self, q: Array) -> Array:
        """Pose T_jc of the child's frame in the joint's frame; works on symbols.

        Parameters
        ----------
        q : (nq,) array, coordinates of the joint

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
        q : (nq,) array, coordinates of the joint

        Returns
        -------
        G : SpatialInertia
        """
        return G.in_frame(self.pose(q))

    # ── the configuration manifold ──

    def add(self, q: Array, dv: Array, angles: Array) -> Array:
        """Configuration plus joint twist, q ⊕ dv: the constant twist ``axes.T @ dv`` for unit time, without a branch.

        Parameters
        ----------
        q : (nq,) array, coordinates of the joint
        dv : (nv,) array
        angles : (nq,) array, q again, for sines, cosines and rotations

        Returns
        -------
        q : (nq,) array
        """
        return q + dv

    def subtract(self, q1: Array, q0: Array) -> Array:
        """Difference of configurations, q1 ⊖ q0: the dv with ``add(q0, dv)`` at the pose of q1, without a branch.

        Parameters
        ----------
        q1, q0 : (nq,) array

        Returns
        -------
        dv : (nv,) array
        """
        return q1 - q0

    def rates(self, q: Array) -> Array:
        """Matrix N with dq/dt = N dq, on symbols.

        Parameters
        ----------
        q : (nq,) array, coordinates of the joint

        Returns
        -------
        N : (nq, nv) array
        """
        return np.eye(1)

    def rotation_slopes(self, q: Array) -> Iterator[tuple[Array, Array]]:
        """Derivatives of a rotation by a quaternion, on symbols; of other joints nothing.

        Parameters
        ----------
        q : (nq,) array, coordinates of the joint

        Returns
        -------
        slopes : iterator of (R (3, 3), its derivative along each velocity (3, 3, nv))
        """
        return iter(())

    def velocities(self, q: Array, q1: Array, q2: Array) -> tuple[Array, Array]:
        """Velocities and accelerations from the derivatives of the coordinates by time.

        Parameters
        ----------
        q, q1, q2 : (n, nq) array, coordinates, their first and second derivatives by time

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

    def bound(self, off: Array) -> Array:
        """Largest errors of the joint that errors of the coordinates can make.

        Parameters
        ----------
        off : (nq,) array

        Returns
        -------
        off : (nv,) array
        """
        return off

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

        Parameters
        ----------
        q : (..., nq) array

        Returns
        -------
        q : (..., nq) array
        """
        return q

    def from_pinocchio(self, q: Array) -> Array:
        """Coordinates from Pinocchio's order.

        Parameters
        ----------
        q : (..., nq) array

        Returns
        -------
        q : (..., nq) array
        """
        return q

    def require_pinocchio(self) -> None:
        """Check that Pinocchio has such a joint.

        Raises
        ------
        ModelError
            It has none.
        """

    def to_mujoco(self, q: Array) -> Array:
        """Coordinates in MuJoCo's order.

        Parameters
        ----------
        q : (..., nq) array

        Returns
        -------
        q : (..., nq) array
        """
        return q

    def from_mujoco(self, q: Array) -> Array:
        """Coordinates from MuJoCo's order.

        Parameters
        ----------
        q : (..., nq) array

        Returns
        -------
        q : (..., nq) array
        """
        return q

    def mujoco_rates(self, q: Array) -> Array:
        """Matrix P between velocities: MuJoCo's are P dq at q.

        Parameters
        ----------
        q : (nq,) array, coordinates of the joint

        Returns
        -------
        P : (nv, nv) array
        """
        return np.eye(self.nv)

    def mujoco_turning(self, dq: Array) -> Array:
        """What P ddq lacks of d(P dq)/dt, in our axes.

        Parameters
        ----------
        dq : (nv,) array, its velocities

        Returns
        -------
        off : (nv,) array
        """
        return np.zeros(self.nv)

    # ── Lagrange's equations ──

    @property
    def chart(self) -> tuple[ChartEntry, ...]:
        """Independent coordinates u, nv of them."""
        raise NotImplementedError

    def from_chart(self, u: Array, du: Array) -> tuple[Array, Array, Array]:
        """Coordinates and velocities from the chart's, for Lagrange's equations.

        Parameters
        ----------
        u, du : (nv,) array, the chart's coordinates and their rates

        Returns
        -------
        q : (nq,) array
        B : (nv, nv) array, with dq = B du
        dB : (nv, nv) array, its rate
        """
        return u, np.eye(1), np.zeros((1, 1))

    def chart_pose(self, cosine_sine: CosineSine, coordinate: Callable[[int], Any]) -> tuple[Array, Array]:
        """Rotation and position of the child in any arithmetic.

        Parameters
        ----------
        cosine_sine : gives cosine and sine of a chart's entry
        coordinate : gives the value of a chart's entry

        Returns
        -------
        R : (3, 3) array
        p : (3,) array
        """
        raise NotImplementedError

    def chart_column(
        self, k: int, into_child: Callable[[Array], Array], cosine_sine: CosineSine
    ) -> tuple[Array, Array]:
        """Twist of the child, in its axes, per unit of the rate of one entry of the chart.

        Parameters
        ----------
        k : int, number of the entry
        into_child : turns vectors of the joint
        cosine_sine : gives cosine and sine of a chart's entry

        Returns
        -------
        omega : (3,) array
        v : (3,) array
        """
        raise NotImplementedError

    # ── the viewer ──

    @property
    def sliders(self) -> tuple[Slider, ...]:
        """The sliders that move its coordinates."""
        raise NotImplementedError
