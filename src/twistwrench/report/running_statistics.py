"""Running figures of a motion: RMS and gaps in time. Rows come in any portions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

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


@dataclass
class Gaps:
    """Steps of time longer than ``threshold``."""

    threshold: float
    count: int = 0
    longest: float = 0.0
    longest_at: float = float("nan")
    _last: float | None = None

    def add(self, time: Array) -> None:
        """Take in consecutive times (n,)."""
        before = time[:1] if self._last is None else np.array([self._last])
        steps = np.diff(time, prepend=before)
        self.count += int((steps > self.threshold).sum())
        k = int(np.argmax(steps))
        if steps[k] > max(self.longest, self.threshold):
            self.longest, self.longest_at = float(steps[k]), float(time[k] - steps[k])
        self._last = float(time[-1])
