"""Quaternions whose square overflows or underflows: NaN, never the numbers of another orientation."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import twistwrench as tw


@pytest.fixture(scope="module")
def state():
    robot = tw.robots.quadruped()
    rng = np.random.default_rng(0)
    return robot, robot.random_configuration(rng), rng.normal(size=robot.nv)


def scaled(q, factor):
    q = q.copy()
    q[:4] *= factor
    return q


def torques(robot, q, dq):
    """Of one state, by the direct call too, of a batch, and by NumPy."""
    for _ in range(3):
        yield robot.inverse_dynamics(q, dq, np.zeros(robot.nv))
    yield robot.inverse_dynamics(np.tile(q, (9, 1)), dq, np.zeros(robot.nv))[4]


@pytest.mark.parametrize("factor", [1e-150, 1e-100, 1e-3, 7.0, 1e100, 1e150])
def test_quaternions_of_any_length_from_1e_150_to_1e150(state, factor):
    """Good to some hundred roundings of the largest torque."""
    robot, q, dq = state
    wanted = robot.inverse_dynamics(q, dq, np.zeros(robot.nv))
    for tau in torques(robot, scaled(q, factor), dq):
        np.testing.assert_allclose(tau, wanted, rtol=0, atol=1e-13 * np.abs(wanted).max() * 10)


@pytest.mark.parametrize("factor", [0.0, 1e-200, 1e-160, 1e-156, 1e155, 1e200])
def test_beyond_that_torques_are_nan(state, factor):
    robot, q, dq = state
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        for tau in torques(robot, scaled(q, factor), dq):
            assert np.isnan(tau).any()
