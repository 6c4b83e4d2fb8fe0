"""Robots joined and cut out: torques and mass matrices of the parts are those of the whole."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest
from quick import mostly_slow
from written_robots import FORMS, again, arm, differences

import twistwrench as tw
from twistwrench.mechanics.model.joining import with_free_base
from twistwrench.testing import random_pose, random_robot

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")

EXACT = 1e-12
"""Relative: the same recursion over the same bodies, added up in another order."""


def gripper():
    """Two fingers on a palm, the second follows the first; a spring, a site, friction, armature."""
    text = """<mujoco model="gripper"><compiler angle="radian"/><worldbody><body name="palm" pos="0 0 0.02">
      <geom type="box" size="0.05 0.03 0.02" density="500"/><site name="grasp" pos="0 0 0.1"/>
      <body name="left" pos="0 0.03 0.03"><joint name="open" type="slide" axis="0 1 0" range="0 0.04" armature="0.1" damping="2"
        stiffness="30"/><geom type="box" size="0.01 0.01 0.04" density="800"/></body>
      <body name="right" pos="0 -0.03 0.03"><joint name="other" type="slide" axis="0 -1 0" range="0 0.04"/>
        <geom type="box" size="0.01 0.01 0.04" density="800"/></body></body></worldbody>
      <equality><joint joint1="other" joint2="open"/></equality>
      <keyframe><key name="home" qpos="0.02 0.02"/></keyframe></mujoco>"""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)
        return tw.load(text)


POSE = random_pose(5)


def both():
    return tw.robots.ur5().attach(gripper(), "tool0", POSE, prefix="g_")


def states(robot, seed=0):
    rng = np.random.default_rng(seed)
    return robot.random_configuration(rng), *rng.uniform(-1, 1, (2, robot.nv))


def close(one, other):
    np.testing.assert_allclose(one, other, rtol=0, atol=EXACT * max(1.0, np.abs(other).max(initial=0.0)))


# ── attach ──


def test_names_limits_and_configurations_are_those_of_both():
    robot, hand = both(), gripper()
    assert robot.joint_names == (*tw.robots.ur5().joint_names, "g_open")
    assert robot.link_names == (*tw.robots.ur5().link_names, *(f"g_{name}" for name in hand.link_names))
    assert robot.frame_names[-1] == "g_grasp"
    np.testing.assert_array_equal(robot.limits.upper[-1:], hand.limits.upper)
    np.testing.assert_array_equal(robot.model.friction.viscous[-1:], hand.model.friction.viscous)
    np.testing.assert_array_equal(robot.armature[-1:], hand.armature)
    np.testing.assert_array_equal(robot.configurations["home"], [0, 0, 0, 0, 0, 0, 0.02])
    np.testing.assert_array_equal(robot.gravity, tw.robots.ur5().gravity)


def test_locked_it_is_a_payload():
    arm, hand, robot = tw.robots.ur5(), gripper(), both()
    held = hand.lock({"open": 0.03})
    loaded = arm.with_payload(held.model.base_inertia.in_frame(POSE), "tool0")
    q, dq, ddq = states(arm)
    locked = robot.lock({"g_open": 0.03})
    close(locked.inverse_dynamics(q, dq, ddq), loaded.inverse_dynamics(q, dq, ddq))
    # The whole robot with the fingers at rest relative to the hand: the same torques at the arm.
    whole = robot.inverse_dynamics([*q, 0.03], [*dq, 0], [*ddq, 0])
    close(whole[:6], loaded.inverse_dynamics(q, dq, ddq))


def test_the_attached_ones_block_of_the_mass_matrix_is_its_own():
    hand, robot = gripper(), both()
    q = robot.random_configuration(1)
    close(robot.mass_matrix(q)[6:, 6:], hand.mass_matrix(q[6:]))


def test_frames_are_where_the_other_has_them():
    arm, hand, robot = tw.robots.ur5(), gripper(), both()
    q = robot.random_configuration(2)
    base = arm.forward_kinematics(q[:6], "tool0") @ POSE
    for name in hand.frame_names:
        close(robot.forward_kinematics(q, f"g_{name}"), base @ hand.forward_kinematics(q[6:], name))


@pytest.mark.parametrize("seed", mostly_slow(range(6), 2))
def test_random_trees_joined_have_the_blocks_of_both(seed):
    one = random_robot(seed, joints=6, floating_base=seed % 2 == 0)
    two = random_robot(100 + seed, joints=5, floating_base=seed % 3 == 0)
    frame = one.link_names[seed % len(one.link_names)]
    robot = one.attach(two, frame, random_pose(seed), prefix="b_")
    fixed = two.lock({"root_joint": [1, 0, 0, 0, 0, 0, 0]}) if "root_joint" in two.joint_names else two
    assert set(robot.joint_names) == {*one.joint_names, *(f"b_{name}" for name in fixed.joint_names)}
    assert robot.nv == one.nv + fixed.nv
    q = robot.random_configuration(seed)
    places = {body.joint.name: body.places for body in robot.model.leaders}

    def restricted(part, prefix):
        mine = np.concatenate([np.zeros(0), *(q[places[prefix + name][0]] for name in part.joint_names)])
        rows = [i for name in part.joint_names for i in range(*places[prefix + name][1].indices(robot.nv))]
        return mine, np.array(rows, int)

    mine, rows = restricted(fixed, "b_")
    close(robot.mass_matrix(q)[np.ix_(rows, rows)], fixed.mass_matrix(mine))
    mine, _ = restricted(one, "")
    close(robot.forward_kinematics(q, frame), one.forward_kinematics(mine, frame))


def test_remarks_on_the_files_of_both_are_kept():
    """The bundled arm of point masses has two remarks, a moving link without mass has one, and the UR5 has none."""
    builder = tw.ModelBuilder("pointer")
    builder.add_link("axle")
    builder.add_link("hand", where="line 3")
    builder.add_joint("turn", "continuous", "axle", "hand")
    with pytest.warns(tw.ModelWarning, match="no mass"):
        pointer = tw.Robot(builder.build())
    arm, quiet = tw.robots.planar_2r(), tw.robots.ur5()
    assert len(arm.defects) == 2 and "'hand'" in " ".join(pointer.defects) and not quiet.defects
    assert arm.attach(pointer).defects == (*arm.defects, *pointer.defects)
    assert pointer.attach(arm).defects == (*pointer.defects, *arm.defects)
    assert arm.attach(quiet, prefix="b_").defects == quiet.attach(arm, prefix="b_").defects == arm.defects
    assert arm.attach(pointer).chain(tip="hand").defects == (*arm.defects, *pointer.defects)


def test_names_of_both_need_a_prefix():
    arm = tw.robots.planar_2r()
    with pytest.raises(tw.ModelError, match=r"link called 'base'.* prefix='hand_'"):
        arm.attach(arm)
    twice = arm.attach(arm, prefix="hand_")
    assert twice.joint_names == ("joint1", "joint2", "hand_joint1", "hand_joint2")
    with pytest.raises(tw.ModelError, match="another prefix"):
        twice.attach(arm, prefix="hand_")
    with pytest.raises(tw.UnknownNameError, match="'tol0'"):
        tw.robots.ur5().attach(arm, "tol0")
    with pytest.raises(tw.ValueRangeError, match=r"tw\.Robot"):
        arm.attach("gripper.urdf")


def test_it_attaches_to_sites_too():
    hand, robot = gripper(), arm()
    joined = robot.attach(hand, "camera", prefix="g_")
    q = joined.random_configuration(0)
    close(joined.forward_kinematics(q, "g_world"), joined.forward_kinematics(q, "camera"))
    placed = robot.attach(hand, "camera", POSE, prefix="g_")
    close(placed.forward_kinematics(q, "g_world"), placed.forward_kinematics(q, "camera") @ POSE)


def limited(model):
    return replace(model, limits=replace(model.limits, effort=np.array([7.0, np.inf])))


def test_actuators_springs_and_friction_come_along():
    elastic = {"ratio": 50, "stiffness": "1000 N m/rad", "rotor": {"inertia": "200 g cm^2"}}
    law = {"viscous": "0.2 N m s/rad", "coulomb": "3 N m"}
    drives = {"actuators": {"joint1": elastic | {"friction": law, "link_friction": {"coulomb": "1 N m"}}}}
    arm = tw.Robot(limited(tw.robots.planar_2r().model))
    driven = arm.with_actuators(drives)
    extra = {"inertia": "1 kg cm^2", "mass": "0.2 kg", "extra": True}
    second = arm.with_actuators({"actuators": {"joint2": {"ratio": 10, "rotor": extra}}})
    joined = driven.attach(second, prefix="b_")
    assert set(joined.joint_names) == {"joint1", "joint2", "b_joint1", "b_joint2", "joint1.motor"}
    assert [(a.joint, a.ratio) for a in joined.actuators.values()] == [("joint1", 50.0), ("b_joint2", 10.0)]
    held = joined.lock({"b_joint1": 0.4, "b_joint2": 0.2})
    loaded = driven.with_payload(second.lock({"joint1": 0.4, "joint2": 0.2}).model.base_inertia)
    q, dq, ddq = states(driven)
    close(held.inverse_dynamics(q, dq, ddq), loaded.inverse_dynamics(q, dq, ddq))
    for robot in (driven, joined):
        at = [robot.joint_names.index(name) for name in ("joint1", "joint1.motor")]
        assert robot.limits.effort[at].tolist() == [np.inf, 7.0]
        assert robot.model.friction.coulomb[at].tolist() == [1.0, 3.0]
        assert robot.model.friction.viscous[at].tolist() == [0.0, 0.2]
    other = again(driven, "mjcf")  # a rigid gear: the friction of both sides of it
    assert (other.limits.effort[0], other.model.friction.coulomb[0], other.armature[0]) == (7.0, 4.0, 0.05)
    part = joined.chain("base", "tip")  # what moves beyond the tip is left out; the base of the second weighs nothing
    close(part.inverse_dynamics(q, dq, ddq), driven.inverse_dynamics(q, dq, ddq))


# ── chain ──


@pytest.mark.parametrize(("name", "base"), [("ur5", "forearm_link"), ("panda", "panda_link4"), ("quadruped", "FL_hip")])
def test_a_subtree_has_the_torques_of_the_whole_at_rest_above(bundled, name, base):
    robot = bundled(name)
    part = robot.chain(base)
    at = [robot.model.joint_names.index(joint) for joint in part.joint_names]
    rows = np.array([robot.model.leaders[k].v_index for k in at])
    places = np.array([robot.model.leaders[k].q_index for k in at])
    q, dq, ddq = states(part)
    whole, rates, accelerations = robot.neutral, np.zeros(robot.nv), np.zeros(robot.nv)
    whole[places], rates[rows], accelerations[rows] = q, dq, ddq
    close(part.inverse_dynamics(q, dq, ddq), robot.inverse_dynamics(whole, rates, accelerations)[rows])
    close(part.mass_matrix(q), robot.mass_matrix(whole)[np.ix_(rows, rows)])
    to_base = tw.se3.inverse(robot.forward_kinematics(whole, base))
    for frame in part.link_names:
        close(part.forward_kinematics(q, frame), to_base @ robot.forward_kinematics(whole, frame))


def test_gravity_below_a_joint_that_follows_with_an_offset_is_turned_by_it():
    """The follower is at 0.4 rad where its leader is neutral."""
    links = "".join(
        f'<link name="{name}"><inertial><mass value="1"/><origin xyz="0.1 0.2 0.3"/>'
        '<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        for name in "abcd"
    )
    joints = "".join(
        f'<joint name="{name}" type="continuous"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0.3 0 0"/><axis xyz="0 1 0"/>{mimic}</joint>'
        for name, parent, child, mimic in (
            ("leads", "a", "b", ""),
            ("follows", "b", "c", '<mimic joint="leads" multiplier="-2" offset="0.4"/>'),
            ("last", "c", "d", ""),
        )
    )
    robot = tw.load(f'<robot name="offset">{links}{joints}</robot>')
    part = robot.chain("c")
    close(part.gravity, tw.so3.exp([0.0, 0.4, 0.0]).T @ robot.gravity)
    close(part.holding_torques([0.3]), robot.holding_torques([0, 0.3])[1:])


def test_a_chain_leaves_out_what_branches_off():
    robot = tw.robots.quadruped()
    leg = robot.chain("trunk", "FL_foot")
    assert leg.joint_names == ("FL_hip_joint", "FL_thigh_joint", "FL_calf_joint")
    assert leg.link_names == ("trunk", "FL_hip", "FL_thigh", "FL_calf", "FL_foot")
    assert leg.tip == "FL_foot"
    floating = robot.chain(tip="FL_foot")
    assert floating.joint_names[0] == "root_joint"
    assert robot.chain().joint_names == robot.joint_names


def test_cut_out_again_the_attached_robot_is_itself():
    hand, robot = gripper(), both()
    part = robot.chain("g_world")
    turned = hand.with_gravity(part.gravity)
    q, dq, ddq = states(hand)
    close(part.inverse_dynamics(q, dq, ddq), turned.inverse_dynamics(q, dq, ddq))
    close(part.model.base_inertia.parameters, hand.model.base_inertia.parameters)


def test_links_fixed_beside_the_base_do_not_come_along():
    """A hand cut off an arm has not the mass of the arm's last link, to which it is bolted."""
    panda = tw.robots.panda()
    hand = panda.chain("panda_hand")
    own = sum(panda.model.link_inertias[n].mass for n in ("panda_hand", "panda_leftfinger", "panda_rightfinger"))
    assert "panda_link7" not in hand.link_names
    np.testing.assert_allclose(hand.model.base_inertia.mass + sum(b.inertia.mass for b in hand.model.bodies), own)


def test_what_leads_nowhere_is_said():
    robot = tw.robots.quadruped()
    with pytest.raises(tw.FrameError, match="'FR_foot' is not carried by link 'FL_hip'"):
        robot.chain("FL_hip", "FR_foot")
    with pytest.raises(tw.UnknownNameError, match="'hip'"):
        robot.chain("hip")
    with pytest.raises(tw.UnknownNameError, match="'foot'"):
        robot.chain("trunk", "foot")
    hand = gripper()
    with pytest.raises(tw.ModelError, match="'other' follows 'open'"):
        hand.chain("palm", "right")


@pytest.mark.parametrize("form", FORMS)
def test_both_are_written_to_files(form):
    robot = both()
    without = {"urdf": ("armature",), "mjcf": ("velocity",), "sdf": ()}[form]
    other = again(robot, form)
    found = differences(robot, other, without=(*without, "tip"))
    # In URDF the armature and the spring of the fingers are lost, which is listed, and with them a part of M and h.
    assert [said for said in found if form != "urdf" or not said.startswith(("M:", "h:"))] == []
    part = tw.robots.ur5().chain("forearm_link")
    gravity = {"gravity": part.gravity} if form == "urdf" else {}
    assert not differences(part, again(part, form, **gravity), without=("velocity", "tip"))


def test_a_base_that_is_locked_anywhere_floats_again():
    """Its axes are then those of gravity: joint torques and the frames of links and of the world stay as they were."""
    text = """<mujoco model="swing"><worldbody><site name="spot" pos="0.3 -0.2 0.1"/><body name="trunk"><freejoint name="root_joint"/>
      <geom type="box" size="0.2 0.1 0.05" density="800"/><body name="arm" pos="0.2 0 0"><joint name="turn" axis="0 1 0"/>
        <geom type="box" pos="0.1 0 0" size="0.1 0.02 0.02" density="900"/></body></body></worldbody></mujoco>"""
    floating = tw.load(text)
    locked = floating.lock({"root_joint": [0.8, 0.4, -0.4, 0.2, 1.0, 2.0, 3.0]})  # quaternion and position
    freed = tw.Robot(with_free_base(locked.model))
    assert freed.joint_names == ("root_joint", "turn")
    q = np.array([0.6])
    q_freed = np.concatenate([freed.neutral[:7], q])
    np.testing.assert_allclose(freed.gravity_forces(q_freed)[6:], locked.gravity_forces(q), rtol=EXACT)

    def pose_on_trunk(robot, q, frame):
        return tw.se3.inverse(robot.forward_kinematics(q, "trunk")) @ robot.forward_kinematics(q, frame)

    for frame in ("arm", "spot"):
        expected = pose_on_trunk(locked, q, frame)
        np.testing.assert_allclose(pose_on_trunk(freed, q_freed, frame), expected, atol=EXACT)
