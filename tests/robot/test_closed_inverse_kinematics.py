"""Inverse kinematics of closed robots: poses and loops met together, against closed forms, and what is not reached."""

from __future__ import annotations

import runpy
from dataclasses import replace

import numpy as np
import pytest
from mechanisms import CRANK, GROUND, ROCKER, along
from places import ROOT

import twistwrench as tw
from twistwrench.robot.inverse_kinematics.solve import twist_left

pytest_plugins = ("mechanism_fixtures",)


def test_poses_of_a_platform_are_found_with_its_loops_closed(platform):
    closed, near = platform
    steps = 0.2 * np.random.default_rng(0).standard_normal((60, closed.nv))
    q = closed.consistent(closed.open().add(near, steps), within=np.inf)
    T = closed.open().forward_kinematics(q, "plate")
    found = closed.inverse_kinematics(T)
    assert found.converged.all() and found.q.shape == q.shape
    assert np.abs(closed.constraint_error(found.q)).max() <= 1e-12 and found.gap.max() <= 1e-12
    left = twist_left(closed.open().forward_kinematics(found.q, "plate"), T, tuple(range(6)))
    assert np.abs(left).max() < 1e-10
    one = closed.inverse_kinematics(T[7], q0=near)
    assert np.abs(closed.constraint_error(one.q)).max() <= 1e-12 and one.converged.shape == ()


@pytest.mark.slow
def test_the_motors_of_a_delta_robot_are_those_of_the_closed_form():
    """|v - arm| = rod for each leg: the example's own formula, elbows outward as the start has them."""
    pytest.importorskip("matplotlib")
    example = runpy.run_path(str(ROOT / "examples" / "delta_robot.py"))
    closed = example["delta"]()
    middle = example["configuration"](closed.open(), np.array([0.0, 0.0, -0.65]))
    p = np.array([0.0, 0.0, -0.65]) + 0.08 * np.random.default_rng(1).uniform(-1, 1, (20, 3))
    found = closed.inverse_kinematics(tw.se3.pose(np.eye(3), p), "plate", middle)
    motors = [closed.open().coordinate_names.index(name) for name in example["MOTORS"]]
    assert found.converged.all() and found.gap.max() <= 1e-12
    assert np.abs(found.q[:, motors] - example["angles"](p)).max() < 1e-9


def test_a_rocker_is_led_to_where_two_circles_meet(linkage):
    """The pin between crank and coupler lies on two circles; so does the answer, and both its branches are answers."""
    x, z = 0.1, np.sqrt(CRANK**2 - 0.1**2)
    found = linkage.inverse_kinematics(along(x, 0.0, z), "coupler", rows="vx vz")
    robot = linkage.open()
    B, C = (robot.forward_kinematics(found.q, name)[[0, 2], 3] for name in ("coupler", "rocker_pin"))
    assert found.converged and np.abs(B - [x, z]).max() < 1e-10
    assert abs(np.linalg.norm(C - [GROUND, 0.0]) - ROCKER) < 1e-12 and abs(np.linalg.norm(C - B) - 0.8) < 1e-12


def test_what_is_out_of_reach_is_said_with_a_configuration_whose_loops_are_closed(linkage):
    found = linkage.inverse_kinematics(along(0.0, 0.0, 1.0), "coupler", rows="vx vz", restarts=4)
    assert not found.converged and found.starts == 5
    assert np.abs(linkage.constraint_error(found.q)).max() < 1e-10 and found.gap < 1e-10
    off = linkage.open().forward_kinematics(found.q, "coupler")[[0, 2], 3] - [0.0, 1.0]
    assert abs(np.linalg.norm(off) - found.distance) < 1e-12 and found.distance >= 1.0 - CRANK - 1e-9
    assert "out of reach" in found.reason() and "0.7" in found.reason()


def test_a_pose_that_only_an_open_loop_reaches_is_not_reached(linkage):
    """The open chain puts the coupler's end anywhere near; the closed linkage on one curve."""
    T = along(0.5, 0.0, 0.2)
    assert linkage.open().inverse_kinematics(T, "coupler_pin", rows="vx vz").converged
    found = linkage.inverse_kinematics(T, "coupler_pin", rows="vx vz")
    assert not found.converged and found.distance > 1e-3


def test_limits_are_kept_and_named(linkage):
    model, q = linkage.open().model, linkage.consistent([0.3, 0.4, 1.2])
    lower, upper = model.limits.lower.copy(), model.limits.upper.copy()
    lower[0], upper[0] = -1.0, 0.0
    held = tw.Robot(replace(model, limits=replace(model.limits, lower=lower, upper=upper)))
    held = held.close("rocker_pin", "coupler_pin", "vx vz")
    wanted = held.open().forward_kinematics(q, "coupler")
    found = held.inverse_kinematics(wanted, "coupler", rows="vx vz", restarts=8)
    assert -1.0 <= found.q[0] <= 0.0 and not found.converged and found.gap < 1e-10


def test_a_batch_is_its_poses_and_bad_ones_stay_alone(platform):
    closed, near = platform
    T = np.repeat(closed.open().forward_kinematics(near, "plate")[None], 3, axis=0)
    T[1, 2, 3], T[2, 0, 0] = 5.0, np.nan
    found = closed.inverse_kinematics(T, restarts=2)
    assert found.converged.tolist() == [True, False, False]
    assert np.isfinite(found.q[:2]).all() and np.isnan(found.q[2]).all()
    alone = closed.inverse_kinematics(T[0], restarts=2)
    assert np.array_equal(alone.q, found.q[0])
    assert "not numbers" in found.reason(2)


def test_what_poses_and_loops_leave_free_is_used_to_stay_near(platform):
    """Three freedoms, one row asked for: of the two that are left the nearest to q0 is no farther than the first found."""
    closed, near = platform
    T = closed.open().forward_kinematics(near, "plate") @ along(0.0, 0.0, 0.03)
    plain, close = (closed.inverse_kinematics(T, q0=near, rows="vz", nearest=x) for x in (False, True))
    far = [np.linalg.norm(closed.open().subtract(f.q, near)) for f in (plain, close)]
    assert plain.converged and close.converged and close.gap <= 1e-12 and far[1] <= far[0] + 1e-9


def test_hinges_that_lie_upside_down_are_not_taken_for_closed():
    """The sine of a turn by π is zero, and so is the slope of its square: what counts is the turn."""
    arm = tw.robots.ur5()
    q = arm.random_configuration(3)
    closed = arm.close("ground", arm.tip, rows="wx wy", pose=arm.forward_kinematics(q), near=q)
    T = arm.forward_kinematics(q) @ tw.se3.exp([0, 0, 0.4, 0.02, 0.01, 0.0])
    over = arm.inverse_kinematics(T @ tw.se3.exp([np.pi, 0, 0, 0, 0, 0]), q0=q)
    assert over.converged
    found = closed.inverse_kinematics(T, q0=over.q, rows="vx vy vz")
    assert found.converged and np.abs(closed.constraint_error(found.q)).max() < 1e-11


def test_redundant_rows_and_rows_of_velocity_change_nothing(linkage):
    q = linkage.consistent([0.3, 0.4, 1.2])
    T = linkage.open().forward_kinematics(q, "coupler")
    spatial = linkage.open().close("rocker_pin", "coupler_pin", "wx wz vx vy vz", redundant="accept")
    one, other = (c.inverse_kinematics(T, "coupler", q) for c in (linkage, spatial))
    assert one.converged and other.converged and np.abs(one.q - other.q).max() < 1e-10
    blade = tw.robots.floating_box().constrain("box", "vy")
    moved = blade.inverse_kinematics(along(1.0, 2.0, 3.0), "box")
    assert moved.converged and moved.gap == 0.0


def test_loops_at_other_places_of_one_arm_are_closed_where_they_are():
    """Two closed robots of one arm whose loops differ in nothing but the pose of the pin."""
    arm = tw.robots.planar_3r()
    q = np.array([-0.6, 0.2, 2.2])
    T = arm.forward_kinematics(arm.close("ground", arm.tip, rows="vx vz", pose=along(1.5)).consistent(q), "link2")
    for x in (1.5, 1.2):
        closed = arm.close("ground", arm.tip, rows="vx vz", pose=along(x))
        found = closed.inverse_kinematics(T, "link2", q, rows="vx")
        assert found.converged and np.abs(arm.forward_kinematics(found.q)[[0, 2], 3] - [x, 0.0]).max() < 1e-10


def test_several_frames_and_several_starts_at_once(platform):
    closed, near = platform
    q = closed.consistent(
        closed.open().add(near, 0.1 * np.random.default_rng(4).standard_normal((5, closed.nv))), within=np.inf
    )
    T = np.stack([closed.open().forward_kinematics(q, name) for name in ("plate", "shin1")], axis=1)
    found = closed.inverse_kinematics(T, ["plate", "shin1"], near, rows={"plate": None, "shin1": "vx vy vz"})
    assert found.converged.all() and np.abs(closed.constraint_error(found.q)).max() <= 1e-12
    many = closed.inverse_kinematics(T[0, 0], "plate", q)
    assert many.q.shape == q.shape and many.converged.all()


@pytest.mark.parametrize(
    ("asked", "error", "told"),
    [
        ({"T": np.ones((4, 4))}, tw.ValueRangeError, "pose"),
        ({"T": np.eye(4), "frame": "nowhere"}, tw.UnknownNameError, "nowhere"),
        ({"T": np.eye(4), "frame": "plate", "q0": [0.0]}, tw.ShapeError, "q0"),
        ({"T": np.eye(4), "frame": "plate", "restarts": -1}, tw.ValueRangeError, "restarts"),
    ],
)
def test_what_cannot_be_meant_is_refused(platform, asked, error, told):
    with pytest.raises(error, match=told):
        platform[0].inverse_kinematics(**asked)


def test_a_start_that_is_not_found_is_asked_for(monkeypatch):
    arm = tw.robots.planar_3r()
    held = arm.close("ground", arm.tip, rows="vx vz", pose=along(1.5))
    monkeypatch.setattr(
        "twistwrench.robot.constraints.closures.STARTS", 1
    )  # the stretched arm alone, which leads nowhere
    T = arm.forward_kinematics(held.consistent([-0.6, 0.2, 2.2]), "link2")
    with pytest.raises(tw.ConstraintError, match="Give q0"):
        held.inverse_kinematics(T, "link2")
    assert held.inverse_kinematics(T, "link2", [-0.6, 0.2, 2.2]).converged
