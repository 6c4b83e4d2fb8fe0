"""Sampling of a log: repeated rows, delays, omitted rows, spikes, dropouts and saturation.

The displacement of joint j in step i differs from the mean of the neighbouring speeds by

    e_ij = q_j(t_{i+1}) - q_j(t_i) - h_i v_ij.

Positions that become late by s give e_i = -s v_i in all joints at once; omitted rows give e_i = s v_i. In both cases the
neighbouring steps are normal. Let d_i be the deviation of q_i from the straight line between its neighbours. A corner of a
path is one large d. A single wrong row of size d is (-d/2, d, -d/2), larger than elsewhere in the log. A stamp that is
wrong by s gives d = -s dq/dt in every joint.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..typing import Array
from .least_squares import MAD

GAP = 5.0
"""Ratio to the typical time step above which a step is a pause."""
_MIN_CHANGES, _MIN_ROWS_APART, _MIN_REGULAR_SHARE = 20, 3, 0.8
"""Criteria of repeated rows: minimum changes of the positions, rows between changes, and share of equal intervals."""
_MAX_ROUNDING = 1e-9
"""Largest rounding error of a curve, as a share of its range, and of a standard deviation [rad, m]."""
_MIN_COUNTS = 2.0
"""Smallest displacement between runs in least steps of the column; slow encoder counts repeat numbers too."""


class Gap(NamedTuple):
    """Step in which joints move further than their speeds imply."""

    time: float
    late: float
    """Delay [s] of positions after the step, if all joints deviate in proportion to their speeds; else nan."""
    held: int = 0
    """Number of rows before the step that repeat an earlier one, if the step makes up for them; else 0."""


def pauses(time: Array, min_length: float = 0.0) -> Array:
    """Indices of steps longer than five typical ones and than ``min_length`` seconds."""
    steps = np.diff(time)
    if not len(steps):
        return np.zeros(0, int)
    return np.flatnonzero(steps > max(min_length, GAP * float(np.median(steps))))


def new_rows(q: Array) -> Array | None:
    """Mask (n,) of new rows of positions (n, k), if all others repeat or interpolate them; else None.

    New rows are at least three rows apart, at equal intervals.
    """
    moved = np.abs(np.diff(q, axis=0))
    if len(moved) < _MIN_CHANGES * _MIN_ROWS_APART:
        return None
    fastest = moved[:, int(moved.sum(axis=0).argmax())]
    count = float(fastest[fastest > 0].min(initial=np.inf))
    changes = np.pad((moved > 0).any(axis=1), (1, 0))
    if _have_equal_intervals(changes) and float(np.median(fastest[changes[1:]])) > _MIN_COUNTS * count:
        return changes
    bends = np.pad((np.abs(np.diff(q, 2, axis=0)) > _MAX_ROUNDING * np.ptp(q, axis=0).max()).any(axis=1), 1)
    if _have_equal_intervals(bends):
        return bends
    return None


def _have_equal_intervals(rows: Array) -> bool:
    """True if the rows of a mask (n,) are enough, several rows apart, and most intervals are alike."""
    intervals = np.diff(np.flatnonzero(rows))
    if len(intervals) < _MIN_CHANGES:
        return False
    usual = float(np.median(intervals))
    regular = np.abs(intervals - usual) <= max(1.0, 0.1 * usual)
    return bool(usual >= _MIN_ROWS_APART and regular.mean() >= _MIN_REGULAR_SHARE)


def moves(x: Array) -> Array:
    """Mask (k,) of columns (n, k) whose variance is far above that of their white noise, by second differences."""
    noise = np.zeros(x.shape[1])
    if len(x) > 2:
        noise = (np.diff(x, 2, axis=0) ** 2).mean(axis=0) / 6.0
    return np.asarray(x.var(axis=0) > np.maximum(_MIN_RATIO_TO_NOISE * noise, _MAX_ROUNDING**2))


_MIN_RATIO_TO_NOISE = 10.0
"""Variance of a curve that moves, relative to the variance of its white noise."""
_MIN_STEPS_OFF_PATH, _MIN_DEVIATIONS = 3.0, 8.0
"""Minimum departure from the path, in typical steps of a joint and in deviations of e."""
_ROWS_BESIDE, _MAX_DEPARTURE_BESIDE = 5, 0.5
"""Rows on either side, and largest relative departure of others there; a single wrong row makes two departures."""
_MAX_STEP_AT_REST = 1e-3
"""Largest step of a repeated row, in usual steps."""
_MAX_DISAGREEMENT = 0.35
"""Largest share of |e| that is not proportional to the speeds."""


def gaps(time: Array, q: Array) -> list[Gap]:
    """Steps in which all moving joints leave their paths at once; q (n, k) without omitted turns."""
    if len(time) < 2 * _ROWS_BESIDE or not q.size:
        return []
    h = np.diff(time)
    v = np.diff(q, axis=0) / h[:, None]
    speed = 0.25 * (v[:-4] + v[1:-3] + v[3:-1] + v[4:])
    e = (v[2:-2] - speed) * h[2:-2, None]
    usual_h = float(np.median(h))
    least_step = np.where(v != 0, np.abs(v) * h[:, None], np.inf).min(axis=0)
    size = usual_h * np.sqrt(np.mean(v**2, axis=0))
    noise = MAD * np.median(np.abs(e), axis=0)
    moving = size > 0.02 * size.max(initial=0.0)
    bound = np.maximum(np.maximum(_MIN_STEPS_OFF_PATH * size, _MIN_DEVIATIONS * noise), 3.0 * least_step)
    off_path = (np.abs(e) > bound) & moving
    candidates = off_path.sum(axis=1) >= np.clip(moving.sum(), 1, 2)
    candidates &= ~np.lib.stride_tricks.sliding_window_view(h > GAP * usual_h, 5).any(axis=1)
    a, b = e[:, moving] / size[moving], speed[:, moving] / size[moving]
    norm = np.linalg.norm(a, axis=1)
    gaps = list[Gap]()
    for i in np.flatnonzero(candidates).tolist():
        neighbourhood = norm[max(0, i - _ROWS_BESIDE) : i + _ROWS_BESIDE + 1]
        if np.partition(neighbourhood, -2)[-2] > _MAX_DEPARTURE_BESIDE * norm[i]:
            continue
        delay = -float(a[i] @ b[i]) / max(float(b[i] @ b[i]), 1e-300)
        proportional = float(np.linalg.norm(a[i] + delay * b[i])) < _MAX_DISAGREEMENT * norm[i]
        held = _held_row_count(i + 2, np.diff(q, axis=0)[:, moving] / size[moving])
        gaps.append(Gap(float(time[i + 2]), delay if proportional else np.nan, held))
    return gaps


def _held_row_count(step: int, steps: Array) -> int:
    """Number of rows before a step (of steps (n, k) in usual ones) that repeat an earlier one; 0 unless the sums agree."""
    first = step
    while first > 0 and np.abs(steps[first - 1]).max() <= _MAX_STEP_AT_REST:
        first -= 1
    neighbours = [steps[k] for k in (first - 2, first - 1, step + 1, step + 2) if 0 <= k < len(steps)]
    missing = steps[step] - (step - first + 1) * np.mean(neighbours, axis=0)
    if np.linalg.norm(missing) < _MAX_DISAGREEMENT * np.linalg.norm(steps[step]):
        return step - first
    return 0


def held_rows(time: Array, gaps: Sequence[Gap]) -> Array:
    """Mask (n,) of the rows at times (n,) that repeat an earlier one."""
    mask = np.zeros(len(time), bool)
    for gap in gaps:
        row = int(np.searchsorted(time, gap.time))
        mask[row - gap.held + 1 : row + 1] = True
    return mask


class LatePositions(NamedTuple):
    """Positions that alternate between late and on time."""

    delay: float
    """How late [s]."""
    min_share: float
    """Smallest share of the time in which they are late."""
    max_share: float
    """Largest share: larger than the smallest if a change was not seen, as at rest, so that its time is unknown."""


def late_by_turns(gaps: Sequence[Gap], begin: float, end: float) -> LatePositions | None:
    """Delay of positions that alternate between late and on time from ``begin`` to ``end`` [s]; otherwise None."""
    delays = np.array([gap.late for gap in gaps])
    if not ((delays > 0).any() and (delays < 0).any()):
        return None
    size = float(np.median(np.abs(delays[np.isfinite(delays)])))
    if not ((np.abs(delays) > 0.5 * size) & (np.abs(delays) < 2.0 * size)).mean() > _MIN_REGULAR_SHARE:
        return None
    changes = np.isfinite(delays)
    becomes_late = delays[changes] > 0
    times = np.array([gap.time for gap in gaps])[changes]
    lengths = np.diff(np.concatenate([[begin], times, [end]]))
    late_at_start = np.concatenate([[not becomes_late[0]], becomes_late])
    late_at_end = np.concatenate([~becomes_late, [becomes_late[-1]]])
    late_throughout = float(lengths[late_at_start & late_at_end].sum())
    late_in_part = float(lengths[late_at_start != late_at_end].sum())
    duration = end - begin
    return LatePositions(size, late_throughout / duration, (late_throughout + late_in_part) / duration)


def spikes(x: Array) -> Array:
    """Mask (n, k) of values beyond both neighbours by eight deviations of the steps and by the column's deviation."""
    steps = np.diff(x, axis=0)
    usual = np.full(x.shape[1], np.inf)
    for k, column in enumerate(steps.T):
        if (column != 0).any():
            usual[k] = MAD * float(np.median(np.abs(column[column != 0])))
    bound = np.maximum(_MIN_DEVIATIONS * usual, x.std(axis=0))
    before, after = steps[:-1], -steps[1:]
    is_spike = (np.minimum(np.abs(before), np.abs(after)) > bound) & (before * after > 0)
    return np.pad(is_spike, ((1, 1), (0, 0)))


_MIN_DROPOUT, _MIN_SHARE_OF_CHANGES, _MIN_MOTION, _MAX_SHARE_UNPOWERED = 0.3, 0.8, 0.02, 0.5
"""Criteria of dropouts: minimum duration [s] of a constant torque, share of other rows with changes, share of the
joint's range moved meanwhile, and share of rows with all torques constant, as for unpowered motors.
"""


def dropouts(time: Array, tau: Array, q: Array) -> Array:
    """Mask (n, k) of rows with constant torques (n, k) while positions (n, k) move and torques change elsewhere.

    Constant torques at the extremes, except zero, are saturated. If all torques are constant at once, the motors were
    off.
    """
    mask = np.zeros(tau.shape, bool)
    unpowered = (np.diff(tau, axis=0, append=np.inf) == 0).all(axis=1)
    for k, x in enumerate(tau.T):
        edges = np.concatenate([[0], np.flatnonzero(np.diff(x)) + 1, [len(x)]]).tolist()
        runs = [slice(a, b) for a, b in pairwise(edges) if time[b - 1] - time[a] >= _MIN_DROPOUT]
        other_rows = len(x) - sum(run.stop - run.start for run in runs)
        if len(edges) - 2 - len(runs) < _MIN_SHARE_OF_CHANGES * max(other_rows, 1):
            continue
        min_motion, extremes = _MIN_MOTION * np.ptp(q[:, k]), {float(x.min()), float(x.max())} - {0.0}
        for run in runs:
            powered = float(unpowered[run].mean()) < _MAX_SHARE_UNPOWERED
            mask[run, k] = powered and np.ptp(q[run, k]) > min_motion and float(x[run.start]) not in extremes
    return mask


_MIN_SATURATED_SHARE, _MIN_SATURATED_ROWS, _MIN_RATIO_TO_NEXT = 0.02, 30, 3.0
"""Criteria of saturation: share and number of rows exactly at an extreme, and their ratio to rows at the next value."""


def cut_off(x: Array) -> tuple[float, float] | None:
    """Saturation level of values (n,), and the share of rows at it; None without saturation."""
    for extreme, beside in (
        (x.max(), x[x < x.max()].max(initial=-np.inf)),
        (x.min(), x[x > x.min()].min(initial=np.inf)),
    ):
        count, level = int((x == extreme).sum()), int((x == beside).sum())
        min_count = max(_MIN_SATURATED_ROWS, _MIN_SATURATED_SHARE * len(x), _MIN_RATIO_TO_NEXT * level)
        if extreme != 0 and level and count >= min_count:
            return float(extreme), count / len(x)
    return None
