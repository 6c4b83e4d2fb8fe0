"""Runs in which functions in Python give torques or look at steps, against the same run stepped by Python.

A plane far below asks for those.
"""

import numpy as np
import pytest
from small_trees import tree
from test_compiled_steps import compare

import twistwrench as tw
from twistwrench.simulation import Event, Plane
from twistwrench.testing import random_state

METHODS = ["euler", "semi_implicit", "rk4"]


def far(robot):
    return Plane(robot.frame_names[-1], height=-1e6)


def both(robot, *given, **options):
    one = robot.simulate(*given, **options)
    return one, robot.simulate(*given, **options, contacts=far(robot))


def spring(robot, q_rest, gain=20.0):
    def torques(t, q, dq):
        return gain * robot.subtract(q_rest, q) - 2.0 * dq + np.sin(3.0 * t)

    return torques


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", ["controller", "tau"])
def test_a_constant_from_a_function_is_that_constant_to_the_last_bit(name, method):
    robot, constant = tw.robots.panda(), np.linspace(0.5, -0.5, tw.robots.panda().nv)
    given = (np.full(robot.nq, 0.2), None, 0.3, 1e-3)
    told = robot.simulate(*given, method=method, tau=constant)
    asked = robot.simulate(*given, method=method, **{name: lambda t, q, dq: constant})
    for array in ("times", "q", "dq", "ddq", "tau"):
        np.testing.assert_array_equal(getattr(asked, array), getattr(told, array), err_msg=array)
    for name, work in told.work.items():
        np.testing.assert_array_equal(asked.work[name], work)
    assert asked.evaluations == told.evaluations and asked.stopped == told.stopped
    np.testing.assert_allclose(asked.error_estimate, told.error_estimate, rtol=1e-9)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("names", "every"), [(("controller",), 1), (("tau",), 7), (("controller", "tau"), 1), (("controller", "tau"), 7)]
)
def test_the_arm_with_functions_of_its_state(names, every, method):
    robot = tw.robots.planar_2r()
    options = {name: spring(robot, [0.5, -0.3], gain) for name, gain in zip(names, (20.0, 5.0), strict=False)}
    compare(*both(robot, [1.0, 0.2], [0.0, 1.0], 0.2, 1e-3, method=method, every=every, **options))


@pytest.mark.parametrize(
    ("name", "method"),
    [
        pytest.param(name, method, marks=() if (i, k) in ((0, 1), (3, 0)) else pytest.mark.slow)
        for i, name in enumerate(["floating base", "planar", "mimic", "driven"])
        for k, method in enumerate(METHODS[1:])
    ],
)
def test_trees_of_all_joints_with_friction_and_wrenches_that_are_functions(name, method):
    robot = tree(name)
    q0, dq0, _ = random_state(robot, np.random.default_rng(3), ())
    pushes = {
        robot.frame_names[1]: lambda t, q, dq: np.linspace(-0.5, 1.0, 6) * np.cos(5 * t),
        robot.frame_names[-1]: np.linspace(0.1, -0.2, 6),
    }
    options = {"wrench_on_robot": pushes, "friction": True, "tau": np.linspace(0.2, -0.2, robot.nv)}
    steered = {"controller": lambda t, q, dq: -0.1 * dq, **options}
    for some in (options, steered):
        one, other = both(robot, q0, 0.2 * dq0, 0.1, 1e-3, method=method, **some)
        compare(one, other)
        assert one.work["wrenches"][-1] != 0.0


def test_dry_friction_that_stops_joints_under_a_controller():
    drives = {"actuators": {"joint1": {"friction": {"coulomb": "2 N m", "viscous": "0.1 N m s/rad"}}}}
    robot = tw.robots.planar_2r().with_actuators(drives)
    options = {"method": "semi_implicit", "friction": True, "controller": lambda t, q, dq: [0.1, 0.5 * np.sin(20 * t)]}
    compare(*both(robot, [0.3, 0.2], [0.5, -3.0], 0.5, 1e-3, **options), 1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_a_function_is_asked_at_the_same_states_and_owns_what_it_is_given(method):
    """One that changes what it is given, and keeps it, changes nothing in the run."""
    robot, seen = tw.robots.planar_2r(), []
    swing = spring(robot, [0.5, -0.3])

    def greedy(t, q, dq):
        tau = swing(t, q, dq)
        seen.append((t, q, dq, q.copy(), dq.copy()))
        return tau

    def spoiling(t, q, dq):
        tau = swing(t, q, dq)
        q[:], dq[:] = np.nan, np.nan
        return tau

    kept, spoiled = (
        robot.simulate([1.0, 0.2], None, 0.3, 1e-3, method=method, controller=f) for f in (greedy, spoiling)
    )
    assert [t for t, *_ in seen] == [k * (0.3 / 300) for k in range(300)]
    for k, (_, q, dq, q_then, dq_then) in enumerate(seen):
        np.testing.assert_array_equal(q, kept.q[k])
        np.testing.assert_array_equal(dq, kept.dq[k])
        assert (q == q_then).all() and (dq == dq_then).all() and q.flags.writeable
    np.testing.assert_array_equal(spoiled.q, kept.q)


def test_a_torque_that_the_function_changes_later_stays_what_it_was():
    robot, mine = tw.robots.planar_2r(), np.zeros(2)

    def rising(t, q, dq):
        mine[:] = t
        return mine

    result = robot.simulate([1.0, 0.2], None, 0.2, 1e-3, method="rk4", controller=rising)
    np.testing.assert_array_equal(result.tau[:-1, 0], result.times[:-1])


@pytest.mark.parametrize("given", [[1, 2], (0.5, 0.25), np.array([1, 2]), np.float32([0.5, 0.25]), np.ones(4)[::2]])
@pytest.mark.parametrize("name", ["controller", "tau"])
def test_torques_of_other_types_are_the_same_numbers(name, given):
    robot = tw.robots.planar_2r()
    one, other = (
        robot.simulate([1.0, 0.2], None, 0.1, 1e-3, method="rk4", **{name: lambda t, q, dq, x=x: x})
        for x in (given, np.array(given, float))
    )
    np.testing.assert_array_equal(one.q, other.q)


BAD = {
    "shape": (lambda n: np.zeros(n + 1), "gave an array of shape"),
    "nan": (lambda n: np.r_[np.zeros(n - 1), np.nan], "not finite at place"),
    "inf": (lambda n: np.r_[np.inf, np.zeros(n - 1)], "not finite at place 0"),
    "text": (lambda n: ["a"] * n, "expected real numbers"),
    "complex": (lambda n: np.zeros(n, complex), "expected real numbers"),
    "none": (lambda n: None, "expected real numbers"),
    "raises": (lambda n: 1 / 0, "with ZeroDivisionError"),
}


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize(
    ("name", "method"), [("controller", "semi_implicit"), ("tau", "rk4"), ("wrench_on_robot", "semi_implicit")]
)
def test_what_a_function_gives_wrong_is_said_and_what_was_computed_is_kept(name, bad, method):
    robot, (wrong, said) = tw.robots.planar_2r(), BAD[bad]
    n = 6 if name == "wrench_on_robot" else 2

    def function(t, q, dq):
        return wrong(n) if t > 0.0395 else np.zeros(n)

    given = {name: {"tip": function} if n == 6 else function}
    found = []
    for contacts in ((), far(robot)):
        with pytest.raises(tw.SimulationError, match=rf"at t = 0.04 s.*{said}|{said}.* at t = 0.04 s") as caught:
            robot.simulate([1.0, 0.2], None, 0.1, 1e-3, method=method, contacts=contacts, **given)
        found.append((str(caught.value), caught.value.result))
    (one, mine), (other, theirs) = found
    assert one == other and not mine.completed
    assert len(mine) == len(theirs) and mine.times[-1] == theirs.times[-1] >= 0.039
    np.testing.assert_allclose(mine.q, theirs.q, rtol=1e-12)


def test_a_controller_that_drives_it_wild_is_said_as_ever():
    robot, said = tw.robots.planar_2r(), []
    for contacts in ((), far(robot)):
        with pytest.raises(tw.SimulationError, match="is unstable") as caught:
            robot.simulate(
                [1, 1], None, 1.0, 1e-3, method="rk4", controller=lambda t, q, dq: 1e3 * dq + 1.0, contacts=contacts
            )
        said.append((str(caught.value).split(" moves at")[0], caught.value.result))
    (one, mine), (other, theirs) = said
    assert one == other and len(mine) == len(theirs) and mine.times[-1] == theirs.times[-1] > 0.0


@pytest.mark.parametrize("method", METHODS)
def test_an_event_stops_a_steered_run_where_it_happens(method):
    robot, asked = tw.robots.planar_2r(), []

    def steer(t, q, dq):
        asked.append(t)
        return np.array([1.0, 0.2 * np.sin(t)])

    passed = Event(lambda t, q, dq: q[0] - 1.05, "passed", terminal=True)
    seen = Event(lambda t, q, dq: q[0] - 1.02, "seen")
    for every in (1, 7):
        options = {"method": method, "controller": steer, "events": [passed, seen], "every": every}
        asked.clear()
        one = robot.simulate([1.0, 0.2], [1.0, 0.0], 1.0, 1e-3, **options)
        assert asked[-1] <= one.times[-1] < asked[-1] + 1e-3
        other = robot.simulate([1.0, 0.2], [1.0, 0.0], 1.0, 1e-3, **options, contacts=far(robot))
        assert [e.name for e in one.events] == ["seen", "passed"] and not one.completed
        np.testing.assert_allclose([e.time for e in one.events], [e.time for e in other.events], rtol=1e-12)
        np.testing.assert_allclose(one.q, other.q, rtol=0.0, atol=1e-12)
        assert one.steps == other.steps and one.stopped == other.stopped and len(one) == len(other)


def test_an_interrupt_in_a_controller_keeps_what_was_computed():
    def stop(t, q, dq):
        if t > 0.5:
            raise KeyboardInterrupt
        return np.zeros(2)

    with pytest.raises(KeyboardInterrupt) as caught:
        tw.robots.planar_2r().simulate([1, 1], None, 1.0, 1e-3, method="rk4", controller=stop)
    assert 0.5 <= caught.value.result.times[-1] < 0.502


def test_progress_is_told_at_every_step_of_a_steered_run():
    told = []
    tw.robots.planar_2r().simulate(
        [1, 1], None, 0.2, 1e-3, method="euler", controller=lambda t, q, dq: np.zeros(2), progress=told.append
    )
    assert told == sorted(told) and len(told) == 200 and told[-1] == 1.0


@pytest.mark.parametrize(("steered", "every"), [(False, 7), (True, 1)])
@pytest.mark.parametrize("method", METHODS)
def test_a_limit_ends_a_run_in_blocks_of_steps_where_it_ends_one_in_single_steps(method, every, steered):
    robot = tw.robots.panda()
    q0 = np.array([0, -0.3, 0, -1.9, 0, 1.7, 0.4, 0.01, 0.01])[: robot.nq]
    falls = {"controller": lambda t, q, dq: np.zeros(robot.nv)} if steered else {}
    one, other = both(robot, q0, None, 1.0, 1e-3, method=method, limits="stop", every=every, **falls)
    assert one.stopped == other.stopped and "reaches its lower limit" in one.stopped
    assert one.steps == other.steps < 1000 and len(one) == len(other)
    np.testing.assert_allclose(one.times, other.times, rtol=1e-12)
    for name in ("q", "dq", "ddq", "tau"):
        mine, theirs = getattr(one, name), getattr(other, name)
        np.testing.assert_allclose(mine, theirs, rtol=0.0, atol=1e-10 * (1.0 + np.abs(theirs).max()), err_msg=name)
    assert [e.name for e in one.events] == [e.name for e in other.events]


@pytest.mark.parametrize("name", ["controller", "events"])
def test_dopri5_under_a_controller_or_an_event_agrees_with_small_steps(name):
    robot = tw.robots.planar_2r()
    function = {"controller": lambda t, q, dq: 5.0 * (0.3 - q) - dq, "events": lambda t, q, dq: q[0]}[name]
    one = robot.simulate([1.0, 0.2], [0.0, 1.0], 0.3, 1e-3, **{name: function})
    other = robot.simulate([1.0, 0.2], [0.0, 1.0], 0.3, 1e-3, method="rk4", **{name: function})
    np.testing.assert_allclose(one.q, other.q, rtol=0.0, atol=1e-7)  # its tolerance is 1e-8 a step
    np.testing.assert_allclose(one.tau, other.tau, rtol=0.0, atol=1e-7)
    np.testing.assert_allclose([e.time for e in one.events], [e.time for e in other.events], atol=1e-7)


@pytest.mark.parametrize("method", METHODS)
def test_states_that_are_kept_are_evenly_apart_whatever_blocks_they_are_computed_in(method):
    """One in seven of 200 steps, which no block of a power of two has a whole number of; and the last."""
    robot = tw.robots.planar_2r()
    found = robot.simulate([0.2, 0.1], None, 0.2, 1e-3, method=method, every=7, controller=lambda t, q, dq: -q)
    assert found.steps == 200
    np.testing.assert_allclose(found.times, [*(7e-3 * np.arange(29)), 0.2], rtol=0.0, atol=1e-15)
