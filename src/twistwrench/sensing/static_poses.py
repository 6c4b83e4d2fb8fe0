"""Static poses of a log: clusters of readings with constant direction of gravity."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..core.typing import Array
from .log import ReadingLog

_DIRECTION_TOLERANCE = (2e-3, 5e-2)  # rad; lower and upper bound of the tolerance on gravity's direction within a dwell
TOLERANCE_IN_STEPS = 5.0  # tolerance between these bounds, in median steps between readings
MAX_TOLERANCE_OF_SPREAD = 0.1  # upper bound of the tolerance as a fraction of the spread of all directions
MIN_READINGS_OF_DWELL = 5  # minimum readings of a dwell in a log with motion
_REST_LIMITS = (0.02, 0.01, 0.2, 0.2)  # rad/s, m/s, rad/s², m/s² below which the sensor is at rest
MAX_COMPARED_DWELLS = 2000  # largest number of dwells whose orientations are compared pairwise


@dataclass(frozen=True, eq=False)
class StaticPoses:
    """Reduced log: one row for each dwell (mean of its readings), and one for each reading in motion."""

    log: ReadingLog  # log of n rows, with times, or indices if no times were logged
    count: Array  # (n,) readings in each row
    within: Array  # (6,) variance of a reading within its dwell [(N m)², N²]; zero if no dwell has two readings
    within_freedom: float  # degrees of freedom of ``within``
    label: Array  # (n,) cluster of each row; rows of a revisited orientation share one
    row: Array
    """Row (N,) of each reading of the original log; -1 for readings between dwells, which are not used."""
    moving: Array  # (n,) True for readings in motion

    def spread(self, kept: Array) -> Array:
        """Expand a mask (n,) of rows to a mask (N,) of readings."""
        return np.asarray(np.where(self.row >= 0, kept[self.row], False))


def static_poses(log: ReadingLog) -> StaticPoses:
    """Static poses of a log: dwells are runs of readings with constant direction of gravity in {f}.

    In a log with twists, a dwell has at least five readings at rest; other readings are in motion. In a log without
    twists, short runs between long ones are taken to be motion between dwells and are left out.

    >>> still = ReadingLog.from_arrays(np.zeros((6, 6)), gravity=np.repeat([[0, 0, -9.81], [9.81, 0, 0]], 3, axis=0))
    >>> static_poses(still).count.tolist()
    [3.0, 3.0]
    """
    unit = log.gravity / np.linalg.norm(log.gravity, axis=1, keepdims=True)
    tolerance = _direction_tolerance(unit)
    rest = _rest_mask(log)
    first, last = _runs(unit, tolerance, rest)
    length = last - first
    moving = ~rest[first]
    used, long = np.ones(len(first), bool), length >= MIN_READINGS_OF_DWELL
    if log.V is None and length[long].sum() > 0.5 * len(log) and long.sum() > 2:
        used = long
    row = np.repeat(np.where(used, np.cumsum(used) - 1, -1), length)
    count = length[used].astype(float)
    averages = {"time": _means(log.clock, row, count)}
    for name in ("readings", "gravity", "V", "dV", "rotations"):
        averages[name] = _means(getattr(log, name), row, count)
    reduced = replace(log, **averages)
    deviations = log.readings[row >= 0] - reduced.readings[row[row >= 0]]
    freedom, within = float((count - 1).sum()), np.zeros(6)
    if freedom:
        within = (deviations**2).sum(axis=0) / freedom
    label = _labels(reduced, tolerance, moving[used])
    return StaticPoses(reduced, count, within, freedom, label, row, moving[used])


def _direction_tolerance(unit: Array) -> float:
    """Tolerance [rad] for equal directions (n, 3): a few median steps, far below the spread of the directions."""
    if len(unit) < 2:
        return 0.0
    least, largest = _DIRECTION_TOLERANCE
    step = float(np.median(_lengths(np.diff(unit, axis=0))))
    spread = float(_lengths(unit - unit.mean(axis=0)).max())
    return float(min(max(TOLERANCE_IN_STEPS * step, least), largest, MAX_TOLERANCE_OF_SPREAD * spread))


def _rest_mask(log: ReadingLog) -> Array:
    """True for readings (n,) in a run at rest that is long enough; all True for a log without twists."""
    if log.V is None or log.dV is None:
        return np.ones(len(log), bool)
    sizes = _lengths(np.concatenate([log.V, log.dV], axis=1).reshape(-1, 4, 3))
    slow = np.asarray((sizes < _REST_LIMITS).all(axis=1))
    for a, b in runs(slow):
        slow[a : b + 1] = b + 1 - a >= MIN_READINGS_OF_DWELL
    return slow


def _runs(unit: Array, tolerance: float, rest: Array) -> tuple[Array, Array]:
    """First index and end index of each run of constant gravity direction; each reading in motion is a separate run."""
    edges, n, start = [0], len(unit), 0
    while start < n:
        end = start + 1
        if rest[start]:
            size = 64
            while end < n:
                window = slice(end, min(n, end + size))
                other = np.flatnonzero((_lengths(unit[window] - unit[start]) > tolerance) | ~rest[window])
                if other.size:
                    end += int(other[0])
                    break
                end, size = window.stop, 2 * size
        edges.append(end)
        start = end
    return np.array(edges[:-1]), np.array(edges[1:])


def _means(value: Array | None, row: Array, count: Array) -> Any:
    """Mean over the readings of each row; valid as readings at rest are linear in all averaged quantities."""
    if value is None:
        return None
    if len(count) == len(value):
        return value
    total = np.zeros((len(count), *value.shape[1:]))
    np.add.at(total, row[row >= 0], value[row >= 0])
    return total / count.reshape(-1, *[1] * (value.ndim - 1))


def _labels(log: ReadingLog, tolerance: float, moving: Array) -> Array:
    """Cluster (n,) of each row: the index of the first row in the same orientation."""
    n = len(log)
    if n > MAX_COMPARED_DWELLS or moving.all():
        return np.arange(n)
    R = log.gravity / np.linalg.norm(log.gravity, axis=1, keepdims=True)
    if log.rotations is not None:
        R = log.rotations.reshape(n, 9)
    label, known = np.arange(n), np.zeros(n, bool)
    for k in np.flatnonzero(~moving).tolist():
        same = np.flatnonzero(known & (_lengths(R - R[k]) <= tolerance))
        if same.size:
            label[k] = int(same[0])
        else:
            known[k] = True
    return label


def _lengths(x: Array) -> Array:
    return np.asarray(np.linalg.norm(x, axis=-1))


def runs(mask: Array) -> list[tuple[int, int]]:
    """First and last index of each run of true values in ``mask`` (n,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(int), [0]])))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]
