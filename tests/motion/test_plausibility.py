"""Steps, torques and times above limits that no robot makes: what counts, from which size on, and for which source."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy.ndimage import median_filter

import twistwrench as tw
from twistwrench.motion.bounds import Extrema, TimeAbove, above_limits
from twistwrench.motion.coordinates import Coordinates
from twistwrench.motion.credible_values import credible_efforts
from twistwrench.motion.plausibility import (
    DoubtfulSpans,
    Instant,
    InstantKind,
    Origin,
    RecordedSteps,
    _departures,
    doubtful_spans,
    impossible_torque,
)

ARM = tw.robots.ur5()
LEVELS = {Origin.LOG: "refuse", Origin.EITHER: "unsure"}


def torques(share):
    """Torques of the UR5, of which the elbow's is a share of its limit."""
    tau = np.array([[0.0, 0.0, share, 0.0, 0.0, 0.0]]) * ARM.limits.effort
    return Extrema.from_rows(np.array([2.0]), np.abs(tau), tau)


def corner(time, kind=InstantKind.IMPACT):
    return Instant(time, time + 0.1, 2, kind)


@pytest.mark.parametrize("origin", LEVELS)
def test_a_torque_of_more_than_ten_times_its_limit_is_no_robot_s(origin):
    assert impossible_torque(ARM, torques(9.9), origin, DoubtfulSpans()) is None
    found = impossible_torque(ARM, torques(10.1), origin, DoubtfulSpans())
    assert (found.kind, found.level, found.joints) == ("impossible-torque", LEVELS[origin], ("elbow_joint",))


def test_a_planner_may_ask_for_any_torque():
    assert impossible_torque(ARM, torques(1000.0), Origin.PLAN, DoubtfulSpans()) is None


def test_a_torque_at_a_corner_is_that_of_an_impact():
    at, elsewhere = (DoubtfulSpans((corner(time),), 0.05) for time in (1.95, 3.0))
    assert impossible_torque(ARM, torques(50.0), Origin.LOG, at).kind == "impact"
    assert impossible_torque(ARM, torques(50.0), Origin.LOG, elsewhere).kind == "impossible-torque"


@pytest.mark.parametrize(("shoulder", "kept"), [(21, True), (19, False)])
def test_a_limit_that_the_weight_alone_passes_three_times_makes_all_placeholders(shoulder, kept):
    """The arm's weight alone takes up to 59.3 N m at the shoulder."""
    efforts = iter((150, shoulder, 30, 28, 28, 28))
    text = re.sub('effort="[^"]*"', lambda _: f'effort="{next(efforts)}"', tw.robots.path_of("ur5").read_text())
    assert np.isfinite(credible_efforts(tw.load(text))).tolist() == [kept] * 6


def test_corners_are_doubted_in_a_recording_alone_and_nothing_in_a_plan():
    every = [corner(float(k), kind) for k, kind in enumerate(InstantKind)]
    kept = {origin: {i.cause for i in doubtful_spans(every, 0.01, origin).instants} for origin in Origin}
    assert kept[Origin.PLAN] == set() and kept[Origin.LOG] == set(InstantKind)
    assert kept[Origin.EITHER] == {InstantKind.ROWS, InstantKind.FREEZE}


# ── Steps of a joint without a velocity limit

T = np.arange(400) * 0.01


def lone_steps(q, t=T):
    model = tw.robots.planar_2r().model
    q = np.stack([q, np.zeros(len(q))], axis=1)
    steps = RecordedSteps(Coordinates.from_model(model), [(t, q)])
    steps.add(t, q)
    return [found.kind for found in steps.doubts(None, Origin.LOG)]


def test_a_step_far_beyond_all_others_is_doubted_and_a_turn_or_a_pause_is_not():
    turning = 2.0 * T
    assert lone_steps(turning) == []
    assert lone_steps(turning + 1.0 * (T > 2.0)) == ["lone-step"]
    assert lone_steps(np.angle(np.exp(1j * turning))) == []  # passes from π to −π
    assert lone_steps(turning + 1.0 * (T > 2.0), T + 0.5 * (T > 2.0)) == []  # a recorder that paused


# ── Measured torques that stay above a limit


def time_above(time, tau):
    return TimeAbove.from_rows(time, above_limits(tau, np.array([9.0]), np.array([0.0])))


def lasting(rows, step, *, at=10.0):
    """Whether a torque that is above 9 for some rows of a log stays there."""
    tau = np.zeros((40, 1))
    tau[5 : 5 + rows] = -at
    return bool(time_above(np.arange(40) * step, tau).is_lasting(step)[0])


def test_a_torque_stays_above_its_limit_from_three_rows_and_10_ms_on():
    assert lasting(3, 0.01) and lasting(10, 0.001)
    assert not lasting(2, 0.01) and not lasting(9, 0.001)
    assert not lasting(20, 0.01, at=9.0)


def test_a_torque_above_its_limit_in_every_other_row_does_not_stay_there():
    above = time_above(T, np.where(np.arange(len(T)) % 2, 10.0, 0.0)[:, None])
    assert not above.is_lasting(0.01)[0] and above.rows[0] == 1


def test_departures_from_running_medians_are_those_of_scipy_bit_for_bit():
    speeds = np.random.default_rng(0).normal(size=(200, 3))
    medians = median_filter(speeds, (9, 1))
    np.testing.assert_array_equal(_departures(speeds)[4:-4], (speeds - medians)[4:-4])
