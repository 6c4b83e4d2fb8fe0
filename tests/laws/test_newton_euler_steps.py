"""The recursion of section 8.3, written out: its wrenches and torques are those of the compiled kernels."""

from __future__ import annotations

import numpy as np
import pytest
from quick import mostly_slow

import twistwrench as tw
from twistwrench.testing import random_robot

EXACT = 1e-10
"""Relative to the largest entry: products of 6 × 6 matrices here, a third fewer terms there, over at most ten bodies."""


def close(one, other):
    np.testing.assert_allclose(one, other, rtol=0, atol=EXACT * max(1.0, np.abs(other).max(initial=0.0)))


@pytest.mark.parametrize("seed", mostly_slow(range(12), 4))
def test_wrenches_and_torques_are_those_of_the_kernels(seed):
    """Random trees with every kind of joint; a wrench at the last frame."""
    rng = np.random.default_rng(seed)
    robot = random_robot(seed, floating_base=seed % 3 == 0)
    q, dq, ddq = robot.random_configuration(rng), *rng.normal(size=(2, robot.nv))
    push = {robot.frame_names[-1]: rng.normal(size=6)}
    steps = robot.newton_euler(q, dq, ddq, wrench_on_robot=push)
    close(steps.F, robot.joint_wrenches(q, dq, ddq, wrench_on_robot=push))
    close(steps.tau, robot.inverse_dynamics(q, dq, ddq, wrench_on_robot=push))


def test_twists_are_those_of_the_frames():
    robot = tw.robots.ur5()
    q, dq, ddq = np.random.default_rng(0).normal(size=(3, 6))
    steps = robot.newton_euler(q, dq, ddq)
    close(steps.V[-1], robot.frame_velocity(q, dq, "wrist_3_link", kind="body"))


def test_the_arm_of_the_book_has_the_torques_of_equation_8_9():
    """Two point masses of 1 kg on links of 1 m, by hand: τ = M ddq + c + g at (0, 90°)."""
    steps = tw.robots.planar_2r().newton_euler([0.0, np.pi / 2], [1.0, 0.5], [1.0, -2.0])
    np.testing.assert_allclose(steps.tau, [3 - 2 - 1.25 + 2 * 9.81, 1 - 2 + 1.0], atol=1e-12)


def test_the_report_fits_a_screen_and_has_all_digits_as_data():
    steps = tw.robots.ur5().newton_euler(np.ones(6), np.ones(6), np.ones(6))
    assert len(str(steps).splitlines()) <= 45 and str(steps.verdict.word) == "DONE"
    rows = steps.tables["Torques"].rows()
    assert [row["τ"] for row in rows] == steps.tau.tolist()
    assert "<table" in steps._repr_html_()


@pytest.mark.parametrize(
    ("state", "error", "said"),
    [
        (([0, 0], [0, 0], [0]), tw.ShapeError, "ddq"),
        ((np.zeros((3, 2)), np.zeros(2), np.zeros(2)), tw.ShapeError, "one state"),
        (([0, np.nan], [0, 0], [0, 0]), tw.TwistWrenchError, "q"),
    ],
)
def test_bad_states_are_one_error(state, error, said):
    with pytest.raises(error, match=said):
        tw.robots.planar_2r().newton_euler(*state)
