"""The dynamics of one rigid body, in any frame fixed to it. Modern Robotics section 8.2."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core import arguments
from ..errors import InertiaError, SingularMassMatrixError
from ..lie import so3
from .inertia import SpatialInertia
from .labels import numbers

if TYPE_CHECKING:
    from .flight import Flight, WrenchLaw

Array = NDArray[Any]

__all__ = ["RigidBody"]

ROWS = 2048
"""Rows worked on at a time: the six columns of an array, 96 KiB, stay in the second-level cache, and under the
size (128 KiB) from which the C library maps fresh pages for every temporary."""


@dataclass(frozen=True, eq=False)
class RigidBody:
    """A body that can exist, and F = G V̇ − ad(V)ᵀ G V in any frame fixed to it.

    Twists, accelerations and wrenches (..., 6) are the body's in the frame of ``inertia``, angular part first, in rad/s, m/s,
    N m and N; all methods take any batch shape and broadcast. Labelled ones are taken too, if their frames agree. An
    inertia that no body has is an :class:`~twistwrench.InertiaError`.

    >>> from twistwrench import SpatialInertia
    >>> body = RigidBody(SpatialInertia.box((0.1, 0.2, 0.3), mass=1.2))
    >>> body.wrench([0, 0, 2, 1, 0, 0], [0, 0, 0, 0, 0, 0]).tolist()  # turning left at speed: a force to the left
    [0.0, 0.0, 0.0, 0.0, 2.4, 0.0]
    """

    inertia: SpatialInertia
    """About the origin of the body's frame {b}."""
    _matrix: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if not isinstance(self.inertia, SpatialInertia):
            raise InertiaError(f"a RigidBody is made of a SpatialInertia, got {type(self.inertia).__name__}.")
        problem = "; ".join(self.inertia.defects()) or ("" if self.inertia.mass > 0 else "it has no mass")
        if problem:
            raise InertiaError(f"no rigid body has this inertia: {problem}. See nearest_consistent() and repair().")
        object.__setattr__(self, "_matrix", self.inertia.matrix)

    # ── dynamics ──

    def wrench(self, V: ArrayLike, dV: ArrayLike) -> Array:
        """The wrench (..., 6) that moves the body so: F = G V̇ − ad(V)ᵀ G V, MR eq. 8.40; twist and its rate (..., 6)."""

        def F(G: Array, V: Array, dV: Array) -> Array:
            return G @ dV - _ad_transposed(V, G @ V)

        return self._by_rows(F, V=V, dV=dV)

    def acceleration(self, V: ArrayLike, F: ArrayLike) -> Array:
        """The rate (..., 6) of the twist under a wrench: V̇ = G⁻¹ (F + ad(V)ᵀ G V). The inverse of :meth:`wrench`.

        A body without extent across some axis can be turned about it by nothing:
        :class:`~twistwrench.SingularMassMatrixError`.
        """
        moments = self.inertia.principal()[0]
        if moments[0] <= 1e-14 * moments[2] or moments[2] == 0:
            raise SingularMassMatrixError(
                f"the body has no inertia about one of its axes (principal moments {moments.tolist()} kg m²), so no wrench "
                "says how it turns. Give it some thickness."
            )

        def dV(G: Array, V: Array, F: Array) -> Array:
            return np.linalg.solve(G, F + _ad_transposed(V, G @ V))

        return self._by_rows(dV, V=V, F=F)

    def momentum(self, V: ArrayLike) -> Array:
        """The spatial momentum (..., 6), P = G V, in the body's frame. MR section 8.2.2."""
        return self._by_rows(lambda G, V: G @ V, V=V)

    def kinetic_energy(self, V: ArrayLike) -> Array:
        """K = ½ Vᵀ G V (...) [J], the same in every frame. MR eq. 8.35.

        >>> from twistwrench import SpatialInertia
        >>> float(RigidBody(SpatialInertia.sphere(1.0, mass=5.0)).kinetic_energy([1, 0, 0, 0, 2, 0]))
        11.0
        """
        (V,) = numbers(V=V)
        return 0.5 * np.einsum("...i,...i->...", V, self.momentum(V))

    def weight(self, T_sb: ArrayLike, gravity: ArrayLike = (0.0, 0.0, -9.81)) -> Array:
        """Gravity's wrench (..., 6) on the body at pose T_sb (..., 4, 4), in {b}; ``gravity`` (3,) [m/s²] in {s}."""
        arguments.pose(T_sb, "T_sb")
        T, g = arguments.real(T_sb, "T_sb", 4, 4), arguments.real(gravity, "gravity", 3)
        try:
            f = (np.swapaxes(T[..., :3, :3], -1, -2) @ g[..., None])[..., 0]
        except ValueError:
            raise arguments.mismatch(T_sb=T, gravity=g) from None
        return np.concatenate([so3.cross(self.inertia.first_moment, f), self.inertia.mass * f], axis=-1)

    # ── points, frames, flight ──

    def point_velocity(self, V: ArrayLike, r: ArrayLike) -> Array:
        """Velocity (..., 3) [m/s] of the body's point at r (..., 3), in the axes of {b}: v + ω × r."""
        (V,), r = numbers(V=V), arguments.real(r, "r", 3)
        return V[..., 3:] + so3.cross(V[..., :3], r)

    def point_acceleration(self, V: ArrayLike, dV: ArrayLike, r: ArrayLike) -> Array:
        """Acceleration (..., 3) [m/s²] of the body's point at r (..., 3): v̇ + ω̇ × r + ω × (v + ω × r). MR section 8.2.1.

        In the axes of {b} and relative to {s}: what an accelerometer fixed there feels, without gravity.
        """
        (V, dV), r = numbers(V=V, dV=dV), arguments.real(r, "r", 3)
        V, dV = arguments.together(V=V, dV=dV)
        return dV[..., 3:] + so3.cross(dV[..., :3], r) + so3.cross(V[..., :3], self.point_velocity(V, r))

    def in_frame(self, T_ab: ArrayLike) -> RigidBody:
        """The same body described in {a}, a frame fixed to it; MR eq. 8.42. Its twists, wrenches are then those of {a}."""
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
        """Free motion from pose T0 (4, 4) and body twist V0 (6,), with a report of what drifted.

        ``duration`` and ``dt`` in s, dt shortened where no whole number of steps fills the duration; ``wrench`` in {b} as a
        constant (6,) or a function ``wrench(t, T, V)``; ``order`` 2, 4 or 6 of the steps; with a ``tolerance`` the steps
        adapt and ``dt`` only spaces the record; ``every`` keeps one step in so many. Labelled poses, twists and wrenches
        must agree on {b}: else :class:`~twistwrench.FrameError`. See :func:`~twistwrench.bodies.flight.fly`.

        >>> from twistwrench import SpatialInertia
        >>> body = RigidBody(SpatialInertia.box((0.1, 0.2, 0.3), mass=1.2))
        >>> flight = body.fly(np.eye(4), [0.01, 5, 0, 0, 0, 1], duration=2, dt=0.01)
        >>> bool(flight.drift.momentum < 1e-13)
        True
        """
        from .flight import fly

        return fly(self.inertia, T0, V0, duration, dt, wrench, order=order, tolerance=tolerance, every=every)

    # ── batches ──

    def _by_rows(self, law: Callable[..., Array], **vectors: ArrayLike) -> Array:
        """Apply ``law(G, *columns)`` to (..., 6) arrays, some thousand rows at a time as contiguous (6, n) columns."""
        arrays = arguments.together(**dict(zip(vectors, numbers(**vectors), strict=True)))
        dtype = np.result_type(*arrays)
        G = self._matrix.astype(dtype)
        shape = arrays[0].shape
        flat = [x.reshape(-1, 6) for x in arrays]
        out = np.empty((len(flat[0]), 6), dtype)
        for i in range(0, len(out), ROWS):
            out[i : i + ROWS] = law(G, *(np.ascontiguousarray(x[i : i + ROWS].T) for x in flat)).T
        return out.reshape(shape)


def _ad_transposed(V: Array, P: Array) -> Array:
    """ad(V)ᵀ P = −(ω × l + v × p, ω × p) on columns (6, n); P = (l, p)."""
    (a, b, c, u, v, w), (k, l, m, p, q, r) = V, P
    out = np.empty_like(P)
    out[0] = l * c - m * b + q * w - r * v
    out[1] = m * a - k * c + r * u - p * w
    out[2] = k * b - l * a + p * v - q * u
    out[3] = q * c - r * b
    out[4] = r * a - p * c
    out[5] = p * b - q * a
    return out
