"""The numbers of Modern Robotics (Lynch and Park, 2017): worked examples, closed forms, and the book's own package.

Tolerances. PRINTED: the numbers come with the digits they were printed with, about eight. EXACT: formulas evaluated in
float64 on both sides, a few dozen operations each.
"""

from __future__ import annotations

import numpy as np
import pytest
from quick import mostly_slow

import twistwrench as tw
from twistwrench.mechanics.model.builder import ModelBuilder
from twistwrench.testing import assert_close, random_state

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")

PRINTED, EXACT = 1e-8, 1e-12


# ── the planar 2R arm of section 8.1, both links of length 1 with a point mass 1 at their ends ──


@pytest.fixture(scope="module")
def arm():
    return tw.robots.planar_2r()


def test_mass_matrix_of_the_bent_2r_arm(arm):
    assert_close(arm.mass_matrix([0.0, np.pi / 2]), [[3.0, 1.0], [1.0, 1.0]], EXACT, "M at θ₂ = 90°")
    # Figure 8.2 prints three decimals.
    expected = [[1.268, 0.134], [0.134, 1.0]]
    assert_close(arm.mass_matrix([0.0, np.deg2rad(150)]), expected, 5e-4, "M at θ₂ = 150°")


@pytest.mark.parametrize(
    ("degrees", "expected", "rtol"),
    [
        (90, [[1.0, 0.0], [0.0, 2.0]], EXACT),
        (150, [[4.0, -1.732], [-1.732, 2.0]], 5e-4),
    ],  # the second has three decimals
)
def test_inertia_felt_at_the_hand_of_the_2r_arm(arm, degrees, expected, rtol):
    """Λ = J⁻ᵀ M J⁻¹ on the two linear rows of its plane, which is x-z here. MR section 8.1.3."""
    q = [0.0, np.deg2rad(degrees)]
    J_inverse = np.linalg.inv(arm.jacobian(q, kind="world_aligned")[[3, 5]])
    assert_close(J_inverse.T @ arm.mass_matrix(q) @ J_inverse, expected, rtol, "Λ")


def two_links(L1, L2, m1, m2, g):
    """The 2R arm of figure 8.1 in the x-y plane, gravity along -y."""
    builder = ModelBuilder("2R")
    builder.add_link("base")
    builder.add_link("link1", tw.SpatialInertia.from_com(m1, (L1, 0, 0)))
    builder.add_link("link2", tw.SpatialInertia.from_com(m2, (L2, 0, 0)))
    builder.add_joint("joint1", "revolute", "base", "link1", axis=(0, 0, 1))
    elbow = np.eye(4)
    elbow[0, 3] = L1
    builder.add_joint("joint2", "revolute", "link1", "link2", axis=(0, 0, 1), placement=elbow)
    return tw.Robot(builder.build(gravity=(0, -g, 0)))


def test_torques_of_the_2r_arm_term_by_term():
    """MR eq. 8.9, every term by itself."""
    L1, L2, m1, m2, g = 0.7, 0.4, 2.0, 1.5, 9.81
    robot = two_links(L1, L2, m1, m2, g)
    for (t1, t2), (d1, d2), (a1, a2) in zip(*np.random.default_rng(0).standard_normal((3, 5, 2)), strict=True):
        c1, c2, s2, c12 = np.cos(t1), np.cos(t2), np.sin(t2), np.cos(t1 + t2)
        M = [
            [m1 * L1**2 + m2 * (L1**2 + 2 * L1 * L2 * c2 + L2**2), m2 * (L1 * L2 * c2 + L2**2)],
            [m2 * (L1 * L2 * c2 + L2**2), m2 * L2**2],
        ]
        c = [-m2 * L1 * L2 * s2 * (2 * d1 * d2 + d2**2), m2 * L1 * L2 * d1**2 * s2]
        grav = [(m1 + m2) * L1 * g * c1 + m2 * g * L2 * c12, m2 * g * L2 * c12]
        assert_close(robot.mass_matrix([t1, t2]), M, EXACT, "M")
        assert_close(robot.coriolis_forces([t1, t2], [d1, d2]), c, EXACT, "c", scale=1.0)  # terms of order m L² dq²
        assert_close(robot.gravity_forces([t1, t2]), grav, EXACT, "g")
        tau = robot.inverse_dynamics([t1, t2], [d1, d2], [a1, a2])
        assert_close(tau, np.dot(M, [a1, a2]) + c + grav, EXACT, "τ", scale=np.abs(grav).max() + 1)


def test_kinetic_energy_of_the_2r_arm_has_the_cross_term_of_the_second_link():
    """2 (L₂² + L₁L₂ cosθ₂) θ̇₁θ̇₂; sources that write L₁² there are wrong."""
    L1, L2, m1, m2 = 0.7, 0.4, 2.0, 1.5
    robot = two_links(L1, L2, m1, m2, 9.81)
    t2, d1, d2 = 0.6, 0.8, -0.5
    c2 = np.cos(t2)
    K1 = 0.5 * m1 * L1**2 * d1**2
    K2 = (L1**2 + 2 * L1 * L2 * c2 + L2**2) * d1**2 + 2 * (L2**2 + L1 * L2 * c2) * d1 * d2 + L2**2 * d2**2
    assert_close(robot.kinetic_energy([0.3, t2], [d1, d2]), K1 + 0.5 * m2 * K2, EXACT, "K")


# ── the three-link robot of the book's package, whose first screw has length √2 ──

LISTS = {
    "M": None,
    "Slist": np.array([[1, 0, 1, 0, 1, 0], [0, 1, 0, -0.089, 0, 0], [0, 1, 0, -0.089, 0, 0.425]]).T,
    "Mlist": np.array(
        [
            [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.089159], [0, 0, 0, 1]],
            [[0, 0, 1, 0.28], [0, 1, 0, 0.13585], [-1, 0, 0, 0], [0, 0, 0, 1]],
            [[1, 0, 0, 0], [0, 1, 0, -0.1197], [0, 0, 1, 0.395], [0, 0, 0, 1]],
            [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.14225], [0, 0, 0, 1]],
        ]
    ),
    "Glist": np.array(
        [
            np.diag([0.010267, 0.010267, 0.00666, 3.7, 3.7, 3.7]),
            np.diag([0.22689, 0.22689, 0.0151074, 8.393, 8.393, 8.393]),
            np.diag([0.0494433, 0.0494433, 0.004095, 2.275, 2.275, 2.275]),
        ]
    ),
}
GRAVITY = np.array([0, 0, -9.8])
Q, DQ, DDQ, F_TIP = np.full(3, 0.1), np.array([0.1, 0.2, 0.3]), np.array([2, 1.5, 1]), np.ones(6)


@pytest.fixture(scope="module")
def three_links():
    return tw.from_screws(**LISTS, gravity=GRAVITY, non_unit_screws=True)


def test_the_books_screw_of_length_root_two_is_refused_by_default():
    with pytest.raises(tw.ModelError, match=r"screw 1 .*joint1.*1\.41421.*non_unit_screws=True"):
        tw.from_screws(**LISTS, gravity=GRAVITY)


def test_a_screw_of_nearly_unit_length_is_refused_with_the_digits_that_differ(tmp_path):
    """The tolerance is 1e-6: a message that a length is 1, not 1, would help nobody."""
    Slist = np.array([[0.0, 0.0, 1.000002, 0.0, 0.0, 0.0]]).T
    with pytest.raises(tw.ModelError, match=r"has length 1\.000002, not 1\."):
        tw.from_screws(np.eye(4), Slist, [np.eye(4)] * 2, [np.eye(6)])
    robot = tw.from_screws(np.eye(4), Slist, [np.eye(4)] * 2, [np.eye(6)], non_unit_screws=True)
    with pytest.raises(tw.ModelError, match=r"a screw axis of length 1\.000002,"):
        tw.save(robot, tmp_path / "robot.urdf")


def test_numbers_of_the_books_three_link_robot(three_links):
    robot = three_links
    tip = {robot.tip: F_TIP}
    tau = robot.inverse_dynamics(Q, DQ, DDQ, wrench_by_robot=tip)
    assert_close(tau, [74.69616155, -33.06766016, -3.23057314], PRINTED, "τ")
    M = [
        [22.5433380, -0.307146754, -0.00718426391],
        [-0.307146754, 1.96850717, 0.432157368],
        [-0.00718426391, 0.432157368, 0.191630858],
    ]
    assert_close(robot.mass_matrix(Q), M, PRINTED, "M")
    # Printed with eight decimals: half of the last one.
    assert_close(robot.coriolis_forces(Q, DQ), [0.26453118, -0.05505157, -0.00689132], 1e-8, "c", scale=1.0)
    assert_close(robot.gravity_forces(Q), [28.40331262, -37.64094817, -5.4415892], PRINTED, "g")
    assert_close(robot.wrench_torques(Q, F_TIP), [1.40954608, 1.85771497, 1.392409], PRINTED, "JᵀF")
    ddq = robot.forward_dynamics(Q, DQ, [0.5, 0.6, 0.7], wrench_by_robot=tip)
    assert_close(ddq, [-0.97392907, 25.58466784, -32.91499212], PRINTED, "θ̈")


def test_forward_dynamics_trajectory_of_the_books_package(three_links):
    """The example in the docstring of ``ForwardDynamicsTrajectory``: ten rows of torque, eight Euler steps a row."""
    torques = np.array(
        [
            [3.63, -6.58, -5.57], [3.74, -5.55, -5.5], [4.31, -0.68, -5.19], [5.18, 5.63, -4.31], [5.85, 8.17, -2.59],
            [5.78, 2.79, -1.7], [4.99, -5.3, -1.19], [4.08, -9.41, 0.07], [3.56, -10.1, 0.97], [3.49, -9.41, 1.23],
        ]
    )  # fmt: skip
    q, dq, step = Q.copy(), DQ.copy(), 0.1 / 8
    for tau in torques[:-1]:  # the last row of torque leads to no further row of motion
        for _ in range(8):
            ddq = three_links.forward_dynamics(q, dq, tau, wrench_by_robot={three_links.tip: F_TIP})
            q, dq = q + step * dq, dq + step * ddq
    # Printed with seven decimals; the motion amplifies rounding, 1e-16, by no more than a million in 72 steps.
    assert_close(q, [-0.4638099, 3.6317879, -7.6319005], 5e-8, "last θ")
    assert_close(dq, [-0.1455669, -4.5714998, -3.4313511], 5e-8, "last θ̇")


# ── Puma 560, by its Denavit–Hartenberg parameters ──


def test_gravity_torques_of_the_puma_560():
    half = np.pi / 2
    rows = [  # d, a, alpha, mass, centre of mass in the link's frame
        (0.67183, 0.0, half, 0.0, (0, 0, 0)),
        (0.0, 0.4318, 0.0, 17.4, (-0.3638, 0.006, 0.2275)),
        (0.15005, 0.0203, -half, 4.8, (-0.0203, -0.0141, 0.07)),
        (0.4318, 0.0, half, 0.82, (0, 0.019, 0)),
        (0.0, 0.0, -half, 0.34, (0, 0, 0)),
        (0.0, 0.0, 0.0, 0.09, (0, 0, 0.032)),
    ]
    builder = ModelBuilder("puma560")
    builder.add_link("link0")
    for i, (d, a, alpha, mass, com) in enumerate(rows, start=1):
        # Standard DH turns about z first and then moves by (d, a, alpha): the joint turns a bare link, the rest is fixed.
        builder.add_link(f"turned{i}")
        builder.add_link(f"link{i}", tw.SpatialInertia.from_com(mass, com))
        builder.add_joint(f"joint{i}", "revolute", f"link{i - 1}", f"turned{i}", axis=(0, 0, 1))
        rest = tw.se3.exp([0, 0, 0, a, 0, d]) @ tw.se3.exp([alpha, 0, 0, 0, 0, 0])
        builder.add_joint(f"dh{i}", "fixed", f"turned{i}", f"link{i}", placement=rest)
    puma = tw.Robot(builder.build())
    g = puma.gravity_forces([0, np.pi / 4, np.pi, 0, np.pi / 4, 0])
    # Four decimals; joint 2 by itself decides the largest entry.
    assert_close(g, [0, 31.6399, 6.0351, 0, 0.0283, 0], 5e-5, "g", scale=1.0)


# ── the book's own package ──


@pytest.mark.parametrize(
    ("name", "at_com"), mostly_slow([("ur5", False), ("ur5", True), ("panda", False), ("panda", True)], 3)
)
def test_the_books_package_agrees_on_our_screws(name, at_com):
    """Its functions on our Slist, Mlist, Glist. 1e-9: its own recursion, whose matrix exponentials cut at 1e-6."""
    mr = pytest.importorskip("modern_robotics", reason="the book's package is not installed")
    robot = serial(getattr(tw.robots, name)())
    lists = robot.screws_at_com() if at_com else robot.screws
    if at_com:
        assert_close([np.diag(np.diag(G)) for G in lists.Glist], lists.Glist, EXACT, "diagonal G")
    chain = robot.gravity, list(lists.Mlist), list(lists.Glist), lists.Slist
    rng = np.random.default_rng(1)
    for _ in range(3):
        (q, dq, ddq), F = random_state(robot, rng), rng.standard_normal(6)
        g, Mlist, Glist, Slist = chain
        theirs = mr.InverseDynamics(q, dq, ddq, g, F, Mlist, Glist, Slist)
        assert_close(robot.inverse_dynamics(q, dq, ddq, wrench_by_robot={robot.tip: F}), theirs, 1e-9, "τ")
        assert_close(robot.mass_matrix(q), mr.MassMatrix(q, Mlist, Glist, Slist), 1e-9, "M")
        assert_close(robot.coriolis_forces(q, dq), mr.VelQuadraticForces(q, dq, Mlist, Glist, Slist), 1e-9, "c")
        assert_close(robot.gravity_forces(q), mr.GravityForces(q, g, Mlist, Glist, Slist), 1e-9, "g")
        assert_close(robot.wrench_torques(q, F), mr.EndEffectorForces(q, F, Mlist, Glist, Slist), 1e-9, "JᵀF")
        assert_close(robot.forward_kinematics(q), mr.FKinSpace(lists.M, Slist, q), 1e-9, "T")
        assert_close(robot.jacobian(q, kind="space"), mr.JacobianSpace(Slist, q), 1e-9, "J_s")
        assert_close(robot.jacobian(q), mr.JacobianBody(lists.Blist, q), 1e-9, "J_b")


def serial(robot):
    """The arm alone: fingers, where it has some, held where they are."""
    return robot.lock({n: 0.0 for n in robot.joint_names if "finger" in n})


@pytest.mark.parametrize("at_com", [False, True])
def test_a_robot_of_its_own_screws_is_the_same_robot(at_com):
    ur5 = tw.robots.ur5()
    lists = ur5.screws_at_com() if at_com else ur5.screws
    back = tw.from_screws(lists.M, lists.Slist, lists.Mlist, lists.Glist)
    state = random_state(ur5, 2)
    assert_close(back.inverse_dynamics(*state), ur5.inverse_dynamics(*state), 1e-11, "τ")
