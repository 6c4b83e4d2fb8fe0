"""Second moments of mass, point masses and uniform solids.

The second moments are S = ∫ r r' dm, the rotational inertia is I = tr(S) 1 - S, (3, 3) each. A real body has this I if S has no
negative eigenvalue.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ...core import arguments
from ...core.errors import ShapeError, ValueRangeError
from ...core.glossary import complete
from ...core.numbers import printed
from ...core.typing import Array

if TYPE_CHECKING:
    from .inertia import SpatialInertia


def ten_parameters(m: Any, h: Any, I: Array) -> list[Any]:
    """Inertial parameters (10) from mass m, first moment h (3,) and rotational inertia I (3, 3) about one origin."""
    return [m, *h, I[0, 0], I[0, 1], I[1, 1], I[0, 2], I[1, 2], I[2, 2]]


def second_moments(I: Array) -> Array:
    """S = ½ tr(I) 1 - I."""
    return np.asarray(0.5 * I.trace() * np.eye(3) - I)


def rotational_inertia(S: Array) -> Array:
    """I = tr(S) 1 - S."""
    return np.asarray(S.trace() * np.eye(3) - S)


def clip_eigenvalues(S: Array, least: float = 0.0) -> Array:
    """Nearest S in the Frobenius norm with eigenvalues of at least ``least`` times the largest absolute eigenvalue."""
    values, axes = np.linalg.eigh(S)
    min_value = least * np.abs(values).max()
    return np.asarray(axes * np.maximum(values, min_value) @ axes.T)


def moment_matrix(I: ArrayLike) -> Array:
    """Validated rotational inertia (3, 3). For three numbers, the error message shows how to make a diagonal matrix."""
    try:
        return arguments.one(I, "moment_about_com", 3, 3)
    except ShapeError as problem:
        try:
            is_three_numbers = np.shape(I) == (3,)
        except ValueError:  # rows of different lengths
            is_three_numbers = False
        hint = ""
        if is_three_numbers:
            hint = " Three moments about the axes are np.diag(…) of them."
        raise ShapeError(f"{problem}{hint}") from None


# ── Point masses and uniform solids

# Each function is a named constructor of :class:`~twistwrench.SpatialInertia`, used there as a class method. All solids except
# the mesh are centred: the frame's origin is the centre of mass, the axes are principal, and a symmetry axis is z.
# Moments of the solids: Lynch and Park, Modern Robotics, figure 8.5, and any table of mechanics.


def from_points(cls: type[SpatialInertia], masses: ArrayLike, points: ArrayLike) -> SpatialInertia:
    """Spatial inertia of point masses, about the frame's origin: I = -Σ m_i [r_i]².

    MR section 8.2.1.

    Parameters
    ----------
    masses : (n,) array_like [kg]
    points : (n, 3) array_like [m]

    Examples
    --------
    >>> from twistwrench import SpatialInertia
    >>> G = SpatialInertia.from_points([1.0, 3.0], [[0, 0, 1], [0, 0, -1]])
    >>> G.mass, G.com.tolist(), G.moment_about_origin.diagonal().tolist()
    (4.0, [0.0, 0.0, -0.5], [4.0, 4.0, 0.0])
    """
    m = np.asarray(arguments.real(masses, "masses"), float)
    r = np.asarray(arguments.real(points, "points"), float)
    if m.ndim != 1 or r.shape != (m.size, 3):
        raise ShapeError(f"masses have shape {m.shape} and points {r.shape}, expected (n,) and (n, 3).")
    is_valid = (m >= 0) & (m < np.inf) & np.isfinite(r).all(axis=1)
    if not is_valid.all():
        i = int(np.argmin(is_valid))  # the first that is not valid
        raise ValueRangeError(
            f"point {i}, mass {printed(m[i])} kg at {r[i]}, must be finite with a mass of at least 0."
        )
    S = (m * r.T) @ r  # Σ m_i r_i r_i'
    I = rotational_inertia(S)  # -[r]² = r'r 1 - r r'
    return cls.from_parameters(ten_parameters(m.sum(), m @ r, I))


def box(
    cls: type[SpatialInertia], size: ArrayLike, *, mass: float | None = None, density: float | None = None
) -> SpatialInertia:
    """Spatial inertia of a uniform box; the origin is its centre.

    Parameters
    ----------
    size : (3,) array_like, full edge lengths along x, y, z [m]

    Examples
    --------
    >>> from twistwrench import SpatialInertia
    >>> SpatialInertia.box((1, 2, 3), mass=12).moment_about_com.diagonal().tolist()
    [13.0, 10.0, 5.0]
    """
    edges = _lengths("size", size, 3)
    volume = float(edges.prod())
    moments = (edges @ edges - edges**2) / 12.0  # about x: (y² + z²)/12
    return _solid_about_centre(cls, "box", volume, moments, mass, density)


def ellipsoid(
    cls: type[SpatialInertia], semi_axes: ArrayLike, *, mass: float | None = None, density: float | None = None
) -> SpatialInertia:
    """Spatial inertia of a uniform ellipsoid; the origin is its centre.

    Parameters
    ----------
    semi_axes : (3,) array_like, along x, y, z [m]

    Examples
    --------
    >>> from twistwrench import SpatialInertia
    >>> SpatialInertia.ellipsoid((1, 2, 3), mass=5).moment_about_com.diagonal().tolist()
    [13.0, 10.0, 5.0]
    """
    lengths = _lengths("semi_axes", semi_axes, 3)
    volume = 4.0 / 3.0 * np.pi * float(lengths.prod())
    moments = (lengths @ lengths - lengths**2) / 5.0  # about x: (y² + z²)/5
    return _solid_about_centre(cls, "ellipsoid", volume, moments, mass, density)


def sphere(
    cls: type[SpatialInertia], radius: float, *, mass: float | None = None, density: float | None = None
) -> SpatialInertia:
    """Spatial inertia of a uniform ball; the origin is its centre.

    Examples
    --------
    >>> from twistwrench import SpatialInertia
    >>> SpatialInertia.sphere(1.0, mass=5.0).moment_about_com.diagonal().tolist()
    [2.0, 2.0, 2.0]
    """
    (r,) = _lengths("radius", radius, 1)
    return ellipsoid(cls, (r, r, r), mass=mass, density=density)


def cylinder(
    cls: type[SpatialInertia], radius: float, length: float, *, mass: float | None = None, density: float | None = None
) -> SpatialInertia:
    """Spatial inertia of a uniform cylinder along z; the origin is its centre.

    Examples
    --------
    >>> from twistwrench import SpatialInertia
    >>> SpatialInertia.cylinder(2.0, 6.0, mass=1.0).moment_about_com.diagonal().tolist()
    [4.0, 4.0, 2.0]
    """
    (r,) = _lengths("radius", radius, 1)
    (h,) = _lengths("length", length, 1)
    across = r * r / 4.0 + h * h / 12.0  # about x and y
    along = r * r / 2.0  # about z
    volume = np.pi * r * r * h
    return _solid_about_centre(cls, "cylinder", volume, (across, across, along), mass, density)


def capsule(
    cls: type[SpatialInertia], radius: float, length: float, *, mass: float | None = None, density: float | None = None
) -> SpatialInertia:
    """Spatial inertia of a uniform capsule, a cylinder along z with hemispherical ends; the origin is its centre.

    Parameters
    ----------
    length : float, of the cylinder [m]; the total length is length + 2 radius

    Examples
    --------
    >>> from twistwrench import SpatialInertia
    >>> ball, pill = SpatialInertia.sphere(0.1, density=1e3), SpatialInertia.capsule(0.1, 1e-12, density=1e3)
    >>> bool(np.allclose(ball.parameters, pill.parameters))
    True
    """
    (r,) = _lengths("radius", radius, 1)
    (h,) = _lengths("length", length, 1)
    tube = np.pi * r * r * h  # volume of the cylinder
    ball = 4.0 / 3.0 * np.pi * r**3  # volume of both hemispheres together
    # A hemisphere's centre of mass is 3r/8 above its flat face, and the face is h/2 above the origin. The moment per volume is
    # 2/5 r² about the face's centre. By Steiner's theorem, it grows by (h/2 + 3r/8)² - (3r/8)² = h²/4 + 3/8 h r.
    across = tube * (r * r / 4.0 + h * h / 12.0) + ball * (2.0 / 5.0 * r * r + h * h / 4.0 + 3.0 / 8.0 * h * r)
    along = tube * r * r / 2.0 + ball * 2.0 / 5.0 * r * r
    volume = tube + ball
    moments = np.array([across, across, along]) / volume
    return _solid_about_centre(cls, "capsule", volume, moments, mass, density)


def cone(
    cls: type[SpatialInertia], radius: float, height: float, *, mass: float | None = None, density: float | None = None
) -> SpatialInertia:
    """Spatial inertia of a uniform cone whose tip points along +z.

    The origin is its centre of mass, height/4 above the base, not the base itself.

    Parameters
    ----------
    radius : float, of the base [m]
    height : float [m]

    Examples
    --------
    >>> from twistwrench import SpatialInertia
    >>> SpatialInertia.cone(2.0, 4.0, mass=10.0).moment_about_com.diagonal().tolist()
    [12.0, 12.0, 12.0]
    """
    (r,) = _lengths("radius", radius, 1)
    (h,) = _lengths("height", height, 1)
    across = 3.0 / 20.0 * r * r + 3.0 / 80.0 * h * h  # about x and y
    along = 3.0 / 10.0 * r * r  # about z
    volume = np.pi / 3.0 * r * r * h
    return _solid_about_centre(cls, "cone", volume, (across, across, along), mass, density)


_MIN_LENGTH = 1e-100  # [m]
_MAX_LENGTH = 1e100  # [m]


def total_mass(shape: str, volume: float, mass: float | None, density: float | None) -> float:
    """Mass [kg] of ``volume`` [m³] from exactly one of mass and density, both positive and finite."""
    if (mass is None) == (density is None):
        given = "neither" if mass is None else "both"
        raise ValueRangeError(f"{shape}: give mass= [kg] or density= [kg/m³], exactly one of them; got {given}.")
    if mass is not None:
        return _positive_number(mass, f"{shape}: mass")
    return _positive_number(density, f"{shape}: density") * volume


def _positive_number(x: Any, name: str) -> float:
    """Validated number above zero; ``name`` is for messages."""
    value = arguments.number(x, name)
    if not 0.0 < value < np.inf:
        raise ValueRangeError(f"{name} is {value}, and must be positive and finite.")
    return value


def _lengths(name: str, value: ArrayLike, count: int) -> Array:
    """Validated lengths (count,), in the range where squares and products neither overflow nor underflow."""
    if count > 1:
        lengths = arguments.one(value, name, count)
    else:
        lengths = np.array([arguments.number(value, name)])
    is_in_range = (lengths >= _MIN_LENGTH) & (lengths <= _MAX_LENGTH)
    if not is_in_range.all():
        text = lengths.tolist() if count > 1 else lengths[0]
        raise ValueRangeError(f"{name} is {text}; lengths must be positive and finite, 1e-100 to 1e100 m.")
    return lengths


def _solid_about_centre(
    cls: type[SpatialInertia], shape: str, volume: float, moments: ArrayLike, mass: float | None, density: float | None
) -> SpatialInertia:
    """Solid about its centre, from its principal moments (3,) per unit mass [m²]."""
    m = total_mass(shape, float(volume), mass, density)
    unit_I = np.diag(np.asarray(moments, float))
    return cls.from_com(m, moment_about_com=m * unit_I)


complete(globals())
