"""Gradients through rollouts: those that differences find, whatever the robot, the method and the law; and what has none.

Differences are of fourth order: with steps e the formula is off by e⁴ f⁽⁵⁾/30, some 1e-13 of motions of hundredths of a second
for e = 1e-3, and round-off by u f/e, 1e-13 f, of costs f of some ten. So slopes are compared to 1e-9 of the largest; those by
torques over two steps, and a payload's, are up to a thousand times smaller than the cost, and get 1e-7.
"""

from __future__ import annotations

import functools

import numpy as np
import pytest
from quick import mostly_slow

import twistwrench as tw
from twistwrench.simulation import BatchComputedTorque, BatchPD
from twistwrench.testing import random_robot, random_state

H, STEPS = 0.01, 5
ROBOTS = {
    "arm": tw.robots.ur5,
    "chain": tw.robots.planar_3r,
    "sliding": tw.robots.cart_pole,
    "mixed": lambda: random_robot(3, joints=4, kinds=("prismatic", "helical", "revolute", "mimic")),
    "planar": lambda: random_robot(100, joints=2, kinds=("planar", "revolute")),
    "ball": lambda: random_robot(5, joints=2, kinds=("ball", "revolute")),
    "floating": lambda: random_robot(4, joints=2, floating_base=True),
    "quadruped": tw.robots.quadruped,
}


@functools.cache
def robot_named(name):
    return ROBOTS[name]()


def some_state(robot, seed=1):
    state = random_state(robot, seed)
    return state.q, 0.3 * state.dq


def difference(cost, shape, e=1e-3):
    """The slopes of cost(x) at x = 0, entry by entry."""
    found = np.zeros(shape)
    for k in np.ndindex(*shape):
        x = np.zeros(shape)
        x[k] = e
        found[k] = (8 * (cost(x) - cost(-x)) - (cost(2 * x) - cost(-2 * x))) / (12 * e)
    return found


def assert_slopes(found, cost, tolerance=1e-9):
    wanted = difference(cost, found.shape)
    assert np.abs(wanted).max() > 1e-6  # else nothing is compared
    assert np.abs(found - wanted).max() < tolerance * np.abs(wanted).max()


class Weighed:
    """A cost linear in the deviations of a rollout's states: its slopes are its weights, on quaternions too."""

    def __init__(self, robot, q0, dq0, tau=None, *, every=1, **options):
        self.robot, self.q0, self.dq0, self.tau = robot, q0, dq0, tau
        self.options = {"dt": H, "steps": STEPS, **options}
        self.base = robot.rollout(q0, dq0, tau, gradients=True, every=every, **self.options)
        rng = np.random.default_rng(7)
        self.by_q, self.by_dq = rng.normal(size=(2, *self.base.dq.shape))
        self.by_tau = 0.0 if self.base.tau is None else rng.normal(size=self.base.tau.shape)
        self.gradient = self.base.gradient(self.by_q, self.by_dq, self.by_tau)
        self.options["every"] = every

    def __call__(self, q0=0.0, dq0=0.0, tau=None, **options):
        q = self.robot.add(self.q0, np.broadcast_to(q0, (*self.q0.shape[:-1], self.robot.nv)))
        other = self.robot.rollout(q, self.dq0 + dq0, self.tau if tau is None else tau, **{**self.options, **options})
        applied = 0.0 if other.tau is None else (self.by_tau * other.tau).sum()
        away = self.robot.subtract(other.q, self.base.q)
        return (self.by_q * away).sum() + (self.by_dq * other.dq).sum() + applied


# ── what differences find ──


SLOW, SLOW_IN_STAGES = ("chain", "sliding", "planar", "quadruped"), ("mixed", "ball", "floating")
COMPARED = [
    pytest.param(
        name, method, marks=[pytest.mark.slow] * (name in SLOW or (method == "rk4" and name in SLOW_IN_STAGES))
    )
    for name in ROBOTS
    for method in ("semi_implicit", "rk4")
]
"""Four stages are compiled as one program, which takes a while where joints are many or turn in space."""


@pytest.mark.parametrize(("name", "method"), mostly_slow(COMPARED, 2))
def test_slopes_by_states_and_torques_are_those_of_differences(name, method):
    robot = robot_named(name)
    torques = np.random.default_rng(0).normal(size=(STEPS, robot.nv))
    cost = Weighed(robot, *some_state(robot), torques, method=method)
    assert_slopes(cost.gradient.q0, lambda x: cost(q0=x))
    assert_slopes(cost.gradient.dq0, lambda x: cost(dq0=x))
    assert_slopes(cost.gradient.tau, lambda x: cost(tau=torques + x), 1e-7)
    assert cost.gradient.remarks == () and "q0" in repr(cost.gradient)


def test_a_cart_has_the_slopes_of_its_formula():
    """A mass m pushed from rest: x_N = x_0 + N h v_0 + h²/m Σ (N - k) f_k of semi-implicit steps, k from 0."""
    robot, n, h = tw.robots.cart_pole().lock({"hinge": 0.3}), 40, 0.01
    m = robot.mass_matrix([0.0])[0, 0]
    end = np.zeros((n + 1, 1))
    end[-1] = 1.0
    by = robot.rollout([0.3], [0.1], np.zeros((n, 1)), dt=h, gradients=True).gradient(end)
    np.testing.assert_allclose(by.q0, [1.0], rtol=1e-14)
    np.testing.assert_allclose(by.dq0, [n * h], rtol=1e-13)
    np.testing.assert_allclose(by.tau[:, 0], h * h / m * np.arange(n, 0, -1), rtol=1e-12)


@pytest.mark.parametrize("method", ("semi_implicit", "rk4"))
def test_slopes_by_references_gains_wrenches_and_parameters(method):
    robot = robot_named("chain")
    state, rng = some_state(robot), np.random.default_rng(3)
    given = {
        "q_des": rng.normal(size=(STEPS, 3)),
        "kp": rng.uniform(1, 5, 3),
        "kd": rng.uniform(0.01, 0.05, (1, 3)),
        "dq_des": rng.normal(size=3),
    }
    wrench, mass = rng.normal(size=6), np.array(2.0)
    options = {"method": method, "torques": True}
    cost = Weighed(
        robot, *state, BatchPD(**given), wrench_on_robot={"tip": wrench}, parameters={"tip.mass": mass}, **options
    )
    by = cost.gradient
    assert by.tau is None and set(by.law) == set(given)
    for name, x in given.items():
        assert by.law[name].shape == x.shape
        assert_slopes(by.law[name], lambda e, x=x, name=name: cost(tau=BatchPD(**{**given, name: x + e})), 1e-7)
    pushed = by.wrench_on_robot["tip"]
    assert_slopes(pushed, lambda e: cost(wrench_on_robot={"tip": wrench + e}), 1e-7)
    assert by.parameters["tip.mass"].shape == ()
    assert_slopes(by.parameters["tip.mass"], lambda e: cost(parameters={"tip.mass": mass + e}), 1e-7)
    assert_slopes(by.q0, lambda e: cost(q0=e))


def test_slopes_of_computed_torque_and_of_controllers_of_one_motion():
    robot = robot_named("chain")
    state, goal, kp = some_state(robot), np.linspace(-1, 1, 3), np.full(3, 30.0)
    cost = Weighed(robot, *state, BatchComputedTorque(goal, kp, 8.0), torques=True)
    assert_slopes(cost.gradient.law["kp"], lambda e: cost(tau=BatchComputedTorque(goal, kp + e, 8.0)), 1e-7)
    assert cost.gradient.law["kd"].shape == ()
    held = Weighed(robot, *state, tw.control.PD(robot, goal, kp, 8.0))
    assert_slopes(held.gradient.q0, lambda e: held(q0=e))


# ── what shares, adds up ──


def test_samples_have_the_slopes_they_have_alone_and_what_they_share_has_the_sum():
    robot, rng = robot_named("sliding"), np.random.default_rng(4)
    q0, dq0 = rng.normal(size=(2, 3, robot.nv))
    apart, shared = rng.normal(size=(3, STEPS, robot.nv)), rng.normal(size=robot.nv)
    mass = {"pole.mass": np.array([0.1, 0.2, 0.4])}
    slope = rng.normal(size=(3, STEPS + 1, robot.nv))
    options = {"dt": H, "steps": STEPS, "gradients": True}
    whole = robot.rollout(q0, dq0, apart, parameters=mass, **options).gradient(slope)
    assert whole.tau.shape == apart.shape and whole.parameters["pole.mass"].shape == (3,)
    for k in range(3):
        part = {"pole.mass": mass["pole.mass"][k]}
        alone = robot.rollout(q0[k], dq0[k], apart[k], parameters=part, **options).gradient(slope[k])
        assert np.array_equal(alone.tau, whole.tau[k]) and np.array_equal(alone.q0, whole.q0[k])
        assert np.array_equal(alone.parameters["pole.mass"], whole.parameters["pole.mass"][k])
    each = robot.rollout(q0, dq0, np.broadcast_to(shared, (3, STEPS, robot.nv)), **options).gradient(slope)
    for tau, axes in ((shared, (0, 1)), (np.broadcast_to(shared, (STEPS, robot.nv)), (0,))):
        by = robot.rollout(q0, dq0, tau, **options).gradient(slope)
        np.testing.assert_allclose(by.tau, each.tau.sum(axis=axes), rtol=1e-12)
    one_start = robot.rollout(q0[0], dq0, apart, **options).gradient(slope)
    assert one_start.q0.shape == (robot.nv,) and one_start.dq0.shape == (3, robot.nv)
    none = robot.rollout(q0, dq0, **options).gradient(slope)
    assert none.tau.shape == (3, STEPS, robot.nv)


def test_states_between_those_that_are_kept_are_computed_once_more_with_their_bits():
    robot = robot_named("floating")
    q0, dq0 = some_state(robot)
    tau = np.random.default_rng(5).normal(size=(12, robot.nv))
    options = {"dt": H, "gradients": True, "torques": True}
    slope_q, slope_dq = np.random.default_rng(6).normal(size=(2, 5, robot.nv))
    slope_tau = np.random.default_rng(8).normal(size=(4, robot.nv))
    spread = np.zeros((3, 13, robot.nv))
    spread[0, ::3], spread[1, ::3], spread[2, :-1:3] = slope_q, slope_dq, slope_tau
    all_kept = robot.rollout(q0, dq0, tau, **options).gradient(*spread[:2], spread[2, :-1])
    some = robot.rollout(q0, dq0, tau, every=3, **options).gradient(slope_q, slope_dq, slope_tau)
    for x, y in ((some.q0, all_kept.q0), (some.dq0, all_kept.dq0), (some.tau, all_kept.tau)):
        assert np.array_equal(x, y)


@pytest.mark.parametrize("name", ("arm", "planar", "ball"))
def test_linearized_steps_carry_slopes_back_and_deviations_forth(name):
    robot = robot_named(name)
    q0, dq0 = some_state(robot)
    tau = np.random.default_rng(0).normal(size=(STEPS, robot.nv))
    base = robot.rollout(q0, dq0, tau, dt=H, gradients=True)
    A, B = base.linearize()
    assert A.shape == (STEPS, 2 * robot.nv, 2 * robot.nv) and B.shape == (STEPS, 2 * robot.nv, robot.nv)
    weights = np.random.default_rng(1).normal(size=(2, STEPS + 1, robot.nv))
    by, slope = base.gradient(*weights), np.r_[weights[0, -1], weights[1, -1]]
    for k in reversed(range(STEPS)):
        np.testing.assert_allclose(B[k].T @ slope, by.tau[k], rtol=1e-9, atol=1e-11)
        slope = A[k].T @ slope + np.r_[weights[0, k], weights[1, k]]
    np.testing.assert_allclose(slope, np.r_[by.q0, by.dq0], rtol=1e-9, atol=1e-11)
    e, along = 1e-6, np.random.default_rng(2).normal(size=(2, robot.nv))
    moved = robot.rollout(robot.add(q0, e * along[0]), dq0 + e * along[1], tau, dt=H)
    deviation = np.r_[along[0], along[1]]
    for k in range(STEPS):
        deviation = A[k] @ deviation
    found = np.r_[robot.subtract(moved.q[-1], base.q[-1]), moved.dq[-1] - base.dq[-1]] / e
    assert np.abs(found - deviation).max() < 1e-4 * np.abs(deviation).max()  # of first order in e
    pair = robot.rollout([q0, q0], [dq0, 0 * dq0], tau, dt=H, gradients=True).linearize()
    assert np.array_equal(pair[0][0], A) and np.array_equal(pair[1][0], B)


def test_a_short_step_of_a_linear_system_is_that_of_its_equation():
    """(A - 1) / h and B / h go to the A and B of robot.linearize, by h."""
    robot = robot_named("ball")
    q0, dq0 = some_state(robot)
    wanted, off = robot.linearize(q0, dq0, np.zeros(robot.nv)), []
    for h in (1e-3, 5e-4):
        A, B = robot.rollout(q0, dq0, dt=h, steps=1, gradients=True).linearize()
        found = (A[0] - np.eye(2 * robot.nv)) / h, B[0] / h
        off.append([np.abs(x - y).max() for x, y in zip(found, wanted, strict=True)])
    assert (np.abs(np.divide(off[0], off[1]) - 2) < 0.1).all(), off


def test_linearized_steps_are_those_that_mujoco_finds_by_differences():
    """Its own steps are semi-implicit, too. Central differences with steps of 1e-5 are good to some 1e-9."""
    mujoco = pytest.importorskip("mujoco")
    robot, h = robot_named("arm"), 2e-3
    model = robot.to_mujoco()
    model.opt.timestep, model.opt.integrator = h, mujoco.mjtIntegrator.mjINT_EULER
    data, tau = mujoco.MjData(model), np.linspace(-5, 5, 6)
    q0, dq0 = some_state(robot)
    data.qpos, data.qvel, data.qfrc_applied = tw.convert.to_mujoco(robot, model, q0, dq0, tau)
    theirs = np.zeros((12, 12))
    mujoco.mjd_transitionFD(model, data, 1e-5, 1, theirs, None, None, None)
    A, _ = robot.rollout(q0, dq0, tau, dt=h, steps=1, gradients=True).linearize()
    assert np.abs(A[0] - theirs).max() < 1e-6 * np.abs(theirs).max()


# ── corners, and numbers that mean nothing ──


def rubbed(**laws):
    said = {"friction": {"coulomb": "0.5 N m", "viscous": "0.1 N m s/rad", **laws}}
    return tw.robots.planar_2r().with_actuators({"actuators": dict.fromkeys(("joint1", "joint2"), said)})


def test_slopes_with_dry_friction_are_those_of_the_way_each_joint_goes():
    robot = rubbed()
    cost = Weighed(robot, np.array([0.3, -0.8]), np.array([1.0, -2.0]), np.array([2.0, 1.0]), friction=True)
    assert_slopes(cost.gradient.q0, lambda e: cost(q0=e))
    assert_slopes(cost.gradient.tau, lambda e: cost(tau=cost.tau + e), 1e-7)
    assert any("dry friction" in remark for remark in cost.gradient.remarks)
    held = robot.rollout([-np.pi / 2, 0], [0, 0], steps=5, friction=True, gradients=True).gradient(np.ones((6, 2)))
    assert not held.tau.any() and (held.q0 == 6).all()  # what is held answers to no torque, and stays where it is put


def test_slopes_at_torque_limits_are_those_of_differences():
    robot = robot_named("arm")
    law, limits = BatchPD(np.ones(6), np.linspace(20, 60, 6), 1.0, gravity=False), np.array([5.0, 90, 5, 90, 90, 5])
    cost = Weighed(robot, *some_state(robot), law, torque_limits=limits, torques=True)
    at = np.abs(cost.base.tau) >= limits
    assert at.any() and not at.all()
    assert_slopes(cost.gradient.q0, lambda e: cost(q0=e))
    assert any("limit" in remark for remark in cost.gradient.remarks)


def test_eased_friction_is_refused_with_advice():
    with pytest.raises(tw.ValueRangeError, match="semi_implicit"):
        rubbed().rollout([0, 0], [1, 1], steps=2, method="rk4", friction=True, gradients=True)


def test_a_robot_at_rest_has_slopes():
    """Angles of steps are 0 there, and so is what they are divided by."""
    robot = robot_named("floating")
    by = robot.rollout(robot.neutral, np.zeros(robot.nv), steps=3, gradients=True).gradient(np.ones((4, robot.nv)))
    assert np.isfinite(by.q0).all() and np.isfinite(by.tau).all() and by.tau.any()


def test_nan_stays_in_its_sample():
    robot = robot_named("sliding")
    q0 = np.array([[0.0, 0.1], [np.nan, 0.0], [0.2, 0.3]])
    slope = np.ones((3, 5, 2))
    found = robot.rollout(q0, np.zeros(2), np.zeros((3, 4, 2)), gradients=True).gradient(slope)
    good = robot.rollout(q0[::2], np.zeros(2), np.zeros((2, 4, 2)), gradients=True).gradient(slope[::2])
    assert np.array_equal(found.tau[::2], good.tau) and np.isfinite(good.tau).all()


# ── what goes in stays what it was ──


def test_arrays_of_the_caller_may_change_after_the_rollout():
    robot, slope = robot_named("sliding"), np.ones((5, 2))
    tau, q0 = np.ones((4, 2)), np.array([0.1, 0.2])
    base = robot.rollout(q0, [0, 0], tau, gradients=True)
    wanted = base.gradient(slope).tau.copy()
    tau[:], q0[:] = 7.0, 7.0
    assert np.array_equal(base.gradient(slope).tau, wanted)
    with pytest.raises(ValueError, match="read-only"):
        base.q[0] = 1.0


def test_single_precision_gives_slopes_in_single_precision():
    robot = robot_named("arm")
    q0, dq0 = some_state(robot)
    tau, slope = np.ones((4, 6)), np.ones((5, 6))
    wanted = robot.rollout(q0, dq0, tau, gradients=True).gradient(slope, slope)
    found = robot.rollout(*(np.float32(x) for x in (q0, dq0, tau)), gradients=True).gradient(slope, slope)
    for x, y in ((found.q0, wanted.q0), (found.tau, wanted.tau)):
        assert x.dtype == np.float32 and np.abs(x - y).max() < 1e-4 * np.abs(y).max()


def test_without_a_compiler_slopes_are_the_same(monkeypatch):
    robot = robot_named("sliding")
    q0, dq0, tau = np.array([[0.1, 0.2], [0.3, 0.4]]), np.array([0.5, 0.6]), np.ones((4, 2))
    slope = np.random.default_rng(0).normal(size=(2, 3, 2))
    wanted = robot.rollout(q0, dq0, tau, every=2, gradients=True).gradient(slope)
    A, B = robot.rollout(q0, dq0, tau, gradients=True).linearize()
    monkeypatch.setenv("TWISTWRENCH_JIT", "0")
    plain = tw.Robot(robot.model)
    found = plain.rollout(q0, dq0, tau, every=2, gradients=True).gradient(slope)
    np.testing.assert_allclose(found.tau, wanted.tau, rtol=1e-10)
    np.testing.assert_allclose(found.q0, wanted.q0, rtol=1e-10)
    for x, y in zip(plain.rollout(q0, dq0, tau, gradients=True).linearize(), (A, B), strict=True):
        np.testing.assert_allclose(x, y, rtol=1e-10, atol=1e-14)


def test_what_does_not_fit_is_refused():
    robot = robot_named("floating")
    q0, dq0 = some_state(robot)
    base = robot.rollout(q0, dq0, steps=4, gradients=True)
    with pytest.raises(tw.ShapeError, match=r"by q has shape \(5, 8\).*robot.add"):
        base.gradient(np.ones((5, robot.nq)))
    with pytest.raises(tw.ShapeError, match="by dq"):
        base.gradient(0.0, np.ones((4, robot.nv)))
    with pytest.raises(tw.ValueRangeError, match="torques=True"):
        base.gradient(tau=1.0)
    for ask in (lambda r: r.gradient(), lambda r: r.linearize()):
        with pytest.raises(tw.ValueRangeError, match="gradients=True"):
            ask(robot.rollout(q0, dq0, steps=4))
    with pytest.raises(tw.ValueRangeError, match="every=1"):
        robot.rollout(q0, dq0, steps=4, every=2, gradients=True).linearize()
    with pytest.raises(tw.ValueRangeError, match="torques=True"):
        robot.rollout(q0, dq0, BatchPD(q0, 1.0, 1.0), steps=4, gradients=True).linearize()
    with pytest.raises(tw.ShapeError, match="out="):
        robot.rollout(q0, dq0, steps=4, gradients=True, out=(base.q.copy(), base.dq.copy()))
