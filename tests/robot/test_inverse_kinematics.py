"""Inverse kinematics: what it says it reached it reached, inside the limits; what it did not, it does not claim."""

from __future__ import annotations

import gc
import os
import pickle
import subprocess
import sys
import weakref

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import twistwrench as tw
from twistwrench.mechanics.model.builder import ModelBuilder
from twistwrench.robot.inverse_kinematics import search, solve

pytest_plugins = ("small_trees",)


@pytest.mark.parametrize("name", ["ur5", "panda"])
def test_random_reachable_poses_are_reached(bundled, name):
    """At least 99 of 100, to 1e-10, inside the limits; measured: all of 1000 of each."""
    robot = bundled(name)
    T = robot.forward_kinematics(robot.random_configuration(5, 150))

    found = robot.inverse_kinematics(T)

    assert found.converged.mean() >= 0.99
    assert (found.angle[found.converged] <= 1e-10).all()
    assert (found.distance[found.converged] <= 1e-10 * 3).all()
    assert_allclose(robot.forward_kinematics(found.q[found.converged]), T[found.converged], atol=3e-10)
    assert (found.q >= robot.limits.lower).all()
    assert (found.q <= robot.limits.upper).all()


def test_the_closed_form_of_the_planar_arm_is_found(bundled):
    """MR section 6.1: of links 1 and 1, elbow angle by the law of cosines."""
    arm = bundled("planar_2r")
    T = arm.forward_kinematics([0.0, 0.0])
    r = float(np.linalg.norm(T[:3, 3]))
    for distance in (0.3, 1.0, 1.7):
        T[:3, 3] *= distance / np.linalg.norm(T[:3, 3])
        found = arm.inverse_kinematics(T, q0=[0.1, 0.3], rows="vx vy vz")
        assert found.converged
        assert np.cos(found.q[1]) == pytest.approx(distance**2 / 2 - 1, abs=1e-9)
    assert r == pytest.approx(2.0)


@settings(deadline=None, max_examples=10)
@given(st.integers(0, 2**32 - 1), st.floats(1.05, 20.0))
def test_what_is_out_of_reach_is_never_claimed(seed, far):
    arm = tw.robots.planar_3r()
    rng = np.random.default_rng(seed)
    T = arm.forward_kinematics(arm.random_configuration(rng))
    T[:3, 3] *= 3.0 * far / np.linalg.norm(T[:3, 3])  # its links are 3 m together

    found = arm.inverse_kinematics(T, restarts=1, rows="vx vy vz")

    assert not found.converged
    assert found.distance >= 3.0 * (far - 1) - 1e-9
    assert "away" in found.reason()
    assert np.isfinite(found.q).all()


def test_the_nearest_point_is_found_where_the_pose_is_out_of_reach(bundled):
    arm = bundled("planar_2r")
    T = arm.forward_kinematics([0.3, 0.2])
    T[:3, 3] *= 5.0 / np.linalg.norm(T[:3, 3])
    found = arm.inverse_kinematics(T, rows="vx vy vz", restarts=2)
    assert not found.converged
    assert found.distance == pytest.approx(3.0, abs=1e-3)


@pytest.mark.parametrize("restarts", [0, 1, 3])
def test_a_pose_out_of_reach_is_started_for_once_and_again_as_often_as_asked(bundled, restarts):
    arm = bundled("planar_2r")
    T = arm.forward_kinematics([0.3, 0.2])
    T[:3, 3] *= 5.0
    assert arm.inverse_kinematics(T, rows="vx vy vz", restarts=restarts).starts == restarts + 1


@pytest.mark.parametrize("side", [-1, 1])
def test_a_joint_at_either_limit_is_held_there_and_named(bundled, side):
    """The pendulum may turn to ±1 rad, and the pose is farther the same way."""
    text = tw.robots.path_of("pendulum").read_text().replace('type="continuous"', 'type="revolute"')
    text = text.replace("<axis", '<limit lower="-1" upper="1" effort="9" velocity="9"/><axis', 1)
    robot = tw.load(text)
    found = robot.inverse_kinematics(bundled("pendulum").forward_kinematics([1.5 * side]), restarts=0, rows="wy")
    assert not found.converged
    assert found.q[0] == pytest.approx(side)
    assert found.held.tolist() == [True]


def test_joints_with_one_limit_stay_inside_it():
    """Two slides that may go to x = -1 m and to y = 1 m, and anywhere on the other side: (-1.3, 1.4) is nearest from there."""
    builder = tw.ModelBuilder("one limit each")
    for name in ("base", "x", "y"):
        builder.add_link(name)
    builder.add_joint("along x", "prismatic", "base", "x", axis=[1, 0, 0], lower=-1.0)
    builder.add_joint("along y", "prismatic", "x", "y", axis=[0, 1, 0], upper=1.0)
    T = np.eye(4)
    T[:2, 3] = -1.3, 1.4
    found = tw.Robot(builder.build()).inverse_kinematics(T, "y", [-0.8, 0.7], restarts=0, rows="vx vy")
    assert not found.converged
    assert_allclose(found.q, [-1.0, 1.0], atol=1e-9)


def test_limits_that_hold_a_joint_back_are_named(tmp_path):
    text = (
        tw.robots.path_of("ur5")
        .read_text()
        .replace('lower="-3.14159265359" upper="3.14159265359"', 'lower="0.5" upper="1.0"')
    )
    robot = tw.load(text)
    q = robot.neutral
    q[1:4] = -0.5, 2.5, 0.3
    T = robot.forward_kinematics(q)  # the elbow at 2.5, which it may not be
    found = robot.inverse_kinematics(T, restarts=2)
    assert not found.converged
    assert "elbow_joint" in found.reason()
    assert 0.5 <= found.q[2] <= 1.0


def test_a_batch_of_starts_and_poses_broadcasts(bundled):
    robot = bundled("panda")
    q = robot.random_configuration(1, (3, 1))
    found = robot.inverse_kinematics(robot.forward_kinematics(q), q0=robot.add(q, np.full(7, 0.02))[0], restarts=8)
    assert found.q.shape == (3, 1, 7)
    assert found.converged.all()


def test_a_start_nearby_stays_nearby(bundled):
    """Newton's method keeps the branch, and redundant joints move no more than they need."""
    robot = bundled("panda")
    q = robot.add(0.5 * (robot.limits.lower + robot.limits.upper), np.zeros(7))
    target = robot.forward_kinematics(q + 0.02)
    found = robot.inverse_kinematics(target, q0=q)
    assert found.starts == 1
    assert np.linalg.norm(found.q - q) <= np.linalg.norm(np.full(7, 0.02)) + 1e-6


def test_a_gap_stays_a_gap(bundled):
    robot = bundled("ur5")
    T = robot.forward_kinematics(robot.random_configuration(2, 3))
    T[1, 0, 3] = np.nan
    found = robot.inverse_kinematics(T)
    assert found.converged.tolist() == [True, False, True]
    assert np.isnan(found.q[1]).all()
    assert "not numbers" in found.reason(1)


def test_a_floating_robot_is_placed(bundled):
    box = bundled("floating_box")
    T = tw.se3.exp([0.3, -0.2, 2.5, 1.0, 2.0, 3.0])
    found = box.inverse_kinematics(T, "box")
    assert found.converged
    assert_allclose(box.forward_kinematics(found.q, "box"), T, atol=1e-9)


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({"restarts": -1}, "restarts"),
        ({"restarts": 1.5}, "restarts"),
        ({"angle": 0.0}, "angle"),
        ({"distance": np.nan}, "distance"),
        ({"rows": "up"}, "up"),
        ({"frame": "hand"}, "hand"),
        ({"q0": np.zeros(5)}, "q0"),
        ({"q0": np.full(6, np.nan)}, "q0"),
        ({"q0": np.zeros((4, 6)), "T": np.broadcast_to(np.eye(4), (3, 4, 4))}, "broadcast"),
        ({"T": np.eye(3)}, "T"),
        ({"T": 2 * np.eye(4)}, "T"),
        ({"T": "here"}, "T"),
    ],
)
def test_bad_input_is_named(bundled, options, word):
    with pytest.raises(tw.TwistWrenchError, match=word):
        bundled("ur5").inverse_kinematics(**{"T": np.eye(4), **options})


@pytest.mark.parametrize("rows", [None, "vx vy vz"])
@pytest.mark.parametrize("name", ["ur5", "planar_3r"])
def test_what_is_found_for_a_pose_depends_on_no_other_pose(bundled, name, rows):
    """To the bit: alone, in parts, in another order, beside poses out of reach that start again and again."""
    robot = bundled(name)
    T = robot.forward_kinematics(robot.random_configuration(5, 40))
    T[::7, :3, 3] *= 3.0  # out of reach
    options = {"rows": rows, "restarts": 3}
    whole = robot.inverse_kinematics(T, **options)
    assert (whole.starts > 1).any()
    for part in (slice(0, 1), slice(3, 20), slice(None, None, -1), slice(7, 8)):
        found = robot.inverse_kinematics(T[part], **options)
        for what in ("q", "angle", "distance", "starts", "converged", "held"):
            np.testing.assert_array_equal(getattr(found, what), getattr(whole, what)[part])
    np.testing.assert_array_equal(robot.inverse_kinematics(T[5], **options).q, whole.q[5])


def test_a_generator_gives_one_number_however_long_the_search(bundled):
    arm = bundled("planar_2r")
    T = arm.forward_kinematics([0.3, 0.4])
    far = T.copy()
    far[:3, 3] *= 5.0
    left = []
    for poses in (T, far, np.stack([T, far, far])):
        rng = np.random.default_rng(3)
        arm.inverse_kinematics(poses, rng=rng, restarts=2)
        left.append(rng.integers(2**60))
    assert len(set(left)) == 1


def test_float32_in_float32_out(bundled):
    robot = bundled("ur5")
    T = robot.forward_kinematics(robot.random_configuration(5, 30))
    single = T.astype(np.float32)
    found = robot.inverse_kinematics(single)
    assert (found.q.dtype, found.angle.dtype, found.distance.dtype) == (np.float32,) * 3
    assert found.converged.all()
    assert_allclose(
        robot.forward_kinematics(found.q.astype(float)), T, atol=3e-6
    )  # 6 angles and T rounded to 2**-24 each
    assert (found.q >= robot.limits.lower).all()  # to the last bit
    assert (found.q <= robot.limits.upper).all()
    assert robot.inverse_kinematics(single, q0=found.q).q.dtype == np.float32
    assert robot.inverse_kinematics(single, q0=found.q.astype(float)).q.dtype == np.float64
    assert robot.inverse_kinematics(T).q.dtype == np.float64


def test_a_joint_held_at_its_limit_stays_inside_in_float32(bundled):
    """0.1 is between two numbers of float32, the nearest of which is above it."""
    robot = tw.load(
        '<robot name="a"><link name="b"/><link name="c"/><joint name="j" type="revolute"><parent link="b"/><child link="c"/>'
        '<axis xyz="0 0 1"/><limit lower="-0.1" upper="0.1" effort="1" velocity="1"/></joint></robot>',
        inertia="accept",
    )
    for turn in (0.5, -0.5):
        T = tw.se3.exp([0, 0, turn, 0, 0, 0]).astype(np.float32)
        (q,) = robot.inverse_kinematics(T, restarts=1).q.astype(float)
        assert -0.1 <= q <= 0.1
        assert abs(q) > 0.0999999


# ── what a pose's answer depends on ──


def same(found, other, *index):
    for name in ("q", "converged", "angle", "distance", "starts", "held"):
        assert np.asarray(getattr(found, name)[index]).tobytes() == np.asarray(getattr(other, name)).tobytes(), name


@pytest.mark.parametrize("name", ["panda", "ur5"])
def test_a_poses_answer_does_not_depend_on_its_neighbours(bundled, name, monkeypatch):
    robot = bundled(name)
    T = robot.forward_kinematics(robot.random_configuration(7, 90))
    T[11, :3, 3] *= 9.0  # out of reach
    T[23, 0, 0] = np.nan
    found = robot.inverse_kinematics(T, restarts=6)
    assert found.starts[11] == 7
    assert found.starts[23] == 0
    for k in (0, 5, 11, 23, 24, 89):
        same(found, robot.inverse_kinematics(T[k], restarts=6), k)
    some = robot.inverse_kinematics(T[::-3], restarts=6)
    np.testing.assert_array_equal(some.q, found.q[::-3])
    monkeypatch.setattr(search, "AT_ONCE", 7)  # calls of the kernel with 64 poses
    np.testing.assert_array_equal(robot.inverse_kinematics(T, restarts=6).q, found.q)


@pytest.mark.parametrize("name", ["panda", "ur5"])
def test_one_pose_asked_for_again_and_again_has_the_answer_it_has_in_a_batch(bundled, name):
    """The first calls with one pose go another way than the later ones, which look in one lane first and then in all."""
    robot = bundled(name)
    T = robot.forward_kinematics(robot.random_configuration(8, 60))
    T[::5, :3, 3] *= 3.0  # out of reach
    start = robot.add(robot.neutral, np.full(robot.nv, 7.0))  # beyond the limits
    for options in ({}, {"q0": start}):
        found = robot.inverse_kinematics(T, restarts=5, **options)
        assert found.starts[found.converged].max() > 1
        for _ in range(2):
            for k in range(60):
                same(found, robot.inverse_kinematics(T[k], restarts=5, **options), k)


def test_a_start_beyond_the_limits_that_is_there_is_no_answer(bundled):
    robot = bundled("panda")
    q = robot.limits.upper + 0.1
    T = robot.forward_kinematics(q)
    for poses in (np.stack([T] * 9), T, T, T):
        found = robot.inverse_kinematics(poses, q0=q)
        assert (found.q <= robot.limits.upper).all()
        assert (found.q >= robot.limits.lower).all()


def test_what_is_asked_again_and_again_is_still_looked_at(bundled):
    robot = bundled("ur5")
    q = robot.random_configuration(2)
    T = robot.forward_kinematics(q)
    for _ in range(4):
        assert robot.inverse_kinematics(T).converged
        assert np.isnan(robot.inverse_kinematics(np.where(np.eye(4), np.nan, T)).q).all()
        assert robot.inverse_kinematics(T.tolist(), q0=q.tolist()).starts == 1
        for wrong, word in (
            ({"T": 2 * T}, "last row"),
            ({"T": T * [[2], [2], [2], [1]]}, "no|not"),
            ({"T": T @ np.diag([1, 1, -1, 1])}, "reflection"),
            ({"T": np.full((4, 4), np.inf)}, "T"),
            ({"T": T, "q0": np.full(6, np.nan)}, "q0"),
            ({"T": T, "restarts": -1}, "restarts"),
            ({"T": T, "restarts": 30.0}, "restarts"),
        ):
            with pytest.raises(tw.TwistWrenchError, match=word):
                robot.inverse_kinematics(**wrong)


def test_a_pose_that_is_one_to_six_digits_is_reached_as_the_nearest_one(bundled):
    robot = bundled("ur5")
    T = robot.forward_kinematics(robot.random_configuration(4, 5))
    rough = T.copy()
    rough[:, 0, 0] += 4e-7
    found = robot.inverse_kinematics(rough)
    assert found.converged.all()
    near = T.copy()
    near[:, :3, :3] = tw.so3.project(rough[:, :3, :3])
    assert_allclose(robot.forward_kinematics(found.q), near, atol=1e-9)


def test_more_restarts_than_a_table_has_places(bundled):
    """A hundred and fifty: three calls of the kernel, of which each makes what the others have left."""
    arm = bundled("planar_2r")
    T = arm.forward_kinematics([[0.3, 0.2], [0.4, 0.5]])
    T[0, :3, 3] *= 5.0
    for restarts in (64, 65, 66, 129, 130, 131, 150):
        found = arm.inverse_kinematics(T, rows="vx vy vz", restarts=restarts)
        assert found.starts[0] == restarts + 1
        assert found.distance[0] == pytest.approx(np.linalg.norm(T[0, :3, 3]) - 2.0, abs=1e-3)
        assert found.converged[1]


def test_a_result_of_one_pose_and_of_many_is_pickled(bundled):
    robot = bundled("ur5")
    T = robot.forward_kinematics(robot.random_configuration(4, 3))
    for poses in (T, T[0], T[0], T[0]):
        found = robot.inverse_kinematics(poses)
        again = pickle.loads(pickle.dumps(found))
        same(found, again)
        assert again.joint_names == found.joint_names


def test_what_is_left_is_what_forward_kinematics_say(bundled):
    robot = bundled("panda")
    T = robot.forward_kinematics(robot.random_configuration(3, 30))
    T[::2, :3, 3] *= 1.6  # most of them out of reach
    found = robot.inverse_kinematics(T, restarts=3)
    left = solve.twist_left(robot.forward_kinematics(found.q), T, tuple(range(6)))
    assert_allclose(found.angle, np.linalg.norm(left[:, :3], axis=1), atol=2e-12)
    apart = robot.forward_kinematics(found.q)[:, :3, 3] - T[:, :3, 3]
    assert_allclose(found.distance, np.linalg.norm(apart, axis=1), atol=2e-12)
    assert (~found.converged).any()


@pytest.mark.parametrize("rows", ["vx vy vz", "wx wy wz", "wz vx vy vz", "vz"])
def test_some_rows(bundled, rows):
    robot = bundled("panda")
    T = robot.forward_kinematics(robot.random_configuration(3, 40))
    found = robot.inverse_kinematics(T, rows=rows)
    assert found.converged.mean() >= 0.95
    left = solve.twist_left(robot.forward_kinematics(found.q), T, found.rows)
    assert np.abs(left[found.converged]).max() <= 2e-10
    assert (robot.limits.lower <= found.q).all()
    assert (found.q <= robot.limits.upper).all()


def test_bases_that_float_and_joints_that_follow_are_moved_too(bundled):
    robot = bundled("quadruped")
    frame = robot.frame_names[-1]
    q = robot.random_configuration(2, 12)
    found = robot.inverse_kinematics(robot.forward_kinematics(q, frame), frame)
    assert found.converged.all()
    assert_allclose(np.linalg.norm(found.q[:, :4], axis=1), 1.0, atol=1e-12)
    assert_allclose(robot.forward_kinematics(found.q, frame), robot.forward_kinematics(q, frame), atol=1e-9)


def test_one_seed_one_search_and_a_generator_gives_one_number_away(bundled):
    robot = bundled("panda")
    T = robot.forward_kinematics(robot.random_configuration(9, 60))
    first = robot.inverse_kinematics(T, rng=1)
    robot.inverse_kinematics(T, rng=2)
    np.testing.assert_array_equal(robot.inverse_kinematics(T, rng=1).q, first.q)
    rngs = [np.random.default_rng(4) for _ in range(3)]
    found = [robot.inverse_kinematics(T[:1] if k else T, rng=rng) for k, rng in enumerate(rngs[:2])]
    rngs[2].integers(2**63)
    assert rngs[0].integers(100) == rngs[1].integers(100) == rngs[2].integers(100)
    np.testing.assert_array_equal(found[0].q[0], found[1].q[0])
    for wrong in (-1, 0.5, "x"):
        with pytest.raises(tw.ValueRangeError, match="a seed"):
            robot.inverse_kinematics(T, rng=wrong)


def test_a_robot_that_looked_for_poses_is_freed():
    robot = tw.robots.planar_3r()
    robot.inverse_kinematics(robot.forward_kinematics(robot.neutral), rows="wy vx vz")
    gone = weakref.ref(robot)
    del robot
    gc.collect()
    assert gone() is None


def test_without_a_compiler_the_steps_are_the_same():
    code = (
        "import numpy as np, twistwrench as tw\n"
        "robot = tw.robots.planar_3r()\n"
        "T = robot.forward_kinematics(robot.random_configuration(1, 5))\n"
        "found = robot.inverse_kinematics(T, rows='wy vx vz')\n"
        "print(found.converged.all(), found.q.round(6).tolist())\n"
    )
    shown = [
        subprocess.run(
            [sys.executable, "-c", code], env={**os.environ, "TWISTWRENCH_JIT": jit},
            capture_output=True, text=True, check=True,
        ).stdout
        for jit in "01"
    ]  # fmt: skip
    assert shown[0] == shown[1]
    assert shown[0].startswith("True")


def test_one_pose_asked_for_twice_goes_the_short_way(bundled):
    """Where machine code runs; else this is the long way each time."""
    robot = tw.robot.Robot(bundled("panda").model)
    q = robot.random_configuration(4)
    T = robot.forward_kinematics(q)
    for _ in range(2):
        assert not any(robot.engine.single_poses.values())
        robot.inverse_kinematics(T, q0=q)
    ((alone, _),) = robot.engine.single_poses.values()
    for q0 in (None, q, q.tolist()):
        np.testing.assert_array_equal(alone.solve(T, q0)[0], robot.inverse_kinematics(T[None], q0=q0).q[0])


# ── several frames at once ──


def test_four_feet_are_placed_at_once(bundled):
    robot = bundled("quadruped")
    feet = [name for name in robot.frame_names if "foot" in name]
    q = robot.random_configuration(3, 20)
    T = np.stack([robot.forward_kinematics(q, foot) for foot in feet], axis=1)
    found = robot.inverse_kinematics(T, feet, rows="vx vy vz")
    assert found.converged.all()
    assert found.rows == (3, 4, 5) * 4
    for k, foot in enumerate(feet):
        left = robot.forward_kinematics(found.q, foot)[:, :3, 3] - T[:, k, :3, 3]
        assert np.linalg.norm(left, axis=1).max() <= 1e-9
    for _ in range(3):
        np.testing.assert_array_equal(robot.inverse_kinematics(T[7], feet, rows="vx vy vz").q, found.q[7])


def test_frames_may_have_rows_of_their_own(bundled):
    """The panda's hand with all six rows and its elbow's height; then an elbow that cannot be where the hand wants it."""
    robot = bundled("panda")
    elbow, hand = "panda_link4", robot.tip
    q = robot.random_configuration(6, 20)
    T = np.stack([robot.forward_kinematics(q, name) for name in (hand, elbow)], axis=1)
    found = robot.inverse_kinematics(T, (hand, elbow), rows={elbow: "wx"}, restarts=60)
    assert found.converged.mean() >= 0.9
    reached = found.q[found.converged]
    assert_allclose(robot.forward_kinematics(reached), T[found.converged, 0], atol=1e-9)
    left = solve.twist_left(robot.forward_kinematics(reached, elbow), T[found.converged, 1], (0,))
    assert np.abs(left).max() <= 2e-10
    T[:, 1, 2, 3] += 5.0
    far = robot.inverse_kinematics(T, (hand, elbow), restarts=1)
    assert not far.converged.any()
    assert (far.distance > 1.0).all()


def test_a_sequence_of_one_frame_takes_one_pose_each(bundled):
    """(1, 4, 4), as k frames take (k, 4, 4): q has no axis more than it has with several."""
    robot = bundled("ur5")
    q = robot.random_configuration(3, 4)
    T = robot.forward_kinematics(q)
    for poses, start in ((T[0], q[1]), (T, q[::-1])):
        found = robot.inverse_kinematics(poses[..., None, :, :], ["tool0"], start)
        np.testing.assert_array_equal(found.q, robot.inverse_kinematics(poses, "tool0", start).q)
        assert found.converged.shape == poses.shape[:-2]
    with pytest.raises(tw.ShapeError, match="1, 4, 4"):
        robot.inverse_kinematics(T[0], ["tool0"])


def test_frames_that_are_none_are_named(bundled):
    robot = bundled("ur5")
    two = np.stack([np.eye(4)] * 2)
    for frame, rows, T, word in (
        (["tool0", "tool0"], None, two, "twice"),
        ([], None, two, "several"),
        (["tool0", 3], None, two, "several"),
        (["tool0", "nowhere"], None, two, "nowhere"),
        (["tool0", "wrist_1_link"], None, np.eye(4), "T"),
        (["tool0", "wrist_1_link"], {"elbow": "vx"}, two, "keys"),
        (["tool0", "wrist_1_link"], None, two * 2, "pose"),
    ):
        with pytest.raises(tw.TwistWrenchError, match=word):
            robot.inverse_kinematics(T, frame, rows=rows)


# ── the nearest ──


def test_the_nearest_configuration_has_no_way_left_to_where_it_started(bundled):
    """Lagrange: of those that have the pose, one is nearest where the way to q0 is a sum of rows of J, limits apart."""
    robot = bundled("panda")
    q, q0 = robot.random_configuration(0, (2, 40))
    T = robot.forward_kinematics(q)
    usual, found = robot.inverse_kinematics(T, q0=q0), robot.inverse_kinematics(T, q0=q0, nearest=True)
    assert found.converged.all()
    assert_allclose(robot.forward_kinematics(found.q), T, atol=3e-10)
    assert (np.linalg.norm(found.q - q0, axis=1) <= np.linalg.norm(usual.q - q0, axis=1)).all()
    inside = (found.q > robot.limits.lower + 1e-6) & (found.q < robot.limits.upper - 1e-6)
    still = 0
    for k in range(40):
        F, z = robot.jacobian(found.q[k]) * inside[k], (q0[k] - found.q[k]) * inside[k]
        still += np.linalg.norm(z - np.linalg.pinv(F, rcond=1e-9) @ (F @ z)) < 1e-6
    assert still >= 36  # the others slide along limits, which they may leave again
    np.testing.assert_array_equal(robot.inverse_kinematics(T[3], q0=q0[3], nearest=True).q, found.q[3])


def test_the_nearest_to_a_configuration_that_has_the_pose_is_itself(bundled):
    for name, frame in (("panda", None), ("ur5", None), ("quadruped", "FL_foot")):
        robot = bundled(name)
        q = robot.random_configuration(2, 3)
        T = robot.forward_kinematics(q, frame)
        T[1, 0, 3] = np.nan
        found = robot.inverse_kinematics(T, frame, q, nearest=True)
        assert found.converged.tolist() == [True, False, True]
        assert np.isnan(found.q[1]).all()
        assert_allclose(found.q[::2], q[::2], atol=1e-9)
        assert found.starts.tolist() == [1, 0, 1]


# ── branches ──


def test_an_arm_with_a_spherical_wrist_or_parallel_axes_has_up_to_eight_branches(bundled):
    """MR section 6.1.1 of such arms: shoulder, elbow and wrist, two ways each; the pose's own configuration is among them."""
    robot = bundled("ur5")
    counts = []
    for q in robot.random_configuration(3, 12):
        T = robot.forward_kinematics(q)
        found = robot.inverse_kinematics_branches(T)
        counts.append(len(found.q))
        assert found.converged.all()
        assert found.starts.shape == (len(found.q),)
        assert_allclose(robot.forward_kinematics(found.q), np.broadcast_to(T, (len(found.q), 4, 4)), atol=3e-10)
        assert (robot.limits.lower <= found.q).all()
        assert (found.q <= robot.limits.upper).all()
        assert np.abs(found.q).max() <= np.pi + 1e-9  # the limits are two turns apart
        turned = np.abs(np.exp(1j * found.q) - np.exp(1j * q)).max(axis=1)
        assert (turned < 1e-6).sum() == 1
        apart = np.abs(np.exp(1j * found.q[:, None]) - np.exp(1j * found.q)).max(axis=-1)
        assert (apart + np.eye(len(apart)) > 1e-6).all()
    assert max(counts) == 8


@pytest.mark.parametrize(
    ("q", "most"),
    [
        ([0.3, -1.0, 1e-4, 0.4, 0.5, 0.2], 6),  # elbow next to stretched: two configurations meet
        ([0.3, -1.0, 1.2, 0.4, 1e-6, 0.2], 8),  # wrist next to stretched
        ([0.97625485, 1.28477538, 2.90548998, -5.3750732, -0.00034151, 3.06741939], 8),
    ],
)
def test_configurations_that_a_singular_pose_hardly_tells_apart_are_one_branch(bundled, q, most):
    """A hand that is off by 1e-10 is reached 1e-5 and more apart there."""
    robot = bundled("ur5")
    T = robot.forward_kinematics(q)
    found = robot.inverse_kinematics_branches(T, starts=512)
    assert 2 <= len(found.q) <= most
    assert_allclose(robot.forward_kinematics(found.q), np.broadcast_to(T, (len(found.q), 4, 4)), atol=3e-10)


def test_points_of_a_curve_are_no_branches_and_are_called_so(bundled):
    """With its wrist stretched the arm's last four joints move, and the hand stays."""
    robot = bundled("ur5")
    T = robot.forward_kinematics([0.3, -1.0, 1.2, 0.4, 0.0, 0.2])
    with pytest.warns(tw.ModelWarning, match="points of curves on which the frame stays"):
        assert len(robot.inverse_kinematics_branches(T).q) > 8


def test_branches_of_a_pose_out_of_reach_and_of_a_redundant_arm(bundled):
    far = bundled("ur5").inverse_kinematics_branches(tw.se3.exp([0, 0, 0, 9, 0, 0]))
    assert far.q.shape == (0, 6)
    assert far.converged.shape == (0,)
    with pytest.raises(tw.ValueRangeError, match="Lock joints"):
        bundled("panda").inverse_kinematics_branches(np.eye(4))
    for options in ({"starts": 0}, {"starts": 2.0}, {"T": np.stack([np.eye(4)] * 2)}, {"frame": "hand"}):
        with pytest.raises(tw.TwistWrenchError):
            bundled("ur5").inverse_kinematics_branches(**{"T": np.eye(4), **options})


@pytest.mark.usefixtures("each_on_numpy")
@pytest.mark.parametrize(
    ("kind", "ratio"), [("revolute", 0.0), ("revolute", 0.3), ("revolute", -1.7), ("helical", 0.0)]
)
def test_only_a_joint_that_is_where_it_was_after_a_full_turn_is_given_without_turns(kind, ratio):
    """A follower is then on the way between two of its places, and a screw a thread further: the angle itself is found."""
    builder = ModelBuilder("shaft")
    for link in ("base", "wheel", "hand"):
        builder.add_link(link, tw.SpatialInertia.from_com(1.0, (0.4, 0.0, 0.0), np.eye(3)))
    reach = tw.se3.exp([0.0, 0.0, 0.0, 0.5, 0.0, 0.0])
    pitch = 0.1 if kind == "helical" else 0.0
    builder.add_joint("lead", kind, "base", "wheel", axis=(0, 0, 1), pitch=pitch, lower=-20.0, upper=20.0)
    follow = {"mimic": ("lead", ratio, 0.2)} if ratio else {}
    kind_of_hand = "revolute" if ratio else "fixed"
    builder.add_joint("hand", kind_of_hand, "wheel", "hand", placement=reach, axis=(0, 0, 1), **follow)
    robot = tw.Robot(builder.build())
    repeats = kind == "revolute" and not ratio
    for q in (-9.0, 0.3, 3.0, 3.3):
        T = robot.forward_kinematics([q], "hand")
        found = robot.inverse_kinematics_branches(T, "hand", starts=12, rng=1)
        wanted = np.arctan2(np.sin(q), np.cos(q)) if repeats else q
        assert_allclose(robot.forward_kinematics(found.q, "hand"), T[None].repeat(len(found.q), axis=0), atol=1e-9)
        assert_allclose(found.q, [[wanted]], atol=1e-9)


@pytest.mark.parametrize("starts", [np.int64(3), np.uint8(3)])
def test_branches_take_whole_numbers_of_numpy(starts):
    robot = tw.robots.planar_2r()
    T = robot.forward_kinematics([0.3, 0.8])
    found = robot.inverse_kinematics_branches(T, rows="vx vz", starts=starts)
    np.testing.assert_array_equal(found.q, robot.inverse_kinematics_branches(T, rows="vx vz", starts=3).q)


@pytest.mark.parametrize("starts", [0, 2.0, True, "3", None, np.float64("nan")])
def test_branches_refuse_what_is_not_a_whole_number(starts):
    robot = tw.robots.planar_2r()
    with pytest.raises(tw.TwistWrenchError, match="starts"):
        robot.inverse_kinematics_branches(np.eye(4), rows="vx vz", starts=starts)
