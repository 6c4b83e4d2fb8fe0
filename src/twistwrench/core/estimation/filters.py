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
_BLOCK, _MIN_STATE = 64, 1e-20
"""Block size in samples, and relative size below which a state is negligible."""
_ALL_PASS = 0.45
"""Cut-off over the sampling rate from which samples are unchanged."""
REACH = 12
"""Periods of the cut-off beyond which the impulse response of the zero-phase low-pass is below 1e-12."""
_MIN_SAMPLES_PER_RESULT = 16
"""Minimum number of samples per wanted one, for which sums of the impulse response take less time than the recursion."""


@dataclass(frozen=True, eq=False)
class _Recursion:
    """Recursive filter y_n = d u_n + Re Σ_k r_k s_k, with s_k ← p_k s_k + u_n, as matrices for blocks of samples.

    State vectors contain real parts, then imaginary parts.
    """

    within: Array
    """(N, N + 2 k) map from a block's samples to its response and its final states."""
    carried: Array
    """(2 k, 2 k) map of states over a block."""
    after: Array
    """(2 k, N) map from the previous block's final states to a block's response."""

    @classmethod
    def from_modes(cls, poles: Array, residues: Array, direct: float) -> _Recursion:
        """Filter with impulse response d δ_n + Re Σ_k r_k p_k^n."""
        powers = poles[:, None] ** np.arange(_BLOCK + 1)
        h = (residues @ powers[:, :-1]).real
        h[0] += direct
        lag = np.subtract.outer(np.arange(_BLOCK), np.arange(_BLOCK))
        ends, over, after = powers[:, _BLOCK - 1 :: -1], np.diag(powers[:, -1]), residues[:, None] * powers[:, 1:]
        return cls(
            np.concatenate([np.tril(h[np.abs(lag)]), ends.real, ends.imag]).T.copy(),
            np.block([[over.real, over.imag], [-over.imag, over.real]]),
            np.concatenate([after.real, -after.imag]),
        )

    def __call__(self, u: Array) -> Array:
        """Response (c, n) to samples u (c, n), with a constant signal before them."""
        first, (columns, n) = u[:, :1], u.shape
        blocks = np.zeros((columns, -(-n // _BLOCK), _BLOCK))
        np.subtract(u, first, out=blocks.reshape(columns, -1)[:, :n])
        responses = blocks @ self.within
        y, ends, over, k = responses[..., :_BLOCK], responses[..., _BLOCK:], self.carried, 1
        while k < ends.shape[1] and np.abs(over).max() > _MIN_STATE:  # s_b over b, b - 1; then b - 2, b - 3; …
            ends[:, k:] += ends[:, :-k] @ over
            over, k = over @ over, 2 * k
        y[:, 1:] += ends[:, :-1] @ self.after
        return y.reshape(columns, -1)[:, :n] + first


@lru_cache(maxsize=32)
def _butterworth(ratio: float) -> _Recursion:
    """Butterworth filter of order 4; ``ratio`` is the cut-off over the sampling rate."""
    s = np.tan(np.pi * ratio) * np.exp(1j * np.pi * (2 * np.arange(4) + 5) / 8)
    p, far = (1 + s) / (1 - s), -2 * s / (1 - s)  # 1 - p without cancellation
    others = 2 * (s[:, None] - s) / ((1 - s[:, None]) * (1 - s) * p[:, None]) + np.eye(4)  # 1 - p_j / p_k
    gain = float(far.prod().real) / 16
    r = gain * ((1 + p) / p) ** 4 / others.prod(axis=1)
    return _Recursion.from_modes(p[:2], 2 * r[:2], gain / float(p.prod().real))


def low_pass(x: Array, cutoff: float, rate: float) -> Array:
    """Zero-phase low-pass of samples (n, ...) with a cut-off [Hz]: filtered forward, then backward.

    Both ends are extended by odd reflection over three periods of the cut-off. Samples are unchanged if the cut-off
    exceeds the Nyquist frequency.
    """
    if cutoff >= _ALL_PASS * rate:
        return x
    filtered, pad = _butterworth(float(cutoff) / float(rate)), min(len(x) - 1, int(3 * rate / cutoff) + 1)
    flat, result = x.reshape(len(x), -1), np.empty(x.shape)
    out = result.reshape(flat.shape)
    width = max(1, _MAX_SAMPLES_PER_BLOCK // (len(x) + 2 * pad))
    for k in range(0, flat.shape[1], width):
        u = flat[:, k : k + width].T
        u = np.concatenate([2 * u[:, :1] - u[:, pad:0:-1], u, 2 * u[:, -1:] - u[:, -2 : -pad - 2 : -1]], axis=1)
        u = filtered(filtered(u)[:, ::-1])[:, ::-1]
        out[:, k : k + width] = u[:, pad : pad + len(x)].T
    return result


def low_pass_at(x: Array, cutoff: float, rate: float, at: Array) -> Array:
    """Samples ``at`` (k,), in increasing order, of :func:`low_pass` of (n, ...), to 1e-12 of the size of ``x``.

    If few samples are wanted, each is the sum of the impulse response times its neighbours; only the ends are filtered.
    """
    reach, n = int(REACH * rate / cutoff) + 1, len(x)
    if n < 6 * reach or n < _MIN_SAMPLES_PER_RESULT * len(at) or cutoff >= _ALL_PASS * rate:
        return low_pass(x, cutoff, rate)[at]
    result = np.empty((len(at), *x.shape[1:]))
    flat, out = x.reshape(n, -1), result.reshape(len(at), -1)
    begin, end = np.searchsorted(at, [reach, n - reach]).tolist()
    if begin:
        out[:begin] = low_pass(flat[: 2 * reach], cutoff, rate)[at[:begin]]
    if end < len(at):
        out[end:] = low_pass(flat[n - 2 * reach :], cutoff, rate)[at[end:] - (n - 2 * reach)]
    response = _zero_phase_response(float(cutoff) / float(rate), reach)
    while begin < end:
        stop = int(np.searchsorted(at[:end], at[begin] + reach))
        first = at[begin] - reach
        T = np.zeros((stop - begin, at[stop - 1] + reach + 1 - first))
        for row, start in zip(T, at[begin:stop] - reach - first, strict=True):
            row[start : start + len(response)] = response
        out[begin:stop] = T @ flat[first : first + T.shape[1]]
        begin = stop
    return result


@lru_cache(maxsize=32)
def _zero_phase_response(ratio: float, reach: int) -> Array:
    """Impulse response (2 reach + 1,) of the zero-phase low-pass; ``ratio`` is the cut-off over the sampling rate."""
    impulse = np.zeros(4 * reach + 1)
    impulse[2 * reach] = 1.0
    return low_pass(impulse, ratio, 1.0)[reach : 3 * reach + 1]


def lagged(x: Array, steps: float, before: Array | None = None) -> Array:
    """First-order low-pass of samples (n, ...), time constant ``steps`` steps.

    Continues from the response (...) ``before`` the first sample, or from a constant signal.
    """
    a = np.exp(-1.0 / steps)
    filtered = _Recursion.from_modes(np.array([a]), np.array([1.0 - a]), 0.0)
    response = filtered(x.reshape(len(x), -1).T).T.reshape(x.shape)
    if before is None:
        return response
    decay = a ** np.arange(1.0, len(x) + 1.0)
    return np.asarray(response + decay.reshape(-1, *[1] * (x.ndim - 1)) * (before - x[0]))


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
    step: float
    y: Array
    M: Array

    @classmethod
    def from_samples(cls, time: Array, y: Array) -> UniformSpline:
        """Spline through ``y`` (n, ...) at ``time`` (n,)."""
        from scipy.linalg import solve_banded

        step, n = float(time[-1] - time[0]) / (len(time) - 1), len(y)
        bands = np.ones((3, n - 2))
        bands[1], bands[1, [0, -1]] = 4.0, 6.0
        bands[0, 1], bands[2, -2] = 0.0, 0.0
        inner = solve_banded((1, 1), bands, 6.0 * np.diff(y, 2, axis=0) / step**2, check_finite=False)
        M = np.concatenate([2 * inner[:1] - inner[1:2], inner, 2 * inner[-1:] - inner[-2:-1]])
        return cls(float(time[0]), step, y, M)

    def __call__(self, t: Array) -> Array:
        """Values (m, ...) at times (m,)."""
        k, a, b = self._places(t)
        y, M, h = self.y, self.M, self.step
        return np.asarray(a * y[k] + b * y[k + 1] + ((a**3 - a) * M[k] + (b**3 - b) * M[k + 1]) * (h**2 / 6))

    def slope(self, t: Array) -> Array:
        """First derivatives (m, ...) at times (m,)."""
        k, a, b = self._places(t)
        y, M, h = self.y, self.M, self.step
        return np.asarray((y[k + 1] - y[k]) / h + ((1 - 3 * a**2) * M[k] + (3 * b**2 - 1) * M[k + 1]) * (h / 6))

    def _places(self, t: Array) -> tuple[Array, Array, Array]:
        """Indices of the samples before times (m,), and the weights of these and the next samples."""
        at = (t - self.start) / self.step
        k = np.clip(at.astype(int), 0, len(self.y) - 2)
        b = (at - k).reshape(-1, *[1] * (self.y.ndim - 1))
        return k, 1.0 - b, b
