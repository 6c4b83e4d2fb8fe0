"""The tolerance of limits of position: mirrored joints have the same, in other units it scales, and infinite ends count nothing."""

from __future__ import annotations

import numpy as np
import pytest

from twistwrench.core.numbers import TOLERANCE
from twistwrench.mechanics.model.limits import Limits

NONE = np.array([np.inf])


def tolerance(lower: float, upper: float) -> float:
    return float(Limits(np.array([lower]), np.array([upper]), NONE, NONE).tolerance[0])


@pytest.mark.parametrize(("lower", "upper"), [(-3.0, 0.0), (-3.0, 0.5), (-3.0, -1.0), (-0.2, 0.1), (-np.inf, 0.3)])
def test_a_mirrored_joint_has_the_same(lower, upper):
    assert tolerance(lower, upper) == tolerance(-upper, -lower)


@pytest.mark.parametrize(("lower", "upper"), [(-3.0, 0.0), (-0.2, 0.1), (-np.inf, 0.3), (0.2, np.inf)])
def test_it_scales_with_the_limits(lower, upper):
    assert tolerance(1e-3 * lower, 1e-3 * upper) == pytest.approx(1e-3 * tolerance(lower, upper), rel=1e-12)


@pytest.mark.parametrize(("lower", "upper"), [(-np.inf, np.inf), (0.0, 0.0), (0.0, np.inf)])
def test_without_a_size_it_is_that_of_one(lower, upper):
    assert tolerance(lower, upper) == TOLERANCE


@pytest.mark.parametrize(("lower", "upper"), [(-3.0, 2.0), (0.5, 4.0), (0.0, 0.0)])
def test_a_joint_at_either_limit_or_beyond_by_less_does_not_exceed_it(lower, upper):
    limits, one = Limits(np.array([lower]), np.array([upper]), NONE, NONE), tolerance(lower, upper)
    at = np.array([lower - 0.5 * one, lower, upper, upper + 0.5 * one])
    assert not limits.exceeded(at[:, None]).any()
    assert limits.exceeded([[lower - 2 * one], [upper + 2 * one]]).all()
