"""Other Pythons than the main interpreter of CPython with its lock: everything works there, or stands aside; nothing crashes."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
import sysconfig
import threading
import types
import weakref

import numpy as np
import pytest

import twistwrench as tw
from twistwrench.compiler.lowering.numpy_kernels import NumpyKernel
from twistwrench.compiler.runtime import batch_threads, dispatch, dispatch_ir, gufunc, interpreter

WAIT = 120.0
"""Seconds until a test that would hang fails instead."""

try:
    import _interpreters as interpreters  # Python 3.13 and later
except ImportError:
    try:
        import _xxsubinterpreters as interpreters
    except ImportError:
        interpreters = None


def python(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-X", "faulthandler", "-c", code],
        env={**os.environ, **environment}, capture_output=True, text=True, timeout=WAIT,
    )  # fmt: skip


def is_builtin(method) -> bool:
    return type(method).__name__ == "builtin_function_or_method"


# ── subinterpreters ──

SUBINTERPRETER = """
import textwrap
try:
    import _interpreters as subinterpreters
    def create(own): return subinterpreters.create("isolated" if own else "legacy")
    def run(where, code):
        problem = subinterpreters.run_string(where, code)
        if problem is not None:
            raise RuntimeError(problem.formatted)
except ImportError:
    import _xxsubinterpreters as subinterpreters
    def create(own): return subinterpreters.create(isolated=own)
    run = subinterpreters.run_string

WORK = '''
import warnings
warnings.simplefilter("ignore")  # NumPy warns that it makes no promises here
import numpy as np
import twistwrench as tw
from twistwrench.compiler.runtime import interpreter
from twistwrench.compiler.runtime import batch_threads
import threading

robot = tw.robots.planar_3r()
q = robot.random_configuration(0, 5000)
kernel = robot.kernel("mass_matrix")
whole = kernel(q)
assert np.allclose(whole[7], robot.reference("mass_matrix", q[7]), rtol=1e-13)
for k in range(5):  # by the method, then by the builtin
    assert np.array_equal(robot.mass_matrix(q[k]), whole[k])
single = robot.mass_matrix(q.astype(np.float32))  # where a callback from C would wait for itself
assert single.dtype == np.float32 and np.allclose(single, whole, atol=1e-4)
batch_threads.MIN_PART = 2e3
tw.set_threads(3)
assert np.array_equal(robot.mass_matrix(q), whole)
assert tw.get_threads() == (3 if interpreter.is_main() else 1)
tw.set_threads(1)
try:
    robot.mass_matrix([0.0, 0.0])
except tw.ShapeError:
    print("worked", interpreter.is_main(), flush=True)
'''

def attempt(own):
    where = create(own)
    try:
        run(where, WORK)
    except Exception as problem:
        print("refused", "ImportError" in str(problem), flush=True)
    subinterpreters.destroy(where)
    print("ended", flush=True)
"""


@pytest.mark.skipif(interpreters is None, reason="no module for subinterpreters")
def test_a_subinterpreter_may_be_the_one_that_uses_it():
    """NumPy lets one interpreter of a process import it; with the shared lock that need not be the main one."""
    done = python(SUBINTERPRETER + "attempt(own=False)\n")
    assert done.returncode == 0, done.stderr
    assert done.stdout in ("worked False\nended\n", "refused True\nended\n"), done.stderr
    if np.lib.NumpyVersion(np.__version__) < "2.5.0" and sys.version_info < (3, 12):
        assert done.stdout.startswith("worked"), done.stderr


@pytest.mark.skipif(interpreters is None, reason="no module for subinterpreters")
@pytest.mark.parametrize("own", [False, True], ids=["shared lock", "own lock"])
def test_a_subinterpreter_beside_the_main_one_is_refused_by_numpy_or_works(own):
    """And the main one goes on as if nothing had happened."""
    done = python(SUBINTERPRETER + f"exec(WORK)\nattempt({own})\nattempt({own})\nexec(WORK)\n")
    assert done.returncode == 0, done.stderr
    lines = done.stdout.split("\n")
    assert lines[0] == lines[-2] == "worked True", done.stderr
    assert set(lines[1:-2]) <= {"refused True", "worked False", "ended"}
    assert lines.count("ended") == 2


def test_here_is_the_main_interpreter():
    assert interpreter.is_main()
    assert interpreter.runs_machine_code()


@pytest.fixture
def elsewhere(monkeypatch):
    """Whether this is the main interpreter is asked anew, and answered with no."""
    monkeypatch.setattr(interpreter, "is_main", lambda: False)


def test_no_stand_in_and_no_helper_where_this_is_not_the_main_one(elsewhere, monkeypatch):
    robot = tw.robots.planar_2r()
    owner = gufunc.owner_of(robot.kernel("mass_matrix"))
    assert set(owner.code) == {"d", "f"}  # both precisions from the start: nothing to call back for
    monkeypatch.setattr(batch_threads, "MIN_PART", 2e3)
    monkeypatch.setattr(threading.Thread, "start", lambda self: pytest.fail("a thread was started"))
    tw.set_threads(3)
    try:
        assert tw.get_threads() == 1
        assert robot.mass_matrix(np.zeros((5000, 2))).shape == (5000, 2, 2)
    finally:
        tw.set_threads(1)


# ── Pythons that are not CPython with its lock ──


@pytest.fixture
def looked_at_again():
    """What an interpreter is like is looked at once; here it is to be looked at again, before and after."""
    caches = (dispatch.abi_matches, gufunc._abi_matches, interpreter.is_main)
    for cache in caches:
        cache.cache_clear()
    yield
    for cache in caches:
        cache.cache_clear()


def stands_aside(robot: tw.Robot) -> None:
    q = np.linspace(-1.0, 1.0, 6)
    for _ in range(4):
        g = robot.gravity_forces(q)
    assert not is_builtin(robot.gravity_forces)
    np.testing.assert_allclose(g, robot.reference("gravity_forces", q), rtol=1e-12, atol=1e-12)


def test_a_free_threaded_python_goes_without_the_builtin(looked_at_again, monkeypatch):
    """Heads of objects are longer there, so nothing lies where the builtin would look; the build says so."""
    ask = sysconfig.get_config_var
    monkeypatch.setattr(sysconfig, "get_config_var", lambda name: 1 if name == "Py_GIL_DISABLED" else ask(name))
    robot = tw.robots.ur5()
    stands_aside(robot)
    assert isinstance(robot.kernel("gravity_forces"), np.ufunc)
    assert gufunc.owner_of(robot.kernel("gravity_forces")) is not None


@pytest.mark.parametrize("field", sorted(dispatch_ir.FIELDS))
def test_arrays_that_lie_otherwise_go_without_the_builtin(looked_at_again, monkeypatch, field):
    shifted = {"type": 0, "data": 32, "nd": 28, "dims": 16, "descr": 8, "flags": 24}
    monkeypatch.setitem(dispatch_ir.FIELDS, field, shifted[field])
    stands_aside(tw.robots.ur5())


@pytest.mark.parametrize("byteorder", ["big"])
def test_the_other_byte_order_goes_without_the_builtin(looked_at_again, monkeypatch, byteorder):
    monkeypatch.setattr(sys, "byteorder", byteorder)
    stands_aside(tw.robots.ur5())


def test_ufuncs_that_lie_otherwise_are_kept_for_good_and_never_looked_into(looked_at_again, monkeypatch):
    """The head as a free-threaded build would have it, read here: all that follows is 16 bytes off."""
    longer = type(
        "Longer",
        (gufunc.ctypes.Structure,),
        {"_fields_": (("more", gufunc.ctypes.c_byte * 16), *gufunc._UFuncObject._fields_)},
    )
    monkeypatch.setattr(gufunc, "_UFuncObject", longer)
    monkeypatch.setattr(gufunc, "_FOREVER", [])
    monkeypatch.setattr(batch_threads, "MIN_PART", 2e4)
    robot = tw.robots.ur5()
    stands_aside(robot)
    assert gufunc.owner_of(robot.kernel("gravity_forces")) is None
    assert gufunc.owner_of(np.matmul) is None
    assert [owner.program for owner in gufunc._FOREVER] == [robot.program("gravity_forces")]
    kernel = robot.kernel("gravity_forces")
    gone, expected = weakref.ref(robot), kernel(np.ones((7, 6)))
    tw.set_threads(2)
    try:
        q = np.ones((20_000, 6))
        np.testing.assert_array_equal(robot.gravity_forces(q)[:7], expected)
    finally:
        tw.set_threads(1)
    del robot
    gc.collect()
    assert gone() is None
    np.testing.assert_array_equal(kernel(np.ones((7, 6))), expected)


@pytest.mark.parametrize("what", ["pypy", "graalpy", "32 bits"])
def test_other_pythons_run_on_numpy(looked_at_again, monkeypatch, what):
    if what == "32 bits":
        monkeypatch.setattr(sys, "maxsize", 2**31 - 1)
    else:
        monkeypatch.setattr(sys, "implementation", types.SimpleNamespace(**(vars(sys.implementation) | {"name": what})))
    robot = tw.robots.ur5()
    assert isinstance(robot.kernel("gravity_forces"), NumpyKernel)
    stands_aside(robot)
    assert interpreter.is_main()


# ── whatever lives longer ──


def test_a_robot_may_be_dropped_while_threads_call_it():
    robot = tw.robots.planar_3r()
    q = robot.random_configuration(0, 50)
    for k in range(2):
        robot.gravity_forces(q[k])
    expected, gate, wrong = robot.kernel("gravity_forces")(q), threading.Barrier(5), []

    def calls(method):
        gate.wait(WAIT)
        wrong.extend(k for k in range(1000) if not np.array_equal(method(q[k % 50]), expected[k % 50]))

    crowd = [threading.Thread(target=calls, args=(robot.gravity_forces,)) for _ in range(4)]
    assert is_builtin(robot.gravity_forces)
    gone = weakref.ref(robot)
    for thread in crowd:
        thread.start()
    gate.wait(WAIT)
    del robot
    gc.collect()
    for thread in crowd:
        thread.join(WAIT)
        assert not thread.is_alive()
    del crowd, thread
    gc.collect()
    assert not wrong
    assert gone() is None


@pytest.mark.slow
def test_kernels_are_made_and_dropped_while_others_run():
    robot, stop, wrong = tw.robots.planar_2r(), threading.Event(), []
    q = np.array([0.3, -0.2])
    robot.gravity_forces(q)
    expected = robot.gravity_forces(q)

    def calls():
        while not stop.is_set():
            if not np.array_equal(robot.gravity_forces(q), expected):
                wrong.append(1)

    thread = threading.Thread(target=calls)
    thread.start()
    try:
        for _ in range(20):
            other = tw.robots.planar_2r()
            for _ in range(3):
                np.testing.assert_array_equal(other.gravity_forces(q), expected)
            method = other.gravity_forces
            del other
            gc.collect()
            np.testing.assert_array_equal(method(q), expected)
            del method
    finally:
        stop.set()
        thread.join(WAIT)
    assert not wrong
