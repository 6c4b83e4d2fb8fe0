"""Methods travel: the builtin in front of a method pickles, copies and works in other processes as the method does."""

from __future__ import annotations

import copy
import multiprocessing
import pickle

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from quick import mostly_slow

import twistwrench as tw
from twistwrench.robot.quantities import QUANTITIES

METHODS = sorted(name for name in QUANTITIES if hasattr(tw.Robot, name))
TIMES = 10


@pytest.fixture(scope="module")
def robot():
    return tw.robots.planar_2r()


def is_builtin(method):
    return type(method).__name__ == "builtin_function_or_method"


def arguments_of(robot, name):
    """One state, as plain arrays."""
    sizes = [shape for _, shape in QUANTITIES[name].shapes(robot.model)]
    return [np.random.default_rng(k).normal(size=shape) for k, shape in enumerate(sizes)]


@pytest.mark.filterwarnings("ignore:.*rows of 'tip':twistwrench.ModelWarning")
@pytest.mark.parametrize("name", mostly_slow(METHODS, 3))
def test_every_method_pickles_before_and_after_a_hundred_calls(robot, name):
    given = arguments_of(robot, name)
    ways = [copy.copy, copy.deepcopy, *(lambda m, p=p: pickle.loads(pickle.dumps(m, p)) for p in range(6))]
    for calls in (0, 100):
        for _ in range(calls):
            expected = getattr(robot, name)(*given)
        for way in ways:
            method = way(getattr(robot, name))
            assert method.__name__ == name
            assert method.__self__ is not None
            if calls:
                found = method(*given)
                for one, other in zip(*((x if isinstance(x, tuple) else (x,)) for x in (found, expected)), strict=True):
                    assert_array_equal(one, other)


def test_most_methods_had_the_builtin(robot):
    """Or the test above tests nothing."""
    for name in ("inverse_dynamics", "gravity_forces", "mass_matrix", "jacobian"):
        for _ in range(3):
            getattr(robot, name)(*arguments_of(robot, name))
        assert is_builtin(getattr(robot, name))
        assert type(getattr(robot, name).__module__) is not type(None)
        assert isinstance(getattr(robot, name).__module__, str)


def test_a_spawned_pool_ten_times(robot):
    q = np.random.default_rng(0).normal(size=(20, 2))
    expected = robot.gravity_forces(q)
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        for _ in range(TIMES):
            assert_array_equal(pool.map(robot.gravity_forces, q[:2]), expected[:2])
            robot.gravity_forces(q[0])
    assert is_builtin(robot.gravity_forces)


@pytest.mark.parametrize("backend", ["loky", "threading"])
def test_joblib_ten_times(robot, backend):
    joblib = pytest.importorskip("joblib")
    q = np.random.default_rng(0).normal(size=(4, 2))
    expected = robot.gravity_forces(q)
    with joblib.Parallel(n_jobs=2, backend=backend) as pool:
        for _ in range(TIMES):
            assert_array_equal(pool(joblib.delayed(robot.gravity_forces)(x) for x in q), expected)
            robot.gravity_forces(q[0])


@pytest.mark.parametrize("options", [{}, {"dtype": float}])
def test_map_blocks_ten_times(robot, options):
    """Without ``dtype`` Dask calls with arrays of its own, of shapes that no robot has, to see what comes out."""
    da = pytest.importorskip("dask.array")
    q = np.random.default_rng(0).normal(size=(50, 2))
    x, expected = da.from_array(q, chunks=(20, 2)), robot.gravity_forces(q)
    for _ in range(TIMES):
        found = da.map_blocks(robot.gravity_forces, x, **options)
        assert found.dtype == np.float64
        assert_array_equal(found.compute(), expected)
        robot.gravity_forces(q[0])
    with pytest.raises(tw.ShapeError):  # and only Dask is told so
        robot.gravity_forces(np.ones((1, 1)))
