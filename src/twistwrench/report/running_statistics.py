"""Running figures of a motion: RMS and gaps in time. Rows come in any portions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.printed_numbers import number, seconds
from ..typing import Array


class Rms:
    """Root mean square over time, by the trapezoidal rule: uneven steps count by their length."""

    def __init__(self, columns: int) -> None:
        self._integral = np.zeros(columns)
        self._last: tuple[float, Array] | None = None
        self._begin = 0.0

    def add(self, time: Array, values: Array) -> None:
        """Take in consecutive rows, times (n,) and values (n, columns)."""
        squares = values * values
        if self._last is None:
            self._begin = float(time[0])
        else:
            self._integral += 0.5 * (time[0] - self._last[0]) * (self._last[1] + squares[0])
        steps = np.diff(time)
        self._integral += 0.5 * (steps @ squares[1:] + steps @ squares[:-1])
        self._last = float(time[-1]), squares[-1].copy()

    def result(self) -> Array:
        """(columns,)."""
        if self._last is None:
            return np.full(self._integral.shape, np.nan)
        duration = self._last[0] - self._begin
        return np.asarray(np.sqrt(self._integral / duration if duration > 0 else self._last[1]))


_LONG, _MOVED = 0.1, 1e-3
"""A gap so long [s], across which a coordinate changes by so much [rad, m], hides a motion: in less time no joint that has
mass speeds up and brakes again."""


@dataclass
class Gaps:
    """Steps of time longer than ``threshold``."""

    threshold: float
    count: int = 0
    longest: float = 0.0
    longest_at: float = float("nan")
    hidden: float = 0.0
    """The longest in which something moved [s]."""
    hidden_at: float = float("nan")
    _last: tuple[float, Array] | None = None

    @property
    def hidden_words(self) -> str:
        """The longest pause in which something moved."""
        return (
            f"the robot moves while nothing is logged for {number(self.hidden)} s after t = {seconds(self.hidden_at)} s"
        )

    def add(self, time: Array, q: Array) -> None:
        """Take in consecutive times (n,) and coordinates (n, nq)."""
        if self._last is not None:
            time, q = np.r_[self._last[0], time], np.concatenate([self._last[1][None], q])
        steps, moved = np.diff(time), np.abs(np.diff(q, axis=0)).max(axis=1, initial=0.0)
        found = steps > self.threshold
        self.count += int(found.sum())
        self.longest, self.longest_at = _longest(time, np.where(found, steps, 0.0), (self.longest, self.longest_at))
        hides = found & (steps > _LONG) & (moved > _MOVED)
        self.hidden, self.hidden_at = _longest(time, np.where(hides, steps, 0.0), (self.hidden, self.hidden_at))
        self._last = float(time[-1]), q[-1].copy()


def _longest(time: Array, steps: Array, known: tuple[float, float]) -> tuple[float, float]:
    """The longest step of time and when it begins, of these and of the one known before."""
    k = int(np.argmax(steps)) if len(steps) else 0
    return (float(steps[k]), float(time[k])) if len(steps) and steps[k] > known[0] else known
