"""What brakes is taken at the end of a semi-implicit step: damping, gains of the rates, dry friction, torques at their limits."""

from __future__ import annotations

import functools
import warnings
from itertools import pairwise

import numpy as np
import pytest
from quick import mostly_slow
from robot_files import FILES, NONE

import twistwrench as tw
from twistwrench.core.errors import TwistWrenchError
from twistwrench.simulation import BatchComputedTorque, BatchPD
from twistwrench.simulation.forces import creep_speeds
from twistwrench.testing import random_robot, random_state

UNITS = {"viscous": "N m s/rad", "coulomb": "N m", "static": "N m", "stribeck": "rad/s", "load": ""}
DRY = {"viscous": 0.5, "coulomb": 1.5, "static": 2.0, "stribeck": 0.3}
H = 1e-3


def rubbing(robot, **law):
    entry = {"friction": {k: f"{v} {UNITS[k]}".strip() for k, v in law.items()}}
    return robot.with_actuators({"actuators": dict.fromkeys(robot.joint_names, entry)})


@functools.cache
def arm(seed=3, joints=5, **law):
    return rubbing(random_robot(seed, joints=joints, kinds=("revolute",)), **(law or DRY))


@functools.cache
def slides(**law):
    """Sliders in directions that are not square: M is constant and full, and c is 0, so that (1) can be checked to rounding."""
    robot = random_robot(5, joints=5, kinds=("prismatic",))
    units = {"viscous": "N s/m", "coulomb": "N", "static": "N", "stribeck": "m/s", "load": ""}
    entry = {"friction": {k: f"{v} {units[k]}".strip() for k, v in law.items()}}
    return robot.with_actuators({"actuators": dict.fromkeys(robot.joint_names, entry)})


def taken_by_friction(robot, found, k):
    """What the torques at the joints lack in step k, by (1) of velocity_step with V v on the side of friction; (..., nv)."""
    q, dq, v = found.q[..., k, :], found.dq[..., k, :], found.dq[..., k + 1, :]
    needed = np.einsum("...ij,...j->...i", robot.mass_matrix(q), v - dq) / found.dt + robot.bias_forces(q, dq)
    return found.tau[..., k, :] - needed - robot.model.friction.viscous * v


# ── dry friction ──


@pytest.mark.parametrize("law", [DRY, {**DRY, "load": 0.2}, {"coulomb": 3.0, "viscous": 0.0}])
def test_dry_friction_stops_joints_holds_them_and_does_no_more(law):
    """In every step: at most F, all of F against a joint that moves, and less only at one that is at rest, exactly.

    What friction takes is the difference of torques that round off at 1e-16 of M dq / h, some 1e4 N m here.
    """
    robot = slides(**law)
    state = random_state(robot, 1, 20)
    dq0 = np.where(np.random.default_rng(0).random(state.dq.shape) < 0.3, 0.0, 0.2 * state.dq)
    tau = 2.0 * np.random.default_rng(2).normal(size=(20, 1, robot.nv))
    found = robot.rollout(state.q, dq0, tau, dt=H, steps=150, friction=True, torques=True)
    changed = 0
    for k in range(found.steps):
        dq, v, taken = found.dq[:, k], found.dq[:, k + 1], taken_by_friction(robot, found, k)
        for way in (-1.0, 1.0):
            y = found.tau[:, k] - robot.model.friction.viscous * dq
            speed = np.where(dq == 0, 1e-12, np.abs(dq))
            F = robot.friction_forces(speed) - robot.model.friction.viscous * speed
            load = robot.model.friction.load
            F = F + load * np.abs(y - way * F) / (1 + way * load * np.sign(y - way * F))
            beyond = way * taken - F
            assert beyond.max() < 1e-8
            assert np.abs(beyond[way * v > 0]).max(initial=0.0) < 1e-8
        changed += np.count_nonzero((dq == 0) != (v == 0))
    assert changed > 20 and (found.dq[:, -1] == 0).any()


def test_a_joint_is_held_without_a_trace_of_motion():
    """|dq| is 0 and not small, for ten seconds, below what friction holds; just above, it moves."""
    wheel = rubbing(tw.robots.pendulum(), coulomb=5.0)
    q0 = np.array([0.6])
    most = wheel.gravity_forces(q0) + np.array([[[0.999 * 5.0]], [[-0.999 * 5.0]], [[1.001 * 5.0]]])
    found = wheel.rollout(q0, [0.0], most, steps=10_000, every=100, friction=True)
    assert not found.dq[:2].any() and np.array_equal(found.q[:2], np.full_like(found.q[:2], 0.6))
    assert found.q[2, -1, 0] > 0.6 and found.remarks == ()
    one = wheel.simulate(q0, None, 1.0, H, tau=most[0, 0], method="semi_implicit", friction=True)
    assert not one.dq.any() and one.remarks == () and one.relative_drift == 0.0
    assert not one.ddq.any()


def test_all_joints_are_held_together():
    """Where the joints' inertias are coupled, and under nine tenths of what each can hold in either direction."""
    robot = arm(coulomb=4.0, viscous=0.1)
    q0 = random_state(robot, 2, 8).q
    signs = np.sign(np.random.default_rng(3).normal(size=(8, robot.nv)))
    held = (robot.gravity_forces(q0) + 0.9 * 4.0 * signs)[:, None, :]
    found = robot.rollout(q0, np.zeros(robot.nv), held, steps=10_000, every=1000, friction=True)
    assert not found.dq.any() and np.array_equal(found.q[:, -1], q0)


def test_a_wheel_runs_down_as_it_should_and_its_energy_is_accounted_for():
    """From 2 rad/s by 0.5 N m at 1 kg m²: each step takes h F / I, and friction's work is all of the energy."""
    wheel = rubbing(tw.robots.pendulum().with_gravity([0, 0, 0]), coulomb=0.5)
    one = wheel.simulate([0.0], [2.0], 5.0, 0.01, method="semi_implicit", friction=True)
    np.testing.assert_allclose(one.dq[:, 0], np.maximum(2.0 - 0.5 * one.times, 0.0), atol=1e-12)
    assert one.dq[-1, 0] == 0.0
    np.testing.assert_allclose(one.work["friction"], one.kinetic_energy - one.kinetic_energy[0], atol=1e-12)


def test_friction_is_eased_off_by_the_larger_of_static_and_sliding_friction():
    """In a step of 10 ms 3 N m take 0.03 rad/s off 1 kg m², whichever of both they are."""
    wheel = tw.robots.pendulum().with_gravity([0, 0, 0])
    for law in ({"coulomb": 1.0, "static": 3.0, "stribeck": 0.1}, {"coulomb": 3.0}):
        (remark,) = rubbing(wheel, **law).simulate([0.0], [1.0], 0.1, 0.01, method="rk4", friction=True).remarks
        assert "creep, at up to about 0.03 rad/s" in remark


def test_the_joint_whose_friction_is_eased_off_is_named():
    """The first has none, and all creep at the same speed."""
    robot = tw.robots.planar_2r().with_actuators({"actuators": {"joint2": {"friction": {"coulomb": "1 N m"}}}})
    (remark,) = robot.simulate([0.3, 0.2], None, 0.01, friction=True).remarks
    assert "most of all 'joint2'" in remark


def test_halving_the_step_halves_the_error():
    """Halving the step halves the distance between motions, through stops and starts: order 1, within what events shift."""
    robot = arm()
    state = random_state(robot, 4, 6)
    ends = [
        robot.rollout(state.q, state.dq, dt=0.5 / n, steps=n, every=n, friction=True) for n in (250, 500, 1000, 2000)
    ]
    gaps = [np.abs(a.q[:, -1] - b.q[:, -1]).mean() for a, b in pairwise(ends)]
    assert gaps[2] < 0.35 * gaps[0] < 0.35 * 0.05


def test_an_adaptive_method_agrees():
    """SciPy's Radau on friction eased off below 1e-5 rad/s, which held joints creep by: 1e-5 in a second; h = 1e-3 costs more."""
    from scipy.integrate import solve_ivp

    robot = arm()
    n, state = robot.nv, random_state(robot, 4)
    V, law = robot.model.friction.viscous, robot.model.friction

    def rate(_t, y):
        q, v = y[:n], y[n:]
        dry = law.coulomb + (law.static - law.coulomb) * np.exp(-((v / law.stribeck) ** 2))
        return np.r_[v, robot.forward_dynamics(q, v, -V * v - dry * np.tanh(v / 1e-5))]

    wanted = solve_ivp(rate, (0, 1.0), np.r_[state.q, 0.3 * state.dq], method="Radau", rtol=1e-7, atol=1e-9).y[:n, -1]
    gaps = [
        np.abs(robot.rollout(state.q, 0.3 * state.dq, dt=h, duration=1.0, friction=True).q[-1] - wanted).max()
        for h in (1e-3, 1e-4)
    ]
    assert gaps[1] < 5e-4 and gaps[1] < 0.3 * gaps[0]


# ── gains of the rates, and limits ──


def stiff(robot, rng):
    """Gains far beyond what explicit steps of a millisecond bear, and small limits, one of which there is not."""
    kp, kd = rng.uniform(50, 500, robot.nv), rng.uniform(20, 2000, robot.nv)
    limits = rng.uniform(5, 40, robot.nv)
    limits[1] = np.inf
    return BatchPD(robot.random_configuration(rng), kp, kd, rng.normal(size=robot.nv), gravity=False), limits


@pytest.mark.parametrize("friction", [False, True])
@pytest.mark.parametrize("limited", [False, True])
def test_the_torques_said_are_those_applied_and_the_law_at_the_end_of_the_step(friction, limited):
    robot, rng = slides(**DRY) if friction else arm(), np.random.default_rng(5)  # of c, friction takes two looks
    law, limits = stiff(robot, rng)
    state = random_state(robot, 1, 12)
    given = {"dt": H, "steps": 300, "friction": friction, "torques": True}
    found = robot.rollout(state.q, state.dq, law, torque_limits=limits if limited else False, **given)
    assert not found.unstable.any()
    asked = law.kp * (law.q_des - found.q[:, :-1]) + law.kd * (law.dq_des - found.dq[:, 1:])
    if limited:
        assert (np.abs(found.tau) <= limits).all()
        assert (np.abs(found.tau) == limits).any(axis=(0, 1)).sum() >= robot.nv - 2
        asked = np.clip(asked, -limits, limits)
    # kd times what dq1 is rounded to: 2000 × 1e-16 × some rad/s, more where M is far from diagonal
    assert np.abs(found.tau - asked).max() < 1e-8
    again = robot.rollout(state.q, state.dq, found.tau[:, :1], dt=H, steps=1, friction=friction)
    assert np.abs(again.dq[:, 1] - found.dq[:, 1]).max() < 1e-10


def test_stiff_gains_bring_the_arm_to_rest_at_the_goal():
    """Without limits and with: explicit steps are unstable from kd > 2 M / h on."""
    robot = tw.robots.ur5()
    goal = np.array([0, -1.2, 1.5, 0, 0.3, 0])
    law = BatchPD(goal, 2000.0, 2000.0, gravity=True)
    for limits in (False, True):
        found = robot.rollout(robot.neutral, np.zeros(6), law, duration=6.0, every=100, torque_limits=limits)
        assert not found.unstable
        assert np.abs(found.q[-1] - goal).max() < 0.02 and np.abs(found.dq[-1]).max() < 0.02
        assert robot.kinetic_energy(found.q, found.dq)[-10:].max() < 1e-3


def test_computed_torque_rests_where_its_gains_carry_an_unknown_load_whatever_the_step():
    """M kp e = what the law does not know of, at rest; damping taken by the law's own model would shift that by 1 + h kd."""
    robot = tw.robots.planar_2r()
    loaded = robot.with_payload(tw.SpatialInertia.from_com(0.2, com=(0, 0, 0)))
    goal, kp, kd = np.array([0.3, 0.4]), 100.0, 20.0
    rest = []
    for dt in (1e-3, 1e-2):
        found = robot.rollout(
            goal, np.zeros(2), BatchComputedTorque(goal, kp, kd), dt=dt, duration=5.0, parameters={"tip.mass": 0.2}
        )
        rest.append(found.q[-1])
    np.testing.assert_allclose(rest[0], rest[1], atol=1e-9)
    unknown = loaded.gravity_forces(rest[0]) - robot.gravity_forces(rest[0])
    np.testing.assert_allclose(robot.mass_matrix(rest[0]) @ (kp * (goal - rest[0])), unknown, atol=1e-8)


def test_simulations_take_the_same_steps():
    robot = arm()
    state = random_state(robot, 6)
    q_des, kp, kd = robot.random_configuration(1), 80.0, np.linspace(5, 900, robot.nv)
    many = robot.rollout(
        state.q, state.dq, BatchPD(q_des, kp, kd, gravity=False), dt=H, steps=200, friction=True, torques=True
    )
    law = tw.control.PD(robot, q_des, kp, kd, gravity=False)
    one = robot.simulate(state.q, state.dq, 200 * H, H, tau=law, method="semi_implicit", friction=True)
    assert np.abs(many.q - one.q).max() < 1e-9 and np.abs(many.dq - one.dq).max() < 1e-9
    assert np.abs(many.tau - one.tau[:-1]).max() < 1e-6
    wanted = np.diff(one.dq, axis=0) / H
    np.testing.assert_allclose(one.ddq[:-1], wanted, atol=1e-9 * np.abs(wanted).max())
    assert np.array_equal(many.dq == 0, one.dq == 0)


def test_a_controller_of_the_callers_stays_as_it_is():
    """Held for a step, or without gains that it tells: the torques it gives are applied, and stiff ones are unstable."""
    robot = tw.robots.ur5()
    law = tw.control.PD(robot, robot.neutral + 0.3, 10.0, 300.0)
    given = {"duration": 0.3, "dt": H, "method": "semi_implicit"}
    assert robot.simulate(robot.neutral, tau=law, **given).completed
    for mine in ({"controller": law}, {"tau": lambda t, q, dq: law(t, q, dq)}):
        with pytest.raises(tw.SimulationError, match="unstable"):
            robot.simulate(robot.neutral, np.full(6, 0.1), **mine, **given)
    coupled = tw.control.PD(robot, robot.neutral, 10.0, np.eye(6) + 0.1)
    assert coupled.rate_gains is None and np.array_equal(law.rate_gains, np.full(6, 300.0))


# ── the same everywhere, and what is said ──


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_a_sample_has_the_bits_it_has_alone(dtype):
    robot, rng = arm(**DRY, load=0.1), np.random.default_rng(7)
    law, limits = stiff(robot, rng)
    law = BatchPD(*(np.asarray(x, dtype) for x in (law.q_des, law.kp, law.kd, law.dq_des)), gravity=False)
    state = random_state(robot, 1, 9)
    q0, dq0 = state.q.astype(dtype), np.where(rng.random((9, robot.nv)) < 0.3, 0, state.dq).astype(dtype)
    given = {"steps": 50, "friction": True, "torques": True, "torque_limits": limits.astype(dtype)}
    whole = robot.rollout(q0, dq0, law, **given)
    assert whole.q.dtype == dtype and not whole.unstable.any()
    for k in range(9):
        alone = robot.rollout(q0[k], dq0[k], law, **given)
        assert np.array_equal(alone.dq, whole.dq[k]) and np.array_equal(alone.tau, whole.tau[k])
    part = robot.rollout(q0[2:7], dq0[2:7], law, **given)
    assert np.array_equal(part.q, whole.q[2:7])


def test_without_a_compiler_steps_are_the_same(monkeypatch):
    robot = arm()
    state = random_state(robot, 1, 3)
    law, limits = stiff(robot, np.random.default_rng(5))
    given = {"steps": 20, "friction": True, "torque_limits": limits}
    wanted = robot.rollout(state.q, state.dq, law, **given)
    monkeypatch.setenv("TWISTWRENCH_JIT", "0")
    found = tw.Robot(robot.model).rollout(state.q, state.dq, law, **given)
    assert np.abs(found.dq - wanted.dq).max() < 1e-9


def test_friction_is_eased_off_below_what_it_takes_off_a_joint_in_a_step(bundled):
    """While the other joints are free to move, which makes a joint lighter than its entry of M says."""
    robot, h, dry = bundled("panda"), 1e-2, np.linspace(0.0, 9.0, 7)
    M = robot.mass_matrix(robot.random_configuration(0))
    taken = [h * np.linalg.solve(M, row)[k] for k, row in enumerate(np.diag(dry))]
    np.testing.assert_allclose(creep_speeds(M, dry, h), np.maximum(1e-3, taken), rtol=1e-9)


def test_what_is_eased_is_remarked_and_what_is_not_takes_no_creep():
    robot = arm()
    eased = robot.rollout(robot.neutral, np.zeros(robot.nv), steps=2, method="rk4", friction=True)
    (remark,) = eased.remarks
    assert "eased" in remark and "three quarters" in remark and remark in repr(eased)
    assert robot.rollout(robot.neutral, np.zeros(robot.nv), steps=2, friction=True).remarks == ()
    assert robot.rollout(robot.neutral, np.zeros(robot.nv), steps=2, method="rk4").remarks == ()
    only_viscous = arm(viscous=0.5)
    assert only_viscous.rollout(robot.neutral, np.zeros(robot.nv), steps=2, method="rk4", friction=True).remarks == ()
    with pytest.raises(tw.ValueRangeError, match="creep"):
        robot.simulate(duration=0.01, method="semi_implicit", friction=True, creep=0.1)


# ── robots as they are ──


def fall(name, duration):
    """The robot let go from neutral, and the largest gain of energy over the larger of what it had and what it lost."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)
        try:
            robot = tw.load(FILES[name], inertia="accept")
        except TwistWrenchError:
            pytest.skip("not read; with which reason is another test's business")
    if not robot.model.friction.any:
        pytest.skip("without friction")
    try:
        found = robot.rollout(robot.neutral, np.zeros(robot.nv), dt=H, duration=duration, friction=True)
    except tw.SingularMassMatrixError:
        pytest.skip("joints that move nothing")
    energy = robot.kinetic_energy(found.q, found.dq) + robot.potential_energy(found.q)
    return robot, found, (energy.max() - energy[0]) / max(abs(energy[0]), energy[0] - energy.min(), 1e-300)


FEW = (
    "xarm_description/xarm7",
    "panda_description/panda",
    "allegro_hand_description/allegro_left_hand",
    "z1_description/z1",
    "beside/ufactory_xarm6",
)


@pytest.mark.parametrize("name", mostly_slow([name for name in FEW if name in FILES] or NONE, 5))
def test_robots_that_explicit_steps_make_unstable_come_down(name):
    """By friction too stiff for them; or by whirling at 70 rad/s almost without any, as the Panda does."""
    _, found, gain = fall(name, 2.0)
    assert not found.unstable and gain < 0.01
    assert found.remarks == ()


@pytest.mark.slow
@pytest.mark.parametrize("name", list(FILES) or NONE)
def test_every_robot_with_friction_is_stable_and_gains_no_energy(name):
    _, found, gain = fall(name, 5.0)
    assert not found.unstable and gain < 0.01


@pytest.mark.skipif("xarm_description/xarm7" not in FILES, reason="example-robot-data is not there")
def test_all_of_xarm7_is_held():
    robot = tw.load(FILES["xarm_description/xarm7"], inertia="accept")
    q0 = np.array([0.3, -0.5, 0.2, 1.0, 0.4, 0.7, 0.1])
    held = robot.gravity_forces(q0) + 0.9 * robot.model.friction.static * [1, -1, 1, -1, 1, -1, 1]
    found = robot.rollout(q0, np.zeros(7), held, duration=10.0, every=1000, friction=True)
    assert not found.dq.any() and np.array_equal(found.q[-1], q0)


@pytest.mark.slow
@pytest.mark.skipif("xarm_description/xarm7" not in FILES, reason="example-robot-data is not there")
def test_xarm7_comes_down_as_an_adaptive_method_has_it():
    """SciPy's Radau for 3 s, on friction eased off below 1e-4 rad/s; the methods of ours would need steps of 1e-8 s for that."""
    from scipy.integrate import solve_ivp

    robot = tw.load(FILES["xarm_description/xarm7"], inertia="accept")
    law = robot.model.friction

    def rate(_t, y):
        return np.r_[
            y[7:], robot.forward_dynamics(y[:7], y[7:], -law.viscous * y[7:] - law.static * np.tanh(y[7:] / 1e-4))
        ]

    wanted = solve_ivp(rate, (0, 3.0), np.zeros(14), method="Radau", rtol=1e-7, atol=1e-9).y[:7, -1]
    found = robot.rollout(np.zeros(7), np.zeros(7), dt=H, duration=3.0, friction=True)
    assert np.abs(found.q[-1] - wanted).max() < 1e-3
