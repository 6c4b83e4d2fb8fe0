"""Models of other libraries as robots, and robots as their models: the same torques on both sides."""

from __future__ import annotations

import warnings
from functools import cache

import numpy as np
import pytest
from pinocchio_models import same_torques
from robot_files import FILES, NONE
from written_robots import differences

import twistwrench as tw
from twistwrench.robot import convert
from twistwrench.testing import random_robot

SAMPLE = ("planar_3r", "ur5", "panda", "quadruped", "floating_box", "cart_pole")
QUICK = list(FILES)[::12]


@pytest.fixture(scope="module")
def pinocchio():
    return pytest.importorskip("pinocchio", reason="Pinocchio is not installed", exc_type=ImportError)


@cache
def models(name, floating_base):
    """(Pinocchio's model of a file, the robot of that model)."""
    import pinocchio

    root = [pinocchio.JointModelFreeFlyer()] if floating_base else []
    try:
        model = pinocchio.buildModelFromUrdf(str(FILES[name]), *root)
    except (ValueError, RuntimeError):
        pytest.skip("Pinocchio does not read this file")
    try:
        return model, quietly(tw.from_pinocchio, model, inertia="accept", snap=0)
    except tw.ModelError as error:
        assert "reversed limits" in str(error)
        pytest.skip("its limits are reversed")


def quietly(make, *arguments, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)
        return make(*arguments, **options)


# ── Pinocchio ──


@pytest.mark.parametrize("floating_base", [False, True])
@pytest.mark.parametrize("name", QUICK or NONE)
def test_from_pinocchio_has_pinocchios_torques_and_frames(name, floating_base, pinocchio):
    model, robot = models(name, floating_base)
    assert robot.nv == model.nv
    same_torques(robot, model, pinocchio, states=1)


@pytest.mark.slow
@pytest.mark.parametrize("floating_base", [False, True])
@pytest.mark.parametrize("name", FILES or NONE)
def test_from_pinocchio_on_every_file(name, floating_base, pinocchio):
    test_from_pinocchio_has_pinocchios_torques_and_frames(name, floating_base, pinocchio)


def test_from_pinocchio_has_what_the_file_says(bundled, pinocchio):
    """Limits, friction, links: those that reading the file gives."""
    for name in ("ur5", "panda"):
        robot = bundled(name)
        model = pinocchio.buildModelFromUrdf(str(tw.robots.path_of(name)))
        other = quietly(tw.from_pinocchio, model)
        assert not differences(robot, other, without=("tip",)), name
        assert set(other.link_names) >= set(robot.link_names) - {"universe"}


def test_joints_that_a_urdf_cannot_have(pinocchio):
    """Ball joints, screws, universal and composite joints, translations, Euler angles, armature, named configurations."""
    pinocchio.seed(0)
    model = pinocchio.Model()
    axis = np.array([0.0, 0.6, 0.8])
    composite = pinocchio.JointModelComposite(pinocchio.JointModelRX())
    composite.addJoint(pinocchio.JointModelPZ(), pinocchio.SE3.Random())
    joints = {
        "ball": pinocchio.JointModelSpherical(),
        "screw": pinocchio.JointModelHelicalUnaligned(axis, 0.1),
        "zyx": pinocchio.JointModelSphericalZYX(),
        "shift": pinocchio.JointModelTranslation(),
        "universal": pinocchio.JointModelUniversal(axis, np.array([1.0, 0.0, 0.0])),
        "both": composite,
        "plane": pinocchio.JointModelPlanar(),
        "turn": pinocchio.JointModelRUBY(),
    }
    parent = 0
    for name, joint in joints.items():
        parent = model.addJoint(parent, joint, pinocchio.SE3.Random(), name)
        model.appendBodyToJoint(parent, pinocchio.Inertia.Random(), pinocchio.SE3.Random())
    each = [np.full(model.joints[j].nv, 0.1 * j) for j in range(1, model.njoints)]  # as a joint has one armature here
    model.armature = np.concatenate(each)
    robot = quietly(tw.from_pinocchio, model, inertia="accept")
    assert robot.nv == model.nv
    assert robot.joint_names[1:4] == ("screw", "zyx.0", "zyx.1")
    rng, data = np.random.default_rng(1), model.createData()
    q = robot.random_configuration(rng)
    dq, ddq = rng.uniform(-1, 1, (2, robot.nv))
    parts = []
    P = np.zeros((robot.nv, robot.nv))
    for body in robot.model.leaders:  # one after the other here and there
        mine, at = q[body.places[0]], body.places[1]
        if body.joint.quaternion is not None:
            mine = body.joint.to_pinocchio(mine)
        elif body.joint.name in ("plane", "turn"):
            mine = np.r_[mine[:-1], np.cos(mine[-1]), np.sin(mine[-1])]
        parts.append(mine)
        P[at, at] = np.eye(body.joint.nv)[list(body.joint.pinocchio_order)]
    tau = P.T @ pinocchio.rnea(model, data, np.concatenate(parts), P @ dq, P @ ddq)
    (plane,) = (body.places[1] for body in robot.model.leaders if body.joint.name == "plane")
    w, vx, vy = dq[plane]
    tau[plane] += robot.armature[plane] * [0.0, -w * vy, w * vx]  # a (ω × v), which Pinocchio leaves out, and we say so
    assert any("'plane' has an armature, whose products" in one for one in robot.defects)
    np.testing.assert_allclose(robot.inverse_dynamics(q, dq, ddq), tau, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(robot.armature, model.armature)


def test_parts_of_a_composite_joint_have_their_own_limits_and_losses(pinocchio):
    """An endless joint has two coordinates, cosine and sine, but one velocity: the slide after it is velocity 1."""
    composite = pinocchio.JointModelComposite(pinocchio.JointModelRUBX())
    composite.addJoint(pinocchio.JointModelPZ())
    model = pinocchio.Model()
    for name, joint in (("both", composite), ("last", pinocchio.JointModelRY())):
        parent = model.addJoint(model.njoints - 1, joint, pinocchio.SE3.Identity(), name)
        model.appendBodyToJoint(parent, pinocchio.Inertia.Random(), pinocchio.SE3.Identity())
    model.lowerPositionLimit, model.upperPositionLimit = np.array([-2, -2, -0.3, -0.4]), np.array([2, 2, 0.5, 0.6])
    model.velocityLimit, model.effortLimit = np.array([1.0, 2.0, 3.0]), np.array([10.0, 20.0, 30.0])
    model.damping, model.friction, model.armature = np.arange(9.0).reshape(3, 3) + 1.0
    robot = quietly(tw.from_pinocchio, model, inertia="accept")
    assert robot.joint_names == ("both.0", "both.1", "last")
    np.testing.assert_array_equal(robot.limits.velocity, model.velocityLimit)
    np.testing.assert_array_equal(robot.limits.effort, model.effortLimit)
    np.testing.assert_array_equal(robot.limits.lower, [-np.inf, -0.3, -0.4])
    np.testing.assert_array_equal(robot.limits.upper, [np.inf, 0.5, 0.6])
    friction = robot.model.friction
    np.testing.assert_array_equal(
        [friction.viscous, friction.coulomb, robot.armature], np.arange(9.0).reshape(3, 3) + 1.0
    )


def test_mimic_joints_of_pinocchio_follow(pinocchio, tmp_path):
    """Their limits, which Pinocchio drops, are wider than their leader's."""
    text = """<robot name="m"><link name="a"/>%s<joint name="j" type="revolute"><parent link="a"/><child link="b"/>
      <origin xyz="0 0 1"/><axis xyz="0 .6 .8"/><limit lower="-1" upper="1" effort="3" velocity="2"/></joint>
      <joint name="k" type="prismatic"><parent link="b"/><child link="c"/><axis xyz="1 0 0"/><limit lower="-2" upper="3"
      effort="3" velocity="4"/><mimic joint="j" multiplier="2" offset=".5"/></joint></robot>"""
    body = """<link name="%s"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>
      </inertial></link>"""
    text = text % (body % "b" + body % "c")
    model = pinocchio.buildModelFromXML(text, True)
    if model.nv == 2:
        pytest.skip("this version of Pinocchio has no mimic joints")
    robot, same = quietly(tw.from_pinocchio, model), quietly(tw.load, text)
    assert not differences(same, robot, without=("tip",))


def test_what_is_no_model_of_pinocchios_is_refused():
    with pytest.raises(tw.ModelError, match="not a model of Pinocchio's: object"):
        tw.from_pinocchio(object())


@pytest.mark.parametrize("name", SAMPLE)
def test_to_pinocchio_has_the_robots_torques(bundled, name, pinocchio):
    robot = bundled(name)
    model = quietly(robot.to_pinocchio)
    same_torques(robot, model, pinocchio)
    back = quietly(tw.from_pinocchio, model)
    if not any(body.follows for body in robot.model.bodies):
        assert not differences(robot, back, without=("tip",))


@pytest.mark.parametrize("seed", range(6))
def test_to_pinocchio_of_random_trees(seed, pinocchio):
    kinds = ("revolute", "continuous", "prismatic", "helical", "ball", "mimic", "fixed")
    robot = random_robot(seed, joints=8, floating_base=seed % 2 == 0, kinds=kinds)
    robot = robot.with_armature({robot.joint_names[-1]: 0.3})
    same_torques(robot, quietly(robot.to_pinocchio), pinocchio)


def test_to_pinocchio_says_that_products_of_velocities_are_lost(pinocchio):
    robot = tw.robots.floating_box().with_armature({tw.robots.floating_box().joint_names[0]: 0.2})
    with pytest.warns(tw.ModelWarning, match="has an armature, whose products of velocities Pinocchio leaves out"):
        robot.to_pinocchio()


def test_the_base_of_a_pinocchio_model_is_held_or_floats_as_asked(pinocchio):
    """As for files: False holds the root where its joint puts it, True adds a joint where there is none."""
    fixed = tw.load(tw.robots.path_of("quadruped"), floating_base=False)
    free = tw.robots.quadruped()
    q = np.tile([0.1, 0.7, -1.4], 4)
    model = free.to_pinocchio()
    model.referenceConfigurations["stand"] = np.concatenate([[0, 0, 0.3, 0, 0, 0, 1], q])
    held, found = (tw.from_pinocchio(model, floating_base=asked) for asked in (False, None))
    np.testing.assert_allclose(held.mass_matrix(q), fixed.mass_matrix(q), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(held.configurations["stand"], q)
    assert (held.nv, found.nv, held.model.mounted, found.model.mounted) == (12, 18, True, False)
    silent = fixed.to_pinocchio()
    assert [tw.from_pinocchio(silent, floating_base=asked).model.mounted for asked in (None, False)] == [False, True]
    assert tw.from_pinocchio(silent, floating_base=True).joint_names[0] == "root_joint"
    assert tw.from_pinocchio(model, floating_base=True).joint_names == found.joint_names


# ── MuJoCo ──


def test_the_base_of_a_mujoco_model_is_held_or_floats_as_asked():
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed", exc_type=ImportError)
    leg = '<body><joint name="hip" axis="0 1 0"/><geom size="0.1" pos="0 0 -0.2"/></body>'
    text = '<mujoco><worldbody><body name="hips" pos="1 0 2">{}<geom size="0.2"/>{}</body></worldbody></mujoco>'
    free, silent = (mujoco.MjModel.from_xml_string(text.format(joint, leg)) for joint in ('<freejoint name="f"/>', ""))
    held = tw.from_mujoco(free, floating_base=False)
    assert (held.joint_names, held.model.mounted) == (("hip",), True)
    np.testing.assert_allclose(held.forward_kinematics([0.3], "hips")[:3, 3], [1, 0, 2], atol=1e-15)
    assert tw.from_mujoco(free).joint_names == tw.from_mujoco(free, floating_base=True).joint_names == ("f", "hip")
    assert [tw.from_mujoco(silent, floating_base=asked).model.mounted for asked in (None, False)] == [False, True]
    assert tw.from_mujoco(silent, floating_base=True).joint_names == ("root_joint", "hip")


def test_armature_of_a_free_joint_is_that_of_mujoco():
    """Six equal ones are the same in both, whose axes differ; others no file can say, and of those the first is kept."""
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed", exc_type=ImportError)
    text = """<mujoco><worldbody><body><joint name="f" type="free" armature="0.7"/><geom size="0.1 0.2 0.3" type="box"/>
      <body pos="0.3 0 0"><joint name="h" axis="0 1 0"/><geom size="0.1" pos="0 0 0.2"/></body></body></worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(text)
    robot, data = tw.from_mujoco(model), mujoco.MjData(model)
    rng = np.random.default_rng(2)
    q = robot.random_configuration(rng)
    dq, ddq = rng.uniform(-1, 1, (2, robot.nv))
    data.qpos[:], data.qvel[:], data.qacc[:] = tw.convert.to_mujoco(robot, model, q, dq, ddq)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    mujoco.mj_inverse(model, data)
    P = tw.convert.mujoco_rates(robot, model, q)
    np.testing.assert_allclose(robot.inverse_dynamics(q, dq, ddq), P.T @ data.qfrc_inverse, rtol=1e-9, atol=1e-9)
    model.dof_armature[4] = 0.1
    with pytest.warns(
        tw.ModelWarning, match="joint 'f' has another armature in each direction, of which the first is kept"
    ):
        tw.from_mujoco(model)


@pytest.mark.parametrize("name", ["ur5", "panda", "quadruped"])
def test_to_mujoco_has_the_robots_mass_matrix(bundled, name):
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed", exc_type=ImportError)
    robot = bundled(name)
    model = quietly(robot.to_mujoco)
    q = robot.random_configuration(0)
    data, M = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    data.qpos[:] = convert.to_mujoco(robot, model, q)[0]
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, M)
    P = convert.mujoco_rates(robot, model, q)
    np.testing.assert_allclose(P.T @ M @ P, robot.mass_matrix(q), rtol=0, atol=1e-9 * np.abs(M).max())


def test_to_mujoco_says_what_mujoco_refuses():
    pytest.importorskip("mujoco", reason="MuJoCo is not installed", exc_type=ImportError)
    robot = quietly(
        tw.load,
        '<robot name="m"><link name="a"/><link name="b"/><joint name="j" type="continuous"><parent link="a"/>'
        '<child link="b"/></joint></robot>',
    )
    with pytest.raises(tw.ModelError, match="MuJoCo refuses robot 'm'"):
        robot.to_mujoco()


# ── SciPy ──


def test_quaternions_of_scipy_turn_as_ours():
    from scipy.spatial.transform import Rotation

    from twistwrench.mechanics.lie import quaternion

    Q = np.random.default_rng(0).normal(size=(5, 4))
    np.testing.assert_allclose(
        Rotation.from_quat(convert.to_scipy_quaternion(Q)).as_matrix(), quaternion.rotation(Q), atol=1e-14
    )
    np.testing.assert_array_equal(convert.from_scipy_quaternion(convert.to_scipy_quaternion(Q)), Q)
