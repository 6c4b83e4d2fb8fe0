"""Second moments and rotational inertia, and the nearest second moments that a body can have.

S = ∫ r r' dm and I = tr(S) 1 - S, (3, 3) each: a body can have I where S has no negative eigenvalue.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..errors import ShapeError
from ..typing import Array


def second_moments(I: Array) -> Array:
    """S = ½ tr(I) 1 - I."""
    return np.asarray(0.5 * I.trace() * np.eye(3) - I)


def rotational_inertia(S: Array) -> Array:
    """I = tr(S) 1 - S."""
    return np.asarray(S.trace() * np.eye(3) - S)


def clipped(S: Array, least: float = 0.0) -> Array:
    """The nearest S, in the Frobenius norm, of eigenvalues not below ``least``, a share of the largest by size."""
    values, axes = np.linalg.eigh(S)
    return np.asarray(axes * np.maximum(values, least * np.abs(values).max()) @ axes.T)


def moment_matrix(I: ArrayLike) -> Array:
    """A rotational inertia (3, 3); three numbers, which could only be its diagonal, are told how to become one."""
    try:
        return arguments.one(I, "moment_about_com", 3, 3)
    except ShapeError as problem:
        try:
            three = np.shape(I) == (3,)
        except ValueError:  # ragged
            three = False
        hint = " Three moments about the axes are np.diag(…) of them." if three else ""
        raise ShapeError(f"{problem}{hint}") from None
