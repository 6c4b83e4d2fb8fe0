"""Servos from commands and positions: values of simulated worlds, joints without a scale, and wrong commands."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

import twistwrench as tw
from twistwrench.core.estimation.cross_validation import HeldOut
from twistwrench.identification.servos.identify_servos import _first_rows, _sums_of_squares, _typical_sizes
from twistwrench.identification.servos.linear_start import scale_determining_torques
from twistwrench.identification.servos.output_error import OutputErrorFit, OutputErrorProblem
from twistwrench.identification.servos.replay import ServoLog, _hermite
from twistwrench.identification.servos.result import IdentifiedServos
from twistwrench.identification.servos.result_view import _accuracy, _cells
from twistwrench.identification.servos.servo_doubts import command_doubts

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
    _, J = problem.linearise(p)
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
        (lambda c: np.degrees(c), "servo-unit"),
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


# ── What follows from definitions, without a fit

RATE = 1e-3
"""Time between rows [s]."""


def log_of(command, positions=None, rate=RATE):
    """Log of one joint whose command is a function of time."""
    time = rate * np.arange(len(command))
    q = command if positions is None else positions
    return ServoLog(time, q[:, None], command[:, None], np.zeros(1))


def test_commands_in_degrees_are_named_with_the_slope_of_positions_by_commands():
    """Positions in rad that follow their command in degrees at once move by π/180 of it."""
    robot = tw.robots.pendulum()
    positions = np.sin(2 * np.pi * np.arange(0.0, 4.0, RATE))
    (named,) = command_doubts(robot, [log_of(np.degrees(positions), positions)])
    assert named.kind == "servo-unit"
    assert "move by 0.0175 of their command" in str(named)


def fit_of(covariance, p):
    """Fit of two joints with a covariance of its unknowns, whose positions are exact."""
    replay = SimpleNamespace(step=RATE, hold="linear")
    return OutputErrorFit(replay, p, covariance, 1e6, [np.zeros((1, 2))], np.ones(2), 1.0, 1)


def servos_of(covariance, sizes=1.0):
    p = np.append(np.log(np.tile([0.5, 4.0, 0.6, 100.0], 2)), 0.02)
    held = HeldOut("used rows", np.zeros(2), np.ones(2), ("joint1", "joint2"))
    return IdentifiedServos(
        tw.robots.planar_2r(), fit_of(covariance, p), held, held, sizes * np.ones((2, 3)), np.ones(2, bool), {}
    )


def test_a_held_command_is_the_one_before_and_a_straight_one_lies_between():
    log = log_of(np.array([0.0, 1.0, 5.0]), rate=1.0)
    begin = np.array([0.25, 0.75, 1.25])
    np.testing.assert_allclose(log.mean_command(begin, 0.5, "zero")[:, 0], [0.0, 0.5, 1.0], atol=1e-12)
    np.testing.assert_allclose(log.mean_command(begin, 0.5, "linear")[:, 0], [0.5, 1.0, 3.0], atol=1e-12)


def test_a_position_that_follows_its_command_late_has_no_tracking_error():
    """A ramp of 2 rad/s, 20 ms late: c(t - δ) - q is 0, and c(t) - q would be 40 mrad."""
    time = RATE * np.arange(1000)
    log = log_of(2.0 * time, 2.0 * (time - 0.02))
    log = replace(log, q=np.tile(log.q, 2), command=np.tile(log.command, 2))
    fit = replace(fit_of(np.eye(9), np.append(np.zeros(8), 0.02)), residuals=[np.zeros((800, 2))])
    squares, sizes = _sums_of_squares([log], [np.arange(100, 900)], fit)
    assert (squares == 0.0).all() and (np.sqrt(sizes / 800) <= 2.0 * RATE).all()


def test_what_short_logs_do_not_need_goes_to_long_ones():
    """Of 120 s, logs of 20, 300 and 400 s get 20, 50 and 50 s."""
    logs = [log_of(np.zeros(seconds + 1), rate=1.0) for seconds in (300, 20, 400)]
    assert [float(log.time[-1]) for log in _first_rows(logs)] == [50.0, 20.0, 50.0]


def test_sizes_are_those_of_acceleration_and_speed():
    """A sine of 0.5 rad at 2 Hz: rms speed 0.5 ω / √2, rms acceleration 0.5 ω² / √2."""
    omega = 4.0 * np.pi
    sizes = _typical_sizes([log_of(0.5 * np.sin(omega * RATE * np.arange(10_000)))])
    np.testing.assert_allclose(sizes[0], [0.5 * omega**2 / np.sqrt(2), 0.5 * omega / np.sqrt(2), 1.0], rtol=2e-2)


def test_cubics_pass_exactly_between_two_states():
    """t³ - 2 t has a slope of 3 t² - 2; between steps of 0.1 s a cubic is itself."""
    steps, time = 0.1 * np.arange(11), np.linspace(0.0, 0.99, 34)
    q, dq = steps**3 - 2.0 * steps, 3.0 * steps**2 - 2.0
    found = _hermite(q[None, :, None], dq[None, :, None], time, 0.1)
    np.testing.assert_allclose(found[0, :, 0], time**3 - 2.0 * time, atol=1e-12)


def test_ratios_are_told_where_the_scale_is_not():
    """All values of a joint may change by the same factor, e^±1: kp is open, ratios to it have √2 times 1 % each."""
    one = np.full((4, 4), 1.0) + 1e-4 * np.eye(4)
    covariance = np.zeros((9, 9))
    covariance[:4, :4] = covariance[4:8, 4:8] = one
    covariance[8, 8] = 1e-6
    found = servos_of(covariance, sizes=1e-9)
    t = stats.norm.isf(0.025)
    np.testing.assert_allclose(found.relative()["kp"], t * np.sqrt(1.0001), rtol=1e-3)
    np.testing.assert_allclose(found.relative()["damping/kp"], t * np.sqrt(2e-4), rtol=1e-3)
    assert found.torque_shares["damping"].max() < 1e-6  # of no matter, and all the same not told without kp
    assert not found.determined["kp"].any() and not found.determined["damping"].any() and found.only_ratios.all()
    low, high = found.to_dict()["delay"]["interval"]
    np.testing.assert_allclose([low, high], [0.02 - t * 1e-3, 0.02 + t * 1e-3], atol=1e-5)


@pytest.mark.parametrize("level", [0.5, 0.68, 0.99])
def test_intervals_of_a_level_reach_as_far_as_its_quantile(level):
    """Logarithms with 1 % standard deviation each: those of values end at z 1 %, those of their ratios at √2 times that."""
    found = servos_of(1e-4 * np.eye(9))
    z = stats.norm.isf(0.5 * (1.0 - level))
    ends = 0.01 * z * np.array([-1.0, 1.0])
    np.testing.assert_allclose(np.log(found.interval(level)["kp"] / 100.0), [ends, ends], rtol=1e-4)
    ratios = np.log(found.ratio_interval(level)["damping/kp"] / 0.04)
    np.testing.assert_allclose(ratios, np.sqrt(2.0) * np.array([ends, ends]), rtol=1e-4)


def test_a_model_with_more_unknowns_needs_more_evidence():
    """Schwarz: each unknown costs half the logarithm of the number of residuals, here (10⁶ + 1) times 2."""
    fit = fit_of(np.eye(9), np.zeros(9))
    count = 2.0 * (1e6 + 1.0)
    plain = 0.5 * count * np.log(1.001)
    assert fit.evidence(1.001, 1.0) == pytest.approx(plain, rel=1e-6)
    assert fit.evidence(1.001, 1.0, 3) == pytest.approx(plain - 1.5 * np.log(count), rel=1e-6)


def test_values_that_are_not_told_stand_in_parentheses():
    cells = _cells(np.array([2.0, 3.0]), np.array([0.01, 0.5]), np.array([True, False]), ["N m", "N m"])
    assert cells[0].startswith("2") and cells[1].startswith("(3") and cells[1].endswith(")")


def test_the_share_of_friction_in_the_headline_is_that_of_the_worst_joint():
    """Of joints with all four values: 5 % of the torque of the second; the third is not determined."""
    width = {"kp": 0.01, "armature": 0.02, "damping": 0.03, "coulomb": 2.0}
    found = SimpleNamespace(
        whole=np.array([True, True, False]),
        torque_shares={"coulomb": np.array([0.001, 0.05, 0.3])},
        relative=lambda: {name: np.full(3, x) for name, x in width.items()},
    )
    assert _accuracy(found).endswith("friction ± 5 % of the joint's torque")


def test_torques_that_armature_damping_and_friction_imitate_tell_no_scale():
    """A body whose torque is 3 ddq + 2 dq + 1.5 sgn dq, up to the softened corner of the sign and the low-pass."""
    t = np.arange(0.0, 20.0, 0.01)
    log = ServoLog.from_arrays(t, 2.0 * np.sin(t)[:, None], np.zeros((len(t), 1)))

    def robot(own):
        def torques(q, dq, ddq):
            return 3.0 * ddq + 2.0 * dq + 1.5 * np.tanh(dq / 0.02) + own * np.cos(2 * q)

        return SimpleNamespace(nv=1, armature=np.zeros(1), inverse_dynamics=torques)

    assert scale_determining_torques(robot(0.0), [log])[0] < 0.1
    assert scale_determining_torques(robot(2.0), [log])[0] > 1.0
