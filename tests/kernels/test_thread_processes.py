"""How many threads a process may use, what forks and workers inherit, how Python leaves; and the benchmark's section."""

from __future__ import annotations

import importlib
import os
import re
import subprocess
import sys

import numpy as np
import pytest
from places import ROOT
from quick import mostly_slow
from thread_calls import WAIT

import twistwrench as tw
from twistwrench.compiler.runtime import batch_threads

pytest_plugins = ("thread_fixtures",)


# ── how many ──


@pytest.mark.parametrize("count", [0, -1, 2.5, 2.0, "2", None, True, 1025, 10**30, [2]])
def test_a_number_that_cannot_be_meant(jobs, count):
    with pytest.raises(
        tw.ValueRangeError, match=re.escape(f"set_threads: {count!r} is not a number of threads")
    ) as error:
        tw.set_threads(count)
    assert "from 1 (off) to 1024" in str(error.value)
    assert tw.get_threads() == 3


def test_numpys_whole_numbers_will_do(jobs):
    tw.set_threads(np.int64(2))
    assert tw.get_threads() == 2
    assert type(tw.get_threads()) is int


def python(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    kept = {k: v for k, v in os.environ.items() if k != batch_threads.VARIABLE}
    return subprocess.run(
        [sys.executable, "-W", "ignore::DeprecationWarning", "-c", code],
        env={**kept, **environment}, capture_output=True, text=True, timeout=2 * WAIT,
    )  # fmt: skip


@pytest.mark.parametrize(("text", "count"), [("2", 2), (" 3 ", 3), ("", 1), ("1", 1)])
def test_the_environment_says_how_many(text, count):
    done = python("import twistwrench as tw; print(tw.get_threads())", TWISTWRENCH_THREADS=text)
    assert done.stdout == f"{count}\n", done.stderr


@pytest.mark.parametrize("text", mostly_slow(["two", "0", "-1", "2.5", "1e3", "²", "9999"], 3))
def test_an_environment_that_cannot_be_meant_is_an_error_at_the_first_call(text):
    code = """
import twistwrench as tw
robot = tw.robots.pendulum()
for _ in range(2):
    try:
        robot.gravity_forces([0.1])
    except tw.ValueRangeError as error:
        print(error)
tw.set_threads(1)
print(robot.gravity_forces([0.0]).shape)
"""
    done = python(code, TWISTWRENCH_THREADS=text, PYTHONIOENCODING="utf-8")
    lines = done.stdout.splitlines()
    assert len(lines) == 3, done.stderr
    shown = text if text.isdecimal() else repr(text)
    assert lines[0] == lines[1]
    assert lines[0].startswith(f"TWISTWRENCH_THREADS: {shown} is not a number of threads. Give a whole number")
    assert lines[2] == "(1,)"


# ── processes ──

SETUP = """
import os, signal, sys, threading, time
import numpy as np
import twistwrench as tw
from twistwrench.compiler.runtime import batch_threads

batch_threads.MIN_PART = 2e4
robot = tw.robots.planar_3r()
q = robot.random_configuration(1, 50_000)
expected = robot.kernel("mass_matrix")(q).tobytes()
shared = []
invite = batch_threads._THREADS.invite
batch_threads._THREADS.invite = lambda job, helpers: (shared.append(1), invite(job, helpers))

def right():
    return robot.mass_matrix(q).tobytes() == expected
"""

FORKED = """
tw.set_threads(3)
assert right() and shared
held = threading.Event()
def hold():
    with batch_threads._THREADS.lock:
        held.set()
        time.sleep(1)
threading.Thread(target=hold).start()  # a fork while a lock is held by a thread that the child has not
held.wait()
child = os.fork()
if child == 0:
    shared.clear()
    helpers = sum(t.name.startswith("twistwrench-") for t in threading.enumerate())
    fine = helpers == 0 and right() and right() and len(shared) == 2 and tw.get_threads() == 3
    os._exit(0 if fine else 7)
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), right())
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
def test_a_forked_process_has_a_crew_of_its_own():
    done = python(SETUP + FORKED)
    assert done.stdout == "0 True\n", done.stderr


WORKERS = """
import multiprocessing, sys
import numpy as np
import twistwrench as tw
from twistwrench.compiler.runtime import batch_threads

def inherited(_):
    before = tw.get_threads()
    tw.set_threads(2)
    after = tw.get_threads()
    return before, after

if __name__ == "__main__":
    if sys.argv[2] == "set":
        tw.set_threads(3)
    assert tw.get_threads() == 3
    with multiprocessing.get_context(sys.argv[1]).Pool(1) as pool:
        print(pool.apply_async(inherited, (0,)).get(timeout=60), tw.get_threads())
"""


@pytest.mark.parametrize("method", ["fork", "spawn", "forkserver"])
@pytest.mark.parametrize("how", ["set", "environment"])
def test_worker_processes_inherit_nothing_but_may_set_their_own(tmp_path, method, how):
    if method not in __import__("multiprocessing").get_all_start_methods():
        pytest.skip(f"no {method} on this system")
    script = tmp_path / "workers.py"
    script.write_text(WORKERS)
    done = subprocess.run(
        [sys.executable, "-W", "ignore::DeprecationWarning", script, method, how],
        env={**os.environ, "TWISTWRENCH_THREADS": "3"}, capture_output=True, text=True, timeout=2 * WAIT,
    )  # fmt: skip
    assert done.stdout == "(1, 2) 3\n", done.stderr


def test_python_leaves_with_helpers_at_rest_and_calls_at_its_exit():
    code = """
import atexit
tw.set_threads(4)
assert right() and shared
atexit.register(lambda: print("at exit", right()))
"""
    done = python(SETUP + code)
    assert (done.returncode, done.stdout) == (0, "at exit True\n"), done.stderr


def test_python_leaves_while_a_daemon_of_ones_own_calls():
    code = """
tw.set_threads(3)
def forever():
    while True:
        right()
threading.Thread(target=forever, daemon=True).start()
while len(shared) < 20:
    time.sleep(0.001)
print("leaving")
"""
    done = python(SETUP + code)
    assert (done.returncode, done.stdout) == (0, "leaving\n"), done.stderr


@pytest.mark.skipif(not hasattr(os, "fork"), reason="signals as POSIX has them")
def test_an_interrupt_from_outside_ends_the_call():
    code = """
tw.set_threads(3)
signal.signal(signal.SIGINT, signal.default_int_handler)
def interrupt():
    while len(shared) < 20:
        time.sleep(0.001)
    os.kill(os.getpid(), signal.SIGINT)
threading.Thread(target=interrupt).start()
try:
    while True:
        right()
except KeyboardInterrupt:
    print("interrupted", right(), right())
"""
    done = python(SETUP + code)
    assert done.stdout == "interrupted True True\n", done.stderr


# ── the benchmark's section ──


@pytest.mark.slow
def test_the_benchmark_times_it_and_the_report_shows_it(jobs, monkeypatch, capsys):
    pytest.importorskip("pinocchio", reason="the benchmark needs its peers")
    monkeypatch.syspath_prepend(str(ROOT))
    found = importlib.import_module("bench.threads").times(1, sizes=(3000,))
    capsys.readouterr()
    assert tw.get_threads() == 3
    assert jobs
    assert set(found["states"]["3000"]) == {"1", "2"}
    text = importlib.import_module("bench.report")._threads({"threads": found})
    assert "## Large batches on several threads" in text
    assert "| 3,000 states |" in text


# ── workers of other packages, where they are installed ──

POOLS = """
import sys
import numpy as np
import twistwrench as tw
from twistwrench.compiler.runtime import batch_threads

robot = tw.robots.planar_3r()
q = robot.random_configuration(1, 5000)

def work(_):
    batch_threads.MIN_PART = 2e3  # so that every call is worth sharing, in whichever process this is
    made = []
    job = batch_threads._Job
    class Watched(job):
        def __init__(self, *given):
            made.append(1)
            super().__init__(*given)
    batch_threads._Job = Watched
    try:
        fine = np.array_equal(robot.mass_matrix(q), robot.kernel("mass_matrix")(q))
    finally:
        batch_threads._Job = job
    return len(made) if fine else None

def joblib(backend):
    from joblib import Parallel, delayed
    return Parallel(n_jobs=2, backend=backend)(delayed(work)(k) for k in range(4))

def dask(scheduler):
    import dask
    return list(dask.compute(*(dask.delayed(work)(k) for k in range(4)), scheduler=scheduler))

def distributed(processes):
    from distributed import Client
    with Client(processes=processes == "processes", n_workers=2, threads_per_worker=1, dashboard_address=None) as client:
        return client.gather([client.submit(work, k) for k in range(4)])

if __name__ == "__main__":
    tw.set_threads(3)
    assert work(0) == 1  # here a call is shared
    print(globals()[sys.argv[1]](sys.argv[2]))
    assert work(0) == 1  # and still is
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("package", "kind"),
    [
        ("joblib", "loky"),
        ("joblib", "threading"),
        ("joblib", "multiprocessing"),
        ("dask", "threads"),
        ("dask", "processes"),
        ("distributed", "threads"),
        ("distributed", "processes"),
    ],
)
def test_calls_in_workers_of_other_packages_stay_on_their_thread(tmp_path, package, kind):
    pytest.importorskip(package)
    script = tmp_path / "pools.py"
    script.write_text(POOLS)
    done = subprocess.run(
        [sys.executable, "-W", "ignore", script, package, kind],
        env={**os.environ, "TWISTWRENCH_THREADS": "3"}, capture_output=True, text=True, timeout=2 * WAIT,
    )  # fmt: skip
    assert done.stdout == "[0, 0, 0, 0]\n", done.stderr
