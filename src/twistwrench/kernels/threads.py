"""Calls with many samples on a standing crew of threads: off until ``set_threads`` or ``TWISTWRENCH_THREADS`` says more.

A call is cut into parts, which the caller and its helpers take in turn. The caller works too, and never waits for a helper
that has not begun: a busy crew slows nobody down, and nothing can deadlock. A sample's bits depend neither on its part nor on
who computes it.
"""

from __future__ import annotations

import operator
import os
import sys
import threading
from collections import deque
from collections.abc import Iterable
from contextvars import copy_context
from queue import SimpleQueue
from typing import Any

from ..core.arguments import shown
from ..errors import ValueRangeError
from . import interpreter
from .batch_split import NOTABLE, Part, cut, room_for_results

MOST = 1024
VARIABLE = "TWISTWRENCH_THREADS"

POOLS = frozenset({"anyio", "concurrent", "dask", "distributed", "joblib", "multiprocessing", "ray"})
"""Packages whose threads share out work themselves: a call from one of them stays on it."""


def set_threads(count: int) -> None:
    """Let the methods of robots share a call with many samples among threads of this process.

    Parameters
    ----------
    count : int, 1 to 1024; 1 (default) is off

    Raises
    ------
    ValueRangeError
        ``count`` is no whole number from 1 to 1024.

    Notes
    -----
    Results are the same to the bit. One thread is what still computes a call with less than some 0.2 ms of work, one
    from a worker thread of a pool (``concurrent.futures``, ``multiprocessing``, joblib, Dask), and one of a bare
    kernel.

    Examples
    --------
    >>> import twistwrench as tw
    >>> tw.set_threads(2)
    >>> tw.get_threads()
    2
    >>> tw.set_threads(1)
    """
    _CREW.resize(_checked(count, "set_threads"))


def get_threads() -> int:
    """Number of threads a call with many samples may use.

    Returns
    -------
    count : int
        What :func:`set_threads` said, else ``TWISTWRENCH_THREADS``, else 1.

    Raises
    ------
    ValueRangeError
        The variable is not a whole number from 1 to 1024.

    Notes
    -----
    The variable is read when first needed. Worker processes of ``multiprocessing``, joblib or Dask inherit neither, and
    say 1 until they set their own; a subinterpreter always does.

    Examples
    --------
    >>> import twistwrench as tw
    >>> tw.get_threads()
    1
    """
    wanted = _CREW.wanted
    if wanted is None:
        text = os.environ.get(VARIABLE, "").strip() or "1"
        wanted = _CREW.wanted = _checked(int(text) if text.isdecimal() and len(text) < 9 else text, VARIABLE)
    alone = wanted == 1 or not interpreter.is_main() or (not _CREW.told and _in_worker_process())
    return 1 if alone else wanted


def call(kernel: Any, arrays: tuple[Any, ...], out: Any = None) -> Any:
    """``kernel(*arrays, out=out)``, on several threads where that is allowed and pays."""
    threads = get_threads()
    shared = cut(kernel, arrays, out, threads) if threads > 1 and not _in_worker_thread() else None
    if shared is None:
        if out is None and arrays and arrays[0].size >= NOTABLE:
            out = room_for_results(kernel, arrays)
        return kernel(*arrays) if out is None else kernel(*arrays, out=out)
    parts, outputs = shared
    share(kernel, parts)
    return outputs[0] if len(outputs) == 1 else outputs


def share(kernel: Any, parts: Iterable[Part]) -> None:
    """Compute all parts, on several threads where that is allowed; the first exception of any is the caller's."""
    threads = get_threads()
    job = _Job(kernel, parts)
    try:
        if threads > 1 and not _in_worker_thread():
            _CREW.invite(job, threads - 1)
        job.work()
    finally:
        problem = job.finish()
    if problem is not None:
        try:
            raise problem
        finally:
            del problem  # its traceback holds this frame: without this, the arrays would wait for the garbage collector


def _checked(count: Any, who: str) -> int:
    try:
        threads = 0 if isinstance(count, bool) else operator.index(count)
    except TypeError:
        threads = 0
    if not 1 <= threads <= MOST:
        raise ValueRangeError(
            f"{who}: {shown(count)} is not a number of threads. Give a whole number from 1 (off) to {MOST};"
            f" this machine has {os.cpu_count() or 1} processors."
        )
    return threads


def _in_worker_process() -> bool:
    process = sys.modules.get("multiprocessing.process")  # behind joblib's and Dask's as well
    return process is not None and process.parent_process() is not None


def _in_worker_thread() -> bool:
    if getattr(_HERE, "helps", False):
        return True
    if threading.get_ident() == threading.main_thread().ident:
        return False
    frame: Any = sys._getframe()
    while frame is not None:  # a pool's user may name its threads at will; what they run tells
        if str(frame.f_globals.get("__name__")).partition(".")[0] in POOLS:
            return True
        frame = frame.f_back
    return False


class _Job:
    """One call: the parts nobody has taken yet, and the helpers that are at work on others."""

    def __init__(self, kernel: Any, parts: Iterable[Part]) -> None:
        self.kernel = kernel
        self.parts = deque(parts)
        self.context = copy_context()  # np.errstate is kept there
        self.changed = threading.Condition()
        self.helpers = 0
        self.problem: BaseException | None = None

    def work(self) -> None:
        """Compute parts until none is left to take."""
        while True:
            try:
                part = self.parts.popleft()
            except IndexError:
                return
            self.kernel(*part.inputs, out=part.outputs)

    def help(self) -> None:
        """What a helper does; its first exception is kept for the caller, and ends the job."""
        with self.changed:
            self.helpers += 1
        try:
            self.context.copy().run(self.work)
        except BaseException as problem:
            self.parts.clear()
            self.problem = problem
        finally:
            with self.changed:
                self.helpers -= 1
                self.changed.notify_all()

    def finish(self) -> BaseException | None:
        """Leave nothing to take, wait for those who have, as they write to the caller's arrays, and say what they met."""
        self.parts.clear()
        with self.changed:
            while self.helpers:
                self.changed.wait()
            problem, self.problem = self.problem, None
        return problem


class _Crew:
    """How many threads this process may use, and all of them but the callers: started when first needed."""

    def __init__(self) -> None:
        self.wanted: int | None = None
        self._begin()
        if hasattr(os, "register_at_fork"):
            os.register_at_fork(after_in_child=self._begin)

    def _begin(self) -> None:
        """No helper survives a fork, and a lock may have been held."""
        self.told = False
        """Whether this very process said how many it wants."""
        self.lock = threading.RLock()
        self.size = 0
        self.calls: SimpleQueue[_Job | None] = SimpleQueue()

    def resize(self, count: int) -> None:
        """Take note of a new number; the helpers there are go home when they have done what they were asked before."""
        with self.lock:
            self.wanted, self.told = count, True
            self._dismiss()

    def invite(self, job: _Job, helpers: int) -> None:
        """Ask so many helpers to a job; whoever comes too late finds nothing to do."""
        with self.lock:
            if self.size != helpers:
                self._dismiss()
                self._hire(helpers)
            calls = self.calls
        for _ in range(min(helpers, len(job.parts) - 1)):
            calls.put(job)

    def _hire(self, helpers: int) -> None:
        self.size = helpers
        for k in range(helpers):
            thread = threading.Thread(
                target=_attend, args=(self.calls,), name=f"twistwrench-{k + 1}", daemon=True
            )  # a daemon: idle helpers do not keep Python from leaving
            try:
                thread.start()
            except RuntimeError:  # no more threads, or Python is leaving: the callers compute what nobody takes
                return

    def _dismiss(self) -> None:
        for _ in range(self.size):
            self.calls.put(None)
        self.size, self.calls = 0, SimpleQueue()


def _attend(calls: SimpleQueue[_Job | None]) -> None:
    _HERE.helps = True
    while (job := calls.get()) is not None:
        job.help()
        del job  # not to be held until the next one comes


_HERE = threading.local()
_CREW = _Crew()
