"""Springs that hold a joint pull on its motor at rest: what is left of its torque is for loads, and not more."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import twistwrench as tw
from twistwrench import statics

ARM = """<mujoco><compiler angle="radian"/><worldbody>
<body name="upper"><joint name="a" axis="0 1 0" stiffness="20" springref="0.4" actuatorfrcrange="-40 40"/>
  <geom type="capsule" size="0.03" fromto="0 0 0 0.5 0 0" mass="1"/>
  <body name="lower" pos="0.5 0 0"><joint name="b" axis="0 1 0" stiffness="5" actuatorfrcrange="-20 20"/>
    <geom type="capsule" size="0.03" fromto="0 0 0 0.4 0 0" mass="0.5"/><site name="hand" pos="0.4 0 0"/></body></body>
</worldbody>
<tendon><fixed stiffness="8"><joint joint="a" coef="1"/><joint joint="b" coef="-1"/></fixed></tendon></mujoco>"""
Q = np.array([[0.1, 0.3], [-0.4, 0.6], [0.7, -0.2], [0.2, 1.0]])


@pytest.fixture(scope="module")
def arm():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)
        return tw.load(ARM, tip="hand")


@pytest.mark.parametrize("q", Q)
def test_the_largest_payload_takes_a_motor_to_its_limit_and_none_beyond(arm, q):
    found = statics.largest_payload(arm, q)
    loaded = arm.with_payload(tw.SpatialInertia.from_com(float(found.mass)))
    shares = np.abs(loaded.holding_torques(q)) / arm.limits.effort
    assert found.holds
    assert shares.max() == pytest.approx(1.0, rel=1e-12)
    assert np.argmax(shares) == found.joint


def test_springs_that_a_motor_cannot_hold_leave_nothing(arm):
    found = statics.largest_payload(arm, [-1.2, 0.0])
    assert not found.holds
    assert float(found.mass) == 0.0


@pytest.mark.parametrize("q", Q)
def test_the_largest_wrench_and_the_polytope_leave_room_for_springs(arm, q):
    along = statics.largest_wrench(arm, q, (0, 0, 1))
    pushing = {"hand": np.concatenate([np.zeros(3), [0, 0, float(along.magnitude)]])}
    T = arm.forward_kinematics(q)
    pushing["hand"][3:] = T[:3, :3].T @ pushing["hand"][3:]
    shares = np.abs(arm.holding_torques(q, wrench_by_robot=pushing)) / arm.limits.effort
    assert shares.max() == pytest.approx(1.0, rel=1e-12)
    reach = statics.wrench_polytope(arm, q).support((0, 0, 1))
    assert reach >= float(along.magnitude) * (1 - 1e-9)
    for corner in statics.wrench_polytope(arm, q).vertices:
        force = {"hand": np.concatenate([np.zeros(3), T[:3, :3].T @ corner])}
        assert (np.abs(arm.holding_torques(q, wrench_by_robot=force)) <= arm.limits.effort * (1 + 1e-9)).all()


def test_robots_held_by_springs_are_in_equilibrium_only_as_their_motors_hold_them(arm):
    for q in [*Q, [-1.2, 0.0], [1.9, -0.5]]:
        holds = bool((np.abs(arm.holding_torques(q)) <= arm.limits.effort).all())
        assert statics.robot_equilibrium(arm, q, []).holds == holds


def test_the_shortest_move_keeps_the_torques_of_springs_within_limits(arm):
    path = tw.trajectories.joint_line(arm, [-0.4, 0.6], [0.5, 0.0])
    motion = tw.trajectories.Trajectory(arm, path, tw.trajectories.fitted(arm, path)).sample(1e-3)
    shares = np.abs(motion.torques()) / arm.limits.effort
    assert shares.max() == pytest.approx(1.0, rel=1e-3)
