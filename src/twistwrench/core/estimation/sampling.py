"""Sampling of a log: repeated rows, delays, omitted rows, spikes, single wrong rows, and scale of rates.

The displacement of joint j in step i differs from the mean of the neighbouring speeds by

    e_ij = q_j(t_{i+1}) - q_j(t_i) - h_i v_ij.

Positions that become late by s give e_i = -s v_i in all joints at once; omitted rows give e_i = s v_i. In both cases the
neighbouring steps are normal. Let d_i be the deviation of q_i from the straight line between its neighbours. A corner of a
path is one large d. A single wrong row of size d is (-d/2, d, -d/2), larger than elsewhere in the log. A stamp that is
wrong by s gives d = -s dq/dt in every joint.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..typing import Array
from .least_squares import MAD

GAP = 5.0
"""Ratio to the typical time step above which a step is a pause."""
_EVENTS, _RUN, _REGULAR = 20, 3, 0.8
"""Criteria of repeated rows: minimum changes of the positions, rows between changes, and share of equal intervals."""
_ROUND = 1e-9
_COUNTS = 2.0
"""Smallest displacement between runs in least steps of the column; slow encoder counts repeat numbers too."""


class Gap(NamedTuple):
    """Step in which joints move further than their speeds imply."""

    time: float
    late: float
    """Delay [s] of positions after the step, if all joints deviate in proportion to their speeds; else nan."""
    held: int = 0
    """Number of rows before the step that repeat an earlier one, if the step makes up for them; else 0."""


def pauses(time: Array, least: float = 0.0) -> Array:
    """Indices of steps longer than five typical ones and than ``least`` seconds."""
    steps = np.diff(time)
    return np.flatnonzero(steps > max(least, GAP * float(np.median(steps)))) if len(steps) else np.zeros(0, int)


def new_rows(q: Array) -> Array | None:
    """Mask (n,) of new rows of positions (n, k), if all others repeat or interpolate them; else None.

    New rows are at least three rows apart, at equal intervals.
    """
    moved = np.abs(np.diff(q, axis=0))
    if len(moved) < _EVENTS * _RUN:
        return None
    own = moved[:, int(moved.sum(axis=0).argmax())]
    least = float(own[own > 0].min(initial=np.inf))
    bends = np.pad((np.abs(np.diff(q, 2, axis=0)) > _ROUND * np.ptp(q, axis=0).max()).any(axis=1), 1)
    changes = np.pad((moved > 0).any(axis=1), (1, 0))
    for rows in (changes, bends):
        apart = np.diff(np.flatnonzero(rows))
        if len(apart) < _EVENTS or (usual := float(np.median(apart))) < _RUN:
            continue
        regular = (np.abs(apart - usual) <= max(1.0, 0.1 * usual)).mean() >= _REGULAR
        if regular and (rows is bends or float(np.median(own[rows[1:]])) > _COUNTS * least):
            return rows
    return None


def moves(x: Array) -> Array:
    """Mask (k,) of columns (n, k) whose variance is far above that of their white noise, by second differences."""
    noise = (np.diff(x, 2, axis=0) ** 2).mean(axis=0) / 6.0 if len(x) > 2 else np.zeros(x.shape[1])
    return np.asarray(x.var(axis=0) > np.maximum(_ABOVE_NOISE * noise, _ROUND**2))


_ABOVE_NOISE = 10.0
_FAR, _MADS = 3.0, 8.0
"""Minimum departure from the path, in typical steps of a joint and in deviations of e."""
_ALONE, _BESIDE = 5, 0.5
"""Rows on either side, and largest relative departure of others there; a single wrong row makes two departures."""
_STILL = 1e-3
"""Largest step of a repeated row, in usual steps."""
_ALIKE = 0.35
"""Largest share of |e| that is not proportional to the speeds."""


def gaps(time: Array, q: Array) -> list[Gap]:
    """Steps in which all moving joints leave their paths at once; q (n, k) without omitted turns."""
    if len(time) < 2 * _ALONE or not q.size:
        return []
    h = np.diff(time)
    v = np.diff(q, axis=0) / h[:, None]
    speed = 0.25 * (v[:-4] + v[1:-3] + v[3:-1] + v[4:])
    e = (v[2:-2] - speed) * h[2:-2, None]
    usual, least = float(np.median(h)), np.where(v != 0, np.abs(v) * h[:, None], np.inf).min(axis=0)
    size = usual * np.sqrt(np.mean(v**2, axis=0))
    moving = size > 0.02 * size.max(initial=0.0)
    found, noise = list[Gap](), MAD * np.median(np.abs(e), axis=0)
    far = (np.abs(e) > np.maximum(np.maximum(_FAR * size, _MADS * noise), 3.0 * least)) & moving
    off = far.sum(axis=1) >= np.clip(moving.sum(), 1, 2)
    off &= ~np.lib.stride_tricks.sliding_window_view(h > GAP * usual, 5).any(axis=1)
    a, b = e[:, moving] / size[moving], speed[:, moving] / size[moving]
    norm = np.linalg.norm(a, axis=1)
    for i in np.flatnonzero(off).tolist():
        if np.partition(norm[max(0, i - _ALONE) : i + _ALONE + 1], -2)[-2] > _BESIDE * norm[i]:
            continue
        late = -float(a[i] @ b[i]) / max(float(b[i] @ b[i]), 1e-300)
        told = float(np.linalg.norm(a[i] + late * b[i])) < _ALIKE * norm[i]
        held = _held_rows(i + 2, np.diff(q, axis=0)[:, moving] / size[moving])
        found.append(Gap(float(time[i + 2]), late if told else np.nan, held))
    return found


def _held_rows(step: int, steps: Array) -> int:
    """Number of rows before a step (of steps (n, k) in usual ones) that repeat an earlier one; 0 unless the sums agree."""
    first = step
    while first > 0 and np.abs(steps[first - 1]).max() <= _STILL:
        first -= 1
    beside = [steps[k] for k in (first - 2, first - 1, step + 1, step + 2) if 0 <= k < len(steps)]
    missing = steps[step] - (step - first + 1) * np.mean(beside, axis=0)
    return step - first if np.linalg.norm(missing) < _ALIKE * np.linalg.norm(steps[step]) else 0


def held_rows(time: Array, found: Sequence[Gap]) -> Array:
    """Mask (n,) of the rows at times (n,) that repeat an earlier one."""
    held = np.zeros(len(time), bool)
    for gap in found:
        last = int(np.searchsorted(time, gap.time))
        held[last - gap.held + 1 : last + 1] = True
    return held


def late_by_turns(found: Sequence[Gap], begin: float, end: float) -> tuple[float, float] | None:
    """Delay [s], and fraction of time late, of positions that alternate between late and on time; otherwise None."""
    late = np.array([gap.late for gap in found])
    if not ((late > 0).any() and (late < 0).any()):
        return None
    size = float(np.median(np.abs(late[np.isfinite(late)])))
    if not ((np.abs(late) > 0.5 * size) & (np.abs(late) < 2.0 * size)).mean() > _REGULAR:
        return None
    edges = np.array([begin, *(gap.time for gap in found), end])
    state = np.array([late[0] < 0, *(late > 0)])
    return size, float(np.diff(edges)[state].sum() / (end - begin))


def spikes(x: Array) -> Array:
    """Mask (n, k) of values beyond both neighbours by eight deviations of the steps and by the column's deviation."""
    steps = np.diff(x, axis=0)
    usual = [MAD * float(np.median(np.abs(s[s != 0]))) if (s != 0).any() else np.inf for s in steps.T]
    least = np.maximum(_MADS * np.array(usual), x.std(axis=0))
    before, after = steps[:-1], -steps[1:]
    off = (np.minimum(np.abs(before), np.abs(after)) > least) & (before * after > 0)
    return np.pad(off, ((1, 1), (0, 0)))


_STANDS_FOR, _NEW, _SOME, _ALONE_SHARE = 0.3, 0.8, 0.02, 0.5
"""Criteria of dropouts: minimum duration [s] of a constant torque, share of other rows with changes, share of the
joint's range moved meanwhile, and share of rows with all torques constant, as for unpowered motors.
"""


def dropouts(time: Array, tau: Array, q: Array) -> Array:
    """Mask (n, k) of rows with constant torques (n, k) while positions (n, k) move and torques change elsewhere.

    Constant torques at the extremes, except zero, are saturated. If all torques are constant at once, the motors were
    off.
    """
    found, off = np.zeros(tau.shape, bool), (np.diff(tau, axis=0, append=np.inf) == 0).all(axis=1)
    for k, x in enumerate(tau.T):
        edges = np.concatenate([[0], np.flatnonzero(np.diff(x)) + 1, [len(x)]]).tolist()
        rows = [slice(a, b) for a, b in pairwise(edges) if time[b - 1] - time[a] >= _STANDS_FOR]
        others = len(x) - sum(run.stop - run.start for run in rows)
        if len(edges) - 2 - len(rows) < _NEW * max(others, 1):
            continue
        moved, ends = _SOME * np.ptp(q[:, k]), {float(x.min()), float(x.max())} - {0.0}
        for run in rows:
            alone = float(off[run].mean()) < _ALONE_SHARE
            found[run, k] = alone and np.ptp(q[run, k]) > moved and float(x[run.start]) not in ends
    return found


_CUT, _CUT_ROWS, _NEXT = 0.02, 30, 3.0
"""Criteria of saturation: share and number of rows exactly at an extreme, and their ratio to rows at the next value."""


def cut_off(x: Array) -> tuple[float, float] | None:
    """Saturation level of values (n,), and the share of rows at it; None without saturation."""
    for extreme, beside in (
        (x.max(), x[x < x.max()].max(initial=-np.inf)),
        (x.min(), x[x > x.min()].min(initial=np.inf)),
    ):
        count, level = int((x == extreme).sum()), int((x == beside).sum())
        if extreme != 0 and level and count >= max(_CUT_ROWS, _CUT * len(x), _NEXT * level):
            return float(extreme), count / len(x)
    return None


# ── Single rows in which one joint leaves its path: not a motion, at any noise level

_BEYOND = 5.0
"""Minimum ratio to the largest e in the rest of the log."""
_LIKE_HALF = 0.25
"""Largest deviation of the neighbours' e from -d/2, as a share of d: the path continues beside the glitch."""
_LEAST_SIZE, _NO_COUNT = 1e-6, 1e-2
"""Sizes [rad, m] below which a glitch is rounding, and above which it is not a flickering encoder count."""
_LEAST_COUNTS = 3.0
"""Minimum size in least steps of the log, above which it is not a flickering count."""
_MOST = 50
"""Largest number of candidates of a joint; with more, the whole log is rough."""
OVERLAP = 6
"""Rows shared by consecutive portions, so that each row is tested once, with two e on either side."""
_OF_CLOCK = 0.25
"""Largest remainder of d, relative to a row's largest d, for a wrong stamp."""
_MOVING = 0.05
"""Smallest relative speed of a moving joint; a single moving joint cannot separate stamp and position errors."""


@dataclass(frozen=True)
class Glitch:
    """Wrong row of one joint."""

    size: float
    """|d| [rad, m]."""
    time: float
    late: float
    """Delay of the stamp [s], if every joint leaves its path in proportion to its speed; else 0."""


class SingleRowGlitches:
    """Running search for wrong rows, over portions that overlap by :data:`OVERLAP` rows."""

    def __init__(self, count: int, turns: Array) -> None:
        """Create for ``count`` joints; joints in the mask ``turns`` (k,) may step by a full turn."""
        self.turns = turns
        self._usual = 0.0
        self._largest, self._least_step = np.zeros(count), np.full(count, np.inf)
        self._found: list[list[Glitch]] = [[] for _ in range(count)]
        """Candidates of each joint."""

    def add(self, t: Array, q: Array) -> None:
        """Add consecutive rows, (n,) and (n, k), starting with the last rows of the previous portion."""
        if len(t) <= OVERLAP:
            return
        curves = q.copy()
        curves[:, self.turns] = np.unwrap(q[:, self.turns], axis=0)
        steps = np.abs(np.diff(curves, axis=0))
        self._least_step = np.minimum(self._least_step, np.where(steps > 0, steps, np.inf).min(axis=0))
        steps_of_time = np.diff(t)
        self._usual = self._usual or float(np.median(steps_of_time))
        pause = steps_of_time > GAP * self._usual
        bridged = (pause[1:] | pause[:-1])[:, None]  # the path across a pause is unknown
        share = ((t[1:-1] - t[:-2]) / (t[2:] - t[:-2]))[:, None]
        e = curves[1:-1] - curves[:-2] - share * (curves[2:] - curves[:-2])
        e = np.where(bridged, 0.0, e)
        d = e[1:-1]
        beside = np.maximum(np.abs(e[:-2] + d / 2), np.abs(e[2:] + d / 2))
        candidate = (np.abs(d) > _LEAST_SIZE) & (beside < _LIKE_HALF * np.abs(d))
        touched = candidate[:-2] | candidate[1:-1] | candidate[2:]
        self._largest = np.maximum(self._largest, np.where(touched, 0.0, np.abs(e[2:-2])).max(axis=0))
        for k in np.flatnonzero(candidate[1:-1].any(axis=0)).tolist():
            rows = np.flatnonzero(candidate[1:-1, k])
            largest = rows[np.argsort(-np.abs(e[rows + 2, k]), kind="stable")[:_MOST]]
            for row in largest.tolist():
                slope = (curves[row + 4] - curves[row + 2]) / (t[row + 4] - t[row + 2])
                self._found[k].append(Glitch(abs(float(e[row + 2, k])), float(t[row + 3]), _late(e[row + 2], slope)))
            self._found[k] = sorted(self._found[k], key=lambda one: -one.size)[:_MOST]

    def result(self) -> list[tuple[int, list[Glitch]]]:
        """Joints with wrong rows and these rows, largest first."""
        found = []
        for k, candidates in enumerate(self._found):
            bound = max(_BEYOND * float(self._largest[k]), min(_LEAST_COUNTS * float(self._least_step[k]), _NO_COUNT))
            wrong = [g for g in candidates if g.size > bound]
            if wrong and len(wrong) < _MOST:
                found.append((k, wrong))
        return found

    def times(self) -> Array:
        """Times of all wrong rows, whether position or stamp is wrong."""
        return np.array(sorted({g.time for _, wrong in self.result() for g in wrong}))

    def stamps(self) -> dict[float, float]:
        """Delay [s] by time of the rows with a wrong stamp."""
        return {g.time: g.late for _, wrong in self.result() for g in wrong if g.late}


def _late(d: Array, speed: Array) -> float:
    """Delay of a row's stamp [s] if joints with speeds (k,) leave their paths by d (k,) in proportion; else 0."""
    if (np.abs(speed) > _MOVING * np.abs(speed).max(initial=0.0)).sum() < 2:
        return 0.0
    found = float(d @ speed) / float(speed @ speed)
    return -found if np.abs(d - found * speed).max() < _OF_CLOCK * np.abs(d).max() else 0.0


# ── Scale of logged rates relative to the slopes of their curves

_ROWS = 512
"""Largest number of rows for integrating a rate, so that its bias adds up to little."""
_FEWEST = 8
_OVER_NOISE, _STEPS = 100.0, 30.0
"""A curve moves if its variance exceeds that of its white noise, and its range its least step, by these factors. An
encoder at rest that flickers by a count or two does not move.
"""
_ROUNDING = (1e-10, 1e-9)
"""Range [rad, m, 1/s of them], and share of the largest range, that may be rounding."""
_ALIASED = 0.05
"""Largest relative change of a summed rate's squares when every other row is left out."""
_SLOW = 0.02
"""Share of the fastest curve's speed below which a curve's rate is irrelevant."""
_MOVES = 0.2
"""Minimum range [rad, m] of an integrated rate that contradicts a curve at rest."""
_STANDS = 0.02


def segments(time: Array) -> list[slice]:
    """Runs of 8 to 512 rows without gaps in time."""
    if len(time) < _FEWEST:
        return []
    edges = sorted({*(pauses(time) + 1).tolist(), *range(0, len(time), _ROWS), len(time)})
    return [slice(a, b) for a, b in pairwise(edges) if b - a >= _FEWEST]


def rate_scales(runs: Sequence[tuple[Array, Array, Array]], alike: Array) -> Array:
    """Scale (k,) of rates y over the slopes of curves x, by least squares on ∫y dt; runs are (t, x, y).

    It is 1 if they agree or it is undetermined, inf if y moves and x does not. Speeds are compared among curves of one
    kind, as given by ``alike`` (k,), because units differ.
    """
    parts = [_sums(t[s], x[s], y[s]) for t, x, y in runs for s in segments(t)]
    if not parts:
        return np.ones(len(alike))
    xx, xy, yy, noise, coarse = np.sum([sums for sums, _, _ in parts], axis=0)
    extent, summed, speed = np.max([most for _, most, _ in parts], axis=0)
    step = np.min([least for _, _, least in parts], axis=0)
    moves = (xx > _OVER_NOISE * noise) & (extent > _STEPS * step)
    for kind in np.unique(alike):
        here = alike == kind
        moves[here] &= speed[here] >= _SLOW * speed[here].max(initial=0.0)
    moves &= extent > max(_ROUNDING[0], _ROUNDING[1] * float(extent.max(initial=0.0)))
    moves &= coarse <= _ALIASED * yy
    gain = np.where(moves, xy / np.where(moves, xx, 1.0), 1.0)
    stands = ~moves & (summed > _MOVES) & (extent < _STANDS * summed)
    return np.where(stands, np.inf, gain)


def _sums(time: Array, x: Array, y: Array) -> tuple[Array, Array, Array]:
    """Sums (5, k), largest numbers (3, k) and least steps (k,) of one segment."""
    integral, extent, moved = _integral(time, y), np.ptp(x, axis=0), np.abs(np.diff(x, axis=0))
    # Integrate every other row for comparison: samples do not resolve a rate that changes from row to row.
    coarser = _integral(time[::2], y[::2]) - integral[::2]
    a, b = x - x.mean(axis=0), integral - integral.mean(axis=0)
    noise = np.sum(np.diff(x, 2, axis=0) ** 2, axis=0) / 6.0
    sums = np.stack(
        [(a * a).sum(axis=0), (a * b).sum(axis=0), (b * b).sum(axis=0), noise, 2.0 * (coarser**2).sum(axis=0)]
    )
    most = np.stack([extent, np.ptp(integral, axis=0), extent / (time[-1] - time[0])])
    return sums, most, np.where(moved > 0, moved, np.inf).min(axis=0)


def _integral(time: Array, y: Array) -> Array:
    """∫y dt by the trapezoidal rule, starting at 0."""
    summed = np.cumsum(0.5 * np.diff(time)[:, None] * (y[1:] + y[:-1]), axis=0)
    return np.concatenate([np.zeros((1, y.shape[1])), summed])


# ── Delay of a logged rate relative to its curve

_LAGS = np.linspace(-0.6, 0.6, 97)
"""Delays to be tested [s]."""
_STEP, _SHORTEST = 0.005, 1.5
"""Time between compared rows, and shortest length of a run [s]."""
_LEAST, _LEAST_STEPS = 0.04, 2.0
"""Smallest reported delay in s and in time steps; filters of drives, and stamps per control cycle, cause less."""
_LEFT, _MATTERS = 0.25, 2e-4
"""Largest share of the squares left by a valid delay, and smallest relevant share of the curve's squares."""
_AS_GOOD = 1e-3
"""Tolerance, as a share of the squares, for equally good delays. The shortest of them is used; repeating motions have
several.
"""
_SOME_MOVE = 0.05
"""Smallest range [rad, m] of a curve about its trend for a comparison."""


def rate_delays(runs: Sequence[tuple[Array, Array, Array]], count: int) -> Array:
    """Delay d (k,) [s] of rates y of curves x with y(t) = x'(t - d), by least squares on ∫y dt; 0 if undetermined.

    Runs are time (n,), x (n, k) without jumps and y (n, k). Mean and trend of both are removed in each run without
    gaps, so that a bias of y has no effect.
    """
    errors, squares, extent, longest = np.zeros((len(_LAGS), count)), np.zeros(count), np.zeros(count), 0.0
    for t, x, y in runs:
        steps = np.diff(t)
        if not len(steps):
            continue
        usual = float(np.median(steps))
        longest, integral, stride = max(longest, usual), _integral(t, y), max(1, round(_STEP / usual))
        edges = [0, *(pauses(t) + 1).tolist(), len(t)]
        for a, b in pairwise(edges):
            found = _left_by_lags(t[a:b:stride], x[a:b:stride], integral[a:b:stride])
            if found is not None:
                wanted, left = found
                errors += left
                squares += np.sum(wanted**2, axis=0)
                extent = np.maximum(extent, np.ptp(wanted, axis=0))
    padded = np.pad(errors, ((1, 1), (0, 0)), constant_values=np.inf)
    dips = (errors <= padded[:-2]) & (errors <= padded[2:]) & (errors <= errors.min(axis=0) + _AS_GOOD * squares)
    best = np.where(dips, np.abs(_LAGS)[:, None], np.inf).argmin(axis=0)
    at = np.arange(count)
    now, then = errors[len(_LAGS) // 2], errors[best, at]
    told = (
        (best > 0) & (best < len(_LAGS) - 1) & (then < _LEFT * now) & (now > _MATTERS * squares) & (extent > _SOME_MOVE)
    )
    told &= np.abs(_LAGS[best]) >= max(_LEAST, _LEAST_STEPS * longest)
    before, here, after = (errors[np.clip(best + k, 0, len(_LAGS) - 1), at] for k in (-1, 0, 1))
    bend = before - 2.0 * here + after
    finer = np.where(bend > 0, 0.5 * (before - after) / np.where(bend > 0, bend, 1.0), 0.0)
    return np.where(told, _LAGS[best] + finer * (_LAGS[1] - _LAGS[0]), 0.0)


def _left_by_lags(t: Array, x: Array, integral: Array) -> tuple[Array, Array] | None:
    """Curves (n, k) of one run without mean and trend, and residual squares (lags, k) by lag; None for short runs."""
    used = (t >= t[0] - _LAGS[0]) & (t <= t[-1] - _LAGS[-1])
    if t[-1] - t[0] < _SHORTEST or used.sum() < len(_LAGS):
        return None
    basis = np.linalg.qr(np.stack([np.ones(used.sum()), t[used] - t[0]], axis=1))[0]
    wanted = _without(basis, x[used])
    places = t[used] + _LAGS[:, None]
    shifted = (np.stack([np.interp(at, t, y) for y in integral.T], axis=1) for at in places)
    return wanted, np.array([np.sum((_without(basis, y) - wanted) ** 2, axis=0) for y in shifted])


def _without(basis: Array, x: Array) -> Array:
    return np.asarray(x - basis @ (basis.T @ x))
