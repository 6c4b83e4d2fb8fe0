"""Sampling of a log: repeated rows, delays, omitted rows, spikes, dropouts and saturation.

In step i, of length h_i, joint j moves by q_j(t_{i+1}) - q_j(t_i). With v_ij, the mean speed in the neighbouring steps, the
unexpected part of this displacement is

    e_ij = q_j(t_{i+1}) - q_j(t_i) - h_i v_ij.

If positions are late by s seconds from step i on, e_i = -s v_i in all joints at once. If rows for s seconds are omitted,
e_i = s v_i. In both cases the neighbouring steps are normal. A single wrong row changes two steps.
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
_MIN_CHANGES = 20
"""Rows are called repeated only if the positions change at least so often."""
_MIN_ROWS_APART = 3
"""Rows are called repeated only if changes are at least so many rows apart."""
_MIN_REGULAR_SHARE = 0.8
"""Rows are called repeated only if at least this share of the intervals between changes is equal."""
_MAX_ROUNDING = 1e-9
"""Largest rounding error of a curve, as a share of its range, and of a standard deviation [rad, m]."""
_MIN_COUNTS = 2.0
"""Smallest usual displacement at a change, in least steps of the column. Counts of a slow encoder repeat numbers, too."""
_MAX_IRREGULARITY = 0.1
"""Largest difference of an equal interval from the usual one, as a share; one row is always allowed."""


class Gap(NamedTuple):
    """Step in which joints move more or less than their speeds imply."""

    time: float
    """Beginning of the step [s]."""
    late: float
    """Delay [s] of positions after the step if all joints deviate in proportion to their speeds; otherwise nan."""
    held: int = 0
    """Number of rows before the step that repeat an earlier row, if the step makes up for them; otherwise 0."""


def pauses(time: Array, min_length: float = 0.0) -> Array:
    """Indices of steps that are longer than ``GAP`` typical steps and longer than ``min_length`` seconds."""
    steps = np.diff(time)
    if not len(steps):
        return np.zeros(0, int)
    typical_step = float(np.median(steps))
    return np.flatnonzero(steps > max(min_length, GAP * typical_step))


def new_rows(q: Array) -> Array | None:
    """Mask (n,) of the new rows of positions (n, k), if all other rows repeat or interpolate new ones; otherwise None.

    New rows are at least three rows apart, at equal intervals.
    """
    steps = np.abs(np.diff(q, axis=0))
    if len(steps) < _MIN_CHANGES * _MIN_ROWS_APART:
        return None
    fastest_joint = int(steps.sum(axis=0).argmax())
    steps_of_fastest = steps[:, fastest_joint]
    least_step = float(steps_of_fastest[steps_of_fastest > 0].min(initial=np.inf))
    is_change = (steps > 0).any(axis=1)
    changes = np.pad(is_change, (1, 0))  # step i leads to row i + 1
    if _have_equal_intervals(changes):
        usual_change = float(np.median(steps_of_fastest[is_change]))
        if usual_change > _MIN_COUNTS * least_step:
            return changes
    rounding = _MAX_ROUNDING * np.ptp(q, axis=0).max()
    is_bend = (np.abs(np.diff(q, 2, axis=0)) > rounding).any(axis=1)
    bends = np.pad(is_bend, 1)  # second difference i is at row i + 1
    if _have_equal_intervals(bends):
        return bends
    return None


def _have_equal_intervals(rows: Array) -> bool:
    """True if a mask (n,) has enough rows, several rows apart, at intervals that are mostly equal."""
    intervals = np.diff(np.flatnonzero(rows))
    if len(intervals) < _MIN_CHANGES:
        return False
    usual_interval = float(np.median(intervals))
    is_regular = np.abs(intervals - usual_interval) <= max(1.0, _MAX_IRREGULARITY * usual_interval)
    return bool(usual_interval >= _MIN_ROWS_APART and is_regular.mean() >= _MIN_REGULAR_SHARE)


def moves(x: Array) -> Array:
    """Mask (k,) of columns (n, k) whose variance is far above that of their white noise.

    Second differences of white noise have 6 times its variance; those of a smooth curve are small.
    """
    noise_variance = np.zeros(x.shape[1])
    if len(x) > 2:
        noise_variance = (np.diff(x, 2, axis=0) ** 2).mean(axis=0) / 6.0
    least_variance = np.maximum(_MIN_RATIO_TO_NOISE * noise_variance, _MAX_ROUNDING**2)
    return np.asarray(x.var(axis=0) > least_variance)


_MIN_RATIO_TO_NOISE = 10.0
"""Smallest variance of a curve that moves, relative to the variance of its white noise."""
_MIN_STEPS_OFF_PATH = 3.0
"""Smallest |e| of a gap, in typical steps of a joint."""
_MIN_LEAST_STEPS = 3.0
"""Smallest |e| of a gap, in least steps of the column."""
_MIN_SPEED_OF_MOVING = 0.02
"""Smallest typical step of a joint that moves, relative to the fastest joint's."""
_MIN_DEVIATIONS = 8.0
"""Smallest |e| of a gap, and smallest height of a spike, in standard deviations."""
_ROWS_BESIDE = 5
"""Number of steps on either side that are compared with a gap."""
_MAX_DEPARTURE_BESIDE = 0.5
"""Largest |e| of these steps relative to |e| of the gap; a single wrong row has two large |e| side by side."""
_MAX_STEP_AT_REST = 1e-3
"""Largest step to a repeated row, in typical steps."""
_MIN_SPEED_SQUARE = 1e-300
"""Smallest squared speed, so that rest is not divided by zero."""
_MAX_DISAGREEMENT = 0.35
"""Largest share of |e| that is not proportional to the speeds."""


def gaps(time: Array, q: Array) -> list[Gap]:
    """Steps in which all moving joints leave their paths at once; q (n, k) without jumps by whole turns."""
    if len(time) < 2 * _ROWS_BESIDE or not q.size:
        return []
    h = np.diff(time)
    v = np.diff(q, axis=0) / h[:, None]
    neighbours_v = 0.25 * (v[:-4] + v[1:-3] + v[3:-1] + v[4:])  # mean speed of two steps before and two after
    e = (v[2:-2] - neighbours_v) * h[2:-2, None]
    typical_h = float(np.median(h))
    nonzero_steps = np.where(v != 0, np.abs(v) * h[:, None], np.inf)
    least_step = nonzero_steps.min(axis=0)
    typical_step = typical_h * np.sqrt(np.mean(v**2, axis=0))
    noise = MAD * np.median(np.abs(e), axis=0)
    min_step_of_moving = _MIN_SPEED_OF_MOVING * typical_step.max(initial=0.0)
    is_moving = typical_step > min_step_of_moving  # mask of joints
    bound = np.maximum(_MIN_STEPS_OFF_PATH * typical_step, _MIN_DEVIATIONS * noise)
    bound = np.maximum(bound, _MIN_LEAST_STEPS * least_step)
    off_path = (np.abs(e) > bound) & is_moving
    min_joints = np.clip(is_moving.sum(), 1, 2)  # two joints, or one if only one moves
    candidates = off_path.sum(axis=1) >= min_joints
    # A pause in any of the five steps makes their speeds incomparable.
    is_pause = np.lib.stride_tricks.sliding_window_view(h > GAP * typical_h, 5)
    candidates &= ~is_pause.any(axis=1)
    relative_e = e[:, is_moving] / typical_step[is_moving]
    relative_v = neighbours_v[:, is_moving] / typical_step[is_moving]
    relative_steps = np.diff(q, axis=0)[:, is_moving] / typical_step[is_moving]
    norms = np.linalg.norm(relative_e, axis=1)
    found = list[Gap]()
    for i in np.flatnonzero(candidates).tolist():  # row i of e belongs to step i + 2
        neighbourhood = norms[max(0, i - _ROWS_BESIDE) : i + _ROWS_BESIDE + 1]
        second_largest = np.partition(neighbourhood, -2)[-2]
        if second_largest > _MAX_DEPARTURE_BESIDE * norms[i]:
            continue
        speed_square = float(relative_v[i] @ relative_v[i])
        speed_square = max(speed_square, _MIN_SPEED_SQUARE)
        delay = -float(relative_e[i] @ relative_v[i]) / speed_square  # least squares of e = -delay v
        residual = float(np.linalg.norm(relative_e[i] + delay * relative_v[i]))
        is_proportional = residual < _MAX_DISAGREEMENT * norms[i]
        held = _held_row_count(i + 2, relative_steps)
        late = delay if is_proportional else np.nan
        found.append(Gap(float(time[i + 2]), late, held))
    return found


def _held_row_count(step: int, steps: Array) -> int:
    """Number of rows before a step that repeat an earlier row; 0 unless the step makes up for them.

    ``steps`` (n, k) are all steps relative to typical ones.
    """
    held_count = 0
    while held_count < step and np.abs(steps[step - held_count - 1]).max() <= _MAX_STEP_AT_REST:
        held_count += 1
    first = step - held_count  # of the steps at rest before, or the step itself
    neighbour_indices = (first - 2, first - 1, step + 1, step + 2)
    neighbours = [steps[k] for k in neighbour_indices if 0 <= k < len(steps)]
    expected = (held_count + 1) * np.mean(neighbours, axis=0)  # motion of the step itself and of the held rows
    difference = steps[step] - expected
    if np.linalg.norm(difference) < _MAX_DISAGREEMENT * np.linalg.norm(steps[step]):
        return held_count
    return 0


def held_rows(time: Array, gaps: Sequence[Gap]) -> Array:
    """Mask (n,) of the rows at times (n,) that repeat an earlier row, by the gaps of :func:`gaps`."""
    mask = np.zeros(len(time), bool)
    for gap in gaps:
        row = int(np.searchsorted(time, gap.time))  # at which the step begins: the last held row
        mask[row - gap.held + 1 : row + 1] = True
    return mask


class LatePositions(NamedTuple):
    """Positions that alternate between late and on time."""

    delay: float
    """Delay of the late positions [s]."""
    min_share: float
    """Smallest share of the time in which they are late."""
    max_share: float
    """Largest share: larger than the smallest if a change was not seen, as at rest, so that its time is unknown."""


_MAX_SIZE_RATIO = 2.0
"""Largest ratio of a delay to the typical delay, or of the typical delay to it, of similar sizes."""


def late_by_turns(gaps: Sequence[Gap], begin: float, end: float) -> LatePositions | None:
    """Delay of positions that alternate between late and on time from ``begin`` to ``end`` [s].

    None unless the delays at the gaps have both signs and mostly similar sizes.
    """
    delays = np.array([gap.late for gap in gaps])
    has_both_signs = (delays > 0).any() and (delays < 0).any()
    if not has_both_signs:
        return None
    sizes = np.abs(delays)
    typical_size = float(np.median(sizes[np.isfinite(delays)]))
    # the size of a gap without a delay is nan, which is not similar
    is_similar = (sizes > typical_size / _MAX_SIZE_RATIO) & (sizes < _MAX_SIZE_RATIO * typical_size)
    if not is_similar.mean() > _MIN_REGULAR_SHARE:
        return None
    is_change = np.isfinite(delays)
    becomes_late = delays[is_change] > 0
    times = np.array([gap.time for gap in gaps])[is_change]
    lengths = np.diff(np.concatenate([[begin], times, [end]]))  # of the intervals between changes
    late_at_start = np.concatenate([[not becomes_late[0]], becomes_late])
    late_at_end = np.concatenate([~becomes_late, [becomes_late[-1]]])
    late_throughout = float(lengths[late_at_start & late_at_end].sum())
    late_in_part = float(lengths[late_at_start != late_at_end].sum())
    duration = end - begin
    return LatePositions(typical_size, late_throughout / duration, (late_throughout + late_in_part) / duration)


def spikes(x: Array) -> Array:
    """Mask (n, k) of values above or below both neighbours by eight deviations of the steps and by the column's deviation."""
    steps = np.diff(x, axis=0)
    step_deviation = np.full(x.shape[1], np.inf)
    for k, column in enumerate(steps.T):
        nonzero_steps = column[column != 0]
        if len(nonzero_steps):
            step_deviation[k] = MAD * float(np.median(np.abs(nonzero_steps)))
    bound = np.maximum(_MIN_DEVIATIONS * step_deviation, x.std(axis=0))
    above_previous = steps[:-1]  # height above the previous value, with sign
    above_next = -steps[1:]
    height = np.minimum(np.abs(above_previous), np.abs(above_next))
    is_spike = (height > bound) & (above_previous * above_next > 0)  # the same sign on both sides
    return np.pad(is_spike, ((1, 1), (0, 0)))


_MIN_DROPOUT = 0.3
"""Smallest duration of a constant torque that is a dropout [s]."""
_MIN_SHARE_OF_CHANGES = 0.8
"""Smallest share of the rows outside dropouts in which the torque changes."""
_MIN_MOTION = 0.02
"""Smallest motion of the joint during a dropout, as a share of its range in the log."""
_MAX_SHARE_UNPOWERED = 0.5
"""Largest share of a dropout in which all torques are constant, as they are if the motors are off."""


def dropouts(time: Array, tau: Array, q: Array) -> Array:
    """Mask (n, k) of rows in dropouts: torques (n, k) are constant while positions (n, k) move, and change elsewhere.

    Constant torques at the extremes, except zero, are saturated. If all torques are constant at once, the motors were
    off.
    """
    mask = np.zeros(tau.shape, bool)
    is_unpowered = (np.diff(tau, axis=0, append=np.inf) == 0).all(axis=1)
    for k, torques in enumerate(tau.T):
        changes = np.flatnonzero(np.diff(torques)) + 1
        run_bounds = [0, *changes.tolist(), len(torques)]
        constant_runs = []
        for begin, end in pairwise(run_bounds):
            duration = time[end - 1] - time[begin]
            if duration >= _MIN_DROPOUT:
                constant_runs.append(slice(begin, end))
        other_row_count = len(torques) - sum(run.stop - run.start for run in constant_runs)
        other_change_count = len(changes) - len(constant_runs)
        if other_change_count < _MIN_SHARE_OF_CHANGES * max(other_row_count, 1):
            continue
        min_motion = _MIN_MOTION * np.ptp(q[:, k])
        saturated = {float(torques.min()), float(torques.max())} - {0.0}
        for run in constant_runs:
            is_powered = float(is_unpowered[run].mean()) < _MAX_SHARE_UNPOWERED
            moves_meanwhile = np.ptp(q[run, k]) > min_motion
            is_saturated = float(torques[run.start]) in saturated
            mask[run, k] = is_powered and moves_meanwhile and not is_saturated
    return mask


_MIN_SATURATED_SHARE = 0.02
"""Smallest share of rows exactly at an extreme that is saturation."""
_MIN_SATURATED_ROWS = 30
"""Smallest number of rows exactly at an extreme that is saturation."""
_MIN_RATIO_TO_NEXT = 3.0
"""Smallest ratio of the rows exactly at an extreme to those at the next value."""


def cut_off(x: Array) -> tuple[float, float] | None:
    """Saturation level of values (n,), and the share of rows at it; None without saturation."""
    largest = x.max()
    smallest = x.min()
    next_to_largest = x[x < largest].max(initial=-np.inf)
    next_to_smallest = x[x > smallest].min(initial=np.inf)
    # each extreme with the next value
    for extreme, next_value in ((largest, next_to_largest), (smallest, next_to_smallest)):
        count = int((x == extreme).sum())
        next_count = int((x == next_value).sum())  # 0 if all values are equal
        min_count = max(_MIN_SATURATED_ROWS, _MIN_SATURATED_SHARE * len(x), _MIN_RATIO_TO_NEXT * next_count)
        if extreme != 0 and next_count and count >= min_count:
            return float(extreme), count / len(x)
    return None
