"""λ is what a cut joint would carry: against free bodies, Newton's and Euler's equations of each with its joint forces unknown.

No mass matrix and none of the library's dynamics are on that side.
"""

from __future__ import annotations

import numpy as np
import pytest
from mechanisms import COUPLER, CRANK, LEGS, MASSES, ROCKER, closed_platform, four_bar
from quick import mostly_slow

import twistwrench as tw
from twistwrench.mechanics.model.model import BASE
from twistwrench.testing import assert_close

G = 9.81
SOLVED = 1e-11
"""Two linear systems of a few dozen equations each, conditions below 1e4, rounding 1e-16; loops closed to 1e-14."""


def cross(r, f):
    return r[0] * f[1] - r[1] * f[0]


def free_bars(q, dq, tau):
    """Accelerations of the joints and the force of the coupler on the rocker, in the plane (x, z), from the three bars.

    Unknown: acceleration of the centre and angular acceleration of each bar, then the forces at the pins A (on the crank),
    B and C (on the coupler) and D (on the rocker).
    """
    phi = np.array([q[0], q[0] + q[1], q[2]])
    w = np.array([dq[0], dq[0] + dq[1], dq[2]])
    couples = np.array([tau[0] - tau[1], tau[1], tau[2]])
    half = 0.5 * np.array([CRANK, COUPLER, ROCKER])[:, None] * np.stack([np.cos(phi), np.sin(phi)], axis=1)
    lengths = np.array([CRANK, COUPLER, ROCKER])
    inertia = np.array(MASSES) * lengths**2 / 12 + 1e-4
    # (bar, place of the pin from its centre, pin, sign of the pin's force on this bar)
    ends = [(0, -half[0], 0, 1), (0, half[0], 1, -1), (1, -half[1], 1, 1), (1, half[1], 2, 1)]
    ends += [(2, half[2], 2, -1), (2, -half[2], 3, 1)]
    K, right = np.zeros((17, 17)), np.zeros(17)
    for bar in range(3):
        K[3 * bar : 3 * bar + 2, 3 * bar : 3 * bar + 2] = MASSES[bar] * np.eye(2)
        K[3 * bar + 2, 3 * bar + 2] = inertia[bar]
        right[3 * bar : 3 * bar + 3] = 0, -MASSES[bar] * G, couples[bar]
    for bar, r, pin, sign in ends:
        force, meet = 9 + 2 * pin, 9 + 2 * pin
        K[3 * bar, force], K[3 * bar + 1, force + 1] = -sign, -sign
        K[3 * bar + 2, force : force + 2] = -sign * np.array([-r[1], r[0]])
        # a + α × r - ω² r is the same for both bars at a pin, and zero at the ground's
        K[meet : meet + 2, 3 * bar : 3 * bar + 2] += sign * np.eye(2)
        K[meet : meet + 2, 3 * bar + 2] += sign * np.array([-r[1], r[0]])
        right[meet : meet + 2] += sign * w[bar] ** 2 * r
    # At C both signs belong to the force on the coupler, and the rocker's is the other.
    x = np.linalg.solve(K, right)
    alpha = x[2:9:3]
    return np.array([alpha[0], alpha[1] - alpha[0], alpha[2]]), -x[13:15], phi[2]


@pytest.mark.parametrize("seed", mostly_slow(range(5), 3))
def test_the_pin_of_a_four_bar_linkage_carries_what_its_free_bars_need(seed):
    rng = np.random.default_rng(seed)
    closed = four_bar().close("rocker_pin", "coupler_pin", "vx vz")
    q = closed.consistent(np.array([0.3, 0.4, 1.2]) + 0.2 * rng.standard_normal(3), tolerance=1e-14)
    dq = closed.project_velocity(q, 3 * rng.standard_normal(3))
    tau = 5 * rng.standard_normal(3)
    ddq, force, angle = free_bars(q, dq, tau)
    c, s = np.cos(angle), np.sin(angle)
    found = closed.forward_dynamics(q, dq, tau)
    assert_close(found.ddq, ddq, SOLVED, "q̈")
    assert_close(found.lam, [c * force[0] + s * force[1], -s * force[0] + c * force[1]], SOLVED, "λ, along the rocker")


def free_bodies(robot, q, dq, tau, loops):
    """q̈ and the forces in the ball joints, for any tree with loops: every body by itself, 12 unknowns each.

    Twists are propagated as V_i = Ad V_p + A dq, so dV_i = Ad dV_p + A ddq + ad(V_i) A dq.
    ``loops`` are pairs of frames; their force is that of the second's body on the first's, in the base's axes.
    """
    bodies = robot.model.bodies
    n = len(bodies)
    K, right = np.zeros((12 * n + 3 * len(loops),) * 2), np.zeros(12 * n + 3 * len(loops))
    V, up, R, drift, poses = [], [], [], [], []
    for i, body in enumerate(bodies):
        S = body.joint.axes.T
        T = body.placement @ body.joint.pose(q[body.q_index : body.q_index + body.joint.nq])
        poses.append(T if body.parent == BASE else poses[body.parent] @ T)
        up.append(tw.Ad(tw.se3.inverse(T)).matrix)
        Adq = S @ dq[body.v_index : body.v_index + body.joint.nv]
        V.append(Adq if body.parent == BASE else up[i] @ V[body.parent] + Adq)
        drift.append(tw.ad(V[i]) @ Adq)
        R.append(poses[i][:3, :3])
        g = R[i].T @ robot.gravity
        I = body.inertia
        motion, wrench = slice(6 * i, 6 * i + 6), slice(6 * n + 6 * i, 6 * n + 6 * i + 6)
        K[motion, motion] = I.matrix
        K[motion, wrench] = -np.eye(6)
        right[motion] = tw.ad(V[i]).T @ (I.matrix @ V[i]) + np.r_[np.cross(I.first_moment, g), I.mass * g]
        if body.parent != BASE:
            K[6 * body.parent : 6 * body.parent + 6, wrench] = up[i].T
        across = np.linalg.svd(S, full_matrices=True)[0][:, body.joint.nv :].T  # what the joint does not let move
        rows = slice(6 * n + 6 * i, 6 * n + 6 * i + len(across))
        K[rows, motion] = across
        if body.parent != BASE:
            K[rows, 6 * body.parent : 6 * body.parent + 6] = -across @ up[i]
        right[rows] = across @ drift[i]
        powered = slice(rows.stop, 6 * n + 6 * i + 6)
        K[powered, wrench] = S.T
        right[powered] = tau[body.v_index : body.v_index + body.joint.nv]
    for m, pair in enumerate(loops):
        force = slice(12 * n + 3 * m, 12 * n + 3 * m + 3)
        for name, sign in zip(pair, (1, -1), strict=True):
            frame = robot.model.frame(name)
            i, r = frame.body, frame.pose[:3, 3]
            hat = tw.so3.hat(r)
            K[6 * i : 6 * i + 3, force] = -sign * hat @ R[i].T
            K[6 * i + 3 : 6 * i + 6, force] = -sign * R[i].T
            K[force, 6 * i : 6 * i + 6] = sign * R[i] @ np.c_[-hat, np.eye(3)]
            w, v = V[i][:3], V[i][3:]
            right[force] -= sign * R[i] @ np.cross(w, v + np.cross(w, r))
    x = np.linalg.solve(K, right)
    ddq = np.zeros(robot.nv)
    for i, body in enumerate(bodies):
        carried = 0.0 if body.parent == BASE else up[i] @ x[6 * body.parent : 6 * body.parent + 6]
        mine = np.linalg.lstsq(body.joint.axes.T, x[6 * i : 6 * i + 6] - carried - drift[i], rcond=None)[0]
        ddq[body.v_index : body.v_index + body.joint.nv] = mine
    return ddq, x[12 * n :].reshape(-1, 3)


@pytest.mark.parametrize("seed", mostly_slow(range(3), 3))
def test_the_ball_joints_of_a_platform_carry_what_its_free_bodies_need(seed):
    rng = np.random.default_rng(seed)
    closed, q = closed_platform()
    robot = closed.open()
    q = closed.consistent(robot.add(q, 0.1 * rng.standard_normal(robot.nv)), tolerance=1e-14, within=1.0)
    dq, tau = closed.project_velocity(q, rng.standard_normal(robot.nv)), 3 * rng.standard_normal(robot.nv)
    ddq, forces = free_bodies(robot, q, dq, tau, [(f"socket{k}", f"foot{k}") for k in range(LEGS)])
    found = closed.forward_dynamics(q, dq, tau)
    assert_close(found.ddq, ddq, SOLVED, "q̈")
    wrenches = closed.wrenches(found.lam)
    for k in range(LEGS):
        R = robot.forward_kinematics(q, f"socket{k}")[:3, :3]
        assert_close(wrenches[f"socket{k}–foot{k}"], np.r_[0, 0, 0, R.T @ forces[k]], SOLVED, f"ball joint {k}")


def test_a_hand_that_rests_on_the_floor_presses_down_on_it():
    """The sign, said with numbers: a rod hinged at one end on a table, horizontal, puts half its weight on the other."""
    closed = four_bar().lock({"b": 0.0, "d": 0.0}).close("ground", "coupler_pin", "vz")
    q, still = np.zeros(1), np.zeros(1)
    reach, weight = CRANK + COUPLER, G * np.array(MASSES[:2])
    expected = (weight[0] * 0.5 * CRANK + weight[1] * (CRANK + 0.5 * COUPLER)) / reach
    found = closed.forward_dynamics(q, still, still)
    assert_close(found.ddq, [0.0], 1e-12, "it rests", scale=1.0)
    assert_close(found.lam, [-expected], 1e-13, "λ is what the robot applies to the ground, down")
    on = closed.open().forward_dynamics(
        q, still, still, wrench_by_robot={"coupler_pin": closed.wrenches(found.lam)["ground–coupler_pin"]}
    )
    assert_close(on, found.ddq, 1e-12, "λ as a wrench by the robot", scale=1.0)


def test_a_hand_that_slides_on_the_floor_while_it_turns_stays_on_it():
    """Its height along q + dq t + ddq t²/2 has no second derivative, though it moves along the floor, where nothing holds it."""
    arm = tw.robots.planar_2r()
    closed = arm.close("ground", "tip", "vz")
    q = closed.consistent([0.4, -0.9])
    dq = closed.project_velocity(q, [3.0, 4.0])
    ddq = closed.forward_dynamics(q, dq, [3.0, -2.0]).ddq
    V = arm.frame_velocity(q, dq, "tip", kind="world_aligned")
    assert abs(V[1]) > 0.5 and abs(V[3]) > 0.5  # a turn and a slide, whose product is the centripetal part
    h = 1e-3
    below, there, above = (arm.forward_kinematics(q + dq * t + ddq * t**2 / 2, "tip")[2, 3] for t in (-h, 0.0, h))
    assert abs(below - 2 * there + above) / h**2 < 1e-4
