"""The builtin in front of a robot's methods: the same bits as the ufunc, the method's behaviour for all else, no leaks."""

from __future__ import annotations

import copy
import gc
import inspect
import pickle
import subprocess
import sys
import threading
import weakref

import numpy as np
import pytest

import twistwrench as tw
from twistwrench.compiler.runtime import dispatch
from twistwrench.testing import random_state

ONE_STATE = {
    "inverse_dynamics": 3, "forward_dynamics": 3, "mass_matrix": 1, "bias_forces": 2, "gravity_forces": 1, "jacobian": 1,
    "forward_kinematics": 1, "link_poses": 1, "coriolis_matrix": 2, "christoffel": 1, "center_of_mass": 1, "regressor": 3,
}  # fmt: skip


@pytest.fixture
def robot():
    return tw.robots.ur5()


def is_builtin(method):
    return type(method).__name__ == "builtin_function_or_method"


@pytest.mark.parametrize("name", ONE_STATE)
def test_one_state_gives_the_bits_of_the_ufunc(robot, name):
    rng = np.random.default_rng(0)
    states = [random_state(robot, rng)[: ONE_STATE[name]] for _ in range(20)]
    for state in states[:3]:
        getattr(robot, name)(*state)
    assert is_builtin(getattr(robot, name))
    for state in states:
        found = getattr(robot, name)(*state)
        np.testing.assert_array_equal(found, robot.kernel(name)(*state))
        assert type(found) is np.ndarray
        assert found.flags.owndata
        assert found.flags.writeable


def test_everything_else_goes_to_the_method(robot):
    q, dq, ddq = random_state(robot, np.random.default_rng(1))
    tau = robot.inverse_dynamics(q, dq, ddq)
    robot.inverse_dynamics(q, dq, ddq)
    assert is_builtin(robot.inverse_dynamics)
    same = np.testing.assert_array_equal
    same(robot.inverse_dynamics(q.tolist(), dq, ddq), tau)
    same(robot.inverse_dynamics(q=q, dq=dq, ddq=ddq), tau)
    same(robot.inverse_dynamics(q, dq, ddq, friction=False), tau)
    same(robot.inverse_dynamics(np.stack([q, q]), dq, ddq), [tau, tau])
    wide = np.stack([q, q], axis=1)[:, 0]  # strided
    assert not wide.flags.c_contiguous
    same(robot.inverse_dynamics(wide, dq, ddq), tau)
    raw = np.zeros(6 * 8 + 1, np.uint8)[1:].view(float)  # unaligned
    raw[:] = q
    assert not raw.flags.aligned
    same(robot.inverse_dynamics(raw, dq, ddq), tau)
    same(robot.inverse_dynamics(q.astype(">f8"), dq, ddq), tau)
    assert robot.inverse_dynamics(*(x.astype(np.float32) for x in (q, dq, ddq))).dtype == np.float32

    class Mine(np.ndarray):
        pass

    same(robot.inverse_dynamics(q.view(Mine), dq, ddq), tau)
    out = np.empty(6)
    assert robot.inverse_dynamics(q, dq, ddq, out=out) is out
    same(out, tau)
    same(robot.inverse_dynamics(q, dq, ddq, wrench_by_robot={"tool0": np.zeros(6)}), tau)
    same(robot.jacobian(q, "tool0"), robot.jacobian(q))
    assert not np.array_equal(robot.jacobian(q, kind="space"), robot.jacobian(q))


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        ((np.zeros(5), np.zeros(6), np.zeros(6)), tw.ShapeError),
        ((np.zeros(()), np.zeros(6), np.zeros(6)), tw.ShapeError),
        (("abc", np.zeros(6), np.zeros(6)), tw.ShapeError),
        ((None, None, None), tw.ShapeError),
        ((np.zeros(6),), TypeError),
        ((), TypeError),
    ],
)
def test_errors_are_the_methods(robot, arguments, error):
    for _ in range(2):
        robot.inverse_dynamics(np.zeros(6), np.zeros(6), np.zeros(6))
    assert is_builtin(robot.inverse_dynamics)
    with pytest.raises(error):
        robot.inverse_dynamics(*arguments)


def test_results_that_are_not_finite_warn_as_numpys_do(robot):
    q = np.zeros(6)
    robot.gravity_forces(q)
    robot.gravity_forces(q)
    assert is_builtin(robot.gravity_forces)
    with pytest.warns(RuntimeWarning, match="invalid value"):
        assert np.isnan(robot.gravity_forces(np.full(6, np.inf))).any()
    assert np.isnan(robot.gravity_forces(np.full(6, np.nan))).any()  # NaN in, NaN out: nothing to warn of


def test_it_looks_like_the_method(robot):
    for _ in range(2):
        robot.inverse_dynamics(np.zeros(6), np.zeros(6), np.zeros(6))
    names = list(inspect.signature(robot.inverse_dynamics).parameters)
    assert names == list(inspect.signature(tw.Robot.inverse_dynamics).parameters)[1:]
    assert "τ = M q̈ + h" in robot.inverse_dynamics.__doc__.strip().splitlines()[0]


def test_robots_with_it_pickle_copy_and_go(robot):
    q = np.full(6, 0.3)
    g = robot.gravity_forces(q)
    robot.gravity_forces(q)
    for other in (pickle.loads(pickle.dumps(robot)), copy.copy(robot), copy.deepcopy(robot)):
        np.testing.assert_array_equal(other.gravity_forces(q), g)
    method = robot.gravity_forces
    del robot
    gc.collect()
    np.testing.assert_array_equal(method(q), g)  # it keeps its robot
    del method


@pytest.mark.slow
def test_nothing_leaks():
    """Every way is gone once before anything is counted: the first error of a robot known from the cache makes its model."""
    robot = tw.robots.planar_2r()
    q, wrong, nowhere = np.array([0.1, 0.2]), np.zeros(3), np.full(2, np.nan)
    kept = weakref.ref(robot)

    def calls(robot, times):
        for _ in range(times):
            robot.gravity_forces(q)
            robot.gravity_forces([0.1, 0.2])
            with pytest.raises(tw.ShapeError):
                robot.gravity_forces(wrong)
            robot.gravity_forces(nowhere)
        gc.collect()  # models of earlier tests' robots go after their kernels
        gc.collect()

    calls(robot, 3)
    before = sys.getrefcount(np.dtype(float)), sys.getrefcount(q)
    calls(robot, 1000)
    assert abs(sys.getrefcount(np.dtype(float)) - before[0]) < 5
    assert sys.getrefcount(q) == before[1]
    del robot
    gc.collect()
    assert kept() is None


def test_methods_of_a_subclass_or_of_the_user_are_never_passed_by():
    class Mine(tw.Robot):
        def gravity_forces(self, q, **options):
            return super().gravity_forces(q, **options) + 100

    robot = Mine(tw.robots.planar_2r().model)
    first = robot.gravity_forces(np.zeros(2))
    for _ in range(3):
        np.testing.assert_array_equal(robot.gravity_forces(np.zeros(2)), first)
    plain = tw.robots.planar_2r()
    vars(plain)["gravity_forces"] = lambda q: "patched"
    for _ in range(3):
        tw.Robot.gravity_forces(plain, np.zeros(2))
    assert plain.gravity_forces(np.zeros(2)) == "patched"


def test_threads(robot):
    q = robot.random_configuration(0, 200)
    expected = robot.gravity_forces(q)
    for k in range(2):
        robot.gravity_forces(q[k])
    assert is_builtin(robot.gravity_forces)
    wrong: list[int] = []

    def work():
        wrong.extend(k for k in range(200) if not np.array_equal(robot.gravity_forces(q[k]), expected[k]))

    threads = [threading.Thread(target=work) for _ in range(4)]
    for t in threads:
        t.start()
    for t in threads:
        t.join()
    assert not wrong


def test_an_interpreter_that_is_not_understood_goes_without(robot, monkeypatch):
    monkeypatch.setattr(dispatch, "abi_matches", lambda: False)
    for _ in range(3):
        g = robot.gravity_forces(np.zeros(6))
    assert not is_builtin(robot.gravity_forces)
    assert g.shape == (6,)


def test_the_interpreter_may_end_with_calls_in_flight():
    code = (
        "import numpy as np, twistwrench as tw, threading\n"
        "r = tw.robots.planar_2r(); q = np.zeros(2); r.gravity_forces(q); r.gravity_forces(q)\n"
        "def work():\n    while True: r.gravity_forces(q); r.gravity_forces(q)\n"
        "threading.Thread(target=work, daemon=True).start()\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
