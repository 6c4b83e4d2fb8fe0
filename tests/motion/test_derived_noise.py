"""What the noise of a log makes of rates and figures derived from it: laws beside those of test_motion_rates."""

from __future__ import annotations

import numpy as np
import pytest
from motions import report_of, write_positions

from twistwrench import robots
from twistwrench.core.estimation.noise import noise
from twistwrench.motion.coordinates import Continuity, Coordinates
from twistwrench.motion.differentiation import Differentiation
from twistwrench.motion.load_case import Payload
from twistwrench.motion.motion_log import MotionLog
from twistwrench.motion.smoothing import smooth


def plan_of(robot, path, *, degrees=False, smoothing=False):
    return Differentiation.plan(MotionLog.open(path, robot.model, degrees=degrees), robot.model, smoothing=smoothing)


def test_accelerations_of_a_floating_base_are_as_noisy_as_is_claimed(tmp_path):
    """A quaternion turns by half the angle, so that its noise is twice as much in the angle; 5000 rows tell it to 3 %."""
    robot = robots.floating_box(floating_base=True)
    t = np.arange(5000) * 1e-3
    q = np.zeros((len(t), 7))
    q[:, 0], q[:, 2] = np.cos(t / 2), np.sin(t / 2)
    q += 1e-5 * np.random.default_rng(1).normal(size=q.shape)
    plan = plan_of(robot, write_positions(tmp_path / "m.csv", robot, t, q))
    (states,) = plan.states(10_000)
    inner = slice(100, -100)
    np.testing.assert_allclose(states.ddq[inner].std(axis=0), plan.sigma_ddq, rtol=0.15)
    np.testing.assert_allclose(states.dq[inner].std(axis=0), plan.sigma_dq, rtol=0.15)


def test_the_unit_of_a_log_is_no_noise(tmp_path):
    robot = robots.planar_2r()
    t = np.arange(3000) * 2e-3
    q = 0.3 * np.sin(np.outer(t, [2.0, 3.0])) + 1e-4 * np.random.default_rng(2).normal(size=(3000, 2))
    radians = plan_of(robot, write_positions(tmp_path / "r.csv", robot, t, q))
    degrees = plan_of(robot, write_positions(tmp_path / "d.csv", robot, t, np.degrees(q)), degrees=True)
    for name in ("sigma_ddq", "sigma_dq", "spread"):
        np.testing.assert_allclose(getattr(degrees, name), getattr(radians, name), rtol=1e-6)
    np.testing.assert_allclose(degrees.errors.at_rest, radians.errors.at_rest, rtol=1e-6)


def test_a_slow_joint_on_a_coarse_grid_moves_although_its_samples_repeat(tmp_path):
    robot = robots.planar_2r()
    t = np.arange(4000) * 1e-3
    angle = 0.3 * t + 0.05 * np.sin(2 * t)
    q = np.round(np.column_stack([angle, 0.7 * angle]) / 2e-3) * 2e-3
    assert (np.diff(q, axis=0) == 0).mean() > 0.8
    (states,) = plan_of(robot, write_positions(tmp_path / "m.csv", robot, t, q), smoothing=True).states(10_000)
    assert not states.stationary[200:-200].any()


@pytest.mark.parametrize("begin", [0, 3000])
def test_noise_of_two_sizes_is_that_of_all_rows(begin):
    """A tenth of the rows thirty times as noisy are too many to be glitches, and the quiet ones do not speak for them."""
    rng = np.random.default_rng(3)
    t = np.arange(6000) * 1e-3
    sizes = np.full(len(t), 1e-5)
    sizes[begin : begin + 600] *= 30.0
    x = np.sin(2 * t) + sizes * rng.normal(size=len(t))
    assert noise([t], [x[:, None]])[0] == pytest.approx(np.sqrt(np.mean(sizes**2)), rel=0.15)


def test_smoothing_is_that_of_the_curve_whatever_the_grid():
    """The penalty is the integral of the third derivative squared: of half the samples, half the strength does the same."""
    t = np.arange(4001) * 1e-3
    x = np.sin(30 * t)
    whole, half = smooth(t, x, 1e9, 1e-3), smooth(t[::2], x[::2], 0.5e9, 1e-3)
    inner = slice(200, -200)
    assert 0.3 < np.abs(whole[::2][inner]).max() < 0.8  # neither all nor nothing is smoothed away
    np.testing.assert_allclose(half[inner], whole[::2][inner], atol=2e-3)


def test_a_bounded_joint_that_steps_by_more_than_half_a_turn_has_done_so():
    coordinates = Coordinates.from_model(robots.ur5().model)
    q = np.zeros((20, 6))
    q[:, 1] = np.where(np.arange(20) < 10, -1.8, 1.8)
    np.testing.assert_array_equal(Continuity.from_parts(coordinates, [q]).curves(q), q)


@pytest.mark.parametrize("end", ["begin", "end"])
def test_a_peak_at_either_end_of_a_log_is_said_to_want_for_neighbours(tmp_path, end):
    robot = robots.pendulum().with_gravity([0, 0, 0])
    t = np.arange(400) * 5e-3
    curve = (t[::-1] if end == "begin" else t) ** 4 / 12  # its acceleration is largest there
    report = report_of(robot, write_positions(tmp_path / "m.csv", robot, t, curve), friction=False)
    (joint,) = report.joints
    assert joint.time == pytest.approx(0.0 if end == "begin" else t[-1])
    assert report.at_an_end(joint)


def test_late_stamps_of_velocities_matter_where_the_joint_accelerates(tmp_path):
    """A velocity read e late is off by ddq e, and not by dq e, which is largest where the acceleration is none."""
    robot, rng = robots.pendulum().with_gravity([0, 0, 0]), np.random.default_rng(4)
    t = np.arange(4000) * 1e-3
    read = t + 1e-4 * rng.normal(size=len(t))
    table = np.column_stack([t, -np.cos(3 * t) / 3, np.sin(3 * read)])
    (name,) = robot.joint_names
    np.savetxt(tmp_path / "m.csv", table, "%.17g", ",", header=f"time,{name},{name}.vel", comments="")
    plan = plan_of(robot, tmp_path / "m.csv")
    assert plan.source == "velocities"
    (states,) = plan.states(10_000)
    sigma, share = plan.sigma_at(states)[:, 0], np.abs(np.cos(3 * t))
    assert sigma[share > 0.9].min() > 2 * sigma[share < 0.1].max()


@pytest.mark.parametrize("angle", [0.5, -0.5])
def test_the_main_cause_of_a_peak_is_along_it_whatever_its_sign(tmp_path, angle):
    robot = robots.pendulum()
    t = np.arange(100) * 1e-2
    report = report_of(robot, write_positions(tmp_path / "m.csv", robot, t, np.full((100, 1), angle)), friction=False)
    (joint,) = report.joints
    assert joint.main_cause == ("gravity", pytest.approx(1.0))


def test_what_pulls_against_a_peak_is_not_its_main_cause_however_large(tmp_path):
    """The rod takes 4.7 N m, its payload 1.2 times that, and a moment of 6 N m on it lifts both."""
    robot = robots.pendulum()
    path = write_positions(tmp_path / "m.csv", robot, np.arange(100) * 1e-2, np.full((100, 1), 0.5))
    moment = np.array([0.0, 6.0, 0.0, 0.0, 0.0, 0.0])
    (joint,) = report_of(robot, path, friction=False, payloads=(Payload(1.2),), wrenches={"bob": moment}).joints
    assert joint.terms["wrench"] < -joint.terms["payload"] < -joint.terms["gravity"] < 0.0 < joint.peak
    assert joint.main_cause == ("payload", pytest.approx(1.2 / 2.2))
