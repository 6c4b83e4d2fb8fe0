"""The nearest tensor that a body can have, in a metric that is named.

With S the second moments, ½ tr(I) 1 - I: a body can have I where S is positive semidefinite.
"""

from __future__ import annotations

import numpy as np

from ..bodies.second_moments import clipped, rotational_inertia, second_moments
from ..errors import ValueRangeError
from ..typing import Array

METRICS = {
    "frobenius": "second moments, Frobenius norm",
    "entropic": "log-det divergence from the tensor of its shapes",
}
"""What may be asked for, with its name in full."""
_THINNEST = 1e-4
"""Share of the second moments that the least one keeps, so that ten digits of a file do not lose it again."""
_WEIGHT = 0.01
"""Of the divergence, beside the squared distance."""


def nearest(tensor: Array, metric: str = "frobenius", reference: Array | None = None) -> Array:
    """The nearest tensor (3, 3) that a body can have.

    ``frobenius`` clips the second moments S. ``entropic`` minimises ½ |X - X_0|² + w (tr X - log det X) with S seen from the
    second moments of ``reference``, X = L⁻¹ S L⁻ᵀ: invariant to units and axes, and always a body with volume (Wensing, Kim
    and Slotine, 2018). Without a reference a ball of the same trace stands for it.
    Raises :class:`~twistwrench.ValueRangeError` for another metric.
    """
    if metric not in METRICS:
        raise ValueRangeError(f"metric={metric!r} is not allowed. Choose from: {', '.join(map(repr, METRICS))}.")
    S = second_moments(tensor)
    return rotational_inertia(clipped(S, _THINNEST) if metric == "frobenius" else _drawn_in(S, reference))


def _drawn_in(S: Array, reference: Array | None) -> Array:
    size = max(abs(float(S.trace())), float(np.abs(S).max()), 1e-300)
    shape = np.eye(3) * size / 3.0 if reference is None else second_moments(reference)
    L = np.linalg.cholesky(clipped(shape, _THINNEST))
    back = np.linalg.inv(L)
    x, axes = np.linalg.eigh(back @ S @ back.T)
    # x - x_0 + w (1 - 1/x) = 0
    b = x - _WEIGHT
    x = np.maximum(0.5 * (b + np.sqrt(b * b + 4.0 * _WEIGHT)), _THINNEST)
    half = L @ axes
    return np.asarray((half * x) @ half.T)
