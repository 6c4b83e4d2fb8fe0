"""Compiled exp against 50-digit arithmetic: one unit in the last place, and the ends where doubles end.

The reduced argument carries half a unit of itself at |r| ≤ 0.35, so 0.18 of the result's; the series' remainder and the
rounding of its last step add 0.25 and 0.5: below 1.
"""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from twistwrench.compiler.ir.tracer import trace
from twistwrench.compiler.lowering.target_machine import DOUBLE, SINGLE
from twistwrench.compiler.lowering.vector_math import bounds
from twistwrench.compiler.runtime.gufunc import make_ufunc

LOW, HIGH = bounds(DOUBLE)


@pytest.fixture(scope="module")
def exp():
    return make_ufunc(trace(lambda x: np.exp(x), [("x", ())], ["y"]), "exp", "")


@pytest.mark.parametrize(("least", "most"), [(-1, 1), (-0.4, 0.4), (-40, 40), (LOW, HIGH), (-1e-8, 1e-8)])
def test_within_one_unit_in_the_last_place(exp, least, most):
    x = np.random.default_rng(3).uniform(least, most, 3000)
    with mpmath.workdps(50):
        exact = [mpmath.exp(mpmath.mpf(float(t))) for t in x]
        error = [
            abs(float(mpmath.mpf(float(y)) - e)) / np.spacing(float(e)) for y, e in zip(exp(x), exact, strict=True)
        ]
    assert max(error) < 1.0


def test_single_precision(exp):
    low, high = bounds(SINGLE)
    x = np.random.default_rng(4).uniform(low, high, 20000).astype(np.float32)
    y = exp(x)
    assert y.dtype == np.float32
    exact = np.exp(x.astype(float))
    assert (np.abs(y - exact) / np.spacing(exact.astype(np.float32))).max() < 1.5  # ln 2 in two singles costs a bit


def test_ends():
    exp = make_ufunc(trace(lambda x: np.exp(x), [("x", ())], ["y"]), "exp", "")
    x = np.array([0.0, -0.0, 800.0, -800.0, np.inf, -np.inf, np.nan, 1e300, -1e300])
    with np.errstate(all="raise"):
        y = exp(x)
    np.testing.assert_array_equal(y, [1.0, 1.0, np.inf, 0.0, np.inf, 0.0, np.nan, np.inf, 0.0])


def test_constants_fold():
    program = trace(lambda x: x + np.exp(np.array(0.0 * x + 2.0, object)), [("x", ())], ["y"])
    assert "exp" not in program.counts()
