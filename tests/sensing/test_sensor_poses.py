"""Which orientations are proposed."""

from __future__ import annotations

import math

import numpy as np
import pytest
from sensor_logs import NOISES as NOISE
from sensor_logs import tool

import twistwrench as tw
from twistwrench.sensing.log import ReadingLog
from twistwrench.sensing.poses import propose_poses
from twistwrench.sensing.simulated_logs import simulate


def test_chosen_poses_tell_more_than_random_ones():
    chosen = propose_poses(12)
    rng = np.random.default_rng(0)
    logs = [ReadingLog.from_arrays(np.zeros((11, 6)), gravity=9.81 * d / np.linalg.norm(d, axis=1, keepdims=True))
            for d in rng.normal(size=(20, 11, 3))]  # fmt: skip
    random = [propose_poses(1, log=log) for log in logs]
    assert chosen.mass_deviation[-1] < np.median([p.mass_deviation[-1] for p in random])
    assert chosen.first_moment_deviation[-1] < np.median([p.first_moment_deviation[-1] for p in random])
    best = NOISE[1] / (9.81 * math.sqrt(12))  # gravity that cancels in the mean
    assert best <= chosen.mass_deviation[-1] < 1.02 * best


def test_next_poses_fill_what_a_log_lacks():
    upright = simulate(tool(), np.tile(np.eye(3), (6, 1, 1)))
    proposal = propose_poses(3, log=upright)
    tilt = np.degrees(np.arccos(-proposal.gravity[:, 2] / 9.81))
    assert tilt[0] > 60
    assert np.isfinite(proposal.mass_deviation[-1])


def test_poses_stay_within_the_tilt_allowed():
    proposal = propose_poses(12, within=math.radians(40))
    assert np.arccos(-proposal.gravity[:, 2] / 9.81).max() <= math.radians(40) + 1e-9
    with pytest.raises(tw.ValueRangeError, match="Allow more"):
        propose_poses(3, candidates=[[0, 0, 1]], within=0.5)
    with pytest.raises(tw.ValueRangeError, match="of at least 1"):
        propose_poses(0)
    with pytest.raises(tw.ShapeError, match="gravity directions"):
        propose_poses(1, candidates=[1, 2, 3])


def test_poses_are_proposed_for_the_gravity_that_is_there():
    here, moon = tw.sensing.propose_poses(6), tw.sensing.propose_poses(6, gravity=1.62)
    assert np.allclose(np.linalg.norm(moon.gravity, axis=-1), 1.62)
    assert np.isclose(moon.mass_deviation[-1] / here.mass_deviation[-1], 9.81 / 1.62, rtol=0.05)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"count": 2.5}, "count=2.5: give a whole number"),
        ({"count": "three"}, "count='three': give a whole number"),
        ({"count": -1}, "give a whole number of at least 1"),
        ({"noise": (0.01, math.nan)}, "two positive numbers"),
        ({"noise": (0.01, -0.3)}, "two positive numbers"),
        ({"noise": None}, "two positive numbers"),
        ({"within": math.nan}, "not a valid largest tilt"),
        ({"gravity": 0.0}, "not a valid magnitude of gravity"),
    ],
)
def test_what_is_no_proposal_is_said(arguments, said):
    with pytest.raises(tw.ValueRangeError, match=said):
        propose_poses(**{"count": 3, **arguments})


def test_counts_may_be_of_any_integer_type():
    np.testing.assert_array_equal(propose_poses(np.int64(5)).gravity, propose_poses(5).gravity)


@pytest.mark.parametrize(("sign", "factor"), [("on_sensor", 1), ("by_sensor", -1)])
def test_a_simulated_touch_is_in_the_readings_with_their_sign(sign, factor):
    touch = np.array([0.1, -0.2, 0.3, 4.0, -5.0, 6.0])
    log = simulate(tool(sign=sign), 30, motion=2.0, noise=(0, 0), touch={4: touch})
    expected = np.zeros((30, 6))
    expected[4] = factor * touch
    np.testing.assert_allclose(log.compensated(tool(sign=sign)), expected, atol=1e-9)


def test_rates_of_a_simulated_motion_are_its_slopes():
    log = simulate(tool(), 4001, motion=2.0, noise=(0, 0))
    np.testing.assert_allclose(log.dV[1:-1], np.gradient(log.V, log.time, axis=0)[1:-1], atol=1e-4)


def test_poses_that_were_read_count_as_those_proposed():
    whole = propose_poses(8)
    log = ReadingLog.from_arrays(np.zeros((4, 6)), gravity=whole.gravity[:4])
    rest = propose_poses(4, log=log)
    np.testing.assert_allclose(rest.gravity, whole.gravity[4:], atol=1e-12)
    np.testing.assert_allclose(rest.mass_deviation, whole.mass_deviation[4:], rtol=1e-9)
