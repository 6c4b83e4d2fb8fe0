"""Rollouts: every kernel takes the steps that a plain loop takes, whatever its lanes, its law, its method, its robot."""

from __future__ import annotations

import functools
from itertools import pairwise

import numpy as np
import pytest
from quick import mostly_slow
from simulated import rates

import twistwrench as tw
from twistwrench.compiler.lowering import lower, scan_loop
from twistwrench.compiler.lowering.target_machine import DOUBLE, choices, host
from twistwrench.compiler.runtime.gufunc import make_ufunc, owner_of
from twistwrench.mechanics.lie import quaternion
from twistwrench.simulation import BatchComputedTorque, BatchPD
from twistwrench.simulation import rollout_steps as rollout_kernel
from twistwrench.simulation.compiled_steps import StepPlan
from twistwrench.simulation.torque_laws import GivenTorque
from twistwrench.testing import random_robot, random_state

H, STEPS = 2e-3, 12
ROBOTS = {
    "arm": lambda: tw.robots.ur5(),
    "mixed": lambda: random_robot(3, joints=4, kinds=("prismatic", "helical", "revolute", "mimic")),
    "planar": lambda: random_robot(100, joints=3, kinds=("planar", "revolute")),
    "floating": lambda: random_robot(4, joints=2, floating_base=True),
}


@functools.cache
def robot_named(name):
    return ROBOTS[name]()


def some_states(robot, size, seed=1, dtype=float):
    state = random_state(robot, seed, size)
    return state.q.astype(dtype), (0.3 * state.dq).astype(dtype)


def round_off(robot, q, dq, reached, u=2.0**-53):
    """How far two ways to take the same steps may be apart: each acceleration is off by some cond(M) u of those that M q̈ is
    the sum of, 100 u for the hundreds of operations behind it; steps add up what they are off, and motions of hundredths of
    a second do not let it grow."""
    q = np.asarray(q, float)
    light = np.linalg.cond(robot.mass_matrix(q)).max()
    ddq = max(1.0, np.abs(robot.forward_dynamics(q, dq, np.zeros(robot.nv))).max())
    return 100 * u * (np.abs(reached).max() + STEPS * H * light * ddq)


def law_of(name, robot, rng):
    kp, kd = rng.uniform(1, 5, robot.nv), rng.uniform(0.01, 0.05, robot.nv)
    q_des, dq_des, ddq_des = robot.random_configuration(rng), *rng.normal(size=(2, robot.nv))
    return {
        "no torques": None,
        "held": rng.normal(size=robot.nv),
        "step by step": rng.normal(size=(STEPS, robot.nv)),
        "PD": BatchPD(q_des, kp, kd, dq_des, gravity=False),
        "PD and gravity": BatchPD(q_des, kp, 0.02, gravity=True),
        "computed": BatchComputedTorque(q_des, kp, kd, dq_des, ddq_des),
    }[name]


def torque_of(law, robot, k, q, dq, h=0.0):
    """The law by the robot's own methods."""
    if law is None or isinstance(law, np.ndarray):
        return np.zeros(robot.nv) if law is None else law if law.ndim == 1 else law[k]
    e = np.zeros(robot.nv)
    for body in robot.model.leaders:
        if body.joint.nv == 1:
            e[body.v_index] = law.q_des[body.q_index] - q[body.q_index]
    u = driven(robot) * (law.kp * e + law.kd * (law.dq_des - dq))
    if isinstance(law, BatchComputedTorque):
        return robot.inverse_dynamics(q, dq, law.ddq_des + u)
    return u + driven(robot) * robot.gravity_forces(q) if law.gravity else u


def driven(robot):
    found = np.zeros(robot.nv)
    for body in robot.model.leaders:
        found[body.v_index] = body.joint.nv == 1
    return found


def normalised(robot, q):
    q = q.copy()
    for body in robot.model.leaders:
        if body.joint.kind == "floating":
            q[body.q_index : body.q_index + 4] /= np.linalg.norm(q[body.q_index : body.q_index + 4])
    return q


def step_by_step(robot, q, dq, law, method, steps=STEPS, h=H):
    """One state, by methods of the robot alone."""
    taus = []
    for k in range(steps):

        def f(q, dq, k=k):
            return rates(robot, q, dq), robot.forward_dynamics(q, dq, torque_of(law, robot, k, q, dq))

        if method == "semi_implicit":
            tau = torque_of(law, robot, k, q, dq, h)
            kd = driven(robot) * law.kd if isinstance(law, BatchPD) else np.zeros(robot.nv)
            change = np.linalg.solve(robot.mass_matrix(q) + h * np.diag(kd), h * (tau - robot.bias_forces(q, dq)))
            taus.append(tau - kd * change)
            dq = dq + change
            q = robot.add(q, h * dq)
        else:
            taus.append(torque_of(law, robot, k, q, dq))
            a = f(q, dq)
            b = f(q + h / 2 * a[0], dq + h / 2 * a[1])
            c = f(q + h / 2 * b[0], dq + h / 2 * b[1])
            d = f(q + h * c[0], dq + h * c[1])
            q, dq = (x + h / 6 * (a[i] + 2 * b[i] + 2 * c[i] + d[i]) for i, x in enumerate((q, dq)))
        q = normalised(robot, q)
    return q, dq, np.array(taus)


LAWS = ("no torques", "held", "step by step", "PD", "PD and gravity", "computed")


SERVED = [(name, law) for name in ROBOTS for law in LAWS if law != "computed" or name in ("arm", "mixed")]
"""Computed torque wants joints of one degree of freedom; it says so below."""


@pytest.mark.parametrize(
    ("name", "law", "method"), mostly_slow([(*served, m) for served in SERVED for m in ("semi_implicit", "rk4")], 5)
)
def test_a_rollout_takes_the_steps_of_a_plain_loop(name, law, method):
    robot, size = robot_named(name), 5
    law = law_of(law, robot, np.random.default_rng(2))
    q0, dq0 = some_states(robot, size)
    found = robot.rollout(q0, dq0, law, dt=H, steps=STEPS, method=method, torques=True)
    assert found.q.shape == (size, STEPS + 1, robot.nq) and found.tau.shape == (size, STEPS, robot.nv)
    tolerance = round_off(robot, q0, dq0, found.dq)
    for k in range(size):
        q, dq, taus = step_by_step(robot, normalised(robot, q0[k]), dq0[k], law, method)
        assert np.abs(found.q[k, -1] - q).max() < tolerance
        assert np.abs(found.dq[k, -1] - dq).max() < tolerance
        assert np.abs(found.tau[k] - taus).max() < 1e4 * tolerance  # kp and M times what states are off


def test_a_law_with_gravity_and_one_without_are_two_on_one_robot():
    """A pendulum of 1 kg at 1 m, 0.7 rad from hanging: it stays where it is held, and begins to fall with g sin 0.7."""
    pendulum, q = tw.robots.pendulum(), [0.7]
    for gravity, ddq in ((True, 0.0), (False, -9.81 * np.sin(0.7)), (True, 0.0)):
        found = pendulum.rollout(q, [0.0], BatchPD(q, 100.0, 0.0, gravity=gravity), dt=H, steps=1)
        np.testing.assert_allclose(found.dq[-1], [H * ddq], rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("method", ("semi_implicit", "rk4"))
@pytest.mark.parametrize("name", ("arm", "floating"))
def test_rollouts_and_simulations_agree(name, method):
    robot = robot_named(name)
    q0, dq0 = some_states(robot, 2)
    tau = np.random.default_rng(5).normal(size=robot.nv)
    many = robot.rollout(q0, dq0, tau, dt=H, steps=STEPS, method=method, friction=True)
    for k in range(2):
        one = robot.simulate(q0[k], dq0[k], STEPS * H, H, tau=tau, method=method, friction=True)
        tolerance = round_off(robot, q0, dq0, one.dq)
        assert np.abs(many.q[k] - one.q).max() < tolerance
        assert np.abs(many.dq[k] - one.dq).max() < tolerance
        assert np.allclose(many.times, one.times, rtol=1e-14)


def test_friction_costs_what_it_costs_in_a_simulation():
    robot = tw.robots.planar_2r().with_actuators(
        {
            "actuators": {
                j: {
                    "friction": {
                        "coulomb": "0.5 N m",
                        "static": "0.8 N m",
                        "viscous": "0.1 N m s/rad",
                        "stribeck": "0.2 rad/s",
                    }
                }
                for j in ("joint1", "joint2")
            }
        }
    )
    start = [0.3, -0.8], [1.0, -2.0]
    for method in ("semi_implicit", "rk4"):
        many = robot.rollout(*start, dt=1e-3, steps=200, method=method, friction=True)
        one = robot.simulate(*start, 0.2, 1e-3, method=method, friction=True)
        assert np.abs(many.dq - one.dq).max() < 1e-11
        assert np.abs(many.dq - robot.rollout(*start, dt=1e-3, steps=200, method=method).dq).max() > 0.01


def test_dry_friction_and_masses_that_are_parameters_act_like_those_of_the_robot():
    """At rest, too: it stops joints and holds them; four-step methods ease it off below a speed that depends on both."""

    def rubbed(coulomb, static):
        laws = {"friction": {"coulomb": f"{coulomb} N m", "static": f"{static} N m", "stribeck": "0.2 rad/s"}}
        return tw.robots.planar_2r().with_actuators({"actuators": dict.fromkeys(("joint1", "joint2"), laws)})

    heavy, light = rubbed(0.5, 0.8), rubbed(20.0, 30.0)
    said = {f"{j}.{law}": x for j in ("joint1", "joint2") for law, x in (("coulomb", 20.0), ("static", 30.0))}
    start, given = ([0.3, -0.8], [0.1, 0.1]), {"dt": 1e-3, "steps": 200, "friction": True}
    masses = {name: x / 20 for name, x in light.varying("*.mass").items() if x}
    for method in ("semi_implicit", "rk4"):
        given["method"] = method
        many = heavy.rollout(*start, parameters={**said, "joint1.static": np.array([30.0, 40.0])}, **given)
        assert np.abs(many.dq[0] - light.rollout(*start, **given).dq).max() < 1e-9
        steps = np.diff(light.rollout(*start, parameters=masses, **given).dq[100:], axis=0)
        # rests, or creeps evenly; chatter would change speeds by h f / m, some rad/s
        assert (np.abs(steps) < 1e-3).all()


# ── the same bits everywhere ──


@pytest.mark.parametrize("dtype", (np.float64, np.float32))
@pytest.mark.parametrize("method", ("semi_implicit", "rk4"))
def test_a_sample_has_the_same_bits_in_every_batch_and_place(method, dtype):
    robot = robot_named("arm")
    q0, dq0 = some_states(robot, 19, dtype=dtype)
    taus = np.random.default_rng(3).normal(size=(19, 6, robot.nv)).astype(dtype)
    options = {"dt": H, "method": method, "torques": True}
    whole = robot.rollout(q0, dq0, taus, **options)
    assert whole.q.dtype == whole.dq.dtype == whole.tau.dtype == dtype and whole.steps == 6
    order = np.random.default_rng(1).permutation(19)
    turned = robot.rollout(q0[order], dq0[order], taus[order], **options)
    assert np.array_equal(turned.q, whole.q[order]) and np.array_equal(turned.tau, whole.tau[order])
    for size in (1, 2, 3, 4, 5, 7, 8, 9, 16, 17):
        part = robot.rollout(q0[:size], dq0[:size], taus[:size], **options)
        assert np.array_equal(part.q, whole.q[:size]) and np.array_equal(part.dq, whole.dq[:size])
    alone = robot.rollout(q0[7], dq0[7], taus[7], **options)
    assert np.array_equal(alone.dq, whole.dq[7])
    assert np.array_equal(whole.q[:, 0], q0) and np.array_equal(whole.tau, taus)


def test_layouts_and_broadcasting_change_no_bit():
    robot = robot_named("arm")
    q0, dq0 = some_states(robot, 6)
    taus = np.random.default_rng(3).normal(size=(6, 4, robot.nv))
    plain = robot.rollout(q0, dq0, taus)
    assert np.array_equal(robot.rollout(np.asfortranarray(q0), dq0[::-1][::-1], np.asfortranarray(taus)).q, plain.q)
    grid = robot.rollout(q0.reshape(2, 3, -1), dq0.reshape(2, 3, -1), taus.reshape(2, 3, 4, -1))
    assert np.array_equal(grid.q.reshape(plain.q.shape), plain.q)
    crossed = robot.rollout(q0[:2, None], dq0[:3], taus[:3])
    assert crossed.batch == (2, 3)
    assert np.array_equal(crossed.dq[1, 2], robot.rollout(q0[1], dq0[2], taus[2]).dq)
    held = robot.rollout(q0, dq0, taus[:, :1], steps=4)
    assert np.array_equal(held.q, robot.rollout(q0, dq0, np.repeat(taus[:, :1], 4, axis=1)).q)
    assert np.array_equal(robot.rollout(q0, dq0, taus[0, 0], steps=4).q[0], held.q[0])
    q0, dq0 = some_states(robot, 2 * host().lanes(DOUBLE) + 3)  # whole vectors of samples are copied in another way
    taus = np.random.default_rng(4).normal(size=(len(q0), 4, robot.nv))
    turned = [np.asfortranarray(x) for x in (q0, dq0, taus)]
    assert np.array_equal(robot.rollout(*turned).q, robot.rollout(q0, dq0, taus).q)


def test_every_keeps_some_of_the_same_states():
    robot = robot_named("floating")
    q0, dq0 = some_states(robot, 5)
    all_of_them = robot.rollout(q0, dq0, steps=12, torques=True)
    some = robot.rollout(q0, dq0, steps=12, every=4, torques=True)
    assert np.array_equal(some.q, all_of_them.q[:, ::4]) and np.array_equal(some.tau, all_of_them.tau[:, ::4])
    assert np.array_equal(some.times, all_of_them.times[::4]) and len(some) == 4
    assert np.array_equal(robot.rollout(q0, dq0, duration=0.012).q, all_of_them.q)


def test_out_takes_results_even_over_what_they_start_from():
    robot = robot_named("arm")
    q0, dq0 = some_states(robot, 6)
    first = robot.rollout(q0, dq0, steps=4, torques=True)
    wanted = robot.rollout(first.q[:, -1], first.dq[:, -1], first.tau, torques=True)
    q, dq, tau = first.q.copy(), first.dq.copy(), first.tau.copy()
    again = robot.rollout(q[:, -1], dq[:, -1], tau, torques=True, out=(q, dq, tau))
    assert again.q is q and again.dq is dq and again.tau is tau
    assert np.array_equal(q, wanted.q) and np.array_equal(dq, wanted.dq)
    for out in (
        q,
        (q,),
        (q, dq),
        (q, dq[:5], tau),
        (q, dq.astype(np.float32), tau),
        (q, np.asfortranarray(dq), tau),
        (1, 2, 3),
    ):
        with pytest.raises(tw.ShapeError, match="out= "):
            robot.rollout(q0, dq0, steps=4, torques=True, out=out)


def test_nan_stays_in_its_sample():
    robot = robot_named("floating")
    q0, dq0 = some_states(robot, 9)
    good = robot.rollout(q0, dq0, steps=5)
    assert not good.unstable.any() and "unstable" not in repr(good)
    for broken in (np.nan, np.inf):
        bad = q0.copy()
        bad[3, -1] = broken
        found = robot.rollout(bad, dq0, steps=5)
        others = np.arange(9) != 3
        assert np.array_equal(found.q[others], good.q[others]) and np.array_equal(found.dq[others], good.dq[others])
        assert found.unstable.tolist() == [k == 3 for k in range(9)]
        assert found.unstable_from[3] == 0.0 and np.isinf(found.unstable_from[others]).all()


def test_unstable_motions_are_named_with_the_time():
    robot = robot_named("arm")
    q0, dq0 = some_states(robot, 6)
    kp = np.full((6, 1, robot.nv), 5.0)
    kp[4] = 1e6  # h² kp / I far above 4: the bound of explicit springs
    found = robot.rollout(q0, dq0, BatchPD(robot.neutral, kp, 0.01, gravity=False), steps=400, every=2)
    assert found.unstable.tolist() == [k == 4 for k in range(6)]
    first = np.argmax(~(np.abs(found.dq[4]) < 1e6).all(axis=-1))
    assert 0 < found.unstable_from[4] == found.times[first] < 0.4
    assert "1 unstable, first (4,) at" in repr(found)


def test_a_motion_that_is_none_from_its_start_is_not_blamed_on_the_step():
    found = tw.robots.pendulum().rollout([[1.0], [1.0]], [[0.0], [np.nan]], dt=1e-3, steps=10)
    assert "1 unstable, first (1,) at 0 s: look at its q0 and dq0" in repr(found)
    fast = tw.robots.pendulum().rollout([[1.0], [1.0]], [[0.0], [0.0]], [[[0.0]], [[1e12]]], dt=1e-3, steps=10)
    assert "1 unstable, first (1,) at 0.001 s: take a smaller dt" in repr(fast)


def test_friction_that_is_given_with_a_rollout_alone_acts():
    """1.5 N m on 1 kg m² take 0.75 rad/s in half a second, off a wheel whose file has no friction."""
    wheel = tw.robots.pendulum().with_gravity([0, 0, 0])
    found = wheel.rollout(
        [0.0], [2.0], dt=1e-3, steps=500, friction=True, parameters={"hinge.coulomb": np.array([0.0, 1.5])}
    )
    np.testing.assert_allclose(found.dq[:, -1, 0], [2.0, 1.25], atol=1e-9)


@pytest.mark.parametrize(
    ("kind", "speed", "torque", "wanted"),
    [
        ("viscous", 2.0, 0.0, 2.0 * np.exp(-0.25)),
        ("coulomb", 2.0, 0.0, 2.0 - 0.5 * 0.5),
        ("static", 0.0, 0.4, 0.0),  # below the friction, which holds it
        ("load", 2.0, 2.0, 2.0 + 0.5 * 2.0 / 1.5),  # of 2 N m, a third is lost
        ("load", 2.0, -1.0, 2.0 - 0.5 * 1.0 / 0.5),  # what brakes is helped
    ],
)
def test_each_kind_of_friction_acts_if_only_the_parameters_of_a_rollout_give_it(kind, speed, torque, wanted):
    """Half a second of 1 kg m² whose file has no friction: without it, the speed gains half the torque."""
    wheel = tw.robots.pendulum().with_gravity([0, 0, 0])
    parameters = {f"hinge.{kind}": np.array([0.0, 0.5])}
    found = wheel.rollout([0.0], [speed], [torque], dt=1e-3, steps=500, friction=True, parameters=parameters)
    np.testing.assert_allclose(found.dq[:, -1, 0], [speed + 0.5 * torque, wanted], atol=2e-4)
    assert found.remarks == ()


@pytest.mark.parametrize("name", mostly_slow(("arm", "planar", "floating"), 3))
@pytest.mark.parametrize("method", ("semi_implicit", "rk4"))
def test_every_processor_takes_the_same_steps(name, method, monkeypatch):
    """Processors that fuse give the same bits; those that do not, the same to round-off."""
    robot = robot_named(name)
    q0, dq0 = some_states(robot, 7)
    wanted = robot.rollout(q0, dq0, dt=H, steps=STEPS, method=method)
    tolerance = round_off(robot, q0, dq0, wanted.dq)
    fused = owner_of(next(k for key, k in robot.engine._kernels.items() if key[0] == "rollout")).machine.fused
    for cpu, machine in choices().items():
        monkeypatch.setenv("TWISTWRENCH_CPU", cpu)
        found = tw.Robot(robot.model).rollout(q0, dq0, dt=H, steps=STEPS, method=method)
        if machine.fused == fused:
            assert np.array_equal(found.q, wanted.q) and np.array_equal(found.dq, wanted.dq)
        assert np.abs(found.dq - wanted.dq).max() < tolerance
    monkeypatch.setenv("TWISTWRENCH_JIT", "0")
    plain = tw.Robot(robot.model).rollout(q0, dq0, dt=H, steps=STEPS, method=method, every=3, torques=True)
    assert np.abs(plain.q - wanted.q[:, ::3]).max() < tolerance and not plain.tau.any()


def test_without_a_compiler_torques_are_those_at_the_states_that_are_kept(monkeypatch):
    robot = robot_named("arm")
    q0, dq0 = some_states(robot, 3)
    law = BatchPD(robot.neutral, 20.0, 0.5, gravity=False)
    wanted = robot.rollout(q0, dq0, law, steps=6, torques=True)
    monkeypatch.setenv("TWISTWRENCH_JIT", "0")
    plain = tw.Robot(robot.model).rollout(q0, dq0, law, steps=6, every=3, torques=True)
    assert np.abs(np.diff(wanted.tau, axis=1)).min() > 1e-6  # from step to step they do change
    np.testing.assert_allclose(plain.tau, wanted.tau[:, ::3], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("every", [1, 3])
@pytest.mark.parametrize(("method", "kd"), [("semi_implicit", 0.0), ("rk4", 0.5)])
def test_without_a_compiler_torques_of_every_method_are_those_where_its_steps_begin(method, kd, every, monkeypatch):
    """Of several stages as of one: a formula of the states that are kept. (Semi-implicit steps damp the speed they reach.)"""
    monkeypatch.setenv("TWISTWRENCH_JIT", "0")
    robot, q_des = tw.robots.planar_2r(), np.array([0.3, -0.2])
    q0, dq0 = some_states(robot, 3)
    law = BatchPD(q_des, 20.0, kd, gravity=False)
    found = robot.rollout(q0, dq0, law, dt=0.01, steps=6, method=method, every=every, torques=True)
    wanted = 20.0 * (q_des - found.q) - kd * found.dq
    count = 6 // every
    assert found.tau.shape == (3, count, 2)
    assert np.abs(np.diff(wanted, axis=1)).min() > 1e-3  # a stage away they do change
    np.testing.assert_allclose(found.tau, wanted[:, :count], rtol=1e-12, atol=1e-12)


def test_long_programs_and_buffers_off_the_stack(monkeypatch):
    robot = tw.robots.quadruped()
    q0, dq0 = some_states(robot, 5)
    q_des = robot.neutral
    law = BatchPD(q_des, 20.0, 0.5, gravity=True)
    found = robot.rollout(q0, dq0, law, steps=6, every=2, method="rk4", torques=True)
    q, dq, taus = step_by_step(robot, q0[4], dq0[4], law, "rk4", steps=6, h=1e-3)
    tolerance = round_off(robot, q0, dq0, found.dq)
    assert np.abs(found.dq[4, -1] - dq).max() < tolerance and np.abs(found.q[4, -1] - q).max() < tolerance
    assert np.abs(found.tau[4] - taus[::2]).max() < 1e3 * tolerance
    monkeypatch.setattr(scan_loop, "ON_STACK", 0)
    again = tw.Robot(robot.model).rollout(q0, dq0, law, steps=6, every=2, method="rk4", torques=True)
    assert np.array_equal(again.q, found.q) and np.array_equal(again.tau, found.tau)


def test_parts_and_threads_change_no_bit(monkeypatch):
    robot = robot_named("arm")
    q0, dq0 = some_states(robot, 99)
    wanted = robot.rollout(q0, dq0, steps=8)
    crossed = robot.rollout(q0[:40, None], dq0[:3], steps=8)
    monkeypatch.setattr(rollout_kernel, "OPERATIONS_PER_CALL", 1.0)
    try:
        for threads in (1, 2):
            tw.set_threads(threads)
            assert np.array_equal(robot.rollout(q0, dq0, steps=8).q, wanted.q)
            assert np.array_equal(robot.rollout(q0[:40, None], dq0[:3], steps=8).dq, crossed.dq)
    finally:
        tw.set_threads(1)


# ── what theory says ──


@pytest.mark.parametrize(("method", "order"), [("semi_implicit", 1), ("rk4", 4)])
def test_computed_torque_makes_every_joint_an_oscillator_of_its_own(method, order):
    """ë + kd ė + kp e = 0 with kp = w², kd = 2 w is critically damped: e = (e0 + (ė0 + w e0) t) exp(-w t). MR eq. 11.10."""
    robot, w, duration = robot_named("arm"), np.array([4.0, 5, 6, 7, 8, 9]), 0.5
    q0, dq0 = some_states(robot, 3)
    q_des = np.array([0.3, -1.0, 1.2, 0.1, -0.2, 0.4])
    errors = []
    for steps in (50, 100):
        found = robot.rollout(
            q0, dq0, BatchComputedTorque(q_des, w**2, 2 * w), steps=steps, dt=duration / steps, method=method
        )
        t = found.times[:, None]
        e0, de0 = (q_des - q0)[:, None], -dq0[:, None]
        e = (e0 + (de0 + w * e0) * t) * np.exp(-w * t)
        errors.append(np.abs(q_des - found.q - e).max())
    assert abs(np.log2(errors[0] / errors[1]) - order) < 0.15, errors
    assert errors[1] < 0.03 * np.abs(e0).max()


def test_computed_torque_is_linear_step_by_step():
    """Semi-implicit steps of decoupled oscillators are a matrix, whatever the arm."""
    robot, kp, kd, h = robot_named("arm"), 30.0, 8.0, 1e-3
    q0, dq0 = some_states(robot, 4)
    q_des = np.zeros(6)
    found = robot.rollout(q0, dq0, BatchComputedTorque(q_des, kp, kd), steps=100, dt=h)
    x = np.stack([q0 - q_des, dq0])
    A = np.array([[1 - h * h * kp, h * (1 - h * kd)], [-h * kp, 1 - h * kd]])
    wanted = np.einsum("ij,jnk->ink", np.linalg.matrix_power(A, 100), x)
    assert np.abs(found.q[:, -1] - q_des - wanted[0]).max() < 1e-11
    assert np.abs(found.dq[:, -1] - wanted[1]).max() < 1e-10


def test_references_may_move():
    """Along a reference that starts where the robot is, computed torque leaves no error but the method's."""
    robot, h, n = robot_named("arm"), 1e-3, 300
    t = np.arange(n)[:, None] * h
    amplitude, rate = np.array([0.5, 0.3, 0.4, 0.2, 0.6, 0.1]), 3.0
    q_des, dq_des = amplitude * np.sin(rate * t), amplitude * rate * np.cos(rate * t)
    law = BatchComputedTorque(q_des, 100.0, 20.0, dq_des, -rate * rate * q_des)
    found = robot.rollout(q_des[0], dq_des[0], law, dt=h)
    assert found.steps == n
    assert np.abs(found.q[:-1] - q_des).max() < 3 * h * amplitude.max() * rate  # order 1


def test_pd_with_gravity_holds_the_unloaded_robot_and_sags_under_a_payload():
    """At rest kp e = τ_payload: what gravity compensation of the unloaded robot leaves to the springs."""
    robot = robot_named("arm")
    q_des, kp = np.array([0.0, -1.0, 1.0, 0.3, 0.2, 0.0]), np.array([8e3, 8e3, 8e3, 500, 500, 500.0])
    M = robot.mass_matrix(q_des)
    kd = 1.4 * np.sqrt(kp * np.diagonal(M))
    masses = np.array([0.0, 1.0, 2.0])
    found = robot.rollout(
        q_des,
        np.zeros(6),
        BatchPD(q_des, kp, kd, gravity=True),
        steps=4000,
        dt=5e-4,
        every=4000,
        method="rk4",
        parameters={"tool0.mass": masses},
    )
    assert not found.unstable.any() and np.abs(found.dq[:, -1]).max() < 1e-3
    assert np.abs(found.q[0, -1] - q_des).max() < 1e-12
    for k, mass in enumerate(masses):
        q = found.q[k, -1]
        loaded = robot.with_payload(tw.SpatialInertia.from_com(mass, (0, 0, 0)), frame="tool0")
        left = loaded.gravity_forces(q) - robot.gravity_forces(q)
        assert np.abs(kp * (q_des - q) - left).max() < 0.02 * max(1.0, np.abs(left).max())


@pytest.mark.parametrize("name", ("arm", "floating"))
def test_torques_are_clipped(name):
    robot = robot_named(name)
    q0, dq0 = some_states(robot, 3)
    limits = np.random.default_rng(4).uniform(0.5, 3.0, robot.nv)
    limits[0] = np.inf
    asked = 5.0 * np.random.default_rng(5).normal(size=(3, STEPS, robot.nv))
    found = robot.rollout(q0, dq0, asked, dt=H, torque_limits=limits, torques=True)
    assert np.array_equal(found.tau, np.clip(asked, -limits, limits)) and (found.tau != asked).any()
    assert np.array_equal(found.q, robot.rollout(q0, dq0, found.tau, dt=H).q)
    asked[1, 4, 2] = np.nan
    broken = robot.rollout(q0, dq0, asked, dt=H, torque_limits=limits, torques=True)
    assert np.isnan(broken.tau[1, 4, 2]) and broken.unstable.tolist() == [False, True, False]
    law = BatchPD(robot.neutral, 1e4, 1.0, gravity=False)
    held = robot.rollout(q0, dq0, law, steps=STEPS, torque_limits=True, torques=True)
    assert (np.abs(held.tau) <= robot.limits.effort).all()
    for said in (True, False):  # NumPy's own truth is not a number
        one, other = (robot.rollout(q0, dq0, law, steps=STEPS, torque_limits=x) for x in (said, np.bool_(said)))
        assert np.array_equal(one.q, other.q, equal_nan=True)  # too stiff for this step: some become NaN
    driven = np.isfinite(robot.limits.effort)
    assert (np.abs(held.tau[..., driven]) == robot.limits.effort[driven]).any() or not driven.any()


def test_every_sample_has_its_own_payload():
    robot = robot_named("arm")
    q0, dq0 = some_states(robot, 3)
    masses = np.array([0.0, 0.7, 3.0])
    found = robot.rollout(
        q0, dq0, dt=H, steps=STEPS, parameters={"tool0.mass": masses, "shoulder_pan_joint.viscous": 0.3}
    )
    for k, mass in enumerate(masses):
        loaded = robot.with_payload(tw.SpatialInertia.from_com(mass, (0, 0, 0)), frame="tool0")
        _, dq, _ = step_by_step(loaded, q0[k], dq0[k], None, "semi_implicit")
        assert np.abs(found.dq[k, -1] - dq).max() < round_off(loaded, q0, dq0, found.dq)


def test_wrenches_on_the_robot():
    """A wrench on the robot is J' F in its torques, and may differ by sample and step."""
    robot = robot_named("floating")
    q0, dq0 = some_states(robot, 3)
    frame = robot.frame_names[-1]
    F = np.random.default_rng(8).normal(size=(3, STEPS, 6))
    found = robot.rollout(q0, dq0, dt=H, wrench_on_robot={frame: F})
    assert found.steps == STEPS
    for k in range(3):
        q, dq = normalised(robot, q0[k]), dq0[k]
        for j in range(STEPS):
            dq = dq + H * robot.forward_dynamics(q, dq, np.zeros(robot.nv), wrench_on_robot={frame: F[k, j]})
            q = robot.add(q, H * dq)
        assert np.abs(found.dq[k, -1] - dq).max() < round_off(robot, q0, dq0, found.dq)


@pytest.mark.parametrize(("method", "order"), [("semi_implicit", 1), ("rk4", 4)])
@pytest.mark.parametrize("name", ("arm", "planar", "floating"))
def test_the_order_is_measured(name, order, method):
    """Halving the step divides the distance between solutions by 2^order; a sixth of an order is allowed for the next terms."""
    robot = robot_named(name)
    q0, dq0 = some_states(robot, 4, seed=6)
    ends = [robot.rollout(q0, dq0, dt=0.2 / n, steps=n, every=n, method=method) for n in (64, 128, 256)]
    gaps = [
        max(np.abs(robot.subtract(a.q[:, -1], b.q[:, -1])).max(), np.abs(a.dq[:, -1] - b.dq[:, -1]).max())
        for a, b in pairwise(ends)
    ]
    assert abs(np.log2(gaps[0] / gaps[1]) - order) < (0.2 if order == 1 else 0.7), gaps


def test_energy_of_semi_implicit_steps_swings_and_has_no_trend():
    """The method is symplectic for a pendulum: energy swings by something of order h and comes back; explicit steps gain."""
    robot = tw.robots.pendulum()
    spread = []
    for h in (4e-3, 2e-3):
        found = robot.rollout(np.linspace(0.5, 2.5, 5)[:, None], [0.0], dt=h, duration=40.0)
        energy = robot.kinetic_energy(found.q, found.dq) + robot.potential_energy(found.q)
        swing = np.ptp(energy, axis=1)
        third = len(found) // 3
        trend = np.abs(energy[:, -third:].mean(axis=1) - energy[:, :third].mean(axis=1))
        assert (trend < 0.1 * swing).all()
        spread.append(swing)
    assert np.allclose(spread[0] / spread[1], 2.0, rtol=0.05)


def test_quaternions_keep_unit_length_and_take_any():
    robot = robot_named("floating")
    q0, dq0 = some_states(robot, 4)
    longer = q0.copy()
    longer[:, :4] *= 7.0
    for method in ("semi_implicit", "rk4"):
        found = robot.rollout(longer, dq0, steps=50, method=method)
        assert np.abs(np.linalg.norm(found.q[:, 1:, :4], axis=-1) - 1).max() < 1e-15 * 4
        wanted = robot.rollout(q0, dq0, steps=50, method=method)
        assert np.abs(robot.subtract(found.q[:, -1], wanted.q[:, -1])).max() < 1e-12


def test_steps_from_rest_and_small_turns_are_exact_at_every_angle():
    """q ⊕ v without a branch against the one with a series, from no turn at all to several radians a step."""
    body = tw.robots.floating_box().with_gravity([0, 0, 0])
    for size in (0.0, 1e-300, 1e-170, 1e-16, 1e-12, 1e-8, 1e-5, 1e-3, 0.1, 1.0, 3.0, 6.0):
        w = size * np.array([0.36, 0.48, 0.8])
        dq = np.r_[w, 1.0, -2.0, 0.5]
        # one step of a second; a box turning about no principal axis has accelerations of its own
        ddq = body.forward_dynamics(body.neutral, dq, np.zeros(6))
        wanted = body.add(body.neutral, dq + ddq)
        found = body.rollout(body.neutral, dq, steps=1, dt=1.0).q[-1]
        assert np.abs(found - wanted).max() < 1e-14 * (1 + np.abs(ddq).max())


# ── float32 ──


@pytest.mark.parametrize("name", ("arm", "floating"))
def test_float32_is_float64_to_its_round_off(name):
    robot = robot_named(name)
    q0, dq0 = some_states(robot, 5, dtype=np.float32)
    for method in ("semi_implicit", "rk4"):
        single = robot.rollout(q0, dq0, dt=H, steps=STEPS, method=method)
        double = robot.rollout(q0.astype(float), dq0.astype(float), dt=H, steps=STEPS, method=method)
        assert single.q.dtype == np.float32
        tolerance = round_off(robot, q0, dq0, double.dq, u=2.0**-24)
        assert np.abs(single.dq - double.dq).max() < tolerance and np.abs(single.q - double.q).max() < tolerance
    assert robot.rollout(q0, dq0, np.zeros(robot.nv), steps=1).q.dtype == np.float64
    assert robot.rollout(q0, dq0, BatchPD(q0[0], 1.0, 0.1), steps=1).q.dtype == np.float32


# ── when something fails ──


def recurrence_of(robot):
    return StepPlan(robot.model, GivenTorque(), "semi_implicit").recurrence()


def test_a_failed_compilation_of_the_float32_loop_is_never_a_number(monkeypatch):
    kernel = make_ufunc(recurrence_of(tw.robots.cart_pole()), "rollout", "")
    assert kernel.signature == "(2),(2),(k),(k,2)->(m,2),(m,2)"

    def fails(*_):
        raise tw.KernelError("on purpose")

    x, dt, tau = np.ones((5, 2), np.float32), np.full(6, 1e-3, np.float32), np.zeros((6, 2), np.float32)
    monkeypatch.setattr("twistwrench.compiler.runtime.gufunc.compile_form", fails)
    out = np.zeros((5, 4, 2), np.float32)
    with pytest.raises(tw.KernelError, match="on purpose"):
        kernel(x, x, dt, tau, out=(out[:, :3], np.empty((5, 3, 2), np.float32)))
    assert np.isnan(out[:, :3]).all() and (out[:, 3] == 0).all()
    monkeypatch.undo()
    assert np.isfinite(kernel(x, x, dt, tau, out=(out[:, :3], np.empty((5, 3, 2), np.float32)))[0]).all()


def test_without_memory_results_are_nan(monkeypatch):
    robot = tw.robots.cart_pole()
    recurrence = recurrence_of(robot)
    monkeypatch.setattr(scan_loop, "ON_STACK", 0)
    text = lower.assembly(recurrence.program, DOUBLE, host(), scan_loop.loop_over(recurrence))
    none = "define internal ptr @malloc(i64 %size) noinline {\n  ret ptr null\n}"
    monkeypatch.setattr(
        "twistwrench.compiler.lowering.lower.modules", lambda *_: [text.replace("declare ptr @malloc(i64)", none)]
    )
    kernel = make_ufunc(recurrence, "starved", "")
    out = np.zeros((3, 5, 2))
    kernel(np.ones((3, 2)), np.ones((3, 2)), np.ones(4), np.ones((4, 2)), out=(out[:, :4], np.empty((3, 4, 2))))
    assert np.isnan(out[:, :4]).all() and (out[:, 4] == 0).all()


# ── empty and refused ──


def test_empty_batches():
    robot = robot_named("arm")
    found = robot.rollout(np.zeros((0, 6)), np.zeros((0, 6)), steps=3)
    assert found.q.shape == (0, 4, 6) and not found.unstable.any() and "0 motions" in repr(found)


BAD = {
    "q0 has shape (5,)": {"q0": np.zeros(5)},
    "dq0 has shape (3, 7)": {"dq0": np.zeros((3, 7))},
    "tau has shape (4,)": {"tau": np.zeros(4)},
    "tau has shape ()": {"tau": 1.0},
    "the axis before the last counts the steps: 10": {"tau": np.zeros((3, 6))},
    "kp has shape (3,), but robot 'ur5' wants 6 in the last axis, or one number": {"tau": BatchPD(np.zeros(6), np.ones(3), 1.0)},
    "kd has shape (5, 6)": {"tau": BatchPD(np.zeros(6), 1.0, np.ones((5, 6)))},
    "q_des has": {"tau": BatchPD(None, 1.0, 1.0)},
    "kp has": {"tau": BatchPD(np.zeros(6), "stiff", 1.0)},
    "tau has shape (6,) of complex": {"tau": np.zeros(6, complex)},
    "q0 has": {"q0": "home"},
    "q_des has shape (7,)": {"tau": BatchPD(np.zeros(7), 1.0, 1.0)},
    "do not broadcast: q0 (), dq0 (), tau (3,), the wrench at 'tool0' (2,)": {
        "tau": np.zeros((3, 1, 6)), "wrench_on_robot": {"tool0": np.zeros((2, 1, 6))},
    },
    "tau is a function": {"tau": lambda t, q, dq: q},
    "tau is the class BatchPD, not a law": {"tau": BatchPD},
    "an input of shape (2, 10, 6) for each of a batch (1000000000000, 2)": {
        "q0": np.broadcast_to(np.zeros(6), (10**12, 1, 6)), "tau": np.zeros((2, 10, 6)),
    },
    "dt is -0.001": {"dt": -1e-3},
    "dt is 0": {"dt": 0.0},
    "dt is nan": {"dt": np.nan},
    "steps is 0": {"steps": 0},
    "steps is 2.5": {"steps": 2.5},
    "more than 1e+09": {"steps": 10**12},
    "more than 1e+09 steps": {"steps": None, "duration": 1e12},
    "both steps and duration": {"duration": 1.0},
    "how long": {"steps": None},
    "duration is -1": {"steps": None, "duration": -1.0},
    "every=3 does not divide 10 steps": {"every": 3},
    "every is 0": {"every": 0},
    "'euler'": {"method": "euler"},
    "Did you mean 'tool0'": {"wrench_on_robot": {"tol0": np.zeros(6)}},
    "wrench_on_robot is a dict": {"wrench_on_robot": np.zeros(6)},
    "'tool0.mas'": {"parameters": {"tool0.mas": 1.0}},
    "is a pattern": {"parameters": {"*.mass": 1.0}},
    "parameters is a dict": {"parameters": 3.0},
    "'tool0.mass' is -1 kg in sample 1: link 'tool0'": {"parameters": {"tool0.mass": [0.5, -1.0]}},
    "'tool0.mass' is -2 kg in sample (1, 0)": {"parameters": {"tool0.mass": [[0.5, 1.0], [-2.0, 1.0]]}},
    "'elbow_joint.viscous' is -0.1, and friction": {"parameters": {"elbow_joint.viscous": -0.1}},
    "'elbow_joint.load' is 1 in sample 0": {"parameters": {"elbow_joint.load": [1.0]}},
    "link 'forearm_link' in sample 2 cannot exist: triangle": {"parameters": {"forearm_link.Izz": [0.05, 0.01, 9.0]}},
    "link 'forearm_link' cannot exist: negative": {"parameters": {"forearm_link.Ixx": -9.0}},
    "torque_limits has shape (4,)": {"torque_limits": np.ones(4)},
    "torque_limits has -1": {"torque_limits": [1, 1, 1, 1, 1, -1]},
    "torque_limits has nan": {"torque_limits": np.nan},
    "take 9.6e+07 GB, more than there is": {"q0": np.broadcast_to(np.zeros(6), (10**9, 6)), "steps": 10**6},
}  # fmt: skip


@pytest.mark.parametrize("said", BAD)
def test_what_cannot_be_meant_is_refused(said):
    robot = robot_named("arm")
    given = {"q0": np.zeros(6), "dq0": np.zeros(6), "steps": 10, **BAD[said]}
    with pytest.raises(tw.TwistWrenchError) as problem:
        robot.rollout(given.pop("q0"), given.pop("dq0"), **given)
    assert said in str(problem.value)


def test_tensors_that_a_body_absorbs_and_numbers_that_are_unknown_are_not_refused():
    """As in loading: a payload's tensor is judged with the link that carries it."""
    robot = robot_named("arm")
    given = {"tool0.mass": np.array([1.0, 0.0]), "tool0.Izz": np.array([1e-6, 0.0])}
    assert robot.rollout(np.zeros(6), np.zeros(6), steps=2, parameters=given).batch == (2,)
    unknown = robot.rollout(np.zeros(6), np.zeros(6), steps=2, parameters={"tool0.mass": [1.0, np.nan]})
    assert unknown.unstable.tolist() == [False, True]


def test_friction_of_a_robot_without_any_is_remarked():
    robot, rusty = tw.robots.planar_2r(), {"joint1.viscous": [0.1, 0.2]}
    found = robot.rollout([0, 0], [0, 0], steps=2, friction=True)
    one = robot.simulate([0, 0], [0, 0], 0.01, friction=True)
    for remarks in (found.remarks, one.remarks):
        assert any("friction is requested, but the robot file has none" in remark for remark in remarks)
    assert "friction is requested" in repr(found) and "friction is requested" in repr(one)
    assert robot.rollout([0, 0], [0, 0], steps=2).remarks == robot.simulate([0, 0], [0, 0], 0.01).remarks == ()
    assert robot.rollout([0, 0], [0, 0], steps=2, friction=True, parameters=rusty).remarks == ()


def test_robots_and_laws_that_do_not_go_together():
    with pytest.raises(tw.ValueRangeError, match="not a joint of one degree of freedom"):
        floating = robot_named("floating")
        floating.rollout(
            floating.neutral, np.zeros(floating.nv), BatchComputedTorque(floating.neutral, 1.0, 1.0), steps=1
        )
    with pytest.raises(tw.ValueRangeError, match="quaternion of zeros"):
        floating.rollout(np.zeros(floating.nq), np.zeros(floating.nv), steps=1)
    with pytest.raises(tw.ValueRangeError, match="no joint that moves"):
        fixed = tw.robots.pendulum()
        fixed.lock(dict.fromkeys(fixed.joint_names, 0.0)).rollout([], [], steps=1)
    chain = '<robot name="light"><link name="a"/><link name="b"/><joint name="j" type="continuous"><parent link="a"/><child link="b"/></joint></robot>'
    for friction in (False, True):
        with pytest.raises(tw.SingularMassMatrixError, match="joints j"):
            tw.load(chain).rollout([0.0], [0.0], steps=1, friction=friction)


def swinging(t):
    """(q_d, dq_d, ddq_d) of a joint reference of the UR5."""
    w = np.arange(1.0, 7.0)
    return 0.3 * np.sin(w * t), 0.3 * w * np.cos(w * t), -0.3 * w**2 * np.sin(w * t)


def inertias(robot):
    return np.diag(robot.mass_matrix(robot.neutral))


@pytest.mark.parametrize(
    ("reference", "method"),
    [(np.full(6, 0.4), "semi_implicit"), (swinging, "semi_implicit"), (swinging, "rk4")],
    ids=["held", "moving", "moving in stages"],
)
@pytest.mark.parametrize(
    "law",
    [
        lambda robot, r: tw.control.PD(robot, r, 100.0 * inertias(robot), 20.0 * inertias(robot)),
        lambda robot, r: tw.control.PD(robot, r, 2.0, 20.0 * inertias(robot), gravity=False),
        lambda robot, r: tw.control.ComputedTorque(robot, r, 100.0, 20.0),
    ],
    ids=["PD", "PD without gravity", "computed torque"],
)
def test_one_controller_drives_a_simulation_and_a_rollout(law, reference, method):
    """The same object, the same motion: to rounding where the reference rests or is read once a step, else to the step's order."""
    robot = tw.robots.ur5()
    controller = law(robot, reference)
    q0, dq0 = 0.1 * np.arange(6.0), np.zeros(6)
    alone = robot.simulate(q0, dq0, duration=0.2, dt=1e-3, method=method, tau=controller)
    found = robot.rollout(q0, dq0, controller, duration=0.2, dt=1e-3, method=method)
    once = method == "semi_implicit" or not callable(reference)
    np.testing.assert_allclose(found.q, alone.q, rtol=0, atol=1e-11 if once else 2e-2)
    if not once:  # read at the beginning of each step: halving it halves the distance
        half = robot.rollout(q0, dq0, controller, duration=0.2, dt=5e-4, every=2, method=method)
        ratio = np.abs(found.q - alone.q).max() / np.abs(half.q - alone.q).max()
        assert 1.8 < ratio < 2.2


def test_controllers_that_no_rollout_can_take():
    robot, other = tw.robots.planar_2r(), tw.robots.planar_2r()
    state = ([0.0, 0.0], [0.0, 0.0])
    with pytest.raises(tw.ValueRangeError, match="couple joints"):
        robot.rollout(*state, tw.control.PD(robot, [0, 0], [[2.0, 1.0], [1.0, 2.0]], 1.0), steps=2)
    with pytest.raises(tw.ValueRangeError, match="was made with the robot"):
        robot.rollout(*state, tw.control.PD(other, [0, 0], 1.0, 1.0), steps=2)
    with pytest.raises(tw.ValueRangeError, match="leaves friction out"):
        robot.rollout(*state, tw.control.ComputedTorque(robot, [0, 0], 1.0, 1.0, friction=True), steps=2)
    with pytest.raises(tw.ValueRangeError, match="call it"):
        robot.rollout(*state, tw.control.PD, steps=2)
    with pytest.raises(tw.ValueRangeError, match="how long"):
        robot.rollout(*state, tw.control.PD(robot, [0, 0], 1.0, 1.0))


def test_quaternion_products_are_traced_as_they_are_computed():
    """What rollouts trace of quaternions is the library's own."""
    robot = tw.robots.floating_box().with_gravity([0, 0, 0])
    q, dq = robot.neutral, np.array([0, 0, 0.3, 0, 0, 0])
    found = robot.rollout(q, dq, steps=10, dt=0.1).q[-1]
    assert np.abs(found[:4] - quaternion.exp([0, 0, 0.3])).max() < 1e-14


SPRUNG = """<mujoco><compiler angle="radian"/><worldbody><body name="a">
<joint name="a" axis="0 1 0" stiffness="20" springref="0.4"/><geom type="capsule" size="0.03" fromto="0 0 0 0.5 0 0"/>
<body name="b" pos="0.5 0 0"><joint name="b" axis="0 1 0" stiffness="5"/><geom size="0.05"/></body></body></worldbody></mujoco>"""


@pytest.mark.parametrize("method", ["rk4", "semi_implicit"])
def test_a_robot_with_springs_stays_where_a_law_with_gravity_holds_it(method):
    """And starts elsewhere as the controller of that name has it."""
    arm = tw.load(SPRUNG)
    goal, still = np.array([0.3, -0.2]), np.zeros(2)
    found = arm.rollout(goal, still, BatchPD(goal, 30.0, 3.0), dt=1e-3, steps=200, method=method)
    assert np.abs(found.q - goal).max() < 1e-12
    law, start = tw.control.PD(arm, goal, kp=30.0, kd=3.0), goal + 0.2
    step = arm.rollout(start, still, BatchPD(goal, 30.0, 3.0), dt=1e-9, steps=1, method=method).dq[-1]
    ddq = arm.forward_dynamics(start, still, law(0.0, start, still))
    assert step / 1e-9 == pytest.approx(ddq, abs=1e-4 * np.abs(ddq).max())
