"""The search for exciting motions runs on one processor: its matrices are small, and further threads of BLAS would only wait."""

from __future__ import annotations

import threading
import time

import pytest

import twistwrench as tw
from twistwrench.core.blas_threads import _libraries, blas_threads, one_blas_thread
from twistwrench.identification.excitation.trajectory_search import MotionSearch


def times_of_a_search():
    """Wall time and processor time of all threads [s]."""
    wall, processor = time.perf_counter(), time.process_time()
    tw.identification.exciting_trajectory(
        tw.robots.planar_3r(), 3.0, 2, acceleration=5.0, velocity=2.0, effort=60.0, restarts=1, clear_of_itself=False
    )
    return time.perf_counter() - wall, time.process_time() - processor


def test_a_search_takes_the_processor_time_of_one_thread():
    """Processor time does not depend on other programs; with two threads of BLAS it was three to five times as long."""
    with one_blas_thread():
        times_of_a_search()  # imports and kernels
        _, alone = times_of_a_search()
    wall, processor = times_of_a_search()
    assert processor <= 1.5 * alone
    assert processor <= 1.1 * wall


@pytest.fixture
def two_threads():
    """OpenBLAS on two threads: tests run on one, and what is restored would be what is set."""
    libraries = _libraries()
    if not libraries:
        pytest.skip("another BLAS")
    before = [library.threads() for library in libraries]
    for library in libraries:
        library.set_threads(2)
    yield libraries
    for library, count in zip(libraries, before, strict=True):
        library.set_threads(count)


def test_threads_of_blas_are_one_within_and_restored_after_the_last_of_several_calls(two_threads):
    ready, leave = threading.Event(), threading.Event()

    def other():
        with one_blas_thread():
            ready.set()
            leave.wait(10)

    thread = threading.Thread(target=other)
    with one_blas_thread():
        thread.start()
        ready.wait(10)
    assert blas_threads() == [1] * len(two_threads)
    leave.set()
    thread.join()
    assert blas_threads() == [2] * len(two_threads)


def test_a_search_runs_on_one_thread_whatever_was_set(monkeypatch, two_threads):
    """Also where the environment allows more; afterwards the number is the one before. No motion is looked for here."""
    seen = list[list[int]]()
    monkeypatch.setattr(MotionSearch, "best", lambda *_: seen.append(blas_threads()))
    with pytest.raises(tw.ValueRangeError, match="no motion"):
        times_of_a_search()
    assert seen == [[1] * len(two_threads)] and blas_threads() == [2] * len(two_threads)
