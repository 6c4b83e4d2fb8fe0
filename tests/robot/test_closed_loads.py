"""What motors of closed robots bear: causes, limits, power, and derivatives, against virtual work and reduced equations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mechanisms import LEGS, MASSES, G, crank_only

import twistwrench as tw
from twistwrench.mechanics.model.limits import Friction
from twistwrench.motion.bounds import bounds_of

pytest_plugins = ("mechanism_fixtures",)


def moving(closed, q, u, du, driven):
    """dq and ddq with the driven joints at u and du; the others follow."""
    A, b = closed.constraint_jacobian(q), None
    dq, ddq = np.zeros(closed.nv), np.zeros(closed.nv)
    dq[driven], ddq[driven] = u, du
    dq[~driven] = -np.linalg.solve(A[:, ~driven], A[:, driven] @ u)
    b = closed.constraint_bias(q, dq)
    ddq[~driven] = -np.linalg.solve(A[:, ~driven], A[:, driven] @ du + b)
    return dq, ddq


def led(closed, q, step, driven):
    """The configuration with the driven coordinates moved by a step, by Newton's method on the others."""
    dv = np.zeros(closed.nv)
    dv[driven] = step
    q = closed.open().add(q, dv)
    for _ in range(8):
        dv = np.zeros(closed.nv)
        dv[~driven] = -np.linalg.solve(closed.constraint_jacobian(q)[:, ~driven], closed.constraint_error(q))
        q = closed.open().add(q, dv)
    assert np.abs(closed.constraint_error(q)).max() < 1e-13
    return q


# ── causes ──


def test_the_weight_of_a_link_on_the_motor_is_its_virtual_work(linkage):
    """τ δφ = m g δz of each link's centre, by differences good to 1e-9; and the parts add up."""
    q, none = linkage.consistent([0.3, 0.4, 1.2]), np.zeros(3)
    why = linkage.explain(q, none, none, ["a"])
    n = linkage.project_velocity(q, [1.0, 0.0, 0.0])
    n = n / n[0]
    for name, mass in zip(("crank", "coupler", "rocker"), MASSES, strict=True):
        half = {"crank": 0.15, "coupler": 0.4, "rocker": 0.3}[name]
        up = [(linkage.open().forward_kinematics(q + s * n, name) @ [half, 0, 0, 1])[2] for s in (1e-5, -1e-5)]
        assert abs(why.contribution(name, "gravity")[0] - mass * G * (up[0] - up[1]) / 2e-5) < 1e-7
    assert np.abs(why.torque - linkage.holding_torques(q, ["a"]).tau).max() < 1e-12 * np.abs(why.torque).max()
    assert not why.torque[1:].any() and "coupler" in why.table("a")


def test_parts_add_up_in_motion_with_wrenches_and_friction(platform):
    closed, q = platform
    friction = Friction.plain(np.full(closed.nv, 0.1), np.zeros(closed.nv))
    rough = tw.Robot(replace(closed.open().model, friction=friction))
    for c in closed.constraints:
        rough = rough.close(c.frame_a, c.frame_b, c.rows, near=q)
    rng, F = np.random.default_rng(0), {"plate": [0.1, 0.2, 0.3, 1.0, 2.0, 3.0]}
    dq = rough.project_velocity(q, rng.standard_normal((4, closed.nv)))
    ddq = rough.project_acceleration(q, dq, rng.standard_normal((4, closed.nv)))
    motors = [f"hip{k}" for k in range(LEGS)]
    given = {"actuated": motors, "wrench_by_robot": F, "friction": True}
    why = rough.explain(q, dq, ddq, **given)
    tau = rough.inverse_dynamics(q, dq, ddq, **given).tau
    assert np.abs(why.torque - tau).max() < 1e-10 * np.abs(tau).max()
    assert {"friction", "wrench at plate"} <= {*why.terms}


def test_the_motor_that_fails_is_named(linkage):
    q = linkage.consistent([0.3, 0.4, 1.2])
    pushed = linkage.simulate(q, duration=0.3, tau=[30.0, 0.0, 0.0]).motion
    tau = linkage.inverse_dynamics(pushed.q, pushed.dq, pushed.ddq, ["a"]).tau
    assert pushed.violations(tau=tau) == ()
    worst = pushed.violations(bounds_of(linkage.open(), effort=20.0), tau=tau)[0]
    assert (worst.joint, worst.kind, worst.limit) == ("a", "torque", 20.0)
    largest = tau[:, 0].max()
    assert abs(worst.value - largest) < 1e-12 * largest  # of values that are equal but for rounding, the first is told
    with pytest.raises(tw.ShapeError, match="a row for each state"):
        pushed.violations(tau=tau[:-1])


# ── motors and power ──


def test_motors_bear_what_the_loop_brings_to_them(linkage):
    motor = {"torque_constant": "0.1 N m/A", "resistance": "0.5 ohm"}
    robot = linkage.open().with_actuators(
        {"actuators": {"a": {"ratio": 50, "efficiency": 0.8, "reflected_inertia": "0.02 kg m^2", "motor": motor}}}
    )
    closed = robot.close("rocker_pin", "coupler_pin", "vx vz")
    q = closed.consistent([0.3, 0.4, 1.2])
    dq = closed.project_velocity(q, [2.0, 0, 0])
    ddq = closed.project_acceleration(q, dq, [5.0, 0, 0])
    loads = closed.motor_loads(q, dq, ddq)
    tau = closed.inverse_dynamics(q, dq, ddq, ["a"]).tau[0]
    rotor = robot.drive_torques(q, dq, ddq)[1][0]
    carried = tau - rotor
    eta = 1 / 0.8 if carried * dq[0] > 0 else 0.8
    assert np.isclose(loads.torque[0], (carried * eta + rotor) / 50, rtol=1e-12) and rotor != 0.0
    assert np.isclose(loads.speed[0], 50 * dq[0]) and np.isclose(loads.current[0], loads.torque[0] / 0.1)
    with pytest.raises(tw.ModelError, match="no actuators"):
        linkage.motor_loads(q, dq, ddq)


@pytest.mark.parametrize("rubs", [False, True])
def test_power_is_balanced_and_is_the_rate_of_energy(linkage, rubs):
    friction = Friction.plain([0.2, 0.1, 0.3], [0.1, 0.0, 0.0])
    closed = tw.Robot(replace(linkage.open().model, friction=friction)).close("rocker_pin", "coupler_pin", "vx vz")
    q = closed.consistent([0.3, 0.4, 1.2])
    dq, tau = closed.project_velocity(q, [2.0, 0, 0]), np.array([1.0, 0.5, -2.0])
    F = {"coupler_pin": [0, 0.2, 0, 1.0, 0, -2.0]}
    powers = closed.power_balance(q, dq, tau, wrench_on_robot=F, friction=rubs)
    assert abs(sum(powers)) < 1e-12 * max(map(abs, powers)) and (powers.friction < -0.1) == rubs
    h = 1e-4
    found = closed.simulate(q, dq, duration=2 * h, dt=h, tau=tau, wrench_on_robot=F, friction=rubs)
    rate = (-3 * found.energy[0] + 4 * found.energy[1] - found.energy[2]) / (2 * h)
    assert abs(rate + powers.motion) < 1e-4 * abs(powers.motion), "to h² of its second rate"


# ── derivatives ──


def test_derivatives_of_a_four_bar_are_those_of_its_reduced_equation(linkage):
    """τ = I φ'' + ½ I' φ'² + V', I and V by plane geometry; slopes by differences good to 1e-5 for the second."""
    q, driven, u, du = linkage.consistent([0.3, 0.4, 1.2]), np.array([True, False, False]), 1.7, -2.3
    found = linkage.inverse_dynamics_derivatives(q, *moving(linkage, q, np.array([u]), np.array([du]), driven), ["a"])
    h = 1e-3
    (I2, V2, _), (I1, V1, _), (I0, V0, _), (J1, W1, _), (J2, W2, _) = (
        crank_only(q[0] + k * h) for k in (2, 1, 0, -1, -2)
    )
    dI, ddI = (8 * (I1 - J1) - (I2 - J2)) / (12 * h), (-(I2 + J2) + 16 * (I1 + J1) - 30 * I0) / (12 * h * h)
    ddV = (-(V2 + W2) + 16 * (V1 + W1) - 30 * V0) / (12 * h * h)
    assert abs(found.tau_by_ddq[0, 0] - I0) < 1e-12
    assert abs(found.tau_by_dq[0, 0] - dI * u) < 1e-8
    assert abs(found.tau_by_q[0, 0] - (dI * du + 0.5 * ddI * u * u + ddV)) < 1e-6


def test_derivatives_of_a_platform_are_differences_along_its_constraints(platform):
    closed, q = platform
    motors = [f"hip{k}" for k in range(LEGS)]
    driven = np.array([name in motors for name in closed.open().model.velocity_names])
    rng, F = np.random.default_rng(1), {"plate": [0.1, 0.2, 0.3, 1.0, 2.0, 3.0]}
    u, du = rng.standard_normal((2, LEGS))
    at = moving(closed, q, u, du, driven)
    found = closed.inverse_dynamics_derivatives(q, *at, motors, wrench_on_robot=F)

    def torques(q, u, du):
        given = {"actuated": motors, "wrench_on_robot": F}
        return closed.inverse_dynamics(q, *moving(closed, q, u, du, driven), **given).tau[driven]

    scale, h = np.abs(found.tau_by_q).max(), 1e-4
    for k, e in enumerate(np.eye(LEGS)):
        for slopes, ends in (
            (found.tau_by_q, [torques(led(closed, q, s * e, driven), u, du) for s in (h, -h)]),
            (found.tau_by_dq, [torques(q, u + s * e, du) for s in (h, -h)]),
            (found.tau_by_ddq, [torques(q, u, du + s * e) for s in (h, -h)]),
        ):
            assert np.abs(slopes[:, k] - (ends[0] - ends[1]) / (2 * h)).max() < 1e-6 * scale
    many = closed.inverse_dynamics_derivatives(np.tile(q, (3, 1)), *at, motors, wrench_on_robot=F)
    assert many.tau_by_q.shape == (3, LEGS, LEGS) and np.abs(many.tau_by_q - found.tau_by_q).max() < 1e-9 * scale
    M = found.tau_by_ddq
    assert np.abs(M - M.T).max() < 1e-12 * np.abs(M).max() and np.linalg.eigvalsh(M).min() > 0


def test_rows_too_many_change_no_derivative(linkage):
    q = linkage.consistent([0.3, 0.4, 1.2])
    spatial = linkage.open().close("rocker_pin", "coupler_pin", "wx wz vx vy vz", redundant="accept")
    one, other = (c.inverse_dynamics_derivatives(q, np.zeros(3), np.zeros(3), ["a"]) for c in (linkage, spatial))
    assert abs(one.tau_by_q - other.tau_by_q).max() < 1e-10


def test_motors_that_are_not_the_independent_joints_are_refused(linkage):
    q, none = linkage.consistent([0.3, 0.4, 1.2]), np.zeros(3)
    with pytest.raises(tw.ConstraintError, match="2 velocities, and there are 1 degrees"):
        linkage.inverse_dynamics_derivatives(q, none, none, ["a", "d"])
    in_line = np.arccos((0.7**2 + 1.1**2 - 0.6**2) / (2 * 0.7 * 1.1))
    dead = linkage.consistent([in_line, 0.0, np.pi - np.arccos((0.7**2 + 0.6**2 - 1.1**2) / (2 * 0.7 * 0.6))])
    assert abs(dead[1]) < 1e-9, "crank and coupler in one line"
    with pytest.raises(tw.ConstraintError, match="dead centre"):
        linkage.inverse_dynamics_derivatives(dead, none, none, ["d"])
    assert np.isfinite(linkage.inverse_dynamics_derivatives(dead, none, none, ["a"]).tau_by_q).all()
