"""Models of other libraries as robots, and robots as their models: the same torques on both sides."""

from __future__ import annotations

import warnings
from functools import cache

import numpy as np
import pytest
from pinocchio_models import TOLERANCE, same_torques
from robot_files import FILES, NONE
from written_robots import differences

import twistwrench as tw
from twistwrench import convert
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
    with pytest.raises(tw.ModelError, match="no model of Pinocchio's: object"):
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


# ── MuJoCo ──


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


# ── Drake ──


@pytest.fixture(scope="module")
def drake():
    return pytest.importorskip("pydrake.multibody.plant", reason="Drake is not installed", exc_type=ImportError)


def plant_of(*texts):
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant

    plant = MultibodyPlant(0.0)
    parser = Parser(plant)
    parser.SetAutoRenaming(True)
    for kind, text in texts:
        parser.AddModelsFromString(text, kind)
    plant.Finalize()
    return plant


def same_as_drake(robot, plant, states=2):
    """M, Coriolis and gravity terms, poses of bodies; states go there and back."""
    context, rng = plant.CreateDefaultContext(), np.random.default_rng(0)
    for _ in range(states):
        q = robot.random_configuration(rng)
        dq, ddq = rng.uniform(-1, 1, (2, robot.nv))
        x, v, a = convert.to_drake(robot, plant, q, dq, ddq)
        plant.SetPositions(context, x)
        plant.SetVelocities(context, v)
        P = convert.drake_rates(robot, plant, q)
        M, c = plant.CalcMassMatrix(context), plant.CalcBiasTerm(context)
        tau = P.T @ (M @ a + c - plant.CalcGravityGeneralizedForces(context))
        size = np.abs(tau).max(initial=0.0) + np.abs(M).max(initial=0.0)
        np.testing.assert_allclose(robot.reference("mass_matrix", q), P.T @ M @ P, rtol=0, atol=TOLERANCE * size)
        np.testing.assert_allclose(robot.reference("inverse_dynamics", q, dq, ddq), tau, rtol=0, atol=TOLERANCE * size)
        for mine, back in zip((q, dq, ddq), convert.from_drake(robot, plant, x, v, a), strict=True):
            for at in robot.model.quaternions if mine is q else ():
                mine[at] *= np.sign(mine[at] @ back[at])
            np.testing.assert_allclose(back, mine, atol=1e-12)
        for name in robot.link_names[1:]:
            if plant.HasBodyNamed(name):
                X = plant.EvalBodyPoseInWorld(context, plant.GetBodyByName(name)).GetAsMatrix4()
                np.testing.assert_allclose(robot.reference("forward_kinematics", q, frame=name), X, atol=TOLERANCE)


@pytest.mark.parametrize("name", SAMPLE)
def test_from_drake_has_drakes_terms(bundled, name, drake):
    """A base that nothing holds floats there."""
    plant = plant_of(("urdf", tw.robots.path_of(name).read_text()))
    robot = quietly(tw.from_drake, plant)
    assert robot.nv == plant.num_velocities()
    same_as_drake(robot, plant)
    own = bundled(name)
    limits = {n: k for k, n in enumerate(robot.joint_names)}
    for k, joint in enumerate(own.joint_names):
        if joint in limits and own.model.leaders[k].joint.nv == 1:
            at, mine = robot.model.leaders[limits[joint]].v_index, own.model.leaders[k].v_index
            assert robot.limits.upper[at] == pytest.approx(own.limits.upper[mine])
            assert robot.limits.velocity[at] == pytest.approx(own.limits.velocity[mine])


SDF = """<sdf version="1.10"><model name="m">
  <link name="base"><inertial><mass>1</mass><inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz></inertia></inertial></link>
  <link name="a"><pose>0 0 1 0.3 0.2 0.1</pose><inertial><pose>0.1 0 0.2 0 0 0</pose><mass>2</mass>
    <inertia><ixx>0.2</ixx><iyy>0.3</iyy><izz>0.25</izz></inertia></inertial></link>
  <link name="b"><pose>0.5 0 1 0 0.2 0.1</pose><inertial><mass>1.5</mass>
    <inertia><ixx>0.2</ixx><iyy>0.3</iyy><izz>0.25</izz></inertia></inertial></link>
  <link name="c"><pose>0.5 0.3 1 0 0.2 0.1</pose><inertial><mass>1.5</mass>
    <inertia><ixx>0.2</ixx><iyy>0.3</iyy><izz>0.25</izz></inertia></inertial></link>
  <link name="d"><pose>0.5 0.3 1 0 0.2 0.1</pose><inertial><mass>1.5</mass>
    <inertia><ixx>0.2</ixx><iyy>0.3</iyy><izz>0.25</izz></inertia></inertial></link>
  <joint name="ball" type="ball"><parent>base</parent><child>a</child></joint>
  <joint name="uni" type="universal"><pose>0.1 0.2 0 0 0 0.4</pose><parent>a</parent><child>b</child>
    <axis><xyz>1 0 0</xyz><limit/></axis><axis2><xyz>0 1 0</xyz><limit/></axis2></joint>
  <joint name="screw" type="screw"><pose>0.1 0 0 0 0 0</pose><parent>b</parent><child>c</child>
    <axis><xyz>0 0.6 0.8</xyz><limit/></axis><screw_thread_pitch>0.3</screw_thread_pitch></joint>
  <joint name="slide" type="prismatic"><parent>c</parent><child>d</child>
    <axis><xyz>0 0.6 0.8</xyz><limit><lower>-1</lower><upper>2</upper><effort>40</effort></limit><dynamics><damping>3</damping></dynamics></axis></joint>
  <frame name="tool" attached_to="d"><pose>0 0 0.1 0 0 0</pose></frame>
</model></sdf>"""


def test_joints_of_drake_that_a_urdf_cannot_have(drake):
    from pydrake.math import RigidTransform, RollPitchYaw
    from pydrake.multibody.tree import PlanarJoint, SpatialInertia

    plant = drake.MultibodyPlant(0.0)
    from pydrake.multibody.parsing import Parser

    Parser(plant).AddModelsFromString(SDF, "sdf")
    plate = plant.AddRigidBody(
        "plate", plant.GetModelInstanceByName("m"), SpatialInertia.SolidCubeWithDensity(300.0, 0.2)
    )
    X = RigidTransform(RollPitchYaw(0.1, 0.2, 0.3), [0.1, 0.0, 0.2])
    plant.AddJoint(
        PlanarJoint(
            "plane",
            plant.GetFrameByName("tool"),
            plant.AddFrame(_offset("on_plate", plate, X)),
            np.array([0.1, 0.2, 0.3]),
        )
    )
    plant.Finalize()
    robot = quietly(tw.from_drake, plant)
    assert robot.nv == plant.num_velocities()
    assert {"ball", "uni.0", "uni.1", "screw", "slide", "plane"} <= set(robot.joint_names)
    same_as_drake(robot, plant)
    at = robot.model.leaders[robot.joint_names.index("slide")].v_index
    assert (robot.limits.lower[at], robot.limits.upper[at], robot.limits.effort[at]) == (-1, 2, 40)
    assert robot.model.friction.viscous[at] == 3
    assert quietly(tw.load, SDF, model="m").name == robot.name == "m"


def _offset(name, body, X):
    from pydrake.multibody.tree import FixedOffsetFrame

    return FixedOffsetFrame(name, body, X)


def test_names_that_two_models_of_a_plant_have_are_told_apart(drake):
    text = tw.robots.path_of("planar_2r").read_text()
    plant = plant_of(("urdf", text), ("urdf", text))
    robot = quietly(tw.from_drake, plant)
    assert len(set(robot.joint_names)) == len(robot.joint_names)
    assert any(name.endswith("::joint1") for name in robot.joint_names)
    same_as_drake(robot, plant)


def test_a_plant_that_is_not_finalised_is_refused(drake):
    with pytest.raises(tw.ModelError, match="Finalize"):
        tw.from_drake(drake.MultibodyPlant(0.0))


# ── Robotics Toolbox ──


class Link:
    """A link as the toolbox has it, whose package is seldom there."""

    def __init__(self, **values):
        defaults = {
            "theta": 0.0,
            "d": 0.0,
            "a": 0.0,
            "alpha": 0.0,
            "offset": 0.0,
            "sigma": 0,
            "mdh": 0,
            "isflip": False,
        }
        defaults |= {"m": 1.0, "r": [0.1, 0.2, 0.3], "I": np.diag([0.2, 0.3, 0.25]), "Jm": 0.0, "G": 1.0, "B": 0.0}
        defaults |= {"Tc": [0.0, 0.0], "qlim": None}
        vars(self).update(defaults | values)


class Toolbox:
    """A DHRobot as the toolbox has it."""

    def __init__(self, links, base=None, tool=None):
        self.name, self.links, self.gravity = "arm", links, np.array([0, 0, -9.81])
        self.base, self.tool = np.eye(4) if base is None else base, np.eye(4) if tool is None else tool


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_from_rtb_is_from_dh(convention):
    table = {"theta": [0, 0.3, 0], "d": [0.3, 0, 0.1], "a": [0.1, 0.4, 0], "alpha": [0.5, -0.2, 1.1]}
    types = ["revolute", "revolute", "prismatic"]
    links = [
        Link(
            **{k: v[i] for k, v in table.items()}, sigma=int(types[i] == "prismatic"), mdh=int(convention == "modified")
        )
        for i in range(3)
    ]
    tool = tw.se3.pose(np.eye(3), [0, 0, 0.2])
    robot = quietly(tw.from_rtb, Toolbox(links, tool=tool))
    same = tw.from_dh(
        table, convention=convention, joint_types=types, masses=[1] * 3, coms=[[0.1, 0.2, 0.3]] * 3,
        moments_about_com=[np.diag([0.2, 0.3, 0.25])] * 3, tool=tool,
    )  # fmt: skip
    q, dq, ddq = np.array([0.3, -0.4, 0.2]), np.array([1.0, -0.5, 0.3]), np.array([0.2, 0.1, -1.0])
    np.testing.assert_allclose(
        robot.inverse_dynamics(q, dq, ddq), same.inverse_dynamics(q, dq, ddq), rtol=1e-12, atol=1e-12
    )
    np.testing.assert_allclose(robot.forward_kinematics(q, "tool"), same.forward_kinematics(q, "tool"), atol=1e-14)


def test_motors_of_the_toolbox_count_by_their_gears():
    links = [Link(Jm=2e-4, G=-50.0, B=1e-3, Tc=[0.4, -0.3], qlim=[-1, 2], isflip=True, offset=0.5)]
    with pytest.warns(tw.ModelWarning, match="mean"):
        robot = tw.from_rtb(Toolbox(links))
    assert robot.armature == pytest.approx(0.5)
    assert robot.model.friction.viscous == pytest.approx(2.5)
    assert robot.model.friction.coulomb == pytest.approx(17.5)
    assert (robot.limits.lower[0], robot.limits.upper[0]) == (-1, 2)
    turned = tw.so3.exp([0, 0, -0.3 + 0.5])
    np.testing.assert_allclose(robot.forward_kinematics([0.3], "link1")[:3, :3], turned, atol=1e-15)


def test_what_is_no_robot_of_the_toolbox_or_plant_of_drakes_is_refused():
    with pytest.raises(tw.ModelError, match="no robot of the Robotics Toolbox"):
        tw.from_rtb(object())
    with pytest.raises(tw.ModelError, match="no plant of Drake's"):
        tw.from_drake(object())


@pytest.fixture(scope="module")
def toolbox():
    return pytest.importorskip("roboticstoolbox", reason="the Robotics Toolbox is not installed", exc_type=ImportError)


def test_the_puma_of_the_toolbox_has_its_torques(toolbox):
    theirs = toolbox.models.DH.Puma560()
    robot = quietly(tw.from_rtb, theirs, inertia="accept")
    rng = np.random.default_rng(0)
    q, dq, ddq = rng.uniform(-1, 1, (3, 6))
    still = theirs.nofriction(coulomb=True, viscous=True)
    np.testing.assert_allclose(robot.inverse_dynamics(q, dq, ddq), still.rne(q, dq, ddq), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(robot.forward_kinematics(q), theirs.fkine(q).A, atol=1e-12)


def test_a_tree_of_the_toolbox_has_its_torques(toolbox, tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(tw.robots.ur5().to_urdf())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        theirs = toolbox.Robot.URDF(str(path))
    robot = quietly(tw.from_rtb, theirs)
    rng = np.random.default_rng(0)
    q, dq, ddq = rng.uniform(-1, 1, (3, 6))
    np.testing.assert_allclose(robot.inverse_dynamics(q, dq, ddq), theirs.rne(q, dq, ddq), rtol=1e-9, atol=1e-9)


# ── SciPy ──


def test_quaternions_of_scipy_turn_as_ours():
    from scipy.spatial.transform import Rotation

    from twistwrench.lie import quaternion

    Q = np.random.default_rng(0).normal(size=(5, 4))
    np.testing.assert_allclose(
        Rotation.from_quat(convert.to_scipy_quaternion(Q)).as_matrix(), quaternion.rotation(Q), atol=1e-14
    )
    np.testing.assert_array_equal(convert.from_scipy_quaternion(convert.to_scipy_quaternion(Q)), Q)
