"""Scale and lag checks of rates against the slopes of positions, and single wrong rows."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..core.numbers import printed, seconds
from ..core.text import listed
from ..typing import Array

_ROWS = 512
"""Most rows over which a rate is summed up: its own bias adds up to little over so few."""
_FEWEST = 8
_GAP = 5.0
"""Usual steps of time from which a step is a gap, over which nothing is summed."""
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
    steps = np.diff(time)
    cuts = set(np.flatnonzero(steps > _GAP * np.median(steps)) + 1) | set(range(0, len(time), _ROWS)) | {len(time)}
    edges = sorted(int(k) for k in cuts)
    return [slice(a, b) for a, b in pairwise(edges) if b - a >= _FEWEST]


class RateScale:
    """Scale of rates y over the slopes of k curves x, by least squares on ∫y dt."""

    def __init__(self, count: int) -> None:
        self._xx, self._xy, self._yy, self._noise = (np.zeros(count) for _ in range(4))
        self._range, self._summed, self._speed = (np.zeros(count) for _ in range(3))
        self._step = np.full(count, np.inf)
        self._coarse = np.zeros(count)

    def add(self, time: Array, x: Array, y: Array) -> None:
        """One segment: time (n,), curves without jumps (n, k), rates (n, k)."""
        h = np.diff(time)[:, None]
        integral = np.concatenate([np.zeros((1, x.shape[1])), np.cumsum(0.5 * h * (y[1:] + y[:-1]), axis=0)])
        extent = np.ptp(x, axis=0)
        self._range = np.maximum(self._range, extent)
        self._summed = np.maximum(self._summed, np.ptp(integral, axis=0))
        self._speed = np.maximum(self._speed, extent / (time[-1] - time[0]))
        moved = np.abs(np.diff(x, axis=0))
        self._step = np.minimum(self._step, np.where(moved > 0, moved, np.inf).min(axis=0))
        self._noise += np.sum(np.diff(x, 2, axis=0) ** 2, axis=0) / 6.0
        # Summed up over every other row too: a rate that changes from row to row is not told by its samples.
        y2, h2 = y[::2], np.diff(time[::2])[:, None]
        coarser = np.concatenate([np.zeros((1, x.shape[1])), np.cumsum(0.5 * h2 * (y2[1:] + y2[:-1]), axis=0)])
        self._coarse += 2.0 * np.sum((coarser - integral[::2]) ** 2, axis=0)
        a, b = x - x.mean(axis=0), integral - integral.mean(axis=0)
        self._xx += np.sum(a * a, axis=0)
        self._xy += np.sum(a * b, axis=0)
        self._yy += np.sum(b * b, axis=0)

    def result(self, alike: Array) -> Array:
        """Scale (k,) of y over the slope of x: 1 if they agree or it is undetermined, inf if y moves and x does not.

        ``alike`` (k,) tells curves of different units apart: speeds are compared among those of one kind.
        """
        moves = (self._xx > _OVER_NOISE * self._noise) & (self._range > _STEPS * self._step)
        for kind in np.unique(alike):
            here = alike == kind
            moves[here] &= self._speed[here] >= _SLOW * self._speed[here].max(initial=0.0)
        moves &= self._range > max(_ROUNDING[0], _ROUNDING[1] * float(self._range.max(initial=0.0)))
        moves &= self._coarse <= _ALIASED * self._yy
        gain = np.where(moves, self._xy / np.where(moves, self._xx, 1.0), 1.0)
        stands = ~moves & (self._summed > _MOVES) & (self._range < _STANDS * self._summed)
        return np.where(stands, np.inf, gain)


# ── How late the column is that claims to be the rate of a curve

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


class RateLag:
    """Lag d of rates y of k curves x with y(t) = x'(t - d), by least squares on ∫y dt.

    Means and trends of both are taken off in each run without gaps, so that a bias of y says nothing.
    """

    def __init__(self, count: int) -> None:
        self._errors, self._squares = np.zeros((len(_LAGS), count)), np.zeros(count)
        self._range, self._longest = np.zeros(count), 0.0

    def add(self, time: Array, x: Array, y: Array) -> None:
        """Consecutive rows: time (n,), curves (n, k) without jumps, rates (n, k)."""
        if len(time) < 2:
            return
        steps = np.diff(time)
        usual = float(np.median(steps))
        self._longest = max(self._longest, usual)
        summed = np.cumsum(0.5 * steps[:, None] * (y[1:] + y[:-1]), axis=0)
        integral = np.concatenate([np.zeros((1, x.shape[1])), summed])
        edges = [0, *(np.flatnonzero(steps > _GAP * usual) + 1).tolist(), len(time)]
        stride = max(1, round(_STEP / usual))
        for a, b in pairwise(edges):
            self._compare(time[a:b:stride], x[a:b:stride], integral[a:b:stride])

    def result(self) -> Array:
        """Lag (k,) [s], 0 if it is negligible or undetermined."""
        padded = np.pad(self._errors, ((1, 1), (0, 0)), constant_values=np.inf)
        dips = (self._errors <= padded[:-2]) & (self._errors <= padded[2:])
        dips &= self._errors <= self._errors.min(axis=0) + _AS_GOOD * self._squares
        best = np.where(dips, np.abs(_LAGS)[:, None], np.inf).argmin(axis=0)
        at = np.arange(len(self._squares))
        now, then = self._errors[len(_LAGS) // 2], self._errors[best, at]
        inside = (best > 0) & (best < len(_LAGS) - 1)
        told = inside & (then < _LEFT * now) & (now > _MATTERS * self._squares) & (self._range > _SOME_MOVE)
        told &= np.abs(_LAGS[best]) >= max(_LEAST, _LEAST_STEPS * self._longest)
        around = [self._errors[np.clip(best + k, 0, len(_LAGS) - 1), at] for k in (-1, 0, 1)]
        bend = around[0] - 2.0 * around[1] + around[2]
        finer = np.where(bend > 0, 0.5 * (around[0] - around[2]) / np.where(bend > 0, bend, 1.0), 0.0)
        return np.where(told, _LAGS[best] + finer * (_LAGS[1] - _LAGS[0]), 0.0)

    def _compare(self, t: Array, x: Array, integral: Array) -> None:
        """Add the squares that each lag leaves in one run."""
        if t[-1] - t[0] < _SHORTEST:
            return
        used = (t >= t[0] - _LAGS[0]) & (t <= t[-1] - _LAGS[-1])
        if used.sum() < len(_LAGS):
            return
        trend = np.stack([np.ones(used.sum()), t[used] - t[0]], axis=1)
        basis = np.linalg.qr(trend)[0]
        wanted = _without(basis, x[used])
        self._squares += np.sum(wanted**2, axis=0)
        self._range = np.maximum(self._range, np.ptp(wanted, axis=0))
        for k, lag in enumerate(_LAGS):
            place = t[used] + lag
            right = np.clip(np.searchsorted(t, place), 1, len(t) - 1)
            share = ((place - t[right - 1]) / (t[right] - t[right - 1]))[:, None]
            shifted = integral[right - 1] + share * (integral[right] - integral[right - 1])
            self._errors[k] += np.sum((_without(basis, shifted) - wanted) ** 2, axis=0)


def _without(basis: Array, x: Array) -> Array:
    return np.asarray(x - basis @ (basis.T @ x))


# ── What a gain between a column and the slope of another one says about their units, in words

_WITHIN = 0.1
"""Relative tolerance within which a scale is taken for a known factor between units."""

_DEGREES = math.degrees(1.0)


def scale_words(gain: float, angular: bool, base: str, per: str) -> str:
    """Description of a rate column by its scale against the slope of ``base``; ``per`` is the unit's end, such as /s."""
    slope = f"the slope of the {base}"
    if math.isinf(gain):
        return f"moves, and the {base} stand"
    if abs(gain) < 0.02 and not (angular and near(gain, 1 / _DEGREES)) and not near(gain, 1e-3):
        return f"is next to nothing, and the {base} move: leave the column out, then it is derived"
    known = [
        ("1000", 1e3, "time seems to be in ms"),
        ("1/1000", 1e-3, "time, or the column, seems to be in another unit"),
    ]
    if angular:
        known += [
            ("57.3", _DEGREES, f"it seems to be in deg{per}; name the unit, as in 'JOINT [deg{per}]'"),
            ("1/57.3", 1 / _DEGREES, "the positions seem to be in degrees; name the unit, as in 'JOINT [deg]'"),
        ]
        if per == "/s":
            known.append(("9.55", 30 / math.pi, "it seems to be in rpm; name the unit, as in 'JOINT [rpm]'"))
    else:
        known[0] = ("1000", 1e3, f"time seems to be in ms, or the column in mm{per}")
    for shown, factor, reason in known:
        if near(gain, factor):
            return f"is {shown} times {slope}: {reason}"
    if near(gain, -1.0):
        return f"has the opposite sign of {slope}"
    return f"is not {slope}, but some {printed(gain, 2)} times it"


def near(gain: float, factor: float) -> bool:
    """True if a scale is close to a factor between units."""
    return abs(gain / factor - 1.0) < _WITHIN


# ── Rows at which one joint leaves its path and is back in the next row: no motion does that, whatever the noise

# e_i is how far q_i is from the straight line between its neighbours. A corner of a path is one large e; a single wrong row of
# size d is e = (-d/2, d, -d/2), beyond all that the rest of the log has. A stamp that is wrong by s makes d = -s dq/dt in every
# joint.

_BEYOND = 5.0
"""Times the largest e of the rest of the log, from which the wrong row explains itself."""
_ALIKE = 0.25
"""Deviation of the neighbours' e from -d/2, as a share of d: the path goes on beside the glitch."""
_LEAST_SIZE, _NO_COUNT = 1e-6, 1e-2
"""Sizes [rad, m]: smaller is rounding; larger is not a count of an encoder that flickers."""
_COUNTS = 3.0
"""Multiples of the least step of the log from which it is not such a count."""
_MOST = 50
"""Candidates that are kept for a joint; with more the log is rough, and not one row wrong."""
_LISTED = 3
OVERLAP = 6
"""Rows that each portion shares with the one before, so that each row is looked at once, with two e on either side."""
SINGLE_ROW = "for a single row"
LEFT_OUT = "Left out: "
"""Words in sentences on a wrong row, and at the beginning of notes on rows left out."""
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
        self._turns = turns
        self._usual = 0.0
        self._largest, self._least_step = np.zeros(count), np.full(count, np.inf)
        self._found: list[list[Glitch]] = [[] for _ in range(count)]
        """Candidates of each joint."""

    def add(self, t: Array, q: Array) -> None:
        """Take in consecutive rows, (n,) and (n, k), the first of which are the last ones of those before."""
        if len(t) <= OVERLAP:
            return
        curves = q.copy()
        curves[:, self._turns] = np.unwrap(q[:, self._turns], axis=0)
        steps = np.abs(np.diff(curves, axis=0))
        self._least_step = np.minimum(self._least_step, np.where(steps > 0, steps, np.inf).min(axis=0))
        steps_of_time = np.diff(t)
        self._usual = self._usual or float(np.median(steps_of_time))
        pause = steps_of_time > _GAP * self._usual
        bridged = (pause[1:] | pause[:-1])[:, None]  # over a pause, the path says nothing
        share = ((t[1:-1] - t[:-2]) / (t[2:] - t[:-2]))[:, None]
        e = curves[1:-1] - curves[:-2] - share * (curves[2:] - curves[:-2])
        e = np.where(bridged, 0.0, e)
        d = e[1:-1]
        beside = np.maximum(np.abs(e[:-2] + d / 2), np.abs(e[2:] + d / 2))
        candidate = (np.abs(d) > _LEAST_SIZE) & (beside < _ALIKE * np.abs(d))
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
            bound = max(_BEYOND * float(self._largest[k]), min(_COUNTS * float(self._least_step[k]), _NO_COUNT))
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

    def sentences(self, names: list[str], angular: Array) -> list[str]:
        """A sentence for each joint, but for rows whose stamp is wrong."""
        said = []
        for k, found in self.result():
            wrong = [g for g in found if not g.late]
            if not wrong:
                continue
            size = (
                f"{printed(math.degrees(wrong[0].size), 3)} degrees" if angular[k] else f"{printed(wrong[0].size, 3)} m"
            )
            when = listed((f"{seconds(g.time, 4)} s" for g in wrong), _LISTED)
            said.append(f"{names[k]} leaves its path by {size} {SINGLE_ROW}, and is back in the next, at t = {when}")
        return said


def _late(d: Array, speed: Array) -> float:
    """Delay of a row's stamp [s] if joints of speeds (k,) leave their paths by d (k,) in proportion; else 0."""
    if (np.abs(speed) > _MOVING * np.abs(speed).max(initial=0.0)).sum() < 2:
        return 0.0
    found = float(d @ speed) / float(speed @ speed)
    return -found if np.abs(d - found * speed).max() < _OF_CLOCK * np.abs(d).max() else 0.0


def stamp_words(stamps: dict[float, float]) -> str:
    """Rows with a wrong stamp, by their times with what they are late by [s]."""
    when = listed((f"{seconds(time, 4)} s" for time in stamps), _LISTED)
    late = max(stamps.values(), key=abs)
    way = "late" if late > 0 else "early"
    return (
        f"the time stamp of {len(stamps)} row{'s' if len(stamps) > 1 else ''} is {seconds(abs(late))} s {way}, at t = {when}, "
        "as every joint leaves its path there in proportion to its speed"
    )
