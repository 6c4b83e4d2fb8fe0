"""Calibration of arms whose geometry differs from their file: ranks, derivatives, errors, outliers, written files."""

from __future__ import annotations

import functools
import json
import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from calibration_faults import lost_zero
from calibration_worlds import BALL, NOISE, World, gantry, planar, rail, scara
from click.testing import CliRunner
from scipy.spatial.transform import Rotation

import twistwrench as tw
from twistwrench.calibration import instrument
from twistwrench.calibration.chain import TipChain
from twistwrench.calibration.fit import CalibrationProblem
from twistwrench.calibration.groups import ParameterGroup, ParameterGroups, Remaining, fitted_in_groups
from twistwrench.calibration.measurements import rotations_from_roll
from twistwrench.calibration.readings_otherwise import _alternatives
from twistwrench.calibration.result import CalibratedRobot
from twistwrench.calibration.result_view import _group_figures
from twistwrench.calibration.targets import rigid_motion
from twistwrench.cli.main import main
from twistwrench.core.errors import TwistWrenchError

ARMS = {f"{n}R": (lambda n=n: planar(n)) for n in range(2, 8)} | {"scara": scara, "rail": rail, "gantry": gantry}
ARMS |= {"ur5": tw.robots.ur5, "panda": tw.robots.panda}
ARMS = {name: functools.cache(make) for name, make in ARMS.items()}
DIFFERENT_ARMS = {"2R", "6R", "rail", "gantry", "panda"}
"""Fewer joints than directions, as many and more; joints that slide beside others, and alone."""
LACKING = {"pose": 0, "position": 3, "distance": 6, "pair": 9}
"""Number of groups that a kind does not see, of 4 R + 2 P + 6."""


def tip_of(robot):
    return None if robot.tip else "panda_link8"


@functools.cache
def calibrated_demo():
    """Calibration with the bundled readings."""
    return tw.calibration.calibrate("ur5", "demo")


@pytest.mark.parametrize("kind", LACKING)
@pytest.mark.parametrize("name", [n if n in DIFFERENT_ARMS else pytest.param(n, marks=pytest.mark.slow) for n in ARMS])
def test_the_rank_is_that_of_theory(name, kind):
    """4 R + 2 P + 6 with poses, fewer by 3, 6 and 9 with positions, distances and pairs."""
    robot = ARMS[name]()
    world = World.drawn(robot, 0, tip=tip_of(robot))
    turning = sum(world.chain.turning)
    fit = CalibrationProblem(world.chain, (world.measured(kind, 120),)).solve()
    groups = ParameterGroups(fit)
    assert groups.rank == groups.theory == 4 * turning + 2 * (len(world.chain.turning) - turning) + 6 - LACKING[kind]


@pytest.mark.parametrize("kind", ["pose", "position", "distance", "pair", "point", "plane", "sphere"])
@pytest.mark.parametrize("make", [pytest.param(tw.robots.ur5, marks=pytest.mark.slow), rail])
def test_derivatives_are_differences_of_residuals(make, kind):
    """Central differences of 1e-6 about a corrected geometry: rounding and curvature are below 1e-7."""
    world = World.drawn(make(), 1, assume=("sag", "gears"))
    problem = CalibrationProblem(world.chain, (world.measured(kind, 6),))
    x = np.random.default_rng(0).normal(size=200)
    state = problem.start()
    design = problem.equations(state).design[0]
    count = design.shape[2]
    state = problem.step(state, 1e-3 * x[:count])
    design = problem.equations(state).design[0]
    for k in range(count):
        step = 1e-6 * np.eye(count)[k]
        ahead, behind = (problem.equations(problem.step(state, s)).residuals[0] for s in (step, -step))
        assert np.allclose((ahead - behind) / 2e-6, design[..., k], atol=2e-7 * max(1, np.abs(design[..., k]).max()))


@pytest.mark.parametrize(
    ("kind", "count", "bound"), [("position", 30, 0.09e-3), ("pose", 30, 0.08e-3), ("pair", 120, 0.09e-3)]
)
def test_the_tip_is_right_after_and_the_prediction_too(kind, count, bound):
    """The predicted error is within a factor of two of the true one, over all configurations; held-out poses agree."""
    world = World.drawn(tw.robots.ur5(), 3)
    found = tw.calibration.calibrate(world.robot, world.measured(kind, count))
    error = world.error(found)
    assert error < bound < 1e-3 < found.before
    assert 0.5 < found.remaining.rms / error < 2.0
    assert found.verdict.ok and found.held_out.rms < 4 * NOISE


def test_zeros_of_known_joints_come_out():
    """A zero that is off by 1.3° is found within its interval, and named first."""
    robot = tw.robots.ur5()
    world = World.drawn(robot, 4, size=(1e-5, 1e-5))
    m = world.measured("position", 40)
    q = m.q - np.radians(1.3) * np.eye(6)[2]
    found = tw.calibration.calibrate(robot, tw.calibration.Measurements(q, positions=m.positions))
    value, half = found.zeros["elbow_joint"]
    assert abs(value - np.radians(1.3)) < half + 2e-4 and "zero of elbow_joint off by 1.29" in found.headline


@pytest.mark.parametrize("kind", ["position", pytest.param("pose", marks=pytest.mark.slow)])
@pytest.mark.parametrize("degrees", [5.0, pytest.param(8.0, marks=pytest.mark.slow), -9.71])
def test_a_large_offset_of_a_zero_is_inside_its_interval(kind, degrees):
    """The elbow is parallel to its neighbours, whose turns and shifts have the same effect on all readings."""
    robot = tw.robots.ur5()
    m = World.drawn(robot, 4, size=(1e-6, 1e-6)).measured(kind, 40)
    found = tw.calibration.calibrate(robot, replace(m, q=m.q - np.radians(degrees) * np.eye(6)[2]))
    value, half = found.zeros["elbow_joint"]
    assert abs(value - np.radians(degrees)) < 1.5 * half < np.radians(0.1) and found.verdict.ok
    others = [abs(value) for joint, (value, _) in found.zeros.items() if joint != "elbow_joint"]
    assert max(others) < np.radians(0.1) and found.robot.model.frames["tool0"].pose.shape == (4, 4)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "tip"), [("6R", None), ("ur5", None), ("panda", "panda_link8")])
@pytest.mark.parametrize(("joint", "degrees"), [(1, 45.0), (2, -30.0), (3, 20.0)])
def test_a_lost_zero_is_inside_its_interval_beside_other_errors(name, tip, joint, degrees):
    """Also where axes are beside the origins of their frames: a turn about the axis is one parameter, however large."""
    world = World.drawn(ARMS[name](), 313, tip=tip)
    other, m = lost_zero(world, world.measured("position", 40), joint, degrees)
    groups = ParameterGroups(fitted_in_groups(CalibrationProblem(world.chain, (m,)).solve())).all
    true = dict(zip(world.chain.parameters, world.chain.values(other.truth), strict=True))
    (group,) = (group for group in groups if group.name == f"{world.chain.joints[joint]}.zero")
    value = sum(factor * true.get(parameter, 0.0) for parameter, factor in group.terms.items())
    assert abs(group.value - value) < 1.5 * group.half_width() < np.radians(0.02) and abs(value) > np.radians(19.0)


def test_how_the_target_is_mounted_is_not_a_zero_of_the_last_joint():
    """Poses of a target turned by 100° about the last axis: the zero that is off by 1.3° is named, at the same value."""
    robot = tw.robots.ur5()
    for turn in (0.0, np.radians(100.0)):
        ball = tw.se3.pose(tw.so3.exp([0, 0, turn]), [0.05, 0.03, 0.02])
        m = World.drawn(robot, 4, size=(1e-5, 1e-5), ball=ball).measured("pose", 40)
        q = m.q - np.radians(1.3) * np.eye(6)[2]
        found = tw.calibration.calibrate(robot, tw.calibration.Measurements(q, poses=m.poses))
        assert (
            "zero of elbow_joint off by 1.29" in found.headline or "zero of elbow_joint off by 1.30" in found.headline
        )
        assert "wrist_3_joint" not in found.zeros and len(found.zeros) == 4


@pytest.mark.parametrize("turn", [(np.pi, 0, 0), (0, 2.5, 0), (2.0, 1.0, -1.5)])
def test_however_a_target_is_turned_the_error_before_is_the_same(turn):
    """Boards are mounted in any orientation: it is estimated, and no part of the file's error."""
    robot, errors = tw.robots.ur5(), []
    for w in ((0, 0, 0), turn):
        world = World.drawn(robot, 4, ball=tw.se3.pose(tw.so3.exp(w), BALL[:3, 3]))
        plain = CalibrationProblem(world.chain, (world.measured("pose", 40),)).solve(frames_only=True)
        errors.append(plain.rms)
    assert 0.9 < errors[1] / errors[0] < 1.1 and errors[0] < 10e-3


def test_joints_without_load_do_not_sag():
    """A vertical first joint and a last one without an offset have no torque of gravity: the rank is that of theory without them."""
    robot = tw.robots.ur5()
    world = World.drawn(robot, 11, assume=("sag",), sags=[0, 2e-4, 3e-4, 0, 0, 0])
    found = tw.calibration.calibrate(robot, world.measured("position", 60), assume="sag")
    assert world.chain.loaded_joints == ["shoulder_lift_joint", "elbow_joint", "wrist_1_joint"]
    assert (
        found.rank == found.theory == 27 + 3 and set(found.sag) == set(world.chain.loaded_joints) and found.verdict.ok
    )


def test_outliers_are_named_with_their_size():
    """Four of forty readings off by 5 mm a coordinate: all are named, no other, and the tip is as right as without."""
    world = World.drawn(tw.robots.ur5(), 5)
    m = world.measured("position", 40)
    m.positions[[3, 11, 25, 30]] += 5e-3
    found = tw.calibration.calibrate(world.robot, m)
    assert sorted(row for row, _ in found.outliers) == [3, 11, 25, 30]
    assert all(abs(size - 8.66e-3) < 0.3e-3 for _, size in found.outliers) and world.error(found) < 0.09e-3
    assert found.doubts[0].kind == "calibration-outlier" and found.verdict.word == "UNSURE"  # 10 % are too many


@pytest.mark.parametrize("kind", ["plane", "point", "sphere"])
def test_touches_without_a_length_are_never_ok(kind):
    """Their residual is as small as noise, and the tip is wrong by millimetres: the prediction knows."""
    world = World.drawn(tw.robots.ur5(), 6)
    found = tw.calibration.calibrate(world.robot, world.touched(kind, 60))
    assert found.verdict.word == "UNSURE" and "contains no length" in found.headline
    assert found.fit.rms < 3 * NOISE and 0.3 < found.remaining.rms / world.error(found) < 3


@pytest.mark.parametrize(("kind", "targets", "length"), [("point", 2, 0.1), ("sphere", 1, 0.8)])
def test_one_known_length_makes_touches_ok(kind, targets, length):
    """Distance of two points, diameter of a sphere: what remains falls to a fifth, and the prediction stays right."""
    world = World.drawn(tw.robots.ur5(), 5)
    touched = world.touched(kind, 90, targets=targets)
    without, found = (tw.calibration.calibrate(world.robot, touched, length=given) for given in (None, length))
    assert found.verdict.ok and found.rank == without.rank + 1
    assert found.remaining.rms < 0.2 * without.remaining.rms and 0.4 < found.remaining.rms / world.error(found) < 2.5


@pytest.mark.slow
@pytest.mark.parametrize(
    ("make", "kind", "count"), [(tw.robots.ur5, "position", 30), (scara, "pose", 24), (rail, "position", 24)]
)
def test_intervals_cover_the_truth_in_95_of_100(make, kind, count):
    """Intervals of all groups in 66 worlds: more than 900 intervals, whose coverage has a deviation below 1 %."""
    robot, inside = make(), []
    for seed in range(66):
        world = World.drawn(robot, 1000 + seed)
        fit = fitted_in_groups(CalibrationProblem(world.chain, (world.measured(kind, count),)).solve())
        true = dict(zip(world.chain.parameters, world.chain.values(world.truth), strict=True))
        for group in ParameterGroups(fit).all:
            value = sum(factor * true.get(name, 0.0) for name, factor in group.terms.items())
            inside.append(abs(group.value - value) <= group.half_width())
    assert 0.93 <= np.mean(inside) <= 0.98


def test_few_readings_are_unsure():
    world = World.drawn(tw.robots.ur5(), 7)
    found = tw.calibration.calibrate(world.robot, world.measured("position", 12))
    assert "calibration-few" in [doubt.kind for doubt in found.doubts] and not found.verdict.ok


def test_a_ball_on_the_last_axis_has_two_groups_fewer():
    world = World.drawn(tw.robots.ur5(), 8, size=(3e-4, 3e-4), ball=tw.se3.pose(np.eye(3), [0, 0, 0.1]))
    found = tw.calibration.calibrate(world.robot, world.measured("position", 60, noise=1e-5))
    assert found.rank == found.theory - 2 and "on the axis of wrist_3_joint" in found.headline


@pytest.mark.parametrize("kind", ["position", "pose", "distance"])
def test_a_right_file_needs_nothing(kind):
    """Sixty readings in all of the reach: the error that the first line gives is above that of the file, which is zero."""
    world = World.drawn(tw.robots.ur5(), 9, size=(1e-9, 1e-9))
    found = tw.calibration.calibrate(world.robot, world.measured(kind, 60))
    assert found.verdict.ok and "already right" in found.headline and found.remaining_before < 0.4e-3


@pytest.mark.parametrize(("kind", "doubt"), [("position", "unseen"), ("pose", "little")])
@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2))])
def test_poses_near_one_another_do_not_make_a_file_right(kind, doubt, seed):
    """Poses within 0.3 rad of one: the file is off by millimetres elsewhere, and the answer is not that it is right."""
    world = World.drawn(tw.robots.ur5(), 40 + seed)
    q = world.configurations(1) + world.rng.uniform(-0.3, 0.3, (40, 6))
    found = tw.calibration.calibrate(world.robot, world.readings(kind, q))
    assert found.verdict.word == "UNSURE" and not found.needs_nothing
    assert found.doubts[0].kind == f"calibration-{doubt}" and found.remaining_before > 2e-3


@pytest.mark.parametrize(
    ("rms", "by_noise", "by_file", "noise", "unseen"),
    [
        (1e-3, 0.33e-3, 0.02, 1e-3, True),  # 3 times its part by noise, so other poses would show more
        (1e-3, 0.34e-3, 0.02, 1e-3, False),
        (1e-3, 1e-3, 9e-3, 0.4e-3, True),  # above a tenth of the file's error, and twice the noise of a reading
        (1e-3, 1e-3, 9e-3, 0.6e-3, False),  # noisy readings of an accurate file
        (1e-3, 1e-3, 11e-3, 0.4e-3, False),  # a poor file, of which a tenth is left
        (1.1e-6, 0.0, 1e-3, 1e-3, True),
        (0.9e-6, 0.0, 1e-3, 1e-3, False),  # below a micrometre nothing is left to see
    ],
)
def test_an_error_is_unseen_beside_its_noise_or_beside_both_the_file_and_a_reading(
    rms, by_noise, by_file, noise, unseen
):
    remaining = Remaining(SimpleNamespace(noise=noise), np.zeros((1, 6)), (1e-3, 1e-3))
    vars(remaining).update(rms=rms, by_noise=by_noise, by_file=by_file)  # what the fit would give
    assert remaining.is_unseen == unseen


def test_distances_are_not_called_places_of_the_tip():
    """Ball bar and pairs: the first line gives the tip's predicted error, near the true one, and that of distances as such."""
    world = World.drawn(tw.robots.ur5(), 3)
    found = tw.calibration.calibrate(world.robot, world.measured("distance", 60))
    assert found.verdict.ok and "(rms, predicted)" in found.headline and "; distances to" in found.headline
    assert 0.4 < found.remaining.rms / world.error(found) < 2.5
    nominal = replace(found, fit=replace(found.fit, state=found.plain.state))
    assert 0.7 < found.remaining_before / world.error(nominal) < 1.5
    assert list(found.tables)[:2] == ["Error of the distances", "Error of the tip"]
    assert {"held out of distances", "before of distances", "remaining"} <= set(found.facts())


@pytest.mark.parametrize(
    ("offset", "seed"), [(2e-3, 3), *(pytest.param(*one, marks=pytest.mark.slow) for one in ((-2e-3, 3), (3e-3, 5)))]
)
def test_an_offset_of_all_distances_is_named_with_its_value(offset, seed):
    """A ball bar or a string whose zero is off by 2 mm: the fit takes most of it up."""
    world = World.drawn(tw.robots.ur5(), seed)
    m = world.measured("distance", 90)
    found = tw.calibration.calibrate(world.robot, replace(m, distances=m.distances + offset))
    assert [one.kind for one in found.doubts] == ["calibration-offset"] and found.verdict.word == "UNSURE"
    low, high = found.doubts[0].interval
    assert low < offset < high and ("too long" in found.headline) == (offset > 0)


def test_an_offset_with_the_effect_of_a_length_is_said_to_be_unseen():
    """A bar of one length scales the arm, whatever its length: no reading shows whether that is right."""
    world = World.drawn(tw.robots.ur5(), 5)
    touched = world.touched("sphere", 60)
    m = tw.calibration.Measurements(touched.q, distances=np.full(60, 0.4))
    found = tw.calibration.calibrate(world.robot, m)
    assert "calibration-offset-unseen" in [one.kind for one in found.doubts] and "no reading shows it" in " ".join(
        str(found).split()
    )


@pytest.mark.parametrize("kind", ["position", pytest.param("pose", marks=pytest.mark.slow)])
def test_a_target_that_slips_is_named_with_its_row(kind):
    """The ball moves by 3 mm on the tip at row 23; or the tracker moves by 3 mm and 2 mrad: the row, and which of them."""
    world = World.drawn(tw.robots.ur5(), 17)
    m = world.measured(kind, 40)
    slipped = replace(world, truth=replace(world.truth, tip=world.truth.tip @ tw.se3.exp([0, 0, 0, 2e-3, -1e-3, 2e-3])))
    late = slipped.readings(kind, m.q)
    tracker = tw.se3.exp([0, 2e-3, 0, 1e-3, -2e-3, 2e-3])
    for name, poses in (("slipped", late.poses), ("moved", None if m.poses is None else tracker @ m.poses)):
        points = late.points if name == "slipped" else m.points @ tracker[:3, :3].T + tracker[:3, 3]
        if kind == "pose":
            both = replace(m, poses=np.concatenate([m.poses[:23], poses[23:]]))
        else:
            both = replace(m, positions=np.concatenate([m.positions[:23], points[23:]]))
        found = tw.calibration.calibrate(world.robot, both)
        assert found.doubts[0].kind == f"calibration-{name}" and "before row 23" in found.headline
        assert abs(found.doubts[0].value - 3e-3) < 2.5e-3 and found.verdict.word == "LOOK AGAIN"


def test_readings_written_a_row_after_their_configuration_are_late_and_those_a_row_before_early():
    """What is called so puts each reading back beside the configuration that it was taken at."""
    m = tw.calibration.Measurements(np.arange(6.0)[:, None], positions=np.random.default_rng(0).normal(size=(6, 3)))
    problem = SimpleNamespace(chain=SimpleNamespace(joints=("slide",), columns=(0,), turning=(False,)), measured=(m,))
    written = {
        "late": replace(m.taken(np.arange(1, 6)), positions=m.positions[:-1]),
        "early": replace(m.taken(np.arange(5)), positions=m.positions[1:]),
    }
    for alternative in _alternatives(problem):
        if alternative.kind == "row-shift":
            read = alternative.change(written.pop(alternative.words))
            rows = [m.q.tolist().index(q) for q in read.q.tolist()]
            np.testing.assert_array_equal(read.positions, m.positions[rows])
            assert len(rows) == 4 and alternative.value == {"late": 1.0, "early": -1.0}[alternative.words]
    assert not written


def test_joints_that_sag_are_found():
    """Compliances of a few tenths of a mrad/(N m), as of small arms, with the sign of gravity."""
    sags = np.array([0, 3e-4, 2e-4, 1e-4, 0, 0])
    world = World.drawn(tw.robots.ur5(), 10, assume=["sag"], sags=sags)
    m = world.measured("position", 60)
    plain, found = (tw.calibration.calibrate(world.robot, m, assume=assume) for assume in ((), "sag"))
    assert found.held_out.rms < 4 * NOISE < plain.held_out.rms
    value, half = found.sag["shoulder_lift_joint"]
    assert abs(value - 3e-4) < 2 * half < 1e-4


# ── Files


def test_a_displacement_that_no_file_can_have_is_stated():
    """The frame of a link is that of its joint: the robot is right with .tip_pose, and without it off by the displacement."""
    robot = tw.robots.ur5()
    world = World.drawn(robot, 11, tip="wrist_3_link")
    found = tw.calibration.calibrate(robot, world.measured("pose", 60), tip="wrist_3_link")
    assert "The target is at (50, 30.7, 20) mm in wrist_3_link." in " ".join(str(found).split())
    q = robot.random_configuration(3, (100,))
    points = found.robot.forward_kinematics(q, frame="wrist_3_link") @ found.tip_pose
    places = world.poses(q)[:, :3, 3]
    moved = (rigid_motion(points[:, :3, 3], places) @ points)[:, :3, 3]
    assert np.abs(moved - places).max() < 2e-4  # four deviations of a reading
    assert calibrated_demo().fit.problem.chain.frame == "tool0" and calibrated_demo().tip_note == ""


def test_the_written_file_has_the_calibrated_poses(tmp_path):
    """Another program reads the same poses: Pinocchio, to 1e-9 m; only placements change."""
    pin = pytest.importorskip("pinocchio", exc_type=ImportError)
    found = calibrated_demo()
    path = found.write(tmp_path / "mine.urdf")
    model = pin.buildModelFromUrdf(str(path))
    data = model.createData()
    for q in found.robot.random_configuration(0, (20,)):
        pin.framesForwardKinematics(model, data, q)
        assert np.abs(data.oMf[model.getFrameId("tool0")].homogeneous - found.robot.forward_kinematics(q)).max() < 1e-9
    before, after = (set(p.read_text().split("\n")) for p in (Path(found.sources()["ROBOT"]), path))
    assert all("<origin" in line for line in before - after)


def test_a_written_mjcf_file_has_the_calibrated_poses(tmp_path):
    """MuJoCo reads the same poses, to 1e-9 m."""
    mujoco = pytest.importorskip("mujoco")
    text = """<mujoco model="arm"><compiler angle="degree"/><worldbody><body name="a" pos="0 0 0.3" euler="0 0 10">
      <joint name="j1" axis="0 0 1"/><geom size="0.1"/><body name="b" pos="0.3 0 0"><joint name="j2" axis="0 1 0"/><geom size="0.1"/>
      <body name="c" pos="0.3 0 0" euler="90 0 0"><joint name="j3" axis="0 1 0"/><geom size="0.1"/>
      <body name="tool" pos="0.1 0.05 0.02"/></body></body></body></worldbody></mujoco>"""
    source = tmp_path / "arm.xml"
    source.write_text(text)
    robot = tw.load(source)
    world = World.drawn(robot, 11, tip="tool", ball=np.eye(4))
    found = tw.calibration.calibrate(robot, world.measured("position", 40), tip="tool")
    path = found.write(tmp_path / "mine.xml")
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    for q in found.robot.random_configuration(0, (20,)):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        assert np.abs(data.body("tool").xpos - found.robot.forward_kinematics(q, frame="tool")[:3, 3]).max() < 1e-9


def test_results_are_plain_data(tmp_path):
    found = calibrated_demo()
    data = json.loads(found.to_json())
    assert data["verdict"] == "OK" and data["rank"] == found.rank == 27 and data["doubts"] == []
    assert data["held_out"]["rms"] == found.held_out.rms and len(data["groups"]) == 21
    low, high = data["groups"][3]["low"], data["groups"][3]["high"]
    assert low < data["groups"][3]["value"] < high
    rows = found.to_csv(tmp_path / "r.csv").read_text().strip().split("\n")
    assert len(rows) == 41


HEAD = "shoulder_pan_joint,shoulder_lift_joint,elbow_joint,wrist_1_joint,wrist_2_joint,wrist_3_joint"
ROW = "0.1,0.2,0.3,0.4,0.5,0.6"


@pytest.mark.parametrize(
    ("header", "row", "said"),
    [
        ("x,y", "1,2", "no reading in the columns"),
        ("x,y,z", "1,2,nan", "must be finite"),
        ("x,y,z,qw,qx,qy,qz", "1,2,3,0,0,0,0", "quaternion does not have the length 1"),
        ("x,y,z,r11,r12,r13,r21,r22,r23,r31,r32,r33", "1,2,3,1,0,0,0,1,0,0,0,1.1", "matrix is not a rotation"),
        ("target", "a", "needs the kind of touch"),
        ("x [kg],y,z", "1,2,3", "the unit 'kg'"),
        ("distance", "-1", "Distances are above 0"),
        ("x,y,z", "", "no readings below the header"),
        ("x,y,z", "1,2,3", "determine nothing"),
    ],
)
def test_bad_files_are_refused_in_one_line(tmp_path, header, row, said):
    path = tmp_path / "m.csv"
    path.write_text(f"{HEAD},{header}\n" + (f"{ROW},{row}\n" if row else ""))
    with pytest.raises(TwistWrenchError, match="(?s)" + said) as error:
        tw.calibration.calibrate("ur5", path)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("header", "row", "options", "said"),
    [
        ("x,y", "1,2", {"kind": "position"}, "needs the columns z"),
        ("x,y,z", "1,2,3", {"kind": "distance"}, "needs the columns distance"),
        ("distance", "0.5", {"kind": "pair"}, "needs the columns pair"),
        ("distance", "0.5", {"kind": "plane"}, "with a column 'distance'"),
        ("x,y,z,qw,qx,qy,qz,rx,ry,rz", "1,2,3,1,0,0,0,0,0,0", {}, "2 orientations"),
        ("x,x,y,z", "1,1,2,3", {}, "appears twice|2 columns 'x'"),
        ("distance,pair", "0.5,9", {}, "outside 0"),
        ("distance,pair", "0.5,7", {}, "a pair at one configuration"),
        ("target", "a", {"kind": "plane", "length": 0.5}, "distance of two planes"),
    ],
)
def test_columns_that_do_not_belong_to_the_kind_are_refused(tmp_path, header, row, options, said):
    path = tmp_path / "m.csv"
    path.write_text(f"{HEAD},{header}\n" + f"{ROW},{row}\n" * 8)
    with pytest.raises(TwistWrenchError, match=said) as error:
        tw.calibration.calibrate("ur5", path, **options)
    assert "\n" not in str(error.value)


def test_robots_that_cannot_be_calibrated_are_refused(tmp_path):
    """No single tip, a base that floats, a mimic joint on the way; each error names what to do."""
    joint = '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{0}_l"/><axis xyz="0 0 1"/>{2}<limit lower="-3" upper="3" effort="9" velocity="9"/></joint><link name="{0}_l"/>'
    mimic = '<mimic joint="a" multiplier="2"/>'
    for joints, said in (
        ((("a", "base", ""), ("b", "a_l", ""), ("c", "a_l", "")), "has no single tip"),
        ((("a", "base", ""), ("b", "a_l", mimic)), "is a mimic joint on the way"),
    ):
        text = "".join(joint.format(*one) for one in joints)
        robot = tw.load(f'<robot name="r"><link name="base"/>{text}</robot>', inertia="accept")
        q = np.random.default_rng(0).normal(size=(9, robot.nq))
        with pytest.raises(TwistWrenchError, match=said):
            tw.calibration.calibrate(robot, tw.calibration.Measurements(q, positions=np.ones((9, 3))))
    robot = tw.load(tw.robots.path_of("ur5"), floating_base=True)
    q = np.tile(robot.neutral, (9, 1))
    with pytest.raises(TwistWrenchError, match="load the robot with a fixed base"):
        tw.calibration.calibrate(robot, tw.calibration.Measurements(q, positions=np.ones((9, 3))))


def test_joints_outside_their_limits_in_all_rows_are_a_doubt():
    robot = tw.robots.ur5()
    world = World.drawn(robot, 12)
    q = world.configurations(40)
    q[:, 2] = robot.limits.upper[2] * 1.5 + 0.3 * q[:, 2]
    found = tw.calibration.calibrate(robot, world.readings("position", q))
    assert "calibration-limits" in [one.kind for one in found.doubts] and not found.verdict.ok


def test_one_row_outside_the_limits_is_no_doubt_of_the_joint():
    """A joint that passes its limit once is where it is; only one that is never inside them counts from another zero."""
    robot = tw.robots.ur5()
    world = World.drawn(robot, 12)
    q = world.configurations(40)
    q[7, 2] = robot.limits.upper[2] * 1.5
    found = tw.calibration.calibrate(robot, world.readings("position", q))
    assert "calibration-limits" not in [one.kind for one in found.doubts]


def test_a_given_noise_is_that_of_lengths_and_then_of_angles():
    """0.2 mm and 3 mrad are the deviations of the readings; a place of three coordinates is off by √3 times 0.2 mm.

    Thirty poses give 180 equations, of which each group takes one, and parameters that no reading tells take none.
    """
    world = World.drawn(tw.robots.ur5(), 4)
    found = tw.calibration.calibrate(world.robot, world.measured("pose", 30), noise=(2e-4, 3e-3), outliers="keep")
    np.testing.assert_allclose(found.fit.deviations, [(2e-4, 3e-3)], rtol=1e-9)
    assert found.fit.noise == pytest.approx(np.sqrt(3.0) * 2e-4, rel=1e-9)
    assert {group.freedom for group in found.parameter_groups.all} == {180.0 - found.rank}
    assert found.rank < len(found.fit.names)


def test_another_seed_draws_other_folds():
    """Each reading is predicted from other ones, so the error held out differs in some digit, and by a few per cent."""
    first, other = calibrated_demo().held_out.rms, tw.calibration.calibrate("ur5", "demo", seed=1).held_out.rms
    assert first != other and abs(first / other - 1.0) < 0.2


def test_a_foot_that_is_five_millimetres_higher_moves_the_tip_by_five_millimetres(tmp_path):
    """d_1 lies along the first axis: at every configuration the whole arm is shifted by it, and turned by nothing."""
    zeros = "[0, 0, 0, 0, 0, 0]"
    lists = f"delta_theta = {zeros}\ndelta_a = {zeros}\ndelta_d = [0.005, 0, 0, 0, 0, 0]\ndelta_alpha = {zeros}\n"
    (tmp_path / "calibration.conf").write_text(f"[mounting]\n{lists}")
    found = tw.calibration.FactoryCalibration.from_file(tw.robots.ur5(), tmp_path / "calibration.conf")
    assert found.displacement == pytest.approx(5e-3, abs=1e-9)


def test_missing_joints_and_wrong_options_are_refused(tmp_path):
    path = tmp_path / "m.csv"
    path.write_text("elbow_joint,x,y,z\n" + "0.1,1,2,3\n" * 5)
    with pytest.raises(TwistWrenchError, match="no column for"):
        tw.calibration.calibrate("ur5", path)
    m = tw.calibration.Measurements(np.zeros((4, 6)), positions=np.ones((4, 3)))
    for options, said in (
        ({"assume": "wear"}, "Known: sag, gears"),
        ({"length": 0.5}, "contain lengths already"),
        ({"outliers": "drop"}, "outliers"),
        ({"tip": "nose"}, "nose"),
    ):
        with pytest.raises(TwistWrenchError, match=said):
            tw.calibration.calibrate("ur5", m, **options)
    with pytest.raises(TwistWrenchError, match=r"robot 'ur5' has 6 coordinates"):
        tw.calibration.calibrate("ur5", tw.calibration.Measurements(np.zeros((4, 5)), positions=np.ones((4, 3))))


# ── Readings taken otherwise


def _faults(m):
    """Readings with a fault, by the doubt that has to name it."""
    q, n = m.q, m.q.shape[1]
    order = [0, 2, 1, *range(3, n)]
    ahead = m.taken(np.arange(1, len(m)))
    yield "unit", replace(m, positions=1e3 * m.positions)
    yield "degrees", replace(m, q=np.degrees(q))
    yield "exchanged", replace(m, q=q[:, order])
    yield "sign", replace(m, q=q * np.where(np.arange(n) == n - 1, -1, 1))
    yield "zero", replace(m, q=q + np.pi / 2 * np.eye(n)[2])
    yield "left-handed", replace(m, positions=m.positions * [1, -1, 1])
    yield "row-shift", replace(ahead, q=q[:-1])
    yield "scale", replace(m, positions=1.02 * m.positions)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ur5", "6R"])
def test_a_fault_of_the_readings_is_named_first(name):
    """Each fault by its name, as LOOK AGAIN; a scale of 2 % as UNSURE, since the file may be wrong instead."""
    world = World.drawn(ARMS[name](), 13)
    clean = world.measured("position", 40)
    assert not tw.calibration.calibrate(world.robot, clean).doubts
    for fault, m in _faults(clean):
        found = tw.calibration.calibrate(world.robot, m)
        assert found.doubts[0].kind == f"calibration-{fault}", fault
        assert found.verdict.word == ("UNSURE" if fault == "scale" else "LOOK AGAIN")


@pytest.mark.parametrize(("fault", "change"), [
    ("inverse", lambda m: tw.se3.inverse(m.poses)),
    ("quaternion-order", lambda m: tw.se3.pose(
        Rotation.from_quat(np.roll(Rotation.from_matrix(m.rotations).as_quat(), -1, 1)).as_matrix(), m.points)),
    ("angle-order", lambda m: tw.se3.pose(
        Rotation.from_euler("xyz", Rotation.from_matrix(m.rotations).as_euler("XYZ")).as_matrix(), m.points)),
])  # fmt: skip
def test_a_convention_of_poses_is_named(fault, change):
    world = World.drawn(ARMS["3R"](), 14)
    m = world.measured("pose", 20)
    found = tw.calibration.calibrate(world.robot, replace(m, poses=change(m)))
    assert found.doubts[0].kind == f"calibration-{fault}" and found.verdict.word == "LOOK AGAIN"
    with pytest.raises(TwistWrenchError, match="nothing is written"):
        found.write("nowhere.urdf")


def test_the_controllers_own_poses_are_no_measurement():
    """Readings that equal the file's kinematics are not measured."""
    robot = tw.robots.ur5()
    q = robot.random_configuration(0, (30,))
    m = tw.calibration.Measurements(q, poses=robot.forward_kinematics(q))
    assert "own kinematics" in tw.calibration.calibrate(robot, m).headline


def test_another_robots_readings_are_not_explained():
    world = World.drawn(planar(6), 15)
    found = tw.calibration.calibrate("ur5", world.measured("position", 40))
    assert found.doubts[0].kind == "calibration-wrong-robot"


def test_copied_rows_are_named():
    m = World.drawn(tw.robots.ur5(), 16).measured("position", 40)
    found = tw.calibration.calibrate("ur5", m.taken(np.r_[np.arange(40), 5]))
    assert "40 of 5" in found.headline


def test_the_command_is_the_function(tmp_path):
    """First line, tables and data of the command are those of the function; the file is written."""
    out, data = tmp_path / "mine.urdf", tmp_path / "found.json"
    done = CliRunner().invoke(
        main, ["calibrate", "ur5", "demo", "--out", str(out), "--json", str(data), "--plot", str(tmp_path / "p.svg")]
    )
    found = calibrated_demo()
    assert done.exit_code == 0 and " ".join(done.output.split()).startswith(found.headline)
    written = json.loads(data.read_text())
    assert {key: written[key] for key in ("verdict", "groups", "held_out", "remaining")} == {
        key: json.loads(found.to_json())[key] for key in ("verdict", "groups", "held_out", "remaining")
    }  # fmt: skip
    assert np.allclose(
        tw.load(out).forward_kinematics(np.ones(6)), found.robot.forward_kinematics(np.ones(6)), atol=1e-9
    )


# ── Factory calibration of UR robots


def _conf(path, values):
    lines = [f"delta_{name} = [{', '.join(map(repr, map(float, x)))}] # comment" for name, x in values.items()]
    path.write_text("[mounting]\n" + "\n".join(lines) + "\ncalibration_status = 2\n")
    return path


def test_a_factory_calibration_is_the_controllers_table(tmp_path):
    """The calibrated robot is the Denavit-Hartenberg chain of the UR5 with the corrections, to rounding."""
    rng = np.random.default_rng(0)
    off = {"theta": 1e-3 * rng.normal(size=6), "d": 2e-4 * rng.normal(size=6), "a": 3e-4 * rng.normal(size=6)}
    off["alpha"] = 1e-3 * rng.normal(size=6)
    off["a"][5] = off["alpha"][5] = 0.0
    robot = tw.robots.ur5()
    found = tw.calibration.factory(robot, _conf(tmp_path / "calibration.conf", off))
    d, a = np.array([0.089159, 0, 0, 0.10915, 0.09465, 0.0823]), np.array([0, -0.425, -0.39225, 0, 0, 0])
    alpha = np.array([1, 0, 0, 1, -1, 0]) * np.pi / 2

    def table(q, off):
        T = np.eye(4)
        for i in range(6):
            T = T @ tw.se3.exp([0, 0, q[i] + off["theta"][i], 0, 0, d[i] + off["d"][i]])
            T = T @ tw.se3.exp([alpha[i] + off["alpha"][i], 0, 0, a[i] + off["a"][i], 0, 0])
        return T

    none = {name: np.zeros(6) for name in off}
    X, E = _ends(robot, lambda q: table(q, none))
    for q in robot.random_configuration(0, (20,)):
        assert np.allclose(found.forward_kinematics(q), X @ table(q, off) @ E, atol=1e-9)


def _ends(robot, table):
    """Base and end frames for which the nominal table is the robot: turns by multiples of 90° about z, and the rest."""
    q = np.array([0.3, 0.5, -0.7, 0.9, 1.1, 0.2])
    for k in range(4):
        X = tw.se3.exp([0, 0, k * np.pi / 2, 0, 0, 0])
        E = np.linalg.inv(X @ table(np.zeros(6))) @ robot.forward_kinematics(np.zeros(6))
        if np.allclose(X @ table(q) @ E, robot.forward_kinematics(q), atol=1e-9):
            return X, E
    raise AssertionError("the table is not the robot")


LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")


def _kinematics(path, off):
    """The YAML of UR's ROS tools: each joint's frame, Tx(a) Rx(α) of the link before it and Rz(θ) Tz(d) of its own."""
    d, a = (
        np.array([0.089159, 0, 0, 0.10915, 0.09465, 0.0823]) + off["d"],
        np.array([0, -0.425, -0.39225, 0, 0, 0]) + off["a"],
    )
    alpha = np.array([1, 0, 0, 1, -1, 0]) * np.pi / 2 + off["alpha"]
    text = "kinematics:\n"
    for i, link in enumerate(LINKS):
        T = tw.se3.exp([alpha[i - 1], 0, 0, a[i - 1], 0, 0]) if i else np.eye(4)
        T = T @ tw.se3.exp([0, 0, off["theta"][i], 0, 0, d[i]])
        angles = Rotation.from_matrix(T[:3, :3]).as_euler("xyz")
        values = zip(("x", "y", "z", "roll", "pitch", "yaw"), [*T[:3, 3], *angles], strict=True)
        text += f"  {link}:\n" + "".join(f"    {name}: {float(value)!r}\n" for name, value in values)
    path.write_text(f"{text}  hash: calib_123456\n")
    return path


@pytest.mark.parametrize("size", [0.0, 1.0])
def test_both_files_of_a_factory_calibration_give_one_robot(tmp_path, size):
    """The controller's corrections, and the YAML that UR's tools make of them; without corrections, the robot of the file."""
    rng, robot = np.random.default_rng(1), tw.robots.ur5()
    off = {
        name: size * s * rng.normal(size=6) for name, s in (("theta", 1e-3), ("d", 2e-4), ("a", 3e-4), ("alpha", 1e-3))
    }
    off["a"][5] = off["alpha"][5] = 0.0
    found = tw.calibration.factory(robot, _kinematics(tmp_path / "kinematics.yaml", off))
    of_controller = tw.calibration.factory(robot, _conf(tmp_path / "calibration.conf", off))
    q = robot.random_configuration(0, (20,))
    for frame in (*robot.link_names,):
        assert np.allclose(
            found.forward_kinematics(q, frame=frame), of_controller.forward_kinematics(q, frame=frame), atol=1e-9
        )
        if not size:
            assert np.allclose(
                found.forward_kinematics(q, frame=frame), robot.forward_kinematics(q, frame=frame), atol=1e-9
            )


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (lambda text: text.replace("wrist_2", "wrist_9"), "wrist_2"),
        (lambda text: text.replace("roll: ", "roll: 1_", 1), "plain number"),
        (lambda text: text.replace("0.089159", ".nan"), "plain number"),
        (lambda text: text.replace("kinematics", "joints"), "kinematics"),
        (lambda text: "kinematics: !!python/object/apply:os.system ['true']\n", "kinematics"),
        (lambda text: "a: &a [*a, *a]\nkinematics: *a\n", "YAML"),
    ],
)
def test_kinematics_files_made_to_do_harm_end_in_one_error(tmp_path, edit, words):
    """Names, numbers and tags that are not those of six poses; nothing is created from a tag."""
    path = _kinematics(tmp_path / "k.yaml", {name: np.zeros(6) for name in ("theta", "d", "a", "alpha")})
    path.write_text(edit(path.read_text()))
    with pytest.raises(TwistWrenchError, match=words) as told:
        tw.calibration.factory(tw.robots.ur5(), path)
    assert len(str(told.value)) < 1000


def test_a_kinematics_file_of_another_model_is_refused(tmp_path):
    off = {name: np.zeros(6) for name in ("theta", "d", "a", "alpha")}
    longer = {**off, "d": np.array([0, 0, 0, 0, 0, 0.0343])}  # the flange of a UR10e
    with pytest.raises(TwistWrenchError, match="another model"):
        tw.calibration.factory(tw.robots.ur5(), _kinematics(tmp_path / "a.yaml", longer))
    wider = {**off, "a": np.array([0, 0.1, 0, 0, 0, 0])}
    with pytest.raises(TwistWrenchError, match="another model"):
        tw.calibration.factory(tw.robots.ur5(), _kinematics(tmp_path / "b.yaml", wider))


def test_a_factory_calibration_of_another_model_or_robot_is_refused(tmp_path):
    zeros = {name: np.zeros(6) for name in ("theta", "d", "a", "alpha")}
    path = _conf(tmp_path / "c.conf", zeros | {"a": np.array([0, 0.1, 0, 0, 0, 0])})
    with pytest.raises(TwistWrenchError, match="another model"):
        tw.calibration.factory(tw.robots.ur5(), path)
    with pytest.raises(TwistWrenchError, match="geometry of a UR"):
        tw.calibration.factory(planar(6), path)
    path.write_text("[mounting]\ndelta_theta = [1, 2]\n")
    with pytest.raises(TwistWrenchError, match=r"not a calibration\.conf"):
        tw.calibration.factory(tw.robots.ur5(), path)


@pytest.mark.parametrize(
    "theta",
    [
        "[%(home)s, 0, 0, 0, 0, 0]",
        "[__import__('os').getpid(), 0, 0, 0, 0, 0]",
        "[nan, 0, 0, 0, 0, 0]",
        f"[{'1,' * 10_000}1]",
        "\xff\xfe",
    ],
)
def test_a_factory_calibration_made_to_do_harm_ends_in_one_error(tmp_path, theta):
    path = tmp_path / "c.conf"
    zeros = "".join(f"delta_{name} = [0, 0, 0, 0, 0, 0]\n" for name in ("a", "d", "alpha"))
    path.write_bytes(
        f"[DEFAULT]\nhome = ../../etc/passwd\n[mounting]\n{zeros}delta_theta = {theta}\n".encode("latin-1")
    )
    with pytest.raises(tw.RobotFileError) as told:
        tw.calibration.factory(tw.robots.ur5(), path)
    assert len(str(told.value)) < 1000


@pytest.mark.parametrize("name", ["c.conf", "ur5--left.conf"])
def test_the_command_writes_a_factory_calibration(tmp_path, name):
    """Two hyphens end no comment of XML."""
    zeros = {name: np.zeros(6) for name in ("theta", "d", "a", "alpha")}
    path = _conf(tmp_path / name, zeros | {"theta": np.array([0, 0.01, 0, 0, 0, 0])})
    done = CliRunner().invoke(main, ["calibrate", "ur5", "--from", str(path), "--out", str(tmp_path / "mine.urdf")])
    assert done.exit_code == 0 and done.output.startswith("DONE: the factory calibration moves tool0 by"), done.output
    right = tw.robots.ur5().forward_kinematics([0, 0.01, 0, 0, 0, 0])
    assert np.allclose(tw.load(tmp_path / "mine.urdf").forward_kinematics(np.zeros(6)), right, atol=1e-9)


def test_a_zero_that_the_fit_absorbs_is_named():
    """Poses let the fit move a zero by 90° all the way: the joint's convention is doubted all the same."""
    world = World.drawn(tw.robots.panda(), 3, tip="panda_link8")
    m = world.measured("pose", 40)
    shifted = replace(m, q=m.q + np.pi / 2 * np.eye(m.q.shape[1])[2])
    found = tw.calibration.calibrate(world.robot, shifted, tip="panda_link8")
    assert found.doubts[0].kind == "calibration-zero" and found.doubts[0].joints == ("panda_joint3",)
    assert abs(found.doubts[0].value + 90) < 1 and found.verdict.word == "LOOK AGAIN"


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        (
            {"q": [[0.1, 0.2], [0.1, 0.2], [0.3, 0.4]], "pairs": [[0, 1]], "distances": [0.3]},
            "a pair at one configuration",
        ),
        (
            {"q": [[0.1, 0.2], [0.1, 2e19], [0.3, 0.4]], "positions": np.zeros((3, 3))},
            "at most 1e\\+06",
        ),
        (
            {"q": [[0.1, 0.2], [0.1, 0.3], [0.3, 0.4]], "positions": [[0, 0, 0], [0, 0, 0], [0, -2e9, 0]]},
            "positions\\[2\\]",
        ),
    ],
)
def test_readings_that_no_arm_gives_are_one_error(arrays, words):
    """Two rows of a pair at one configuration, and numbers beyond any unit, are refused with their row."""
    with pytest.raises(tw.ValueRangeError, match=words):
        tw.calibration.Measurements(**arrays)


def test_readings_at_few_configurations_are_one_error():
    """Repeated readings leave nothing to hold out."""
    q = np.repeat(np.random.default_rng(0).normal(size=(2, 6)), 20, axis=0)
    T = tw.robots.ur5().forward_kinematics(q)
    with pytest.raises(tw.ValueRangeError, match="none can be held out"):
        tw.calibration.calibrate("ur5", tw.calibration.Measurements(q, positions=T[:, :3, 3]))


def test_roll_pitch_and_yaw_are_about_fixed_axes():
    angles = np.random.default_rng(0).uniform(-1.5, 1.5, (20, 3))
    np.testing.assert_allclose(
        rotations_from_roll(angles), Rotation.from_euler("xyz", angles).as_matrix(), atol=1e-12
    )  # small letters: fixed axes


@pytest.mark.parametrize(
    ("name", "unit", "value"),
    [("j.gear", "%", 1.0), ("j.sag", "mrad/(N m)", 10.0), ("j.x", "mm", 10.0), ("j.rx", "°", math.degrees(0.01))],
)
def test_a_group_is_shown_in_the_unit_that_is_named(name, unit, value):
    group = ParameterGroup(name, {name: 1.0}, 0.01, 0.0, 10.0, name == "j.x")
    assert _group_figures(group)[:2] == (unit, pytest.approx(value))


def test_the_table_says_which_readings_were_used(tmp_path):
    fit = SimpleNamespace(errors=[np.array([1e-4, 5e-3])], weights=[np.array([[1e4], [0.0]])], turns=[np.zeros(0)])
    CalibratedRobot.to_csv(SimpleNamespace(fit=fit), tmp_path / "readings.csv")
    rows = (tmp_path / "readings.csv").read_text().splitlines()[1:]
    assert [float(row.rpartition(",")[2]) for row in rows] == [1.0, 0.0]


def test_a_rigid_motion_of_the_base_is_no_error_of_the_tip():
    """Before and after differ by a turn of 20° and a shift of the base: what remains before is what remains after."""
    rng = np.random.default_rng(1)
    after = np.tile(np.eye(4), (50, 1, 1))
    after[:, :3, 3] = rng.normal(size=(50, 3))
    moved = tw.se3.pose(tw.so3.exp([0.1, 0.2, -0.28]), [0.3, 0.1, -0.2]) @ after
    fits = [SimpleNamespace(state=SimpleNamespace(corrections=T)) for T in (after, moved)]
    fits[0].problem = SimpleNamespace(chain=SimpleNamespace(tips=lambda _q, T: T))
    found = SimpleNamespace(fit=fits[0], plain=fits[1], reference=None, remaining=SimpleNamespace(rms=1e-4))
    assert CalibratedRobot.remaining_before.func(found) == pytest.approx(1e-4, rel=1e-6)


def test_readings_that_are_too_short_have_a_scale_below_one(monkeypatch):
    """Lengths that have to be longer by a quarter are 0.8 of the true ones."""
    error = instrument._InstrumentError(0.25, 1e-3, 1.0, 0.1)
    monkeypatch.setattr(instrument, "_instrument_error", lambda *_: error)
    measured = [SimpleNamespace(points=np.ones((2, 3)))]
    found = SimpleNamespace(fit=SimpleNamespace(problem=SimpleNamespace(measured=measured)))
    ((_, offered),) = instrument._scale_error(found)
    assert offered.doubt.value == pytest.approx(0.8)


def test_joints_that_yield_let_the_tip_down():
    """An arm that is stretched out is held up by torques of its joints; the more they yield, the lower is its tip."""
    chain = TipChain.from_robot(tw.robots.ur5(), assume=["sag"])
    stretched = np.zeros((1, 6))
    assert abs(chain.loads(stretched)[0, 1]) > 50.0  # N m, of the shoulder
    heights = [chain.tips(stretched, replace(chain.start, sags=np.full(6, sag)))[0, 2, 3] for sag in (0.0, 1e-4, 2e-4)]
    assert heights[0] > heights[1] > heights[2] > heights[0] - 0.05
