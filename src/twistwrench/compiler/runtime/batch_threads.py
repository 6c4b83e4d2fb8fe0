"""Calls with many samples: memory for the results, and distribution to several threads if that pays."""

from __future__ import annotations

import math
import operator
import os
import sys
import threading
from collections import deque
from collections.abc import Iterable
from contextvars import copy_context
from functools import cache
from queue import SimpleQueue
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...core.arguments import value_text
from ...core.errors import ValueRangeError
from ...core.typing import Array
from ..lowering.target_machine import SINGLE
from . import interpreter
from .result_pool import result_arrays

if TYPE_CHECKING:
    from ..ir.loops import Form
    from ..ir.program import Program, TensorSpec

Arrays = tuple[Array, ...]

MIN_PART = 2.5e6
"""Operations of the smallest part: about 0.1 ms, four times the handover. Less work than two such parts is not divided."""

PARTS_EACH = 4
"""Parts per thread: if one thread is delayed, the others take the remaining parts."""

ROWS = 64
"""Number of rows at multiples of which long axes are divided, so that all parts but the last fill the lanes of any machine."""

# Costs in operations of a lane.
SINE = 18  # a sine or cosine
ENTRY = 6  # reading or writing an entry

# Sizes of results [bytes] from which they are allocated here; smaller ones cause no page faults with NumPy's own allocation.
ONE_ROOM = 1 << 24  # a single result
SEVERAL_ROOMS = 1 << 19  # several results together

MIN_ELEMENTS_FOR_ROOMS = 2048
"""Number of elements in the first input from which sizes of results are checked; 4 times as many for a single result."""

FLOAT32 = np.dtype(np.float32)
FLOAT64 = np.dtype(np.float64)

# Codes of the types that NumPy casts to doubles, and to singles.
TO_DOUBLE = frozenset(c for c in "?" + np.typecodes["AllInteger"] + np.typecodes["Float"] if np.can_cast(c, "d"))
TO_SINGLE = frozenset(c for c in TO_DOUBLE if np.can_cast(c, "f"))


class Part(NamedTuple):
    """Arguments of a kernel for some samples: views of the whole arrays."""

    inputs: Arrays
    outputs: Arrays


def cost_model(form: Form) -> int:
    """Operations of a sample, or of one step of a rollout.

    With lanes of four doubles, programs of arms and quadrupeds take 12 to 30 operations per nanosecond.
    """
    from ..ir.loops import ColumnSolve, program_of

    program = program_of(form)
    operations = _operations(program)
    for port in (*program.inputs, *program.outputs):
        operations += ENTRY * port.size
    if isinstance(form, ColumnSolve):
        for group in form.groups:
            operations += len(group.places) * _operations(group.program)
    return operations


def _operations(program: Program) -> int:
    """Operations of a program, without reading and writing entries."""
    counts = program.counts()
    sines = counts.get("sin", 0) + counts.get("cos", 0)
    return sum(counts.values()) + (SINE - 1) * sines


def cut(kernel: Any, given: tuple[Any, ...], out: Any, threads: int) -> tuple[list[Part], Arrays] | None:
    """Parts of a call and its whole outputs; None if the call is not divided.

    A call with little work, or for one thread, is not divided. Neither is a call with an argument that is not a plain array,
    which NumPy rejects, converts or copies by its own rules.
    """
    owner = _owner_of()(kernel)
    if owner is None or len(given) != len(owner.given.inputs):
        return None
    arrays = tuple([np.asarray(a) if type(a) in (list, tuple) else a for a in given])
    batch = _batch(arrays, owner.given.inputs)
    if batch is None:
        return None
    is_single = _is_single(arrays)
    work = math.prod(batch) * owner.cost
    if is_single:
        work /= 2  # twice as many lanes
    part_count = min(int(work / MIN_PART), PARTS_EACH * threads)
    if part_count < 2:
        return None
    if part_count > threads:
        part_count = part_count // threads * threads  # equally many for each thread
    shapes = [batch + port.shape for port in owner.given.outputs]
    dtype = FLOAT32 if is_single else FLOAT64
    outputs = _outputs(out, shapes, dtype, arrays)
    if outputs is None:
        return None
    if is_single:
        owner.address(SINGLE)  # compiled before the threads start, and here, where exceptions propagate
    axis = _divided_axis(batch, part_count)
    rows_per_part = -(-batch[axis] // part_count)  # rounded up
    if rows_per_part >= ROWS:
        rows_per_part = -(-rows_per_part // ROWS) * ROWS  # rounded up to a multiple
    ports = (*owner.given.inputs, *owner.given.outputs)
    indices = [
        _index_before_axis(a, port, axis - len(batch)) for a, port in zip((*arrays, *outputs), ports, strict=True)
    ]
    parts = []
    for first in range(0, batch[axis], rows_per_part):
        samples = slice(first, first + rows_per_part)
        views = []
        for a, before in zip((*arrays, *outputs), indices, strict=True):
            views.append(a if before is None else a[(*before, samples)])  # a broadcast array belongs to each part whole
        parts.append(Part(tuple(views[: len(arrays)]), tuple(views[len(arrays) :])))
    return parts, outputs


def _divided_axis(batch: tuple[int, ...], count: int) -> int:
    """Batch axis to divide into ``count`` parts: the first long one, so that inner axes stay whole, or else the longest."""
    for axis, n in enumerate(batch):
        if n >= PARTS_EACH * count:
            return axis
    return batch.index(max(batch))


@cache
def _owner_of() -> Any:
    """Function that finds the owner of a ufunc. It is imported here, as its module imports this one."""
    from .gufunc import owner_of

    return owner_of


def room_for_results(kernel: Any, arrays: tuple[Any, ...]) -> Arrays | None:
    """New arrays for the results of a call that is not divided; None if NumPy's own allocation is as fast."""
    first = arrays[0]
    if kernel.nout == 1 and first.size < 4 * MIN_ELEMENTS_FOR_ROOMS:
        return None
    owner = _owner_of()(kernel)
    if owner is None or type(first) is not np.ndarray or len(arrays) != len(owner.given.inputs):
        return None
    ports = owner.given.outputs
    min_size = ONE_ROOM if len(ports) == 1 else SEVERAL_ROOMS
    # An estimate: other inputs may have more samples.
    if owner.result_size * first.size < min_size * owner.given.inputs[0].size:
        return None
    batch = _batch(arrays, owner.given.inputs)
    if batch is None:
        return None
    dtype = FLOAT32 if _is_single(arrays) else FLOAT64
    return result_arrays([batch + port.shape for port in ports], dtype)


def _is_single(arrays: Arrays) -> bool:
    """True if NumPy would select the loop for float32."""
    return all(a.dtype.char in TO_SINGLE for a in arrays)


def _batch(arrays: Arrays, ports: tuple[TensorSpec, ...]) -> tuple[int, ...] | None:
    """Batch shape of plain arrays of real numbers with the kernel's shapes; None if any array is different."""
    batches = []
    for a, port in zip(arrays, ports, strict=True):
        if type(a) is not np.ndarray or a.dtype.char not in TO_DOUBLE:
            return None
        rank = a.ndim - len(port.shape)
        if rank < 0 or a.shape[rank:] != port.shape:
            return None
        batches.append(a.shape[:rank])
    if len(set(batches)) == 1:
        return batches[0]
    try:
        return np.broadcast_shapes(*batches)
    except ValueError:
        return None


def _outputs(out: Any, shapes: list[tuple[int, ...]], dtype: np.dtype[Any], arrays: Arrays) -> Arrays | None:
    """New arrays, or the given ones if they are contiguous and do not overlap other arrays."""
    if out is None:
        return result_arrays(shapes, dtype)
    outputs = out if isinstance(out, tuple) else (out,)
    if len(outputs) != len(shapes):
        return None
    for k, (a, shape) in enumerate(zip(outputs, shapes, strict=True)):
        if type(a) is not np.ndarray or a.dtype != dtype or a.shape != shape:
            return None
        if not (a.flags.c_contiguous and a.flags.behaved):
            return None
        if any(np.may_share_memory(a, other) for other in (*arrays, *outputs[:k])):
            return None
    return outputs


def _index_before_axis(a: Array, port: TensorSpec, axis: int) -> tuple[slice, ...] | None:
    """Index of all axes before the divided one; None if the array is broadcast along it.

    ``axis`` is negative: -1 is the last batch axis.
    """
    position = a.ndim - len(port.shape) + axis
    if position < 0 or a.shape[position] == 1:
        return None
    return (slice(None),) * position


# ── Calls with many samples on a thread pool: disabled until ``set_threads`` or ``TWISTWRENCH_THREADS`` sets more than one

# A call is divided into parts. The calling thread and its helpers take one part after another. The calling thread never waits
# for a helper that has not begun, so busy threads do not delay it, and deadlocks are impossible. The bits of a result depend
# neither on the part nor on the thread.

MAX_THREADS = 1024
VARIABLE = "TWISTWRENCH_THREADS"
"""Environment variable with the number of threads."""

POOLS = frozenset({"anyio", "concurrent", "dask", "distributed", "joblib", "multiprocessing", "ray"})
"""Packages with thread pools. Calls from their threads are not divided, as the work is distributed already."""


def set_threads(count: int) -> None:
    """Distribute calls with many samples of a robot's methods to threads of this process.

    Parameters
    ----------
    count : int, 1 to 1024; 1 (default) disables it

    Notes
    -----
    Results are bit-identical. One thread still computes calls with less than about 0.2 ms of work, calls from a worker
    thread of a pool (``concurrent.futures``, ``multiprocessing``, joblib, Dask), and direct calls of a kernel.

    Examples
    --------
    >>> import twistwrench as tw
    >>> tw.set_threads(2)
    >>> tw.get_threads()
    2
    >>> tw.set_threads(1)
    """
    _THREADS.resize(_thread_count(count, "set_threads"))


def get_threads() -> int:
    """Number of threads that a call with many samples may use.

    Returns
    -------
    count : int
        Argument of the last :func:`set_threads`, else ``TWISTWRENCH_THREADS``, else 1.

    Notes
    -----
    The variable is read on first use. Worker processes of ``multiprocessing``, joblib or Dask do not inherit either setting
    and use 1 until they set their own; a subinterpreter always uses 1.

    Examples
    --------
    >>> import twistwrench as tw
    >>> tw.get_threads()
    1
    """
    count = _THREADS.wanted
    if count is None:
        count = _THREADS.wanted = _count_from_environment()
    if count == 1 or not interpreter.is_main():
        return 1
    if not _THREADS.set_here and _is_worker_process():
        return 1
    return count


def _count_from_environment() -> int:
    """Number of threads by the environment variable, by default 1; raises ValueRangeError for other texts."""
    text = os.environ.get(VARIABLE, "").strip() or "1"
    is_number = text.isdecimal() and len(text) < 9  # a longer number is too large, and may be slow to convert
    return _thread_count(int(text) if is_number else text, VARIABLE)


def call(kernel: Any, arrays: tuple[Any, ...], out: Any = None) -> Any:
    """Result of ``kernel(*arrays, out=out)``, on several threads if allowed and worthwhile."""
    threads = get_threads()
    if threads > 1 and not _is_worker_thread():
        divided = cut(kernel, arrays, out, threads)
        if divided is not None:
            parts, outputs = divided
            share(kernel, parts)
            return outputs[0] if len(outputs) == 1 else outputs
    if out is None and arrays and arrays[0].size >= MIN_ELEMENTS_FOR_ROOMS:
        out = room_for_results(kernel, arrays)
    if out is None:
        return kernel(*arrays)
    return kernel(*arrays, out=out)


def share(kernel: Any, parts: Iterable[Part]) -> None:
    """Compute all parts, on several threads if allowed; the first exception of any thread is raised here."""
    threads = get_threads()
    job = _Job(kernel, parts)
    try:
        if threads > 1 and not _is_worker_thread():
            _THREADS.invite(job, threads - 1)
        job.work()
    finally:
        problem = job.finish()
    if problem is not None:
        try:
            raise problem
        finally:
            # The traceback refers to this frame, which would keep the arrays until the next garbage collection.
            del problem


def _thread_count(count: Any, who: str) -> int:
    """Validated number of threads; ``who`` is the function or variable that messages name."""
    try:
        threads = operator.index(count)
    except TypeError:
        threads = 0
    if isinstance(count, bool) or not 1 <= threads <= MAX_THREADS:
        raise ValueRangeError(
            f"{who}: {value_text(count)} is not a number of threads. Give a whole number from 1 (off) to {MAX_THREADS};"
            f" this machine has {os.cpu_count() or 1} processors."
        )
    return threads


def _is_worker_process() -> bool:
    """True in a worker process of ``multiprocessing``, joblib or Dask."""
    process = sys.modules.get("multiprocessing.process")  # also loaded by joblib and Dask
    return process is not None and process.parent_process() is not None


def _is_worker_thread() -> bool:
    """True in a helper, and in a thread that a pool's package started."""
    if getattr(_THIS_THREAD, "is_helper", False):
        return True
    if threading.get_ident() == threading.main_thread().ident:
        return False
    frame: Any = sys._getframe()
    while frame is not None:  # thread names are arbitrary, so the running code is checked
        if str(frame.f_globals.get("__name__")).partition(".")[0] in POOLS:
            return True
        frame = frame.f_back
    return False


class _Job:
    """One call: its remaining parts, the number of active helpers, and the first exception of a helper."""

    def __init__(self, kernel: Any, parts: Iterable[Part]) -> None:
        self.kernel = kernel
        self.parts = deque(parts)
        self.context = copy_context()  # includes np.errstate
        self.changed = threading.Condition()  # notified when a helper ends
        self.helpers = 0
        self.problem: BaseException | None = None

    def work(self) -> None:
        """Compute parts until none remain."""
        while True:
            try:
                part = self.parts.popleft()
            except IndexError:
                return
            self.kernel(*part.inputs, out=part.outputs)

    def help(self) -> None:
        """Compute parts in a helper; its first exception is stored for the caller, and ends the job."""
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
        """Discard remaining parts and wait for helpers, which write to the caller's arrays; returns their first exception."""
        self.parts.clear()
        with self.changed:
            while self.helpers:
                self.changed.wait()
            problem = self.problem
            self.problem = None
        return problem


class _ThreadPool:
    """Number of threads of this process, and its helper threads, which start on first use."""

    def __init__(self) -> None:
        self.wanted: int | None = None
        """Number of threads that is set; None before it is read from the environment."""
        self._begin()
        if hasattr(os, "register_at_fork"):
            os.register_at_fork(after_in_child=self._begin)

    def _begin(self) -> None:
        """Reset to no helpers and a new lock: after a fork, helpers do not exist, and the old lock may be held for ever."""
        self.set_here = False
        """True if this process has set its number of threads."""
        self.lock = threading.RLock()
        self.size = 0
        """Number of helpers."""
        self.calls: SimpleQueue[_Job | None] = SimpleQueue()
        """Jobs for helpers; None ends a helper."""

    def resize(self, count: int) -> None:
        """Set the number of threads; existing helpers end after their jobs."""
        with self.lock:
            self.wanted = count
            self.set_here = True
            self._dismiss()

    def invite(self, job: _Job, helpers: int) -> None:
        """Offer a job to helpers. A helper that comes too late finds no parts, and does nothing."""
        with self.lock:
            if self.size != helpers:
                self._dismiss()
                self._hire(helpers)
            calls = self.calls
        for _ in range(min(helpers, len(job.parts) - 1)):
            calls.put(job)

    def _hire(self, helpers: int) -> None:
        """Start helpers."""
        self.size = helpers
        for k in range(helpers):
            # A daemon, so that idle helpers do not prevent Python from exiting.
            thread = threading.Thread(target=_serve_jobs, args=(self.calls,), name=f"twistwrench-{k + 1}", daemon=True)
            try:
                thread.start()
            except RuntimeError:  # no more threads, or Python is shutting down: the caller computes the remaining parts
                return

    def _dismiss(self) -> None:
        """End all helpers after their jobs; new helpers get another queue."""
        for _ in range(self.size):
            self.calls.put(None)  # ends a helper
        self.size = 0
        self.calls = SimpleQueue()


def _serve_jobs(calls: SimpleQueue[_Job | None]) -> None:
    """Take part in one job after another, until a None: target of helper threads."""
    _THIS_THREAD.is_helper = True
    while (job := calls.get()) is not None:
        job.help()
        del job  # releases the job before waiting for the next


_THIS_THREAD = threading.local()
_THREADS = _ThreadPool()
