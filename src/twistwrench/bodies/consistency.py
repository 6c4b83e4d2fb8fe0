"""Whether a real body can have an inertia, the nearest one that a body can have, and what a repair moved."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..core.printed_numbers import number, percent, printed
from ..errors import InertiaError
from ..typing import Array
from .second_moments import clipped, rotational_inertia, second_moments

if TYPE_CHECKING:
    from .inertia import SpatialInertia


def defects(G: SpatialInertia, *, size: float = 0.0) -> list[str]:
    """Physical consistency: why no real body has this inertia, in words with amounts.

    Parameters
    ----------
    G : SpatialInertia
    size : float, moments [kg m²] that these came from, where they are differences of larger ones
        As of bodies moved from frame to frame: their rounding is no defect.

    Returns
    -------
    reasons : list of str, empty when a real body can have it

    Notes
    -----
    Conditions: finite, mass ≥ 0, and about the centre of mass positive semidefinite with principal moments that
    obey the triangle inequality, to 1e-6 of their sum, whatever the scale.

    Examples
    --------
    >>> from twistwrench import SpatialInertia
    >>> SpatialInertia.box((1, 2, 3), mass=12).defects()
    []
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
    # Moments about a far origin lose digits on their way to the centre of mass.
    slack = 1e-6 * abs(A + B + C) + 2e-15 * max(size, abs(float(G.moment_about_origin.trace())))
    found = []
    if -slack > A:
        found.append(
            f"negative principal moment {number(A, 6)} kg m² (moments {number(A, 6)}, {number(B, 6)}, {number(C, 6)})"
        )
    if A + B + slack < C:
        found.append(
            f"triangle inequality: the largest principal moment {number(C, 6)} kg m² exceeds the sum of the others, "
            f"{number(A, 6)} + {number(B, 6)}, by {number(C - A - B, 3)}"
        )
    return found


def nearest_consistent(G: SpatialInertia) -> SpatialInertia:
    """Nearest inertia a real body can have: same mass and centre of mass, second moments clipped at zero.

    Parameters
    ----------
    G : SpatialInertia

    Returns
    -------
    G : SpatialInertia

    Raises
    ------
    InertiaError
        The mass is negative; that has no near neighbour.

    Notes
    -----
    Nearest in the Frobenius norm of the second moments about the centre of mass.

    Examples
    --------
    >>> from twistwrench import SpatialInertia
    >>> bad = SpatialInertia.from_com(2.0, moment_about_com=np.diag([1.0, 1.0, 3.0]))
    >>> bad.nearest_consistent().moment_about_com.diagonal().tolist()
    [1.5, 1.5, 3.0]
    """
    if not np.isfinite(G.parameters).all() or G.mass < 0:
        raise InertiaError(f"no body is near this inertia: {'; '.join(G.defects())}.")
    if G.mass == 0:
        return type(G).zero()
    S = clipped(second_moments(G.moment_about_com))
    return type(G).from_com(G.mass, G.com, rotational_inertia(S))


def repair(G: SpatialInertia) -> Repair:
    """Repaired inertia, :meth:`nearest_consistent`, with a report of what moved and why.

    Parameters
    ----------
    G : SpatialInertia

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
        moments = [", ".join(number(x, 6) for x in G.principal()[0] + 0.0) for G in (self.before, self.after)]
        change = np.abs(np.linalg.eigvalsh(self.moved)).max()
        return "\n".join(
            [
                *self.reasons,
                f"  principal moments  {moments[0]}  →  {moments[1]} kg m²",
                f"  largest change     {number(change, 6)} kg m², {percent(self.largest, 3)} of the largest moment",
            ]
        )
