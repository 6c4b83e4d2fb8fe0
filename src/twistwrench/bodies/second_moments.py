"""Second moments and rotational inertia, and the nearest second moments that a body can have.

S = ∫ r r' dm and I = tr(S) 1 - S, (3, 3) each: a body can have I where S has no negative eigenvalue.
"""

from __future__ import annotations

import numpy as np

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
