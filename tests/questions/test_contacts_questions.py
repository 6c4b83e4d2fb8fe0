"""Feet, wheels, bolts and grippers.

Pages: [What holds it?](holds.md), [feet, wheels, mounting and grip](torques.md#feet-wheels-mounting-and-grip).
"""

from __future__ import annotations

import numpy as np
from pytest import approx

import twistwrench as tw
from twistwrench import statics


def standing_dog():
    """A quadruped at rest, its soles in its feet's frames, and the configuration."""
    dog, legs = tw.robots.quadruped(), tw.robots.quadruped(floating_base=False)
    bent = {name: 0.8 if "thigh" in name else -1.6 for name in legs.joint_names if "hip" not in name}
    return dog, np.r_[1, 0, 0, 0, 0, 0, 0.3, legs.coordinates(**bent)]


def test_inverse_dynamics_with_contacts():
    """How do I compute the inverse dynamics of a walking robot, with its contacts?

    `tw.check(robot, motion, feet="auto", contact_friction=…)`, or `statics.support`. Forces stay in their friction cones at each row;
    the torques of the free base are then 0.

    Source: pinocchio#1052, pinocchio#61, pinocchio#1650, bullet3#2520.
    Number: Newton's law, Σf = m (a_com − g), with the acceleration of the centre of mass by differences.
    """
    held = tw.load(tw.robots.path_of("quadruped"))
    t = np.linspace(0, 2, 101)
    bend = 0.2 * np.sin(np.pi * t)[:, None] ** 2
    squat = tw.Motion(t, np.tile([0.0, 0.7, -1.4], 4) + bend * np.tile([0.0, 1.0, -2.0], 4), robot=held)
    answer = tw.check(held, squat, feet="auto", contact_friction=0.6)
    print(answer.headline)
    motion = answer.motion
    mass = motion.robot.mass_matrix(motion.robot.neutral)[3, 3]
    height = motion.robot.center_of_mass(motion.q)[:, 2]
    a = np.gradient(np.gradient(height, t), t)[30:70]
    assert answer.support.forces[30:70].sum(axis=1)[:, 2] == approx(mass * (a + 9.81), rel=2e-3)


def test_standing_on_one_foot():
    """Which torques hold a robot that stands on one foot?

    `statics.support` with the contacts of that foot: `torques` are those of the joints, with 0 at the free base.

    Source: pinocchio#1308.
    Number: the equation of motion, τ = g(q) − Jᵀf, with f the whole weight below the centre of mass.
    """
    leg = tw.ModelBuilder("leg")
    leg.add_link("foot", tw.SpatialInertia.box((0.2, 0.1, 0.05), mass=1.0))
    leg.add_link("shank", tw.SpatialInertia.from_com(2.0, (0.05, 0, 0.3), np.diag([0.02, 0.02, 0.01])))
    leg.add_joint("ankle", "revolute", "foot", "shank", axis=(0, 1, 0))
    robot = tw.Robot(leg.build(floating_base=True))
    sole = [statics.Contact((x, y, -0.025), friction=0.6, frame="foot") for x in (-0.1, 0.1) for y in (-0.05, 0.05)]
    found = statics.support(robot, np.r_[1, np.zeros(7)], np.zeros(7), np.zeros(7), sole)
    print(found.torques[0].round(4) + 0.0)
    assert found.torques[0] == approx([0, 0, 0, 0, 0, 0, -2.0 * 9.81 * 0.05], abs=1e-9)


def test_six_numbers_of_the_base():
    """What are the six numbers of the base in the torques of a floating robot?

    The wrench (m, f) that something else must give, because nothing drives the base. For a robot at rest it is its weight.

    Source: rbdl#34, RBDyn#51, bullet3#541, PhysX#46.
    Number: the sum of the masses times 9.81 m/s².
    """
    dog, q = standing_dog()
    tau = dog.inverse_dynamics(q, np.zeros(dog.nv), np.zeros(dog.nv))
    print(tau[:6].round(2))
    mass = sum(body.inertia.mass for body in dog.model.bodies)
    assert tau[3:6] == approx([0, 0, 9.81 * mass], abs=1e-9)


def test_force_on_the_mounting():
    """Which load does the robot put on its table or foundation over a motion?

    `statics.mounting_load`, or `tw.check(…, mounting=True, bolts="4x0.17")` and `--mounting --bolts` in the shell. The weight of the
    base link is part of it.

    Source: drake#12123, rbdl#56.
    Number: at rest, the masses of the file, 20.9939 kg with the base link, times 9.81 m/s².
    """
    ur5 = tw.robots.ur5()
    load = statics.mounting_load(ur5, np.zeros(6), np.zeros(6), np.zeros(6))
    print(load)
    assert load.wrench[0, 3:] == approx([0, 0, -9.81 * 20.9939])
    assert load.wrench[0, 1] == approx(
        -ur5.gravity_forces(np.zeros(6))[1]
    )  # the shoulder's axis meets that of the base


def test_does_it_tip():
    """Does my mobile robot tip over?

    `tw.check(robot, motion, wheels=…)` or `statics.support`: margins in speed and payload, or how it tips. A box of 6 kg on wheels
    0.4 m apart carries a load 0.8 m from its middle:

    Source: robocup-home#90 of RoBorregos, arXiv 2202.10186.
    Number: moments about the edge, 6 kg · 0.2 m / (0.8 m − 0.2 m) = 2 kg.
    """
    cart, q = tw.robots.floating_box(), [1, 0, 0, 0, 0, 0, 0.5]
    wheels = [statics.Contact((x, y, -0.5), friction=0.6, frame="box") for x in (-0.2, 0.2) for y in (-0.15, 0.15)]
    rest = statics.support(cart, q, np.zeros(6), np.zeros(6), wheels, payload_frame="box", payload_com=(0.8, 0, 0))
    over = statics.support(cart, q, np.zeros(6), [0, 0, 0, 5.0, 0, 0], wheels)
    print(rest, over.how, sep="\n")
    assert rest.payload == approx([2.0])
    assert over.how[0] == "tips"


def test_zero_moment_point():
    """Where is the zero moment point?

    `statics.support(…).zmp`, with its distance from the edge of the support polygon in `zmp_margin`.

    Source: rbdl-orb#2, hulk#1015, jskeus#423.
    Number: −h a / g for a centre of mass at the height h = 0.5 m, accelerated by a = 2 m/s².
    """
    cart, q = tw.robots.floating_box(), [1, 0, 0, 0, 0, 0, 0.5]
    wheels = [statics.Contact((x, y, -0.5), friction=0.6, frame="box") for x in (-0.2, 0.2) for y in (-0.15, 0.15)]
    found = statics.support(cart, q, np.zeros(6), [0, 0, 0, 2.0, 0, 0], wheels)
    print(found.zmp, found.zmp_margin)
    assert found.zmp == approx(np.array([[-0.5 * 2 / 9.81, 0]]), abs=1e-9)
    assert found.zmp_margin == approx([0.2 - 0.5 * 2 / 9.81])


def test_slip_in_the_gripper():
    """Does the load slip in the gripper while the arm moves?

    `tw.check(…, grip="FORCE,FRICTION")`; in the shell `--grip`. Two pads with 60 N and friction 0.5 hold at most 60 N.

    Source: bullet3#1936, mujoco_menagerie#235, ergoCub#39.
    Number: m (|a_t| / µ + |a_n|) / 2 over the motion, with a − g across and along the closing axis y of the tool.
    """
    answer = tw.check("ur5", "demo", payload=5, grip="60,0.5")
    print(answer.headline)
    motion, ur5 = answer.motion, tw.robots.ur5()
    a = ur5.frame_acceleration(motion.q, motion.dq, motion.ddq, "tool0", kind="world_aligned")[:, 3:] + [0, 0, 9.81]
    x, y, z = np.einsum("nji,nj->in", ur5.forward_kinematics(motion.q, "tool0")[:, :3, :3], a)
    needed = 5 * (np.hypot(x, z) / 0.5 + np.abs(y)) / 2
    assert answer.grip_force.max() == approx(needed.max(), rel=1e-6)
    assert motion.time[needed.argmax()] == approx(1.808)


def test_force_closure():
    """Does a grasp have force closure, and which wrench does it resist?

    `statics.hold(wrench, contacts)`: forces within the friction cones, or the motion that no contact resists. `push` limits the normal
    force of a finger.

    Source: dex-net#29, openrave#116.
    Number: two opposed fingers with friction µ and 10 N each hold a weight of 2 · µ · 10 N.
    """
    fingers = [
        statics.Contact((x, 0, 0), (-np.sign(x), 0, 0), friction=0.5, push=10.0, group=f"finger at {x}")
        for x in (-0.03, 0.03)
    ]
    weights = np.array([[0, 0, 0, 0, 0, -f] for f in (9.9, 10.1)])
    found = statics.hold(weights, fingers)
    print(found.holds, found.how)
    assert found.holds.tolist() == [True, False]


def test_strict_inequality_of_force_closure():
    """Why must all forces of a frictionless grasp be positive, and not only nonnegative, for force closure?

    Three frictionless contacts of a disc resist every force in the plane and no moment. The motion that proves it is a turn:

    Source: underactuated#241.
    Number: the lines of all contact forces meet in the centre, so that their moment about it is 0.
    """
    disc = [statics.Contact(np.r_[d, 0], -np.r_[d, 0], friction=0.0) for d in statics.bolt_circle(3, 2.0)]
    found = statics.hold(np.array([[0, 0, 0, 1.0, 0, 0], [0, 0, 1.0, 0, 0, 0]]), disc)
    print(found.holds, found.how[1])
    assert found.holds.tolist() == [True, False]
