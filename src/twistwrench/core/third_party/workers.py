"""Independent jobs in this process, in local processes, or on a Dask cluster, with results in order."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeVar

from ..errors import MissingExtraError, TwistWrenchError, ValueRangeError
from ..text import argument

Item = TypeVar("Item")
Result = TypeVar("Result")

# Dask does scheduling, retries, data transfer and the dashboard. In local workers, the threads of this library and of BLAS are
# disabled.

RETRIES = 3
"""Number of times that a job is tried again after an error, and number of dead workers after which Dask gives a job up."""
_CONNECTION_TIMEOUT = 10.0
"""Time in which a scheduler must respond [s]."""
_JOBS_PER_THREAD = 3
"""Number of submitted jobs for each thread of the workers, so that no worker waits for its next job."""
_MAX_WORKERS = 4096
"""Largest number of local processes."""
_ONE_THREAD_EACH = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "TWISTWRENCH_THREADS": "1",
}
"""Environment of local worker processes, each of which has one thread."""


@dataclass(frozen=True)
class Failure:
    """Failure of a job, in place of its result."""

    reason: str
    """Message of an error of this library, or class and message of another error."""
    problem: TwistWrenchError | None = field(default=None, compare=False)
    """Error of this library; None for other errors."""


@dataclass
class Workers:
    """Workers for jobs: this process, or the workers of a Dask client."""

    client: Any = None
    """Dask client; None for this process."""
    ahead: int = 1
    """Largest number of submitted jobs whose results are not yet returned."""

    @classmethod
    def from_client(cls, client: Any) -> Workers:
        """Workers of a Dask client; this process if it is None."""
        if client is None:
            return cls()
        thread_count = sum(client.nthreads().values())
        return cls(client, ahead=_JOBS_PER_THREAD * max(1, thread_count))

    def results(
        self, function: Callable[[Item], Result], items: Sequence[Item], progress: Callable[[float], None] | None = None
    ) -> Iterator[Result | Failure]:
        """``function`` of each item, in the order of the items; an error in one item becomes a :class:`Failure`.

        ``progress`` is called with the finished fraction after each item.
        """
        report_progress = progress or (lambda _fraction: None)
        job = partial(_result_or_failure, function)  # picklable for other processes
        if self.client is None:
            for done_count, item in enumerate(items, start=1):
                yield job(item)
                report_progress(done_count / len(items))
            return
        from concurrent.futures import CancelledError

        from distributed.comm.core import CommClosedError
        from distributed.scheduler import KilledWorker

        futures: list[Any] = []  # of submitted jobs, in the order of the items
        submitted_count = 0
        for k in range(len(items)):
            submitted_end = min(len(items), k + self.ahead)
            while submitted_count < submitted_end:
                # pure=False: Dask would otherwise return the same result for equal items
                futures.append(self.client.submit(job, items[submitted_count], pure=False, retries=RETRIES))
                submitted_count += 1
            future = futures.pop(0)
            try:
                yield future.result()
            except (KilledWorker, CommClosedError, CancelledError, MemoryError, OSError) as problem:
                message_lines = str(problem).splitlines() or ["no details were reported"]
                yield Failure(f"{type(problem).__name__}: {message_lines[0]}")
            future.release()
            report_progress((k + 1) / len(items))


@contextmanager
def workers_of(workers: int | None = None, scheduler: str | None = None) -> Iterator[Workers]:
    """Workers of one kind: this process by default, a number of local processes, or a cluster by its address.

    Raises MissingExtraError without Dask, and ValueRangeError if both are given or the address does not respond.
    """
    if workers is None and scheduler is None:
        yield Workers()
        return
    if workers is not None and scheduler is not None:
        raise ValueRangeError(f"both {argument('workers')} and {argument('scheduler')} are given. Choose one.")
    if workers is not None and not 1 <= workers <= _MAX_WORKERS:
        raise ValueRangeError(
            f"{workers!r} is not a valid number of workers. Give 1 or more; this machine has {os.cpu_count()} cores."
        )
    try:
        from dask import config
        from distributed import Client, LocalCluster
    except ImportError:
        raise MissingExtraError.from_extra("dask", "dask", "Working on several processes or machines") from None
    settings = {
        "distributed.scheduler.allowed-failures": RETRIES,
        "distributed.nanny.pre-spawn-environ": _ONE_THREAD_EACH,
    }
    with config.set(settings):
        if workers is not None:
            options: dict[str, Any] = {
                "threads_per_worker": 1,
                "dashboard_address": None,  # no dashboard
                "silence_logs": logging.CRITICAL,
            }
            with LocalCluster(n_workers=workers, **options) as cluster, Client(cluster) as client:
                yield Workers.from_client(client)
            return
        try:
            client = Client(scheduler, timeout=_CONNECTION_TIMEOUT)
        except (OSError, TimeoutError, ValueError, TypeError) as problem:
            first_line = str(problem).splitlines()[0]
            raise ValueRangeError(
                f"no Dask scheduler answers at {scheduler!r}: {first_line}. Start one with `dask scheduler` "
                "and workers with `dask worker ADDRESS`, and give the address that it prints, such as tcp://10.0.0.1:8786."
            ) from None
        with client:
            if not client.nthreads():
                raise ValueRangeError(
                    f"the Dask scheduler at {scheduler!r} has no workers. Start some with `dask worker {scheduler}`."
                )
            yield Workers.from_client(client)


def _result_or_failure(function: Callable[[Item], Result], item: Item) -> Result | Failure:
    """Result of a job. An error of this library becomes a failure: it is due to the input, so the job is not tried again."""
    try:
        return function(item)
    except TwistWrenchError as problem:
        return Failure(str(problem), problem)
