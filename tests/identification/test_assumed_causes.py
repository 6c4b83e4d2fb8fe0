"""Causes that a fit assumes: names, values with their intervals, parameters, and torques of another motion."""

from __future__ import annotations

import numpy as np
import pytest

import twistwrench as tw
from twistwrench.errors import UnknownNameError, ValueRangeError
from twistwrench.identification.assumed import JOINTS_OF_CAUSE, WantedCause, wanted_causes

ARM = tw.robots.planar_2r()
NAMES = ARM.model.velocity_names


@pytest.fixture(scope="module")
def log():
    """Ten seconds of two joints with friction and noise."""
    t = np.arange(0, 10, 0.01)
    q = np.stack([np.sin(1.3 * t) + 0.5 * np.sin(3.1 * t), np.cos(1.9 * t) + np.sin(4.3 * t)], axis=1)
    motion = tw.Motion(t, q, robot=ARM)
    noise = 0.1 * np.random.default_rng(0).normal(size=q.shape)
    return tw.Motion(t, q, tau=motion.torques() + 0.4 * motion.dq + noise, robot=ARM)


def test_causes_are_named_with_their_joints():
    wanted = wanted_causes(["gain:joint2", " tilt", "exchanged-torques:joint2:joint1"], ("joint1", "joint2"))
    assert wanted == (
        WantedCause("exchanged-torques", (0, 1)),
        WantedCause("tilt", ()),
        WantedCause("gain", (1,)),
    )
    assert wanted_causes("load-friction", NAMES) == (WantedCause("load-friction", ()),)
    assert wanted_causes((), NAMES) == ()


@pytest.mark.parametrize(
    ("assume", "error", "said"),
    [
        ("gian:joint1", UnknownNameError, "Did you mean 'gain'"),
        ("gain:joint9", UnknownNameError, "no joint named 'joint9'"),
        ("gain", ValueRangeError, "write gain:JOINT"),
        ("tilt:joint1", ValueRangeError, "write tilt"),
        ("exchanged-torques:joint1", ValueRangeError, "JOINT:JOINT"),
        ("exchanged-torques:joint1:joint1", ValueRangeError, "JOINT:JOINT"),
        ("low-pass", ValueRangeError, "before the filter"),
        ("late-joint:joint1", ValueRangeError, "friction and elasticity"),
        (["tilt", "tilt"], ValueRangeError, "twice"),
        (["warming", "warming:joint1"], ValueRangeError, "twice"),
    ],
)
def test_other_causes_are_refused(assume, error, said):
    names = ("joint1", "joint2")
    with pytest.raises(error, match=said):
        wanted_causes(assume, names)


def test_every_cause_that_can_be_assumed_is_a_row_of_the_table():
    from twistwrench.log_checks.doubts import doubt_table

    assert JOINTS_OF_CAUSE.keys() <= doubt_table().keys()


def test_a_gain_is_an_unknown_of_the_fit(log):
    scaled = tw.Motion(log.time, log.q, tau=np.asarray(log.tau) * [1.0, 1.5], robot=ARM)
    fixed = {"cutoff": 10.0, "friction_speed": 0.05, "shift": 0.0}
    right = tw.identification.identify(ARM, log, **fixed)
    found = tw.identification.identify(ARM, scaled, assume=f"gain:{NAMES[1]}", **fixed)
    (gain,) = found.settings.assumed
    assert gain.kind == "gain" and gain.joints == (NAMES[1],)
    assert gain.interval[0] <= 1.5 <= gain.interval[1] and abs(gain.value - 1.5) < 0.02
    assert "gain" not in {doubt.kind for doubt in found.doubts}
    np.testing.assert_allclose(found.values, right.values, rtol=0.05, atol=0.02)
    wider = found.covariance.textbook / right.covariance.textbook
    assert (wider > 0.99).all() and wider.max() > 1.1
    assert found.to_dict()["assumed"][0]["value"] == gain.value and "assuming gain" in repr(found)
    assert any(note.startswith("Assumed: gain") for note in found.notes)


def test_a_cause_that_a_log_does_not_tell_is_refused(log):
    with pytest.raises(ValueRangeError, match="do not tell"):
        tw.identification.identify(ARM, log, assume="tilt", cutoff=10.0, friction_speed=0.05, shift=0.0)
    with pytest.raises(ValueRangeError, match="late is assumed"):
        tw.identification.identify(ARM, log, assume="late", shift=0.0)
