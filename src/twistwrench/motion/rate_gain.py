"""How many times the slope of a curve the column is that claims to be its rate."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

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


class RateGain:
    """Of k curves x and what is said to be their rates y: the y that the slopes of x show, by least squares on ∫y dt."""

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
        """(k,) y over the slope of x: 1 where they agree or nothing can be said, inf where y moves and x stands.

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

    @property
    def range(self) -> Array:
        """(k,) how far each curve moves within a segment at most."""
        return self._range
