"""Robots that are held or pushed: force and motion at a wall, and what an observer of momentum makes of a push."""

from __future__ import annotations

import numpy as np
import pytest
from controlled import Q6, Q, tasks

import twistwrench as tw
from twistwrench.control import PD, ComputedTorque, HybridMotionForce, MomentumObserver, TaskSpace
from twistwrench.simulation import Plane

WALL = 1.5
"""m along x."""


@pytest.fixture(scope="module")
def planar():
    return tw.robots.planar_3r()


@pytest.fixture(scope="module")
def ur5():
    return tw.robots.ur5()


@pytest.fixture(scope="module")
def wall(planar):
    return planar.close("ground", planar.tip, rows="vx", pose=tw.se3.exp([0, 0, 0, WALL, 0, 0]))


def lower(T, by):
    T = T.copy()
    T[2, 3] -= by
    return T


# ── motion and force ──


def test_the_force_is_the_one_asked_for_whatever_the_motion_law_says(planar, wall):
    """λ = λ_d in a closed robot's own equations, in motion, with a motion law that would leave the wall."""
    rng = np.random.default_rng(0)
    for _ in range(5):
        q = wall.consistent(Q + 0.1 * rng.normal(size=3), within=np.inf)
        dq, tau, lam = wall.project_velocity(q, rng.normal(size=3)), 20.0 * rng.normal(size=3), rng.normal(size=1)
        law = HybridMotionForce(wall, lambda t, q, dq, tau=tau: tau, force=lam)
        found = wall.forward_dynamics(q, dq, law(0.0, q, dq))
        free = wall.forward_dynamics(q, dq, tau)
        np.testing.assert_allclose(found.lam, lam, atol=1e-9)
        np.testing.assert_allclose(found.ddq, free.ddq, atol=1e-9)  # the motion is that of the law, as the wall lets it


def test_torques_of_motion_go_through_the_projector_and_those_of_force_beside_it(planar, wall):
    """P (τ - h) = P (τ_motion - h), and (1 - P)(τ - h) = A'(λ_d - (A M⁻¹ A')⁻¹ dA/dt dq)."""
    q = wall.consistent(Q)
    dq, tau = wall.project_velocity(q, [1.0, -0.5, 0.3]), np.array([10.0, -5.0, 3.0])
    law = HybridMotionForce(wall, lambda t, q, dq: tau, force=[7.0])
    h, P, A = planar.bias_forces(q, dq), wall.projector(q), wall.constraint_jacobian(q)
    given = law(0.0, q, dq) - h
    np.testing.assert_allclose(P @ given, P @ (tau - h), atol=1e-10)
    S = A @ np.linalg.solve(planar.mass_matrix(q), A.T)
    pressed = A.T @ (7.0 - np.linalg.solve(S, wall.constraint_bias(q, dq)))
    np.testing.assert_allclose(given - P @ given, pressed, atol=1e-10)


def test_sliding_along_a_rigid_wall_the_motion_error_decays_and_the_force_stays(planar, wall):
    """The closed robot's own motion by Runge and Kutta's method of order four, put back on the wall after each step."""
    q, dq = wall.consistent(Q), np.zeros(3)
    goal = lower(planar.forward_kinematics(q), 0.3)
    motion = TaskSpace(planar, goal, 64.0, 16.0, rows="wy vx vz", posture=q)
    law = HybridMotionForce(wall, motion, force=lambda t: [15.0 + 5.0 * np.sin(10.0 * t)])
    h, left, forces = 0.005, [], []

    def f(t, q, dq):
        ddq, lam = wall.forward_dynamics(q, dq, law(t, q, dq))
        forces.append((t, lam[0]))
        return dq, ddq

    for k in range(100):
        left.append(motion.task(0.0, q, dq).error)
        t = k * h
        a = f(t, q, dq)
        b = f(t + h / 2, q + h / 2 * a[0], dq + h / 2 * a[1])
        c = f(t + h / 2, q + h / 2 * b[0], dq + h / 2 * b[1])
        d = f(t + h, q + h * c[0], dq + h * c[1])
        q = q + h / 6 * (a[0] + 2 * b[0] + 2 * c[0] + d[0])
        dq = dq + h / 6 * (a[1] + 2 * b[1] + 2 * c[1] + d[1])
        q = wall.consistent(q)
        dq = wall.project_velocity(q, dq)
    t = h * np.arange(100)
    decay = (1 + 8.0 * t) * np.exp(-8.0 * t)
    np.testing.assert_allclose(np.array(left)[:, 2], -0.3 * decay, atol=1e-6)  # order four at ω h = 0.04
    np.testing.assert_allclose(np.array(left)[:, :2], 0.0, atol=1e-6)
    times, found = np.array(forces).T
    np.testing.assert_allclose(found, 15.0 + 5.0 * np.sin(10.0 * times), atol=1e-8)


STIFFNESS = 5e3
"""N/m."""


def slide(planar, wall, duration, push=None, **options):
    """Down a wall that yields, begun where it touches; what presses is found from how deep it is in."""
    q = wall.consistent(Q)
    motion = TaskSpace(planar, lower(planar.forward_kinematics(q), 0.2), 64.0, 16.0, rows="wy vx vz")
    plane = Plane("tip", normal=(-1, 0, 0), height=-WALL, stiffness=STIFFNESS, exponent=1.0, dissipation=4.0)
    law = HybridMotionForce(wall, motion, force=[20.0], **options)
    wrenches = {"tip": push} if push else None
    run = planar.simulate(q, None, duration, 0.02, tau=law, contacts=plane, wrench_on_robot=wrenches, rtol=1e-6)
    return run, STIFFNESS * (planar.forward_kinematics(run.q)[:, 0, 3] - WALL), motion


def test_at_a_wall_that_yields_the_force_is_reached_while_sliding(planar, wall):
    """The wall is in by 4 mm, which is all that the motion along it is off by besides its decay."""
    run, force, motion = slide(planar, wall, 1.0)
    error, _ = tasks(motion, run)
    assert force[-1] == pytest.approx(20.0, rel=1e-3)
    assert np.abs(force[25:] - 20.0).max() < 0.5  # sliding still, at up to 0.1 m/s
    decay = (1 + 8.0 * run.times) * np.exp(-8.0 * run.times)
    np.testing.assert_allclose(error[:, 2], -0.2 * decay, atol=4e-3)


@pytest.mark.slow
def test_force_feedback_leaves_of_an_unknown_push_one_part_in_one_plus_its_gain(planar, wall):
    """8 N off the wall that the law knows nothing of: λ - λ_d is -8 N without feedback, and -8 / (1 + K_f) N with it."""

    def push(t, q, dq):
        return np.r_[0, 0, 0, planar.forward_kinematics(q)[:3, :3].T @ [-8.0, 0, 0]]

    def felt(t, q, dq):
        return [STIFFNESS * max(0.0, planar.forward_kinematics(q)[0, 3] - WALL)]

    for K in (0.0, 3.0):
        _, force, _ = slide(planar, wall, 0.8, push, **({"force_gain": K, "measured": felt} if K else {}))
        assert force[-1] == pytest.approx(20.0 - 8.0 / (1.0 + K), abs=0.02)


# ── the observer ──


def test_a_residual_rises_to_the_push_with_its_time_constant(ur5):
    """r(t) = (1 - exp(-K t)) τ_ext, each joint with a K of its own, while the arm gives way."""
    push, K = np.array([4.0, -6.0, 5.0, 2.0, -1.0, 0.5]), np.array([5.0, 10, 20, 40, 80, 10])
    hold = ComputedTorque(ur5, Q6, 100.0, 20.0)
    for h, allowed in ((0.002, 2e-2), (0.001, 5e-3)):  # the trapezoidal rule: a quarter of it at half the step
        run = ur5.simulate(Q6, None, 0.3, h, controller=hold, tau=push, rtol=1e-9)
        given = run.tau - push
        found = MomentumObserver(ur5, K).over(run.times, run.q, run.dq, given)
        expected = (1 - np.exp(-np.outer(run.times, K))) * push
        np.testing.assert_allclose(found, expected, atol=allowed)
    at = 0.1  # 1/K of the second joint
    assert found[round(at / 0.001), 1] == pytest.approx((1 - np.exp(-1.0)) * push[1], rel=2e-3)


def test_without_a_push_the_residual_is_the_rounding_of_the_rule(ur5):
    law = ComputedTorque(ur5, Q6, 100.0, 20.0)
    run = ur5.simulate(Q6 + 0.3, 0.3 * np.ones(6), 0.2, 0.0005, controller=law, rtol=1e-10)
    found = MomentumObserver(ur5, 50.0).over(run.times, run.q, run.dq, run.tau)
    assert np.abs(found).max() < 2e-4 * np.abs(run.tau).max()


def test_watching_updating_and_going_over_a_record_are_one(planar):
    F, K = np.array([0, 0, 1.0, 5.0, -3.0, 0]), 30.0
    law, observer, updated = PD(planar, Q, 300.0, 60.0), MomentumObserver(planar, K), MomentumObserver(planar, K)
    run = planar.simulate(Q, None, 0.2, 0.002, controller=observer.watch(law), wrench_on_robot={"tip": F})
    over = observer.over(run.times, run.q, run.dq, run.tau)
    for k, (t, q, dq) in enumerate(zip(run.times, run.q, run.dq, strict=True)):
        r = updated.update(t, q, dq, run.tau[max(k - 1, 0)])
    np.testing.assert_array_equal(r, over[-1])
    np.testing.assert_array_equal(observer.residual, over[-2])  # a controller is not asked at the end
    observer.reset()
    assert not observer.residual.any()


def test_the_wrench_of_a_push_is_found_by_six_joints():
    drive = {"ratio": 101, "rotor": {"inertia": "40 g cm^2", "extra": True}}  # without rotors the wrists would whirl
    ur5 = tw.robots.ur5()
    ur5 = ur5.with_actuators({"actuators": dict.fromkeys(ur5.joint_names, drive)})
    F, observer = np.array([0.4, -0.3, 0.2, 6.0, -4.0, 8.0]), MomentumObserver(ur5, 60.0)
    hold = ComputedTorque(ur5, Q6, 100.0, 20.0)
    run = ur5.simulate(Q6, None, 0.5, 0.001, controller=observer.watch(hold), wrench_on_robot={"tool0": F}, rtol=1e-7)
    found = observer.wrench(run.q[-1])
    assert found.rank == 6
    assert found.blind.shape == (0, 6)
    np.testing.assert_allclose(found.wrench, F, atol=0.05)
    assert np.abs(found.unexplained).max() < 1e-9
    assert str(found).startswith("wrench on the robot at tool0: mx 0.")


def test_three_joints_feel_three_directions_and_say_which_they_do_not(planar):
    """A wrench of the plane is found, and the rest is said to be unknown: no torque knows of it."""
    F = np.array([0, 0, 1.0, 5.0, -3.0, 0])
    observer = MomentumObserver(planar, np.inf)
    r = planar.wrench_torques(Q, F)
    found = observer.wrench(Q, residual=r)
    assert found.rank == 3
    np.testing.assert_allclose(found.wrench, F, atol=1e-9)
    np.testing.assert_allclose(planar.jacobian(Q).T @ found.blind.T, 0.0, atol=1e-12)
    np.testing.assert_allclose(found.blind @ found.blind.T, np.eye(3), atol=1e-12)
    assert "3 directions are not observable" in str(found)


def test_what_is_not_felt_is_among_the_rows_that_are_looked_at(planar):
    """An arm in the plane feels no force across it, and of forces alone that is all it does not feel."""
    found = MomentumObserver(planar, np.inf).wrench(Q, rows="vx vy vz", residual=np.ones(3))
    assert found.rank == 2
    np.testing.assert_allclose(np.abs(found.blind), [[0, 0, 0, 0, 0, 1]], atol=1e-12)


def test_a_force_alone_needs_fewer_joints_and_a_contact_elsewhere_is_not_explained(ur5):
    """At the fourth link four joints feel a force there; the same torques are not a force at the tool."""
    f = np.array([0, 0, 0, 3.0, -5.0, 7.0])
    observer, r = MomentumObserver(ur5, np.inf), ur5.wrench_torques(Q6, f, "wrist_1_link")
    near = observer.wrench(Q6, "wrist_1_link", rows="vx vy vz", residual=r)
    np.testing.assert_allclose(near.wrench, f, atol=1e-9)
    assert near.rank == 3
    assert np.abs(near.unexplained).max() < 1e-9
    far = observer.wrench(Q6, "tool0", rows="vx vy vz", residual=r)
    assert np.abs(far.unexplained).max() > 0.1


def test_a_box_that_tumbles_feels_nothing_until_it_is_pushed():
    """A floating base, whose p and β are those of its body twist: τ_ext is the wrench in the box."""
    box, F = tw.robots.floating_box(), np.array([0.1, 0.05, -0.2, 1.0, -2.0, 0.5])
    begin = [1.0, 3.0, -2.0, 0.5, 0.2, 1.0]
    for push in (np.zeros(6), F):
        run = box.simulate(None, begin, 0.3, 4e-4, wrench_on_robot={"box": push}, rtol=1e-10)
        found = MomentumObserver(box, 50.0).over(run.times, run.q, run.dq, run.tau)
        np.testing.assert_allclose(found[-1], push, atol=1e-4)


def test_friction_is_part_of_the_residual_unless_it_is_known():
    drives = {"actuators": {"hinge": {"friction": {"viscous": "0.7 N m s/rad"}}}}
    wheel = tw.robots.pendulum().with_gravity([0, 0, 0]).with_actuators(drives)
    run = wheel.simulate([0.0], [2.0], 0.5, 1e-3, friction=True, rtol=1e-10)
    seen = MomentumObserver(wheel, np.inf).over(run.times, run.q, run.dq, run.tau)
    middle = 0.5 * (run.dq[1:] + run.dq[:-1])
    np.testing.assert_allclose(seen[1:], -0.7 * middle, atol=1e-6)
    known = MomentumObserver(wheel, np.inf, friction=True).over(run.times, run.q, run.dq, run.tau)
    np.testing.assert_allclose(known, 0.0, atol=1e-6)


@pytest.mark.parametrize("torque", [5.0, -3.0])
def test_friction_that_grows_with_the_load_is_taken_off_too(torque):
    """A wheel driven forward or braked: friction takes a tenth of what is left of the torque, and nothing else acts."""
    drives = {"actuators": {"hinge": {"friction": {"load": "0.1"}}}}
    wheel = tw.robots.pendulum().with_gravity([0, 0, 0]).with_actuators(drives)
    run = wheel.simulate([0.0], [2.0], 0.1, 1e-3, tau=[torque], friction=True, rtol=1e-10)
    known = MomentumObserver(wheel, np.inf, friction=True).over(run.times, run.q, run.dq, run.tau)
    np.testing.assert_allclose(known, 0.0, atol=1e-6)
    seen = MomentumObserver(wheel, np.inf).over(run.times, run.q, run.dq, run.tau)
    left = torque / 1.1 if torque > 0 else torque / 0.9
    np.testing.assert_allclose(seen[1:], left - torque, atol=1e-6)


def test_what_is_observed_can_be_made_up_for(planar):
    """An integrator's job without one: the residual taken off the torques leaves no error under a constant load."""
    F = np.array([0, 0, 2.0, 20.0, -15.0, 0])
    observer, law = MomentumObserver(planar, 10.0), ComputedTorque(planar, Q, 100.0, 20.0)
    controller = observer.watch(lambda t, q, dq: law(t, q, dq) - observer.residual)
    run = planar.simulate(Q, None, 3.0, 0.005, controller=controller, wrench_on_robot={"tip": F}, rtol=1e-6)
    assert np.abs(run.q[-1] - Q).max() < 1e-4
