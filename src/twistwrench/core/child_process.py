"""Child processes under limits, for readers whose C code may crash, run without end or take all memory.

``run_in_child("package.module:function", *args)`` calls a function in another process and returns its result. The child is a
fresh interpreter that imports only the module of the function. It serves one call after another. It ends itself when idle,
and is killed at a limit. Arguments are anything that can be pickled. Results are plain data: numbers, texts, lists,
dictionaries and NumPy arrays; the parent creates no other objects from what a child sends.

Memory and processor time are limited by the operating system, on Linux. Elsewhere only the waiting time is limited, and
a crash still ends the child alone.
"""

from __future__ import annotations

import atexit
import contextlib
import importlib
import io
import json
import math
import os
import pickle
import signal
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from operator import attrgetter
from pathlib import Path
from typing import Any, BinaryIO

from . import errors
from .errors import TwistWrenchError
from .numbers import number
from .text import Argument
from .third_party import reason_of

VARIABLE = "TWISTWRENCH_SANDBOX"
"""Environment variable: 1 runs readers with foreign C code in a child process, 0 in this process."""
BY_DEFAULT = True
"""True if readers run in a child process unless the variable is 0."""

_IDLE_SECONDS = 20
"""Time after which an idle child ends itself [s]."""
_WAITING_FACTOR = 3.0
"""Largest waiting time in multiples of the allowed processor time: the machine may be loaded, and a file may never arrive."""
_CHILD_ENVIRONMENT = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    VARIABLE: "0",  # no child of its own
    "ARROW_DEFAULT_MEMORY_POOL": "system",  # no memory reserved in advance, which would count as used
}

_HEADER = struct.Struct("<cQ")
"""Kind of a message, and its size [bytes]."""
_CALL, _MORE, _STOP = b"c", b"m", b"s"
"""Kinds of requests: a call, the next item, no more items."""
_ITEM, _END, _ERROR, _REASON = b"i", b"e", b"x", b"r"
"""Kinds of answers: an item, no more items, an error of this library, the reason of another failure."""
_MAX_START_ANSWER = 1 << 10
"""Largest size of the answer that a child has started [bytes]."""


@dataclass(frozen=True)
class ChildLimits:
    """Limits of one call in a child process."""

    seconds: float = 60.0
    """Processor time of the call, or of each item of an iterator [s]; waiting may take three times as long."""
    memory: int = 1 << 30
    """Memory beyond that of the idle child [bytes]."""
    output: int = 1 << 30
    """Size of the result, or of all items together [bytes]."""


_START_LIMITS = ChildLimits(seconds=10.0)
"""Limits of the start of a child."""
PREPARATIONS: list[tuple[str, tuple[Any, ...]]] = []
"""Functions ``module:name`` that each new child calls before it serves, with their arguments, which must be data for JSON."""
_NO_CHILD_REASON = f"no child process can be started for its reader; {VARIABLE}=0 reads it in this process"


def sandboxed() -> bool:
    """True if readers with foreign C code run in a child process, by the environment variable or by default."""
    setting = os.environ.get(VARIABLE, "")
    if setting in ("0", "1"):
        return setting == "1"
    return BY_DEFAULT and _possible()


@cache
def _possible() -> bool:
    """True if a child can be started. The child of this test is kept for the first call.

    No child can be started in a browser, in a frozen program, or if Python is embedded in another program.
    """
    if getattr(sys, "frozen", False) or sys.platform in ("emscripten", "wasi"):
        return False
    interpreter = Path(sys.executable or "").stem.lower()
    if not interpreter.startswith(("python", "pypy")):
        return False
    try:
        child = _take_idle_or_start()
    except _FailedCall:
        return False
    _keep_idle(child)
    return True


def run_in_child(
    target: str, *args: Any, limits: ChildLimits | None = None, error_of: Callable[[str], TwistWrenchError]
) -> Any:
    """Result of the function ``module:name`` in a child process.

    An error of this library in the function is raised here. Another exception, a crash and an exceeded limit become
    ``error_of(reason)``.

    >>> run_in_child("math:hypot", 3.0, 4.0, error_of=errors.ValueRangeError)
    5.0
    >>> run_in_child("os:abort", error_of=errors.ValueRangeError)
    Traceback (most recent call last):
    twistwrench.core.errors.ValueRangeError: its reader crashed (SIGABRT)
    """
    (result,) = _answers(target, args, limits or ChildLimits(), error_of, whole=True)
    return result


def stream_from_child(
    target: str, *args: Any, limits: ChildLimits | None = None, error_of: Callable[[str], TwistWrenchError]
) -> Iterator[Any]:
    """Items of the iterator that the function ``module:name`` returns in a child process, each computed on demand.

    Raises the same errors as :func:`run_in_child`.
    """
    return _answers(target, args, limits or ChildLimits(), error_of, whole=False)


class _FailedCall(Exception):
    """Call that ended without a result; the text is the reason."""


class _OutdatedChild(Exception):
    """Child that had ended before the call reached it."""


class _Child:
    """Process that serves calls."""

    def __init__(self) -> None:
        package = Path(__file__).parents[1]
        import_folders = [str(Path(entry).absolute()) for entry in sys.path if entry]
        search_path = [str(package.parent), *import_folders]
        try:
            self.process = subprocess.Popen(
                [sys.executable or "python", "-I", "-S", "-c", _START_PROGRAM],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env={**os.environ, **_CHILD_ENVIRONMENT},
            )
            start_arguments = json.dumps([search_path, str(package), PREPARATIONS])
            self.requests.write(start_arguments.encode() + b"\n")
            self.requests.flush()
        except (OSError, RuntimeError) as problem:
            raise _FailedCall(f"{_NO_CHILD_REASON} ({reason_of(problem)})") from None
        self.overdue = False
        """True if the child was killed because it took too long."""

    def await_start(self) -> None:
        """Wait for the interpreter to start. Raises _FailedCall if it does not."""
        try:
            kind, _ = self.answer(_START_LIMITS, _MAX_START_ANSWER)
        except (_FailedCall, _OutdatedChild):
            kind = b""
        if kind != _END:
            self.end()
            raise _FailedCall(_NO_CHILD_REASON)

    @property
    def requests(self) -> BinaryIO:
        """Pipe to the child."""
        assert self.process.stdin is not None
        return self.process.stdin  # type: ignore[return-value]

    @property
    def answers(self) -> BinaryIO:
        """Pipe from the child."""
        assert self.process.stdout is not None
        return self.process.stdout  # type: ignore[return-value]

    def ask(self, kind: bytes, content: bytes = b"") -> None:
        """Send a message. Raises _OutdatedChild if the child has ended."""
        try:
            self.requests.write(_HEADER.pack(kind, len(content)) + content)
            self.requests.flush()
        except OSError:
            raise _OutdatedChild from None

    def begin(self, request: bytes, limits: ChildLimits) -> tuple[bytes, bytes]:
        """Send a call and return the first answer."""
        self.ask(_CALL, request)
        return self.answer(limits, limits.output)

    def answer(self, limits: ChildLimits, max_size: int) -> tuple[bytes, bytes]:
        """Kind and content of the next answer.

        Raises _FailedCall if the child ends, takes too long, or sends more than ``max_size`` bytes.
        """
        timer = threading.Timer(_WAITING_FACTOR * limits.seconds, self._end_overdue)
        timer.start()
        try:
            header = self.answers.read(_HEADER.size)
            kind = b""  # if the child has ended
            size = 0
            if len(header) == _HEADER.size:
                kind, size = _HEADER.unpack(header)
            if size > max_size:
                raise _FailedCall(f"its content takes more than {_size_text(max_size)} once read")
            content = self.answers.read(size)
        finally:
            timer.cancel()
        if not kind or len(content) < size:
            raise _FailedCall(self._end_reason(limits))
        return kind, content

    def _end_overdue(self) -> None:
        """Kill the child because it takes too long."""
        self.overdue = True
        self.process.kill()

    def _end_reason(self, limits: ChildLimits) -> str:
        """Reason why the child ended. Raises _OutdatedChild if it ended itself because it was idle."""
        self.process.kill()  # it has closed its output, but may still run
        code = self.process.wait()  # the negative number of a signal if one ended the child
        if self.overdue:
            return f"reading it took longer than {number(_WAITING_FACTOR * limits.seconds)} s"
        if code == -getattr(signal, "SIGXCPU", 0):  # Windows has neither of these two signals
            return f"reading it took more than {number(limits.seconds)} s of processor time"
        if code == -getattr(signal, "SIGALRM", 0):
            raise _OutdatedChild
        with contextlib.suppress(ValueError):  # the code is not that of a signal
            return f"its reader crashed ({signal.Signals(-code).name})"
        return f"its reader ended with code {code}"

    def end(self) -> None:
        """End the process."""
        self.process.kill()
        self.process.wait()
        for pipe in (self.requests, self.answers):
            with contextlib.suppress(OSError):  # a dead child cannot receive the rest of the buffer
                pipe.close()


_idle: dict[int, list[_Child]] = {}
"""Idle children by the id of the process that started them, so that a fork does not use children of its parent."""
_lock = threading.Lock()


def _take_idle_or_start() -> _Child:
    """An idle child of this process, or a new one."""
    with _lock:
        own_children = _idle.setdefault(os.getpid(), [])
        while own_children:
            child = own_children.pop()
            if child.process.poll() is None:
                return child
            child.end()
    child = _Child()
    child.await_start()
    return child


def _keep_idle(child: _Child) -> None:
    """Keep a child for the next call, or end it if another one is idle already."""
    with _lock:
        own_children = _idle.setdefault(os.getpid(), [])
        if not own_children:
            own_children.append(child)
            return
    child.end()


@atexit.register
def end_children() -> None:
    """End the idle children of this process."""
    with _lock:
        own_children = _idle.pop(os.getpid(), [])
    for child in own_children:
        child.end()


def _answers(
    target: str, args: tuple[Any, ...], limits: ChildLimits, error_of: Callable[[str], TwistWrenchError], *, whole: bool
) -> Iterator[Any]:
    """Items of a call: its result as the only item if ``whole``, else the items of the iterator that it returns."""
    request = pickle.dumps((target, args, limits, whole, _folder()), protocol=5)
    try:
        child, kind, content = _begin_in_child(request, limits)
    except _FailedCall as problem:
        raise error_of(str(problem)) from None
    remaining_output = limits.output
    can_serve_again = False
    try:
        while kind == _ITEM:
            remaining_output -= len(content)
            yield _plain_data(content)
            child.ask(_MORE)
            kind, content = child.answer(limits, remaining_output)
        can_serve_again = True
        if kind == _ERROR:
            raise _error_from(*_plain_data(content))
        if kind == _REASON:
            raise error_of(str(_plain_data(content)))
    except GeneratorExit:
        with contextlib.suppress(_FailedCall, _OutdatedChild):  # the caller wants no more items
            child.ask(_STOP)
            kind, _ = child.answer(limits, remaining_output)
            can_serve_again = kind == _END
        raise
    except (_FailedCall, _OutdatedChild) as problem:
        raise error_of(str(problem) or "its reader ended early") from None
    finally:
        if can_serve_again:
            _keep_idle(child)
        else:
            child.end()


def _error_from(name: str, text: str, *arguments: Any) -> TwistWrenchError:
    """Error of this library by its name, with the arguments in its text."""
    error_class: Any = TwistWrenchError
    if name in errors.__all__:
        error_class = getattr(errors, name)
    if not issubclass(error_class, TwistWrenchError):  # a warning
        error_class = TwistWrenchError
    error: TwistWrenchError = error_class(text, *(Argument(*fields) for fields in arguments))
    return error


def _text_and_arguments(problem: TwistWrenchError) -> tuple[Any, ...]:
    """Text of an error, and its arguments as tuples of plain data: (name,) or (name, value)."""
    text, *arguments = problem.args or ("",)
    if not all(isinstance(argument, Argument) for argument in arguments):  # other objects are in the text alone
        return (str(problem),)
    fields_of_arguments: list[tuple[Any, ...]] = []
    for argument in arguments:
        if argument.value is ...:  # an argument without a value
            fields_of_arguments.append((argument.name,))
        else:
            fields_of_arguments.append((argument.name, argument.value))
    return str(text), *fields_of_arguments


def _folder() -> str:
    """Working folder of this process; the root folder if it has been removed."""
    try:
        return str(Path.cwd())
    except OSError:
        return os.path.abspath(os.sep)  # noqa: PTH100


def _begin_in_child(request: bytes, limits: ChildLimits) -> tuple[_Child, bytes, bytes]:
    """Child that has taken the call, and kind and content of its first answer. A child that ended while idle is replaced."""
    while True:
        child = _take_idle_or_start()
        try:
            return child, *child.begin(request, limits)
        except _OutdatedChild:
            child.end()
        except BaseException:
            child.end()
            raise


class _PlainData(pickle.Unpickler):
    """Unpickler that creates numbers, texts, lists, dictionaries and NumPy arrays, and refuses all other classes."""

    def find_class(self, module: str, name: str) -> Any:
        """Class or function of a module, if it is allowed."""
        module_of_numpy_2 = module.replace("numpy.core", "numpy._core")
        if (module_of_numpy_2, name) in _ALLOWED_NAMES:
            return super().find_class(module, name)
        raise pickle.UnpicklingError(f"{module}.{name} is not plain data")


_ALLOWED_NAMES = {
    ("numpy", "ndarray"), ("numpy", "dtype"), ("numpy._core.numeric", "_frombuffer"),
    ("numpy._core.multiarray", "_reconstruct"), ("numpy._core.multiarray", "scalar"),
}  # fmt: skip


def _plain_data(content: bytes) -> Any:
    """Data of an answer. Raises _FailedCall for other objects than plain data."""
    try:
        return _PlainData(io.BytesIO(content)).load()
    except Exception as problem:  # any error of the unpickler: the child is not trusted
        raise _FailedCall(f"its reader returned what is not plain data ({reason_of(problem)})") from None


def _size_text(size: int) -> str:
    """Size [bytes] as text with a unit."""
    if size >= 2**28:  # a quarter of a GiB
        return f"{number(size / 2**30)} GiB"
    return f"{number(size / 2**20)} MiB"


_START_PROGRAM = """
import json, sys, types
sys.path[:], folder, preparations = json.loads(sys.stdin.buffer.readline())
package = types.ModuleType("twistwrench")
package.__path__ = [folder]
sys.modules["twistwrench"] = package
from twistwrench.core.child_process import serve
serve(sys.stdin.buffer, preparations)
"""
"""Program of a child. Its package is an empty module, so that the package's ``__init__`` is not run. Modules are searched only
in the folders of the parent."""


def serve(requests: BinaryIO, preparations: Sequence[tuple[str, Sequence[Any]]] = ()) -> None:
    """Run the preparations, and then serve calls until the input ends."""
    with contextlib.suppress(ValueError):
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends its child
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # text that a library prints goes to stderr, so that it does not mix with the answers
    _set_limit("RLIMIT_CORE", 0)
    for target, args in preparations:
        prepare = _function(target)
        prepare(*args)
    set_alarm = getattr(signal, "alarm", lambda _seconds: None)  # SIGALRM ends the process

    def next_request() -> tuple[bytes, bytes]:
        header = requests.read(_HEADER.size)
        if len(header) < _HEADER.size:
            raise SystemExit
        kind, size = _HEADER.unpack(header)
        return kind, requests.read(size)

    def answer(kind: bytes, value: Any = None) -> None:
        content = pickle.dumps(value, protocol=5)
        answers.write(_HEADER.pack(kind, len(content)))
        answers.write(content)
        answers.flush()

    answer(_END)  # the child has started
    while True:
        set_alarm(_IDLE_SECONDS)
        kind, request = next_request()
        set_alarm(0)
        if kind != _CALL:
            continue
        try:
            for item in _items(request):
                answer(_ITEM, item)
                kind, _ = next_request()
                if kind == _STOP:
                    break
            answer(_END)
        except TwistWrenchError as problem:
            answer(_ERROR, (type(problem).__name__, *_text_and_arguments(problem)))
        except MemoryError:
            answer(_REASON, "it needs more memory than its reader may use")
        except Exception as problem:  # any error of a foreign reader is an error of the file
            answer(_REASON, reason_of(problem))


def loaded_packages() -> list[str]:
    """Names of the imported top-level packages and modules."""
    return sorted(name for name in sys.modules if "." not in name)


def _items(request: bytes) -> Iterator[Any]:
    """Items of a call, each under the limits of processor time and memory."""
    target, args, limits, whole, folder = pickle.loads(request)
    function = _function(target)
    os.chdir(folder)  # of the parent, to which paths are relative
    _limit_memory(limits.memory)
    _limit_time(limits.seconds)
    if whole:
        yield function(*args)
        return
    for item in function(*args):
        yield item
        _limit_time(limits.seconds)


def _function(target: str) -> Callable[..., Any]:
    """Function with the name ``module:name``."""
    module_name, _, name = target.partition(":")
    module = importlib.import_module(module_name)
    function: Callable[..., Any] = attrgetter(name)(module)
    return function


def _limit_time(seconds: float) -> None:
    """Limit the processor time from now on."""
    _set_limit("RLIMIT_CPU", math.ceil(time.process_time() + seconds))


def _limit_memory(memory: int) -> None:
    """Limit the memory beyond that in use now. Linux counts memory that can be written, not the code of libraries."""
    with contextlib.suppress(OSError, IndexError, ValueError):
        page_counts = Path("/proc/self/statm").read_text(encoding="ascii").split()
        pages = int(page_counts[5])  # data and stack
        _set_limit("RLIMIT_DATA", pages * os.sysconf("SC_PAGE_SIZE") + memory)


def _set_limit(name: str, value: int) -> None:
    """Set a limit of this process, at most to the system's hard limit. Systems without such limits are not changed."""
    try:
        import resource
    except ImportError:
        return
    kind = getattr(resource, name, None)
    if kind is None:
        return
    with contextlib.suppress(OSError, ValueError):
        _, hard_limit = resource.getrlimit(kind)
        if hard_limit != resource.RLIM_INFINITY:
            value = min(value, hard_limit)
        resource.setrlimit(kind, (value, hard_limit))
