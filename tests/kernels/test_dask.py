"""Dask arrays in, Dask arrays out: right shapes, types and chunks before anything is computed, and the bits of the array."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from quick import mostly_slow

import twistwrench as tw
from twistwrench import robots

dask = pytest.importorskip("dask")
da = pytest.importorskip("dask.array")

CALLS = {
    "gravity_forces": lambda r, q, dq, x: r.gravity_forces(q),
    "link_poses": lambda r, q, dq, x: r.link_poses(q),
    "potential_energy": lambda r, q, dq, x: r.potential_energy(q),
    "jacobian": lambda r, q, dq, x: r.jacobian(q, kind="space"),
    "inverse_dynamics": lambda r, q, dq, x: r.inverse_dynamics(q, dq, x),
    "inverse_dynamics, one for all": lambda r, q, dq, x: r.inverse_dynamics(q, np.zeros(3), [0.1, 0.2, 0.3]),
    "inverse_dynamics, friction": lambda r, q, dq, x: r.inverse_dynamics(q, dq, x, friction=True),
    "forward_dynamics, friction": lambda r, q, dq, x: r.forward_dynamics(q, dq, x, friction=True),
    "derivatives": lambda r, q, dq, x: r.inverse_dynamics_derivatives(q, dq, x),
    "gradient": lambda r, q, dq, x: r.inverse_dynamics_gradient(q, dq, x, dq),
    "add": lambda r, q, dq, x: r.add(q, dq),
    "subtract": lambda r, q, dq, x: r.subtract(q, x),
    "power_balance": lambda r, q, dq, x: r.power_balance(q, dq, x, friction=True),
    "task_inertia": lambda r, q, dq, x: r.task_inertia(q, kind="world_aligned", rows="vx vz"),
    "task_bias": lambda r, q, dq, x: r.task_bias(q, dq, kind="world_aligned", rows="vx vz"),
}


@pytest.fixture(scope="module")
def robot():
    return robots.planar_3r()


@pytest.fixture(scope="module")
def states():
    return np.random.default_rng(0).normal(size=(3, 30, 3))


def parts(x):
    return x if isinstance(x, tuple) else (x,)


def check(lazy, expected, chunks):
    """Dask arrays of the shapes, types, chunks and bits of ``expected``."""
    assert isinstance(lazy, tuple) == isinstance(expected, tuple)
    if isinstance(expected, tuple):
        assert type(lazy) is type(expected)
    for promised, e in zip(parts(lazy), parts(expected), strict=True):
        assert isinstance(promised, da.Array)
        assert (promised.shape, promised.dtype, promised.chunks[0]) == (e.shape, e.dtype, chunks)
        found = promised.compute()
        assert type(found) is np.ndarray
        assert found.dtype == e.dtype
        assert_array_equal(found, e)


@pytest.mark.parametrize("kind", [np.float64, np.float32])
@pytest.mark.parametrize("name", mostly_slow(CALLS, 3))
def test_results_are_lazy_and_of_the_same_bits(robot, states, name, kind):
    given = states.astype(kind)
    lazy = [da.from_array(x, chunks=(7, 2)) for x in given]  # the joints' axis in two chunks
    check(CALLS[name](robot, *lazy), CALLS[name](robot, *given), (7, 7, 7, 7, 2))


def test_wrenches_may_be_lazy(robot, states):
    F = np.random.default_rng(1).normal(size=(30, 6))
    lazy, q = da.from_array(F, chunks=(10, 6)), states[0]
    for call in (
        lambda F: robot.holding_torques(q, wrench_by_robot={"tip": F}),
        lambda F: robot.inverse_dynamics(
            *states, wrench_on_robot={"tip": F}, wrench_by_robot={"tip": [1, 2, 3, 4, 5, 6]}
        ),
        lambda F: robot.power_balance(*states, wrench_on_robot={"tip": F}),
        lambda F: robot.wrench_torques(q, F),
    ):
        check(call(lazy), call(F), (10, 10, 10))


def test_batches_broadcast_as_in_numpy(robot, states):
    q, dq, _ = states
    lazy = robot.bias_forces(da.from_array(q, chunks=(10, 3))[:, None], da.from_array(dq[:4], chunks=(2, 3)))
    assert lazy.chunks == ((10, 10, 10), (2, 2), (3,))
    assert_array_equal(lazy.compute(), robot.bias_forces(q[:, None], dq[:4]))


def test_nothing_is_computed_before_it_is_asked_for(robot):
    def never(block):
        raise AssertionError

    q = da.map_blocks(never, da.zeros((10, 3), chunks=(5, 3)), dtype=float, meta=np.empty((0, 0)))
    assert robot.mass_matrix(q).shape == (10, 3, 3)


def test_robots_that_differ_are_told_apart(robot, states):
    """Dask names a result by what it is made from, and takes one for the other where the names are the same."""
    q = da.from_array(states[0], chunks=(10, 3))
    loaded = robot.with_payload(tw.SpatialInertia.from_com(1.0))
    for one, other in (
        (robot.gravity_forces(q), loaded.gravity_forces(q)),
        (robot.jacobian(q), robot.jacobian(q, kind="space")),
        (da.map_blocks(robot.gravity_forces, q, dtype=float), da.map_blocks(loaded.gravity_forces, q, dtype=float)),
    ):
        a, b = dask.compute(one, other)
        assert not np.array_equal(a, b)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda r, q: r.gravity_forces(q[:, :2]), r"q has shape \(10, 2\), but robot 'planar_3r' wants 3"),
        (lambda r, q: r.add(q, q[:, :2]), r"dv has shape \(10, 2\), but robot .* wants 3 in the last axis"),
        (lambda r, q: r.bias_forces(q, q[:4]), r"the batch shapes do not broadcast: q \(10,\), dq \(4,\)"),
        (lambda r, q: r.gravity_forces(q.astype(complex)), "q is not an array of real numbers but of complex128"),
        (lambda r, q: r.gravity_forces(q, out=np.empty((10, 3))), "out= is for results that are computed now"),
        (lambda r, q: r.inverse_dynamics(q, q, q, friction=True, out=np.empty((10, 3))), "out= is for results"),
    ],
)
def test_what_cannot_be_meant_is_refused_at_once(robot, call, words):
    with pytest.raises(tw.ShapeError, match=words):
        call(robot, da.zeros((10, 3), chunks=(5, 3)))


CLOSED = {
    "constraint_error": "q", "consistent": "q", "constraint_jacobian": "q", "constraint_bias": "qd", "rank": "q",
    "degrees_of_freedom": "q", "projector": "q", "split": "qa", "project_velocity": "qd", "project_acceleration": "qda",
    "forward_dynamics": "qda", "inverse_dynamics": "qda", "power_balance": "qda",
}  # fmt: skip


@pytest.fixture(scope="module")
def held(robot):
    return robot.close("ground", robot.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))


@pytest.mark.parametrize("kind", [np.float64, np.float32])
@pytest.mark.parametrize("name", mostly_slow(CLOSED, 3))
def test_closed_robots_too(held, name, kind):
    rng = np.random.default_rng(0)
    q = held.consistent(np.array([-0.6, 0.2, 2.2]) + 0.05 * rng.normal(size=(12, 3)))
    dq = held.project_velocity(q, rng.normal(size=(12, 3)))
    state = {"q": q, "d": dq, "a": held.project_acceleration(q, dq, rng.normal(size=(12, 3)))}
    given = [state[letter].astype(kind) for letter in CLOSED[name]]
    method = getattr(held, name)
    expected = method(*given)
    assert all(x.dtype == (int if "rank" in name or "freedom" in name else kind) for x in parts(expected))
    check(method(*(da.from_array(x, chunks=(5, 3)) for x in given)), expected, (5, 5, 2))
