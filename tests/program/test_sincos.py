"""Compiled sin and cos against 50-digit arithmetic, over every range an angle may come from.

Up to the limit the error is bounded in units in the last place of the result itself: the reduced angle carries half a unit,
one whole unit of a result that lies a binade lower, and on ±π/4 the polynomials and their last rounding stay under 0.9.
To that comes the tail that the stored π/2 lacks, as often as π/2 was taken off; it is felt where the result is nearly zero.
In absolute terms the same sum is 0.5 + 0.9 halves of eps. Beyond the limit the angle comes from atan2, which rounds it at
size π (2 halves of eps in double), from a sine and a cosine rounded once each (under 1): 4 with the polynomials.
"""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from twistwrench.compiler.ir.tracer import trace
from twistwrench.compiler.lowering.target_machine import DOUBLE, SINGLE, host
from twistwrench.compiler.lowering.vector_math import HALF_PI, limit
from twistwrench.compiler.runtime.gufunc import make_ufunc

ULPS = 2.0
NEAR = 1.5  # of half an eps
FAR = 4.0  # of half an eps
with mpmath.workdps(80):
    TAILS = {bits: abs(float(mpmath.pi / 2 - mpmath.fsum(map(mpmath.mpf, parts)))) for bits, parts in HALF_PI.items()}
FAST, FAST32 = limit(DOUBLE), limit(SINGLE)
ANGLES = 3000


@pytest.fixture(scope="module")
def sincos():
    return make_ufunc(trace(lambda x: (np.sin(x), np.cos(x)), [("x", ())], ["sin", "cos"]), "sincos", "")


def tail(x, bits: int) -> np.ndarray:
    """What the reduced angle lacks for want of further digits of π/2."""
    return (np.abs(x) * (2 / np.pi) + 0.5) * TAILS[bits] * (np.abs(x) > 0.7)


def errors(sincos, x):
    """Error of sine and cosine: absolute in halves of eps, and without the tail in units in the last place of the exact."""
    absolute, ulps = [], []
    with mpmath.workdps(50):
        for got, function in zip(sincos(x), (mpmath.sin, mpmath.cos), strict=True):
            exact = [function(mpmath.mpf(float(t))) for t in x]
            high = np.array([float(e) for e in exact])
            low = np.array([float(e - mpmath.mpf(h)) for e, h in zip(exact, high.tolist(), strict=True)])
            error = np.abs((got - high) - low)  # the first difference is exact: neighbours
            absolute.append(error / 2.0**-53)
            ulps.append((error - tail(x, 64)) / np.spacing(np.abs(high)))
    return np.concatenate(absolute), np.concatenate(ulps)


def multiples(numbers) -> np.ndarray:
    """The doubles next to multiples of π/2, on both sides."""
    with mpmath.workdps(60):
        nearest = np.array([float(int(k) * mpmath.pi / 2) for k in numbers])
    return np.concatenate([nearest, np.nextafter(nearest, np.inf), np.nextafter(nearest, -np.inf)])


def within_limit() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(1)
    tiny = [0.0, 5e-324, 1e-310, 2.2250738585072014e-308, 1e-160, 1e-20, 1.4e-8]
    far_multiples = rng.integers(1000, int(FAST / np.pi * 2) - 1, ANGLES // 3)
    return {
        "±π/4": rng.uniform(-np.pi / 4, np.pi / 4, ANGLES),
        "±20, dense": np.linspace(-20, 20, 2 * ANGLES + 1),
        "±20, random": rng.uniform(-20, 20, ANGLES),
        "near multiples of π/2": multiples(np.arange(-700, 700)),
        "near large multiples of π/2": multiples(far_multiples),
        "halfway between multiples": (np.arange(-ANGLES, ANGLES) + 0.5) * np.pi / 2,
        "up to the limit": rng.uniform(-FAST, FAST, ANGLES),
        "every size up to the limit": np.exp(rng.uniform(-30, np.log(FAST), ANGLES)) * rng.choice([-1, 1], ANGLES),
        "just inside the limit": np.r_[FAST, -FAST, FAST - rng.uniform(0, 50, 500)],
        "tiny and denormal": np.r_[tiny, np.negative(tiny), 10.0 ** rng.uniform(-323, -5, ANGLES)],
    }


def test_what_is_stored_of_half_a_turn_has_the_digits_of_three_numbers():
    """What is left is less than half of the last bit of the third one, which is 2^-162 and, in single precision, 2^-73."""
    assert TAILS[64] <= 2.0**-163
    assert TAILS[32] <= 2.0**-74


@pytest.mark.parametrize("where", within_limit())
def test_fast_reduction(sincos, where):
    absolute, ulps = errors(sincos, within_limit()[where])
    assert ulps.max() <= ULPS
    assert absolute.max() <= NEAR


def beyond_limit() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(2)
    sizes = 10.0 ** rng.uniform(np.log10(FAST) + 0.1, 300, ANGLES // 2)
    numbers = rng.integers(int(FAST / np.pi * 2) + 2, 2**50, ANGLES // 4)
    return {
        "just outside the limit": np.nextafter(FAST, np.inf) + np.r_[0.0, rng.uniform(0, 50, 500)],
        "just outside, negative": -np.nextafter(FAST, np.inf) - np.r_[0.0, rng.uniform(0, 50, 500)],
        "up to 1e300": sizes * rng.choice([-1, 1], ANGLES // 2),
        "near huge multiples of π/2": multiples(numbers),
        "the double nearest to any multiple": np.array([6381956970095103.0 * 2.0**797]),
        "the largest": np.array([np.finfo(float).max, -np.finfo(float).max]),
    }


@pytest.mark.parametrize("where", beyond_limit())
def test_huge_angles(sincos, where):
    absolute, _ = errors(sincos, beyond_limit()[where])
    assert absolute.max() <= FAR


def within_limit32() -> dict[str, np.ndarray]:
    first, last = np.array([1e-3, FAST32], np.float32).view(np.uint32)
    return {
        "a share of all floats": np.arange(first, last + 1, 331, dtype=np.uint32).view(np.float32),
        "near multiples of π/2": (np.arange(-20000, 20000) * (np.pi / 2)).astype(np.float32),
        "tiny and denormal": (10.0 ** np.linspace(-44, -3, 100_000)).astype(np.float32),
        "the limit": np.array([FAST32, -FAST32], np.float32),
    }


@pytest.mark.parametrize("where", within_limit32())
def test_fast_reduction_in_single_precision(sincos, where):
    x = within_limit32()[where]
    for got, function in zip(sincos(x), (np.sin, np.cos), strict=True):
        assert got.dtype == np.float32
        exact = function(x.astype(float))
        error = np.abs(got - exact)
        assert ((error - tail(x.astype(float), 32)) / np.spacing(np.abs(exact).astype(np.float32))).max() <= ULPS
        assert error.max() <= NEAR * 2.0**-24


def test_huge_angles_in_single_precision(sincos):
    rng = np.random.default_rng(3)
    x = np.r_[np.nextafter(np.float32(FAST32), np.float32(np.inf)), FAST32 + rng.uniform(1, 1e3, 10**5),
              10 ** rng.uniform(4.6, 38, 10**5), np.finfo(np.float32).max].astype(np.float32)  # fmt: skip
    for got, function in zip(sincos(x), (np.sin, np.cos), strict=True):
        assert np.abs(got - function(x.astype(float))).max() <= FAR * 2.0**-24


def test_sine_is_odd_and_cosine_even_to_the_bit(sincos):
    x = np.concatenate([*within_limit().values(), *beyond_limit().values()])
    sine, cosine = sincos(x)
    mirrored_sine, mirrored_cosine = sincos(-x)
    assert np.array_equal(mirrored_sine, -sine)
    assert np.array_equal(mirrored_cosine, cosine)


@pytest.mark.parametrize("precision", [DOUBLE, SINGLE], ids=lambda p: p.llvm)
@pytest.mark.parametrize("odd_one", [np.nan, np.inf, -np.inf, 1e30, -0.0, 1e-40])
def test_an_odd_angle_touches_no_other_sample(sincos, precision, odd_one):
    lanes = host().lanes(precision)
    plain = np.random.default_rng(4).uniform(-20, 20, 3 * lanes - 1).astype(precision.char)
    expected = sincos(plain)
    for place in range(plain.size):
        x = plain.copy()
        x[place] = odd_one
        with np.errstate(invalid="ignore"):  # infinity has no sine, and NumPy says so
            results = sincos(x)
        for got, undisturbed in zip(results, expected, strict=True):
            assert np.isnan(got[place]) == (not np.isfinite(odd_one))
            others = np.arange(plain.size) != place
            assert got[others].tobytes() == undisturbed[others].tobytes()


def test_zero_is_exact(sincos):
    sine, cosine = sincos(np.array([0.0, -0.0]))
    assert sine.tolist() == [0.0, 0.0]
    assert cosine.tolist() == [1.0, 1.0]
