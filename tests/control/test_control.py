"""Controllers in closed loop against their theory: how fast errors decay, where a load leaves them, how stiff a hand is."""

from __future__ import annotations

import numpy as np
import pytest
from controlled import Q6, TIGHT, Q, errors, second_order, tasks

import twistwrench as tw
from twistwrench import trajectories
from twistwrench.control import PD, ComputedTorque, Impedance, PoseMotion, TaskSpace
from twistwrench.mechanics.lie import se3


@pytest.fixture(scope="module")
def ur5():
    return tw.robots.ur5()


@pytest.fixture(scope="module")
def panda():
    return tw.robots.panda()


@pytest.fixture(scope="module")
def planar():
    return tw.robots.planar_3r()


# ── joints ──


COUPLED = 60.0 * np.eye(6) + 10.0 * np.ones((6, 6))


@pytest.mark.parametrize("kp", [100.0, np.linspace(20, 150, 6), COUPLED], ids=["number", "diagonal", "matrix"])
def test_computed_torque_errors_obey_their_linear_equation(ur5, kp):
    """Whatever the robot does meanwhile: here it follows sines, from a wrong place at a wrong velocity."""
    a, w = np.linspace(0.2, 0.5, 6), np.linspace(2, 4, 6)

    def sines(t):
        return Q6 + a * np.sin(w * t), a * w * np.cos(w * t), -a * w * w * np.sin(w * t)

    law = ComputedTorque(ur5, sines, kp, 14.0)
    run = ur5.simulate(Q6 + 0.3, np.zeros(6), 0.6, 0.05, tau=law, **TIGHT)
    expected = second_order(run.times, np.full(6, -0.3), a * w, kp, 14.0)
    np.testing.assert_allclose(errors(law, run), expected, atol=3e-8)


def test_computed_torque_follows_a_trajectory_without_error(ur5):
    moving = trajectories.move(ur5, Q6, Q6 + 0.8, trajectories.quintic(0.8))
    law = ComputedTorque(ur5, moving, 100.0, 20.0)
    run = ur5.simulate(Q6, np.zeros(6), 0.8, 0.1, tau=law, **TIGHT)
    np.testing.assert_allclose(run.q, moving(run.times)[0], atol=1e-8)


def test_computed_torque_with_a_payload_it_does_not_know_rests_where_its_gains_carry_it(ur5):
    """At rest M Kp e + g = g of the loaded robot: e = Kp⁻¹ M⁻¹ (g_loaded - g), M and g those of the model."""
    # On the upper arm: a wrist that feels a hundred times the inertia it knows of comes to no rest.
    loaded = ur5.with_payload(tw.SpatialInertia.from_com(3.0, (0.4, 0, 0.1)), "upper_arm_link")
    law = ComputedTorque(ur5, Q6, 100.0, 20.0)
    run = loaded.simulate(Q6, None, 3.0, 0.5, tau=law)
    q = run.q[-1]
    left = np.linalg.solve(ur5.mass_matrix(q), loaded.gravity_forces(q) - ur5.gravity_forces(q)) / 100.0
    assert np.abs(run.dq[-1]).max() < 1e-6
    assert np.abs(left).max() > 0.05
    np.testing.assert_allclose(Q6 - q, left, atol=1e-6)


def test_computed_torque_makes_up_for_friction_if_asked(planar):
    drives = {"actuators": {"joint1": {"friction": {"viscous": "4 N m s/rad"}}}}
    rusty = planar.with_actuators(drives)
    law = ComputedTorque(rusty, Q, 100.0, 20.0, friction=True)
    run = rusty.simulate(Q + 0.3, None, 0.5, 0.1, tau=law, friction=True, **TIGHT)
    np.testing.assert_allclose(errors(law, run), second_order(run.times, [-0.3] * 3, [0] * 3, 100, 20), atol=3e-8)


def test_held_torques_come_near_the_continuous_law_as_samples_come_closer(planar):
    law = ComputedTorque(planar, Q, 100.0, 20.0)
    off = []
    for dt in (0.004, 0.002):
        run = planar.simulate(Q + 0.3, None, 0.4, dt, controller=law)
        off.append(np.abs(errors(law, run) - second_order(run.times, [-0.3] * 3, [0] * 3, 100, 20)).max())
    assert off[0] / off[1] == pytest.approx(2.0, rel=0.1)


def test_pd_with_gravity_rests_without_error_and_loses_energy_to_its_damping_only(planar):
    """½ dq'M dq + ½ e'Kp e falls by what Kd takes, which is the work that energy and springs lack."""
    kp, kd = np.array([300.0, 200.0, 100.0]), np.array([60.0, 30.0, 10.0])
    law = PD(planar, Q, kp, kd)
    run = planar.simulate(Q + np.array([0.5, -0.4, 0.3]), None, 4.0, 2e-3, tau=law)
    np.testing.assert_allclose(run.q[-1], Q, atol=1e-6)
    e = Q - run.q
    stored = run.kinetic_energy + 0.5 * (e * e * kp).sum(axis=1)
    assert (np.diff(stored) < 1e-9).all()
    power = (run.dq**2 * kd).sum(axis=1)
    taken = np.sum(0.5 * (power[1:] + power[:-1]) * np.diff(run.times))
    assert taken == pytest.approx(
        stored[0] - stored[-1], rel=2e-3
    )  # the trapezoidal rule, with a first jerk of 1e4 rad/s³


def test_under_a_load_pd_yields_by_the_torque_over_its_stiffness(planar):
    kp, F = np.array([300.0, 200.0, 100.0]), np.array([0, 0, 2.0, 20.0, -15.0, 0])
    law = PD(planar, Q, kp, 30.0)
    run = planar.simulate(Q, None, 6.0, 0.5, tau=law, wrench_on_robot={"tip": F})
    q = run.q[-1]
    assert np.abs(run.dq[-1]).max() < 1e-6
    assert np.abs(Q - q).max() > 0.05
    np.testing.assert_allclose(Q - q, -planar.wrench_torques(q, F) / kp, atol=1e-6)


def test_without_gravity_compensation_pd_sags_by_gravity_over_its_stiffness(planar):
    law = PD(planar, Q, 300.0, 60.0, gravity=False)
    q = planar.simulate(Q, None, 6.0, 0.5, tau=law).q[-1]
    np.testing.assert_allclose(300.0 * (Q - q), planar.gravity_forces(q), atol=1e-4)


# ── a frame ──


def test_a_frame_called_to_a_pose_goes_there_on_one_screw_and_its_error_decays_as_one_number(ur5):
    """X_e(t) = (1 + ω t) exp(-ω t) X_e(0), however large: X_e stays on its ray, on which its rate is V_e itself."""
    T_d = ur5.forward_kinematics(Q6) @ se3.exp([0.5, -0.4, 0.6, 0.1, 0.2, -0.15])
    law = TaskSpace(ur5, T_d, kp=64.0, kd=16.0, kind="body")
    run = ur5.simulate(Q6, None, 0.4, 0.05, tau=law, **TIGHT)
    found, _ = tasks(law, run)
    decay = (1 + 8.0 * run.times) * np.exp(-8.0 * run.times)
    np.testing.assert_allclose(found, decay[:, None] * found[0], atol=1e-7)
    assert np.linalg.norm(found[0]) > 0.5


@pytest.mark.parametrize("path", [trajectories.screw_path, trajectories.straight_path])
def test_beside_a_moving_pose_the_error_obeys_the_books_equation(ur5, path):
    """dV_e/dt = -Kp X_e - Kd V_e and dX_e/dt = J_l⁻¹(X_e) V_e, integrated here by SciPy; gains a matrix, X_e not small."""
    from scipy.integrate import solve_ivp

    T = ur5.forward_kinematics(Q6)
    there = T @ se3.exp([0.4, 0.5, -0.3, 0.1, -0.1, 0.1])
    moving = PoseMotion(path(T @ se3.exp([0.2, 0.1, -0.2, 0.03, 0.02, 0.05]), there), trajectories.quintic(0.6))
    Kp = np.diag([50.0, 60, 70, 80, 90, 100]) + 5.0
    law = TaskSpace(ur5, moving, kp=Kp, kd=15.0, kind="body")
    run = ur5.simulate(Q6, 0.3 * np.ones(6), 0.3, 0.05, tau=law, **TIGHT)
    X, V = tasks(law, run)

    def f(_t, y):
        return np.r_[se3.left_jacobian_inverse(y[:6]) @ y[6:], -Kp @ y[:6] - 15.0 * y[6:]]

    found = solve_ivp(f, (0, 0.3), np.r_[X[0], V[0]], method="DOP853", rtol=1e-12, atol=1e-13, t_eval=run.times)
    np.testing.assert_allclose(np.c_[X, V], found.y.T, atol=1e-7)


def test_along_the_worlds_axes_moving_errors_are_linear_each_for_itself(ur5):
    """p_d - p of a frame whose reference moves and turns; three different gains."""
    T = ur5.forward_kinematics(Q6)
    path = trajectories.straight_path(T, T @ se3.exp([0.4, 0.5, -0.3, 0.1, -0.1, 0.1]))
    kp, kd = np.array([40.0, 40, 40, 50, 80, 120]), np.array([12.0, 12, 12, 10, 18, 20])
    law = TaskSpace(ur5, PoseMotion(path, trajectories.quintic(0.6)), kp, kd)
    run = ur5.simulate(Q6 + 0.05, 0.2 * np.ones(6), 0.3, 0.05, tau=law, **TIGHT)
    X, V = tasks(law, run)
    np.testing.assert_allclose(X[:, 3:], second_order(run.times, X[0, 3:], V[0, 3:], kp[3:], kd[3:]), atol=1e-7)
    assert np.abs(X[-1, :3]).max() < np.abs(X[0, :3]).max()


def test_turning_along_the_worlds_axes_decays_about_one_axis(ur5):
    T = ur5.forward_kinematics(Q6)
    T_d = T.copy()
    T_d[:3, :3] = tw.so3.exp([0.5, -0.7, 0.4]) @ T[:3, :3]
    law = TaskSpace(ur5, T_d, 64.0, 16.0)
    run = ur5.simulate(Q6, None, 0.5, 0.05, tau=law, **TIGHT)
    X, _ = tasks(law, run)
    decay = (1 + 8.0 * run.times) * np.exp(-8.0 * run.times)
    np.testing.assert_allclose(X[:, :3], decay[:, None] * [0.5, -0.7, 0.4], atol=1e-7)
    np.testing.assert_allclose(X[:, 3:], 0.0, atol=1e-7)


@pytest.mark.parametrize("kind", ["body", "world_aligned"])
def test_a_trajectory_of_the_joints_is_one_of_their_frame(ur5, kind):
    moving = trajectories.move(ur5, Q6, Q6 + 0.6, trajectories.quintic(0.8))
    law = TaskSpace(ur5, moving, 100.0, 20.0, kind=kind)
    run = ur5.simulate(Q6, None, 0.3, 0.1, tau=law, **TIGHT)
    np.testing.assert_allclose(run.q, moving(run.times)[0], atol=1e-7)


def test_a_posture_moves_what_the_task_leaves_free_and_nothing_else(panda):
    """Two postures, one motion of the tip; at last no torque of the posture is left in the null space, P M (q_r - q) = 0."""
    q0 = np.array([0.1, -0.5, 0.2, -2.0, 0.1, 1.6, 0.4])
    T_d = panda.forward_kinematics(q0)
    T_d[:3, 3] += [0.05, -0.1, 0.08]
    tips, ends = [], []
    for turned in (0.0, 0.5):
        posture = q0 + turned * np.array([1, 0, -1, 0.2, 1, 0, 1])
        law = TaskSpace(panda, T_d, 36.0, 12.0, rows="vx vy vz", posture=posture)
        run = panda.simulate(q0, None, 5.0, 0.1, tau=law)
        tips.append(panda.forward_kinematics(run.q)[:, :3, 3])
        ends.append(run.q[-1])
        J, M = panda.jacobian(run.q[-1], kind="world_aligned")[3:], panda.mass_matrix(run.q[-1])
        P = np.eye(7) - J.T @ np.linalg.solve(J @ np.linalg.solve(M, J.T), J @ np.linalg.inv(M))
        np.testing.assert_allclose(P @ M @ (posture - run.q[-1]), 0.0, atol=1e-6)
    np.testing.assert_allclose(tips[0], tips[1], atol=1e-7)
    assert np.abs(ends[1] - ends[0]).max() > 0.2
    decay = (1 + 6.0 * run.times) * np.exp(-6.0 * run.times)
    np.testing.assert_allclose(T_d[:3, 3] - tips[0], decay[:, None] * [0.05, -0.1, 0.08], atol=1e-7)


def test_without_a_posture_free_motions_come_to_rest(panda):
    q0 = np.array([0.1, -0.5, 0.2, -2.0, 0.1, 1.6, 0.4])
    law = TaskSpace(panda, panda.forward_kinematics(q0), 100.0, 20.0)
    run = panda.simulate(q0, 0.5 * np.ones(7), 2.5, 0.5, tau=law, rtol=1e-6)
    assert np.abs(run.dq[-1]).max() < 1e-6


def test_the_torques_are_the_books_with_the_projector(panda):
    """J'(Λ a + η) + P (M ddq_0 + h), from task_inertia, task_bias and a closed robot's projector."""
    q, dq = np.array([0.1, -0.5, 0.2, -2.0, 0.1, 1.6, 0.4]), np.linspace(-0.5, 0.5, 7)
    T_d = panda.forward_kinematics(q) @ se3.exp([0.1, 0.2, 0.3, 0.1, 0.1, 0.1])
    posture = q + 0.2
    law = TaskSpace(panda, T_d, 50.0, 10.0, kind="body", posture=posture, posture_kp=9.0, posture_kd=6.0)
    X_e, V_b = se3.log(se3.inverse(panda.forward_kinematics(q)) @ T_d), panda.frame_velocity(q, dq)
    a = 50.0 * X_e - 10.0 * V_b
    force = panda.task_inertia(q) @ a + panda.task_bias(q, dq)
    P = panda.constrain("panda_hand_tcp", None).projector(q)
    free = panda.inverse_dynamics(q, dq, 9.0 * (posture - q) - 6.0 * dq)
    np.testing.assert_allclose(law(0.0, q, dq), panda.jacobian(q).T @ force + P @ free, atol=1e-9)


# ── impedance ──


F_TIP = np.array([1.0, -2.0, 1.5, 12.0, -8.0, 10.0])
K6 = np.diag([40.0, 50, 60, 400, 500, 600])


def at_rest(run):
    return np.abs(run.dq[-1]).max() < 1e-5


def in_world(robot, q, F):
    R = robot.forward_kinematics(q)[:3, :3]
    return np.r_[R @ F[:3], R @ F[3:]]


def test_under_a_wrench_a_hand_yields_by_the_wrench_over_its_stiffness(ur5):
    """K X_e = -F at rest: the place is p_d + K⁻¹ f, and the turn K⁻¹ m."""
    T_d = ur5.forward_kinematics(Q6)
    mass = np.diag(K6) / 60.0
    law = Impedance(ur5, T_d, K6, 15.0 * mass, mass=mass, wrench_on_robot=lambda t, q, dq: F_TIP)
    run = ur5.simulate(Q6, None, 3.0, 0.5, tau=law, wrench_on_robot={"tool0": F_TIP})
    q = run.q[-1]
    assert at_rest(run)
    F = in_world(ur5, q, F_TIP)
    moved = ur5.forward_kinematics(q)[:3, 3] - T_d[:3, 3]
    assert np.linalg.norm(moved) > 0.02
    np.testing.assert_allclose(moved, F[3:] / np.diag(K6)[3:], atol=1e-6)
    turned = tw.so3.log(ur5.forward_kinematics(q)[:3, :3] @ T_d[:3, :3].T)
    np.testing.assert_allclose(turned, F[:3] / np.diag(K6)[:3], atol=1e-6)


def test_along_its_own_axes_a_hand_yields_the_same_way(ur5):
    T_d = ur5.forward_kinematics(Q6)
    mass = K6 / 60.0
    law = Impedance(ur5, T_d, K6, 15.0 * mass, kind="body", mass=mass, wrench_on_robot=lambda t, q, dq: F_TIP)
    run = ur5.simulate(Q6, None, 3.0, 0.5, tau=law, wrench_on_robot={"tool0": F_TIP})
    assert at_rest(run)
    X_e = se3.log(se3.inverse(ur5.forward_kinematics(run.q[-1])) @ T_d)
    np.testing.assert_allclose(K6 @ X_e, -F_TIP, atol=1e-4)


@pytest.mark.slow
def test_with_the_robots_own_inertia_a_hand_yields_just_as_much_and_nothing_is_measured(planar):
    T_d, F = planar.forward_kinematics(Q), np.array([0, 0, 3.0, 12.0, -8.0, 0])  # the plane is (x, y) of the tip
    K, B = np.array([20.0, 200.0, 300.0]), np.array([9.0, 60.0, 80.0])
    law = Impedance(planar, T_d, K, B, rows="wy vx vz")
    run = planar.simulate(Q, None, 7.0, 0.5, tau=law, wrench_on_robot={"tip": F}, rtol=1e-6)
    T = planar.forward_kinematics(run.q[-1])
    assert at_rest(run)
    F_s = in_world(planar, run.q[-1], F)
    np.testing.assert_allclose((T - T_d)[[0, 2], 3], F_s[[3, 5]] / K[1:], atol=1e-5)
    assert tw.so3.log(T[:3, :3] @ T_d[:3, :3].T)[1] == pytest.approx(F_s[1] / K[0], abs=1e-5)


def test_a_hand_with_a_mass_given_to_it_swings_at_the_root_of_stiffness_over_mass(planar):
    """Undamped and far from small: p_d - p = cos(√(k/m) t) e_0 along each axis by itself."""
    k, m, e = np.array([500.0, 200.0]), np.array([5.0, 8.0]), np.array([0.3, -0.2])
    T_d = planar.forward_kinematics(Q)
    T_d[[0, 2], 3] += e
    still = {"wrench_on_robot": lambda t, q, dq: np.zeros(6)}
    law = Impedance(planar, T_d, k, 0.0, mass=m, rows="vx vz", posture=Q, **still)
    run = planar.simulate(Q, None, 0.8, 0.02, tau=law)
    X, _ = tasks(law, run)
    np.testing.assert_allclose(X, e * np.cos(np.sqrt(k / m) * run.times[:, None]), atol=1e-6)


@pytest.mark.parametrize("mass", [None, 5.0])
@pytest.mark.parametrize("kind", ["world_aligned", "body"])
def test_a_hand_on_its_reference_has_the_acceleration_of_the_reference(ur5, kind, mass):
    """Without an error nothing yields, whatever the mass: d/dt V_d goes through to the frame."""
    T, dV = ur5.forward_kinematics(Q6), np.array([0.3, -0.8, 0.5, 1.0, -2.0, 0.7])
    measured = {} if mass is None else {"mass": mass, "wrench_on_robot": lambda t, q, dq: np.zeros(6)}
    law = Impedance(ur5, lambda t: (T, np.zeros(6), dV), 400.0, 30.0, kind=kind, **measured)
    ddq = ur5.forward_dynamics(Q6, np.zeros(6), law(0.0, Q6, np.zeros(6)))
    np.testing.assert_allclose(ur5.frame_acceleration(Q6, np.zeros(6), ddq), dV, atol=1e-9)


def test_a_pushed_hand_moves_as_the_mass_spring_and_damper_it_is_told_to_be(planar):
    """M_d ë + B ė + K e = -F from rest, F a constant force of the world, solved by the exponential of the matrix."""
    M_d, B, K = 5.0, 30.0, 400.0
    f = np.array([25.0, -10.0])

    def push(t, q, dq):
        R = planar.forward_kinematics(q)[:3, :3]
        return np.r_[0, 0, 0, R.T @ [f[0], 0, f[1]]]

    T_d = planar.forward_kinematics(Q)
    law = Impedance(planar, T_d, K, B, mass=M_d, wrench_on_robot=push, rows="vx vz", posture=Q)
    run = planar.simulate(Q, None, 0.7, 0.05, tau=law, wrench_on_robot={"tip": push})
    X, _ = tasks(law, run)
    np.testing.assert_allclose(X, second_order(run.times, f / K, [0, 0], K / M_d, B / M_d) - f / K, atol=1e-7)


def test_with_the_robots_own_inertia_small_swings_have_the_frequencies_of_stiffness_through_it(planar):
    """The generalised eigenvectors of K and Λ: each swings by itself, ω² the eigenvalue; what is left is of second order."""
    from scipy.linalg import eigh

    K = np.diag([500.0, 300.0])
    T_d = planar.forward_kinematics(Q)
    law = Impedance(planar, T_d, K, 0.0, rows="vx vz", posture=Q)
    squares, modes = eigh(K, planar.task_inertia(Q, kind="world_aligned", rows="vx vz"))
    J = planar.jacobian(Q, kind="world_aligned")[[3, 5]]
    M = planar.mass_matrix(Q)
    for w2, v in zip(squares, modes.T, strict=True):
        small = 1e-4 * v / np.abs(v).max()
        dq = np.linalg.solve(
            M, J.T @ planar.task_inertia(Q, kind="world_aligned", rows="vx vz") @ small
        )  # no self-motion
        run = planar.simulate(Q, np.sqrt(w2) * dq, 0.4, 0.02, tau=law, rtol=1e-8)
        X, _ = tasks(law, run)
        expected = -small * np.sin(np.sqrt(w2) * run.times)[:, None]
        np.testing.assert_allclose(X, expected, atol=1e-6)


def test_a_stretched_arm_is_controlled_in_the_directions_it_has(planar):
    """At the singular configuration Λ is the pseudo-inverse: torques stay finite, and the lost direction is left alone."""
    law = TaskSpace(planar, planar.forward_kinematics(Q), 100.0, 20.0, rows="vx vz")
    tau = law(0.0, [0, 0, 0], [0, 0, 0])
    assert np.isfinite(tau).all()
    ddq = planar.forward_dynamics([0, 0, 0], [0, 0, 0], tau)
    moved = (planar.jacobian([0, 0, 0], kind="world_aligned") @ ddq)[[3, 5]]
    wanted = 100.0 * (planar.forward_kinematics(Q) - planar.forward_kinematics([0, 0, 0]))[[0, 2], 3]
    np.testing.assert_allclose(moved, [0.0, wanted[1]], atol=1e-9)
