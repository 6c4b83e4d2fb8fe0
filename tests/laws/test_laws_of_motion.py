"""The laws of motion on random trees of every joint kind: frames, momentum, centre of mass, configurations."""

from __future__ import annotations

import numpy as np
import pytest
from quick import mostly_slow
from random_trees import DIFFERENCES, ROUNDING, UNDRIVEN, body_poses, frames

import twistwrench as tw
from twistwrench import Ad, se3, so3
from twistwrench.mechanics.model.builder import ModelBuilder
from twistwrench.mechanics.model.model import BASE
from twistwrench.testing import assert_close, derivative_along, random_state

KINDS = ("body", "space", "world_aligned")

pytest_plugins = ("random_tree_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")


# ── kinematics ──


@pytest.mark.parametrize("kind", KINDS)
def test_jacobian_gives_the_twist_of_the_moving_frame(robot, state, kind):
    q, dq, _ = state
    for frame in frames(robot):
        T = robot.forward_kinematics(q, frame)
        dT = derivative_along(robot, lambda x, f=frame: robot.forward_kinematics(x, f), q, dq)
        in_frame, in_base = se3.inverse(T) @ dT, dT @ se3.inverse(T)
        twist = {
            "body": np.r_[so3.vee(in_frame[:3, :3]), in_frame[:3, 3]],  # [V_b] = T⁻¹ Ṫ
            "space": np.r_[so3.vee(in_base[:3, :3]), in_base[:3, 3]],  # [V_s] = Ṫ T⁻¹
            "world_aligned": np.r_[so3.vee(in_base[:3, :3]), dT[:3, 3]],
        }[kind]
        J = robot.jacobian(q, frame, kind)
        scale = max(1.0, np.abs(twist).max())  # a frame of the base has no twist; its pose is of order 1
        assert_close(J @ dq, twist, DIFFERENCES, f"J dq, {kind}, of {frame}", scale=scale)
        assert_close(robot.frame_velocity(q, dq, frame, kind), J @ dq, ROUNDING, "frame_velocity", scale=scale)


@pytest.mark.parametrize("kind", KINDS)
def test_jacobian_rate_is_its_derivative(robot, state, kind):
    q, dq, ddq = state
    for frame in frames(robot, 2):
        J, rate = robot.jacobian(q, frame, kind), robot.jacobian_rate(q, dq, frame, kind)
        along = derivative_along(robot, lambda x, f=frame: robot.jacobian(x, f, kind), q, dq)
        scale = max(1.0, np.abs(J).max(), np.abs(rate).max())
        assert_close(rate, along, DIFFERENCES, f"dJ/dt, {kind}, of {frame}", scale=scale)
        dV = robot.frame_acceleration(q, dq, ddq, frame, kind)
        assert_close(dV, J @ ddq + rate @ dq, ROUNDING, "dV = J ddq + dJ dq", scale=max(scale, np.abs(dV).max()))


def test_link_poses_are_the_forward_kinematics_of_each_link(robot, state):
    each = [robot.forward_kinematics(state.q, name) for name in robot.link_names]
    assert_close(robot.link_poses(state.q), each, ROUNDING, "link_poses")


def test_subtract_undoes_add(robot, rng):
    q, dv, _ = random_state(robot, rng, 50)
    dv *= 0.5  # rotations by less than π, within which the way back is unique
    assert_close(robot.subtract(robot.add(q, dv), q), dv, ROUNDING, "(q ⊕ v) ⊖ q")
    q1 = robot.random_configuration(rng, 50)
    back = robot.add(q, robot.subtract(q1, q))
    assert_close(robot.link_poses(back), robot.link_poses(q1), ROUNDING, "q ⊕ (q1 ⊖ q), as poses")


def test_random_configurations_without_limits_fill_a_turn_and_a_metre_either_way():
    """Each coordinate by its own kind, in its own place: of a planar joint x, y within ±1 m and theta within ±π."""
    builder = ModelBuilder("sled")
    for name in ("sled", "wheel", "slide"):
        builder.add_link(name)
        builder.add_link(f"{name}_end")
    builder.add_joint("plane", "planar", "sled", "sled_end", axis=(0, 0, 1))
    builder.add_joint("to_wheel", "fixed", "sled_end", "wheel")
    builder.add_joint("turn", "continuous", "wheel", "wheel_end", axis=(0, 0, 1))
    builder.add_joint("to_slide", "fixed", "wheel_end", "slide")
    builder.add_joint("push", "prismatic", "slide", "slide_end", axis=(0, 0, 1))
    robot = tw.Robot(builder.build())
    assert robot.coordinate_names == ("plane.x", "plane.y", "plane.theta", "turn", "push")
    reach = np.array([1.0, 1.0, np.pi, np.pi, 1.0])
    q = robot.random_configuration(0, 500)
    assert (np.abs(q) <= reach).all()
    assert (np.abs(q).max(axis=0) >= 0.95 * reach).all()  # missed by 0.95⁵⁰⁰, one in 10¹¹


@pytest.mark.parametrize("limit", [-4.0, -0.5, 0.5, 4.0])
def test_random_configurations_with_one_limit_fill_the_default_range_or_one_as_long_beside_it(limit):
    """The side without a limit is as without any, ±π or ±1 m, unless less than π or 1 m would remain up to the limit."""
    builder = ModelBuilder("ladder")
    builder.add_link("0")
    joints = [(kind, side) for kind in ("revolute", "prismatic") for side in ("lower", "upper")]
    for k, (kind, side) in enumerate(joints):
        builder.add_link(str(k + 1))
        builder.add_joint(f"{kind} with {side}", kind, str(k), str(k + 1), axis=(0, 0, 1), **{side: limit})
    robot = tw.Robot(builder.build())
    reach = np.array([np.pi, np.pi, 1.0, 1.0])
    is_lower = np.array([True, False, True, False])
    lower = np.where(is_lower, limit, np.minimum(-reach, limit - reach))
    upper = np.where(is_lower, np.maximum(reach, limit + reach), limit)
    q = robot.random_configuration(0, 1000)
    assert (lower <= q).all() and (q <= upper).all()
    length = upper - lower
    assert (q.min(axis=0) <= lower + 0.03 * length).all()  # missed by 0.97¹⁰⁰⁰, one in 10¹³
    assert (q.max(axis=0) >= upper - 0.03 * length).all()


# ── momentum and centre of mass ──


def link_momenta(robot, q, dq):
    """Momentum of each link by itself, fused ones too, at the base origin; what stands still has none."""
    for name, G in robot.model.link_inertias.items():
        V = robot.frame_velocity(q, dq, name, "body")
        yield Ad(se3.inverse(robot.forward_kinematics(q, name))).T @ (G @ V)


@pytest.mark.parametrize("robot", [*mostly_slow(UNDRIVEN[:12], 4), *UNDRIVEN[12:]], indirect=True)
def test_momentum_is_the_sum_over_the_links(robot, state):
    q, dq, _ = state
    P = robot.momentum(q, dq)
    assert_close(P, sum(link_momenta(robot, q, dq)), ROUNDING, "P = Σ Ad' G V")
    about = robot.momentum(q, dq, frame="com")
    assert_close(
        about[:3], P[:3] - np.cross(robot.center_of_mass(q), P[3:]), ROUNDING, "angular momentum about the com"
    )
    mass = sum(body.inertia.mass for body in robot.model.bodies)
    assert_close(about[3:], mass * robot.com_jacobian(q) @ dq, ROUNDING, "linear momentum = m v_com")


def test_rate_of_momentum_is_gravity_plus_what_comes_through_the_base(robot, state):
    q, dq, ddq = state
    along = derivative_along(robot, lambda x: robot.momentum(x, dq), q, dq)  # P is linear in dq: the rest is P(q, ddq)
    rate = along + robot.momentum(q, ddq)
    mass = sum(body.inertia.mass for body in robot.model.bodies)
    weight = mass * np.r_[np.cross(robot.center_of_mass(q), robot.gravity), robot.gravity]
    through = robot.joint_wrenches(q, dq, ddq)
    poses = body_poses(robot, q)
    reaction = sum(
        Ad(se3.inverse(poses[i])).T @ through[i] for i, b in enumerate(robot.model.bodies) if b.parent == BASE
    )
    assert_close(rate, weight + reaction, DIFFERENCES, "dP/dt", scale=max(np.abs(rate).max(), np.abs(weight).max()))


@pytest.mark.parametrize("robot", [*mostly_slow(UNDRIVEN[:12], 4), *UNDRIVEN[12:]], indirect=True)
def test_center_of_mass_is_where_the_links_balance(robot, state):
    q, dq, _ = state
    moving = {n: G for n, G in robot.model.link_inertias.items() if robot.model.frames[n].body != BASE}
    mass = sum(G.mass for G in moving.values())
    places = [G.mass * (robot.forward_kinematics(q, n) @ np.r_[G.com, 1.0])[:3] for n, G in moving.items()]
    assert_close(robot.center_of_mass(q), sum(places) / mass, ROUNDING, "centre of mass")
    v = derivative_along(robot, robot.center_of_mass, q, dq)
    assert_close(robot.com_jacobian(q) @ dq, v, DIFFERENCES, "J dq = d com/dt", scale=max(1.0, np.abs(v).max()))


def test_gravity_forces_are_the_gradient_of_the_potential_energy(robot, state):
    gradient = derivative_along(robot, robot.potential_energy, state.q, np.eye(robot.nv))
    scale = max(np.abs(gradient).max(), abs(robot.potential_energy(state.q)))
    assert_close(robot.gravity_forces(state.q), gradient, DIFFERENCES, "g = ∂P/∂q", scale=scale)
