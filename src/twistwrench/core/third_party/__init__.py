"""Third-party libraries: Dask arrays evaluated block by block, imports at first use, and conversion of errors and output."""

from __future__ import annotations

import contextlib
import importlib
import inspect
import os
import re
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
"""Function of a robot and of arguments by name, which returns the shapes of the results for one state."""
Place = tuple[str, str | None]
"""Name of an array argument; for wrenches also the frame, which is the key in the argument's mapping."""

_STATE_ARGUMENTS = ("q", "q0", "q1", "dq", "ddq", "dv", "tau")
"""Arguments that are arrays of states."""
_WRENCH_ARGUMENTS = ("wrench_by_robot", "wrench_on_robot")
"""Arguments that are mappings from frames to wrenches."""


def is_lazy(x: Any) -> bool:
    """True if ``x`` is a Dask array."""
    dask = sys.modules.get("dask.array")
    return dask is not None and isinstance(x, getattr(dask, "Array", ()))


def any_lazy(arguments: Iterable[Any]) -> bool:
    """True if one of the arguments is a Dask array, or a mapping with a Dask array among its values."""
    if "dask.array" not in sys.modules:
        return False
    for argument in arguments:
        if isinstance(argument, Mapping):
            if any_lazy(argument.values()):
                return True
        elif is_lazy(argument):
            return True
    return False


def is_asking_for_type() -> bool:
    """True if the caller runs inside Dask's type inference.

    If ``dtype=`` is missing, ``map_blocks`` calls its function with small arrays to find the type of the result.
    """
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

    ``signature`` is that of a generalized ufunc with sizes in place of names, as in ``(7),(7)->(7,7)``. Batch axes broadcast
    and keep their chunks by Dask's rules; each core axis becomes one chunk. ``dtype=None`` selects float32 if it can hold every
    input, else float64.
    """
    dask: Any = sys.modules["dask.array"]
    _, _, outputs = signature.partition("->")
    sizes = set(re.findall(r"\w+", outputs))
    output_count = outputs.count("(")
    if dtype is None:
        dtype = np.float32 if all(np.can_cast(array.dtype, np.float32) for array in arrays) else np.float64
    one_chunk = {-1: -1}  # for the last axis
    return dask.apply_gufunc(
        function,
        signature,
        *(array.rechunk(one_chunk) if is_lazy(array) else array for array in arrays),
        output_dtypes=dtype if output_count == 1 else (dtype,) * output_count,
        output_sizes={size: int(size) for size in sizes},
        allow_rechunk=True,  # for arguments with different chunks along the batch axes
    )


def lazy_by_blocks(
    shapes: Shapes, result: Callable[..., Any] | None = None, dtype: Any = None
) -> Callable[[Method], Method]:
    """Decorator of a robot's method: if an argument or wrench is a Dask array, the method is evaluated later, block by block.

    ``shapes`` returns the shapes of the results for one state. ``result`` combines several results to one. Arguments named q,
    q0 and q1 are (nq,), other states (nv,), wrenches (6,). All other arguments are passed to every block.
    """

    def decorate(method: Method) -> Method:
        signature = inspect.signature(method)
        owner_name = next(iter(signature.parameters))  # usually "self"

        @wraps(method)
        def call(owner: Any, *args: Any, **options: Any) -> Any:
            if not any_lazy((*args, *options.values())):
                return method(owner, *args, **options)
            arguments = signature.bind(owner, *args, **options).arguments
            del arguments[owner_name]
            places: list[Place] = [(name, None) for name in arguments if name in _STATE_ARGUMENTS]
            for name in _WRENCH_ARGUMENTS:
                wrenches = arguments.get(name) or {}
                places += [(name, frame) for frame in wrenches]
            arrays = [_array(owner, method.__name__, arguments, place) for place in places]
            inputs = _signature_part([array.shape[-1:] for array in arrays])
            outputs = _signature_part(shapes(owner, arguments))
            block = _Block(owner, method.__name__, arguments, tuple(places))
            deferred = later(block, f"{inputs}->{outputs}", arrays, dtype)
            if result is None:
                return deferred
            return result(*deferred)

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
    """Name of the method."""
    arguments: Mapping[str, Any]
    places: tuple[Place, ...]
    """Place of each array among the arguments."""

    def __call__(self, *arrays: Array) -> Any:
        arguments = dict(self.arguments)
        for name in _WRENCH_ARGUMENTS:
            if arguments.get(name):
                arguments[name] = dict(arguments[name])  # a copy, whose values this block replaces
        for (name, frame), array in zip(self.places, arrays, strict=True):
            if frame is None:
                arguments[name] = array
            else:
                arguments[name][frame] = array
        return getattr(self.owner, self.name)(**arguments)


def _array(owner: Any, method: str, arguments: Mapping[str, Any], place: Place) -> Any:
    """Array argument at ``place``, checked to have the owner's size in its last axis."""
    name, frame = place
    if frame is not None:
        array = arguments[name][frame]
        label = f"{name}[{frame!r}]"
        size = 6  # of a wrench
    else:
        array = arguments[name]
        label = name
        size = owner.nq if name.startswith("q") else owner.nv
    if not is_lazy(array):
        array = np.asarray(array)
    if array.shape[-1:] != (size,):
        raise ShapeError(f"{method}: {label} has shape {array.shape}, expected {size} in the last axis.")
    return array


class _LazyModule:
    """Placeholder for a module; attributes are taken from the module on first use."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, name: str) -> Any:
        value = getattr(importlib.import_module(self._name), name)
        setattr(self, name, value)  # the next access finds it without this method
        return value


def lazy_module(name: str) -> Any:
    """Module of that name, imported when one of its names is first used."""
    return _LazyModule(name)


_MAX_REASON_LENGTH = 200
"""Maximum number of displayed characters of a foreign message."""


@contextmanager
def third_party_errors(error_of: Callable[[str], TwistWrenchError]) -> Iterator[None]:
    """Convert any exception of the block to an error of this library, made by ``error_of`` from the reason.

    This library's own errors, ``KeyboardInterrupt`` and ``SystemExit`` pass unchanged. Use it only around calls of a
    third-party parser on external data: a mistake of our own code in the block would be reported as an error in the file.
    """
    try:
        yield
    except TwistWrenchError:
        raise
    except Exception as problem:
        raise error_of(reason_of(problem)) from problem


def reason_of(problem: Exception) -> str:
    """Reason of an error in one line without a full stop: the system's text for files, otherwise class and message."""
    if isinstance(problem, RecursionError):
        return "its entries are nested too deeply"
    if isinstance(problem, MemoryError):
        return "it needs more memory than is available"
    if isinstance(problem, OSError) and problem.strerror:
        return problem.strerror
    one_line = " ".join(_message_of(problem).split())
    message = one_line.rstrip(".")
    class_name = type(problem).__name__
    if not message:
        return class_name
    if len(message) > _MAX_REASON_LENGTH:
        message = f"{message[:_MAX_REASON_LENGTH]}…"
    return f"{class_name}: {message}"


def _message_of(problem: Exception) -> str:
    """Message of an error; empty if it cannot be made, for example if the text of an error in C++ is not Unicode."""
    try:
        return str(problem)
    except Exception:
        return ""


_MAX_OUTPUT_LENGTH = 300
"""Maximum number of displayed characters of captured output."""
_MAX_CAPTURED_BYTES = 2**16
"""Largest size of captured output that is read; far more than is displayed."""
_STDERR = 2
"""File descriptor of the standard error."""


class ForeignOutput:
    """Output written during the block of :func:`capture_stderr`."""

    text = ""
    """Output, at most its beginning of 64 KiB; available after the block."""

    def __str__(self) -> str:
        one_line = " ".join(self.text.split())
        if len(one_line) <= _MAX_OUTPUT_LENGTH:
            return one_line
        return f"{one_line[:_MAX_OUTPUT_LENGTH]}…"


@contextlib.contextmanager
def capture_stderr() -> Iterator[ForeignOutput]:
    r"""Capture the process's standard error in the block, including output of C and C++.

    Output of other threads is captured too. Without a standard error, nothing is captured.
    """
    output = ForeignOutput()
    with contextlib.suppress(Exception):  # sys.stderr may be None or closed
        sys.stderr.flush()
    try:
        saved_stderr = os.dup(_STDERR)
    except OSError:  # there is no standard error
        yield output
        return
    import tempfile

    try:
        with tempfile.TemporaryFile() as file:
            os.dup2(file.fileno(), _STDERR)
            try:
                yield output
            finally:
                with contextlib.suppress(Exception):
                    sys.stderr.flush()
                os.dup2(saved_stderr, _STDERR)
                file.seek(0)
                first_bytes = file.read(_MAX_CAPTURED_BYTES)
                output.text = first_bytes.decode("utf-8", "replace")
    finally:
        os.close(saved_stderr)
