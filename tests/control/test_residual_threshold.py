"""Thresholds of a momentum observer's residual: false alarms of simulated work, parts, and the least push that passes."""

from __future__ import annotations

import numpy as np
import pytest

import twistwrench as tw
from twistwrench.control.residual_threshold import _DIRECTIONS, gumbel_level, smallest_force

ARM = tw.robots.planar_2r()
GAIN, STEP = 30.0, 0.01


def work(seconds, seed, friction=0.0, noise=0.5):
    """Log of sums of sines with noisy torques, and Coulomb friction that the robot's file lacks."""
    rng, t = np.random.default_rng(seed), np.arange(0.0, seconds, STEP)
    hertz = np.array([0.13, 0.31, 0.47])
    a, phase = rng.uniform(0.2, 0.5, (3, 2)), rng.uniform(0.0, 2.0 * np.pi, (3, 2))
    w = 2.0 * np.pi * hertz[:, None]
    angle = w * t[:, None, None] + phase
    q, dq, ddq = ((a * x).sum(axis=1) for x in (np.sin(angle), w * np.cos(angle), -(w**2) * np.sin(angle)))
    tau = np.asarray(ARM.inverse_dynamics(q, dq, ddq)) + friction * np.sign(dq)
    tau = 0.5 * (tau + np.roll(tau, -1, axis=0)) + rng.normal(0.0, noise, q.shape)  # held from each row to the next
    return tw.Motion(t, q, dq, ddq, tau, robot=ARM, in_seconds=True)


def alarms(found, motion):
    """Number of seconds in which the residual of some joint passes its threshold."""
    e = np.abs(found.observer.over(motion.time, motion.q, motion.dq, motion.tau)) > found.torques
    return int(e.any(axis=1)[: len(e) // 100 * 100].reshape(-1, 100).any(axis=1).sum())


def test_false_alarms_come_at_the_rate_that_was_asked_for():
    """Twenty minutes of other work of the same kind: 40 alarms were asked for, which scatter by 6.3."""
    found = tw.control.MomentumObserver(ARM, GAIN).threshold(work(600.0, 1), per_hour=120.0)
    assert found.verdict.ok
    assert 40 / 3 < alarms(found, work(1200.0, 2)) < 40 * 3


def test_joints_share_the_alarms_that_were_asked_for():
    """1200 alarms an hour by two joints: each passes its level in a sixth of the seconds of other work."""
    found = tw.control.MomentumObserver(ARM, GAIN).threshold(work(600.0, 1), per_hour=1200.0)
    log = work(600.0, 2)
    passed = np.abs(found.observer.over(log.time, log.q, log.dq, log.tau)) > found.torques
    shares = passed.reshape(-1, 100, 2).any(axis=1).mean(axis=0)
    np.testing.assert_allclose(shares, 1 / 6, atol=0.06)  # of 600 seconds: 0.015 by chance, the rest by the fitted law


@pytest.mark.slow
@pytest.mark.parametrize("per_hour", [1.0, 10.0])
def test_false_alarms_of_ten_hours(per_hour):
    """Ten hours of simulated work: 10 and 100 alarms were asked for; counts of 10 scatter by 3.2."""
    found = tw.control.MomentumObserver(ARM, GAIN).threshold(work(1800.0, 1), per_hour=per_hour)
    count = sum(alarms(found, work(3600.0, seed)) for seed in range(10, 20))
    assert 10 * per_hour / 3 <= count <= 10 * per_hour * 3


def test_friction_that_the_file_lacks_is_the_model_part():
    found = tw.control.MomentumObserver(ARM, GAIN).threshold(work(300.0, 3, friction=2.0))
    plain = tw.control.MomentumObserver(ARM, GAIN).threshold(work(300.0, 3))
    np.testing.assert_allclose(found.model, 2.0, atol=0.3)
    assert (plain.model < 0.1).all()
    np.testing.assert_array_equal(found.torques, found.noise + found.model)


def test_the_smallest_push_passes_a_threshold_in_the_worst_direction_and_no_smaller_one_does():
    ur5 = tw.robots.ur5()
    observer, threshold = tw.control.MomentumObserver(ur5, GAIN), np.linspace(2.0, 4.0, 6)
    q = np.array([[0.3, -1.0, 1.2, 0.4, 0.5, 0.1]])
    force = smallest_force(observer, q, threshold)
    for scale, passes in ((1.001, True), (0.999, False)):
        torques = _DIRECTIONS * scale * force @ ur5.jacobian(q[0])[3:] * -np.expm1(-0.3 * GAIN)
        assert (np.abs(torques) > threshold).any(axis=1).all() == passes
    assert np.isinf(smallest_force(tw.control.MomentumObserver(ARM, GAIN), np.array([[0.3, 1.0]]), np.ones(2)))


def test_a_push_in_the_log_and_a_short_log_are_unsure():
    quiet = work(120.0, 4)
    tau = quiet.tau.copy()
    tau[5000:5050, 0] += 30.0
    pushed = tw.Motion(quiet.time, quiet.q, quiet.dq, quiet.ddq, tau, robot=ARM, in_seconds=True)
    observer = tw.control.MomentumObserver(ARM, GAIN)
    assert [one.kind for one in observer.threshold(quiet).doubts] == []
    assert [one.kind for one in observer.threshold(pushed).doubts] == ["residual-pushed"]
    assert "t = 50 s" in str(observer.threshold(pushed))
    short = observer.threshold(quiet.between(0.0, 20.0))
    assert short.verdict.word == "UNSURE"
    assert "19 blocks of 1 s" in short.headline


def test_levels_of_gaussian_noise_are_those_of_its_law():
    """Maxima of 15 independent numbers in each block: a share of 1e-4 passes 4.4 standard deviations."""
    maxima = np.abs(np.random.default_rng(5).normal(size=(4000, 15, 1))).max(axis=1)
    np.testing.assert_allclose(gumbel_level(maxima, 1e-4), 4.5, atol=0.2)


@pytest.mark.parametrize("share", [0.5, 0.2, 0.1, 0.05])
def test_levels_are_passed_by_the_share_of_the_blocks_that_was_asked_for(share):
    """Counted among the maxima themselves: 4000 blocks have 200 beyond a level of 5 %, with 14 by chance."""
    maxima = np.abs(np.random.default_rng(5).normal(size=(4000, 15, 1))).max(axis=1)
    assert (maxima > gumbel_level(maxima, share)).mean() == pytest.approx(share, rel=0.15)


def test_bad_input_is_one_error():
    observer, log = tw.control.MomentumObserver(ARM, GAIN), work(40.0, 6)
    with pytest.raises(tw.ShapeError, match="no torques"):
        observer.threshold(tw.Motion(log.time, log.q, log.dq, log.ddq, robot=ARM, in_seconds=True))
    with pytest.raises(tw.ValueRangeError, match="per_hour"):
        observer.threshold(log, per_hour=0.0)
    with pytest.raises(tw.ValueRangeError, match="Give 32 s"):
        observer.threshold(log[:300])
