"""Runs whose steps are machine code against the same run stepped by Python, which an event that never happens asks for."""

import numpy as np
import pytest
from small_trees import tree

import twistwrench as tw
from twistwrench.testing import random_state

METHODS = ["euler", "semi_implicit", "rk4", "dopri5"]


def never(t, q, dq):
    return 1.0


def both(robot, *given, **options):
    one = robot.simulate(*given, **options)
    return one, robot.simulate(*given, **options, events=never)


def compare(one, other, rounding=1e-11):
    """Both round at every step, each in an order of its own, and a motion doubles differences some times a second."""
    assert len(one) == len(other)
    assert (one.stopped, one.completed, one.steps, one.method, one.dt) == (
        other.stopped, other.completed, other.steps, other.method, other.dt,
    )  # fmt: skip
    assert one.evaluations == other.evaluations
    np.testing.assert_array_equal(one.times, other.times)
    for name in ("q", "dq", "ddq", "tau", "kinetic_energy", "potential_energy", "momentum", "drift"):
        mine, theirs = getattr(one, name), getattr(other, name)
        scale = 1.0 + np.abs(other.energy if name == "drift" else theirs).max()
        np.testing.assert_allclose(mine, theirs, rtol=0.0, atol=rounding * scale, err_msg=name)
    for name, work in one.work.items():
        scale = 1.0 + np.abs(other.work[name]).max()
        np.testing.assert_allclose(work, other.work[name], rtol=0.0, atol=rounding * scale, err_msg=name)
    # An estimate is a difference of nearly equal states, whose rounding, some 1e-14 a step, adds up over the steps.
    np.testing.assert_allclose(one.error_estimate, other.error_estimate, rtol=1e-4, atol=1e-11)
    assert one.remarks == other.remarks


@pytest.mark.parametrize("method", METHODS)
def test_the_arm(method):
    robot = tw.robots.panda()
    q0 = np.linspace(-1.0, 1.0, robot.nq) * 0.3
    one, other = both(robot, q0, np.linspace(0.5, -0.5, robot.nv), 0.3, 1e-3, method=method, tau=np.full(robot.nv, 0.5))
    compare(one, other)
    assert one.work["torques"][-1] != 0.0


@pytest.mark.parametrize(
    ("name", "method"),
    [
        pytest.param(name, method, marks=() if k == 2 * (i % 2) else pytest.mark.slow)
        for i, name in enumerate(["floating base", "planar", "mimic", "driven"])
        for k, method in enumerate(METHODS[1:])
    ],
)
def test_trees_of_all_joints_with_their_friction_pushed_at_two_frames(name, method):
    robot = tree(name)
    q0, dq0, _ = random_state(robot, np.random.default_rng(3), ())
    pushes = {robot.frame_names[k]: np.linspace(-0.5, 1.0, 6) * (k + 1) for k in (1, -1)}
    options = {"wrench_on_robot": pushes, "friction": True, "tau": np.linspace(0.2, -0.2, robot.nv)}
    one, other = both(robot, q0, 0.2 * dq0, 0.1, 1e-3, method=method, **options)
    compare(one, other)
    assert one.work["wrenches"][-1] != 0.0
    for mine in robot.model.quaternions:
        np.testing.assert_allclose(np.linalg.norm(one.q[:, mine], axis=1), 1.0, rtol=0.0, atol=1e-15)


@pytest.mark.parametrize("method", METHODS)
def test_dry_friction_that_stops_joints(method):
    drives = {"actuators": {"joint1": {"friction": {"coulomb": "2 N m", "viscous": "0.1 N m s/rad"}}}}
    robot = tw.robots.planar_2r().with_actuators(drives)
    one, other = both(robot, [0.3, 0.2], [0.5, -3.0], 0.5, 1e-3, method=method, friction=True, tau=[0.1, 0.0])
    compare(one, other, 1e-9)  # where it stops and goes is decided by a sign
    assert one.work["friction"][-1] < 0.0


@pytest.mark.parametrize("every", [1, 3, 50, 1000])
@pytest.mark.parametrize("method", METHODS)
def test_one_state_in_so_many(method, every):
    robot = tw.robots.planar_2r()
    options = {"method": method, "every": every}
    compare(*both(robot, [1, 1], [0, 1.0], 0.1, 1e-3, **options))
    told = []
    compare(robot.simulate([1, 1], [0, 1.0], 0.1, 1e-3, **options, progress=told.append), robot.simulate(
        [1, 1], [0, 1.0], 0.1, 1e-3, **options, events=never
    ))  # fmt: skip
    assert told == sorted(told) and told[-1] == 1.0


@pytest.mark.parametrize("every", [1, 7])
def test_a_step_that_is_unstable_is_said_as_ever(every):
    drives = {"actuators": {"joint2": {"friction": {"viscous": "100 N m s/rad"}}}}
    robot, said = tw.robots.planar_2r().with_actuators(drives), []
    for options in ({}, {"events": never}):
        with pytest.raises(tw.SimulationError, match="is unstable") as caught:
            robot.simulate([1, 1], [0, 1.0], 1.0, 0.02, method="euler", friction=True, every=every, **options)
        said.append((str(caught.value).split(" moves at")[0], caught.value.result))
    (one, mine), (other, theirs) = said
    assert one == other and mine.times[-1] == theirs.times[-1] > 0.0 and len(mine) == len(theirs)
    np.testing.assert_allclose(mine.q[:5], theirs.q[:5], rtol=1e-9)


def test_an_interrupt_between_two_blocks_keeps_what_was_computed():
    def stop(share):
        if share > 0.5:
            raise KeyboardInterrupt

    robot = tw.robots.planar_2r()
    with pytest.raises(KeyboardInterrupt) as caught:
        robot.simulate([1, 1], None, 1.0, 1e-3, method="rk4", progress=stop)
    assert 0.5 < caught.value.result.times[-1] < 0.52
    assert caught.value.result.stopped == "interrupted"
