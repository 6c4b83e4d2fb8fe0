"""Other ways to write the ten numbers, and what a repair moved.

The pseudo-inertia J = ∫ [r; 1] [r; 1]' dm is positive definite exactly when a real body has the inertia (Wensing, Kim and
Slotine, 2018). Its Cholesky factor with logarithms on the diagonal gives ten numbers of which *every* choice is a real body,
for optimisers and estimators (Rucker and Wensing, "Smooth parameterization of rigid-body inertia", RA-L 7(2), 2022).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..errors import InertiaError, ValueRangeError
from ..lie import so3
from ..typing import Array
from .second_moments import rotational_inertia, second_moments

if TYPE_CHECKING:
    from .inertia import SpatialInertia


def from_pseudo_inertia(cls: type[SpatialInertia], J: ArrayLike) -> SpatialInertia:
    """Spatial inertia from the pseudo-inertia [[∫ r r' dm, m c], [m c', m]].

    Parameters
    ----------
    J : (4, 4) array_like [kg m², kg m, kg]

    Returns
    -------
    G : SpatialInertia

    Notes
    -----
    The inverse of :attr:`SpatialInertia.pseudo_inertia`.

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
    return cls.from_parameters([P[3, 3], *P[:3, 3], I[0, 0], I[0, 1], I[1, 1], I[0, 2], I[1, 2], I[2, 2]])


def log_cholesky(G: SpatialInertia) -> Array:
    """Log-Cholesky parameters of an inertia, ten numbers with J = U U' for the pseudo-inertia J.

    Parameters
    ----------
    G : SpatialInertia

    Returns
    -------
    theta : (10,) array, (α, d1, d2, d3, s12, s23, s13, t1, t2, t3)
        The mass is exp(2α), t the centre of mass [m].

    Raises
    ------
    InertiaError
        The body is impossible, or not of full dimension (a point, a rod, a plate without thickness).

    Notes
    -----
    U as in Rucker and Wensing eq. 9.

    Examples
    --------
    >>> from twistwrench import SpatialInertia
    >>> SpatialInertia.from_com(1.0, (1, 2, 3), 2 * np.eye(3)).log_cholesky().tolist()
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 2.0, 3.0]
    """
    m, I = float(G.mass), G.moment_about_com
    problem = "; ".join(G.defects()) or (None if m > 0 else "it has no mass")
    if problem is None:
        S = second_moments(I) / m
        try:
            U = np.linalg.cholesky(S[::-1, ::-1])[::-1, ::-1]  # upper triangular: S = U U'
        except np.linalg.LinAlgError:
            problem = "it has no extent in some direction"
    if problem is not None:
        raise InertiaError(f"this inertia has no log-Cholesky parameters: {problem}. Try nearest_consistent() first.")
    return np.array([0.5 * np.log(m), *np.log(U.diagonal()), U[0, 1], U[1, 2], U[0, 2], *G.com])


def from_log_cholesky(cls: type[SpatialInertia], theta: ArrayLike) -> SpatialInertia:
    """Spatial inertia from log-Cholesky parameters; any finite ten numbers give a body that can exist.

    Parameters
    ----------
    theta : (10,) array_like, as :meth:`SpatialInertia.log_cholesky` gives them

    Returns
    -------
    G : SpatialInertia

    Raises
    ------
    ValueRangeError
        A number is not finite, or too large to be a logarithm.

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
        raise ValueRangeError(f"log-Cholesky parameters overflow: mass exp(2 α) = {m:.3g} kg; got {x}.")
    return cls.from_com(m, t, rotational_inertia(S))


def aligned_axes(moments: Array, axes: Array) -> Array:
    """Principal axes (3, 3) as a rotation, with the freedom that repeated moments leave spent on following the frame's axes.

    Moments count as repeated when they differ by no more than their rounding, 8 eps of their sum.
    """
    close = np.diff(moments) <= 8 * np.finfo(float).eps * abs(moments.sum())
    if close.all():
        return np.eye(3)
    axes = axes.copy()
    if close.any():
        alone = 2 if close[0] else 0
        n = axes[:, alone]
        n *= np.copysign(1.0, n[np.argmax(np.abs(n))])
        e = np.eye(3)[np.argmin(np.abs(n))]  # the coordinate axis most nearly across the single one
        e = e - (e @ n) * n
        axes[:, (alone + 1) % 3] = e / np.linalg.norm(e)
        axes[:, (alone + 2) % 3] = so3.cross(n, axes[:, (alone + 1) % 3])
    axes[:, 2] = so3.cross(axes[:, 0], axes[:, 1])
    return axes


@dataclass(frozen=True, eq=False)
class Repair:
    """What :meth:`SpatialInertia.nearest_consistent` changed; printing it says so in words.

    Examples
    --------
    >>> from twistwrench import SpatialInertia
    >>> print(SpatialInertia.from_com(2.0, moment_about_com=np.diag([1.0, 1.0, 3.0])).repair())
    triangle inequality: the largest principal moment 3 kg m² exceeds the sum of the others, 1 + 1, by 1
      principal moments  1, 1, 3  →  1.5, 1.5, 3 kg m²
      largest change     0.5 kg m², 16.7 % of the largest moment
    """

    before: SpatialInertia
    """The inertia as it was."""
    after: SpatialInertia
    """The nearest inertia that a real body can have."""

    @property
    def reasons(self) -> list[str]:
        """The conditions that were violated."""
        return self.before.defects()

    @property
    def moved(self) -> Array:
        """Change of the moment about the centre of mass (3, 3) [kg m²]; mass and centre of mass stay."""
        return self.after.moment_about_com - self.before.moment_about_com

    @property
    def largest(self) -> float:
        """The largest change of a moment, over the largest moment before."""
        size = float(np.abs(self.before.principal()[0]).max())
        return float(np.abs(np.linalg.eigvalsh(self.moved)).max()) / size if size else 0.0

    def __str__(self) -> str:
        if not self.reasons:
            return "nothing to repair"
        moments = [", ".join(f"{x:.6g}" for x in G.principal()[0] + 0.0) for G in (self.before, self.after)]
        change = np.abs(np.linalg.eigvalsh(self.moved)).max()
        return "\n".join(
            [
                *self.reasons,
                f"  principal moments  {moments[0]}  →  {moments[1]} kg m²",
                f"  largest change     {change:.6g} kg m², {self.largest:.1%} of the largest moment".replace("%", " %"),
            ]
        )
