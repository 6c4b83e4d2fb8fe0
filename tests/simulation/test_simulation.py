"""Simulated motions against closed forms, SciPy and MuJoCo; and the balance of their energies."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest
from peers import mujoco_model
from quick import mostly_slow
from simulated import dop853

import twistwrench as tw
from twistwrench.simulation import METHODS, Event
from twistwrench.testing import random_robot, random_state


@pytest.fixture(scope="module")
def ur5():
    return tw.robots.ur5()


@pytest.fixture(scope="module")
def pendulum():
    return tw.robots.pendulum()


# ── closed forms ──


@pytest.mark.parametrize(("method", "allowed"), [("dopri5", 1e-9), ("rk4", 1e-10), ("variational", 1e-10)])
def test_a_pendulum_swings_as_jacobis_functions_say(pendulum, method, allowed):
    """sin(q/2) = k sn(√g (t + K), k): Landau and Lifshitz, Mechanics, section 11. Steps of 1 ms are far below the period."""
    from scipy.special import ellipj, ellipk

    k, omega = np.sin(1.0), np.sqrt(9.81)
    found = pendulum.simulate([2.0], [0.0], 3.0, method=method, rtol=1e-11, every=10)
    sn, _, _, _ = ellipj(omega * found.times + ellipk(k**2), k**2)
    np.testing.assert_allclose(found.q[:, 0], 2 * np.arcsin(k * sn), atol=allowed)
    assert found.completed
    assert found.relative_drift < allowed


def test_a_thrown_box_falls_on_a_parabola_and_keeps_its_angular_momentum():
    box = tw.robots.floating_box()
    found = box.simulate(None, [0.4, 3.0, 0.2, 1.0, 0.5, 2.0], 1.0, 0.01, rtol=1e-11)
    t, place = found.times, found.q[:, 4:]
    np.testing.assert_allclose(place, np.outer(t, [1.0, 0.5, 2.0]) - np.outer(t**2, [0, 0, 4.905]), atol=1e-10)
    np.testing.assert_allclose(np.linalg.norm(found.q[:, :4], axis=1), 1.0, atol=1e-15)
    about_com = box.momentum(found.q, found.dq, frame="com")[:, :3]
    np.testing.assert_allclose(about_com, np.tile(about_com[0], (len(t), 1)), atol=1e-10)


def test_viscous_friction_stops_a_wheel_exponentially():
    """ω = ω0 exp(-b t / I): the pendulum without gravity, I = 1 kg m²."""
    drives = {"actuators": {"joint1": {"friction": {"viscous": "0.7 N m s/rad"}}}}
    wheel = tw.robots.pendulum().with_gravity([0, 0, 0]).with_actuators(_for(drives, "pendulum"))
    found = wheel.simulate([0.0], [2.0], 2.0, 0.01, friction=True, rtol=1e-11)
    np.testing.assert_allclose(found.dq[:, 0], 2.0 * np.exp(-0.7 * found.times), atol=1e-9)
    np.testing.assert_allclose(found.work["friction"], found.kinetic_energy - 2.0, atol=1e-9)
    assert wheel.simulate([0.0], [2.0], 1.0, 0.1).dq[-1, 0] == pytest.approx(2.0, abs=1e-12)


def _for(drives, robot):
    """The same actuators on the first joint of a bundled robot, whatever it is called."""
    (entry,) = drives["actuators"].values()
    return {"actuators": {getattr(tw.robots, robot)().joint_names[0]: entry}}


def rough_ur5():
    """Dry friction at every joint, the light wrists included."""
    ur5 = tw.robots.ur5()
    return ur5.with_actuators({"actuators": {j: {"friction": {"coulomb": "5 N m"}} for j in ur5.joint_names}})


def test_dry_friction_that_makes_steps_endless_is_an_error_that_names_the_method_for_it():
    robot = rough_ur5()
    with pytest.raises(tw.SimulationError, match=r"Dry friction of joint.*method=\'semi_implicit\'") as caught:
        robot.simulate(duration=1.0, friction=True)
    assert caught.value.result.times[-1] > 0 and not caught.value.result.completed
    assert robot.simulate(duration=0.1, friction=True, method="semi_implicit").completed


def test_damping_too_steep_for_adaptive_steps_is_an_error_too():
    arm = tw.robots.planar_2r()
    with pytest.raises(tw.SimulationError, match="the equations are stiff"):
        arm.simulate([0.3, 0.2], [0, 0], 1.0, tau=lambda t, q, dq: -1e7 * dq)


def test_a_run_that_ends_soon_is_not_called_endless():
    """Stiff it is too, but all of it takes some ten thousand steps."""
    arm = tw.robots.planar_2r()
    assert arm.simulate([0.3, 0.2], [0, 0], 2.0, 0.1, tau=lambda t, q, dq: -1e3 * dq).completed


@pytest.mark.parametrize("method", ["dopri5", "rk4", "semi_implicit", "variational"])
def test_dry_friction_stops_a_wheel_when_it_should_and_holds_it(method):
    """From 2 rad/s by 0.5 N m at 1 kg m²: 4 s. Then a torque below friction moves it at most at the creep it is said to have,
    and not at all in semi-implicit steps."""
    drives = _for({"actuators": {"": {"friction": {"coulomb": "0.5 N m"}}}}, "pendulum")
    wheel = tw.robots.pendulum().with_gravity([0, 0, 0]).with_actuators(drives)
    found = wheel.simulate([0.0], [2.0], 5.0, 0.01, friction=True, method=method)
    moving = found.times < 3.9
    np.testing.assert_allclose(found.dq[moving, 0], 2.0 - 0.5 * found.times[moving], atol=1e-6)
    assert np.abs(found.dq[found.times > 4.1]).max() < 1e-4
    assert any("creep" in remark for remark in found.remarks) == (method != "semi_implicit")
    held = wheel.simulate([0.0], [0.0], 1.0, 0.01, friction=True, method=method, tau=[0.4])
    if method == "semi_implicit":
        assert not held.dq.any() and not held.remarks
        return
    creep = 1e-3 if method == "dopri5" else 0.01 * 0.5
    assert held.dq[-1, 0] == pytest.approx(creep * np.arctanh(0.8), rel=1e-2)


def test_all_dry_friction_is_eased_alike_also_the_part_of_the_load():
    """1 kg m²: of τ, x passes on, with x + 0.2 u + s (0.5 + 0.3 exp(-(u/v)²) + 0.3 |x|) = τ at u > 0, where s = tanh(u / creep).

    So an acceleration changes by little where a slow motion turns back, as the fraction s is small on either side.
    """
    law = {
        "viscous": "0.2 N m s/rad",
        "coulomb": "0.5 N m",
        "static": "0.8 N m",
        "stribeck": "0.1 rad/s",
        "load": "0.3",
    }
    wheel = tw.robots.pendulum().with_gravity([0, 0, 0])
    wheel = wheel.with_actuators({"actuators": {"hinge": {"friction": law}}})
    dt, creep = 1e-3, 0.05

    def acceleration(u, tau):
        return (
            wheel.simulate([0.0], [u], dt, dt, tau=tau, friction=True, creep=creep, method="euler").dq[-1, 0] - u
        ) / dt

    for u in (1e-6, 0.05, 1.0):
        share = np.tanh(u / creep)
        against = 0.2 * u + share * (0.5 + 0.3 * np.exp(-((u / 0.1) ** 2)))
        forward, backward = (2.0 - against) / (1.0 + 0.3 * share), (-2.0 - against) / (1.0 - 0.3 * share)
        for sign in (1.0, -1.0):
            for tau, wanted in ((2.0, forward), (-2.0, backward)):
                given = [sign * tau]
                for torque in (given, lambda _t, _q, _dq, given=given: given):
                    assert acceleration(sign * u, torque) == pytest.approx(sign * wanted, rel=1e-9), (u, sign, tau)
    assert acceleration(1e-6, [2.0]) == pytest.approx(acceleration(-1e-6, [2.0]), rel=1e-4)


def test_a_constant_wrench_accelerates_and_its_sign_is_on_the_robot():
    """6 kg, 3 N along x of the body, which does not turn: x = t²/4; and all of its work is kinetic energy."""
    box = tw.robots.floating_box().with_gravity([0, 0, 0])
    found = box.simulate(None, None, 2.0, 0.1, wrench_on_robot={"box": [0, 0, 0, 3.0, 0, 0]})
    np.testing.assert_allclose(found.q[:, 4], 0.25 * found.times**2, atol=1e-9)
    np.testing.assert_allclose(found.work["wrenches"], 3.0 * found.q[:, 4], atol=1e-9)


def test_constant_wrenches_on_several_frames_each_push_there():
    arm, pushes = tw.robots.planar_2r(), {"link1": [0.1, 0.2, -0.3, 1, 2, -3], "link2": [0.3, -2, 0.1, 4, 0, 5]}
    found = arm.simulate([0.3, -0.8], [0.5, 0.2], 0.01, 1e-3, wrench_on_robot=pushes)
    wanted = arm.forward_dynamics(found.q, found.dq, np.zeros(2), wrench_on_robot=pushes)
    np.testing.assert_allclose(found.ddq, wanted, rtol=1e-9)


@pytest.mark.parametrize("torque", [3.0, -3.0])
@pytest.mark.parametrize("speed", [2.0, -2.0])
def test_friction_that_grows_with_the_load_opposes_the_motion_whichever_way_it_goes(torque, speed):
    """Driven or braked, forward or backward, a wheel of 1 kg m² loses a tenth of what its shaft carries, against its motion."""
    drives = _for({"actuators": {"": {"friction": {"load": "0.1"}}}}, "pendulum")
    wheel = tw.robots.pendulum().with_gravity([0, 0, 0]).with_actuators(drives)
    found = wheel.simulate([0.0], [speed], 0.3, 0.01, tau=[torque], friction=True)
    carried = torque / (1 + 0.1 * np.sign(speed * torque))
    np.testing.assert_allclose(found.dq[:, 0], speed + carried * found.times, rtol=1e-6)
    assert (np.diff(found.work["friction"]) < 0).all()


def test_a_wrench_may_be_a_function_of_time_and_state():
    """A spring to the origin and a push that swings: x'' = -ω² x + a cos(νt) has a closed form."""
    box = tw.robots.floating_box().with_gravity([0, 0, 0])
    k, m, nu = 24.0, 6.0, 3.0
    omega = np.sqrt(k / m)

    def push(t, q, dq):
        return [0, 0, 0, m * np.cos(nu * t) - k * q[4], 0, 0]

    found = box.simulate(None, None, 2.0, 0.05, wrench_on_robot={"box": push}, rtol=1e-10)
    t = found.times
    np.testing.assert_allclose(found.q[:, 4], (np.cos(nu * t) - np.cos(omega * t)) / (omega**2 - nu**2), atol=1e-8)
    assert found.relative_drift < 1e-8


@pytest.mark.parametrize("method", ["dopri5", "rk4", "variational"])
def test_a_controller_is_sampled_and_its_torque_held(method):
    """A double integrator under a sampled law: x+ = x + h v + ½ h² u, v+ = v + h u, exactly."""
    wheel = tw.robots.pendulum().with_gravity([0, 0, 0])
    times = []

    def law(t, q, dq):
        times.append(t)
        return -4.0 * q - 1.5 * dq

    found = wheel.simulate([1.0], [0.0], 1.0, 0.05, controller=law, method=method)
    x, v, wanted = 1.0, 0.0, []
    for _ in range(20):
        u = -4.0 * x - 1.5 * v
        wanted.append((x, v, u))
        x, v = x + 0.05 * v + 0.00125 * u, v + 0.05 * u
    np.testing.assert_allclose(np.c_[found.q, found.dq, found.tau][:20], wanted, atol=1e-12)
    np.testing.assert_allclose(times, 0.05 * np.arange(20), atol=1e-12)
    assert found.q[-1, 0] == pytest.approx(x, abs=1e-12)


def test_torques_as_a_function_of_time_are_continuous_and_add_to_a_controllers():
    """x'' = sin t + 1 from rest: x = t - sin t + t²/2."""
    wheel = tw.robots.pendulum().with_gravity([0, 0, 0])
    found = wheel.simulate(
        None, None, 2.0, 0.1, tau=lambda t, q, dq: [np.sin(t)], controller=lambda t, q, dq: [1.0], rtol=1e-10
    )
    t = found.times
    np.testing.assert_allclose(found.q[:, 0], t - np.sin(t) + t**2 / 2, atol=1e-9)
    np.testing.assert_allclose(found.tau[:, 0], np.sin(t) + 1, atol=1e-12)


# ── energy ──


@pytest.mark.parametrize("method", ["variational", "rk4", "dopri5"])
def test_the_ur5_falls_for_three_seconds_and_keeps_its_energy(ur5, method):
    """The book's exercise, from the stretched arm at rest, in steps of 1.5 ms (dopri5: at a tolerance of 1e-10)."""
    found = ur5.simulate(None, None, 3.0, 1.5e-3, method=method, rtol=1e-10)
    assert found.kinetic_energy.max() > 30.0
    assert found.relative_drift < 1e-7
    again = ur5.kinetic_energy(found.q, found.dq) + ur5.potential_energy(found.q)
    np.testing.assert_array_equal(found.energy, again)


@pytest.mark.slow
def test_the_ur5_falls_for_five_seconds_at_a_kilohertz(ur5):
    """Steps of the sixth order lose nothing but rounding; what those of the fourth lose falls with the fourth power of the step."""
    assert ur5.simulate(None, None, 5.0, 1e-3, method="variational6").relative_drift < 1e-9
    coarse, fine = (ur5.simulate(None, None, 5.0, dt, method="variational").relative_drift for dt in (1e-3, 0.5e-3))
    assert fine < 1e-9
    assert 12 < coarse / fine < 20


def test_the_energy_of_variational_steps_has_no_trend():
    """A double pendulum for 40 s in steps of 20 ms: what RK4 loses grows with time, what a symplectic map is off does not."""
    robot = tw.robots.planar_2r()
    halves = {}
    for method in ("variational", "rk4"):
        found = robot.simulate([-0.8, 0.5], [0.0, 0.0], 40.0, 0.02, method=method)  # regular, not chaotic
        size = np.abs(found.drift)
        halves[method] = size[:1001].max(), size[1001:].max(), abs(np.polyfit(found.times, found.drift, 1)[0]) * 40.0
    first, second, trend = halves["variational"]
    assert second < 1.1 * first
    assert trend < 0.02 * first
    first, second, trend = halves["rk4"]
    assert second > 1.8 * first
    assert trend > 0.5 * second


@functools.cache
def sliding_and_turning():
    return random_robot(7, joints=4, kinds=("revolute", "prismatic"))


@pytest.mark.parametrize("method", METHODS)
def test_work_and_energy_balance_with_everything_acting(method):
    """Torques, friction and a wrench at once. The drift falls at the order of the method, two or more digits a tenth of dt."""
    robot = sliding_and_turning()
    frame = robot.frame_names[-1]
    acting = {
        "tau": lambda t, q, dq: np.cos(3 * t) - 0.1 * dq,
        "wrench_on_robot": {frame: [0.1, 0.2, -0.1, 1.0, -2.0, 0.5]},
        "friction": True,
    }
    if method != "semi_implicit":  # which eases nothing
        acting["creep"] = 0.5  # wide, so that the order shows
    state = random_state(robot, 7)
    coarse, fine = (
        robot.simulate(state.q, state.dq, 0.4, dt, method=method, rtol=1e-10, **acting) for dt in (0.01, 0.0025)
    )
    assert min(np.abs(fine.work[w]).max() for w in ("torques", "friction", "wrenches")) > 1e-2
    order = {"euler": 1, "semi_implicit": 1, "midpoint": 2}.get(method, 4)
    assert fine.relative_drift < 1e-9 or np.log2(coarse.relative_drift / fine.relative_drift) > 2 * order - 1


def test_springs_are_in_the_energy():
    """An elastic gear: motor and link swing against each other, and what the spring stores counts."""
    entry = {"ratio": 50, "stiffness": "300 N m/rad", "rotor": {"inertia": "1e-4 kg m^2", "extra": True}}
    robot = tw.robots.pendulum()
    robot = robot.with_actuators({"actuators": {robot.joint_names[0]: entry}})
    found = robot.simulate([0.5, 0.0], None, 1.0, 1e-3, method="variational")
    assert robot.nv == 2
    assert np.ptp(found.q[:, 0] - found.q[:, 1]) > 0.1
    assert found.relative_drift < 1e-7


# ── other libraries ──


@pytest.mark.slow
@pytest.mark.parametrize("seed", [3, 6])
def test_scipys_dop853_agrees(seed):
    """At every state of the record, between the steps too, to 1e-9."""
    robot = random_robot(seed, joints=5, floating_base=True, kinds=("revolute", "prismatic", "planar", "helical"))
    state = random_state(robot, seed)
    found = robot.simulate(state.q, state.dq, 1.0, 0.01, rtol=1e-12, atol=1e-12)
    q, dq = np.split(dop853(robot, state.q, state.dq, 1.0, found.times), [robot.nq], axis=1)
    assert found.steps != len(found) - 1
    assert np.abs(robot.subtract(found.q, q)).max() < 1e-9
    assert np.abs(found.dq - dq).max() < 1e-9 * max(1.0, np.abs(dq).max())


@pytest.fixture(scope="module")
def fall(ur5):
    """States of the UR5 that falls from the stretched pose, at each tenth of a second, by SciPy."""
    return dop853(ur5, np.zeros(6), np.zeros(6), 1.0, np.linspace(0.0, 1.0, 11))


@pytest.mark.parametrize("method", ["dopri5", "rk4", "variational"])
def test_scipys_dop853_agrees_on_the_ur5(ur5, fall, method):
    found = ur5.simulate(None, None, 1.0, 4e-4, method=method, rtol=1e-12, atol=1e-12, every=250)
    np.testing.assert_allclose(found.times, np.linspace(0.0, 1.0, 11), rtol=0.0, atol=1e-14)
    assert np.abs(found.q - fall[:, :6]).max() < 1e-9


@pytest.mark.parametrize("name", mostly_slow(["ur5", "panda", "quadruped", "planar_3r", "floating_box"], 2))
def test_mujoco_agrees(name):
    """A second of falling, from where gravity moves all: MuJoCo's RK4 in steps of 0.1 ms, 1e-6 rad or m.

    Without its contacts, limits and losses. Its inertias are those of the file to 1e-9 (see test_mujoco.py).
    """
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed", exc_type=ImportError)
    from twistwrench.robot.convert import from_mujoco, to_mujoco

    robot = tw.load(tw.robots.path_of(name), floating_base=name in ("floating_box", "quadruped"))
    model = mujoco_model(robot)
    model.opt.timestep, model.opt.integrator = 1e-4, int(mujoco.mjtIntegrator.mjINT_RK4)
    data = mujoco.MjData(model)
    q0 = robot.random_configuration(1)
    dq0 = 0.3 * np.random.default_rng(2).standard_normal(robot.nv)
    data.qpos[:], data.qvel[:] = to_mujoco(robot, model, q0, dq0)
    mujoco.mj_step(model, data, 10_000)
    found = robot.simulate(q0, dq0, 1.0, 0.1, rtol=1e-11, atol=1e-11)
    q, dq = from_mujoco(robot, model, data.qpos, data.qvel)
    assert np.abs(robot.subtract(found.q[-1], q)).max() < 1e-6
    assert np.abs(found.dq[-1] - dq).max() < 1e-5
    assert np.abs(robot.subtract(q, q0)).max() > 0.1


# ── events ──


@pytest.mark.parametrize("method", ["dopri5", "rk4", "variational", "semi_implicit"])
def test_events_are_found_where_they_happen(pendulum, method):
    """A pendulum passes its lowest point after a quarter of K(k) 4/√g; each method finds it as well as it knows the motion."""
    from scipy.special import ellipk

    quarter = ellipk(np.sin(1.0) ** 2) / np.sqrt(9.81)
    events = [Event(lambda t, q, dq: q[0], "down there"), Event(lambda t, q, dq: q[0], "rising", direction="up")]
    found = pendulum.simulate([2.0], [0.0], 4.0, 1e-3, method=method, events=events, rtol=1e-11)
    times = [e.time for e in found.events if e.name == "down there"]
    allowed = 2e-2 if method == "semi_implicit" else 1e-9
    np.testing.assert_allclose(times, quarter * np.arange(1, 2 * len(times), 2), atol=allowed)
    assert [e.time for e in found.events if e.name == "rising"] == times[1::2]
    assert all(abs(e.q[0]) < 1e-12 for e in found.events)
    assert len(times) == 3


@pytest.mark.parametrize("method", ["dopri5", "rk4"])
def test_a_terminal_event_ends_it_there(pendulum, method):
    event = Event(lambda t, q, dq: q[0] - 1.0, "halfway", terminal=True)
    found = pendulum.simulate([2.0], [0.0], 4.0, 0.01, method=method, events=event)
    assert not found.completed
    assert found.stopped.startswith("halfway at")
    assert found.q[-1, 0] == pytest.approx(1.0, abs=1e-12)
    assert found.times[-1] == found.events[-1].time
    assert (np.diff(found.times) > 0).all()
    np.testing.assert_allclose(found.times[:-1], 0.01 * np.arange(len(found) - 1), atol=1e-12)


def test_an_event_that_passes_zero_and_comes_back_within_a_step_is_remarked(pendulum):
    """A parabola with zeros at 0.54 s and 0.56 s is positive at 0.5 s and 0.6 s, and steeper at both than a line between."""
    dip = tw.simulation.Event(lambda t, q, dq: (t - 0.55) ** 2 - 1e-4, "dip")
    found = pendulum.simulate([1.0], None, 1.0, 0.1, method="rk4", events=dip)
    assert found.events == ()
    assert any("event 'dip' may pass zero more often than was seen" in remark for remark in found.remarks)


@pytest.mark.parametrize("method", ["rk4", "dopri5"])
def test_a_function_of_time_adds_to_a_controller_in_the_motion_and_in_what_is_kept_of_it(pendulum, method):
    """2 + sin t on 1 kg m²."""
    wheel = pendulum.with_gravity([0, 0, 0])
    acting = {"controller": lambda t, q, dq: [2.0], "tau": lambda t, q, dq: [np.sin(t)]}
    found = wheel.simulate([0.0], [0.0], 1.0, 0.01, method=method, **acting)
    np.testing.assert_allclose(found.dq[:, 0], 2.0 * found.times + 1.0 - np.cos(found.times), atol=1e-6)
    np.testing.assert_allclose(found.tau[:, 0], 2.0 + np.sin(found.times), atol=1e-12)
    np.testing.assert_allclose(found.ddq, found.tau, atol=1e-12)


def test_an_event_of_time_alone_is_found_to_rounding(pendulum):
    found = pendulum.simulate([2.0], [0.0], 1.0, 0.1, events=lambda t, q, dq: t - np.pi / 10, method="rk4")
    assert found.events[0].time == pytest.approx(np.pi / 10, abs=1e-15)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_event_exactly_at_the_end_of_a_step_is_one_event(sign):
    """Eighths of a second are numbers that floats hold: the function is zero there, and not beyond it."""
    event = Event(lambda t, q, dq: sign * (t - 0.5), "half", direction="up" if sign > 0 else "down")
    found = tw.robots.pendulum().simulate([0.3], [0.0], 1.0, 0.125, method="rk4", events=event)
    assert [(e.name, e.time) for e in found.events] == [("half", 0.5)]


@pytest.mark.parametrize("last", [1, 2])
def test_events_of_one_step_happen_one_after_the_other(last):
    """Whatever their order in the list; the first terminal one ends it, and what would have been later does not happen."""
    times = [0.3, 0.1, 0.2]
    events = [Event(lambda t, q, dq, at=at: t - at, f"{at}", terminal=k == last) for k, at in enumerate(times)]
    found = tw.robots.pendulum().simulate([0.3], [0.0], 1.0, 0.5, method="rk4", events=events)
    assert [e.name for e in found.events] == (["0.1"] if last == 1 else ["0.1", "0.2"])
    assert found.times[-1] == pytest.approx(times[last], abs=1e-15)


@pytest.mark.parametrize("acting", [{}, {"tau": lambda t, q, dq: 0.0 * dq}], ids=["compiled", "function"])
def test_quaternions_of_every_state_have_unit_length(acting):
    """Those between two steps of the adaptive method too, which come from a polynomial."""
    box = tw.robots.floating_box(floating_base=True)
    q = box.simulate(box.neutral, [1.0, 7.0, 2.0, 0.1, 0.2, 0.3], 1.0, 1e-2, rtol=1e-4, **acting).q
    np.testing.assert_allclose(np.linalg.norm(q[:, :4], axis=1), 1.0, rtol=0, atol=1e-15)


def test_a_joint_limit_ends_it_with_its_name():
    panda = tw.robots.panda()
    q0 = panda.random_configuration(1)
    found = panda.simulate(q0, None, 5.0, 0.01, limits="stop")
    assert not found.completed
    assert "limit" in found.stopped
    name = found.stopped.split("'")[1]
    k = panda.joint_names.index(name)
    gap = min(abs(found.q[-1, k] - x[k]) for x in (panda.limits.lower, panda.limits.upper))
    assert gap < 1e-12


# ── the record ──


@pytest.mark.parametrize("method", METHODS)
def test_accelerations_and_torques_are_those_of_the_states(method):
    robot = tw.robots.planar_3r()
    found = robot.simulate([1, 0, 0], [0, 1, 0], 0.2, 0.01, method=method, tau=[3.0, 2.0, 1.0], every=3)
    np.testing.assert_allclose(robot.inverse_dynamics(found.q, found.dq, found.ddq), found.tau, atol=1e-10)
    np.testing.assert_array_equal(found.tau[0], [3.0, 2.0, 1.0])
    np.testing.assert_allclose(found.times, [*(0.03 * np.arange(7)), 0.2], atol=1e-12)
    np.testing.assert_array_equal(found.momentum, robot.momentum(found.q, found.dq))


def test_a_step_that_does_not_fill_the_duration_is_shortened_and_said(pendulum):
    found = pendulum.simulate([1.0], None, 1.0, 0.3, method="rk4")
    np.testing.assert_allclose(found.times, [0, 0.25, 0.5, 0.75, 1.0])
    assert "0.25 s apart, not 0.3 s" in found.remarks[0]


def test_a_step_that_fills_the_duration_but_for_rounding_is_kept(pendulum):
    """0.07 / 0.01 is above 7 in floating-point numbers."""
    found = pendulum.simulate([1.0], None, 0.07, 0.01, method="rk4")
    assert (found.steps, found.dt, found.remarks) == (7, pytest.approx(0.01, rel=1e-15), ())


def test_the_same_call_gives_the_same_bits(ur5):
    one, other = (ur5.simulate(np.ones(6), None, 0.2, 0.01) for _ in range(2))
    np.testing.assert_array_equal(one.q, other.q)


def test_energy_that_is_lost_is_drift_as_much_as_energy_that_is_gained():
    swing = tw.robots.pendulum().simulate([1.0], [0.0], duration=0.5)
    ramp = np.linspace(0.0, 0.5, len(swing))
    for sign in (1, -1):
        found = replace(swing, kinetic_energy=swing.kinetic_energy + sign * ramp)
        moved = max(found.kinetic_energy.max(), np.ptp(found.potential_energy))
        assert found.relative_drift == pytest.approx(0.5 / moved, rel=1e-3)
