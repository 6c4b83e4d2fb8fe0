"""Static poses of a log: clusters of readings with constant direction of gravity."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..core.typing import Array
from .log import ReadingLog

_MIN_TOLERANCE = 2e-3
_MAX_TOLERANCE = 5e-2
"""Bounds of the tolerance on gravity's direction within a dwell [rad]."""
TOLERANCE_IN_STEPS = 5.0
"""Tolerance between these bounds, in median steps between readings."""
MAX_TOLERANCE_OF_SPREAD = 0.1
"""Largest tolerance as a fraction of the spread of all directions."""
MIN_READINGS_OF_DWELL = 5
"""Smallest number of readings of a dwell in a log with motion."""
_REST_LIMITS = (0.02, 0.01, 0.2, 0.2)
"""Rates [rad/s, m/s] and accelerations [rad/s², m/s²] below which the sensor is at rest."""
MAX_COMPARED_DWELLS = 2000
"""Largest number of dwells whose orientations are compared pairwise."""
_FIRST_WINDOW = 64
"""Number of readings in which the end of a run is sought first; each later window is twice as long."""


@dataclass(frozen=True, eq=False)
class StaticPoses:
    """Reduced log: a row for each dwell, the mean of its readings, and a row for each reading in motion."""

    log: ReadingLog
    """Log of n rows, with times, or indices if no times were logged."""
    count: Array
    """Number (n,) of readings in each row."""
    within: Array
    """Variance (6,) of a reading within its dwell [(N m)², N²]; zero if no dwell has two readings."""
    within_freedom: float
    """Degrees of freedom of ``within``."""
    label: Array
    """Cluster (n,) of each row; rows of a revisited orientation have the same cluster."""
    row: Array
    """Index of the row (N,) of each reading of the original log; -1 for readings between dwells, which are not used."""
    moving: Array
    """Mask (n,) of rows that are readings in motion."""

    def spread(self, mask: Array) -> Array:
        """Expand a mask (n,) of rows to a mask (N,) of readings."""
        return np.asarray(np.where(self.row >= 0, mask[self.row], False))


def static_poses(log: ReadingLog) -> StaticPoses:
    """Static poses of a log: dwells are runs of readings with constant direction of gravity in {f}.

    In a log with twists, a dwell has at least five readings at rest; other readings are in motion. In a log without
    twists, short runs between long runs count as motion between dwells and are left out.

    >>> still = ReadingLog.from_arrays(np.zeros((6, 6)), gravity=np.repeat([[0, 0, -9.81], [9.81, 0, 0]], 3, axis=0))
    >>> static_poses(still).count.tolist()
    [3.0, 3.0]
    """
    directions = log.gravity / np.linalg.norm(log.gravity, axis=1, keepdims=True)
    tolerance = _direction_tolerance(directions)
    at_rest = _rest_mask(log)
    first, end = _constant_direction_runs(directions, tolerance, at_rest)
    length = end - first
    is_used_run = np.ones(len(first), bool)
    is_long = length >= MIN_READINGS_OF_DWELL
    has_dwells = length[is_long].sum() > 0.5 * len(log) and is_long.sum() > 2
    if log.V is None and has_dwells:
        is_used_run = is_long  # short runs are motion between the dwells
    row_of_run = np.where(is_used_run, np.cumsum(is_used_run) - 1, -1)
    row = np.repeat(row_of_run, length)
    count = length[is_used_run].astype(float)
    averages = {"time": _row_means(log.clock, row, count)}
    for name in ("readings", "gravity", "V", "dV", "rotations"):
        averages[name] = _row_means(getattr(log, name), row, count)
    reduced = replace(log, **averages)
    is_used = row >= 0
    deviations = log.readings[is_used] - reduced.readings[row[is_used]]
    freedom = float((count - 1).sum())
    within = np.zeros(6)
    if freedom:
        within = (deviations**2).sum(axis=0) / freedom
    moving = ~at_rest[first][is_used_run]
    label = _orientation_labels(reduced, tolerance, moving)
    return StaticPoses(reduced, count, within, freedom, label, row, moving)


def _direction_tolerance(directions: Array) -> float:
    """Tolerance [rad] for equal directions (n, 3): a few median steps, far below the spread of the directions."""
    if len(directions) < 2:
        return 0.0
    usual_step = float(np.median(_lengths(np.diff(directions, axis=0))))
    spread = float(_lengths(directions - directions.mean(axis=0)).max())
    tolerance = max(TOLERANCE_IN_STEPS * usual_step, _MIN_TOLERANCE)
    return float(min(tolerance, _MAX_TOLERANCE, MAX_TOLERANCE_OF_SPREAD * spread))


def _rest_mask(log: ReadingLog) -> Array:
    """Mask (n,) of readings in runs at rest that are long enough for a dwell; all True for a log without twists."""
    if log.V is None or log.dV is None:
        return np.ones(len(log), bool)
    four_vectors = np.concatenate([log.V, log.dV], axis=1).reshape(-1, 4, 3)  # in the order of the limits
    rates = _lengths(four_vectors)
    is_slow = np.asarray((rates < _REST_LIMITS).all(axis=1))
    for first, last in runs(is_slow):
        is_slow[first : last + 1] = last + 1 - first >= MIN_READINGS_OF_DWELL
    return is_slow


def _constant_direction_runs(directions: Array, tolerance: float, at_rest: Array) -> tuple[Array, Array]:
    """First index and end index (after the last) of each run of constant gravity direction; a reading in motion is a run."""
    edges = [0]
    n = len(directions)
    start = 0
    while start < n:
        end = start + 1
        if at_rest[start]:
            window_size = _FIRST_WINDOW
            while end < n:
                window = slice(end, min(n, end + window_size))
                is_other = _lengths(directions[window] - directions[start]) > tolerance
                ends_run = np.flatnonzero(is_other | ~at_rest[window])
                if ends_run.size:
                    end += int(ends_run[0])
                    break
                end = window.stop
                window_size *= 2
        edges.append(end)
        start = end
    return np.array(edges[:-1]), np.array(edges[1:])


def _row_means(values: Array | None, row: Array, count: Array) -> Any:
    """Means (n, ...) of values (N, ...) over the readings of each row; ``count`` (n,) is the number of readings.

    Means may be used instead of readings, since readings at rest depend linearly on all quantities of a log.
    """
    if values is None:
        return None
    if len(count) == len(values):
        return values
    total = np.zeros((len(count), *values.shape[1:]))
    is_used = row >= 0
    np.add.at(total, row[is_used], values[is_used])
    return total / count.reshape(-1, *[1] * (values.ndim - 1))


def _orientation_labels(log: ReadingLog, tolerance: float, moving: Array) -> Array:
    """Cluster (n,) of each row: the index of the first row in this orientation; a row in motion is a cluster by itself."""
    n = len(log)
    if n > MAX_COMPARED_DWELLS or moving.all():
        return np.arange(n)
    orientations = log.gravity / np.linalg.norm(log.gravity, axis=1, keepdims=True)
    if log.rotations is not None:
        orientations = log.rotations.reshape(n, 9)
    label = np.arange(n)
    is_first = np.zeros(n, bool)
    for k in np.flatnonzero(~moving).tolist():
        is_near = _lengths(orientations - orientations[k]) <= tolerance
        same_orientation = np.flatnonzero(is_first & is_near)
        if same_orientation.size:
            label[k] = int(same_orientation[0])
        else:
            is_first[k] = True
    return label


def _lengths(vectors: Array) -> Array:
    """Lengths (...) of vectors (..., k)."""
    return np.asarray(np.linalg.norm(vectors, axis=-1))


def runs(mask: Array) -> list[tuple[int, int]]:
    """First and last index of each run of true values in ``mask`` (n,)."""
    padded = np.concatenate([[0], mask.astype(int), [0]])
    edges = np.flatnonzero(np.diff(padded))  # first and end of each run in turn
    return [(int(first), int(end) - 1) for first, end in zip(edges[::2], edges[1::2], strict=True)]
