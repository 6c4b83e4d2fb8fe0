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


_MOMENT_TOLERANCE = 1e-6
"""Violation of a condition on the moments that is tolerated, over the sum of the principal moments."""
_MOMENT_ROUNDING = 2e-15
"""Rounding error of a principal moment, over the moments from which it was subtracted."""
_MATRIX_TOLERANCE = 1e-6
"""Deviation of a block of a matrix (6, 6) from its form that is tolerated, over the largest entry of the block."""
_AXES_ROUNDING = 8 * np.finfo(float).eps
"""Difference of two principal moments up to which they count as equal, over the sum of the moments."""


def defects(G: SpatialInertia, *, size: float = 0.0) -> list[str]:
    """Physical consistency: the reasons, with amounts, why no real body has this inertia.

    Parameters
    ----------
    size : float, size of the moments [kg m²] whose difference this inertia is
        Rounding errors of moments of that size, such as after a change of frame, are not defects.

    Returns
    -------
    reasons : list of str, empty if a real body can have this inertia

    Notes
    -----
    All values must be finite and the mass at least 0. The inertia about the centre of mass must be positive semidefinite, and
    its principal moments must obey the triangle inequality. The tolerance is 1e-6 of the sum of the moments.
    """
    if not np.isfinite(G.parameters).all():
        return ["has a value that is not a finite number"]
    if G.mass < 0:
        return [f"negative mass {printed(G.mass)} kg"]
    if G.mass == 0:
        if np.any(G.parameters != 0):
            return ["zero mass but nonzero inertia or first moment"]
        return []
    principal_moments, _ = G.principal()
    smallest, middle, largest = principal_moments.tolist()
    # Moments about a distant origin leave a rounding error when moved to the centre of mass.
    moment_about_origin = abs(float(G.moment_about_origin.trace()))
    rounding_error = _MOMENT_ROUNDING * max(size, moment_about_origin)
    tolerance = _MOMENT_TOLERANCE * abs(smallest + middle + largest) + rounding_error
    shown_moments = np.where(np.abs(principal_moments) > rounding_error, principal_moments, 0.0)
    smallest_text, middle_text, largest_text = (number(moment, 6) for moment in shown_moments.tolist())
    problems = []
    if smallest < -tolerance:
        problems.append(
            f"negative principal moment {smallest_text} kg m² (moments {smallest_text}, {middle_text}, {largest_text})"
        )
    excess = largest - smallest - middle
    if smallest + middle + tolerance < largest:
        problems.append(
            f"triangle inequality: the largest principal moment {largest_text} kg m² exceeds the sum of the others, "
            f"{smallest_text} + {middle_text}, by {number(excess, 3)}"
        )
    return problems


def nearest_consistent(G: SpatialInertia) -> SpatialInertia:
    """Nearest inertia a real body can have: same mass and centre of mass, eigenvalues of the second moments at least zero.

    It is the nearest in the Frobenius norm of the second moments about the centre of mass.

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
        """Violated conditions, as returned by :meth:`SpatialInertia.defects` before the repair."""
        return self.before.defects()

    @property
    def moved(self) -> Array:
        """Change of the moment about the centre of mass (3, 3) [kg m²]; mass and centre of mass are kept."""
        return self.after.moment_about_com - self.before.moment_about_com

    @property
    def largest(self) -> float:
        """Largest change of a moment, relative to the largest moment before."""
        moments_before, _ = self.before.principal()
        largest_moment = float(np.abs(moments_before).max())
        if not largest_moment:
            return 0.0
        changes = np.abs(np.linalg.eigvalsh(self.moved))
        return float(changes.max()) / largest_moment

    def __str__(self) -> str:
        if not self.reasons:
            return "nothing to repair"
        moments_before = _moments_text(self.before)
        moments_after = _moments_text(self.after)
        largest_change = np.abs(np.linalg.eigvalsh(self.moved)).max()
        return "\n".join(
            [
                *self.reasons,
                f"  principal moments  {moments_before}  →  {moments_after} kg m²",
                f"  largest change     {number(largest_change, 6)} kg m², {percent(self.largest, 3)} of the largest moment",
            ]
        )


def _moments_text(G: SpatialInertia) -> str:
    """Principal moments without their unit, separated by commas."""
    moments, _ = G.principal()
    is_rounding = np.abs(moments) <= _MOMENT_ROUNDING * np.abs(moments).max()
    return ", ".join(number(moment, 6) for moment in np.where(is_rounding, 0.0, moments))


# ── Parametrisations of the ten parameters

# The pseudo-inertia J = ∫ [r; 1] [r; 1]' dm is positive definite exactly if a real body has the inertia (Wensing, Kim and
# Slotine, 2018). Its Cholesky factor with logarithms on the diagonal has ten parameters, and *every* choice is a real body, as
# optimisers and estimators need (Rucker and Wensing, "Smooth parameterization of rigid-body inertia", RA-L 7(2), 2022).

_MAX_GYRATION_RADIUS = 100.0
"""Largest radius of gyration [m] in a matrix (6, 6). A larger one is taken for a body below a centimetre, written with the
linear part first: the form of the matrix of a ball or a cube does not show the order of its parts."""


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
    moment_block, coupling_block, mass_block = G[:3, :3], G[:3, 3:], G[3:, 3:]
    I = 0.5 * (moment_block + moment_block.T)
    h = so3.vee(0.5 * (coupling_block - coupling_block.T))
    inertia = cls.from_parameters(ten_parameters(mass_block.trace() / 3, h, I))
    # Blocks have tolerances of their own: kg m² and kg differ by a factor of a million for a body of a millimetre.
    largest_moment = float(np.abs(moment_block).max())
    largest_mass = float(np.abs(mass_block).max())
    roots = np.sqrt(np.repeat([largest_moment, largest_mass], 3))  # one for each row of the matrix
    entry_sizes = np.outer(roots, roots)  # of the coupling blocks: geometric mean of moment and mass
    deviation = np.abs(inertia.matrix - G)
    if not (deviation <= _MATRIX_TOLERANCE * entry_sizes).all():
        raise InertiaError(
            "no spatial inertia [[I, m[c]], [-m[c], m 1]], angular part first: the matrix is off by "
            f"{printed(deviation.max(), 3)}. Is its linear part first? Then swap the blocks."
        )
    if largest_moment > _MAX_GYRATION_RADIUS**2 * largest_mass > 0:
        gyration_radius = printed(np.sqrt(largest_moment / largest_mass), 3)
        raise InertiaError(
            f"read with the angular part first, this spatial inertia is of {printed(inertia.mass, 3)} kg spread over "
            f"{gyration_radius} m. Is its linear part first? Then swap the blocks. A body so large is "
            "described by from_com."
        )
    return inertia


def from_pseudo_inertia(cls: type[SpatialInertia], J: ArrayLike) -> SpatialInertia:
    """Spatial inertia from the pseudo-inertia [[∫ r r' dm, m c], [m c', m]].

    Inverse function of :attr:`SpatialInertia.pseudo_inertia`.

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
    matrix = arguments.one(J, "a pseudo-inertia", 4, 4)
    matrix = 0.5 * (matrix + matrix.T)
    S, h, m = matrix[:3, :3], matrix[:3, 3], matrix[3, 3]
    return cls.from_parameters(ten_parameters(m, h, rotational_inertia(S)))


def log_cholesky(G: SpatialInertia) -> Array:
    """Log-Cholesky parameters of an inertia: ten numbers that determine U in J = U U', where J is the pseudo-inertia.

    U is the upper triangular matrix of Rucker and Wensing eq. 9.

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
    m = float(G.mass)
    problem = "; ".join(G.defects())
    if not problem and not m > 0:
        problem = "it has no mass"
    U = None
    if not problem:
        S = second_moments(G.moment_about_com) / m
        try:
            U = np.linalg.cholesky(S[::-1, ::-1])[::-1, ::-1]  # S = U U'; the reversed order makes U upper triangular
        except np.linalg.LinAlgError:
            problem = "it has no extent in some direction"
    if U is None:
        raise InertiaError(f"this inertia has no log-Cholesky parameters: {problem}. Try nearest_consistent() first.")
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
    parameters = arguments.one(theta, "log-Cholesky parameters", 10)
    if not np.isfinite(parameters).all():
        raise ValueRangeError(f"log-Cholesky parameters must be finite, got {parameters}.")
    alpha, d1, d2, d3, s12, s23, s13, *com = parameters.tolist()
    with np.errstate(over="ignore", invalid="ignore"):
        m = np.exp(2.0 * alpha)
        U = np.array([[np.exp(d1), s12, s13], [0.0, np.exp(d2), s23], [0.0, 0.0, np.exp(d3)]])
        S = m * U @ U.T
    if not np.isfinite([m, S.trace()]).all():
        raise ValueRangeError(
            f"log-Cholesky parameters overflow: mass exp(2 α) = {printed(m, 3)} kg; got {parameters}."
        )
    return cls.from_com(m, com, rotational_inertia(S))


def principal_axes(moments: Array, axes: Array) -> Array:
    """Principal axes (3, 3) as a rotation; axes of repeated moments are aligned with the frame's axes.

    ``moments`` (3,) ascend, and ``axes`` (3, 3) are their directions, in the columns. Moments that differ by at most
    their rounding error count as repeated.
    """
    # Two flags: for the first and second moment, and for the second and third.
    is_repeated = np.diff(moments) <= _AXES_ROUNDING * abs(moments.sum())
    if is_repeated.all():
        return np.eye(3)
    axes = axes.copy()
    if is_repeated.any():
        single_column = 2 if is_repeated[0] else 0  # of the axis whose moment is not repeated
        next_column = (single_column + 1) % 3
        last_column = (single_column + 2) % 3
        single_axis = axes[:, single_column]
        largest_component = single_axis[np.argmax(np.abs(single_axis))]
        single_axis *= np.copysign(1.0, largest_component)  # a view of the column: ``axes`` changes, too
        nearest_to_perpendicular = np.argmin(np.abs(single_axis))
        coordinate_axis = np.eye(3)[nearest_to_perpendicular]
        perpendicular = coordinate_axis - (coordinate_axis @ single_axis) * single_axis
        axes[:, next_column] = perpendicular / np.linalg.norm(perpendicular)
        axes[:, last_column] = so3.cross(single_axis, axes[:, next_column])
    axes[:, 2] = so3.cross(axes[:, 0], axes[:, 1])  # a rotation, not a reflection
    return axes


complete(globals())
