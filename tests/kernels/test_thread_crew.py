"""The caller and its helpers: exceptions, interrupts, callers in threads of their own and of pools."""

from __future__ import annotations

import threading
import time
from concurrent.futures import ThreadPoolExecutor
from multiprocessing.pool import ThreadPool

import numpy as np
import pytest
from thread_calls import WAIT, same, states

import twistwrench as tw
from twistwrench.compiler.runtime import batch_threads

pytest_plugins = ("thread_fixtures",)


# ── the crew, with kernels that wait for each other ──


def together(robot: tw.Robot, kernel, count: int) -> batch_threads._Job:
    """A job of so many parts for a stand-in of a kernel, and a crew of two invited to it."""
    whole = np.zeros((count, 1))
    job = batch_threads._Job(kernel, [batch_threads.Part((), (whole[k : k + 1],)) for k in range(count)])
    batch_threads._THREADS.invite(job, 2)
    return job


def test_caller_and_helpers_work_side_by_side_in_the_callers_context(panda, jobs):
    gate, seen = threading.Barrier(3), []

    def kernel(out):
        gate.wait(WAIT)  # passes only if three are here at once
        seen.append((threading.get_ident(), np.geterr()["under"]))

    with np.errstate(under="raise"):
        job = together(panda, kernel, 3)
        job.work()
    assert job.finish() is None
    assert len({who for who, _ in seen}) == 3
    assert {how for _, how in seen} == {"raise"}


class Stand:
    """A stand-in of a kernel in every job: one thing for the caller's thread, another for a helper's."""

    def __init__(self, monkeypatch, caller, helper):
        here = threading.get_ident()

        def kernel(*inputs, out):
            (caller if threading.get_ident() == here else helper)(out)

        class Job(batch_threads._Job):
            def __init__(job, _, its_parts):
                super().__init__(kernel, its_parts)
                self.job = job

        monkeypatch.setattr(batch_threads, "_Job", Job)


def test_an_exception_of_a_helper_is_raised_by_the_caller(panda, jobs, monkeypatch):
    raised = threading.Event()

    def helper(out):
        raised.set()
        raise MemoryError("of a helper")

    Stand(monkeypatch, lambda out: raised.wait(WAIT), helper)
    with pytest.raises(MemoryError, match="of a helper"):
        panda.inverse_dynamics(*states(panda, 9000))


def test_an_interrupted_caller_leaves_nobody_behind(panda, jobs, monkeypatch):
    begun, done = threading.Event(), []

    def caller(out):
        assert begun.wait(WAIT)
        raise KeyboardInterrupt

    def helper(out):
        begun.set()
        limit = time.monotonic() + WAIT
        while stand.job.parts and time.monotonic() < limit:  # until the caller has stopped it
            time.sleep(0.001)
        time.sleep(0.05)
        done.append(out)

    arrays = states(panda, 9000)
    with monkeypatch.context() as patch:
        stand = Stand(patch, caller, helper)
        with pytest.raises(KeyboardInterrupt):
            panda.inverse_dynamics(*arrays)
    finished = len(done)
    assert 1 <= finished <= 2  # a part for each helper that had begun; the others were taken back
    assert same(panda.inverse_dynamics(*arrays), panda.kernel("inverse_dynamics")(*arrays))
    assert len(jobs) == 2
    assert len(done) == finished


def test_a_busy_crew_holds_nobody_up(panda, jobs):
    release = threading.Event()
    job = together(panda, lambda out: release.wait(WAIT), 3)
    try:
        arrays = states(panda, 3000)
        assert same(panda.inverse_dynamics(*arrays), panda.kernel("inverse_dynamics")(*arrays))
        assert len(jobs) == 2
    finally:
        release.set()
        job.finish()


def test_calls_go_on_when_no_thread_can_be_started(panda, jobs, monkeypatch):
    def start(self):
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", start)
    arrays = states(panda, 3000)
    assert same(panda.inverse_dynamics(*arrays), panda.kernel("inverse_dynamics")(*arrays))
    assert len(jobs) == 1


def helpers() -> int:
    return sum(t.name.startswith("twistwrench-") for t in threading.enumerate())


def test_helpers_stay_and_go_home(panda, jobs):
    for _ in range(3):
        panda.inverse_dynamics(*states(panda, 3000))
    assert helpers() >= 2
    mine = [t for t in threading.enumerate() if t.name.startswith("twistwrench-")]
    tw.set_threads(1)
    for thread in mine:
        thread.join(WAIT)
    assert helpers() == 0


# ── callers in threads ──


def in_threads(count: int, function) -> None:
    """Run it in plain threads at once; what goes wrong in one is raised here."""
    problems: list[BaseException] = []

    def run(k):
        try:
            function(k)
        except BaseException as problem:
            problems.append(problem)

    crowd = [threading.Thread(target=run, args=(k,)) for k in range(count)]
    for thread in crowd:
        thread.start()
    for thread in crowd:
        thread.join(WAIT)
        assert not thread.is_alive()
    if problems:
        raise problems[0]


def test_many_threads_of_ones_own_may_call_at_once(panda, jobs):
    arrays = states(panda, 2500)
    expected = panda.kernel("inverse_dynamics")(*arrays)

    def calls(k):
        for _ in range(10):
            assert same(panda.inverse_dynamics(*arrays), expected)

    in_threads(5, calls)
    assert len(jobs) == 50


def test_the_number_may_change_while_calls_run(panda, jobs):
    arrays = states(panda, 2500)
    expected = panda.kernel("inverse_dynamics")(*arrays)

    def calls(k):
        for n in range(15):
            if k < 2:
                tw.set_threads(1 + (n + k) % 4)
            assert same(panda.inverse_dynamics(*arrays), expected)

    in_threads(5, calls)


@pytest.mark.parametrize("pool", [ThreadPoolExecutor, ThreadPool])
def test_a_call_from_a_pools_thread_stays_on_it(panda, jobs, pool):
    arrays = states(panda, 2500)
    with pool(2) as workers:
        found = list(workers.map(lambda _: panda.inverse_dynamics(*arrays), range(4)))
    assert jobs == []
    assert all(same(tau, panda.kernel("inverse_dynamics")(*arrays)) for tau in found)


def test_a_helper_never_shares_its_own_calls(panda, jobs):
    arrays, here, gate = states(panda, 2500), threading.get_ident(), threading.Barrier(2)
    found = []

    def kernel(out):
        gate.wait(WAIT)
        if threading.get_ident() != here:
            found.append(panda.inverse_dynamics(*arrays))

    job = together(panda, kernel, 2)
    job.work()
    assert job.finish() is None
    assert same(found[0], panda.kernel("inverse_dynamics")(*arrays))
    assert jobs == [job]
