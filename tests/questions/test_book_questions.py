"""Modern Robotics and other courses.

Pages: [Chapter 8](chapter-8.md), [the book's package](modern-robotics.md), [twists and wrenches](screws.md), [derive](derive.md).
"""

from __future__ import annotations

import numpy as np
from pytest import approx

import twistwrench as tw
from twistwrench import modern_robotics as mr

NOT_YET = {
    "How do I hand out a notebook that grades itself?": ("manipulation#541", "a checker of notebooks"),
}
"""Questions without an answer: source, and the capability that they need."""


def test_are_my_torques_right(shell):
    """Are my torques right?

    `twistwrench verify ROBOT` compares independent formulas at random states: recursion, energies, closed form, differences.

    Source: ModernRobotics#47, a two-link arm at MathWorks (2020).
    Number: the book's (8.9) with m = L = 1, at q = (0, π/2), θ̇ = (1, 2), θ̈ = (1, 1).
    """
    shell("twistwrench verify planar_2r")
    arm = tw.robots.planar_2r()
    tau = arm.inverse_dynamics([0, np.pi / 2], [1.0, 2.0], [1.0, 1.0])
    assert tau == approx([3 * 1 + 1 * 1 - (2 * 1 * 2 + 2**2) + 2 * 9.81, 1 + 1 + 1.0], abs=1e-12)


def test_library_against_simscape():
    """Is the gravity torque of another program the same as that of the book's package?

    Compare with `mr.GravityForces` or `robot.gravity_forces`; the page [errata](errata.md) lists known slips of published examples.

    Source: ModernRobotics#32.
    Number: the example of the book's package, GravityForces of its three-link robot at (0.1, 0.1, 0.1).
    """
    M = [np.eye(4), np.eye(4), np.eye(4), np.eye(4)]
    M[0][2, 3], M[1][:3, 3], M[2][:3, 3], M[3][2, 3] = 0.089159, (0.28, 0.13585, 0), (0, -0.1197, 0.395), 0.14225
    M[1][:3, :3] = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]
    G = [np.diag([*I, m, m, m]) for *I, m in ((0.010267, 0.010267, 0.00666, 3.7), (0.22689, 0.22689, 0.0151074, 8.393),
                                              (0.0494433, 0.0494433, 0.004095, 2.275))]  # fmt: skip
    S = np.array([[1, 0, 1, 0, 1, 0], [0, 1, 0, -0.089, 0, 0], [0, 1, 0, -0.089, 0, 0.425]]).T
    print(mr.GravityForces([0.1, 0.1, 0.1], [0, 0, -9.8], M, G, S))
    assert mr.GravityForces([0.1, 0.1, 0.1], [0, 0, -9.8], M, G, S) == approx([28.40331262, -37.64094817, -5.4415892])


def test_logarithm_of_an_imprecise_matrix():
    """What do MatrixLog3 and MatrixLog6 do with imprecise matrices?

    They stay finite and keep small angles: the logarithm uses the sine and the cosine of the angle, not the cosine alone.

    Source: ModernRobotics#12.
    Number: the angle of 1.6e-5 rad from which the matrix was made, rounded to nine digits.
    """
    R = np.round(mr.MatrixExp3(mr.VecToso3([0, 0, 1.6e-5])), 9)
    w = mr.so3ToVec(mr.MatrixLog3(R))
    print(w)
    assert w == approx([0, 0, 1.6e-5], abs=1e-9)


def test_screws_of_an_ar4():
    """Why do my screws give a wrong pose of the tool?

    Each screw is (ω, −ω × q) for a point q of its axis at the zero position, and M is the pose of the tip there.

    Source: kousheekc/Kinematics#8.
    Number: a point 2 m from a vertical axis turned by 90°, by hand.
    """
    S = tw.screws.screw_axis([0, 0, 1], point=[1, 0, 0])
    M = tw.se3.pose(np.eye(3), [3.0, 0, 0.5])
    print(S, mr.FKinSpace(M, S[:, None], [np.pi / 2])[:3, 3].round(9))
    assert mr.FKinSpace(M, S[:, None], [np.pi / 2])[:3, 3] == approx([1, 2, 0.5])


def test_one_link_by_code_and_by_the_book():
    """Why does the torque of one link differ between generated code and the book?

    A common cause is the moment of inertia: about the centre of mass or about the joint. Here both are right.

    Source: SymPyBotics#25.
    Number: (I + m r²) θ̈ + m g r cos θ by hand.
    """
    moment, m, r = 0.02, 1.5, 0.7
    link = tw.from_dh({"d": [0], "a": [r], "alpha": [0]}, masses=[m], coms=[(0, 0, 0)],
                      moments_about_com=[np.diag([moment, moment, moment])], gravity=[0, -9.81, 0])  # fmt: skip
    print(link.inverse_dynamics([0.3], [0.0], [2.0]))
    assert link.inverse_dynamics([0.3], [0.0], [2.0]) == approx([(moment + m * r**2) * 2 + m * 9.81 * r * np.cos(0.3)])


def test_formula_of_the_mass_matrix(shell):
    """How do I get the formula of the mass matrix?

    `twistwrench derive ROBOT`, or `tw.derive(robot).mass_matrix` in SymPy.

    Source: pinocchio#1047.
    Number: the book's (8.9).
    """
    import pytest

    sympy = pytest.importorskip("sympy")
    arm = tw.derive("planar_2r")
    print(arm.text("mass_matrix"))
    L1, L2, m2, th2 = sympy.symbols("L_1 L_2 m_2 theta_2")
    assert sympy.expand(arm.mass_matrix[0, 1] - m2 * (L1 * L2 * sympy.cos(th2) + L2**2)) == 0


def test_sign_of_a_screw():
    """Which sign has the screw of a joint, seen from the child?

    The twist of the child relative to its parent, in the axes of either: a positive rate turns the child about +ω. Seen from the
    child, the parent turns the other way.

    Source: GTDynamics#302.
    Number: the derivative of the pose, V = Ṫ T⁻¹, by differences.
    """
    S = tw.screws.screw_axis([0, 0, 1], point=[1, 2, 0])
    h = 1e-6
    dT = (tw.se3.exp(S * h) - tw.se3.exp(-S * h)) / (2 * h)
    print(tw.se3.vee(dT).round(6), S)
    assert tw.se3.vee(dT) == approx(S, abs=1e-9)


def test_rotate_or_move_a_wrench():
    """Do I rotate a wrench into another frame, or is it the transpose of the adjoint?

    `Ad(T_ab).T @ F_a` is F_b; a rotation alone is right only for frames with a common origin. `tw.Wrench` checks the frames.

    Source: analytical-wrench-cone#2.
    Number: moment r × f of a force of 3 N at 2 m.
    """
    T_ab = tw.se3.pose(np.eye(3), [2.0, 0, 0])
    F_b = np.array([0, 0, 0, 0, 3.0, 0])
    print(tw.Ad(tw.se3.inverse(T_ab)).T @ F_b)
    assert tw.Ad(tw.se3.inverse(T_ab)).T @ F_b == approx([0, 0, 6, 0, 3, 0])


def test_order_of_a_twist():
    """Is a twist (v, ω) or (ω, v)?

    Angular first here, as in the book. `tw.convert.swap_halves` changes the order of twists, wrenches and Jacobians.

    Source: hil-serl#36.
    Number: the same six numbers, halves exchanged.
    """
    print(tw.convert.swap_halves([0.2, 0.0, 0.1, 0.0, 0.0, 1.0]))
    assert tw.convert.swap_halves([0.2, 0.0, 0.1, 0.0, 0.0, 1.0]).tolist() == [0, 0, 1, 0.2, 0, 0.1]


def test_practice_exercises():
    """Are my numbers of the practice exercises of chapter 8 right?

    Code with the book's package runs with one import changed, `import twistwrench.modern_robotics as mr`, and all 47 functions.

    Source: practice exercises of Modern Robotics, chapter 8.
    Number: Euler's equations of a brick, I ω̇ + ω × I ω, by hand.
    """
    inertia, w, dw = np.diag([1.0, 2.0, 3.0]), np.array([1.0, 2.0, 3.0]), np.array([0.1, 0.2, 0.3])
    brick = tw.RigidBody(tw.SpatialInertia.from_com(1.0, moment_about_com=inertia))
    F = brick.wrench([*w, 0, 0, 0], [*dw, 0, 0, 0])
    print(F[:3])
    assert F[:3] == approx(inertia @ dw + np.cross(w, inertia @ w))
