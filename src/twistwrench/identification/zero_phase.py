"""Signals without delay: samples on a steady clock, low-passed forward and backward, and their derivatives.

The filter is Butterworth's, run over the samples and back over the result, so that phases cancel (Gustafsson, "Determining the
initial states in forward-backward filtering", IEEE Trans. Signal Processing 44(4), 1996); derivatives are central differences.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise

import numpy as np

from ..errors import TrajectoryError
from ..typing import Array

ORDER = 4
"""Order of the filter; twice that, forward and backward."""
STATE_RATE, ROW_RATE = 20.0, 2.5
"""Samples per period of the cut-off that states are computed at, and that rows of equations are kept at."""
STEADY = 1e-3
"""Share of the step that stamps may be off without being moved to a steady clock."""
GAP, PAUSE = 5.0, 0.05
"""Times the usual step, and s, beyond which a step is a pause that a log is split at: what is between is never filled."""
_CUT_BORDER = 2
"""Periods of the cut-off at a pause, in which filters that begin there are not settled."""
_SHORT = 0.1
"""Share of the longest piece that others last at least."""
FEWEST = 60
"""Samples that anything can be identified from."""


@dataclass(frozen=True, eq=False)
class SteadySamples:
    """One log on a steady clock.

    Attributes
    ----------
    start : float, time of the first sample [s]
    rate : float, samples a second [Hz]
    q : (n, nv) array, positions of the joints
    tau : (n, nv) array, torques of the joints
    moved : float, share of the stamps that were off the steady clock by a tenth of a step
    cut : bool, whether it is one of several pieces of a log with pauses
    """

    start: float
    rate: float
    q: Array
    tau: Array
    moved: float = 0.0
    cut: bool = False

    @classmethod
    def pieces(cls, time: Array, q: Array, tau: Array, where: str) -> list[SteadySamples]:
        """Split a log at its pauses, each piece on a steady clock of its own; pieces that are too short are left out."""
        edges = [0, *(pauses(time) + 1).tolist(), len(time)]
        rows = [slice(a, b) for a, b in pairwise(edges) if b - a >= FEWEST]
        if len(rows) < 2:
            rows = rows or [slice(None)]
            return [replace(cls.from_arrays(time[s], q[s], tau[s], where), cut=len(edges) > 2) for s in rows]
        found = [replace(cls.from_arrays(time[s], q[s], tau[s], where), cut=True) for s in rows]
        longest = max(piece.seconds for piece in found)
        return [piece for piece in found if piece.seconds >= _SHORT * longest]

    @classmethod
    def from_arrays(cls, time: Array, q: Array, tau: Array, where: str) -> SteadySamples:
        """Samples at times that need not be steady: positions by a cubic spline, torques linearly between their stamps."""
        if len(time) < FEWEST:
            raise TrajectoryError(
                f"{where}: {len(time)} rows are too few to identify a robot from. Give {FEWEST} at least."
            )
        steps = np.diff(time)
        mean = float((time[-1] - time[0]) / (len(time) - 1))
        step = float(steps[steps <= GAP * mean].mean())  # of a log with gaps the clock's own
        count = round((time[-1] - time[0]) / step) + 1
        steady = time[0] + step * np.arange(count)
        if len(time) == count and np.abs(time - steady).max() <= STEADY * step:
            return cls(float(time[0]), 1.0 / step, q, tau)
        moved = float(np.mean(np.abs(steps - step) > 0.1 * step))
        return cls(float(time[0]), 1.0 / step, *resampled(time, q, tau, steady), moved)

    def __len__(self) -> int:
        return len(self.q)

    @property
    def seconds(self) -> float:
        """Duration [s]."""
        return (len(self) - 1) / self.rate


def resampled(time: Array, q: Array, tau: Array, at: Array) -> tuple[Array, Array]:
    """Positions by a cubic spline and torques linearly between their stamps, at times that are kept within those."""
    from scipy.interpolate import CubicSpline

    local = time - time[0]
    at = np.clip(at - time[0], 0.0, local[-1])
    return CubicSpline(local, q)(at), np.stack([np.interp(at, local, x) for x in tau.T], axis=1)


def pauses(time: Array) -> Array:
    """Numbers of the samples (n,) after which a log pauses."""
    steps = np.diff(time)
    return np.flatnonzero(steps > max(PAUSE, GAP * float(np.median(steps)))) if len(steps) else np.zeros(0, int)


@dataclass(frozen=True, eq=False)
class Filtered:
    """States of one log below a cut-off, and the torques there.

    Attributes
    ----------
    time : (m,) array [s]
    rate : float [Hz]
    q, dq, ddq : (m, nv) arrays
    tau : (m, nv) array, low-passed as q is
    """

    time: Array
    rate: float
    q: Array
    dq: Array
    ddq: Array
    tau: Array


@lru_cache(maxsize=32)
def _filter(cutoff: float, rate: float) -> Array:
    from scipy.signal import butter

    return np.asarray(butter(ORDER, cutoff, fs=rate, output="sos"))


def low_pass(x: Array, cutoff: float, rate: float) -> Array:
    """Samples (n, ...) below a cut-off [Hz], without delay; as they are where the cut-off is above what they can show."""
    if cutoff >= 0.45 * rate:
        return x
    from scipy.signal import sosfiltfilt

    sos = _filter(float(cutoff), float(rate))
    pad = min(len(x) - 1, int(3 * rate / cutoff) + 1)
    return np.asarray(sosfiltfilt(sos, x, axis=0, padlen=pad))


def states_below(samples: SteadySamples, cutoff: float, rate: float | None = None) -> Filtered:
    """States below a cut-off [Hz], at twenty samples a period of it, or at about ``rate`` samples a second."""
    every = _every(samples, rate or STATE_RATE * cutoff)
    step = 1.0 / samples.rate
    time = samples.start + step * np.arange(len(samples))
    return states_below_of(time, samples.q, samples.tau, step, cutoff, slice(None, None, every))


def torques_below(samples: SteadySamples, cutoff: float) -> tuple[Array, Array]:
    """Times (m,) and torques (m, nv) of the states below a cut-off [Hz]."""
    rows = slice(None, None, _every(samples, STATE_RATE * cutoff))
    time = samples.start + np.arange(len(samples)) / samples.rate
    return time[rows], np.stack([low_pass(x, cutoff, samples.rate)[rows] for x in samples.tau.T], axis=1)


def _every(samples: SteadySamples, rate: float) -> int:
    return max(1, math.floor(samples.rate / rate))


def states_below_of(time: Array, q: Array, tau: Array, step: float, cutoff: float, rows: slice) -> Filtered:
    """States below a cut-off [Hz] at some of the samples, which are a ``step`` apart [s]."""
    rate = 1.0 / step
    states = np.empty((4, len(time[rows]), q.shape[1]))
    for j in range(q.shape[1]):  # one joint after another: what is in between stays small
        x = low_pass(q[:, j], cutoff, rate)
        rates = np.gradient(x, step)
        for out, values in zip(
            states, (x, rates, np.gradient(rates, step), low_pass(tau[:, j], cutoff, rate)), strict=True
        ):
            out[:, j] = values[rows]
    return Filtered(time[rows], rate / (rows.step or 1), *states)


def kept_rows(states: Filtered, cutoff: float, most: float, *, cut: bool = False) -> slice:
    """States that become rows: two and a half a period of the cut-off, without the first and the last, where filters begin.

    Long logs: at most ``most`` rows, evenly spaced, as near ones are autocorrelated anyway. For a piece that is ``cut``
    from a log with pauses two periods of the cut-off are left out at both ends, however short it is.
    """
    every = max(1, math.floor(states.rate / (ROW_RATE * cutoff)), math.ceil(len(states.time) / most))
    border = border_of(states.rate, cutoff, len(states.time), cut=cut)
    return slice(border, max(border, len(states.time) - border), every)


def border_of(rate: float, cutoff: float, count: int, *, cut: bool) -> int:
    """States at either end of so many that are left out."""
    border = math.ceil(rate / cutoff)
    return _CUT_BORDER * border if cut else min(border, count // 10)


def cutoffs(samples: Sequence[SteadySamples], rows: float) -> tuple[float, ...]:
    """Cut-offs worth trying [Hz]: steps of a third of a decade or less, up to a tenth of the slowest rate.

    At each of them there are ``rows`` rows at least.
    """
    most = 0.1 * min(s.rate for s in samples)
    whole = min((s.seconds for s in samples if not s.cut), default=np.inf)
    pieces = 0.5 * max((s.seconds for s in samples if s.cut), default=np.inf)  # the shorter ones have no rows then
    least = max(4.0 / min(whole, pieces), rows / (ROW_RATE * sum(s.seconds for s in samples)))
    steps = [base * 10.0**power for power in range(-1, 3) for base in (1.0, 2.0, 3.0, 5.0, 7.0)]
    found = tuple(f for f in steps if least <= f <= most)
    return found or (most,)
