"""Sampling of a log: repeated rows, delays, rows cut out, spikes, single wrong rows, and rates beside the slopes of positions.

The path of joint j over step i departs from the mean of the speeds on either side by

    e_ij = q_j(t_{i+1}) - q_j(t_i) - h_i v_ij.

Positions that begin to be late by s, or rows that were cut out, make e_i = -s v_i or e_i = s v_i in all joints at once, and the
path goes on beside the step. With d_i how far q_i is from the straight line between its neighbours, a corner of a path is one
large d; a single wrong row of size d is (-d/2, d, -d/2), beyond all that the rest of the log has. A stamp that is wrong by s
makes d = -s dq/dt in every joint.
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
"""Usual steps of time from which a step is a pause."""
_EVENTS, _RUN, _REGULAR = 20, 3, 0.8
"""Changes of the positions, rows from one to the next, and share of them that are as far apart, of a log with repeated rows."""
_ROUND = 1e-9
_COUNTS = 2.0
"""Least steps of a column that it moves by from run to run: an encoder that counts one by one repeats numbers too."""


class Gap(NamedTuple):
    """A step that joints go farther in than their speeds take them."""

    time: float
    late: float
    """Seconds by which positions are late from there on, if all joints are off in proportion to their speeds; else nan."""


def pauses(time: Array, least: float = 0.0) -> Array:
    """Numbers of the steps that are longer than five usual ones, and than ``least`` seconds."""
    steps = np.diff(time)
    return np.flatnonzero(steps > max(least, GAP * float(np.median(steps)))) if len(steps) else np.zeros(0, int)


def new_rows(q: Array) -> Array | None:
    """(n,) bool: rows of positions (n, k) that are new, where all others repeat them or lie on lines between them; else None.

    New rows are at least three apart, and always as many.
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
    """(k,) bool: columns (n, k) whose variance is far above that of their white noise, by second differences."""
    noise = (np.diff(x, 2, axis=0) ** 2).mean(axis=0) / 6.0 if len(x) > 2 else np.zeros(x.shape[1])
    return np.asarray(x.var(axis=0) > np.maximum(_ABOVE_NOISE * noise, _ROUND**2))


_ABOVE_NOISE = 10.0
_FAR, _MADS = 3.0, 8.0
"""Usual steps of a joint, and deviations of e, from which it departs from its path."""
_ALONE, _BESIDE = 5, 0.5
"""Rows on either side, and share of a departure that others there may have: a single wrong row makes two alike."""
_ALIKE = 0.35
"""Share of |e| that is left where the departure is in proportion to the speeds."""


def gaps(time: Array, q: Array) -> list[Gap]:
    """Steps at which all moving joints depart from their paths at once; q (n, k) without omitted turns."""
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
        found.append(Gap(float(time[i + 2]), late if told else np.nan))
    return found


def late_by_turns(found: Sequence[Gap], begin: float, end: float) -> tuple[float, float] | None:
    """Delay [s] and share of the time of positions that are late and on time by turns; None of others."""
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
    """(n, k) bool: numbers beyond both neighbours by eight deviations of the steps, and by the column's own deviation."""
    steps = np.diff(x, axis=0)
    usual = [MAD * float(np.median(np.abs(s[s != 0]))) if (s != 0).any() else np.inf for s in steps.T]
    least = np.maximum(_MADS * np.array(usual), x.std(axis=0))
    before, after = steps[:-1], -steps[1:]
    off = (np.minimum(np.abs(before), np.abs(after)) > least) & (before * after > 0)
    return np.pad(off, ((1, 1), (0, 0)))


_STANDS_FOR, _NEW, _SOME, _ALONE_SHARE = 0.3, 0.8, 0.02, 0.5
"""Seconds for which a torque is one number where it drops out, share of the other rows in which it changes, share of a joint's
range that the joint moves by meanwhile, and share of these rows in which all torques are, as of motors without power."""


def dropouts(time: Array, tau: Array, q: Array) -> Array:
    """(n, k) bool: rows in which torques (n, k) are one number, while positions (n, k) move and torques change elsewhere.

    Rows at the least or largest torque, unless it is zero, are those of a torque that is cut off. Where all torques are one
    number at once, the motors were switched off.
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
"""Share of the rows, and rows, that are exactly at an extreme where a column is cut off, and times those at the next number."""


def cut_off(x: Array) -> tuple[float, float] | None:
    """Extreme at which numbers (n,) are cut off, and the share of the rows there; None if they are not."""
    for extreme, beside in (
        (x.max(), x[x < x.max()].max(initial=-np.inf)),
        (x.min(), x[x > x.min()].min(initial=np.inf)),
    ):
        count, level = int((x == extreme).sum()), int((x == beside).sum())
        if extreme != 0 and level and count >= max(_CUT_ROWS, _CUT * len(x), _NEXT * level):
            return float(extreme), count / len(x)
    return None


# ── Rows at which one joint leaves its path and is back in the next row: no motion does that, whatever the noise

_BEYOND = 5.0
"""Times the largest e of the rest of the log, from which the wrong row explains itself."""
_LIKE_HALF = 0.25
"""Deviation of the neighbours' e from -d/2, as a share of d: the path goes on beside the glitch."""
_LEAST_SIZE, _NO_COUNT = 1e-6, 1e-2
"""Sizes [rad, m]: smaller is rounding; larger is not a count of an encoder that flickers."""
_LEAST_COUNTS = 3.0
"""Multiples of the least step of the log from which it is not such a count."""
_MOST = 50
"""Candidates that are kept for a joint; with more the log is rough, and not one row wrong."""
OVERLAP = 6
"""Rows that each portion shares with the one before, so that each row is looked at once, with two e on either side."""
_OF_CLOCK = 0.25
"""Share of the largest d of a row that is left where the stamp is wrong."""
_MOVING = 0.05
"""Share of the fastest joint's speed from which a joint moves: one moving joint does not separate stamp and position."""


@dataclass(frozen=True)
class Glitch:
    """A wrong row of one joint."""

    size: float
    """|d| [rad, m]."""
    time: float
    late: float
    """Delay of its stamp [s], if every joint leaves its path in proportion to its speed; else 0."""


class SingleRowGlitches:
    """A tally over the rows of a motion, which come in portions that overlap by :data:`OVERLAP`."""

    def __init__(self, count: int, turns: Array) -> None:
        """``count`` joints, of which those that turn (k,) bool may step by a full turn."""
        self.turns = turns
        self._usual = 0.0
        self._largest, self._least_step = np.zeros(count), np.full(count, np.inf)
        self._found: list[list[Glitch]] = [[] for _ in range(count)]
        """Candidates of each joint."""

    def add(self, t: Array, q: Array) -> None:
        """Take in consecutive rows, (n,) and (n, k), the first of which are the last ones of those before."""
        if len(t) <= OVERLAP:
            return
        curves = q.copy()
        curves[:, self.turns] = np.unwrap(q[:, self.turns], axis=0)
        steps = np.abs(np.diff(curves, axis=0))
        self._least_step = np.minimum(self._least_step, np.where(steps > 0, steps, np.inf).min(axis=0))
        steps_of_time = np.diff(t)
        self._usual = self._usual or float(np.median(steps_of_time))
        pause = steps_of_time > GAP * self._usual
        bridged = (pause[1:] | pause[:-1])[:, None]  # over a pause, the path says nothing
        share = ((t[1:-1] - t[:-2]) / (t[2:] - t[:-2]))[:, None]
        e = curves[1:-1] - curves[:-2] - share * (curves[2:] - curves[:-2])
        e = np.where(bridged, 0.0, e)
        d = e[1:-1]
        beside = np.maximum(np.abs(e[:-2] + d / 2), np.abs(e[2:] + d / 2))
        candidate = (np.abs(d) > _LEAST_SIZE) & (beside < _LIKE_HALF * np.abs(d))
        touched = candidate[:-2] | candidate[1:-1] | candidate[2:]
        self._largest = np.maximum(self._largest, np.where(touched, 0.0, np.abs(e[2:-2])).max(axis=0))
        for row, k in np.argwhere(candidate[1:-1]).tolist():
            slope = (curves[row + 4] - curves[row + 2]) / (t[row + 4] - t[row + 2])
            found = Glitch(abs(float(e[row + 2, k])), float(t[row + 3]), _late(e[row + 2], slope))
            self._found[k] = sorted([*self._found[k], found], key=lambda g: -g.size)[:_MOST]

    def result(self) -> list[tuple[int, list[Glitch]]]:
        """Each joint that has such rows, with these, the largest first."""
        found = []
        for k, candidates in enumerate(self._found):
            bound = max(_BEYOND * float(self._largest[k]), min(_LEAST_COUNTS * float(self._least_step[k]), _NO_COUNT))
            wrong = [g for g in candidates if g.size > bound]
            if wrong and len(wrong) < _MOST:
                found.append((k, wrong))
        return found

    def times(self) -> Array:
        """Times of all such rows, whatever is wrong in them."""
        return np.array(sorted({g.time for _, wrong in self.result() for g in wrong}))

    def stamps(self) -> dict[float, float]:
        """Times of the rows whose stamp is wrong, and by how much it is late [s]."""
        return {g.time: g.late for _, wrong in self.result() for g in wrong if g.late}


def _late(d: Array, speed: Array) -> float:
    """Delay of a row's stamp [s] if joints of speeds (k,) leave their paths by d (k,) in proportion; else 0."""
    if (np.abs(speed) > _MOVING * np.abs(speed).max(initial=0.0)).sum() < 2:
        return 0.0
    found = float(d @ speed) / float(speed @ speed)
    return -found if np.abs(d - found * speed).max() < _OF_CLOCK * np.abs(d).max() else 0.0


# ── Scale of logged rates over the slopes of what they belong to

_ROWS = 512
"""Most rows over which a rate is summed up: its own bias adds up to little over so few."""
_FEWEST = 8
_OVER_NOISE, _STEPS = 100.0, 30.0
"""A curve moves for certain if its variance is that many times that of its white noise, and its range that many of its
smallest steps: an encoder at rest that flickers by a count or two does not."""
_ROUNDING = (1e-10, 1e-9)
"""A range [rad, m, 1/s of them], or a share of the largest one, that may be rounding."""
_ALIASED = 0.05
"""Share of the squares of a summed rate by which leaving out every other row may change it."""
_SLOW = 0.02
"""Share of the fastest curve's speed below which a curve's rate matters to nobody."""
_MOVES = 0.2
"""Range [rad, m] that a rate must sum up to, to contradict a curve that stands."""
_STANDS = 0.02


def segments(time: Array) -> list[slice]:
    """Runs of at most 512 rows without gaps in time, of at least eight."""
    if len(time) < _FEWEST:
        return []
    edges = sorted({*(pauses(time) + 1).tolist(), *range(0, len(time), _ROWS), len(time)})
    return [slice(a, b) for a, b in pairwise(edges) if b - a >= _FEWEST]


def rate_scales(runs: Sequence[tuple[Array, Array, Array]], alike: Array) -> Array:
    """Scale (k,) of rates y over the slope of curves x by least squares on ∫y dt, in runs of time (n,), x (n, k) and y (n, k).

    It is 1 if they agree or it is undetermined, inf if y moves and x does not. ``alike`` (k,) tells curves of different units
    apart: speeds are compared among those of one kind.
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
    # Summed up over every other row too: a rate that changes from row to row is not told by its samples.
    coarser = _integral(time[::2], y[::2]) - integral[::2]
    a, b = x - x.mean(axis=0), integral - integral.mean(axis=0)
    noise = np.sum(np.diff(x, 2, axis=0) ** 2, axis=0) / 6.0
    sums = np.stack(
        [(a * a).sum(axis=0), (a * b).sum(axis=0), (b * b).sum(axis=0), noise, 2.0 * (coarser**2).sum(axis=0)]
    )
    most = np.stack([extent, np.ptp(integral, axis=0), extent / (time[-1] - time[0])])
    return sums, most, np.where(moved > 0, moved, np.inf).min(axis=0)


def _integral(time: Array, y: Array) -> Array:
    """∫y dt by trapezia, 0 at first."""
    summed = np.cumsum(0.5 * np.diff(time)[:, None] * (y[1:] + y[:-1]), axis=0)
    return np.concatenate([np.zeros((1, y.shape[1])), summed])


# ── Delay of a column that claims to be the rate of a curve

_LAGS = np.linspace(-0.6, 0.6, 97)
"""Delays that are tried [s]."""
_STEP, _SHORTEST = 0.005, 1.5
"""Between the rows that are compared, and shortest length of a run of them [s]."""
_LEAST, _LEAST_STEPS = 0.04, 2.0
"""A delay to speak of: [s], and in steps of time. Filters of drives and stamps of one cycle cost less."""
_LEFT, _MATTERS = 0.25, 2e-4
"""Share of the squares that a delay leaves, to be believed, and share of the curve's own from which they matter."""
_AS_GOOD = 1e-3
"""Share of the squares by which the error of one delay may exceed the least, and be as good: of motions that repeat, several
are, and the shortest is meant."""
_SOME_MOVE = 0.05
"""Range [rad, m] of a curve about its trend from which there is anything to compare."""


def rate_delays(runs: Sequence[tuple[Array, Array, Array]], count: int) -> Array:
    """Delay d (k,) [s] of rates y of curves x with y(t) = x'(t - d), by least squares on ∫y dt; 0 if it is not determined.

    Runs are time (n,), x (n, k) without jumps and y (n, k). Means and trends of both are taken off in each run without gaps, so
    that a bias of y says nothing.
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
    """Curves (n, k) of one run without means and trends, and the squares (lags, k) that lags leave; None if it is short."""
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
