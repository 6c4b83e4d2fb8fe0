"""Independent jobs in this process, in local processes, or on a Dask cluster, with results in order."""

from __future__ import annotations

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

# Dask does scheduling, retries, data transfer and the dashboard. This library's own threads are disabled in its workers.

RETRIES = 3
"""Retries of a job whose worker died; Dask counts worker deaths with the same number."""
_PATIENCE = 10.0
"""Timeout for a scheduler [s]."""
_ALONE = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "TWISTWRENCH_THREADS": "1"}
"""Environment of local worker processes: one per core, with one thread each."""


@dataclass(frozen=True)
class Failure:
    """Reason for the failure of a job: a message of this library, or kind and text of another error."""

    reason: str
    problem: TwistWrenchError | None = field(default=None, compare=False)
    """Error of this library, with its arguments."""


@dataclass
class Workers:
    """Workers: this process, or the workers of a Dask client."""

    client: Any = None
    ahead: int = 1
    """Number of jobs submitted ahead, which limits the results that wait for their turn."""

    @classmethod
    def from_client(cls, client: Any) -> Workers:
        """Workers of a Dask client; this process if it is None."""
        if client is None:
            return cls()
        return cls(client, 3 * max(1, sum(client.nthreads().values())))

    def results(
        self, function: Callable[[Item], Result], items: Sequence[Item], progress: Callable[[float], None] | None = None
    ) -> Iterator[Result | Failure]:
        """``function`` of each item, in the order of the items; an error in one item does not stop the others."""
        tell = progress or (lambda _share: None)
        work = partial(_result_or_failure, function)  # picklable for other processes
        if self.client is None:
            for k, item in enumerate(items, start=1):
                yield work(item)
                tell(k / len(items))
            return
        from concurrent.futures import CancelledError

        from distributed.comm.core import CommClosedError
        from distributed.scheduler import KilledWorker

        waiting: list[Any] = []
        given = 0
        for k in range(len(items)):
            while given < len(items) and given < k + self.ahead:
                waiting.append(self.client.submit(work, items[given], pure=False, retries=RETRIES))
                given += 1
            future = waiting.pop(0)
            try:
                yield future.result()
            except (KilledWorker, CommClosedError, CancelledError, MemoryError, OSError) as problem:
                first = (str(problem).splitlines() or ["no details were reported"])[0]
                yield Failure(f"{type(problem).__name__}: {first}")
            future.release()
            tell((k + 1) / len(items))


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
    if workers is not None and not 1 <= workers <= 4096:
        raise ValueRangeError(
            f"{workers!r} is not a valid number of workers. Give 1 or more; this machine has {os.cpu_count()} cores."
        )
    try:
        from dask import config
        from distributed import Client, LocalCluster
    except ImportError:
        raise MissingExtraError.from_extra("dask", "dask", "Working on several processes or machines") from None
    settings = {"distributed.scheduler.allowed-failures": RETRIES, "distributed.nanny.pre-spawn-environ": _ALONE}
    with config.set(settings):
        if workers is not None:
            local: dict[str, Any] = {"threads_per_worker": 1, "dashboard_address": None, "silence_logs": 50}
            with LocalCluster(n_workers=workers, **local) as cluster, Client(cluster) as client:
                yield Workers.from_client(client)
            return
        try:
            client = Client(scheduler, timeout=_PATIENCE)
        except (OSError, TimeoutError, ValueError, TypeError) as problem:
            raise ValueRangeError(
                f"no Dask scheduler answers at {scheduler!r}: {str(problem).splitlines()[0]}. Start one with `dask scheduler` "
                "and workers with `dask worker ADDRESS`, and give the address that it prints, such as tcp://10.0.0.1:8786."
            ) from None
        with client:
            if not client.nthreads():
                raise ValueRangeError(
                    f"the Dask scheduler at {scheduler!r} has no workers. Start some with `dask worker {scheduler}`."
                )
            yield Workers.from_client(client)


def _result_or_failure(function: Callable[[Item], Result], item: Item) -> Result | Failure:
    """Result, or the reason for an input error, which does not depend on the worker and is not retried."""
    try:
        return function(item)
    except TwistWrenchError as problem:
        return Failure(str(problem), problem)
