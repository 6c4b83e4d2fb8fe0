"""Physical consistency of inertias: checks, nearest consistent inertia, and parametrisations of the ten parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ...core import arguments
from ...core.errors import InertiaError, ValueRangeError
from ...core.glossary import complete
from ...core.numbers import number, percent, printed
from ...core.typing import Array
from ..lie import so3
from .solids import clip_eigenvalues, rotational_inertia, second_moments, ten_parameters

if TYPE_CHECKING:
    from .inertia import SpatialInertia


def defects(G: SpatialInertia, *, size: float = 0.0) -> list[str]:
    """Physical consistency: the reasons, with amounts, why no real body has this inertia.

    Parameters
    ----------
    size : float, size of the moments [kg m²] of which this inertia is a difference
        Rounding errors of that size, such as after a change of frame, are not defects.

    Returns
    -------
    reasons : list of str, empty if a real body can have this inertia

    Notes
    -----
    Conditions: finite; mass ≥ 0; about the centre of mass positive semidefinite; principal moments obey the triangle
    inequality. The tolerance is 1e-6 of the sum of the moments.
    """
    if not np.isfinite(G.parameters).all():
        return ["has a value that is not a finite number"]
    if G.mass < 0:
        return [f"negative mass {printed(G.mass)} kg"]
    if G.mass == 0:
        if np.any(G.parameters != 0):
            return ["zero mass but nonzero inertia or first moment"]
        return []
    A, B, C = (float(x) for x in G.principal()[0])
    # Rounding error of moments about a distant origin, when moved to the centre of mass.
    slack = 1e-6 * abs(A + B + C) + 2e-15 * max(size, abs(float(G.moment_about_origin.trace())))
    problems = []
    if -slack > A:
        problems.append(
            f"negative principal moment {number(A, 6)} kg m² (moments {number(A, 6)}, {number(B, 6)}, {number(C, 6)})"
        )
    if A + B + slack < C:
        problems.append(
            f"triangle inequality: the largest principal moment {number(C, 6)} kg m² exceeds the sum of the others, "
            f"{number(A, 6)} + {number(B, 6)}, by {number(C - A - B, 3)}"
        )
    return problems


def nearest_consistent(G: SpatialInertia) -> SpatialInertia:
    """Nearest inertia a real body can have: same mass and centre of mass, second moments clipped at zero.

    Nearest in the Frobenius norm of the second moments about the centre of mass.

    Raises
    ------
    InertiaError
        The mass is negative; no consistent inertia is near.

    Examples
    --------
    >>> from twistwrench import SpatialInertia
    >>> bad = SpatialInertia.from_com(2.0, moment_about_com=np.diag([1.0, 1.0, 3.0]))
    >>> bad.nearest_consistent().moment_about_com.diagonal().tolist()
    [1.5, 1.5, 3.0]
    """
    if not np.isfinite(G.parameters).all() or G.mass < 0:
        raise InertiaError(f"this inertia has no consistent one nearby: {'; '.join(G.defects())}.")
    if G.mass == 0:
        return type(G).zero()
    S = clip_eigenvalues(second_moments(G.moment_about_com))
    return type(G).from_com(G.mass, G.com, rotational_inertia(S))


def repair(G: SpatialInertia) -> Repair:
    """Repaired inertia, :meth:`nearest_consistent`, with a report of the changes and reasons.

    Returns
    -------
    repair : Repair

    Raises
    ------
    InertiaError
        The mass is negative.

    Examples
    --------
    >>> from twistwrench import SpatialInertia
    >>> bad = SpatialInertia.from_com(2.0, moment_about_com=np.diag([1.0, 1.0, 3.0]))
    >>> round(bad.repair().largest, 3)
    0.167
    """
    return Repair(G, G.nearest_consistent())


@dataclass(frozen=True, eq=False)
class Repair:
    """Changes made by :meth:`SpatialInertia.nearest_consistent`; ``print`` it for a description.

    Examples
    --------
    >>> from twistwrench import SpatialInertia
    >>> print(SpatialInertia.from_com(2.0, moment_about_com=np.diag([1.0, 1.0, 3.0])).repair())
    triangle inequality: the largest principal moment 3 kg m² exceeds the sum of the others, 1 + 1, by 1
      principal moments  1, 1, 3  →  1.5, 1.5, 3 kg m²
      largest change     0.5 kg m², 16.7 % of the largest moment
    """

    before: SpatialInertia
    """Inertia before the repair."""
    after: SpatialInertia
    """Nearest inertia that a real body can have."""

    @property
    def reasons(self) -> list[str]:
        """Violated conditions."""
        return self.before.defects()

    @property
    def moved(self) -> Array:
        """Change of the moment about the centre of mass (3, 3) [kg m²]; mass and centre of mass are kept."""
        return self.after.moment_about_com - self.before.moment_about_com

    @property
    def largest(self) -> float:
        """Largest change of a moment, relative to the largest moment before."""
        size = float(np.abs(self.before.principal()[0]).max())
        return float(np.abs(np.linalg.eigvalsh(self.moved)).max()) / size if size else 0.0

    def __str__(self) -> str:
        if not self.reasons:
            return "nothing to repair"
        before, after = _moments_text(self.before), _moments_text(self.after)
        change = np.abs(np.linalg.eigvalsh(self.moved)).max()
        return "\n".join(
            [
                *self.reasons,
                f"  principal moments  {before}  →  {after} kg m²",
                f"  largest change     {number(change, 6)} kg m², {percent(self.largest, 3)} of the largest moment",
            ]
        )


def _moments_text(G: SpatialInertia) -> str:
    return ", ".join(number(x, 6) for x in G.principal()[0] + 0.0)


# ── Parametrisations of the ten parameters

# The pseudo-inertia J = ∫ [r; 1] [r; 1]' dm is positive definite exactly if a real body has the inertia (Wensing, Kim and
# Slotine, 2018). Its Cholesky factor with logarithms on the diagonal has ten parameters, and *every* choice is a real body, as
# optimisers and estimators need (Rucker and Wensing, "Smooth parameterization of rigid-body inertia", RA-L 7(2), 2022).

_MAX_GYRATION_RADIUS = 100.0
"""Radius of gyration [m] above which a matrix is taken to have its linear part first, of a body below a centimetre. The
matrix of a ball or cube alone does not show the order."""


def from_matrix(cls: type[SpatialInertia], G: ArrayLike) -> SpatialInertia:
    """Spatial inertia from the 6×6 matrix of the book, [[I, m[c]], [-m[c], m 1]].

    MR eq. 8.32. A radius of gyration above 100 m is rejected.

    Parameters
    ----------
    G : (6, 6) array_like, about the frame's origin, angular part first

    Raises
    ------
    InertiaError
        The matrix does not have that form, within a relative tolerance of 1e-6 for each block.

    Examples
    --------
    >>> from twistwrench import SpatialInertia
    >>> SpatialInertia.from_matrix(np.diag([1, 1, 1, 2, 2, 2])).mass
    2.0
    """
    G = arguments.one(G, "a spatial inertia matrix", 6, 6)
    if not np.isfinite(G).all():
        raise InertiaError("no spatial inertia [[I, m[c]], [-m[c], m 1]]: an entry is not a finite number.")
    h = so3.vee(0.5 * (G[:3, 3:] - G[:3, 3:].T))
    I = 0.5 * (G[:3, :3] + G[:3, :3].T)
    inertia = cls.from_parameters(ten_parameters(G[3:, 3:].trace() / 3, h, I))
    # Tolerances per unit: kg m² and kg differ by a factor of a million for a body of a millimetre.
    moment, mass = float(np.abs(G[:3, :3]).max()), float(np.abs(G[3:, 3:]).max())
    root = np.sqrt(np.repeat([moment, mass], 3))
    gap = np.abs(inertia.matrix - G)
    if not (gap <= 1e-6 * np.outer(root, root)).all():
        raise InertiaError(
            "no spatial inertia [[I, m[c]], [-m[c], m 1]], angular part first: the matrix is off by "
            f"{printed(gap.max(), 3)}. Is its linear part first? Then swap the blocks."
        )
    if moment > _MAX_GYRATION_RADIUS**2 * mass > 0:
        raise InertiaError(
            f"read with the angular part first, this spatial inertia is of {printed(inertia.mass, 3)} kg spread over "
            f"{printed(np.sqrt(moment / mass), 3)} m. Is its linear part first? Then swap the blocks. A body so large is "
            "described by from_com."
        )
    return inertia


def from_pseudo_inertia(cls: type[SpatialInertia], J: ArrayLike) -> SpatialInertia:
    """Spatial inertia from the pseudo-inertia [[∫ r r' dm, m c], [m c', m]].

    The inverse of :attr:`SpatialInertia.pseudo_inertia`.

    Parameters
    ----------
    J : (4, 4) array_like [kg m², kg m, kg]

    Examples
    --------
    >>> from twistwrench import SpatialInertia
    >>> G = SpatialInertia.box((1, 2, 3), mass=12)
    >>> bool(np.allclose(SpatialInertia.from_pseudo_inertia(G.pseudo_inertia).parameters, G.parameters))
    True
    """
    P = arguments.one(J, "a pseudo-inertia", 4, 4)
    P = 0.5 * (P + P.T)
    I = rotational_inertia(P[:3, :3])
    return cls.from_parameters(ten_parameters(P[3, 3], P[:3, 3], I))


def log_cholesky(G: SpatialInertia) -> Array:
    """Log-Cholesky parameters of an inertia, ten numbers with J = U U' for the pseudo-inertia J.

    U is that of Rucker and Wensing eq. 9.

    Returns
    -------
    theta : (10,) array, (α, d1, d2, d3, s12, s23, s13, t1, t2, t3)
        The mass is exp(2α), t the centre of mass [m].

    Raises
    ------
    InertiaError
        The body is impossible, or has no extent in some direction (a point, a rod, a plate without thickness).

    Examples
    --------
    >>> from twistwrench import SpatialInertia
    >>> SpatialInertia.from_com(1.0, (1, 2, 3), 2 * np.eye(3)).log_cholesky().tolist()
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 2.0, 3.0]
    """
    m, I = float(G.mass), G.moment_about_com
    problem = "; ".join(G.defects()) or ("" if m > 0 else "it has no mass")
    S = np.zeros((3, 3)) if problem else second_moments(I) / m
    try:
        U = np.linalg.cholesky(S[::-1, ::-1])[::-1, ::-1]  # upper triangular: S = U U'
    except np.linalg.LinAlgError:
        problem = problem or "it has no extent in some direction"
        raise InertiaError(
            f"this inertia has no log-Cholesky parameters: {problem}. Try nearest_consistent() first."
        ) from None
    return np.array([0.5 * np.log(m), *np.log(U.diagonal()), U[0, 1], U[1, 2], U[0, 2], *G.com])


def from_log_cholesky(cls: type[SpatialInertia], theta: ArrayLike) -> SpatialInertia:
    """Spatial inertia from log-Cholesky parameters; any ten finite numbers give a physically consistent body.

    Parameters
    ----------
    theta : (10,) array_like, in the order of :meth:`SpatialInertia.log_cholesky`

    Examples
    --------
    >>> from twistwrench import SpatialInertia
    >>> SpatialInertia.from_log_cholesky(np.linspace(-1, 2, 10)).defects()
    []
    """
    x = arguments.one(theta, "log-Cholesky parameters", 10)
    if not np.isfinite(x).all():
        raise ValueRangeError(f"log-Cholesky parameters must be finite, got {x}.")
    alpha, d1, d2, d3, s12, s23, s13, *t = x.tolist()
    with np.errstate(over="ignore", invalid="ignore"):
        m = np.exp(2.0 * alpha)
        U = np.array([[np.exp(d1), s12, s13], [0.0, np.exp(d2), s23], [0.0, 0.0, np.exp(d3)]])
        S = m * U @ U.T
    if not np.isfinite([m, S.trace()]).all():
        raise ValueRangeError(f"log-Cholesky parameters overflow: mass exp(2 α) = {printed(m, 3)} kg; got {x}.")
    return cls.from_com(m, t, rotational_inertia(S))


def principal_axes(moments: Array, axes: Array) -> Array:
    """Principal axes (3, 3) as a rotation; axes of repeated moments are aligned with the frame's axes.

    Moments count as repeated if they differ by at most their rounding error, 8 eps of their sum.
    """
    close = np.diff(moments) <= 8 * np.finfo(float).eps * abs(moments.sum())
    if close.all():
        return np.eye(3)
    axes = axes.copy()
    if close.any():
        single = 2 if close[0] else 0
        n = axes[:, single]
        n *= np.copysign(1.0, n[np.argmax(np.abs(n))])
        e = np.eye(3)[np.argmin(np.abs(n))]  # the coordinate axis nearest to perpendicular to the single axis
        e = e - (e @ n) * n
        axes[:, (single + 1) % 3] = e / np.linalg.norm(e)
        axes[:, (single + 2) % 3] = so3.cross(n, axes[:, (single + 1) % 3])
    axes[:, 2] = so3.cross(axes[:, 0], axes[:, 1])
    return axes


complete(globals())
