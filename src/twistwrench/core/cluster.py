"""Independent work on this process, on processes of this machine, or on a Dask cluster, with results in order.

Scheduling, retries, moving data and the dashboard are Dask's. Our own threads stay off in its workers.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

from ..errors import MissingExtraError, TwistWrenchError, ValueRangeError

Item = TypeVar("Item")
Result = TypeVar("Result")

RETRIES = 3
"""Retries of work whose worker died; Dask counts deaths of workers with the same number."""
_PATIENCE = 10.0
"""Timeout for a scheduler [s]."""
_ALONE = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "TWISTWRENCH_THREADS": "1"}
"""Settings of local processes: as many workers as there are cores, one thread each."""


@dataclass(frozen=True)
class Failure:
    """Reason why a piece of work failed: a sentence of ours, or the kind and text of another error."""

    reason: str


@dataclass
class Workers:
    """Workers: this process, or those of a Dask client.

    Parameters
    ----------
    client : dask.distributed.Client, optional
    ahead : int, pieces that are handed out at a time, so that results that wait for their turn stay few
    """

    client: Any = None
    ahead: int = 1

    @classmethod
    def on(cls, client: Any) -> Workers:
        """Workers of a Dask client; this process if it is None."""
        return cls() if client is None else cls(client, 3 * max(1, sum(client.nthreads().values())))

    def results(
        self, function: Callable[[Item], Result], items: Sequence[Item], progress: Callable[[float], None] | None = None
    ) -> Iterator[Result | Failure]:
        """``function`` of each item, in the order of the items; errors of one do not stop the others.

        Examples
        --------
        >>> list(Workers().results(abs, [-1, 2]))
        [1, 2]
        """
        tell, work = progress or (lambda _share: None), partial(_guarded, function)
        if self.client is None:
            for k, item in enumerate(items, start=1):
                yield work(item)
                tell(k / len(items))
            return
        from concurrent.futures import CancelledError

        from distributed.comm import CommClosedError
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
                yield Failure(_said(problem))
            future.release()
            tell((k + 1) / len(items))


@contextmanager
def workers_of(workers: int | None = None, scheduler: str | None = None) -> Iterator[Workers]:
    """Workers of one kind: this process by default, a number of processes of this machine, or a cluster by its address.

    Parameters
    ----------
    workers : int, optional
    scheduler : str, optional, such as ``tcp://10.0.0.1:8786``

    Raises
    ------
    MissingExtraError
        There is no Dask.
    ValueRangeError
        Both are asked for, the number is none, or nothing answers at the address.

    Examples
    --------
    >>> with workers_of() as team:
    ...     list(team.results(len, ["ab", "c"]))
    [2, 1]
    """
    if workers is None and scheduler is None:
        yield Workers()
        return
    if workers is not None and scheduler is not None:
        raise ValueRangeError("workers of this machine and a scheduler's are both asked for. Choose one.")
    if workers is not None and not 1 <= workers <= 4096:
        raise ValueRangeError(
            f"{workers!r} is no number of workers. Give 1 or more; this machine has {os.cpu_count()} cores."
        )
    try:
        import dask
        from distributed import Client, LocalCluster
    except ImportError:
        raise MissingExtraError.from_extra("dask", "dask", "Working on several processes or machines") from None
    settings = {"distributed.scheduler.allowed-failures": RETRIES, "distributed.nanny.pre-spawn-environ": _ALONE}
    with dask.config.set(settings):
        if workers is not None:
            with (
                LocalCluster(
                    n_workers=workers, threads_per_worker=1, dashboard_address=None, silence_logs=50
                ) as cluster,
                Client(cluster) as client,
            ):
                yield Workers.on(client)
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
            yield Workers.on(client)


def _guarded(function: Callable[[Item], Result], item: Item) -> Result | Failure:
    """The result, or the reason why there is none; an input error is the same on every worker."""
    try:
        return function(item)
    except TwistWrenchError as problem:
        return Failure(str(problem))


def _said(problem: Exception) -> str:
    return f"{type(problem).__name__}: {str(problem).splitlines()[0] if str(problem) else 'no more is said'}"
