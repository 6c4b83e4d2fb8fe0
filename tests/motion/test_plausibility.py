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
    _is_abrupt,
    _pulses,
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


def pulses_of(departures, *, split, base=0.0, own=slice(0, 60), share=0.6):
    """Pulses of speeds that are ``base`` but for some rows from row 20 on; those below 0.5 are no pulses."""
    v = np.full((60, 1), base)
    v[20 : 20 + len(departures), 0] += departures
    return [(first, last) for first, last, _ in _pulses(v, np.array([0.5]), share, own, split=split)]


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize(
    ("departures", "split", "found"),
    [
        ([1.0], False, [(20, 20)]),
        ([0.49], False, []),
        ([1.0, 0.33], False, [(20, 20)]),
        ([1.0, 0.37], False, []),  # of more than 0.35 beside it, no lone pulse
        ([1.0, 0.37], True, [(20, 21)]),  # an impact between two rows
        ([1.0, -0.37], True, []),  # back and forth is none
        ([1.0, -0.33], True, [(20, 20)]),
        ([1.0, 0.0, 0.37], True, []),
        ([1.0] * 4, False, [(20, 23)]),
        ([1.0, 0, 0, 0, 1.0], False, [(20, 24)]),
        ([1.0, 0, 0, 0, 0, 1.0], False, []),  # too long for one
        ([1.0, 0, 0, 0, 0, 0, 1.0], False, [(20, 20), (26, 26)]),
        ([1.0, 0, 0, 0, 0, 0.4], False, []),  # five steps beside it are quiet
        ([1.0, 0, 0, 0, 0, 0, 0.4], False, [(20, 20)]),
    ],
)
def test_pulses_are_a_few_rows_in_quiet_surroundings_forwards_and_backwards(departures, split, found, mirrored):
    if mirrored:
        end = 39 + len(departures)  # first and last row of what departs, together
        departures, found = departures[::-1], [(end - last, end - first) for first, last in found[::-1]]
    assert pulses_of(departures, split=split) == found


def test_a_pulse_departs_by_a_share_of_the_speed_around_it_and_begins_in_a_portion_s_own_rows():
    assert pulses_of([1.1], split=False, base=2.0) == [] and pulses_of([1.1], split=False, base=-2.0) == []
    assert pulses_of([1.3], split=False, base=2.0) == pulses_of([-1.3], split=False, base=-2.0) == [(20, 20)]
    for own, found in ((slice(20, 21), [(20, 20)]), (slice(0, 20), []), (slice(21, 60), [])):
        assert pulses_of([1.0], split=False, own=own) == found


def test_the_column_of_a_pulse_is_the_one_that_departs_most_for_its_noise():
    v = np.zeros((60, 2))
    v[20] = 1.0, 3.0
    assert [found[2] for found in _pulses(v, np.array([0.5, 2.0]), 0.6, slice(0, 60))] == [0]
    assert [found[2] for found in _pulses(v, np.array([0.5, 1.0]), 0.6, slice(0, 60))] == [1]


def test_a_brief_stop_is_smooth_and_a_repeated_row_is_abrupt():
    """Speeds change most at the ends of a wrong row, and beside them where a joint comes to rest and starts again."""
    stop = 1.0 - np.exp(-(((np.arange(60) - 30.0) / 3.0) ** 2))
    assert not _is_abrupt(stop, 29, 31) and not _is_abrupt(1.0 - stop, 29, 31)
    wrong = np.ones(60)
    for rows in (slice(30, 31), slice(30, 33)):
        wrong[rows] = 0.0
        assert _is_abrupt(wrong, rows.start, rows.stop - 1)
    kick = np.where(np.arange(60) == 33, 3.0, 1.0)
    kick[30] = 0.0
    assert not _is_abrupt(kick, 30, 30) and not _is_abrupt(kick[::-1], 29, 29)
    ends = np.r_[np.full(30, 0.2), 0.0, 1.0, 1.0, np.full(27, 1.5)]  # changes by 0.2 and 1.0, and by 0.5 beside them
    assert _is_abrupt(ends, 30, 30) and _is_abrupt(ends[::-1], 29, 29)
