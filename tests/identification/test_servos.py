"""Servos from commands and positions: values of simulated worlds, joints without a scale, and wrong commands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import twistwrench as tw
from twistwrench.identification.servos.output_error import OutputErrorProblem

VALUES = {"armature": [0.5, 0.3], "damping": [4.0, 2.0], "coulomb": [0.6, 0.4], "kp": [120.0, 70.0]}

DISC = """<robot name="disc"><link name="base"/>
<link name="disc"><inertial><mass value="0.01"/>
<inertia ixx="1e-6" iyy="1e-6" izz="1e-6" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="axle" type="continuous"><parent link="base"/><child link="disc"/><axis xyz="0 0 1"/></joint></robot>"""


@pytest.fixture(scope="module")
def arm():
    return tw.robots.planar_2r()


@pytest.fixture(scope="module")
def log(arm):
    return tw.identification.simulated_servo_log(arm, **VALUES, delay=0.017, seconds=10.0, seed=3)


@pytest.fixture(scope="module")
def found(arm, log):
    return tw.identification.identify_servos(arm, log, hold="zero")


def test_values_of_the_simulated_servos_lie_in_their_intervals(found):
    bounds = found.interval()
    for name, truth in VALUES.items():
        assert (bounds[name][:, 0] <= truth).all(), name
        assert (truth <= bounds[name][:, 1]).all(), name
    np.testing.assert_allclose(found.kp, VALUES["kp"], rtol=0.01)
    assert abs(found.delay - 0.017) < 1e-3
    assert found.verdict.ok


def test_the_robot_has_the_identified_armature_and_friction(found):
    np.testing.assert_array_equal(found.robot.armature, found.armature)
    np.testing.assert_array_equal(found.robot.model.friction.coulomb, found.coulomb)


def test_data_and_text_have_the_same_verdict(found):
    data = found.to_dict()
    assert data["verdict"] == found.headline.partition(":")[0] == "OK"
    assert data["servos"]["joint1"]["kp"]["value"] == found.kp[0]
    low, high = data["delay"]["interval"]
    assert low < found.delay < high


def test_derivatives_along_the_scale_of_a_joint_are_those_of_its_positions(found):
    """All four values of a joint times one factor: positions depend on it through the bodies' torques alone."""
    p, free = found.fit.p, np.ones(len(found.fit.p), bool)
    problem = OutputErrorProblem.from_logs(found.fit.replay, p, free)
    scale = np.r_[np.zeros(4), np.ones(4), 0.0]
    _, J = problem.linearised(p)
    before, after = problem.flat(np.stack([p, p + 1e-3 * scale]))
    right = (before - after) / 1e-3
    assert np.linalg.norm(J @ scale - right) < 1e-6 * np.linalg.norm(right)


def test_steps_of_two_lengths_replay_alike(found):
    """Stiffness half a step early and damping half a step late are corrected: what is left is of second order."""
    fit = found.fit
    whole, half = (replace(fit.replay, step=h).positions(fit.p[None])[0] for h in (5e-4, 2.5e-4))
    assert np.abs(whole - half).max() < 1e-4


def test_parts_of_a_motion_keep_their_commands(log):
    part = log.between(2.0, 4.0)
    np.testing.assert_array_equal(part.command, log.command[200:401])
    np.testing.assert_array_equal(log[::2].command, log.command[::2])


@pytest.mark.parametrize(
    "hold", [pytest.param("zero", marks=pytest.mark.slow), pytest.param("linear", marks=pytest.mark.slow), "auto"]
)
def test_the_interval_of_a_delay_holds_whatever_lies_between_the_commands(arm, hold):
    """At 500 Hz held commands and straight ones with a millisecond more replay alike, so that the log does not tell which."""
    fast = tw.identification.simulated_servo_log(arm, **VALUES, delay=0.017, seconds=6.0, rate=500.0, bits=14, seed=3)
    found = tw.identification.identify_servos(arm, fast, hold=hold)
    late = 0.001 if hold == "linear" else 0.0
    assert abs(found.delay - 0.017 - late) < max(found.delay_half_width, 5e-5)
    assert (found.delay_half_width > 5e-4) == (hold == "auto")


@pytest.mark.slow
def test_a_joint_on_which_nothing_hangs_is_not_determined(tmp_path):
    """A spinning disc without weight tells ratios alone: its kp and armature may have any common factor."""
    path = tmp_path / "disc.urdf"
    path.write_text(DISC)
    disc = tw.load(path)
    spun = tw.identification.simulated_servo_log(disc, armature=0.01, damping=0.4, coulomb=0.05, kp=20.0)
    servos = tw.identification.identify_servos(disc, spun)
    assert not servos.determined["kp"][0]
    assert servos.verdict.word == "UNSURE"
    np.testing.assert_allclose(servos.ratios["damping/kp"], [0.02], rtol=0.05)
    told = tw.identification.identify_servos(disc, spun, known={"axle.kp": 20.0})
    np.testing.assert_allclose(told.armature, [0.01], rtol=0.1)


@pytest.mark.slow
def test_friction_that_hardly_counts_is_stated_as_a_share_of_the_torque(arm):
    """Friction of a thousandth of the torque has a wide interval of its own; an OK states how much of the torque is open.

    The bound of 2 % of the rms torque is the one within which friction counts as determined.
    """
    log = tw.identification.simulated_servo_log(arm, armature=0.4, damping=3.0, coulomb=0.01, kp=90.0, delay=0.012)
    servos = tw.identification.identify_servos(arm, log)
    assert servos.verdict.ok
    assert (servos.relative()["coulomb"] > 1.0).all()
    assert "of the joint's torque" in servos.headline
    assert (servos.torque_shares["coulomb"] <= 0.02).all()
    assert (np.abs(servos.coulomb - 0.01) <= 0.02 * servos.rms_torques).all()


@pytest.mark.parametrize(
    ("changed", "kind"),
    [
        (lambda c: c * [1, -1], "servo-sign"),
        pytest.param(lambda c: c[:, ::-1], "servo-exchanged", marks=pytest.mark.slow),
        pytest.param(lambda c: np.degrees(c), "servo-unit", marks=pytest.mark.slow),
    ],
)
def test_commands_of_another_joint_sign_or_unit_are_named(arm, log, changed, kind):
    wrong = tw.Motion(log.time, log.q, robot=arm, command=changed(log.command), in_seconds=True)
    servos = tw.identification.identify_servos(arm, wrong, hold="zero")
    assert kind in [doubt.kind for doubt in servos.doubts]
    assert servos.verdict.word == "LOOK AGAIN"


def test_bad_input_is_one_error(arm, log):
    identify = tw.identification.identify_servos
    with pytest.raises(tw.ShapeError, match="no commands"):
        identify(arm, tw.Motion(log.time, log.q, robot=arm, in_seconds=True))
    with pytest.raises(tw.ValueRangeError, match="command of logs number 1 is its position"):
        identify(arm, tw.Motion(log.time, log.q, robot=arm, command=log.q, in_seconds=True))
    with pytest.raises(tw.ShapeError, match="command has shape"):
        tw.Motion(log.time, log.q, robot=arm, command=log.command[:-1], in_seconds=True)
    with pytest.raises(tw.UnknownNameError, match=r"joint1\.kd"):
        identify(arm, log, known={"joint1.kd": 1.0})
    with pytest.raises(tw.ModelError, match="degrees of freedom"):
        identify(tw.robots.floating_box(), log)
    with pytest.raises(tw.ShapeError, match="no log"):
        identify(arm, [])
