"""What a simulation says of its own error, against SciPy's DOP853 and closed forms; and that saying it changes nothing."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import twistwrench as tw
from twistwrench.simulation import METHODS, JointStops, Plane
from twistwrench.simulation.accuracy.step_doubling import sample_steps
from twistwrench.testing import random_robot, random_state

FIXED = [m for m in METHODS if m != "dopri5"]


@pytest.fixture(scope="module")
def pendulum():
    """1 kg at 1 m: q'' = τ - 9.81 sin q."""
    return tw.robots.pendulum()


@pytest.fixture(scope="module")
def box():
    """6 kg."""
    return tw.robots.floating_box()


def truth(times, q0, tau=lambda t, q, dq: 0.0):
    """The pendulum at some times, from rest."""

    def f(t, y):
        return [y[1], tau(t, *y) - 9.81 * np.sin(y[0])]

    return solve_ivp(f, (0, times[-1]), [q0, 0.0], method="DOP853", rtol=1e-12, atol=1e-12, t_eval=times).y[0]


def off(found, wanted):
    return float(np.abs(found.q[:, 0] - wanted).max())


def said(found, words):
    return any(words in remark for remark in found.remarks)


STEPS = "errors of its steps"


# ── how far off ──


@pytest.mark.parametrize("n", [20, 4000])
def test_the_error_of_a_fall_by_eulers_steps_is_estimated_exactly(n):
    """Each step falls short by g h²/2, in whichever halves it is taken again, and velocities are right."""
    text = '<mujoco><worldbody><body><joint type="slide" axis="0 0 1"/><geom type="sphere" size="0.1" mass="2"/></body>'
    robot = tw.load(f"{text}</worldbody></mujoco>")
    h, g = 1.0 / n, float(np.linalg.norm(robot.gravity))
    found = robot.simulate([0.0], [0.0], 1.0, h, method="euler")
    assert len(sample_steps(n)) < n or n == 20
    fallen = -found.q[-1, 0]
    assert fallen == pytest.approx(0.5 * g - n * g * h**2 / 2, rel=1e-12)
    assert found.relative_error == pytest.approx(n * g * h**2 / 2 / fallen, rel=1e-9)


def test_metres_are_not_measured_against_radians():
    """Beside a wheel that turns by a hundred radians a fall of five metres is as far off as alone."""
    slide = '<body><joint type="slide" axis="0 0 1"/><geom type="sphere" size="0.1" mass="2"/></body>'
    wheel = '<body><joint type="hinge" axis="0 0 1"/><geom type="sphere" size="0.1" mass="2"/></body>'
    alone = tw.load(f"<mujoco><worldbody>{slide}</worldbody></mujoco>").simulate([0], [0], 1.0, 0.05, method="euler")
    both = tw.load(f"<mujoco><worldbody>{slide}{wheel}</worldbody></mujoco>")
    found = both.simulate([0, 0], [0, 100], 1.0, 0.05, method="euler")
    assert found.relative_error == pytest.approx(alone.relative_error, rel=1e-9)


@pytest.mark.parametrize("method", ["rk4", "semi_implicit", "dopri5"])
def test_a_fall_to_the_other_side_is_as_far_off(pendulum, method):
    """Half a swing: its velocities have one sign."""
    there, back = (pendulum.simulate([q], [0.0], 0.6, 2e-2, method=method, rtol=1e-4) for q in (1.0, -1.0))
    assert there.relative_error > 0.0
    assert back.relative_error == pytest.approx(there.relative_error, rel=1e-9)


@pytest.mark.parametrize(
    ("method", "duration"),
    [*((m, 2.0) for m in METHODS), *((m, 20.0) for m in ("rk4", "midpoint", "semi_implicit"))],
)
def test_the_error_of_a_swing_is_estimated_to_its_size(pendulum, method, duration):
    """Not less than a fifth of what it is, and not more than some hundred times: errors that cancel are added up.

    Midpoint steps err most along the way, which for a pendulum mostly cancels; dopri5 judges by its method of order 4.
    """
    dt = {"euler": 1e-3, "semi_implicit": 1e-3}.get(method, 0.02)
    found = pendulum.simulate([2.0], None, duration, dt, method=method, rtol=1e-6)
    error = off(found, truth(found.times, 2.0))
    assert error / 5 < found.error_estimate[0] < 300 * error
    assert found.relative_error == pytest.approx(found.error_estimate[0] / np.ptp(found.q))


@pytest.mark.parametrize("method", ["rk4", "dopri5"])
def test_an_error_is_relative_to_all_of_the_travel_wherever_the_motion_begins(pendulum, method):
    """From the bottom a pendulum swings as far to both sides."""
    found = pendulum.simulate([0.0], [3.0], 2.5, 0.02, method=method)
    assert np.ptp(found.q) == pytest.approx(2 * np.abs(found.q).max(), rel=1e-3)
    assert found.relative_error == pytest.approx(found.error_estimate[0] / np.ptp(found.q), rel=1e-9)


def test_velocities_of_semi_implicit_steps_lag_by_half_a_step():
    """A fall from rest begins with the velocity g h / 2 too much, which lasts for its travel over its largest speed."""
    text = '<mujoco><worldbody><body><joint type="slide" axis="0 0 1"/><geom type="sphere" size="0.1" mass="2"/></body>'
    robot, h = tw.load(f"{text}</worldbody></mujoco>"), 0.01
    found = robot.simulate([0.0], [0.0], 1.0, h, method="semi_implicit")
    lasts = np.ptp(found.q) / np.abs(found.dq).max()
    assert found.error_estimate[0] == pytest.approx(0.5 * 9.81 * h * lasts, rel=1e-6)


@functools.cache
def tree_of_all_kinds():
    """A floating robot, a state of it, and its motion for half a second by dopri5 at 1e-11, at every 5 ms."""
    robot = random_robot(1, joints=3, floating_base=True, kinds=("revolute", "prismatic", "planar"))
    state = random_state(robot, 1)
    return robot, state, robot.simulate(state.q, state.dq, 0.5, 0.005, rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize(("method", "dt"), [("rk4", 0.01), ("midpoint", 0.005), ("semi_implicit", 0.005)])
def test_the_error_of_a_tree_of_all_kinds_of_joints_is_estimated_to_its_size(method, dt):
    """Half a second of a floating robot, against dopri5 at 1e-11: errors hardly grow or cancel, so to a factor of five."""
    robot, state, wanted = tree_of_all_kinds()
    found = robot.simulate(state.q, state.dq, 0.5, dt, method=method)
    error = np.abs(robot.subtract(found.q, wanted.q[:: round(dt / 0.005)])).max()
    assert error / 5 < found.error_estimate.max() < 5 * error


@pytest.mark.parametrize("method", FIXED)
def test_the_estimate_falls_at_the_order_of_the_method(pendulum, method):
    order = {"euler": 1, "semi_implicit": 1, "midpoint": 2, "variational6": 6}.get(method, 4)
    steps = (50, 100) if order == 6 else (200, 400)
    coarse, fine = (pendulum.simulate([2.0], None, 2.0, 2.0 / n, method=method).error_estimate[0] for n in steps)
    assert np.log2(coarse / fine) == pytest.approx(order, abs=0.5)


@pytest.mark.parametrize(("method", "dt"), [("midpoint", 0.05), ("variational", 0.1), ("midpoint", 0.02)])
def test_steps_too_long_for_a_controller_are_remarked_though_the_energy_balances(pendulum, method, dt):
    """A stiff PD as a function of the state: the drift is below 0.1 %, the motion wrong by more than 5 %."""

    def pd(t, q, dq):
        return 900.0 * (0.8 - q) - 6.0 * dq

    found = pendulum.simulate([0.0], None, 1.0, dt, method=method, tau=pd)
    assert off(found, truth(found.times, 0.0, pd)) > 0.05
    assert found.relative_drift < 1e-3
    assert said(found, STEPS)
    assert found.error_estimate[0] > 0.05
    fine = pendulum.simulate([0.0], None, 0.5, 2e-3, method=method, tau=pd)
    assert off(fine, truth(fine.times, 0.0, pd)) < 2e-2
    assert not fine.remarks


def dropped(box, method, dt, stiffness=1e5, duration=1.0):
    """From 0.1 m on its middle, without loss; the largest drop of its energy between contacts is zero in truth."""
    q0 = box.coordinates(root_joint=[1, 0, 0, 0, 0, 0, 0.1])
    return box.simulate(q0, None, duration, dt, method=method, contacts=Plane("box", stiffness=stiffness))


@pytest.mark.parametrize(("method", "dt"), [*((m, 0.05) for m in FIXED), ("midpoint", 0.02)])
def test_steps_too_long_for_a_contact_are_remarked_though_the_energy_balances(box, method, dt):
    """The contact lasts some 0.06 s. A step of 50 ms gains or loses energy by what the drift cannot see."""
    found = dropped(box, method, dt)
    assert said(found, STEPS)
    if method in ("midpoint", "variational", "variational6"):
        assert found.relative_drift < 1e-10


@pytest.mark.parametrize("method", ["midpoint", "rk4"])
def test_steps_short_enough_for_a_contact_are_not(box, method):
    found = dropped(box, method, 2e-3, duration=0.35)
    wanted = dropped(box, "dopri5", 2e-3, duration=0.35)
    assert not found.remarks
    error = np.abs(found.q[-1, 6] - wanted.q[-1, 6])
    assert error < 2 * found.error_estimate.max() < 5e-3


@pytest.mark.parametrize("method", ["midpoint", "rk4", "semi_implicit"])
def test_contacts_that_are_over_within_three_steps_are_remarked(box, method):
    """At 1e7 N/m^1.5 the contact lasts 9 ms, less than a step; at 1e5 it lasts 30 steps of 2 ms."""
    words = "a contact was over within three steps"
    assert said(dropped(box, method, 0.01, 1e7, duration=0.4), words)
    assert not said(dropped(box, method, 2e-3, duration=0.3), words)


def test_contacts_with_joint_stops_are_remarked_too():
    """0.12 kg m² against 1e4 N m/rad^1.5: some 20 ms."""
    panda = tw.robots.panda().with_gravity([0, 0, 0])
    alone = panda.lock({n: float(x) for n, x in zip(panda.joint_names[1:], panda.neutral[1:], strict=True)})
    for method in ("midpoint", "rk4"):
        found = alone.simulate([alone.limits.upper[0] - 0.1], [2.0], 0.3, 0.02, method=method, contacts=JointStops(1e4))
        assert said(found, "'a joint touches its stop'")


# ── forces that are over within a step ──

UNSEEN = "changes within steps of"


def pulse(t, q, dq):
    """0.05 N m s, at 0.5 s."""
    return [10.0 if 0.5 <= t < 0.505 else 0.0]


def pushed(t, q, dq):
    return [0.0, *pulse(t, q, dq), 0.0, 0.0, 0.0, 0.0]


@pytest.mark.parametrize("dt", [1e-3, 0.05])
@pytest.mark.parametrize("q0", [0.0, 0.3])
def test_a_pulse_shorter_than_the_steps_of_dopri5_is_not_stepped_over(pendulum, q0, dt):
    """At rest its steps grow to 0.3 s. The truth is that of pieces without jumps."""
    found = pendulum.simulate([q0], None, 1.0, dt, tau=pulse)
    state, start = [np.array([q0]), np.zeros(1)], 0.0
    for end, tau in ((0.5, 0.0), (0.505, 10.0), (1.0, 0.0)):
        piece = pendulum.simulate(*state, end - start, end - start, tau=[tau], rtol=1e-11, atol=1e-12)
        state, start = [piece.q[-1], piece.dq[-1]], end
    assert abs(found.q[-1, 0] - state[0][0]) < 1e-6
    assert not found.remarks


def test_a_push_shorter_than_the_steps_of_dopri5_is_not_stepped_over(pendulum):
    """The same pulse as a moment of the world on the bob."""
    found = pendulum.simulate([0.0], None, 1.0, wrench_on_robot={pendulum.tip: pushed})
    moment = pendulum.wrench_torques([0.0], pushed(0.502, None, None), pendulum.tip)
    wanted = pendulum.simulate([0.0], None, 1.0, tau=lambda t, q, dq: moment if 0.5 <= t < 0.505 else 0 * moment)
    assert np.abs(moment).max() > 1.0
    np.testing.assert_allclose(found.q[-1], wanted.q[-1], atol=1e-6)


@pytest.mark.parametrize("q0", [0.0, 0.03])
@pytest.mark.parametrize("method", FIXED)
def test_a_pulse_shorter_than_fixed_steps_is_remarked_with_its_time(pendulum, method, q0):
    """Two steps out of ten are probed in halves, which the pulse may be between too."""
    found = pendulum.simulate([q0], None, 5.0, 0.05, method=method, tau=lambda t, q, dq: pulse(t - 1.523, q, dq))
    (remark,) = (r for r in found.remarks if UNSEEN in r)
    assert remark.startswith("tau ")
    assert float(remark.split("about t = ")[1].split(" s")[0]) == pytest.approx(2.0255, abs=0.02)
    assert found.relative_error > 0.05


@pytest.mark.parametrize("method", ["midpoint", "rk4"])
def test_a_push_shorter_than_fixed_steps_is_remarked(pendulum, method):
    found = pendulum.simulate([0.0], None, 1.0, 0.05, method=method, wrench_on_robot={pendulum.tip: pushed})
    assert said(found, f"the wrench at {pendulum.tip!r} {UNSEEN}")


@pytest.mark.parametrize("torque", [30.0, 5.0])
def test_the_error_under_dry_friction_after_a_pulse_of_torque_is_estimated_to_its_size(torque):
    """With friction, semi-implicit velocities are those of the state itself, and none of half a step before. A reference of 16
    times finer steps; errors of steps are added up without their signs, here to some ten times what they make."""
    arm = tw.robots.planar_2r()
    law = {"friction": {"coulomb": "2 N m", "viscous": "0.1 N m s/rad"}}
    arm = arm.with_actuators({"actuators": dict.fromkeys(arm.joint_names, law)})
    q0 = np.array([0.3, 0.4])
    held = arm.gravity_forces(q0)

    def pushed_off(t, q, dq):
        return held + (np.array([torque, 0.25 * torque]) if 0.1 <= t < 0.15 else 0.0)

    given = {"method": "semi_implicit", "tau": pushed_off, "friction": True}
    found = arm.simulate(q0, None, 0.5, 2e-3, **given)
    wanted = arm.simulate(q0, None, 0.5, 2e-3 / 16, every=16, **given)
    error = np.abs(found.q - wanted.q).max()
    assert np.ptp(wanted.q) > 1e-4 and error > 1e-9
    assert 0.5 * error < found.error_estimate.max() < 20 * error
    assert found.remarks == ()


@pytest.mark.parametrize(("stiffness", "damping"), [(9.0, 0.2), (9.0, 0.02)])
def test_the_error_under_implicit_damping_is_estimated_to_its_size(pendulum, stiffness, damping):
    """A wheel on a spring, whose damping is taken at the end of a step: velocities are those of half a step before, too. A
    reference of 16 times finer steps."""
    wheel = pendulum.with_gravity([0, 0, 0])
    given = {"method": "semi_implicit", "tau": tw.control.PD(wheel, [0.0], kp=stiffness, kd=damping)}
    found = wheel.simulate([1.0], None, 2.0, 4e-3, **given)
    wanted = wheel.simulate([1.0], None, 2.0, 4e-3 / 16, every=16, **given)
    error = np.abs(found.q - wanted.q).max()
    assert error < found.error_estimate[0] < 8 * error


def _at_rest(t, q, dq):
    return [10.0 if t == 0.5 else 0.0]


def test_a_step_to_rest_is_found_by_the_variational_methods(pendulum):
    """The rate before the step says that it moves, and all forces within it say that it does not."""
    for method in ("midpoint", "variational"):
        found = pendulum.simulate([0.0], None, 1.0, 0.05, method=method, tau=_at_rest)
        assert found.completed
        assert np.abs(found.q).max() < 1e-12


LAWS = {
    "of the state": lambda t, q, dq: [-30.0 * q[0] - 2.0 * dq[0]],
    "of both": lambda t, q, dq: [30.0 * (np.sin(3.0 * t) - q[0]) - 2.0 * dq[0]],
    "of time": lambda t, q, dq: [2.0 * np.sin(20.0 * t)],
}


@pytest.mark.parametrize(
    ("kind", "method"), [(kind, m) for kind in LAWS for m in METHODS if kind == "of both" or m in ("rk4", "dopri5")]
)
def test_smooth_functions_cost_no_step_and_no_remark(pendulum, monkeypatch, method, kind):
    dt = 2e-3 if method in ("euler", "semi_implicit") else 0.02
    found = pendulum.simulate([1.0], None, 1.0, dt, method=method, tau=LAWS[kind])
    assert not said(found, UNSEEN)
    monkeypatch.setattr(
        "twistwrench.simulation.accuracy.missed_impulses.ForceQuadrature.impulses",
        lambda self, t, *_: np.zeros((*np.shape(t), 1)),
    )
    without = pendulum.simulate([1.0], None, 1.0, dt, method=method, tau=LAWS[kind])
    np.testing.assert_array_equal(found.q, without.q)
    np.testing.assert_array_equal(found.error_estimate, without.error_estimate)


def test_a_longest_step_is_for_steps_that_adapt(pendulum):
    found = pendulum.simulate([0.0], None, 1.0, 0.05, tau=pulse, max_step=2e-3)
    assert found.steps >= 500
    with pytest.raises(tw.ValueRangeError, match=r"max_step is 0\.01 s, and steps of method 'rk4' are 0\.05 s each"):
        pendulum.simulate([0.0], None, 1.0, 0.05, method="rk4", max_step=0.01)


# ── no false alarm ──


@pytest.mark.parametrize("method", METHODS)
def test_a_joint_that_friction_holds_is_no_drift(pendulum, method):
    """Next to no kinetic energy, but friction and torque do work: the drift is measured against what moved."""
    drives = {"actuators": {pendulum.joint_names[0]: {"friction": {"coulomb": "0.5 N m"}}}}
    wheel = pendulum.with_gravity([0, 0, 0]).with_actuators(drives)
    found = wheel.simulate([0.0], None, 1.0, 0.01, friction=True, method=method, tau=[0.4])
    assert not said(found, "the energy drift")
    assert not said(found, STEPS)


@pytest.mark.parametrize("method", METHODS)
def test_a_robot_in_balance_is_off_by_nothing(method):
    """Moments of rounding size: no motion, no kinetic energy, and nothing to remark."""
    ur5 = tw.robots.ur5()
    q = np.ones(6)
    found = ur5.simulate(q, None, 0.2, 0.01, method=method, tau=ur5.gravity_forces(q))
    assert not found.remarks
    assert found.relative_error < 1e-3


# ── nothing is changed by it ──


def _logged(calls, remember):
    def law(t, q, dq):
        calls.append(t)
        return [-2.0 * q[0] + (0.01 * len(calls) if remember else 0.0)]

    return law


@pytest.mark.parametrize("method", FIXED)
def test_a_controller_is_asked_once_a_step_and_never_for_the_estimate(pendulum, method):
    """It may keep what it likes: an integral, a filter, a counter."""
    calls = []
    found = pendulum.simulate([1.0], None, 1.0, 0.02, method=method, controller=_logged(calls, remember=True))
    np.testing.assert_allclose(calls, 0.02 * np.arange(50), atol=1e-12)
    np.testing.assert_allclose(found.tau[:50, 0], -2.0 * found.q[:50, 0] + 0.01 * np.arange(1, 51), atol=1e-12)
    assert 0.0 < found.error_estimate[0] < np.inf


@pytest.mark.parametrize("method", ["rk4", "semi_implicit"])
def test_functions_with_a_memory_are_asked_for_the_estimate_after_the_run_only(pendulum, method, monkeypatch):
    """The estimate asks torques at times between, but when all is over: with it and without, the run has the same bits."""
    calls = []
    with_it = pendulum.simulate([1.0], None, 1.0, 0.02, method=method, tau=_logged(calls, remember=True))
    monkeypatch.setattr("twistwrench.simulation.run.Run.judge", lambda self: None)
    fewer = []
    without = pendulum.simulate([1.0], None, 1.0, 0.02, method=method, tau=_logged(fewer, remember=True))
    np.testing.assert_array_equal(with_it.q, without.q)
    assert calls[: len(fewer)] == fewer
    assert len(calls) > len(fewer)
    assert np.isnan(without.error_estimate).all()
    assert with_it.evaluations == without.evaluations


def test_a_function_that_fails_between_the_steps_fails_the_estimate_alone(pendulum):
    """A table of torques by step, asked by Euler's method at the steps only."""
    table = np.zeros((51, 1))

    def law(t, q, dq):
        k = t / 0.02
        if abs(k - round(k)) > 1e-6:
            raise LookupError("no torque between the steps")
        return table[round(k)]

    found = pendulum.simulate([1.0], None, 1.0, 0.02, method="euler", tau=law)
    assert found.completed
    assert np.isnan(found.error_estimate).all()


def test_the_estimate_is_the_same_every_time(box):
    one, other = (dropped(box, "rk4", 0.01) for _ in range(2))
    np.testing.assert_array_equal(one.error_estimate, other.error_estimate)


@pytest.mark.parametrize("n", [1, 2, 20, 31, 400, 5000, 10**6])
def test_few_steps_are_probed_but_never_none(n):
    """All of a short run, the first ones closely, then 2 % and at most 2000; no gap is longer than two blocks."""
    probed = list(sample_steps(n))
    assert probed[0] == 0
    assert probed == sorted(set(probed))
    assert probed[-1] < n
    assert min(n, 30) <= len(probed) <= max(64, n // 50 + 8)
    assert len(probed) <= 2010
    assert max(np.diff([*probed, n])) <= max(2 * n / 25, 2, min(100, n))


def test_an_error_beyond_the_first_step_and_a_failure_leave_what_is_known(pendulum):
    with pytest.raises(tw.SimulationError) as caught:
        pendulum.simulate(
            [1.0], None, 1.0, 0.02, method="rk4", controller=lambda t, q, dq: [np.nan if t > 0.5 else 0.0]
        )
    assert 0.0 < caught.value.result.error_estimate[0] < 1e-3
    with pytest.raises(tw.SimulationError) as caught:
        pendulum.simulate([1.0], None, 1.0, 0.02, method="rk4", controller=lambda t, q, dq: [np.nan])
    assert np.isnan(caught.value.result.error_estimate).all()


@pytest.mark.parametrize("kind", ["csv", "npz"])
def test_files_keep_the_estimate(pendulum, tmp_path, kind):
    found = pendulum.simulate([1.0], None, 0.1, 0.02, method="rk4")
    again = tw.simulation.SimulationResult.load(getattr(found, f"to_{kind}")(tmp_path / "a"))
    np.testing.assert_array_equal(again.error_estimate, found.error_estimate)
    assert again.relative_error == found.relative_error
