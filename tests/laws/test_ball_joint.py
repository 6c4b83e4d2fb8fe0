"""Ball joints: laws, and every quantity against Pinocchio's spherical joint and MuJoCo's ball.

A chain and a tree of ball joints and hinges, on the ground and floating. Both libraries compute in float64 with other
formulas; what is compared is of order 1 to 100, and agrees to some 1e-13. TOLERANCE is the project's promise.
"""

from __future__ import annotations

import numpy as np
import pytest

import twistwrench as tw
from twistwrench.robot.convert import (
    from_mujoco,
    from_pinocchio,
    mujoco_rates,
    pinocchio_rates,
    to_mujoco,
    to_pinocchio,
)
from twistwrench.testing import random_builder, random_robot, random_state
from twistwrench.viz.sliders import sliders_of

TOLERANCE = 1e-10
KINDS = ("ball", "revolute", "prismatic")
CASES = [
    pytest.param(seed, floating, marks=pytest.mark.slow if seed > 1 else ())
    for seed in range(4)
    for floating in (False, True)
]


def ball_robot(seed, floating=False):
    builder = random_builder(seed, 5, KINDS)
    return tw.Robot(builder.build(floating_base=floating))


def in_pinocchio(robot):
    """The model, joint by joint: Pinocchio's URDF reader knows no ball joints."""
    pin = pytest.importorskip("pinocchio", reason="Pinocchio is not installed", exc_type=ImportError)
    types = {
        "ball": lambda _: pin.JointModelSpherical(),
        "floating": lambda _: pin.JointModelFreeFlyer(),
        "revolute": lambda joint: pin.JointModelRevoluteUnaligned(joint.axes[0, :3].copy()),
        "prismatic": lambda joint: pin.JointModelPrismaticUnaligned(joint.axes[0, 3:].copy()),
    }
    model, places = pin.Model(), {-1: 0}
    for k, body in enumerate(robot.model.bodies):
        T, G = np.asarray(body.placement, float), body.inertia
        joint = types[body.joint.kind](body.joint)
        place = pin.SE3(T[:3, :3].copy(), T[:3, 3].copy())
        places[k] = model.addJoint(places[body.parent], joint, place, body.joint.name)
        centred = pin.Inertia(G.mass, np.array(G.com), np.array(G.moment_about_com))
        model.appendBodyToJoint(places[k], centred, pin.SE3.Identity())
    model.gravity.linear = robot.gravity
    return pin, model, model.createData(), places


def in_mujoco(robot):
    """The model by its XML, without contacts and limits."""
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    import xml.etree.ElementTree as Tree

    from twistwrench.mechanics.lie import quaternion

    root = Tree.Element("mujoco")
    Tree.SubElement(
        root, "compiler", angle="radian", autolimits="false", inertiagrouprange="0 0", balanceinertia="false"
    )
    option = Tree.SubElement(root, "option", gravity=" ".join(map(repr, robot.gravity.tolist())))
    Tree.SubElement(option, "flag", contact="disable", limit="disable", constraint="disable")
    elements = {-1: Tree.SubElement(root, "worldbody")}

    def text(values):
        return " ".join(repr(float(x)) for x in np.ravel(values))

    for k, body in enumerate(robot.model.bodies):
        T, G, joint = np.asarray(body.placement, float), body.inertia, body.joint
        own = elements[k] = Tree.SubElement(
            elements[body.parent],
            "body",
            name=body.link,
            pos=text(T[:3, 3]),
            quat=text(quaternion.from_matrix(T[:3, :3])),
        )
        moments, axes = G.principal()
        Tree.SubElement(
            own,
            "inertial",
            mass=repr(float(G.mass)),
            pos=text(G.com),
            quat=text(quaternion.from_matrix(axes)),
            diaginertia=text(moments),
        )
        if joint.kind == "floating":
            Tree.SubElement(own, "freejoint", name=joint.name)
        else:
            kind = {"ball": "ball", "revolute": "hinge", "prismatic": "slide"}[joint.kind]
            axis = {} if kind == "ball" else {"axis": text(joint.axes[0, :3] if kind == "hinge" else joint.axes[0, 3:])}
            Tree.SubElement(own, "joint", name=joint.name, type=kind, **axis)
    model = mujoco.MjModel.from_xml_string(Tree.tostring(root, encoding="unicode"))
    return mujoco, model, mujoco.MjData(model)


def assert_near(found, wanted):
    wanted = np.asarray(wanted, float)
    assert np.abs(found - wanted).max() <= TOLERANCE * max(1.0, np.abs(wanted).max())


@pytest.mark.slow
@pytest.mark.parametrize("seed,floating", CASES)
def test_pinocchio_s_spherical_joint_agrees(seed, floating):
    robot = ball_robot(seed, floating)
    pin, model, data, places = in_pinocchio(robot)
    q, dq, ddq = random_state(robot, seed)
    x, v, a = to_pinocchio(robot, model, q, dq, ddq)
    P = pinocchio_rates(robot, model)
    for mine, back in zip((q, dq, ddq), from_pinocchio(robot, model, x, v, a), strict=True):
        assert_near(back, mine)
    tau = robot.inverse_dynamics(q, dq, ddq)
    assert_near(tau, P.T @ pin.rnea(model, data, x, v, a))
    assert_near(P @ robot.forward_dynamics(q, dq, tau), pin.aba(model, data, x, v, np.linalg.solve(P.T, tau)))
    pin.crba(model, data, x)
    M = np.triu(data.M) + np.triu(data.M, 1).T
    assert_near(robot.mass_matrix(q), P.T @ M @ P)
    assert_near(robot.bias_forces(q, dq), P.T @ pin.nle(model, data, x, v))
    assert_near(robot.gravity_forces(q), P.T @ pin.computeGeneralizedGravity(model, data, x))
    assert_near(robot.kinetic_energy(q, dq), pin.computeKineticEnergy(model, data, x, v))
    assert_near(robot.center_of_mass(q), pin.centerOfMass(model, data, x))
    pin.computeJointJacobians(model, data, x)
    body = len(robot.model.bodies) - 1
    J = pin.getJointJacobian(model, data, places[body], pin.ReferenceFrame.LOCAL)
    link = robot.model.bodies[body].link
    assert_near(robot.jacobian(q, link), np.roll(J, 3, axis=0) @ P)
    by_q, by_dq, _ = pin.computeRNEADerivatives(model, data, x, v, a)
    ours_q, ours_dq = robot.inverse_dynamics_derivatives(q, dq, ddq)
    assert_near(ours_q, P.T @ by_q @ P)
    assert_near(ours_dq, P.T @ by_dq @ P)
    dv = np.random.default_rng(seed).normal(size=robot.nv)
    moved = from_pinocchio(robot, model, pin.integrate(model, x, P @ dv))[0]
    assert_near(robot.subtract(moved, robot.add(q, dv)), np.zeros(robot.nv))  # a quaternion's sign is free
    assert_near(P @ robot.subtract(robot.add(q, dv), q), pin.difference(model, x, pin.integrate(model, x, P @ dv)))


@pytest.mark.parametrize("seed,floating", CASES)
def test_mujoco_s_ball_agrees(seed, floating):
    robot = ball_robot(seed, floating)
    mujoco, model, data = in_mujoco(robot)
    q, dq, ddq = random_state(robot, seed)
    x, v, a = to_mujoco(robot, model, q, dq, ddq)
    for mine, back in zip((q, dq, ddq), from_mujoco(robot, model, x, v, a), strict=True):
        assert_near(back, mine)
    data.qpos[:], data.qvel[:], data.qacc[:] = x, v, a
    mujoco.mj_inverse(model, data)
    P = mujoco_rates(robot, model, q)
    tau = robot.inverse_dynamics(q, dq, ddq)
    assert_near(tau, P.T @ data.qfrc_inverse)
    M = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, M)
    assert_near(robot.mass_matrix(q), P.T @ M @ P)
    if not floating:  # the linear velocity of a free joint is along the world's axes, so that ddq = 0 is another motion
        assert_near(robot.bias_forces(q, dq), P.T @ data.qfrc_bias)
    last = robot.model.bodies[-1].link
    pose = robot.forward_kinematics(q, last)
    assert_near(pose[:3, 3], data.body(last).xpos)
    assert_near(pose[:3, :3], data.body(last).xmat.reshape(3, 3))


def test_euler_angles_and_quaternions_describe_one_motion():
    """The chart of Lagrange's equations against differences along the motion."""
    ball = tw.Robot(random_builder(3, 1, ("ball",)).build())
    chain = tw.symbolic.coordinates.coordinates_of(ball.model)
    assert [c.name for c in chain] == ["alpha_1", "beta_1", "gamma_1"]
    u, du, ddu = np.array([0.4, -0.3, 0.9]), np.array([0.2, 1.1, -0.7]), np.array([-0.5, 0.3, 0.8])
    q, dq, ddq, N = tw.symbolic.coordinates.to_robot(ball.model, u, du, ddu)
    h = 1e-4
    places = {
        k: tw.symbolic.coordinates.to_robot(ball.model, u + k * h * du + 0.5 * (k * h) ** 2 * ddu, du, ddu)[0]
        for k in (-1, 1)
    }
    assert np.allclose(ball.subtract(places[1], places[-1]) / (2 * h), dq, atol=1e-7)
    found = (ball.subtract(places[1], q) + ball.subtract(places[-1], q)) / h**2
    assert np.allclose(found, ddq, atol=1e-6)
    assert np.allclose(N @ du, dq)


def test_its_equations_are_derived_and_checked():
    """``derive`` compares what it derived with Newton–Euler at random states, and raises where they differ."""
    ball = tw.Robot(random_builder(5, 1, ("ball",)).build())
    derived = tw.symbolic.derive(ball)
    assert list(map(str, derived.q)) == ["alpha_1", "beta_1", "gamma_1"]


@pytest.mark.parametrize(
    "method", ["dopri5", "rk4", "semi_implicit", pytest.param("variational", marks=pytest.mark.slow)]
)
def test_a_free_top_keeps_its_energy_and_angular_momentum(method):
    """A body on a ball joint at its centre, without gravity: Euler's equations."""
    builder = random_builder(1, 1, ("ball",))
    model = builder.build(gravity=(0, 0, 0))
    top = tw.Robot(model)
    q0, dq0 = top.random_configuration(2), np.array([0.3, 2.0, -1.0])
    motion = top.simulate(q0, dq0, duration=1.0, dt=1e-3, method=method)
    energy = top.kinetic_energy(motion.q, motion.dq)
    allowed = 2e-3 if method == "semi_implicit" else 1e-8  # of order 1 in dt = 1e-3
    assert np.abs(energy / energy[0] - 1.0).max() < allowed
    assert np.allclose(np.linalg.norm(motion.q, axis=1), 1.0, atol=1e-12)


def test_rollouts_take_the_steps_of_simulate():
    robot = random_robot(7, 3, ("ball", "revolute"))
    q0, dq0, _ = random_state(robot, 3)
    one = robot.simulate(q0, dq0, duration=0.1, dt=1e-3, method="semi_implicit")
    many = robot.rollout(q0[None], dq0[None], dt=1e-3, steps=100)
    assert np.abs(robot.subtract(many.q[0], one.q)).max() < 1e-12
    assert np.abs(many.dq[0] - one.dq).max() < 1e-11


def test_it_is_locked_shown_and_exported(tmp_path):
    robot = random_robot(7, 3, ("ball", "revolute"))
    name = next(b.joint.name for b in robot.model.bodies if b.joint.kind == "ball")
    assert robot.lock({name: [1.0, 0.0, 0.0, 0.0]}).nv == robot.nv - 3
    with pytest.raises(tw.ValueRangeError, match="quaternion nonzero"):
        robot.lock({name: [0.0, 0.0, 0.0, 0.0]})
    assert tw.viz.write_page(robot, tmp_path / "ball.html").stat().st_size > 0
    assert [s["name"] for s in sliders_of(robot.model) if s.get("turn") is not None][:3] == [
        f"{name} roll", f"{name} pitch", f"{name} yaw"
    ]  # fmt: skip
    header, *_ = robot.export_c(["inverse_dynamics", "add", "subtract"], tmp_path)
    assert f"{name}.qw" in header.read_text()
    (cuda,) = robot.export_cuda("forward_dynamics", tmp_path)
    assert "__global__" in cuda.read_text()
