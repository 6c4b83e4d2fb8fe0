"""Paths and time scalings: derivatives are derivatives, ends are ends, and limits that are passed are found."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import twistwrench as tw
from twistwrench import trajectories
from twistwrench.mechanics.model.actuation import with_friction
from twistwrench.motion.bounds import bounds_of
from twistwrench.motion.motion_log import MotionLog as MotionFile

HOME = np.array([0, -1.2, 1.5, -0.3, 1.5, 0])

SCALINGS = {
    "cubic": trajectories.cubic(1.7),
    "quintic": trajectories.quintic(1.7),
    "trapezoid": trajectories.trapezoid(v=0.9, a=2.1),
    "bang-bang": trajectories.trapezoid(v=9.0, a=2.1),
    "s-curve": trajectories.s_curve(1.7, alpha=0.4, beta=0.3),
}


@pytest.mark.parametrize("scaling", SCALINGS.values(), ids=SCALINGS)
def test_a_scaling_goes_from_rest_to_rest_and_its_rates_are_derivatives(scaling):
    T, h = scaling.duration, 1e-6
    s, ds, _ = scaling(np.array([0.0, T]))
    assert_allclose(s, [0, 1], atol=1e-15)
    assert_allclose(ds, [0, 0], atol=1e-15)
    t = np.linspace(0.013, T - 0.013, 58)
    before, after = scaling(t - h), scaling(t + h)
    assert_allclose((after[0] - before[0]) / (2 * h), scaling(t)[1], atol=1e-8)  # rounding 1e-16 / h
    smooth = np.abs(after[2] - before[2]) < 1e-2
    assert smooth.sum() > 50
    assert_allclose(((after[1] - before[1]) / (2 * h))[smooth], scaling(t)[2][smooth], atol=1e-8)
    assert (np.diff(scaling(np.linspace(0, T, 999))[0]) >= 0).all()


def test_the_peaks_of_the_book():
    """MR section 9.2.2: cubic 3/2 and 6, quintic 15/8 and 10/√3, of 1/T and 1/T²."""
    t = np.linspace(0, 2, 200_001)
    for scaling, v, a in ((trajectories.cubic(2.0), 1.5, 6.0), (trajectories.quintic(2.0), 15 / 8, 10 / np.sqrt(3))):
        _, ds, dds = scaling(t)
        assert ds.max() == pytest.approx(v / 2, abs=1e-8)
        assert np.abs(dds).max() == pytest.approx(a / 4, abs=1e-8)


@settings(deadline=None)
@given(st.floats(0.05, 20), st.floats(1.0001, 2.0))
def test_each_pair_of_a_trapezoid_gives_the_third(T, share):
    by_v = trajectories.trapezoid(v=share / T, duration=T)
    by_a = trajectories.trapezoid(a=by_v.a, duration=T)
    by_both = trajectories.trapezoid(v=by_v.v, a=by_v.a)
    assert_allclose([by_v.duration, by_a.duration, by_both.duration], T, rtol=1e-9)
    assert_allclose([by_a.v, by_both.v], by_v.v, rtol=1e-5)  # a root near its double point


@pytest.mark.parametrize(
    "given",
    [{}, {"v": 1.0}, {"v": 1, "a": 1, "duration": 1}, {"v": 0.4, "duration": 2}, {"v": 3, "duration": 1},
     {"a": 1, "duration": 1.9}, {"v": -1, "a": 1}, {"v": np.nan, "a": 1}, {"v": "fast", "a": 1}, {"a": np.inf, "duration": 1}],
)  # fmt: skip
def test_a_trapezoid_that_cannot_be_says_what_would(given):
    with pytest.raises(tw.ValueRangeError):
        trajectories.trapezoid(**given)


@pytest.mark.parametrize("straight", [True, False])
def test_the_twist_of_a_pose_path_is_its_derivative(straight):
    a, b = tw.se3.exp([0.3, -0.4, 1.2, 1, 2, 3]), tw.se3.exp([1.0, 0.8, -0.5, 0, 1, -1])
    path = (trajectories.straight_path if straight else trajectories.screw_path)(a, b)
    assert_allclose(path(np.array([0.0, 1.0])), [a, b], atol=1e-14)
    s, h = np.linspace(0, 1, 11), 1e-6
    V = tw.se3.log(tw.se3.inverse(path(s - h)) @ path(s + h)) / (2 * h)
    assert_allclose(V, path.body_twist(s), atol=1e-9)
    if straight:
        assert_allclose(path(s)[:, :3, 3], a[:3, 3] + s[:, None] * (b - a)[:3, 3], atol=1e-14)


@settings(deadline=None, max_examples=10)
@given(st.integers(0, 2**32 - 1), st.sampled_from([3, 5]))
def test_splines_meet_their_waypoints_and_their_rates_are_derivatives(seed, degree):
    robot = tw.robots.ur5()
    rng = np.random.default_rng(seed)
    points = robot.random_configuration(rng, int(rng.integers(6 if degree == 5 else 2, 9)))
    path = trajectories.spline(robot, points, degree=degree)
    assert_allclose(path(path.knots)[0], points, atol=1e-12)
    s, h = np.linspace(0.01, 0.99, 40), 1e-6
    size = np.abs(path(s)[2]).max() + 1
    assert_allclose((path(s + h)[0] - path(s - h)[0]) / (2 * h), path(s)[1], atol=1e-6 * size)
    assert_allclose((path(s + h)[1] - path(s - h)[1]) / (2 * h), path(s)[2], atol=1e-4 * size)


def test_waypoints_with_times_and_velocities_are_met_in_time(bundled):
    arm = bundled("planar_2r")
    times, points, rates = [1.0, 2.0, 4.0], [[0, 0], [1, 0.5], [0, 1]], [[0, 0], [1, 0], [0, 0]]
    path = trajectories.spline(arm, points, times=times, velocities=rates)
    moving = trajectories.Trajectory(arm, path, trajectories.uniform(3.0))
    q, dq, _ = moving(np.array(times) - 1.0)
    assert_allclose(q, points, atol=1e-14)
    assert_allclose(dq, rates, atol=1e-14)


def test_a_line_of_a_floating_robot_is_one_twist(bundled):
    box = bundled("floating_box")
    q0, q1 = box.random_configuration(3, 2)
    moving = trajectories.move(box, q0, q1, trajectories.cubic(2.0))
    q, dq, ddq = moving(np.linspace(0, 2, 9))
    assert_allclose(box.subtract(q[-1], q1), np.zeros(6), atol=1e-12)
    assert_allclose(box.subtract(moving(1.0 + 1e-6)[0], moving(1.0 - 1e-6)[0]) / 2e-6, moving(1.0)[1], atol=1e-8)
    assert np.linalg.matrix_rank(dq, tol=1e-9) == 1
    assert np.linalg.matrix_rank(ddq, tol=1e-9) == 1


@pytest.mark.parametrize(
    "shape", [trajectories.cubic, trajectories.quintic, lambda T: trajectories.trapezoid(v=1.5 / T, duration=T)]
)
def test_a_fitted_duration_touches_a_limit_and_passes_none(bundled, shape):
    robot = bundled("ur5").with_payload(tw.SpatialInertia.from_com(4.0, (0, 0, 0.1)))
    path = trajectories.joint_line(robot, HOME, HOME + np.array([1.5, 0.9, -1.0, 0.5, 0, 1]))
    moving = trajectories.Trajectory(robot, path, trajectories.fitted(robot, path, shape(1.0)))
    assert moving.violations() == ()
    hasty = trajectories.Trajectory(robot, path, moving.scaling.stretched(0.999 * moving.duration))
    assert hasty.violations()


@pytest.mark.parametrize("begin", [0.0, 1.5])
def test_a_fitted_motion_takes_as_long_as_its_mirror_image(bundled, begin):
    """On the other side of where it hangs a pendulum takes the same torques with the other sign."""
    robot = bundled("pendulum")
    bounds, times = bounds_of(robot, effort=15.0), []
    for way in (1.0, -1.0):
        path = trajectories.joint_line(robot, [way * begin], [way * (begin + 0.7)])
        scaling = trajectories.fitted(robot, path, bounds=bounds)
        assert trajectories.Trajectory(robot, path, scaling).violations(bounds) == ()
        times.append(scaling.duration)
    assert times[0] == pytest.approx(times[1], rel=1e-9)


def test_static_friction_that_fades_does_not_help_a_motor_that_brakes():
    """A lift of 1 kg goes down 1 m: at its peak of 10/√3 a quintic brakes with 20 N against the weight, helped by 1 N and not by 5 N."""
    text = """<robot name="lift"><link name="base"/><link name="car"><inertial><mass value="1"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="lift" type="prismatic">
    <parent link="base"/><child link="car"/><axis xyz="0 0 1"/><limit lower="-2" upper="2" effort="20" velocity="100"/></joint></robot>"""
    law = {"lift": {"coulomb": 1.0, "static": 5.0, "stribeck": 1e-3}}
    robot = tw.Robot(with_friction(tw.load(text).model, law))
    path = trajectories.joint_line(robot, [0.0], [-1.0])
    down = trajectories.Trajectory(robot, path, trajectories.fitted(robot, path, friction=True))
    weight = np.linalg.norm(robot.gravity)
    assert down.duration == pytest.approx(np.sqrt(10 / np.sqrt(3) / (20.0 - weight + 1.0)), rel=1e-3)
    assert down.violations(friction=True) == ()


def test_violations_name_joint_kind_and_time(bundled):
    robot = bundled("ur5")
    moving = trajectories.move(robot, HOME, HOME + np.array([0, 0, 3.0, 0, 0, 0]), trajectories.cubic(0.5))
    kinds = {(v.joint, v.kind) for v in moving.violations()}
    assert {("elbow_joint", "position"), ("elbow_joint", "velocity")} <= kinds
    position = next(v for v in moving.violations() if v.kind == "position")
    assert position.value == pytest.approx(4.5)
    assert position.time == pytest.approx(0.5)


def test_a_limit_passed_in_the_negative_direction_is_found_as_in_the_positive(bundled):
    """The mirrored motion of a robot without gravity passes the same limits by as much, each at its lower side."""
    arm = bundled("planar_2r").with_gravity((0, 0, 0))
    bounds = bounds_of(arm, velocity=1.0, acceleration=2.0, effort=1.5)
    bounds = replace(bounds, lower=np.full(2, -0.5), upper=np.full(2, 0.5))
    found = {}
    for way in (1.0, -1.0):
        one_way = trajectories.move(arm, [0, 0], [way, way], _Rising())
        found[way] = {(v.joint, v.kind): v for v in trajectories.violations(arm, one_way, bounds)}
    assert {kind for _, kind in found[1.0]} == {"position", "velocity", "acceleration", "torque"}
    assert found[1.0].keys() == found[-1.0].keys()
    for key, ahead in found[1.0].items():
        back = found[-1.0][key]
        assert back.value == pytest.approx(-ahead.value, rel=1e-9)
        assert back.limit == -ahead.limit < 0
        assert back.by == pytest.approx(ahead.by)


class _Rising:
    """s = t³ over a second: rates and accelerations of one sign only, so that one side of each limit is met."""

    name, duration = "rising", 1.0

    def __call__(self, t):
        t = np.asarray(t, float)
        return t**3, 3 * t**2, 6 * t


@pytest.mark.parametrize("degrees", [False, True])
def test_the_file_is_read_back_as_the_motion(bundled, tmp_path, degrees):
    robot = bundled("panda")
    q0, q1 = robot.random_configuration(4, 2)
    moving = trajectories.move(robot, q0, q1)
    path = moving.to_csv(tmp_path / "m.csv", 0.01, degrees=degrees)
    file = MotionFile.open(path, robot.model, degrees=degrees)
    back = file.motion(file.table)
    sampled = moving.sample(0.01)
    assert_allclose(back.time, sampled.time, atol=1e-12)
    for part in ("q", "dq", "ddq"):
        assert_allclose(getattr(back, part), getattr(sampled, part), atol=1e-11)
    assert sampled.time[-1] == moving.duration


@pytest.mark.parametrize("make", [trajectories.straight_path, trajectories.screw_path])
def test_the_tip_follows_the_poses(bundled, make):
    robot = bundled("ur5")
    T = robot.forward_kinematics(HOME)
    end = T @ tw.se3.exp([0.3, 0.2, -0.5, 0, 0, 0])
    end[:3, 3] += [0.1, -0.2, 0.15]
    poses = make(T, end)
    path = trajectories.follow_poses(robot, poses, HOME)
    s = np.linspace(0, 1, 333)
    off = tw.se3.log(tw.se3.inverse(poses(s)) @ robot.forward_kinematics(path(s)[0]))
    assert np.abs(off).max() <= 1.5e-8
    assert path.deviation <= 1e-8
    V = np.einsum("nij,nj->ni", robot.jacobian(path(s)[0]), path(s)[1])
    assert_allclose(V, poses.body_twist(s), atol=1e-5)


def test_a_start_at_a_limit_but_for_rounding_is_within(bundled):
    """As everywhere: a millionth of the limit is rounding to float32 or to six digits, more is beyond."""
    robot = bundled("ur5")
    q0 = HOME.copy()
    q0[0] = robot.limits.lower[0]
    outward = np.array([-1.0, 0, 0, 0, 0, 0])
    for past, fine in ((2e-6, True), (2e-5, False)):
        T = robot.forward_kinematics(q0 + past * outward)
        poses = trajectories.straight_path(T, robot.forward_kinematics(q0 - 0.05 * outward))
        if fine:
            assert trajectories.follow_poses(robot, poses, q0 + past * outward).deviation <= 1e-8
        else:
            with pytest.raises(tw.PathError, match=r"it begins with shoulder_pan_joint at .* outside its limits"):
                trajectories.follow_poses(robot, poses, q0 + past * outward)


def test_a_redundant_arm_follows_smoothly(bundled):
    robot = bundled("panda")
    q0 = np.array([0, -0.5, 0, -2.0, 0, 1.6, 0.8])
    T = robot.forward_kinematics(q0)
    end = T.copy()
    end[:3, 3] += [0.05, 0.2, -0.1]
    path = trajectories.follow_poses(robot, trajectories.straight_path(T, end), q0)
    assert_allclose(robot.forward_kinematics(path(1.0)[0])[:3, 3], end[:3, 3], atol=1e-6)
    assert np.abs(path(np.linspace(0, 1, 99))[2]).max() < 20


def test_a_path_that_ends_early_says_where_and_why_and_keeps_what_it_has(bundled):
    robot = bundled("ur5")
    T = robot.forward_kinematics(HOME)
    end = T.copy()
    end[2, 3] += 2.0
    with pytest.raises(tw.PathError, match=r"s = 0\.\d+.*singular") as caught:
        trajectories.follow_poses(robot, trajectories.straight_path(T, end), HOME)
    error = caught.value
    assert 0.05 < error.reached < 0.5
    reached = robot.forward_kinematics(error.partial(1.0)[0])[:3, 3]
    assert_allclose(reached, T[:3, 3] + error.reached * (end - T)[:3, 3], atol=1e-6)


@pytest.mark.parametrize("down, limit", [(0.3, "1.6"), (-0.2, "1.4")], ids=["upper", "lower"])
def test_a_limit_on_the_way_is_named(bundled, down, limit):
    text = (
        tw.robots.path_of("ur5")
        .read_text()
        .replace('lower="-3.14159265359" upper="3.14159265359"', 'lower="1.4" upper="1.6"')
    )
    robot = tw.load(text)
    T = robot.forward_kinematics(HOME)
    end = T.copy()
    end[2, 3] -= down
    with pytest.raises(tw.PathError, match=f"elbow_joint reaches its limit {re.escape(limit)}"):
        trajectories.follow_poses(robot, trajectories.straight_path(T, end), HOME)


@pytest.mark.parametrize("drawn", [0, 1], ids=["a limit", "a singular configuration"])
def test_the_path_so_far_says_how_far_it_is_off(bundled, drawn):
    """Near its end a path may bend more than its places tell: what is looked at between them is not all."""
    robot = bundled("panda")
    rng = np.random.default_rng(drawn)
    for _ in range(30):
        q0 = robot.random_configuration(rng)
        T = robot.forward_kinematics(q0)
        poses = trajectories.screw_path(T, T @ tw.se3.exp(rng.normal(size=6)))
        try:
            trajectories.follow_poses(robot, poses, q0, tolerance=1e-6)
        except tw.PathError as error:
            partial, reached = error.partial, error.reached
            if partial is not None:
                break
    s = np.linspace(0, 1, 500)
    off = robot.forward_kinematics(partial(s)[0])[:, :3, 3] - poses(reached * s)[:, :3, 3]
    assert np.linalg.norm(off, axis=1).max() <= 1.5 * partial.deviation + 1e-12


BAD = {
    "same place": lambda r: trajectories.joint_line(r, HOME, HOME),
    "no number": lambda r: trajectories.joint_line(r, HOME, HOME * np.nan),
    "too short": lambda r: trajectories.joint_line(r, HOME[:5], HOME),
    "one waypoint": lambda r: trajectories.spline(r, [HOME]),
    "waypoint twice": lambda r: trajectories.spline(r, [HOME, HOME]),
    "no waypoints": lambda r: trajectories.spline(r, HOME),
    "degree 5": lambda r: trajectories.spline(r, [HOME, HOME + 1], degree=5),
    "degree": lambda r: trajectories.spline(r, [HOME, HOME + 1], degree=4),
    "velocities alone": lambda r: trajectories.spline(r, [HOME, HOME + 1], velocities=[HOME, HOME]),
    "times fall": lambda r: trajectories.spline(r, [HOME, HOME + 1], times=[1, 0]),
    "another robot's path": lambda r: trajectories.fitted(tw.robots.panda(), trajectories.joint_line(r, HOME, HOME + 1)),
    "another robot's motion": lambda r: trajectories.Trajectory(tw.robots.panda(), trajectories.joint_line(r, HOME, HOME + 1), trajectories.cubic(1)),
    "a pose for poses": lambda r: trajectories.follow_poses(r, np.eye(4), HOME),
    "one pose of many": lambda r: trajectories.follow_poses(r, lambda s: r.forward_kinematics(HOME), HOME),
    "poses of nan": lambda r: trajectories.follow_poses(r, lambda s: np.full((len(s), 4, 4), np.nan), HOME),
    "poses that fail": lambda r: trajectories.follow_poses(r, lambda s: 1 / 0, HOME),
    "too few times": lambda r: trajectories.spline(r, [HOME, HOME + 1], times=[1]),
    "elsewhere": lambda r: trajectories.follow_poses(r, trajectories.straight_path(np.eye(4), tw.se3.exp(np.ones(6))), HOME),
    "tolerance": lambda r: trajectories.follow_poses(r, trajectories.straight_path(np.eye(4), np.eye(4)), HOME, tolerance=0),
    "dt": lambda r: trajectories.move(r, HOME, HOME + 1).sample(0),
    "no duration": lambda r: trajectories.cubic(0),
    "limits": lambda r: trajectories.bounds_of(r, velocity=-1),
    "negative jerk": lambda r: trajectories.fastest(r, trajectories.joint_line(r, HOME, HOME + 1), jerk=-1.0),
    "jerk's shape": lambda r: trajectories.fastest(r, trajectories.joint_line(r, HOME, HOME + 1), jerk=[100.0, 200.0]),
    "jerk of a cubic timing": lambda r: trajectories.fitted(r, trajectories.joint_line(r, HOME, HOME + 1), trajectories.cubic(1), bounds_of(r, jerk=9.0)),
    "jerk of a trapezoid": lambda r: trajectories.fitted(r, trajectories.joint_line(r, HOME, HOME + 1), trajectories.trapezoid(v=1.5, duration=1), bounds_of(r, jerk=9.0)),
    "jerk of a path without third derivative": lambda r: trajectories.fitted(r, trajectories.JointPath("mine", trajectories.joint_line(r, HOME, HOME + 1)), None, bounds_of(r, jerk=9.0)),
    "alpha": lambda r: trajectories.s_curve(1.0, alpha=0.6),
    "beta": lambda r: trajectories.s_curve(1.0, beta=0.0),
    "no duration of a double S": lambda r: trajectories.s_curve(np.nan),
    "limits' shape": lambda r: trajectories.bounds_of(r, velocity=[1, 2]),
    "no pose": lambda r: trajectories.screw_path(np.ones((4, 4)), np.eye(4)),
    "poses": lambda r: trajectories.screw_path(np.eye(4)[None], np.eye(4)),
    "floating spline": lambda r: trajectories.spline(tw.robots.floating_box(), tw.robots.floating_box().random_configuration(0, 2)),
}  # fmt: skip


@pytest.mark.parametrize("call", BAD.values(), ids=BAD)
def test_bad_input_is_one_error_of_the_tree(bundled, call):
    with pytest.raises((tw.ValueRangeError, tw.ShapeError)):
        call(bundled("ur5"))


def test_a_path_without_a_third_derivative_is_named_whatever_the_timing_lacks():
    arm = tw.robots.planar_2r()
    path = trajectories.JointPath(
        "mine", trajectories.move(arm, [0, 0], [1, 0], trajectories.quintic(2.0)).path.coordinates
    )

    class Timing:
        duration = 1.0

        def __call__(self, t):
            t = np.asarray(t, float)
            return t, np.ones_like(t), np.zeros_like(t)

    with pytest.raises(tw.ValueRangeError, match="the path 'mine' has no third derivative"):
        trajectories.Trajectory(arm, path, Timing()).jerk(0.5)
