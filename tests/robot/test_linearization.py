"""The linear model against the motion itself: simulated from states that deviate by little, and as a controller's model."""

from __future__ import annotations

import numpy as np
import pytest
from quick import mostly_slow
from scipy.linalg import expm, solve_continuous_are

import twistwrench as tw


@pytest.mark.parametrize("name", mostly_slow(["planar_2r", "quadruped", "cart_pole", "ur5", "floating_box"], 3))
def test_deviations_go_as_the_linear_model_says(name):
    """Over 1 ms, deviations of 1e-5 by central differences, whose own error is of second order, 1e-10 of the deviations.

    The linear model is of one state, and A changes along the motion: x(h) is off expm(A h) x(0) by h² dA/dt / 2, beside
    A h of the change itself. Light links accelerate by some 40 rad/s² here, so this is 2 % of it at most.
    """
    robot = getattr(tw.robots, name)()
    rng = np.random.default_rng(0)
    q, dq, tau = robot.random_configuration(0), rng.normal(size=robot.nv), rng.normal(size=robot.nv)
    A, _ = robot.linearize(q, dq, tau)
    h, size, x = 1e-3, 1e-5, rng.normal(size=2 * robot.nv)

    def after(sign):
        start = robot.add(q, sign * size * x[: robot.nv]), dq + sign * size * x[robot.nv :]
        found = robot.simulate(*start, duration=h, tau=tau, method="rk4", dt=h / 4)
        return found.q[-1], found.dq[-1]

    (q1, dq1), (q0, dq0) = after(1), after(-1)
    found = np.concatenate([robot.subtract(q1, q0), dq1 - dq0]) / (2 * size)
    expected = expm(A * h) @ x
    np.testing.assert_allclose(found - x, expected - x, rtol=0, atol=2e-2 * np.abs(expected - x).max())


def test_the_bracket_of_a_floating_base_is_seen():
    """Without gravity and torques a box that turns keeps its twist; a deviation of place turns in its axes: δ' = -ad(V) δ."""
    box = tw.robots.floating_box().with_gravity([0, 0, 0])
    A, B = box.linearize([1, 0, 0, 0, 0, 0, 0], [0, 0, 2.0, 0, 0, 0], np.zeros(6))
    np.testing.assert_allclose(A[:6, :6], -_ad([0, 0, 2.0, 0, 0, 0]), atol=1e-12)
    np.testing.assert_allclose(B[6:], np.linalg.inv(box.mass_matrix([1, 0, 0, 0, 0, 0, 0])), atol=1e-12)


def _ad(V):
    w, v = (np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) for x, y, z in (V[:3], V[3:]))
    return np.block([[w, np.zeros((3, 3))], [v, w]])


def test_linear_quadratic_control_holds_the_pole_upright():
    robot = tw.robots.cart_pole()
    A, B = robot.linearize([0, 0], [0, 0], [0, 0])
    B = B[:, :1]  # the cart is driven, the pole is not
    P = solve_continuous_are(A, B, np.diag([1.0, 10, 1, 1]), [[0.1]])
    K = B.T @ P / 0.1
    assert np.linalg.eigvals(A - B @ K).real.max() < 0

    def law(t, q, dq):
        return np.array([-(K @ np.concatenate([q, dq]))[0], 0.0])

    found = robot.simulate([0, 0.3], [0, 0], duration=6.0, controller=law, dt=1e-2, method="rk4")
    np.testing.assert_allclose(found.q[-1], 0, atol=2e-2)


def test_states_come_in_batches():
    robot = tw.robots.planar_2r()
    q, dq, tau = np.random.default_rng(0).normal(size=(3, 5, 2))
    A, B = robot.linearize(q, dq, tau)
    one = robot.linearize(q[3], dq[3], tau[3])
    np.testing.assert_allclose(A[3], one[0], atol=1e-13)
    np.testing.assert_allclose(B[3], one[1], atol=1e-13)
