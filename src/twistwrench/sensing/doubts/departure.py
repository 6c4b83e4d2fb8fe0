"""Departure of readings from a sensor's file: drift of the bias, gain and cross-talk in the residuals."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.doubts import Doubt, doubt
from ...core.numbers import number, percent
from ...core.typing import Array
from .reading_doubts import listed_bias

if TYPE_CHECKING:
    from ..log import ReadingLog
    from ..sensor import ForceTorqueSensor

MIN_OUTLIERS = 3
"""Smallest number of off readings for which a cause is sought."""
MAX_REMAINING_SHARE = 0.25
"""Largest fraction of the off readings that a cause may leave off."""
MAX_GAIN = 0.5
"""Largest error of gain or cross-talk, relative to the load's wrench; with a larger one the tool is another one."""
MIN_READINGS_PER_COLUMN = 3
"""Smallest number of readings for each column of an explanation."""
_HUBER_LIMIT = 2.0
"""Ratio of residual to noise above which a reading loses weight."""
_SPAN_TOLERANCE = 1e-6
"""Largest singular value at rounding level, for columns of unit length."""


def departure(
    log: ReadingLog, sensor: ForceTorqueSensor, rest: Array, sigma: Array, off: Callable[[Array], Array]
) -> Doubt | None:
    """Cause of nearly all readings that are off; None if not found.

    ``off`` returns the mask of these readings, from residuals ``rest`` (n, 6) with noise ``sigma`` (n, 6). Each channel is
    fitted by columns X with Huber weights: 1 for a constant offset, 1, t, t² for a drifting bias, or 1 and the six
    components of the load's wrench for a gain or cross-talk. None of them fits a temporary contact. If an offset explains
    the readings, the other causes are not tried, since they contain it.
    """
    before = int(off(rest).sum())
    if before < MIN_OUTLIERS:
        return None
    t = log.clock
    duration = float(t[-1] - t[0])
    s = (t - t[0]) / max(duration, 1e-300) - 0.5  # time from -½ to ½
    load = log.predicted(sensor) - np.asarray(sensor.bias)
    constant = np.ones((len(s), 1))
    explanations = {
        "offset": constant,
        "drift": np.stack([s**k for k in range(3)], axis=1),
        "gain": np.column_stack([constant, load]),
    }
    best: tuple[int, str, Array] | None = None
    for name, X in explanations.items():
        columns = X[:, X.any(axis=0)]
        basis = orthonormal(columns / np.linalg.norm(columns, axis=0))
        if len(s) < MIN_READINGS_PER_COLUMN * basis.shape[1]:
            continue
        fits = [_robust_fit(basis, y, deviations) for y, deviations in zip(rest.T, sigma.T, strict=True)]
        explained = np.stack(fits, axis=1)
        after = int(off(rest - explained).sum())
        if after <= MAX_REMAINING_SHARE * before and (best is None or after < best[0]):
            best = (after, name, explained)
            if name == "offset":
                break
    if best is None:
        return None
    after, name, explained = best
    counts: dict[str, Any] = {"count": before - after, "total": before}
    if name == "offset":
        return doubt("sensor-file-offset", bias=listed_bias(explained[0]), **counts)
    if name == "drift":
        span = f"the {len(t)} readings"
        if log.time is not None:
            span = f"{number(duration, 3)} s"
        return doubt("sensor-file-drift", bias=listed_bias(explained[-1] - explained[0]), span=span, **counts)
    share = largest_share(explained, load)
    if share > MAX_GAIN:
        return None
    return doubt("sensor-file-gain", share=percent(share, 2), **counts)


def largest_share(explained: Array, load: Array) -> float:
    """Ratio of the changes of the explained part (n, 6) and of the load (n, 6); the larger of moments and forces."""
    return float((_changes(explained) / np.maximum(_changes(load), 1e-12)).max())


def _changes(wrenches: Array) -> Array:
    """Standard deviations (2,) of moments and forces of wrenches (n, 6)."""
    deviations = (wrenches - wrenches.mean(axis=0)).reshape(-1, 2, 3)
    return np.sqrt((deviations**2).mean(axis=(0, 2)))


def orthonormal(E: Array, basis: Array | None = None) -> Array:
    """Orthonormal basis of the columns E (N, k) orthogonal to a basis (N, p), without directions at rounding level."""
    if basis is not None:
        E = E - basis @ (basis.T @ E)
        E = E - basis @ (basis.T @ E)  # again: rounding errors of the first projection are not orthogonal
    U, values, _ = np.linalg.svd(E, full_matrices=False)
    return np.asarray(U[:, values > _SPAN_TOLERANCE])


def _robust_fit(X: Array, y: Array, sigma: Array) -> Array:
    """Robust fit of y (n,) by columns X (n, k), with Huber's loss, which is convex."""
    from scipy.optimize import least_squares

    def residuals(x: Array) -> Array:
        return np.asarray((X @ x - y) / sigma)

    optimum = least_squares(residuals, np.zeros(X.shape[1]), loss="huber", f_scale=_HUBER_LIMIT)
    return np.asarray(X @ optimum.x)
