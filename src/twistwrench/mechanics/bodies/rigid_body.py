"""Dynamics of one rigid body in any frame fixed to it, with checks of labelled vectors. Modern Robotics section 8.2."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ...core import arguments
from ...core.errors import FrameError, InertiaError, SingularMassMatrixError
from ...core.glossary import complete
from ...core.gravity import GRAVITY
from ...core.typing import Array
from ..lie import so3
from ..lie.twist_wrench import Pose, Twist, Wrench
from .inertia import SpatialInertia

if TYPE_CHECKING:
    from .free_body import Flight
    from .free_body_steps import WrenchLaw

_KINDS: dict[str, type[Twist | Wrench | Pose]] = {"F": Wrench, "wrench": Wrench, "T0": Pose}
"""Kinds of labelled arguments by name; all other arguments are twists or rates of twists."""


def common_frame(known: str | None = None, **values: Any) -> str | None:
    """Common body frame of the labelled ``values``, for a pose its frame ``of``; None if no value has a label.

    ``known`` is the frame if it is already known. Raises FrameError for different frames, and for a value of the wrong kind.
    """
    frames: set[str] = set()
    descriptions: list[str] = []  # of values and frames, for the message
    if known is not None:
        frames.add(known)
        descriptions.append(f"the body in {known!r}")
    for name, value in values.items():
        if not isinstance(value, Twist | Wrench | Pose):
            continue
        kind = _KINDS.get(name, Twist)
        if not isinstance(value, kind):
            raise FrameError(f"{name} is a {kind.__name__}, not a {type(value).__name__}.")
        if isinstance(value, Pose):
            frames.add(value.of)
            descriptions.append(f"{name} = {value.symbol} of {value.of!r}")
        else:
            frames.add(value.frame)
            descriptions.append(f"{name} in {value.frame!r}")
    if len(frames) > 1:
        raise FrameError(
            f"{', '.join(descriptions)}: a body's equations hold in one frame. Move one first, with a Pose between them."
        )
    return next(iter(frames), None)  # the only one


def numbers(**vectors: Any) -> list[Array]:
    """Numbers (..., 6) of each vector, after a check that kinds and frames of labelled vectors agree."""
    common_frame(**vectors)
    return [arguments.real(vector, name, 6) for name, vector in vectors.items()]


# ── Dynamics of one rigid body in any body-fixed frame. Modern Robotics section 8.2

ROWS = 2048
"""Number of rows of a block. Six columns are 96 KiB: they fit in the second-level cache, and stay below the 128 KiB from which
the C library maps fresh pages for every temporary."""
_MIN_MOMENT_RATIO = 1e-14
"""Ratio of the smallest principal moment to the largest up to which it is zero but for rounding errors."""


@dataclass(frozen=True, eq=False)
class RigidBody:
    """Physically consistent rigid body with F = G V̇ − ad(V)ᵀ G V in any frame fixed to it.

    Twists, accelerations and wrenches (..., 6) are expressed in the frame of ``inertia``, angular part first, in rad/s,
    m/s, N m and N. All methods broadcast over leading axes. Labelled values are accepted if their frames agree. An
    inertia that no body can have raises :class:`~twistwrench.InertiaError`.

    Examples
    --------
    >>> body = RigidBody(SpatialInertia.box((0.1, 0.2, 0.3), mass=1.2))
    >>> body.wrench([0, 0, 2, 1, 0, 0], [0, 0, 0, 0, 0, 0]).tolist()  # turning left at speed: force to the left
    [0.0, 0.0, 0.0, 0.0, 2.4, 0.0]
    >>> ball = RigidBody(SpatialInertia.sphere(1.0, mass=5.0))
    >>> ball.acceleration([0, 0, 0, 0, 0, 0], [0, 0, 2, 10, 0, 0]).tolist(), ball.weight(np.eye(4))[5].round(2).item()
    ([0.0, 0.0, 1.0, 2.0, 0.0, 0.0], -49.05)
    >>> ball.momentum([1, 0, 0, 0, 2, 0]).tolist(), float(ball.kinetic_energy([1, 0, 0, 0, 2, 0]))
    ([2.0, 0.0, 0.0, 0.0, 10.0, 0.0], 11.0)
    >>> V = [0, 0, 3, 0, 0, 0]
    >>> ball.point_velocity(V, [2, 0, 0]).tolist(), ball.point_acceleration(V, np.zeros(6), [2, 0, 0]).tolist()
    ([0.0, 6.0, 0.0], [-18.0, 0.0, 0.0])
    """

    inertia: SpatialInertia
    """Spatial inertia about the origin of the body's frame {b}."""
    _matrix: Array = field(init=False, repr=False)
    """G as a matrix (6, 6)."""

    def __post_init__(self) -> None:
        if not isinstance(self.inertia, SpatialInertia):
            raise InertiaError(
                f"a RigidBody is made of a SpatialInertia, got {type(self.inertia).__name__}. Write "
                "SpatialInertia.from_com(mass, com, moment_about_com), or SpatialInertia.from_matrix(G) for a matrix (6, 6)."
            )
        defects = "; ".join(self.inertia.defects())
        if not defects and not self.inertia.mass > 0:
            defects = "it has no mass"
        if defects:
            raise InertiaError(f"no rigid body has this inertia: {defects}. See nearest_consistent() and repair().")
        object.__setattr__(self, "_matrix", self.inertia.matrix)

    # ── dynamics ──

    def wrench(self, V: ArrayLike, dV: ArrayLike) -> Array:
        """Newton-Euler equations of a rigid body: wrench for given twist and acceleration, F = G V̇ − ad(V)ᵀ G V.

        MR eq. 8.40.

        Returns
        -------
        F : (..., 6) array, in the body's frame [N m, N]
        """
        return self._by_rows(lambda G, V, dV: G @ dV - _ad_transposed(V, G @ V), V=V, dV=dV)

    def acceleration(self, V: ArrayLike, F: ArrayLike) -> Array:
        """Acceleration of a rigid body under a wrench: V̇ = G⁻¹ (F + ad(V)ᵀ G V), the inverse of :meth:`wrench`.

        Parameters
        ----------
        F : (..., 6) array_like or Wrench, (m, f) [N m, N]

        Returns
        -------
        dV : (..., 6) array, rate of the body twist [rad/s², m/s²]

        Raises
        ------
        SingularMassMatrixError
            The body has no inertia about some axis, so that its acceleration is undefined.
        """
        moments, _ = self.inertia.principal()
        smallest_moment, _, largest_moment = moments
        if smallest_moment <= _MIN_MOMENT_RATIO * largest_moment or largest_moment == 0:
            raise SingularMassMatrixError(
                f"the body has no inertia about one of its axes (principal moments {moments.tolist()} kg m²), so its "
                "angular acceleration is undetermined. Give it some thickness."
            )
        return self._by_rows(lambda G, V, F: np.linalg.solve(G, F + _ad_transposed(V, G @ V)), V=V, F=F)

    def momentum(self, V: ArrayLike) -> Array:
        """Spatial momentum of a rigid body, P = G V, in the body's frame.

        MR section 8.2.2.

        Returns
        -------
        P : (..., 6) array, (angular, linear) [N m s, N s]
        """
        return self._by_rows(lambda G, V: G @ V, V=V)

    def kinetic_energy(self, V: ArrayLike) -> Array:
        """Kinetic energy of a rigid body, K = ½ Vᵀ G V, the same in every frame.

        MR eq. 8.35.

        Returns
        -------
        K : (...) array [J]
        """
        (V,) = numbers(V=V)
        return 0.5 * np.einsum("...i,...i->...", V, self.momentum(V))

    def weight(self, T_sb: ArrayLike, gravity: ArrayLike = GRAVITY) -> Array:
        """Weight of a rigid body: wrench of gravity on it, in its frame {b}.

        Parameters
        ----------
        T_sb : (..., 4, 4) array_like, pose of the body
        gravity : (3,) array_like, in {s} [m/s²]

        Returns
        -------
        F : (..., 6) array, (m, f) in {b} [N m, N]
        """
        arguments.pose(T_sb, "T_sb")
        T = arguments.real(T_sb, "T_sb", 4, 4)
        g = arguments.real(gravity, "gravity", 3)
        try:
            g_column = np.swapaxes(T[..., :3, :3], -1, -2) @ g[..., None]
        except ValueError:
            raise arguments.mismatch(T_sb=T, gravity=g) from None
        g_b = g_column[..., 0]
        return np.concatenate([so3.cross(self.inertia.first_moment, g_b), self.inertia.mass * g_b], axis=-1)

    # ── points, frames, flight ──

    def point_velocity(self, V: ArrayLike, r: ArrayLike) -> Array:
        """Velocity of a point of the body, v + ω × r, in the axes of {b}.

        MR section 8.2.1.

        Returns
        -------
        velocity : (..., 3) array [m/s]
        """
        (V,) = numbers(V=V)
        r = arguments.real(r, "r", 3)
        w, v = V[..., :3], V[..., 3:]
        return v + so3.cross(w, r)

    def point_acceleration(self, V: ArrayLike, dV: ArrayLike, r: ArrayLike) -> Array:
        """Acceleration of a point of the body relative to {s}, v̇ + ω̇ × r + ω × (v + ω × r), in the axes of {b}.

        An accelerometer at that point reads this acceleration minus gravity. MR section 8.2.1.

        Returns
        -------
        acceleration : (..., 3) array [m/s²]
        """
        V, dV = numbers(V=V, dV=dV)
        r = arguments.real(r, "r", 3)
        V, dV = arguments.together(V=V, dV=dV)
        w = V[..., :3]
        dw = dV[..., :3]
        dv = dV[..., 3:]
        return dv + so3.cross(dw, r) + so3.cross(w, self.point_velocity(V, r))

    def in_frame(self, T_ab: ArrayLike) -> RigidBody:
        """The same body described in another frame {a} fixed to it; twists and wrenches are then expressed in {a}.

        MR eq. 8.42.

        Parameters
        ----------
        T_ab : (4, 4) array_like, pose of the body's frame {b} seen from {a}

        Examples
        --------
        >>> T = np.eye(4)
        >>> T[:3, 3] = 0, 0, 1
        >>> RigidBody(SpatialInertia.sphere(1.0, mass=5.0)).in_frame(T).inertia.com.tolist()
        [0.0, 0.0, 1.0]
        """
        return RigidBody(self.inertia.in_frame(T_ab))

    def fly(
        self,
        T0: ArrayLike,
        V0: ArrayLike,
        duration: float,
        dt: float,
        wrench: ArrayLike | WrenchLaw | None = None,
        *,
        order: int = 4,
        tolerance: float | None = None,
        every: int = 1,
    ) -> Flight:
        """Free motion of a rigid body from a pose and a body twist, with a report of the drift.

        Parameters
        ----------
        T0 : (4, 4) array_like or Pose, pose T_sb at the start
        V0 : (6,) array_like or Twist, body twist at the start [rad/s, m/s]
        duration : float [s]
        dt : float, step [s], shortened if the duration is not a whole number of steps
        wrench : (6,) array_like, Wrench, or function ``wrench(t, T, V)``, optional, in {b} [N m, N]
        order : 2, 4 or 6, order of accuracy in ``dt``
        tolerance : float, optional, relative error per step; with it steps are adaptive (DOP853) and ``dt`` only spaces records
        every : int, keep every n-th state, and the last

        Returns
        -------
        flight : Flight

        Raises
        ------
        FrameError
            Labelled poses, twists and wrenches do not agree on {b}.
        InertiaError
            The body has no inertia about some axis.
        SimulationError
            A step is unstable.

        Notes
        -----
        Without a wrench the spatial momentum is constant, and a body with two equal moments moves exactly. A wrench function
        is also evaluated between steps, at least eight times per step and at intervals below ``dt`` and a thousandth of the
        duration; shorter pulses may be missed. ``flight.remarks`` lists shortened steps, rotation by more than 1 rad per step,
        unresolved changes of the wrench, and an energy error above 1 %.

        Examples
        --------
        >>> body = RigidBody(SpatialInertia.box((0.1, 0.2, 0.3), mass=1.2))
        >>> flight = body.fly(np.eye(4), [0.01, 5, 0, 0, 0, 1], duration=2, dt=0.01)
        >>> bool(flight.drift.momentum < 1e-13)
        True
        """
        from .free_body import fly

        return fly(self.inertia, T0, V0, duration, dt, wrench, order=order, tolerance=tolerance, every=every)

    # ── batches ──

    def _by_rows(self, law: Callable[..., Array], **vectors: ArrayLike) -> Array:
        """Result (..., 6) of ``law(G, *columns)`` for vectors (..., 6), in blocks of rows as contiguous columns (6, n)."""
        numbers_by_name = dict(zip(vectors, numbers(**vectors), strict=True))
        arrays = arguments.together(**numbers_by_name)  # of a common batch shape
        dtype = np.result_type(*arrays)
        G = self._matrix.astype(dtype)
        shape = arrays[0].shape
        flat_arrays = [array.reshape(-1, 6) for array in arrays]
        result = np.empty((len(flat_arrays[0]), 6), dtype)
        for first_row in range(0, len(result), ROWS):
            block = slice(first_row, first_row + ROWS)
            columns = [np.ascontiguousarray(rows[block].T) for rows in flat_arrays]
            result[block] = law(G, *columns).T
        return result.reshape(shape)


def _ad_transposed(V: Array, P: Array) -> Array:
    """ad(V)ᵀ P = −(ω × l + v × p, ω × p) for columns (6, n); P = (l, p)."""
    wx, wy, wz, vx, vy, vz = V
    lx, ly, lz, px, py, pz = P
    result = np.empty_like(P)
    result[0] = ly * wz - lz * wy + py * vz - pz * vy
    result[1] = lz * wx - lx * wz + pz * vx - px * vz
    result[2] = lx * wy - ly * wx + px * vy - py * vx
    result[3] = py * wz - pz * wy
    result[4] = pz * wx - px * wz
    result[5] = px * wy - py * wx
    return result


complete(globals())
