"""Low-pass filters and cubic splines for uniformly sampled signals, by matrix products.

A Butterworth low-pass of order 4, after the bilinear transform with K = tan(π f_c / f_s), has the poles

    p_k = (1 + s_k) / (1 - s_k),   s_k = K exp(jπ (2k + 5) / 8),   k = 0 … 3,

and in partial fractions the impulse response h_n = d δ_n + Σ_k r_k p_k^n. Blocks of N samples are multiplied by the
Toeplitz matrix of h_0 … h_{N-1}. Earlier samples act on a block by one number for each pole, Σ_i p_k^{N-1-i} u_i,
multiplied by p_k^N from block to block. Oppenheim and Schafer, "Discrete-Time Signal Processing", sections 6.3 and 7.1.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..typing import Array

_MAX_SAMPLES_PER_BLOCK = 1 << 16
"""Number of samples of several signals that are filtered together, so that they stay in the cache."""
_BLOCK_LENGTH = 64
"""Number N of samples of a block."""
_MIN_STATE = 1e-20
"""Relative size of a state that is negligible."""
_ALL_PASS = 0.45
"""Ratio of cut-off to sampling rate from which samples are unchanged."""
REACH = 12
"""Number of periods of the cut-off after which the impulse response of the zero-phase low-pass is below 1e-12."""
_MIN_SAMPLES_PER_RESULT = 16
"""Ratio of samples to wanted results from which sums of the impulse response take less time than the recursion."""


@dataclass(frozen=True, eq=False)
class _Recursion:
    """Recursive filter y_n = d u_n + Re Σ_k r_k s_k, with s_k ← p_k s_k + u_n, as matrices for blocks of N samples.

    Vectors of the states s_k contain all real parts, then all imaginary parts. Vectors are rows, as in states @ state_map.
    """

    block_map: Array
    """(N, N + 2 k) map from a block's samples to its response and its final states, for zero initial states."""
    state_map: Array
    """(2 k, 2 k) map from states to the states a block later, without samples."""
    state_response: Array
    """(2 k, N) map from the previous block's final states to a block's response."""

    @classmethod
    def from_modes(cls, poles: Array, residues: Array, direct: float) -> _Recursion:
        """Filter with impulse response d δ_n + Re Σ_k r_k p_k^n."""
        powers = poles[:, None] ** np.arange(_BLOCK_LENGTH + 1)
        h = (residues @ powers[:, :-1]).real
        h[0] += direct
        lag = np.subtract.outer(np.arange(_BLOCK_LENGTH), np.arange(_BLOCK_LENGTH))  # row minus column
        toeplitz = np.tril(h[np.abs(lag)])
        final_states = powers[:, _BLOCK_LENGTH - 1 :: -1]  # of a unit sample at each place in the block
        decay = np.diag(powers[:, -1])
        response = residues[:, None] * powers[:, 1:]  # to each initial state
        return cls(
            block_map=np.concatenate([toeplitz, final_states.real, final_states.imag]).T.copy(),
            state_map=np.block([[decay.real, decay.imag], [-decay.imag, decay.real]]),
            state_response=np.concatenate([response.real, -response.imag]),
        )

    def __call__(self, u: Array) -> Array:
        """Response (c, n) to samples u (c, n), if the signal was constant before the first sample."""
        first_samples = u[:, :1]
        signal_count, n = u.shape
        block_count = -(-n // _BLOCK_LENGTH)  # rounded up
        blocks = np.zeros((signal_count, block_count, _BLOCK_LENGTH))
        samples = blocks.reshape(signal_count, -1)[:, :n]  # a view
        np.subtract(u, first_samples, out=samples)
        responses = blocks @ self.block_map
        y, states = responses[..., :_BLOCK_LENGTH], responses[..., _BLOCK_LENGTH:]
        # The final states of block b are Σ_i (states of block b - i) state_map^i. Each round doubles the number of terms.
        term_count = 1
        power = self.state_map  # state_map^term_count
        while term_count < block_count and np.abs(power).max() > _MIN_STATE:
            states[:, term_count:] += states[:, :-term_count] @ power
            power = power @ power
            term_count = 2 * term_count
        y[:, 1:] += states[:, :-1] @ self.state_response
        return y.reshape(signal_count, -1)[:, :n] + first_samples


@lru_cache(maxsize=32)
def _butterworth(ratio: float) -> _Recursion:
    """Butterworth filter of order 4; ``ratio`` is the cut-off over the sampling rate.

    Its transfer function in z^-1 is g (1 + z^-1)^4 / Π_k (1 - p_k z^-1), with g = Π_k (1 - p_k) / 16 for a gain of 1 at
    frequency 0. Its residues are r_k = g (1 + 1 / p_k)^4 / Π_{j≠k} (1 - p_j / p_k).
    """
    s = np.tan(np.pi * ratio) * np.exp(1j * np.pi * (2 * np.arange(4) + 5) / 8)
    p = (1 + s) / (1 - s)
    one_minus_p = -2 * s / (1 - s)  # without cancellation
    # 1 - p_j / p_k in row k, without cancellation; 1 on the diagonal
    one_minus_ratio = 2 * (s[:, None] - s) / ((1 - s[:, None]) * (1 - s) * p[:, None]) + np.eye(4)
    g = float(one_minus_p.prod().real) / 16
    r = g * ((1 + p) / p) ** 4 / one_minus_ratio.prod(axis=1)
    direct = g / float(p.prod().real)
    return _Recursion.from_modes(p[:2], 2 * r[:2], direct)  # the other two poles are conjugate to the first two


def low_pass(x: Array, cutoff: float, rate: float) -> Array:
    """Zero-phase low-pass of samples (n, ...): filtered forward, then backward. ``cutoff`` and ``rate`` in Hz.

    Both ends are extended by odd reflection over three periods of the cut-off. Samples are unchanged if the cut-off is near
    the Nyquist frequency or above it.
    """
    if cutoff >= _ALL_PASS * rate:
        return x
    butterworth = _butterworth(float(cutoff) / float(rate))
    n = len(x)
    pad = min(n - 1, int(3 * rate / cutoff) + 1)  # number of samples added at each end
    columns = x.reshape(n, -1)
    result = np.empty(x.shape)
    result_columns = result.reshape(columns.shape)  # a view
    signals_per_block = max(1, _MAX_SAMPLES_PER_BLOCK // (n + 2 * pad))
    for k in range(0, columns.shape[1], signals_per_block):
        u = columns[:, k : k + signals_per_block].T
        reflected_start = 2 * u[:, :1] - u[:, pad:0:-1]
        reflected_end = 2 * u[:, -1:] - u[:, -2 : -pad - 2 : -1]
        u = np.concatenate([reflected_start, u, reflected_end], axis=1)
        forward = butterworth(u)
        reversed_result = butterworth(forward[:, ::-1])
        filtered = reversed_result[:, ::-1]
        result_columns[:, k : k + signals_per_block] = filtered[:, pad : pad + n].T
    return result


def low_pass_at(x: Array, cutoff: float, rate: float, at: Array) -> Array:
    """Results of :func:`low_pass` of x (n, ...), only at the indices ``at`` (k,) in increasing order.

    If few results are wanted, each is the sum of its neighbours times the impulse response, to 1e-12 of the size of ``x``.
    Recursion is then used near both ends only.
    """
    n = len(x)
    reach = int(REACH * rate / cutoff) + 1  # samples on each side that influence a result
    are_many = n < _MIN_SAMPLES_PER_RESULT * len(at)
    if n < 6 * reach or are_many or cutoff >= _ALL_PASS * rate:
        return low_pass(x, cutoff, rate)[at]
    result = np.empty((len(at), *x.shape[1:]))
    columns = x.reshape(n, -1)
    result_columns = result.reshape(len(at), -1)  # a view
    # results from ``begin`` to ``end`` are far from both ends
    begin, end = np.searchsorted(at, [reach, n - reach]).tolist()
    if begin > 0:
        result_columns[:begin] = low_pass(columns[: 2 * reach], cutoff, rate)[at[:begin]]
    if end < len(at):
        first_sample = n - 2 * reach
        result_columns[end:] = low_pass(columns[first_sample:], cutoff, rate)[at[end:] - first_sample]
    response = _zero_phase_response(float(cutoff) / float(rate), reach)
    while begin < end:  # results at indices within ``reach`` are computed together
        stop = int(np.searchsorted(at[:end], at[begin] + reach))
        first_sample = at[begin] - reach
        sample_count = at[stop - 1] + reach + 1 - first_sample
        T = np.zeros((stop - begin, sample_count))  # impulse response of each result in its row
        first_columns = at[begin:stop] - reach - first_sample
        for row, first_column in zip(T, first_columns, strict=True):
            row[first_column : first_column + len(response)] = response
        result_columns[begin:stop] = T @ columns[first_sample : first_sample + sample_count]
        begin = stop
    return result


@lru_cache(maxsize=32)
def _zero_phase_response(ratio: float, reach: int) -> Array:
    """Impulse response (2 reach + 1,) of the zero-phase low-pass; ``ratio`` is the cut-off over the sampling rate."""
    impulse = np.zeros(4 * reach + 1)
    impulse[2 * reach] = 1.0
    return low_pass(impulse, ratio, 1.0)[reach : 3 * reach + 1]


def lagged(x: Array, steps: float, before: Array | None = None) -> Array:
    """First-order low-pass of samples x (n, ...) with a time constant of ``steps`` steps.

    The response before the first sample is ``before`` (...), by default x[0].
    """
    a = np.exp(-1.0 / steps)  # decay in a step
    first_order = _Recursion.from_modes(np.array([a]), np.array([1.0 - a]), 0.0)
    response = first_order(x.reshape(len(x), -1).T).T.reshape(x.shape)
    if before is None:
        return response
    decay = _along_first_axis(a ** np.arange(1.0, len(x) + 1.0), x.ndim)
    return np.asarray(response + decay * (before - x[0]))


def _along_first_axis(values: Array, ndim: int) -> Array:
    """Values (n,) with the shape (n, 1, …, 1) of ``ndim`` axes."""
    shape = (-1,) + (1,) * (ndim - 1)
    return values.reshape(shape)


@dataclass(frozen=True, eq=False)
class UniformSpline:
    """Cubic spline through at least four uniform samples (n, ...), with not-a-knot ends.

    Its second derivatives M solve M_{i-1} + 4 M_i + M_{i+1} = 6 (y_{i-1} - 2 y_i + y_{i+1}) / h², with M_0 = 2 M_1 - M_2 and
    likewise at the end (de Boor, "A Practical Guide to Splines", chapter IV).

    Examples
    --------
    >>> time = np.arange(8.0)
    >>> spline = UniformSpline.from_samples(time, time**3)
    >>> spline(np.array([2.5])).round(9).tolist(), spline.slope(np.array([2.5])).round(9).tolist()
    ([15.625], [18.75])
    """

    start: float
    """Time of the first sample [s]."""
    step: float
    """Time step h [s]."""
    y: Array
    """(n, ...) samples."""
    M: Array
    """(n, ...) second derivatives at the samples."""

    @classmethod
    def from_samples(cls, time: Array, y: Array) -> UniformSpline:
        """Spline through ``y`` (n, ...) at ``time`` (n,)."""
        from scipy.linalg import solve_banded

        step = float(time[-1] - time[0]) / (len(time) - 1)
        # Rows are the upper diagonal, the diagonal and the lower diagonal of the equations for M_1 … M_{n-2}. With
        # M_0 = 2 M_1 - M_2, the first equation is 6 M_1 = …, and the last one likewise.
        bands = np.ones((3, len(y) - 2))
        bands[1] = 4.0
        bands[1, [0, -1]] = 6.0
        bands[0, 1] = 0.0
        bands[2, -2] = 0.0
        right_sides = 6.0 * np.diff(y, 2, axis=0) / step**2
        inner = solve_banded((1, 1), bands, right_sides, check_finite=False)  # M_1 … M_{n-2}
        M_first = 2 * inner[:1] - inner[1:2]
        M_last = 2 * inner[-1:] - inner[-2:-1]
        return cls(float(time[0]), step, y, np.concatenate([M_first, inner, M_last]))

    def __call__(self, t: Array) -> Array:
        """Values (m, ...) at times (m,)."""
        k, a, b = self._positions(t)
        y, M, h = self.y, self.M, self.step
        return np.asarray(a * y[k] + b * y[k + 1] + ((a**3 - a) * M[k] + (b**3 - b) * M[k + 1]) * (h**2 / 6))

    def slope(self, t: Array) -> Array:
        """First derivatives (m, ...) at times (m,)."""
        k, a, b = self._positions(t)
        y, M, h = self.y, self.M, self.step
        return np.asarray((y[k + 1] - y[k]) / h + ((1 - 3 * a**2) * M[k] + (3 * b**2 - 1) * M[k + 1]) * (h / 6))

    def _positions(self, t: Array) -> tuple[Array, Array, Array]:
        """Indices k (m,) of the samples before times (m,), and linear weights a and b of samples k and k + 1."""
        steps_from_start = (t - self.start) / self.step
        k = np.clip(steps_from_start.astype(int), 0, len(self.y) - 2)
        b = _along_first_axis(steps_from_start - k, self.y.ndim)
        return k, 1.0 - b, b
