"""How late the column is that claims to be the rate of a curve."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from ..typing import Array

_LAGS = np.linspace(-0.6, 0.6, 97)
"""Delays that are tried [s]."""
_STEP, _WINDOW = 0.005, 4.0
"""Between the rows that are compared, and the length of what is compared at once [s]."""
_SHORTEST = 1.5
_GAP = 5.0
"""Usual steps of time from which a step is a gap, over which nothing is summed."""
_LEAST, _STEPS = 0.04, 2.0
"""A delay to speak of: [s], and in steps of time. Filters of drives and stamps of one cycle cost less."""
_LEFT, _MATTERS = 0.25, 2e-4
"""Share of the squares that a delay leaves, to be believed, and share of the curve's own from which they matter."""
_AS_GOOD = 1e-3
"""Share of the squares by which the error of one delay may exceed the least, and be as good: of motions that repeat, several
are, and the shortest is meant."""
_SOME_MOVE = 0.05
"""Range [rad, m] of a curve about its trend from which there is anything to compare."""


class RateDelay:
    """Of k curves x and what is said to be their rates y: the d with y(t) = x'(t - d), by least squares on ∫y dt.

    Means and trends of both are taken off, window by window, so that a bias of y says nothing. Rows come in any portions.
    """

    def __init__(self, count: int) -> None:
        self._errors, self._squares = np.zeros((len(_LAGS), count)), np.zeros(count)
        self._range, self._longest = np.zeros(count), 0.0
        self._rows: list[tuple[Array, Array, Array]] = []
        self._last: tuple[float, Array, Array, Array] | None = None

    def add(self, time: Array, x: Array, y: Array) -> None:
        """Consecutive rows: time (n,), curves (n, k) without jumps within the portion, rates (n, k)."""
        if len(time) < 2:
            return
        usual = float(np.median(np.diff(time)))
        self._longest = max(self._longest, usual)
        integral = np.zeros(x.shape[1])
        if self._last is not None:
            t0, x0, y0, integral0 = self._last
            if time[0] - t0 > _GAP * usual or (np.abs(x[0] - x0) > np.pi).any():
                self._flush()
            else:
                integral = integral0 + 0.5 * (time[0] - t0) * (y0 + y[0])
        steps = np.diff(time)
        sums = integral + np.concatenate(
            [np.zeros((1, x.shape[1])), np.cumsum(0.5 * steps[:, None] * (y[1:] + y[:-1]), axis=0)]
        )
        edges = [0, *(np.flatnonzero(steps > _GAP * usual) + 1).tolist(), len(time)]
        stride = max(1, round(_STEP / usual))
        for k, (a, b) in enumerate(pairwise(edges)):
            if k:
                self._flush()
            self._rows.append((time[a:b:stride], x[a:b:stride], sums[a:b:stride]))
            if self._rows[-1][0][-1] - self._rows[0][0][0] >= _WINDOW:
                self._flush()
        self._last = float(time[-1]), x[-1].copy(), y[-1].copy(), sums[-1].copy()

    def result(self) -> Array:
        """(k,) s, 0 where there is no delay to speak of or nothing can be said."""
        self._flush()
        padded = np.pad(self._errors, ((1, 1), (0, 0)), constant_values=np.inf)
        dips = (self._errors <= padded[:-2]) & (self._errors <= padded[2:])
        dips &= self._errors <= self._errors.min(axis=0) + _AS_GOOD * self._squares
        best = np.where(dips, np.abs(_LAGS)[:, None], np.inf).argmin(axis=0)
        at = np.arange(len(self._squares))
        now, then = self._errors[len(_LAGS) // 2], self._errors[best, at]
        inside = (best > 0) & (best < len(_LAGS) - 1)
        told = inside & (then < _LEFT * now) & (now > _MATTERS * self._squares) & (self._range > _SOME_MOVE)
        told &= np.abs(_LAGS[best]) >= max(_LEAST, _STEPS * self._longest)
        around = [self._errors[np.clip(best + k, 0, len(_LAGS) - 1), at] for k in (-1, 0, 1)]
        bend = around[0] - 2.0 * around[1] + around[2]
        finer = np.where(bend > 0, 0.5 * (around[0] - around[2]) / np.where(bend > 0, bend, 1.0), 0.0)
        return np.where(told, _LAGS[best] + finer * (_LAGS[1] - _LAGS[0]), 0.0)

    def _flush(self) -> None:
        rows, self._rows = self._rows, []
        if not rows or rows[-1][0][-1] - rows[0][0][0] < _SHORTEST:
            return
        t, x, integral = (np.concatenate([part[k] for part in rows]) for k in range(3))
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
