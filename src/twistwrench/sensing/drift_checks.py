"""What is left of a log that changes steadily with time or with the load: a bias that drifts, a gain or cross-talk."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..core.printed_numbers import number, percent
from ..typing import Array
from .log import ReadingLog
from .log_mistakes import listed_bias
from .sensor import ForceTorqueSensor
from .unknowns import clock

_LEAST = 3  # readings that are off, from which a cause is looked for
_CURED = 0.25  # of them, at most, that are still off without it
_MOST = 0.5  # of the load's wrench; more is another tool
_PER_COLUMN = 3  # readings for each column of what is tried
_HUBER = 2.0  # times the noise, from which a reading loses weight
_ROUNDS = 50


def departure(
    log: ReadingLog, sensor: ForceTorqueSensor, rest: Array, sigma: Array, off: Callable[[Array], Array]
) -> str | None:
    """What explains nearly all readings that are ``off`` in rest (n, 6), with noise sigma (n, 6); None if nothing.

    Each channel is explained by columns X with Huber's weights: the powers 1, t, t² of time for a bias that drifts, or 1 and
    the load's six wrench components for a gain or cross-talk. A push of a while is neither.
    """
    before = int(off(rest).sum())
    if before < _LEAST:
        return None
    t = clock(log)
    s = (t - t[0]) / max(float(t[-1] - t[0]), 1e-300) - 0.5
    load = log.predicted(sensor) - np.asarray(sensor.bias)
    tried = {"drift": np.stack([s**k for k in range(3)], axis=1), "gain": np.column_stack([np.ones(len(s)), load])}
    best: tuple[int, str, Array] | None = None
    for name, X in tried.items():
        basis = _basis(X)
        if len(s) < _PER_COLUMN * basis.shape[1]:
            continue
        explained = np.stack([_robust(basis, rest[:, c], sigma[:, c]) for c in range(6)], axis=1)
        after = int(off(rest - explained).sum())
        if after <= _CURED * before and (best is None or after < best[0]):
            best = (after, name, explained)
    if best is None:
        return None
    _, name, explained = best
    if name == "drift":
        moved = explained[-1] - explained[0]
        per = f"over {number(t[-1] - t[0], 3)} s" if log.time is not None else f"over the {len(t)} readings"
        return (
            f"The bias drifts: by {listed_bias(moved)} [N m, N] {per}, which explains {before - best[0]} of {before} readings "
            "that are off. Identify the sensor again, zero it more often, or let it warm up."
        )
    changes = explained - explained.mean(axis=0)
    size = [np.sqrt((x.reshape(-1, 2, 3) ** 2).mean(axis=(0, 2))) for x in (changes, load - load.mean(axis=0))]
    share = float((size[0] / np.maximum(size[1], 1e-9)).max())
    if share > _MOST:
        return None
    return (
        f"A gain or cross-talk is off by {percent(share, 2)} of what the load does, which explains {before - best[0]} of "
        f"{before} readings that are off. Check the sensor's calibration matrix and its scale, or whether it is the log of "
        "this tool."
    )


def _basis(X: Array) -> Array:
    """Orthonormal columns that span those of X (n, k), without what is rounding."""
    size = np.linalg.norm(X, axis=0)
    U, values, _ = np.linalg.svd(X[:, size > 0] / size[size > 0], full_matrices=False)
    return np.asarray(U[:, values > 1e-6 * values[0]])


def _robust(X: Array, y: Array, sigma: Array) -> Array:
    """What columns X (n, k) explain of y (n,), with Huber's weights; least absolute deviations to begin with."""
    e, fitted = y - np.median(y), np.zeros_like(y)
    scale = max(float(np.median(np.abs(e))), 1e-300)
    for round_ in range(_ROUNDS):
        limit = 1e-3 * scale if round_ < 20 else _HUBER * sigma
        root = np.sqrt(np.minimum(1.0, limit / np.maximum(np.abs(e), 1e-300)))
        x = np.linalg.lstsq(X * root[:, None], y * root, rcond=None)[0]
        before, fitted = fitted, X @ x
        e = y - fitted
        if round_ > 20 and np.abs(fitted - before).max() < 1e-3 * sigma.min():
            break
    return fitted
