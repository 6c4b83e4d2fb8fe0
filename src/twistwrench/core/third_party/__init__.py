"""Third-party libraries: Dask arrays by blocks, imports on first use, and foreign errors and output."""

from __future__ import annotations

import contextlib
import importlib
import inspect
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import wraps
from typing import Any, TypeVar

import numpy as np

from ..errors import ShapeError, TwistWrenchError
from ..typing import Array

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
