"""Filters and splines of samples on a steady clock, beside SciPy's recursions."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.signal import butter, lfilter, sosfiltfilt

from twistwrench.core.estimation.filters import UniformSpline, lagged, low_pass

NUMBERS = np.cumsum(np.random.default_rng(0).normal(size=(3000, 3)), axis=0)


@pytest.mark.parametrize(
    ("n", "cutoff", "rate"), [(3000, 5.0, 100.0), (3000, 40.0, 100.0), (61, 5.0, 100.0), (3000, 0.5, 250.0)]
)
def test_the_low_pass_is_butterworths_forward_and_backward(n, cutoff, rate):
    """Rounding of either recursion grows with the samples in a period: 500 at most here."""
    x = NUMBERS[:n]
    pad = min(n - 1, int(3 * rate / cutoff) + 1)
    expected = sosfiltfilt(butter(4, cutoff, fs=rate, output="sos"), x, axis=0, padlen=pad)
    np.testing.assert_allclose(low_pass(x, cutoff, rate), expected, rtol=0, atol=1e-9 * np.abs(x).max())
    np.testing.assert_allclose(low_pass(x[:, 0], cutoff, rate), expected[:, 0], rtol=0, atol=1e-9 * np.abs(x).max())


def test_a_cut_off_near_half_the_rate_changes_nothing():
    assert low_pass(NUMBERS, 45.0, 100.0) is NUMBERS


@pytest.mark.parametrize("steps", [0.3, 7.0, 400.0])
def test_a_lag_is_a_recursion_from_a_steady_state(steps):
    a = np.exp(-1.0 / steps)
    expected = lfilter([1.0 - a], [1.0, -a], NUMBERS, axis=0, zi=a * NUMBERS[:1])[0]
    np.testing.assert_allclose(lagged(NUMBERS, steps), expected, rtol=0, atol=1e-11 * np.abs(NUMBERS).max())


@pytest.mark.parametrize("n", [4, 5, 200])
def test_the_spline_is_the_cubic_one_with_not_a_knot_ends(n):
    time = 1e6 + 0.01 * np.arange(n)
    at = np.append(np.random.default_rng(1).uniform(time[0], time[-1], 50), time[[0, -1]])
    mine, theirs = UniformSpline.from_samples(time, NUMBERS[:n]), CubicSpline(time - 1e6, NUMBERS[:n])
    np.testing.assert_allclose(mine(at), theirs(at - 1e6), rtol=0, atol=1e-6)  # rounding of times: 1e-10 s
    np.testing.assert_allclose(mine.slope(at), theirs(at - 1e6, 1), rtol=0, atol=1e-4)
