"""Rotors as bodies, MR section 8.9: energies counted by hand, power at the motors, what the book's special cases say.

The laws of mechanics on robots with rotors are in test_laws*.py, whose trees named ``driven`` have them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from quick import mostly_slow
from random_trees import DIFFERENCES, ROUNDING, driven, tree

import twistwrench as tw
from twistwrench.mechanics.model.builder import ModelBuilder
from twistwrench.mechanics.model.model import BASE
from twistwrench.testing import assert_close, derivative, random_state

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")

J, G = 2e-4, 80.0


def geared(robot, **more):
    entry = {"ratio": G, "rotor": {"inertia": f"{J} kg m^2", **more}}
    joints = [body.joint.name for body in robot.model.leaders if body.joint.nv == 1]
    return robot.with_actuators({"actuators": dict.fromkeys(joints, entry)})


def carrier(robot, q, body):
    """Pose and world-aligned Jacobian of the link that carries a rotor."""
    if body.parent == BASE:
        return np.eye(4), np.zeros((6, robot.nv))
    link = robot.model.bodies[body.parent].link
    return robot.forward_kinematics(q, link), robot.jacobian(q, link, "world_aligned")


def spins(robot, q):
    """For each rotor: its axis, and the W with angular velocity W dq, of its carrier and its own, in the base frame."""
    for body in robot.model.bodies:
        if body.joint.kind == "rotor":
            T, J_world = carrier(robot, q, body)
            axis = T[:3, :3] @ body.placement[:3, :3] @ body.joint.axes[0, :3]
            W = J_world[:3].copy()
            W[:, body.v_index] += body.ratio * axis
            yield axis, J_world[:3], W, body


@pytest.mark.parametrize("name", mostly_slow(["ur5", "panda", "quadruped"], 3))
def test_mass_matrix_is_the_hessian_of_the_energy_with_every_rotor_spinning(name):
    """K is a sum over bodies of the bare robot, plus what each spin adds: ½ J ((a·w)² - (a·w_carrier)²)."""
    bare = getattr(tw.robots, name)()
    robot = geared(bare)
    for seed in range(5):
        q = bare.random_configuration(seed)
        expected = bare.mass_matrix(q).copy()
        for axis, carried, W, _ in spins(robot, q):
            expected += J * (np.outer(axis @ W, axis @ W) - np.outer(axis @ carried, axis @ carried))
        assert_close(robot.mass_matrix(q), expected, ROUNDING, "M")


@pytest.mark.parametrize("name", ["driven0", "driven1", "driven2"])
def test_kinetic_energy_counts_every_extra_rotor_as_a_free_body(name):
    """Their own ½ m v² + ½ w'I w, by the Jacobians of the links that carry them."""
    robot = tree(name)
    q, dq, _ = random_state(robot, np.random.default_rng(5))
    links = tuple(body for body in robot.model.bodies if body.joint.kind != "rotor")
    assert len(links) < len(robot.model.bodies)
    energy = float(tw.Robot(replace(robot.model, bodies=links)).kinetic_energy(q, dq))
    for _, _, W, body in spins(robot, q):
        T, J_world = carrier(robot, q, body)
        R = T[:3, :3] @ body.placement[:3, :3]
        V, w = J_world @ dq, W @ dq
        v = V[3:] + np.cross(V[:3], T[:3, :3] @ body.placement[:3, 3])
        energy += 0.5 * body.inertia.mass * v @ v + 0.5 * w @ R @ body.inertia.moment_about_com @ R.T @ w
    assert_close(robot.kinetic_energy(q, dq), energy, ROUNDING, "K")


def test_on_a_fixed_axis_a_rotor_is_its_reflected_inertia():
    """One joint: M grows by G² J, MR eq. 8.117, to the last bits of G² J + …"""
    pendulum = tw.robots.pendulum()
    heavier = geared(pendulum, extra=True)
    assert_close(heavier.mass_matrix([0.3]) - pendulum.mass_matrix([0.3]), np.array([[G**2 * J]]), 1e-13, "G² J")
    assert_close(heavier.gravity_forces([0.3]), pendulum.gravity_forces([0.3]), 1e-14, "g")


def test_a_spinning_rotor_resists_being_turned_over():
    """A flywheel on a turntable, its axis level: turning the table takes the gyroscopic couple J G dq2 dq1, sideways."""
    builder = ModelBuilder("gyroscope")
    builder.add_link("base")
    solid = tw.SpatialInertia.box((0.1, 0.1, 0.1), mass=2.0)
    for name, parent, axis in (
        ("table", "base", (0, 0, 1)),
        ("frame", "table", (1, 0, 0)),
        ("wheel", "frame", (0, 1, 0)),
    ):
        builder.add_link(name, solid)
        builder.add_joint(f"{name}_joint", "revolute", parent, name, axis=axis)
    robot = tw.Robot(builder.build())
    wheel = robot.with_actuators(
        {
            "actuators": {
                "wheel_joint": {
                    "ratio": G,
                    "rotor": {"inertia": f"{J} kg m^2", "extra": True, "link": "frame", "axis": [0, 1, 0]},
                }
            }
        }
    )
    q, dq = np.zeros(3), np.array([0.7, 0.0, 30.0])  # turn the table while the wheel spins about y
    couple = wheel.inverse_dynamics(q, dq, np.zeros(3)) - robot.inverse_dynamics(q, dq, np.zeros(3))
    # dL/dt = w × L: (0, 0, w) × (0, J (G dq3), 0) = -w J G dq3 along x, which the frame's joint must provide.
    assert_close(couple, np.array([0.0, -0.7 * J * G * 30.0, 0.0]), 1e-12, "gyroscopic couple")


@pytest.mark.parametrize("name", ["ur5", "panda", "planar_3r"])
def test_power_into_the_motors_is_the_rate_of_the_energy_and_the_losses(name):
    """Σ torque · speed at the rotors = d/dt (K + P) + joint friction + what the gears lose, along a smooth motion."""
    bare = getattr(tw.robots, name)()
    entry = {
        "ratio": G, "efficiency": 0.7, "rotor": {"inertia": f"{J} kg m^2", "extra": True},
        "motor": {"torque_constant": "0.1 N m/A"},
        "friction": {"viscous": "2 N m s/rad", "coulomb": "1 N m", "static": "2 N m", "stribeck": "0.2 rad/s", "load": 0.1},
    }  # fmt: skip
    robot = bare.with_actuators({"actuators": dict.fromkeys(bare.joint_names, entry)})
    rng = np.random.default_rng(2)
    a, w, phase = rng.uniform(0.2, 0.8, robot.nv), rng.uniform(1, 3, robot.nv), rng.uniform(0, 6, robot.nv)

    def motion(t):
        angle = np.multiply.outer(t, w) + phase
        return a * np.sin(angle), a * w * np.cos(angle), -a * w**2 * np.sin(angle)

    def energy(t):
        q, dq, _ = motion(t)
        return robot.kinetic_energy(q, dq) + robot.potential_energy(q)

    for t in np.linspace(0, 2, 7):
        q, dq, ddq = motion(t)
        carried, rotor = robot.kernel("drive_torques")(q, dq, ddq)
        friction = robot.friction_forces(dq, load=carried + rotor)
        power = (carried + friction) * dq
        gears = np.where(power >= 0, power * (1 / 0.7 - 1), -power * (1 - 0.7)).sum()
        loads = robot.motor_loads(q, dq, ddq, friction=True)
        into_motors = (loads.torque * loads.speed).sum()
        rate = derivative(lambda s, t=t: energy(t + s), 5.0)
        size = np.abs(loads.torque * loads.speed).max() + abs(energy(np.array(t)))
        assert gears > 0
        assert abs(into_motors - (rate + friction @ dq + gears)) < DIFFERENCES * size


def test_drive_torques_add_up_to_inverse_dynamics():
    for seed in range(4):
        robot = driven(tree(f"one_degree{seed}"), seed)
        state = random_state(robot, np.random.default_rng(seed))
        carried, rotor = robot.kernel("drive_torques")(*state)
        assert_close(carried + rotor, robot.inverse_dynamics(*state), ROUNDING, "gear + rotor")


def test_a_locked_joint_keeps_its_rotor_as_dead_weight():
    arm = tw.robots.planar_3r()
    robot = geared(arm, extra=True, mass="3 kg")
    held = robot.lock({"joint2": 0.4})
    assert held.nv == 2
    assert list(held.actuators) == ["joint1", "joint3"]
    q = np.array([0.2, -0.3])
    full = robot.mass_matrix([0.2, 0.4, -0.3])
    rows = np.ix_([0, 2], [0, 2])
    assert_close(held.mass_matrix(q), full[rows], ROUNDING, "M of what still moves")


def test_a_rotor_that_its_link_cannot_contain_is_an_error():
    with pytest.raises(tw.InertiaError, match=r"cannot contain the rotor of joint 'joint2'.*extra"):
        tw.robots.planar_2r().with_actuators(
            {"actuators": {"joint2": {"ratio": 100, "rotor": {"inertia": "1 kg m^2"}}}}
        )


def test_numbers_of_the_file_arrive_in_the_energy():
    """Mass, place, inertia and axis as the file has them, by hand: a rotor beside a pendulum's link, on a slanted axis."""
    rotor = {
        "inertia": "3 kg cm^2",
        "extra": True,
        "mass": "0.7 kg",
        "place": ["0.1 m", "-20 mm", "0.3 m"],
        "axis": (1, 2, 2),
    }
    bare = tw.robots.planar_2r()
    robot = bare.with_actuators({"actuators": {"joint2": {"ratio": "-30:1", "rotor": {"link": "link1", **rotor}}}})
    q, dq = np.array([0.4, -0.9]), np.array([1.3, 2.1])
    T, J_world = bare.forward_kinematics(q, "link1"), bare.jacobian(q, "link1", "world_aligned")
    V, R = J_world @ dq, T[:3, :3]
    v = V[3:] + np.cross(V[:3], R @ [0.1, -0.02, 0.3])
    a = R @ np.array([1, 2, 2]) / 3
    w = V[:3] - 30 * 2.1 * a
    along = w @ a
    energy = 0.5 * 0.7 * v @ v + 0.5 * 3e-4 * along**2 + 0.5 * 1.5e-4 * (w @ w - along**2)
    assert_close(robot.kinetic_energy(q, dq) - bare.kinetic_energy(q, dq), energy, 1e-12, "K of the rotor")
    height = (T @ [0.1, -0.02, 0.3, 1])[:3] @ bare.gravity
    assert_close(robot.potential_energy(q) - bare.potential_energy(q), -0.7 * height, 1e-12, "P of the rotor")


def test_naming_the_link_that_carries_the_joint_changes_nothing():
    panda = tw.robots.panda()
    entry = {"ratio": 100, "rotor": {"inertia": "200 g cm^2"}}
    one = panda.with_actuators({"actuators": {"panda_joint2": entry}})
    named = {"ratio": 100, "rotor": {"inertia": "200 g cm^2", "link": "panda_link1"}}
    other = panda.with_actuators({"actuators": {"panda_joint2": named}})
    q = panda.random_configuration(1)
    assert_close(other.mass_matrix(q), one.mass_matrix(q), 1e-14, "M")
    with pytest.raises(tw.ModelError, match="Give its axis"):
        panda.with_actuators({"actuators": {"panda_joint2": {"rotor": {"inertia": "1 g cm^2", "link": "panda_link4"}}}})


def test_a_rotor_turns_about_its_joints_axis_whatever_the_frame_of_the_link_it_is_on():
    builder = ModelBuilder("arm")
    builder.add_link("base")
    for name, parent, axis in (("upper", "base", (0, 0, 1)), ("lower", "upper", (0, 1, 0))):
        builder.add_link(name, tw.SpatialInertia.box((0.3, 0.2, 0.1), mass=2.0))
        builder.add_joint(
            f"{name}_joint", "revolute", parent, name, axis=axis, placement=tw.se3.exp([0, 0.3, 0, 0.2, 0, 0])
        )
    builder.add_link("housing")
    builder.add_joint("screwed", "fixed", "upper", "housing", placement=tw.se3.exp([0.7, -0.4, 1.1, 0.1, 0, 0]))
    robot = tw.Robot(builder.build(tip="lower"))
    rotor = {"inertia": "200 kg cm^2", "extra": True}
    matrices = [
        robot.with_actuators({"actuators": {"lower_joint": {"ratio": 10, "rotor": rotor | where}}}).mass_matrix(
            [0.3, 0.5]
        )
        for where in ({}, {"link": "upper"}, {"link": "housing"})
    ]
    for found in matrices[1:]:
        assert_close(found, matrices[0], 1e-14, "M")


def test_a_link_may_contain_several_rotors_and_payloads_do_not_matter():
    builder = ModelBuilder("cube")
    builder.add_link("base")
    builder.add_link("cube", tw.SpatialInertia.from_com(1.0, (0, 0, 0), 1.2e-4 * np.eye(3)))
    builder.add_joint("hinge", "revolute", "base", "cube", axis=(0, 0, 1))
    for name, axis in (("x", (1, 0, 0)), ("y", (0, 1, 0))):
        builder.add_link(name, tw.SpatialInertia.box((0.1, 0.1, 0.1), mass=0.1))
        builder.add_joint(f"{name}_joint", "revolute", "cube", name, axis=axis)
    robot = tw.Robot(builder.build(tip="x"))
    entry = {"ratio": 2, "rotor": {"inertia": "1 kg cm^2"}}
    both = robot.with_actuators({"actuators": {"x_joint": entry, "y_joint": entry}})
    assert np.linalg.eigvalsh(both.mass_matrix([0.1, 0.2, 0.3])).min() > 0
    with pytest.raises(tw.InertiaError, match="cannot contain"):
        both.lock({}).with_actuators(
            {"actuators": {"hinge": {"rotor": {"inertia": "1.5 kg cm^2", "link": "cube", "axis": [1, 1, 0]}}}}
        )


def test_robots_share_nothing_that_can_be_changed():
    robot = geared(tw.robots.ur5())
    with pytest.raises(TypeError):
        robot.actuators["elbow_joint"] = None
    import pickle

    again = pickle.loads(pickle.dumps(robot))
    for one in (robot, again):
        for array in (one.actuators["elbow_joint"].rotor.place, one.model.friction.viscous):
            with pytest.raises(ValueError, match="read-only"):
                array[:] = 1.0
    q = robot.random_configuration(2)
    np.testing.assert_array_equal(again.mass_matrix(q), robot.mass_matrix(q))


def test_a_second_actuator_is_an_error_under_either_name():
    entry = {"ratio": 50, "stiffness": "100 N m/rad", "rotor": {"inertia": "1 g cm^2", "extra": "true"}}
    elastic = tw.robots.planar_2r().with_actuators({"actuators": {"joint1": entry}})
    for name in ("joint1", "joint1.motor"):
        with pytest.raises(tw.ModelError, match="has an actuator already"):
            elastic.with_actuators({"actuators": {name: {"ratio": 3}}})
