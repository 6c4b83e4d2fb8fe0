"""The laws of constraints on random trees of every joint kind: the rows of A, their rates, and the motion that keeps them."""

from __future__ import annotations

import numpy as np
import pytest
from quick import mostly_slow
from random_trees import DIFFERENCES, ROUNDING, frames

import twistwrench as tw
from twistwrench.mechanics.algorithms.constraints import Closure, Rolling
from twistwrench.testing import assert_close, derivative

pytest_plugins = ("random_tree_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")

ROWS = ("wx", "wy", "wz", "vx", "vy", "vz")


def loops(robot, rng):
    """Closures between frames of a tree, and rolling frames, wherever they are; every row."""
    every = tuple(range(6))
    pose = tuple(map(tuple, tw.se3.exp(rng.standard_normal(6)).tolist()))
    names = frames(robot, 4)
    pairs = [(a, b) for a, b in zip(names, [*names[1:], "ground"], strict=True)]
    return tuple(Closure(a, b, every, pose) for a, b in pairs), tuple(Rolling(f, every, "body") for f in names[:2])


def test_the_jacobian_of_a_loop_is_the_rate_of_its_pose(robot, state, rng):
    q, dq, _ = state
    closures, _ = loops(robot, rng)
    poses = robot.kernel("closure_poses", constraints=closures)
    V = (robot.kernel("constraint_jacobian", constraints=closures)(q) @ dq).reshape(-1, 6)
    T, dT = poses(q), derivative(lambda t: poses(robot.add(q, np.multiply.outer(t, dq))), np.abs(dq).sum() + 1)
    w = tw.so3.vee(dT[:, :3, :3] @ np.swapaxes(T[:, :3, :3], 1, 2))  # [w] = dR/dt R'
    assert_close(V, np.concatenate([w, dT[:, :3, 3]], axis=1), DIFFERENCES, "V_cb", scale=max(1.0, np.abs(dT).max()))


def test_the_bias_is_the_rate_of_the_jacobian_times_the_velocity(robot, state, rng):
    q, dq, _ = state
    held = sum(loops(robot, rng), ())
    A = robot.kernel("constraint_jacobian", constraints=held)
    b = robot.kernel("constraint_bias", constraints=held)(q, dq)
    rate = derivative(lambda t: A(robot.add(q, np.multiply.outer(t, dq))) @ dq, np.abs(dq).sum() + 1)
    assert_close(b, rate, DIFFERENCES, "(dA/dt) dq", scale=max(1.0, np.abs(rate).max(), np.abs(A(q) @ dq).max()))


def test_the_pose_of_a_loop_is_that_of_its_frames(robot, state, rng):
    closures, _ = loops(robot, rng)
    found = robot.kernel("closure_poses", constraints=closures)(state.q)
    where = {name: robot.forward_kinematics(state.q, name) for name in robot.frame_names} | {"ground": np.eye(4)}
    for c, T in zip(closures, found, strict=True):
        expected = tw.se3.inverse(where[c.frame_a] @ c.T_ac) @ where[c.frame_b]
        assert_close(T, expected, ROUNDING, c.name, scale=max(1.0, np.abs(expected).max()))


def test_any_tree_closed_anywhere_moves_by_the_equations(robot, state, rng):
    """Two frames of a random tree held where they are, on random rows: redundant rows are accepted, and still met."""
    q, dq, _ = state
    names = [name for name in robot.frame_names if robot.model.frames[name].body >= 0]
    a, b = names[-1], names[0]
    if robot.model.frames[a].body == robot.model.frames[b].body:
        b = "ground"
    pose_of = {name: robot.forward_kinematics(q, name) for name in names} | {"ground": np.eye(4)}
    rows = [("vx", "vy", "vz"), ("wx", "wy", "vx"), ROWS][rng.integers(3)]
    pose = tw.se3.inverse(pose_of[a]) @ pose_of[b]
    closed = robot.close(a, b, rows, pose=pose, near=q, redundant="accept")
    assert np.abs(closed.constraint_error(q)).max() < 1e-12
    dq = closed.project_velocity(q, dq)
    tau = rng.standard_normal(robot.nv)
    ddq, lam = closed.forward_dynamics(q, dq, tau)
    A, h = closed.constraint_jacobian(q), robot.bias_forces(q, dq)
    pressed = A.T @ lam
    scale = max(np.abs(pressed).max(), np.abs(h).max(), 1.0)
    tolerance = 1e-13 * np.linalg.cond(robot.mass_matrix(q)) + ROUNDING
    assert_close(robot.inverse_dynamics(q, dq, ddq) + pressed, tau, tolerance, "τ = M q̈ + h + A'λ", scale=scale)
    slip = A @ ddq + closed.constraint_bias(q, dq)
    assert_close(slip, 0 * slip, 1e-8, "A q̈ + (dA/dt) dq = 0", scale=max(1.0, np.abs(A).max() * np.abs(ddq).max()))
    P = closed.projector(q)
    assert_close(P @ P, P, 1e-9, "P² = P", scale=np.abs(P).max() ** 2)
    assert_close(np.trace(P), closed.degrees_of_freedom(q), 1e-9, "rank of P", scale=1.0)


def with_random_loops(robot, q, rng):
    """The robot with one to three closures and perhaps a rolling frame, of random frames and rows, all met at q."""
    names = [*(name for name in robot.frame_names if robot.model.frames[name].body >= 0), "ground"]
    body_of = {name: robot.model.frames[name].body for name in names[:-1]} | {"ground": -1}
    pose_of = {name: robot.forward_kinematics(q, name) for name in names[:-1]} | {"ground": np.eye(4)}
    closed = robot
    for _ in range(rng.integers(1, 4)):
        a, b = rng.choice(names, 2)
        if body_of[a] == body_of[b]:
            continue
        rows = ("vx vy vz", "wx wy vx", "vz", " ".join(ROWS))[rng.integers(4)]
        pose = tw.se3.inverse(pose_of[a]) @ pose_of[b]
        closed = closed.close(a, b, rows, pose=pose, near=q, redundant="accept")
    if rng.random() < 0.5:
        closed = closed.constrain(names[0], "vy", near=q, redundant="accept")
    return closed


EQUATIONS = 1e-9
"""One factorisation of A M⁻¹ A' with conditions up to 1e6 on random trees, rounding 1e-16, and as much room again."""


@pytest.mark.parametrize("draw", mostly_slow(range(3), 3))
def test_random_trees_with_random_loops_obey_the_equations_of_constrained_motion(robot, state, draw):
    """M q̈ + h = τ - A'λ and A q̈ + (dA/dt) dq = 0, all of them methods of one robot."""
    rng = np.random.default_rng([draw, robot.nv])
    closed = with_random_loops(robot, state.q, rng)
    if not closed.constraints:
        return
    assert isinstance(closed, tw.Robot) and closed.open() is robot
    q, dq, tau = state.q, closed.project_velocity(state.q, state.dq), rng.standard_normal(robot.nv)
    ddq, lam = closed.forward_dynamics(q, dq, tau)
    M, h, A = closed.mass_matrix(q), closed.bias_forces(q, dq), closed.constraint_jacobian(q)
    scale = max(1.0, *(np.abs(part).max() for part in (M @ ddq, h, A.T @ lam)))
    assert_close(M @ ddq + h + A.T @ lam, tau, EQUATIONS, "τ = M q̈ + h + A'λ", scale=scale)
    rate = closed.constraint_bias(q, dq)
    scale = max(1.0, np.abs(A).max() * np.abs(ddq).max(), np.abs(rate).max())
    assert_close(A @ ddq + rate, 0 * rate, EQUATIONS, "A q̈ + (dA/dt) dq = 0", scale=scale)
