"""Identification of robots whose parameters are known: intervals that hold, doubts that are raised, and none that is not."""

from __future__ import annotations

import re

import numpy as np
import pytest
from identification_logs import coloured, known_log
from leaning_arm import short_arm
from quick import mostly_slow

import twistwrench as tw
from twistwrench.identification import identify, without_links
from twistwrench.mechanics.bodies.inertia import SpatialInertia
from twistwrench.testing import random_robot

ARM = tw.robots.ur5().lock({"wrist_2_joint": 0.3, "wrist_3_joint": 0.0})
LOG = known_log(ARM, 1, seconds=10.0)
GIVEN = {"cutoff": 10.0, "friction_speed": 0.05, "shift": 0.0}
"""Hz, rad/s and s: what the program chooses is tested apart."""
CLOCK_SOUGHT = {"cutoff": 10.0, "friction_speed": 0.05}


def kinds(found, *, refusing=False):
    return {doubt.kind for doubt in found.doubts if doubt.refuses or not refusing}


def test_a_clean_log_raises_no_doubt_and_gives_the_truth():
    found = identify(ARM, LOG.motion, **GIVEN)
    assert found.verdict.ok and found.doubts == ()
    assert found.held_out.all < 0.03
    off = (found.values - LOG.truth(found)) / found.standard_deviations
    assert np.sqrt((off**2).mean()) < 2.0


def test_settings_are_chosen():
    """The speed at which friction turns, and a torque that is three samples late."""
    arm = tw.robots.planar_3r()
    log = known_log(arm, 2)
    found = identify(arm, log.changed(tau=np.roll(log.motion.tau, 3, axis=0), rows=slice(10, None)))
    assert abs(found.settings.shift - 0.015) < 0.002
    assert (found.settings.friction_speed == 0.05).all()
    assert 5.0 <= found.settings.cutoff <= 20.0


def _coverage(robot, count, cutoff):
    inside = []
    for seed in range(count):
        log = known_log(robot, seed)
        found = identify(robot, log.motion, test=log.motion[:500], cutoff=cutoff)
        low, high = found.interval().T
        truth = log.truth(found)
        inside.append((low <= truth) & (truth <= high))
    return float(np.mean(inside))


@pytest.mark.slow
def test_intervals_hold_the_truth_and_those_of_the_textbook_do_not():
    """Noise that forgets itself in 30 ms, at rows of 20 ms: what the textbook takes for independent is not."""
    arm = tw.robots.planar_2r()
    logs = [known_log(arm, s, seconds=15.0) for s in range(12)]
    # With a log of its own to predict, settings are not chosen anew for each fifth.
    runs = [(identify(arm, log.motion, test=log.motion[:500], cutoff=20.0), log) for log in logs]
    truths = [log.truth(found) for found, log in runs]
    inside = [(f.interval()[:, 0] <= x) & (x <= f.interval()[:, 1]) for (f, _), x in zip(runs, truths, strict=True)]
    assert np.mean(inside) >= 0.85  # of 156 intervals, of which those of a log hang together
    spread = np.sqrt(np.mean([(f.values - x) ** 2 for (f, _), x in zip(runs, truths, strict=True)], axis=0))
    ours = np.median([found.standard_deviations for found, _ in runs], axis=0)
    textbook = np.median([found.covariance.textbook for found, _ in runs], axis=0)
    assert 0.7 < np.median(spread / ours) < 1.5 < np.median(spread / textbook)


GEARED = """<robot name="geared"><link name="base"/>{parts}</robot>"""
LINK = """<link name="link{k}"><inertial><origin xyz="0.2 0 0.05"/><mass value="{mass}"/>
  <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.04"/></inertial></link>
<joint name="joint{k}" type="{type}"><parent link="{parent}"/><child link="link{k}"/><origin xyz="0.4 0 0"/><axis xyz="{axis}"/>
  <limit lower="-3" upper="3" velocity="9" effort="99"/>{more}</joint>"""


def geared():
    """An arm whose second joint takes a third along, and a slide."""
    kinds = [
        ("0 0 1", "revolute", ""),
        ("0 1 0", "revolute", ""),
        ("0 1 0", "revolute", '<mimic joint="joint1" multiplier="-0.5" offset="0.2"/>'),
        ("1 0 0", "prismatic", ""),
    ]
    parts = [
        LINK.format(k=k, mass=4 - k, parent=f"link{k - 1}" if k else "base", axis=axis, type=kind, more=more)
        for k, (axis, kind, more) in enumerate(kinds)
    ]
    return tw.load(GEARED.format(parts="".join(parts)))


TEN = {
    "pendulum": tw.robots.pendulum,
    "planar_2r": tw.robots.planar_2r,
    "planar_3r": tw.robots.planar_3r,
    "cart_pole": tw.robots.cart_pole,
    "geared": geared,
    "sliding": lambda: random_robot(5, 4, kinds=("revolute", "prismatic")),
    "branched": lambda: random_robot(8, 5, kinds=("revolute",)),
    "ur5": tw.robots.ur5,
    "panda": tw.robots.panda,
    "quadruped": lambda: tw.robots.quadruped(floating_base=False),
}
"""Arms, slides, a mimic joint, a quadruped on a stand."""


@pytest.mark.slow
@pytest.mark.parametrize("name", TEN)
def test_intervals_hold_the_truth_in_nine_of_ten_logs(name):
    robot = TEN[name]()
    assert 0.90 <= _coverage(robot, 200 if robot.nv < 6 else 20, 20.0) <= 0.98


def test_friction_that_fades_with_speed_is_found_and_kept_in_the_actuator_file(tmp_path):
    """Half of Coulomb's friction more at rest, gone at 0.1 rad/s."""
    arm = tw.load(tw.robots.path_of("planar_2r"))
    log = known_log(arm, 4, seconds=30.0)
    dq, more = log.motion.dq, 0.5 * log.drives["coulomb"]
    tau = log.motion.tau + more * np.exp(-((dq / 0.1) ** 2)) * np.tanh(dq / 0.05)
    laws = ("viscous", "coulomb", "stribeck", "offset")
    found = identify(arm, log.changed(tau=tau), cutoff=20.0, friction_speed=0.05, shift=0.0, friction=laws)
    assert found.verdict.ok
    for joint, value in zip(arm.joint_names, more, strict=True):
        estimate, deviation = found.parameters[f"{joint}.stribeck"]
        assert abs(estimate - value) < 4 * deviation < value
    notes = found.write(tmp_path / "new.urdf", tmp_path / "new.yaml")
    again = tw.load(tmp_path / "new.urdf").with_actuators(tmp_path / "new.yaml").model.friction
    above = found.consistent.of_joints("stribeck")
    assert np.allclose(again.static - again.coulomb, list(above.values()), rtol=1e-12)
    assert (again.stribeck == 0.1).all() and any("static friction above Coulomb's" in note for note in notes)


# ── what is wrong with a log ──


def test_rows_that_repeat_others_are_noted(tmp_path):
    arm = tw.robots.planar_2r()
    path = known_log(arm, 2, seconds=8.0).motion.to_csv(tmp_path / "log.csv")
    first, *rows = path.read_text("utf-8").splitlines()
    path.write_text("\n".join([first, *(row for row in rows for _ in range(2))]), "utf-8")
    found = identify(arm, tw.Motion.from_file(path, arm), motor_inertia=False, **GIVEN)
    assert any("rows that repeat the row before" in note for note in found.notes)


def test_a_robot_at_rest_is_unexciting_and_no_cause_is_sought():
    """Encoders that are noisy by a microradian: no cause is sought in their noise, and nothing warns."""
    arm, t = tw.robots.planar_2r(), np.arange(0, 10, 0.01)
    rng = np.random.default_rng(0)
    q = 0.3 + 1e-6 * rng.normal(size=(len(t), 2))
    log = tw.Motion(t, q, tau=[3.0, 1.0] + 0.01 * rng.normal(size=q.shape), robot=arm)
    assert tw.identification.measured_causes(arm, log) == ()
    found = identify(arm, log)
    assert [(doubt.kind, doubt.refuses) for doubt in found.doubts] == [("unexciting", False)]
    assert str(found.verdict).startswith("UNSURE: the robot stood still")
    moving = tw.Motion(t, q, tau=np.sin(t[:, None]) + 0.01 * rng.normal(size=q.shape), robot=arm)
    dead = next(doubt for doubt in identify(arm, moving, **GIVEN).doubts if doubt.kind == "dead-position")
    assert dead.refuses and "all joints" in dead.sentence


@pytest.mark.parametrize("noise", [1e-14, pytest.param(1e-6, marks=pytest.mark.slow)])
def test_torques_that_fit_exactly_at_rest_are_no_fault(noise):
    arm = tw.robots.ur5()
    t = np.arange(0, 1.5, 0.01)
    q = np.tile(np.linspace(0.3, -0.6, 6), (len(t), 1))
    tau = arm.gravity_forces(q) + noise * np.random.default_rng(1).standard_normal(q.shape)
    found = identify(arm, tw.Motion(t, q, tau=tau, robot=arm), **GIVEN)
    assert [doubt.kind for doubt in found.doubts] == ["unexciting"]


@pytest.mark.parametrize("joint", mostly_slow([0, 3], 2))
def test_a_torque_of_the_wrong_sign(joint):
    tau = LOG.motion.tau.copy()
    tau[:, joint] *= -1
    found = identify(ARM, LOG.changed(tau=tau), **GIVEN)
    signs = [doubt for doubt in found.doubts if doubt.kind == "torque-sign" and doubt.refuses]
    assert [doubt.joints for doubt in signs] == [(ARM.joint_names[joint],)]
    assert found.verdict.word == "LOOK AGAIN"


def test_a_torque_in_another_unit():
    tau = LOG.motion.tau.copy()
    tau[:, 2] *= 50
    found = identify(ARM, LOG.changed(tau=tau), **GIVEN)
    gain = next(doubt for doubt in found.doubts if doubt.kind == "gain")
    assert gain.refuses and gain.joints == (ARM.joint_names[2],) and abs(gain.value / 50.0 - 1.0) < 0.05
    assert gain.interval[0] < 50.0 < gain.interval[1]


def test_exchanged_torque_columns():
    tau = LOG.motion.tau.copy()
    tau[:, [1, 3]] = tau[:, [3, 1]]
    found = identify(ARM, LOG.changed(tau=tau), **GIVEN)
    exchanged = next(doubt for doubt in found.doubts if doubt.kind == "exchanged-torques")
    assert exchanged.refuses and set(exchanged.joints) == {ARM.joint_names[1], ARM.joint_names[3]}


@pytest.mark.parametrize("rows", mostly_slow([2, 10, 14], 3))
def test_late_torques(rows):
    """10, 50 and 70 ms at 200 Hz; found, taken off, and said."""
    found = identify(ARM, LOG.changed(tau=np.roll(LOG.motion.tau, rows, axis=0), rows=slice(20, None)), **CLOCK_SOUGHT)
    assert abs(found.settings.shift - 0.005 * rows) < 0.002
    assert kinds(found) == {"late"} and found.held_out.all < 0.03
    assert "ms after the positions of their rows" in str(found.doubts[0])


def test_a_delay_that_the_caller_leaves_in_is_not_said_to_be_taken_off():
    late = LOG.changed(tau=np.roll(LOG.motion.tau, 10, axis=0), rows=slice(20, None))
    found = identify(ARM, late, **GIVEN)
    (doubt,) = [doubt for doubt in found.doubts if doubt.kind == "late"]
    assert doubt.refuses and abs(doubt.value - 50.0) < 2.0 and found.settings.shift == 0.0
    assert "The fit has 0.000 s in its place: give shift=0.0" in doubt.sentence


def test_saturated_torques():
    """Two joints are cut off below and one above; another does not come as far as its limit."""
    size, below = 0.6 * np.abs(LOG.motion.tau).max(axis=0), np.array([True, False, True, False])
    least, most = np.where(below, -size, -np.inf), np.where(below, np.inf, size)
    cut = ((LOG.motion.tau < least) | (LOG.motion.tau > most)).any(axis=0)
    assert cut.tolist() == [True, False, True, True]
    found = identify(ARM, LOG.changed(tau=np.clip(LOG.motion.tau, least, most)), **GIVEN)
    saturated = {joint for doubt in found.doubts if doubt.kind == "saturated" for joint in doubt.joints}
    assert saturated == {name for name, is_cut in zip(ARM.joint_names, cut, strict=True) if is_cut}


@pytest.mark.slow
def test_coarse_positions():
    assert "quantised" not in kinds(identify(ARM, LOG.changed(q=LOG.motion.q.round(4)), **GIVEN))
    assert "quantised" in kinds(identify(ARM, LOG.changed(q=LOG.motion.q.round(2)), **GIVEN))


def test_degrees_in_place_of_radians():
    m = LOG.motion
    found = identify(ARM, tw.Motion(m.time, np.degrees(m.q), tau=m.tau, robot=ARM, in_seconds=True), **GIVEN)
    assert "angle-unit" in kinds(found, refusing=True)


def test_a_motion_too_short_to_tell():
    assert "unexciting" in kinds(identify(ARM, LOG.changed(rows=slice(0, 250)), **GIVEN))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["planar_2r", "planar_3r", "geared", "sliding"])
def test_too_short_a_log_is_not_called_late(name):
    """1.6 s, whose clock's offset is a guess: other motions would be predicted to a tenth and worse, which is the reason told."""
    log = known_log(TEN[name](), 11, seconds=15.0)
    short = identify(log.motion.robot, log.changed(rows=slice(0, 320)))
    assert "unexciting" in kinds(short) and "late" not in kinds(short)
    assert identify(log.motion.robot, log.motion).doubts == ()


def test_a_dead_torque_channel():
    tau = LOG.motion.tau.copy()
    tau[:, 3] = 0.1
    found = identify(ARM, LOG.changed(tau=tau), **GIVEN)
    dead = next(doubt for doubt in found.doubts if doubt.kind == "dead-torque")
    assert dead.joints == (ARM.joint_names[3],) and np.isfinite(found.values).all()


def test_torques_of_something_else():
    tau = coloured(len(LOG.motion), ARM.nv, 200.0, np.random.default_rng(5), memory=0.3)
    found = identify(ARM, LOG.changed(tau=tau), **GIVEN)
    assert "unexplained" in kinds(found, refusing=True) and not found.verdict.ok


def test_a_hand_that_the_file_has_and_the_log_lacks():
    """The file's robot carries a kilogram at its flange, on a fixed link; the robot of the log does not."""
    held = {"wrist_1_joint": 0.2, "wrist_2_joint": 0.3, "wrist_3_joint": 0.0}
    text = tw.robots.path_of("ur5").read_text()
    hand = (
        '<link name="hand"><inertial><origin xyz="0 0 0.08"/><mass value="1.5"/><inertia ixx="0.002" ixy="0" ixz="0" iyy="0.002" '
        'iyz="0" izz="0.001"/></inertial></link><joint name="mount" type="fixed"><parent link="wrist_3_link"/><child '
        'link="hand"/></joint></robot>'
    )
    whole = tw.load(text.replace("</robot>", hand)).lock(held)
    log = known_log(tw.robots.ur5().lock(held), 3, of=whole)
    found = identify(whole, log.motion, **GIVEN)
    missing = next(doubt for doubt in found.doubts if doubt.kind == "missing-link")
    assert "without hand" in missing.sentence
    again = identify(without_links(whole, ["hand"]), log.changed(of=without_links(whole, ["hand"])), **GIVEN)
    assert again.verdict.ok


@pytest.mark.parametrize("motor_inertia", [0.0, 0.5])
def test_a_motor_inertia_hides_no_hand_that_the_log_lacks(motor_inertia):
    """The motor of the first joint is in a group of its link; without the hand of 0.6 kg, only the noise of 0.3 % is left."""
    arm = short_arm()
    bare = without_links(arm, ["grip"]).with_armature({"waist": motor_inertia})
    log = known_log(bare, 1, noise=0.003, of=arm)
    missing = next(doubt for doubt in identify(arm, log.motion, **GIVEN).doubts if doubt.kind == "missing-link")
    left = re.search(r"without grip.* explains the torques to ([0-9.]+) % in place of", missing.sentence)
    assert left and float(left[1]) < 0.4, missing


def test_logs_that_do_not_belong_together():
    """A test log of a robot that carries something is announced."""
    arm = tw.robots.planar_3r()
    loaded = arm.with_payload(SpatialInertia.from_com(0.4))
    found = identify(arm, known_log(arm, 1).motion, test=known_log(loaded, 2, of=arm).motion, **GIVEN)
    assert {"other-torques"} <= kinds(found, refusing=True)


# ── what is not a log ──


def test_bad_input_is_one_clear_error():
    arm = tw.robots.planar_2r()
    log = known_log(arm, 0)
    with pytest.raises(tw.ShapeError, match="no torques"):
        identify(arm, tw.Motion(log.motion.time, log.motion.q, robot=arm))
    with pytest.raises(tw.TrajectoryError, match="not those of"):
        identify(tw.robots.ur5(), log.motion)
    with pytest.raises(tw.TrajectoryError, match="too few"):
        identify(arm, log.motion[:40])
    with pytest.raises(tw.TrajectoryError, match="constant throughout"):
        identify(arm, log.changed(tau=np.zeros_like(log.motion.tau)))
    with pytest.raises(tw.ShapeError, match=r"tw\.Motion"):
        identify(arm, [1.0])
    with pytest.raises(tw.UnknownNameError, match="friction column"):
        identify(arm, log.motion, friction=("sticky",))
    with pytest.raises(tw.ValueRangeError, match="above 0"):
        identify(arm, log.motion, cutoff=-1.0)


# ── Faults of columns, two at once, and inertias that cannot be


def columns_changed(log, change):
    """The log with positions and torques changed, whose rates are those of the changed positions."""
    q, tau = log.motion.q.copy(), log.motion.tau.copy()
    change(q, tau)
    return tw.Motion(log.motion.time, q, tau=tau, robot=log.motion.robot, in_seconds=True)


def test_a_scaled_position_is_named_with_its_factor():
    def change(q, _tau):
        q[:, 1] *= 1.1

    found = identify(tw.robots.planar_3r(), columns_changed(known_log(tw.robots.planar_3r(), 3), change), **GIVEN)
    (scale,) = (doubt for doubt in found.doubts if doubt.kind == "position-scale")
    assert found.verdict.word == "LOOK AGAIN" and scale.joints == ("joint2",)
    assert scale.value == pytest.approx(1.1, abs=0.01)
    assumed = identify(
        tw.robots.planar_3r(),
        columns_changed(known_log(tw.robots.planar_3r(), 3), change),
        assume="position-scale:joint2",
        **GIVEN,
    )
    assert assumed.verdict.ok


def test_values_of_two_causes_are_estimated_at_once():
    """Each interval holds its truth, which the value estimated while the other is in the log does not."""

    def change(q, _tau):
        q[:, 0] += np.radians(6.0)
        q[:, 1] -= np.radians(5.0)

    found = identify(tw.robots.planar_3r(), columns_changed(known_log(tw.robots.planar_3r(), 3), change), **GIVEN)
    zeros = {doubt.joints: doubt for doubt in found.doubts if doubt.kind == "zero"}
    assert set(zeros) == {("joint1",), ("joint2",)}
    for joint, truth in (("joint1", 6.0), ("joint2", -5.0)):
        low, high = zeros[joint,].interval
        assert low <= truth <= high and high - low < 2.0


def test_an_inertia_that_cannot_be_makes_the_verdict_unsure(tmp_path):
    """Negative in a group with links, so that no parameter of its own says so; a file that can exist is still written."""
    log = known_log(tw.robots.planar_2r(), 1)
    inertia = 3.0 * np.asarray(log.robot.mass_matrix(np.zeros(2)))[0, 0]
    tau = log.motion.tau - inertia * log.motion.ddq * [1.0, 0.0]
    found = identify(log.robot, log.changed(tau=tau), **GIVEN)
    assert found.verdict.word == "UNSURE" and kinds(found) == {"negative-inertia"}
    assert "kinetic energy of -" in found.doubts[0].sentence
    found.write(tmp_path / "arm.urdf", tmp_path / "drives.yaml")
    assert not any(body.inertia.defects() for body in tw.load(tmp_path / "arm.urdf").model.bodies)


def test_held_out_is_printed_as_a_table():
    found = identify(tw.robots.planar_2r(), known_log(tw.robots.planar_2r(), 1).motion, **GIVEN)
    lines = str(found.held_out).splitlines()
    assert [line.split()[0] for line in lines] == ["joint1", "joint2", "all"]
    assert float(lines[-1].split()[1]) == pytest.approx(100 * found.held_out.all, rel=0.01)
