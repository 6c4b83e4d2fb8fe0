"""Joint friction, MR section 8.9.4: each law by its formula, and forward dynamics undoing inverse dynamics under all of them."""

from __future__ import annotations

import numpy as np
import pytest

import twistwrench as tw
from twistwrench.testing import assert_close, random_robot, random_state

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")

LAW = {"viscous": 2.0, "coulomb": 1.5, "static": 4.0, "stribeck": 0.3, "load": 0.2}
UNITS = {"viscous": "N m s/rad", "coulomb": "N m", "static": "N m", "stribeck": "rad/s", "load": ""}


def rubbing(robot, **law):
    entry = {"friction": {k: f"{v} {UNITS[k]}".strip() for k, v in law.items()}}
    return robot.with_actuators({"actuators": dict.fromkeys(robot.joint_names, entry)})


@pytest.fixture
def arm():
    return tw.robots.planar_2r()


@pytest.mark.parametrize(
    ("law", "expected"),
    [
        ({"viscous": 2.0}, lambda w: 2.0 * w),
        ({"coulomb": 1.5}, lambda w: 1.5 * np.sign(w)),
        ({"coulomb": 1.5, "viscous": 2.0}, lambda w: 1.5 * np.sign(w) + 2.0 * w),
        (
            {"coulomb": 1.5, "static": 4.0, "stribeck": 0.3},
            lambda w: (1.5 + 2.5 * np.exp(-((w / 0.3) ** 2))) * np.sign(w),
        ),
        ({k: v for k, v in LAW.items() if k != "load"}, lambda w: 2 * w + (1.5 + 2.5 * np.exp(-((w / 0.3) ** 2))) * np.sign(w)),
    ],
)  # fmt: skip
def test_each_law_by_its_formula(arm, law, expected):
    w = np.linspace(-2, 2, 401)
    found = rubbing(arm, **law).friction_forces(np.stack([w, -w], axis=-1))
    assert_close(found[:, 0], expected(w), 1e-14, "friction")
    assert_close(found[:, 1], expected(-w), 1e-14, "friction, the other way")


def test_load_dependent_friction_grows_with_what_the_joint_carries(arm):
    found = rubbing(arm, load=0.2).friction_forces([1.0, -1.0], load=[10.0, 10.0])
    assert_close(found, np.array([2.0, -2.0]), 1e-15, "load-dependent friction")


def test_friction_is_left_out_unless_asked_for(arm):
    robot, state = rubbing(arm, **LAW), ([0.3, 0.4], [1.0, -2.0], [0.5, 0.6])
    np.testing.assert_array_equal(robot.inverse_dynamics(*state), arm.inverse_dynamics(*state))
    with_it = robot.inverse_dynamics(*state, friction=True)
    tau = arm.inverse_dynamics(*state)
    assert_close(with_it - tau, robot.friction_forces(state[1], load=tau), 1e-13, "friction=True adds friction_forces")


def test_the_result_may_take_the_place_of_an_input(arm):
    robot = rubbing(arm, **LAW)
    q, dq, ddq = (np.array(x) for x in ([0.3, 0.4], [1.0, -2.0], [0.5, 0.6]))
    expected = robot.inverse_dynamics(q, dq, ddq, friction=True)
    assert robot.inverse_dynamics(q, dq, ddq, friction=True, out=dq) is dq
    np.testing.assert_array_equal(dq, expected)


def test_load_has_the_shape_of_torques_whether_or_not_friction_depends_on_it(arm):
    for robot in (arm, rubbing(arm, **LAW)):
        assert robot.friction_forces([1.0, 1.0], load=np.ones((3, 2))).shape == (3, 2)
        with pytest.raises(tw.ShapeError, match="load"):
            robot.friction_forces([1.0, 1.0], load="nonsense")


@pytest.mark.parametrize("seed", range(5))
def test_forward_dynamics_undoes_inverse_dynamics_under_every_law_together(seed):
    """With load-dependent friction the torque that arrives is on both sides of its equation."""
    robot = rubbing(random_robot(seed, joints=4, kinds=("revolute",)), **LAW)
    rng = np.random.default_rng(seed)
    for _ in range(20):
        q, dq, ddq = random_state(robot, rng)
        tau = robot.inverse_dynamics(q, dq, ddq, friction=True)
        again = robot.forward_dynamics(q, dq, tau, friction=True)
        M = robot.mass_matrix(q)
        assert_close(M @ again, M @ ddq, 1e-11, "FD∘ID with friction")


def test_friction_takes_power_out():
    robot = rubbing(tw.robots.planar_3r(), **LAW)
    rng = np.random.default_rng(1)
    for _ in range(50):
        _, dq, load = random_state(robot, rng)
        assert robot.friction_forces(dq, load=load) @ dq > 0


def test_the_power_balance_sums_to_zero():
    robot = rubbing(tw.robots.planar_3r(), **LAW)
    rng = np.random.default_rng(2)
    q, dq, tau = (np.stack(x) for x in zip(*(random_state(robot, rng) for _ in range(100)), strict=True))
    F = rng.normal(size=(100, 6))
    for friction in (False, True):
        balance = robot.power_balance(q, dq, tau, wrench_on_robot={"tip": F}, friction=friction)
        assert balance.joints.shape == (100,)
        np.testing.assert_allclose(balance.joints, (tau * dq).sum(axis=-1), rtol=1e-13)
        V = np.einsum("nij,nj->ni", robot.jacobian(q, "tip"), dq)
        np.testing.assert_allclose(balance.wrenches, (F * V).sum(axis=-1), rtol=1e-9, atol=1e-9)
        assert (balance.friction < 0).all() if friction else (balance.friction == 0).all()
        assert np.abs(sum(balance)).max() < 1e-11 * np.abs(balance).max()


def test_motion_in_the_power_balance_is_the_rate_of_the_energy(arm):
    from twistwrench.testing import derivative

    q, dq, tau = np.array([0.3, 0.4]), np.array([1.0, -2.0]), np.array([3.0, 1.0])
    ddq = arm.forward_dynamics(q, dq, tau)

    def energy(t):
        x, v = q + np.multiply.outer(t, dq), dq + np.multiply.outer(t, ddq)
        return arm.kinetic_energy(x, v) + arm.potential_energy(x)

    assert_close(arm.power_balance(q, dq, tau).motion, -derivative(energy, 3.0), 1e-9, "dE/dt")


def test_laws_that_cannot_be_meant_are_errors(arm):
    for law, text in (
        ({"coulomb": 2.0, "static": 3.0}, "give stribeck"),
        ({"coulomb": 2.0, "static": 1.0, "stribeck": 0.1}, "static 1 must be at least coulomb 2"),
        ({"load": 1.0}, "load 1 below 1"),
        ({"coulomb": 1.0, "static": 2.0, "stribeck": 0.0}, "Stribeck speed 0 above 0"),
        ({"viscous": -1.0}, "viscous friction of joint 'joint1' is -1"),
    ):
        with pytest.raises(tw.ValueRangeError, match=text):
            rubbing(arm, **law)
