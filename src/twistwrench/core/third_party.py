"""Third-party libraries: Dask arrays by blocks and Dask workers, lazy imports, and foreign errors and output."""

from __future__ import annotations

import contextlib
import importlib
import inspect
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial, wraps
from typing import Any, TypeVar

import numpy as np

from .errors import MissingExtraError, ShapeError, TwistWrenchError, ValueRangeError
from .text import argument
from .typing import Array

Item = TypeVar("Item")
Result = TypeVar("Result")
Method = TypeVar("Method", bound=Callable[..., Any])
Shapes = Callable[[Any, Mapping[str, Any]], Sequence[tuple[int, ...]]]
Place = tuple[str, str | None]

_STATES = ("q", "q0", "q1", "dq", "ddq", "dv", "tau")
_WRENCHES = ("wrench_by_robot", "wrench_on_robot")


def is_lazy(x: Any) -> bool:
    """True if ``x`` is a Dask array."""
    dask = sys.modules.get("dask.array")
    return dask is not None and isinstance(x, getattr(dask, "Array", ()))


def any_lazy(arguments: Iterable[Any]) -> bool:
    """True if a Dask array is among the arguments, or among the values of a mapping there."""
    if "dask.array" not in sys.modules:
        return False
    return any(any_lazy(x.values()) if isinstance(x, Mapping) else is_lazy(x) for x in arguments)


def is_asking_for_type() -> bool:
    """True within Dask's type inference, which ``map_blocks`` makes with small arrays if ``dtype=`` is missing."""
    if "dask.array" not in sys.modules:
        return False
    frame: Any = sys._getframe()
    while frame is not None:
        if frame.f_code.co_name == "apply_infer_dtype" and str(frame.f_globals.get("__name__")).startswith("dask."):
            return True
        frame = frame.f_back
    return False


def later(function: Callable[..., Any], signature: str, arrays: Sequence[Any], dtype: Any = None) -> Any:
    """Deferred ``function(*arrays)``: a Dask array, or a tuple of Dask arrays.

    ``signature`` is that of a generalized ufunc with sizes, ``(7),(7)->(7,7)``. Batch axes broadcast and keep their chunks by
    Dask's rules; each core axis becomes one chunk. ``dtype=None`` selects float32 if it can hold every input, else float64.
    """
    dask: Any = sys.modules["dask.array"]
    outputs = signature.partition("->")[2]
    sizes = {size for size in outputs.replace("(", ",").replace(")", ",").split(",") if size}
    count = outputs.count("(")
    if dtype is None:
        dtype = np.float32 if all(np.can_cast(x.dtype, np.float32) for x in arrays) else np.float64
    return dask.apply_gufunc(
        function,
        signature,
        *(x.rechunk({-1: -1}) if is_lazy(x) else x for x in arrays),
        output_dtypes=dtype if count == 1 else (dtype,) * count,
        output_sizes={size: int(size) for size in sizes},
        allow_rechunk=True,  # for arguments with different chunks along the batch axes
    )


def lazy_by_blocks(
    shapes: Shapes, result: Callable[..., Any] | None = None, dtype: Any = None
) -> Callable[[Method], Method]:
    """Decorator of a robot's method, evaluated lazily block by block if an argument array or wrench is a Dask array.

    ``shapes`` returns the shapes of the results for one state, from the robot and the arguments by name; ``result`` combines
    several results. Arguments named q are (nq,), other states (nv,), wrenches (6,); all others are passed to every block.
    """

    def decorate(method: Method) -> Method:
        parameters = inspect.signature(method)
        first = next(iter(parameters.parameters))

        @wraps(method)
        def call(owner: Any, *args: Any, **options: Any) -> Any:
            if not any_lazy((*args, *options.values())):
                return method(owner, *args, **options)
            arguments = parameters.bind(owner, *args, **options).arguments
            del arguments[first]
            places: list[Place] = [(name, None) for name in arguments if name in _STATES]
            for name in _WRENCHES:
                places += [(name, key) for key in arguments.get(name) or ()]
            arrays = [_array(owner, method.__name__, arguments, place) for place in places]
            inputs = _signature_part([x.shape[-1:] for x in arrays])
            outputs = _signature_part(shapes(owner, arguments))
            block = _Block(owner, method.__name__, arguments, tuple(places))
            values = later(block, f"{inputs}->{outputs}", arrays, dtype)
            if result is None:
                return values
            return result(*values)

        return call  # type: ignore[return-value]

    return decorate


def _signature_part(shapes: Sequence[Sequence[int]]) -> str:
    """Shapes as in one half of a gufunc's signature: ``(6),(6,6)``."""
    parts = []
    for shape in shapes:
        sizes = ",".join(map(str, shape))
        parts.append(f"({sizes})")
    return ",".join(parts)


@dataclass(frozen=True)
class _Block:
    """Call of a method with the arrays of one block; picklable for other processes."""

    owner: Any
    name: str
    arguments: Mapping[str, Any]
    places: tuple[Place, ...]

    def __call__(self, *arrays: Array) -> Any:
        arguments = {name: dict(x) if name in _WRENCHES and x else x for name, x in self.arguments.items()}
        for (name, key), array in zip(self.places, arrays, strict=True):
            if key is None:
                arguments[name] = array
            else:
                arguments[name][key] = array
        return getattr(self.owner, self.name)(**arguments)


def _array(owner: Any, method: str, arguments: Mapping[str, Any], place: Place) -> Any:
    """Array argument at ``place``, checked to have the owner's size in its last axis."""
    name, key = place
    x, label = arguments[name], name
    size = owner.nq if name.startswith("q") else owner.nv
    if key is not None:  # a wrench on a frame
        x, label, size = x[key], f"{name}[{key!r}]", 6
    if not is_lazy(x):
        x = np.asarray(x)
    if x.shape[-1:] != (size,):
        raise ShapeError(f"{method}: {label} has shape {x.shape}, expected {size} in the last axis.")
    return x


# ── Independent jobs in this process, in local processes, or on a Dask cluster, with results in order

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


# ── Large packages that are imported on first use


class _LazyModule:
    """Placeholder for a module; attributes are taken from the module on first use."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, name: str) -> Any:
        value = getattr(importlib.import_module(self._name), name)
        setattr(self, name, value)
        return value


def lazy_module(name: str) -> Any:
    """Module of that name, imported when one of its names is first used."""
    return _LazyModule(name)


# ── Errors of parsers and other libraries, converted to errors of this library

_MAX_REASON_LENGTH = 200
"""Maximum number of displayed characters of a foreign message."""


@contextmanager
def third_party_errors(error_of: Callable[[str], TwistWrenchError]) -> Iterator[None]:
    """Convert any exception of the block to one error of this library; this library's own errors pass unchanged.

    Use it only around calls of a third-party parser on external data: an error of our own code in the block would be reported
    as an error in the file. ``KeyboardInterrupt`` and ``SystemExit`` pass. ``error_of`` makes the error from the reason text.
    """
    try:
        yield
    except TwistWrenchError:
        raise
    except Exception as problem:
        raise error_of(reason_of(problem)) from problem


def reason_of(problem: Exception) -> str:
    """Reason of an error in one line without a full stop: the system's text for files, else its kind and message."""
    if isinstance(problem, RecursionError):
        return "its entries are nested too deeply"
    if isinstance(problem, MemoryError):
        return "it needs more memory than is available"
    if isinstance(problem, OSError) and problem.strerror:
        return problem.strerror
    text = " ".join(_text_of(problem).split()).rstrip(".")
    kind = type(problem).__name__
    if not text:
        return kind
    if len(text) > _MAX_REASON_LENGTH:
        text = f"{text[:_MAX_REASON_LENGTH]}…"
    return f"{kind}: {text}"


def _text_of(problem: Exception) -> str:
    """Text of an error; empty if it has none, as the text of an error of C++ may not be Unicode."""
    try:
        return str(problem)
    except Exception:
        return ""


# ── Output of other libraries to the standard error of the process, bypassing Python: captured, and shown if useful

_MOST_OUTPUT = 300
"""Maximum number of displayed characters of the output."""


class ForeignOutput:
    """Output written during the block, available after it."""

    text = ""

    def __str__(self) -> str:
        words = " ".join(self.text.split())
        if len(words) <= _MOST_OUTPUT:
            return words
        return f"{words[:_MOST_OUTPUT]}…"


@contextlib.contextmanager
def capture_stderr() -> Iterator[ForeignOutput]:
    r"""Capture the process's standard error (file descriptor 2) in the block, including output of C and C++.

    Output of other threads is captured too. Without a standard error, nothing is captured.
    """
    output = ForeignOutput()
    with contextlib.suppress(Exception):
        sys.stderr.flush()
    try:
        stderr = os.dup(2)
    except OSError:
        yield output
        return
    import tempfile

    try:
        with tempfile.TemporaryFile() as file:
            os.dup2(file.fileno(), 2)
            try:
                yield output
            finally:
                with contextlib.suppress(Exception):
                    sys.stderr.flush()
                os.dup2(stderr, 2)
                file.seek(0)
                output.text = file.read(1 << 16).decode("utf-8", "replace")
    finally:
        os.close(stderr)
