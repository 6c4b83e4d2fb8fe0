"""Spatial inertia about a body-fixed frame, and momentum-conserving rotation steps. MR sections 8.2.1 and 8.2.2."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, sin, sqrt
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ...core import arguments
from ...core.errors import FrameError, HintedClass, InertiaError, ShapeError, ValueRangeError
from ...core.glossary import complete
from ...core.numbers import number, vector, without_noise
from ...core.typing import Array
from ..lie import so3
from ..lie.labelled import Labelled
from . import consistency, solids
from .solids import moment_matrix, second_moments, ten_parameters

_MAX_ASYMMETRY = 1e-9
"""Largest difference of entries of a tensor that should be equal, relative to its largest entry."""


@dataclass(frozen=True, eq=False, repr=False)
class SpatialInertia(metaclass=HintedClass):
    """Mass, first moment and rotational inertia of a body, about the origin of a frame fixed to it.

    The object has no frame label. Its frame is that of the operand it is used with: the twist in ``G @ V``, the other
    inertia in ``G1 + G2``, ``frame=`` in ``with_payload``. A sum of inertias about two different frames is wrong and raises no
    error; convert one first with :meth:`in_frame`. The constructor does not check physical consistency; :meth:`defects` does.
    ``G @ V`` is the momentum of the body moving with twist V. The parameters may be symbols.

    Examples
    --------
    >>> G = SpatialInertia.from_com(2.0, (0, 0, 0.5), np.diag([0.1, 0.1, 0.02]))
    >>> G
    SpatialInertia: mass 2 kg, com (0, 0, 0.5) m, about the com Ixx, Iyy, Izz = (0.1, 0.1, 0.02) kg m²
    >>> G.mass, G.com.tolist(), round(float(G.moment_about_origin[0, 0]), 6)
    (2.0, [0.0, 0.0, 0.5], 0.6)
    >>> G.principal()[0].round(9).tolist(), G.defects()
    ([0.02, 0.1, 0.1], [])
    """

    parameters: Array
    """Parameters (10,): m, m c (3), Ixx, Ixy, Iyy, Ixz, Iyz, Izz about the frame's origin; kg, kg m, kg m²."""

    __array_ufunc__ = None  # array + inertia raises TypeError instead of broadcasting

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self.parameters.setflags(write=False)  # unpickled arrays are writable

    def __post_init__(self) -> None:
        if getattr(self.parameters, "shape", None) == (6, 6):
            raise ShapeError(
                "SpatialInertia takes ten parameters, got a matrix (6, 6). Write SpatialInertia.from_matrix(G)."
            )
        names = "inertial parameters m, m c, Ixx, Ixy, Iyy, Ixz, Iyz, Izz:"
        pi = np.array(arguments.one(self.parameters, f"{names} the array", 10, symbols=True))
        pi.setflags(write=False)
        object.__setattr__(self, "parameters", pi)

    def __repr__(self) -> str:
        if self.parameters.dtype == object or not np.isfinite(self.parameters).all():
            parameters = ", ".join(map(str, self.parameters))
            return f"SpatialInertia: m, m c, Ixx, Ixy, Iyy, Ixz, Iyz, Izz = ({parameters}) about the origin"
        I = self.moment_about_com
        c = self.com
        scale = float(np.abs(I).max() + self.mass * c @ c)  # of Steiner's terms, which leave rounding errors in I
        moments = without_noise(I.diagonal(), scale)
        products = without_noise(I[[0, 0, 1], [1, 2, 2]], scale)  # Ixy, Ixz, Iyz
        inertia_text = f"Ixx, Iyy, Izz = {vector(moments)}"
        if products.any():
            inertia_text += f", Ixy, Ixz, Iyz = {vector(products)}"
        return f"SpatialInertia: mass {number(self.mass, 6)} kg, com {vector(c)} m, about the com {inertia_text} kg m²"

    def _repr_html_(self) -> str | None:
        if self.parameters.dtype == object:
            return None  # notebooks show repr
        I = self.moment_about_com.tolist()
        title = f"{number(self.mass, 6)} kg, com {vector(self.com)} m; moments of inertia about the com, in kg m²"
        from ...core.tables import html_table

        return html_table(title, ("x", "y", "z"), I)

    # ── constructors ──

    @classmethod
    def from_parameters(cls, pi: ArrayLike) -> SpatialInertia:
        """Spatial inertia from the ten inertial parameters, in the order of :attr:`parameters`.

        Parameters
        ----------
        pi : (10,) array_like, (m, m c (3), Ixx, Ixy, Iyy, Ixz, Iyz, Izz) about the frame's origin [kg, kg m, kg m²]

        Examples
        --------
        >>> SpatialInertia.from_parameters([2, 0, 0, 1, 1, 0, 1, 0, 0, 1]).com.tolist()
        [0.0, 0.0, 0.5]
        """
        return cls(np.asarray(arguments.array(pi, "inertial parameters", 10)))

    @classmethod
    def from_com(
        cls, mass: float, com: ArrayLike = (0.0, 0.0, 0.0), moment_about_com: ArrayLike | None = None
    ) -> SpatialInertia:
        """Spatial inertia from mass, centre of mass and rotational inertia about it, in the frame's axes.

        Parameters
        ----------
        mass : float [kg]
        com : (3,) array_like, centre of mass [m]
        moment_about_com : (3, 3) array_like, optional, rotational inertia [kg m²]; None: a point mass

        Raises
        ------
        InertiaError, ShapeError
            ``moment_about_com`` is not symmetric, or of another size.

        Examples
        --------
        >>> SpatialInertia.from_com(2.0, (0, 0, 0.5)).moment_about_origin.diagonal().tolist()
        [0.5, 0.5, 0.0]
        """
        m = arguments.number(mass, "mass")
        c = arguments.one(com, "com", 3)
        I = np.zeros((3, 3)) if moment_about_com is None else moment_matrix(moment_about_com)
        (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = I.tolist()
        asymmetry = max(abs(xy - yx), abs(xz - zx), abs(yz - zy))
        largest_entry = max(map(abs, (xx, xy, xz, yx, yy, yz, zx, zy, zz)))
        is_symmetric = asymmetry <= _MAX_ASYMMETRY * largest_entry
        if not is_symmetric and np.isfinite(I).all():  # defects() reports values that are not finite
            raise InertiaError(
                f"moment_about_com is not symmetric: entries that should be equal differ by {number(asymmetry, 3)} kg m²."
            )
        x, y, z = c.tolist()
        hx, hy, hz = m * x, m * y, m * z
        if hx or hy or hz:  # Steiner: I_o = I_com - [h] [c], h = m c
            h_hat = np.array([[0.0, -hz, hy], [hz, 0.0, -hx], [-hy, hx, 0.0]])
            c_hat = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
            with np.errstate(over="ignore", invalid="ignore"):
                (sxx, sxy, sxz), (_, syy, syz), (_, _, szz) = (h_hat @ c_hat).tolist()
            xx, yy, zz = xx - sxx, yy - syy, zz - szz
            xy, xz, yz = xy - sxy, xz - sxz, yz - syz
        return cls._from_floats(np.array([m, hx, hy, hz, xx, xy, yy, xz, yz, zz]))

    @classmethod
    def _from_floats(cls, parameters: Array) -> SpatialInertia:
        """Inertia of ten floats, without checks; the array itself is kept, and made read-only."""
        inertia = object.__new__(cls)
        parameters.setflags(write=False)
        object.__setattr__(inertia, "parameters", parameters)
        return inertia

    @classmethod
    def zero(cls) -> SpatialInertia:
        """Zero spatial inertia: no mass and no moments.

        Examples
        --------
        >>> SpatialInertia.zero().mass
        0.0
        """
        return cls._from_floats(np.zeros(10))

    from_points = classmethod(solids.from_points)
    box = classmethod(solids.box)
    sphere = classmethod(solids.sphere)
    cylinder = classmethod(solids.cylinder)
    capsule = classmethod(solids.capsule)
    cone = classmethod(solids.cone)
    ellipsoid = classmethod(solids.ellipsoid)

    @classmethod
    def mesh(
        cls,
        surface: str | Path | tuple[ArrayLike, ArrayLike],
        *,
        mass: float | None = None,
        density: float | None = None,
        scale: float = 1.0,
    ) -> SpatialInertia:
        """Spatial inertia of a uniform solid bounded by a mesh, in the mesh's own frame.

        Parameters
        ----------
        surface : str, Path, or (vertices (n, 3), triangles (k, 3) of vertex numbers)
            File that trimesh reads (extra ``mesh``), or arrays.
        scale : float, metres per unit of the mesh: 0.001 for millimetres

        Raises
        ------
        ModelError
            The surface is not closed; the message gives the position.
        MissingExtraError
            trimesh is not installed and a file has to be read.
        NotFoundError
            The file does not exist.

        Warns
        -----
        ModelWarning
            Shells intersect or coincide, or the size or density is implausible for a robot part.

        Notes
        -----
        Shells are sets of faces connected by edges. The orientation of their faces is ignored: an outer shell bounds a solid,
        a shell inside it a cavity, a shell inside a cavity a solid again. Shells that intersect or coincide each count as
        solids, so that their common volume counts twice.

        Examples
        --------
        >>> from twistwrench import SpatialInertia
        >>> corner = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
        >>> G = SpatialInertia.mesh(corner, density=6.0)
        >>> round(G.mass, 12), G.com.round(12).tolist()
        (1.0, [0.25, 0.25, 0.25])
        """
        from .mesh import mass_com_and_inertia

        return cls.from_com(*mass_com_and_inertia(surface, mass, density, scale))

    from_matrix = classmethod(consistency.from_matrix)
    from_pseudo_inertia = classmethod(consistency.from_pseudo_inertia)
    from_log_cholesky = classmethod(consistency.from_log_cholesky)

    # ── properties ──

    log_cholesky = consistency.log_cholesky

    @property
    def mass(self) -> Any:
        """Mass [kg]."""
        return self.parameters.item(0)

    @property
    def first_moment(self) -> Array:
        """Mass times centre of mass (3,) [kg m]."""
        return self.parameters[1:4]

    @property
    def com(self) -> Array:
        """Centre of mass (3,) [m]; the origin if the mass is zero."""
        return self.first_moment / self.mass if self.mass else np.zeros(3)

    @property
    def moment_about_origin(self) -> Array:
        """Rotational inertia (3, 3) about the frame's origin [kg m²]."""
        xx, xy, yy, xz, yz, zz = self.parameters[4:]
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])

    @property
    def moment_about_com(self) -> Array:
        """Rotational inertia (3, 3) about the centre of mass, in the frame's axes [kg m²]."""
        C = so3.hat(self.com)
        return self.moment_about_origin + self.mass * C @ C  # Steiner: I_com = I_o + m [c]²

    @property
    def matrix(self) -> Array:
        """Spatial inertia matrix G (6, 6) in F = G dV - ad(V)' G V, about the origin, angular part first [kg m², kg m, kg]."""
        h = so3.hat(self.first_moment)
        return np.block([[self.moment_about_origin, h], [-h, self.mass * np.eye(3)]])

    @property
    def second_moment(self) -> Array:
        """Matrix of second moments (3, 3), ∫ r r' dm = ½ tr(I) 1 - I [kg m²]."""
        return second_moments(self.moment_about_origin)

    @property
    def pseudo_inertia(self) -> Array:
        """Matrix ∫ [r; 1] [r; 1]' dm (4, 4); positive definite exactly if a real body has it."""
        h = self.first_moment
        return np.block([[self.second_moment, h[:, None]], [h[None, :], np.full((1, 1), self.mass)]])

    def principal(self) -> tuple[Array, Array]:
        """Principal moments of inertia about the centre of mass, ascending, and their axes.

        Axes of repeated moments are aligned with the frame's axes; those of a ball equal them.

        Returns
        -------
        moments : (3,) array [kg m²]
        axes : (3, 3) array, a rotation whose columns are the axes

        Raises
        ------
        InertiaError
            The inertia is not finite.
        """
        if not np.isfinite(self.parameters).all():
            first_defect, *_ = self.defects()
            raise InertiaError(f"this inertia has no principal axes: it {first_defect}.")
        moments, axes = np.linalg.eigh(self.moment_about_com)
        return moments, consistency.principal_axes(moments, axes)

    # ── change of frame, sums ──

    def in_frame(self, T_ab: ArrayLike) -> SpatialInertia:
        """Inertia of the same body in another frame {a}, given this one in {b}.

        G_a = Ad(T_ba)' G_b Ad(T_ba), MR eq. 8.42. By blocks, with T_ab = (R, p), h and I rotated to the axes of {a}, and
        u = h + ½ m p, the first moment becomes h + m p, and I becomes I + 2 (u·p) 1 - u p' - p u'.

        Parameters
        ----------
        T_ab : (4, 4) array_like, pose of {b} seen from {a}

        Returns
        -------
        G_a : SpatialInertia

        Examples
        --------
        >>> T = np.eye(4)
        >>> T[:3, 3] = 0, 0, 1
        >>> SpatialInertia.sphere(0.1, mass=2).in_frame(T).com.tolist()
        [0.0, 0.0, 1.0]
        """
        T = arguments.pose(arguments.one(T_ab, "T_ab", 4, 4, symbols=True), "T_ab")
        R, p, m = T[:3, :3], T[:3, 3], self.mass
        h = R @ self.first_moment
        I = R @ self.moment_about_origin @ R.T
        u = h + 0.5 * m * p
        d = 2.0 * (u @ p)
        # I + d 1 - u p' - p u', entry by entry: for three numbers this is faster than NumPy operations.
        (x, y, z), (ux, uy, uz) = p.tolist(), u.tolist()
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = I.tolist()
        moments = [
            xx + d - ux * x - x * ux, xy - ux * y - x * uy, yy + d - uy * y - y * uy,
            xz - ux * z - x * uz, yz - uy * z - y * uz, zz + d - uz * z - z * uz,
        ]  # fmt: skip
        parameters = [m, *(h + m * p).tolist(), *moments]
        if I.dtype == np.float64:
            return SpatialInertia._from_floats(np.array(parameters))
        return SpatialInertia.from_parameters(parameters)

    def turned(self, k: int, angle: Any) -> SpatialInertia:
        """Inertia of the body rotated about a coordinate axis, in the same frame.

        Parameters
        ----------
        k : int, axis: 0, 1 or 2
        angle : float or symbols, angle [rad], or pair of its cosine and sine

        Notes
        -----
        For a rotation about z with cosine c and sine s, let e = s (I_xx - I_yy) + 2 c I_xy. The new entries are I_xx - s e,
        I_yy + s e and c e - I_xy for the product xy. All takes eight multiplications; R I R' would take eighteen. For other
        axes k, z stands for k, x and y for the next axes in cyclic order.

        Examples
        --------
        >>> SpatialInertia.box((1, 2, 3), mass=12).turned(2, np.pi / 2).moment_about_com.diagonal().round(9).tolist()
        [10.0, 13.0, 5.0]
        """
        if k not in (0, 1, 2):
            raise ValueRangeError(f"no coordinate axis {k!r}; choose 0, 1 or 2.")
        arguments.one(angle, "angle", symbols=True)
        x, y, z = (k + 1) % 3, (k + 2) % 3, k
        s = np.sin(angle)
        c = np.cos(angle)
        h = self.first_moment.astype(object)
        h_x = c * h[x] - s * h[y]
        h_y = s * h[x] + c * h[y]
        h[x] = h_x
        h[y] = h_y
        I = self.moment_about_origin.astype(object)
        e = s * (I[x, x] - I[y, y]) + c * (I[x, y] + I[x, y])
        xz = c * I[x, z] - s * I[y, z]
        yz = s * I[x, z] + c * I[y, z]
        I[x, x] = I[x, x] - s * e
        I[y, y] = I[y, y] + s * e
        I[x, y] = I[y, x] = c * e - I[x, y]
        I[x, z] = I[z, x] = xz
        I[y, z] = I[z, y] = yz
        return SpatialInertia.from_parameters(ten_parameters(self.mass, h, I))

    def __matmul__(self, V: ArrayLike) -> Array:
        """Momentum (..., 6) of the body with twist V (..., 6): (I w + h × v, m v - h × w).

        A labelled twist raises :class:`~twistwrench.FrameError`, because an inertia has no frame to compare.
        """
        if isinstance(V, Labelled):
            raise FrameError(
                f"SpatialInertia @ {V.symbol}: an inertia names no frame, so that of {V.symbol} cannot be checked. If the "
                f"inertia is about the origin of {V.frame!r}, write G @ {V.symbol}.values."
            )
        V = arguments.array(V, "V", 6)
        w, v, h = V[..., :3], V[..., 3:], self.first_moment
        angular = w @ self.moment_about_origin + so3.cross(h, v)  # w'I = (I w)', since I is symmetric
        linear = self.mass * v - so3.cross(h, w)
        return np.concatenate([angular, linear], axis=-1)

    def __add__(self, other: SpatialInertia) -> SpatialInertia:
        return SpatialInertia.from_parameters(self.parameters + self._parameters_of(other, "+"))

    def __radd__(self, other: Any) -> SpatialInertia:
        if np.ndim(other) == 0 and not isinstance(other, str) and other == 0:  # for sum()
            return self
        raise InertiaError(f"{type(other).__name__} + SpatialInertia: an inertia goes with another SpatialInertia.")

    def __sub__(self, other: SpatialInertia) -> SpatialInertia:
        return SpatialInertia.from_parameters(self.parameters - self._parameters_of(other, "-"))

    @staticmethod
    def _parameters_of(other: Any, sign: str) -> Array:
        """Parameters (10,) of the other operand of + or -; raises InertiaError if it is not an inertia."""
        if not isinstance(other, SpatialInertia):
            raise InertiaError(
                f"SpatialInertia {sign} {type(other).__name__}: an inertia goes with another SpatialInertia."
            )
        return other.parameters

    # ── physical consistency ──

    defects = consistency.defects
    nearest_consistent = consistency.nearest_consistent
    repair = consistency.repair


if not TYPE_CHECKING:  # type checkers have the signature of the fields
    SpatialInertia.__init__ = arguments.hint_if_misused(
        "SpatialInertia takes an array of ten parameters; of mass, centre and moments: tw.SpatialInertia.from_com(1, com, I)"
    )(SpatialInertia.__init__)


# ── Momentum-conserving steps of free rotation about the centre of mass

# In principal axes, with the body momentum m = (m1, m2, m3) and the middle moment I2, the rotational energy is split into
#
#     K = |m|²/(2 I2) + ½ (1/I1 - 1/I2) m1² + ½ (1/I3 - 1/I2) m3².
#
# The motion of each part alone has an exact solution. The first part rotates the body about the constant momentum, the second
# about body axis 1, the third about body axis 3. The first commutes with the others, which are composed symmetrically. So every
# step is a product of exact motions, each of which conserves the spatial momentum. The composition is symplectic and symmetric,
# so the energy error is bounded for exponentially long times. A body with two equal moments moves exactly: one of the last two
# parts is zero, and the two that remain commute. Sources: McLachlan,
# "Explicit Lie-Poisson integration and the Euler equations", PRL 71, 1993; Fassò, "Comparison of splitting algorithms for the
# rigid body", J. Comput. Phys. 189, 2003; Hairer, Lubich and Wanner, Geometric Numerical Integration, VII.5.3 and V.3.
#
# Plain floats, because a step is too short for arrays: a step of order 4 takes a few microseconds.

Quat = tuple[float, float, float, float]
"""Unit quaternion, scalar first."""
Vec = tuple[float, float, float]

_SUZUKI = 1.0 / (4.0 - 4.0 ** (1.0 / 3.0))
"""Fraction of four of the five parts of a step of order 4."""
_KAHAN_LI = (0.39216144400731413928, 0.33259913678935943860, -0.70624617255763935981, 0.08221359629355080023)
"""Fractions of the first four of the nine parts of a step of order 6."""

COMPOSITIONS: dict[int, tuple[float, ...]] = {
    2: (1.0,),
    4: (_SUZUKI, _SUZUKI, 1.0 - 4.0 * _SUZUKI, _SUZUKI, _SUZUKI),  # Suzuki, 1990
    6: (*_KAHAN_LI, 1.0 - 2.0 * sum(_KAHAN_LI), *reversed(_KAHAN_LI)),  # Kahan and Li, 1997
}
"""Fractions of a step, per order: symmetric, with sum 1, and zero sums of the odd powers below the order."""


def body_momentum(q: Quat, l: Vec) -> Vec:
    """R(q)ᵀ l = l + w t + t × v with t = 2 l × v, for a unit quaternion q = (w, v)."""
    w, x, y, z = q
    lx, ly, lz = l
    tx, ty, tz = 2.0 * (ly * z - lz * y), 2.0 * (lz * x - lx * z), 2.0 * (lx * y - ly * x)
    return lx + w * tx + ty * z - tz * y, ly + w * ty + tz * x - tx * z, lz + w * tz + tx * y - ty * x


@dataclass(frozen=True)
class SplitRotor:
    """Body rotating about its centre of mass, with the factors of the three parts of K in 1/(kg m²)."""

    middle: float
    """1/I2."""
    first: float
    """1/I1 - 1/I2."""
    third: float
    """1/I3 - 1/I2."""

    @classmethod
    def from_moments(cls, moments: Vec) -> SplitRotor:
        """Rotor from principal moments, ascending."""
        first, middle, third = (1.0 / moment for moment in moments)
        return cls(middle, first - middle, third - middle)

    def schedule(self, h: float, fractions: tuple[float, ...]) -> tuple[list[tuple[float, float]], float]:
        """Factors of the alternating rotations about axes 1 and 3 in a step ``h``, and of the last rotation about axis 1.

        A factor times the momentum about its axis is half the angle. Each fraction f of the step rotates by f/2 about axis 1,
        by f about axis 3, and by f/2 about axis 1; neighbouring rotations about axis 1 are merged.
        """
        first_factor = 0.25 * h * self.first  # for half of the step
        third_factor = 0.5 * h * self.third
        previous_fractions = (0.0, *fractions)
        factors = []
        for previous, fraction in zip(previous_fractions, fractions, strict=False):  # the last fraction precedes none
            factors.append((first_factor * (previous + fraction), third_factor * fraction))
        return factors, first_factor * fractions[-1]

    def step(self, q: Quat, l: Vec, h: float, turns: list[tuple[float, float]], last_turn: float) -> Quat:
        """Quaternion after a step ``h``; ``l`` is the spatial angular momentum, which is constant.

        ``turns`` and ``last_turn`` are the factors of :meth:`schedule`.
        """
        w, x, y, z = q
        m1, m2, m3 = body_momentum(q, l)
        for first_turn, third_turn in turns:
            s, c = sin(first_turn * m1), cos(first_turn * m1)  # about axis 1, of half the angle
            w, x, y, z = w * c - x * s, x * c + w * s, y * c + z * s, z * c - y * s
            s, c = 2.0 * s * c, 1.0 - 2.0 * s * s  # of the angle
            m2, m3 = m2 * c + m3 * s, m3 * c - m2 * s
            s, c = sin(third_turn * m3), cos(third_turn * m3)  # about axis 3
            w, x, y, z = w * c - z * s, x * c + y * s, y * c - x * s, z * c + w * s
            s, c = 2.0 * s * c, 1.0 - 2.0 * s * s
            m1, m2 = m1 * c + m2 * s, m2 * c - m1 * s
        s, c = sin(last_turn * m1), cos(last_turn * m1)
        w, x, y, z = w * c - x * s, x * c + w * s, y * c + z * s, z * c - y * s

        # Rotation about the momentum, by the first part of K: the quaternion (c, i, j, k) times q.
        lx, ly, lz = l
        size = sqrt(lx * lx + ly * ly + lz * lz)
        if size == 0.0:
            return q
        half_angle = 0.5 * h * self.middle * size
        s, c = sin(half_angle) / size, cos(half_angle)
        i, j, k = lx * s, ly * s, lz * s
        w, x, y, z = (
            c * w - i * x - j * y - k * z,
            c * x + i * w + j * z - k * y,
            c * y - i * z + j * w + k * x,
            c * z + i * y - j * x + k * w,
        )
        # 1/|q| to first order in |q|² - 1, which is a rounding error
        scale = 1.5 - 0.5 * (w * w + x * x + y * y + z * z)
        return scale * w, scale * x, scale * y, scale * z


complete(globals())
