"""Simulations from many states: each of them is what it is alone, to the last bit, whatever the others do."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from quick import mostly_slow
from small_trees import tree

import twistwrench as tw
from twistwrench.simulation import Event, JointStops, Plane
from twistwrench.testing import random_state

ARM = tw.robots.panda()
HAND = ARM.frame_names[-1]
HOME = np.array([0, -0.3, 0, -1.9, 0, 1.7, 0.4, 0.01, 0.01])[: ARM.nq]


def starts(n=5, spread=0.2):
    return HOME + spread * np.random.default_rng(0).uniform(-1.0, 1.0, (n, ARM.nq))


def assert_same(one, alone):
    for name in ("times", "q", "dq", "ddq", "tau", "kinetic_energy", "potential_energy", "momentum", "error_estimate"):
        assert_array_equal(getattr(one, name), getattr(alone, name), err_msg=name)
    for name, work in alone.work.items():
        assert_array_equal(one.work[name], work)
    said = [
        (x.stopped, x.completed, x.steps, x.evaluations, x.remarks, [(e.name, e.time) for e in x.events])
        for x in (one, alone)
    ]
    assert said[0] == said[1]


CASES = {
    "constant torques and a wrench": {
        "tau": ARM.gravity_forces(HOME),
        "wrench_on_robot": {HAND: np.linspace(-1.0, 1.0, 6)},
    },
    "limits": {"limits": "stop", "every": 7},
    "a controller": {"controller": lambda t, q, dq: 20.0 * (HOME - q) - dq},
    "a torque law": {"tau": lambda t, q, dq: -dq},
    "events": {"events": Event(lambda t, q, dq: q[1] + 0.35, "down", terminal=True)},
    "stops": {"contacts": JointStops(1e4)},
    "a plane": {"contacts": Plane(HAND, height=0.3)},
}


@pytest.mark.parametrize("case", mostly_slow(CASES, 2))
@pytest.mark.parametrize("method", ["semi_implicit", "rk4"])
def test_each_is_what_it_is_alone(case, method):
    options = {"method": method, **CASES[case]}
    q0, dq0 = starts(3), np.linspace(0.2, -0.2, ARM.nv)
    batch = ARM.simulate_batch(q0, dq0, 0.2, 1e-3, **options)
    assert len(batch) == 3 and batch.shape == (3,)
    for one, q in zip(batch, q0, strict=True):
        assert_same(one, ARM.simulate(q, dq0, 0.2, 1e-3, **options))


@pytest.mark.parametrize("method", ["semi_implicit", "rk4", "dopri5"])
def test_friction_is_that_of_each_state(method):
    """It is eased off by the mass matrix of the start, which differs from one to the next."""
    drives = {"joint1": {"friction": {"coulomb": "2 N m", "viscous": "0.1 N m s/rad"}}}
    arm = tw.robots.planar_2r().with_actuators({"actuators": drives})
    q0, dq0 = [[0.3, 0.2], [0.3, 2.0], [1.0, -1.0]], [[0.5, -3.0], [0.0, 1.0], [-2.0, 0.0]]
    batch = arm.simulate_batch(q0, dq0, 0.4, 1e-3, method=method, friction=True)
    for one, q, dq in zip(batch, q0, dq0, strict=True):
        assert_same(one, arm.simulate(q, dq, 0.4, 1e-3, method=method, friction=True))


def test_quaternions_keep_their_length_side_by_side():
    robot = tree("floating base")
    q0, dq0, _ = random_state(robot, np.random.default_rng(0), (4,))
    batch = robot.simulate_batch(q0, 0.2 * dq0, 0.05, 1e-3, method="rk4")
    for one, q, dq in zip(batch, q0, dq0, strict=True):
        assert_same(one, robot.simulate(q, 0.2 * dq, 0.05, 1e-3, method="rk4"))


def test_one_that_is_unstable_ends_and_says_so_and_the_others_go_on():
    drives = {"joint2": {"friction": {"viscous": "100 N m s/rad"}}}
    arm = tw.robots.planar_2r().with_actuators({"actuators": drives})
    dq0 = np.array([[0.0, 0.0], [0.0, 3.0], [0.0, 0.0]])
    weightless = arm.with_gravity([0, 0, 0])
    options = {"method": "euler", "friction": True}
    batch = weightless.simulate_batch([1.0, 1.0], dq0, 1.0, 0.02, **options)
    assert_array_equal(batch.completed, [True, False, True])
    assert "is unstable" in batch[1].stopped and "the first of the others, [1]" in repr(batch)
    with pytest.raises(tw.SimulationError) as caught:
        weightless.simulate([1.0, 1.0], dq0[1], 1.0, 0.02, **options)
    assert_same(batch[1], caught.value.result)
    assert_array_equal(batch.ends[[0, 2]], [1.0, 1.0])


def test_batches_of_any_shape_broadcast_and_are_indexed_so():
    arm = tw.robots.planar_2r()
    q0, dq0 = np.random.default_rng(0).normal(size=(3, 1, 2)), np.random.default_rng(1).normal(size=(2, 2))
    batch = arm.simulate_batch(q0, dq0, 0.05, 1e-3, method="semi_implicit")
    assert batch.shape == batch.completed.shape == batch.ends.shape == (3, 2) and len(batch) == len(list(batch)) == 6
    assert_same(batch[2, 1], arm.simulate(q0[2, 0], dq0[1], 0.05, 1e-3, method="semi_implicit"))
    assert_array_equal(batch[-1, -1].q, batch[2, 1].q)
    one = arm.simulate_batch([0.3, 0.1], duration=0.05, method="rk4")
    assert one.shape == () and len(one) == 1 and "1 simulations, 1 reached the end" in repr(one)
    none = arm.simulate_batch(np.zeros((0, 2)), duration=0.05)
    assert len(none) == 0 and "no simulations" in repr(none)


@pytest.mark.parametrize(
    ("given", "error", "said"),
    [
        ({"q0": [[0, 0], [np.nan, 0]]}, tw.ValueRangeError, r"q0 has the entry nan at \(1, 0\)"),
        ({"q0": [[0, 0, 0]]}, tw.ShapeError, "q0"),
        ({"q0": np.zeros((3, 2)), "dq0": np.zeros((2, 2))}, tw.ShapeError, "do not go together"),
        ({"q0": [[0, 0]], "loops": None}, TypeError, "loops"),
        ({"q0": [[0, 0]], "method": "rk5"}, tw.UnknownNameError, "rk4"),
    ],
)
def test_bad_input_is_said_before_anything_runs(given, error, said):
    with pytest.raises(error, match=said):
        tw.robots.planar_2r().simulate_batch(**given)


def test_a_start_beyond_a_limit_is_said_with_its_place():
    q0 = starts()
    q0[3, 1] = 3.0
    with pytest.raises(tw.ValueRangeError, match=r"simulation \[3\] of the batch: .*outside already"):
        ARM.simulate_batch(q0, limits="stop", method="rk4")


def test_progress_is_told_after_each():
    told = []
    tw.robots.planar_2r().simulate_batch(np.zeros((4, 2)), duration=0.01, method="rk4", progress=told.append)
    assert told == [0.25, 0.5, 0.75, 1.0]


def test_one_state_too_many_for_simulate_names_the_method_that_takes_them():
    with pytest.raises(tw.ShapeError, match="simulate_batch"):
        tw.robots.planar_2r().simulate(np.zeros((3, 2)))
