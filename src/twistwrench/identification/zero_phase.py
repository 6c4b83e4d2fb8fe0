"""Signals without delay: samples on a steady clock, low-passed forward and backward, and their derivatives.

The filter is Butterworth's, run over the samples and back over the result, so that phases cancel (Gustafsson, "Determining the
initial states in forward-backward filtering", IEEE Trans. Signal Processing 44(4), 1996); derivatives are central differences.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..errors import TrajectoryError
from ..typing import Array

ORDER = 4
"""Of the filter; twice that, forward and backward."""
STATE_RATE, ROW_RATE = 20.0, 2.5
"""Samples per period of the cut-off that states are computed at, and that rows of equations are kept at."""
_STEADY = 1e-3
"""Share of the step that stamps may be off without being moved to a steady clock."""
_GAP = 5.0
"""Times the mean step, from which a step is a gap."""
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
    """

    start: float
    rate: float
    q: Array
    tau: Array
    moved: float = 0.0

    @classmethod
    def of(cls, time: Array, q: Array, tau: Array, where: str) -> SteadySamples:
        """Samples at times that need not be steady: positions by a cubic spline, torques linearly between their stamps.

        Parameters
        ----------
        time : (n,) array [s], increasing
        q : (n, nv) array
        tau : (n, nv) array
        where : str, what errors begin with

        Returns
        -------
        samples : SteadySamples

        Raises
        ------
        TrajectoryError
            There are too few samples.

        Examples
        --------
        >>> t = np.arange(100) * 0.01
        >>> round(SteadySamples.of(t, np.zeros((100, 1)), np.zeros((100, 1)), "a log").rate, 9)
        100.0
        """
        if len(time) < FEWEST:
            raise TrajectoryError(
                f"{where}: {len(time)} rows are too few to identify a robot from. Give {FEWEST} at least."
            )
        steps = np.diff(time)
        mean = float((time[-1] - time[0]) / (len(time) - 1))
        step = float(steps[steps <= _GAP * mean].mean())  # of a log with gaps the clock's own
        count = round((time[-1] - time[0]) / step) + 1
        steady = time[0] + step * np.arange(count)
        if len(time) == count and np.abs(time - steady).max() <= _STEADY * step:
            return cls(float(time[0]), 1.0 / step, q, tau)
        from scipy.interpolate import CubicSpline

        local = time - time[0]
        at = np.clip(steady - time[0], 0.0, local[-1])
        torques = np.stack([np.interp(at, local, x) for x in tau.T], axis=1)
        moved = float(np.mean(np.abs(steps - step) > 0.1 * step))
        return cls(float(time[0]), 1.0 / step, CubicSpline(local, q)(at), torques, moved)

    def __len__(self) -> int:
        return len(self.q)

    @property
    def seconds(self) -> float:
        """How long it is [s]."""
        return (len(self) - 1) / self.rate


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
    """States below a cut-off [Hz], at twenty samples a period of it, or at about ``rate`` samples a second.

    Parameters
    ----------
    samples : SteadySamples
    cutoff : float [Hz]
    rate : float, optional [Hz]

    Returns
    -------
    states : Filtered

    Examples
    --------
    >>> t = np.arange(2000) * 1e-3
    >>> samples = SteadySamples.of(t, np.sin(t)[:, None], np.zeros((2000, 1)), "a log")
    >>> found = states_below(samples, 10.0)
    >>> bool(np.abs(found.ddq[60:-60, 0] + np.sin(found.time[60:-60])).max() < 1e-3)
    True
    """
    every = _every(samples, rate or STATE_RATE * cutoff)
    step = 1.0 / samples.rate
    time = samples.start + step * np.arange(len(samples))
    return states_below_of(time, samples.q, samples.tau, step, cutoff, slice(None, None, every))


def torques_below(samples: SteadySamples, cutoff: float) -> tuple[Array, Array]:
    """Times (m,) and torques (m, nv) of the states below a cut-off [Hz].

    Parameters
    ----------
    samples : SteadySamples
    cutoff : float [Hz]

    Returns
    -------
    time : (m,) array [s]
    tau : (m, nv) array

    Examples
    --------
    >>> t = np.arange(2000) * 1e-3
    >>> samples = SteadySamples.of(t, np.zeros((2000, 1)), np.sin(t)[:, None], "a log")
    >>> torques_below(samples, 10.0)[1].shape
    (400, 1)
    """
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


def kept_rows(states: Filtered, cutoff: float, most: float) -> slice:
    """Which states become rows: two and a half a period of the cut-off, without the first and the last, where filters begin.

    Of long logs fewer, ``most``, spread evenly: rows that are near each other hang together anyway.
    """
    every = max(1, math.floor(states.rate / (ROW_RATE * cutoff)), math.ceil(len(states.time) / most))
    border = math.ceil(states.rate / cutoff)
    border = min(border, len(states.time) // 10)
    return slice(border, len(states.time) - border, every)


def cutoffs(samples: Sequence[SteadySamples], rows: float) -> tuple[float, ...]:
    """Cut-offs worth trying [Hz]: steps of a third of a decade or less, up to a tenth of the slowest rate.

    At each of them there are ``rows`` rows at least.
    """
    most = 0.1 * min(s.rate for s in samples)
    least = max(4.0 / min(s.seconds for s in samples), rows / (ROW_RATE * sum(s.seconds for s in samples)))
    steps = [base * 10.0**power for power in range(-1, 3) for base in (1.0, 2.0, 3.0, 5.0, 7.0)]
    found = tuple(f for f in steps if least <= f <= most)
    return found or (most,)
