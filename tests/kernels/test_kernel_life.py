"""The life of a kernel: threads, processes, memory, and what outlives what."""

from __future__ import annotations

import ctypes
import gc
import io
import os
import pickle
import subprocess
import sys
import threading
import time
import weakref
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import numpy as np
import pytest

import twistwrench as tw
from twistwrench.compiler.lowering.target_machine import DOUBLE
from twistwrench.compiler.runtime import jit
from twistwrench.compiler.runtime.gufunc import _UFuncObject, make_ufunc
from twistwrench.compiler.runtime.jit import compile_form

THREADS = 8


def states(robot: tw.Robot, count: int) -> list[np.ndarray]:
    rng = np.random.default_rng(9)
    return [
        robot.random_configuration(rng, count),
        rng.normal(size=(count, robot.nv)),
        rng.normal(size=(count, robot.nv)),
    ]


# ── threads ──


def test_a_long_call_lets_other_threads_run():
    robot = tw.robots.cart_pole()
    kernel = robot.kernel("kinetic_energy")
    ticks, stop = [], threading.Event()

    def tick():
        while not stop.wait(0.001):
            ticks.append(time.perf_counter())

    clock = threading.Thread(target=tick)
    clock.start()
    try:
        for samples in 2 ** np.arange(20, 25):
            q = np.broadcast_to([0.1, 0.2], (samples, 2))
            start = time.perf_counter()
            kernel(q, q)
            end = time.perf_counter()
            if meanwhile := sum(start < t < end for t in ticks) > 5:
                break
    finally:
        stop.set()
        clock.join()
    # A call that kept the interpreter would let the clock tick at its two ends at most, however long it took.
    assert meanwhile


def run_together(function) -> list:
    """The results of ``function`` in threads that start at the same moment."""
    gate = threading.Barrier(THREADS)

    def wait_and_run(k):
        gate.wait()
        return function(k)

    with ThreadPoolExecutor(THREADS) as pool:
        return list(pool.map(wait_and_run, range(THREADS)))


def test_many_threads_get_the_same_bits():
    robot = tw.robots.panda()
    kernel, arrays = robot.kernel("inverse_dynamics"), states(robot, 1001)
    expected = kernel(*arrays).tobytes()
    assert all(
        all(r == expected for r in rs) for rs in run_together(lambda k: [kernel(*arrays).tobytes() for _ in range(20)])
    )


def test_the_first_single_precision_call_may_come_from_many_threads(monkeypatch):
    monkeypatch.setenv("TWISTWRENCH_CACHE_DIR", "off")  # so that the compilation takes its time
    robot = tw.robots.planar_3r()
    kernel, arrays = robot.kernel("forward_dynamics"), [a.astype(np.float32) for a in states(robot, 33)]
    results = run_together(lambda k: kernel(*arrays))
    assert {r.dtype for r in results} == {np.dtype(np.float32)}
    assert {r.tobytes() for r in results} == {kernel(*arrays).tobytes()}


def test_kernels_may_be_compiled_by_many_threads(monkeypatch):
    monkeypatch.setenv("TWISTWRENCH_CACHE_DIR", "off")
    robot = tw.robots.planar_2r()
    names = ("mass_matrix", "gravity_forces", "center_of_mass", "potential_energy")
    q = np.array([0.3, -0.4])
    results = run_together(lambda k: getattr(robot, names[k % len(names)])(q).tobytes())
    assert results == [getattr(robot, names[k % len(names)])(q).tobytes() for k in range(THREADS)]


# ── processes ──

PROCESSES = """
import multiprocessing, sys
import numpy as np
import twistwrench as tw

def work(job):
    robot, q = job
    # The first quantity was compiled by the parent, the second was not; single precision was by neither.
    return [robot.gravity_forces(q).tobytes(), robot.mass_matrix(q).tobytes(), robot.mass_matrix(q.astype("f")).tobytes()]

if __name__ == "__main__":
    robot = tw.robots.planar_3r()
    q = robot.random_configuration(1, 21)
    robot.gravity_forces(q)
    context = multiprocessing.get_context(sys.argv[1])
    with context.Pool(2) as pool:
        theirs = pool.map_async(work, [(robot, q)] * 4).get(timeout=60)
    assert theirs == [work((robot, q))] * 4
    print("the same bits")
"""


FORKED_MEANWHILE = """
import os, threading, time
import numpy as np
import twistwrench as tw

robot = tw.robots.quadruped()
kernel, arrays = robot.kernel("forward_dynamics"), [robot.neutral.astype("f")] + [np.zeros(18, "f")] * 2
thread = threading.Thread(target=kernel, args=arrays)
thread.start()
time.sleep(0.05)  # the compilation takes several times that
compiling = thread.is_alive()
child = os.fork()
if child == 0:
    kernel(*arrays)
    os._exit(0)
for _ in range(200):
    time.sleep(0.1)
    if os.waitpid(child, os.WNOHANG)[0] == child:
        print("the child ran", compiling)
        break
else:
    os.kill(child, 9)
thread.join()
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
def test_a_process_may_be_forked_while_a_thread_compiles(tmp_path):
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", FORKED_MEANWHILE],
        env={**os.environ, "TWISTWRENCH_CACHE_DIR": "off"}, capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    assert done.stdout == "the child ran True\n", done.stderr


@pytest.mark.parametrize("method", ["fork", "spawn", "forkserver"])
def test_forked_and_spawned_processes(tmp_path, method):
    if method not in __import__("multiprocessing").get_all_start_methods():
        pytest.skip(f"no {method} on this system")
    script = tmp_path / "processes.py"
    script.write_text(PROCESSES)
    done = subprocess.run([sys.executable, script, method], capture_output=True, text=True, timeout=120)
    assert done.stdout == "the same bits\n", done.stderr


def test_robots_pickle():
    robot = tw.robots.panda().with_gravity((0, 0, -1.62))
    arrays = states(robot, 5)
    before = robot.inverse_dynamics(*arrays)
    twin = pickle.loads(pickle.dumps(robot))
    assert (twin.name, twin.joint_names, twin.frame_names, twin.tip) == (
        robot.name,
        robot.joint_names,
        robot.frame_names,
        robot.tip,
    )
    assert np.array_equal(twin.gravity, robot.gravity)
    assert twin.inverse_dynamics(*arrays).tobytes() == before.tobytes()
    assert len(pickle.dumps(robot)) == len(
        pickle.dumps(tw.robots.panda().with_gravity((0, 0, -1.62)))
    )  # no kernels in it


# ── memory ──


def owner_of(ufunc: np.ufunc) -> weakref.ref:
    head = _UFuncObject.from_address(id(ufunc))
    return weakref.ref(ctypes.cast(head.owner, ctypes.py_object).value)


def test_a_kernel_outlives_its_robot():
    robot = tw.robots.planar_3r()
    arrays = states(robot, 9)
    kernel = robot.kernel("inverse_dynamics")
    before = [kernel(*arrays).tobytes(), kernel(*(a.astype(np.float32) for a in arrays)).tobytes()]
    gone = weakref.ref(robot)
    del robot
    gc.collect()
    assert gone() is None
    assert [kernel(*arrays).tobytes(), kernel(*(a.astype(np.float32) for a in arrays)).tobytes()] == before


@pytest.mark.parametrize("single", [False, True])
def test_code_is_freed_with_the_kernel(single):
    program = tw.robots.planar_2r().program("mass_matrix")
    kernel = make_ufunc(program, "mass_matrix", "")
    kernel(np.zeros(2, np.float32 if single else np.float64))
    owner = owner_of(kernel)
    assert owner() is not None
    del kernel
    gc.collect()
    assert owner() is None


def test_a_kernel_is_freed_with_its_robot():
    robot = tw.robots.planar_2r()
    robot.mass_matrix([0.0, 0.0])
    owner = owner_of(robot.kernel("mass_matrix"))
    del robot
    gc.collect()
    assert owner() is None


@pytest.mark.slow
@pytest.mark.skipif(not os.path.exists("/proc/self/statm"), reason="reads the resident size from /proc")
def test_memory_does_not_grow_with_kernels_made_and_dropped():
    program = tw.robots.panda().program("forward_dynamics_derivatives")
    size = compile_form(program, DOUBLE).size  # from here on the code comes from the cache
    state = np.zeros(7)

    def make_and_drop(times: int) -> float:
        for _ in range(times):
            make_ufunc(program, "forward_dynamics_derivatives", "")(state, state, state)
        gc.collect()
        with open("/proc/self/statm") as file:
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")

    before = make_and_drop(60)
    count = 300
    after = make_and_drop(count)
    # LLVM keeps about 10 KB of names for each library it ever linked; the code itself, many times that, must go.
    assert after - before < 0.6 * size * count


@pytest.mark.slow
def test_thousands_of_small_kernels():
    program = tw.robots.pendulum().program("gravity_forces")
    owners = []
    for _ in range(2000):
        kernel = make_ufunc(program, "gravity_forces", "")
        owners.append(owner_of(kernel))
    del kernel
    gc.collect()
    assert not any(owner() for owner in owners)


def test_a_compilation_that_ends_early_frees_what_it_had_once():
    """The exception lies in a circle, so its traceback and all it holds are the garbage collector's, which knows no order."""
    script = """
import gc
import numpy as np
from twistwrench.compiler.runtime import jit
from twistwrench.compiler.ir.tracer import trace
from twistwrench.compiler.lowering.target_machine import DOUBLE

class Ends:
    def emit_object(self, module):
        raise KeyboardInterrupt

jit._JIT.target = lambda machine: Ends()
gc.disable()
for _ in range(20):
    try:
        jit.compile_form(trace(lambda x: 3.0 * np.sin(x), [("x", ())], ["y"]), DOUBLE)
    except KeyboardInterrupt as problem:
        problem.itself = problem
    gc.collect()
"""
    variables = {**os.environ, "TWISTWRENCH_CACHE_DIR": "off"}
    done = subprocess.run([sys.executable, "-c", script], env=variables, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


class LateError(Exception):
    """Exception with an argument, as raised by a timeout."""

    def __init__(self, seconds):
        super().__init__(f"late by {seconds} s")


def test_a_slow_compilation_of_many_modules_is_told_once(monkeypatch):
    """On a terminal, and in one line, however many modules follow."""
    terminal = io.StringIO()
    monkeypatch.setattr(terminal, "isatty", lambda: True, raising=False)
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setattr(jit, "SILENT_SECONDS", -1.0)
    program = SimpleNamespace(outputs=[SimpleNamespace(name="tau")])
    assert list(jit._with_message(program, ["first", "second", "third"])) == ["first", "second", "third"]
    assert terminal.getvalue().count("\n") == 1 and "compiling a kernel of tau" in terminal.getvalue()


@pytest.mark.parametrize(
    "problem", [LateError(2), KeyboardInterrupt(), tw.KernelError("LLVM refused a kernel")], ids=repr
)
def test_whatever_is_raised_below_numpy_is_raised_itself_and_the_next_call_compiles(problem, monkeypatch):
    pytest.importorskip("llvmlite.binding", reason="compiles nothing here")
    monkeypatch.setenv("TWISTWRENCH_CACHE_DIR", "off")
    robot = tw.robots.cart_pole()
    q = np.array([[0.1, 0.2], [0.3, -0.4]])
    for way in (robot.kernel("mass_matrix"), robot.gravity_forces):
        right = way(q)

        def fail(*_):
            raise problem

        with monkeypatch.context() as patch:
            patch.setattr("twistwrench.compiler.runtime.gufunc.compile_form", fail)
            with pytest.raises(type(problem)) as caught:
                way(q.astype("f"))
        assert caught.value is problem
        np.testing.assert_allclose(way(q.astype("f")), right, rtol=1e-5, atol=1e-6)
