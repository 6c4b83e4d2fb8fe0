"""Child processes under limits: calls of readers whose C code may crash, run without end or take all memory.

``run_in_child("package.module:function", *args)`` calls a function in another process and returns its result. The child is a
fresh interpreter that imports only the module of the function. It serves one call after another, ends itself when idle, and is
killed at a limit. Arguments are anything that can be pickled. Results are plain data: numbers, texts, lists, dictionaries and
NumPy arrays; the parent creates no other objects from what a child sends.

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

_IDLE = 20
"""Time after which an idle child ends itself [s]."""
_WAITING = 3.0
"""Largest waiting time in multiples of the processor time allowed: a loaded machine, or a file that never arrives."""
_THREADS = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
_ALONE = {**_THREADS, VARIABLE: "0", "ARROW_DEFAULT_MEMORY_POOL": "system"}
"""Environment of a child: one thread, no child of its own, and no memory reserved in advance, which would count as used."""

_HEAD = struct.Struct("<cQ")
"""Kind of a message, and its size [bytes]."""
_CALL, _MORE, _STOP = b"c", b"m", b"s"
_ITEM, _END, _ERROR, _REASON = b"i", b"e", b"x", b"r"


@dataclass(frozen=True)
class ChildLimits:
    """Limits of one call in a child process."""

    seconds: float = 60.0
    """Processor time of the call, or of each item of an iterator [s]; waiting may take three times as long."""
    memory: int = 1 << 30
    """Memory beyond that of the idle child [bytes]."""
    output: int = 1 << 30
    """Size of the result, or of all items together [bytes]."""


_START = ChildLimits(seconds=10.0)
"""Limits of the start of a child."""
PREPARATIONS: list[tuple[str, tuple[Any, ...]]] = []
"""Functions ``module:name`` that each new child calls before it serves, with their arguments, which JSON can hold."""
_NO_CHILD = f"no child process can be started for its reader; {VARIABLE}=0 reads it in this process"


def sandboxed() -> bool:
    """True if readers with foreign C code shall run in a child process, by the environment variable or by default."""
    wanted = os.environ.get(VARIABLE, "")
    if wanted in ("0", "1"):
        return wanted == "1"
    return BY_DEFAULT and _possible()


@cache
def _possible() -> bool:
    """True if a child starts: not within another program, a frozen one, or a browser. The child is kept."""
    if getattr(sys, "frozen", False) or sys.platform in ("emscripten", "wasi"):
        return False
    if not Path(sys.executable or "").stem.lower().startswith(("python", "pypy")):
        return False
    try:
        _returned(_taken())
    except _FailedCall:
        return False
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
    """Items of the iterator that the function ``module:name`` returns in a child process, each computed when it is wanted.

    Raises as :func:`run_in_child`.
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
        import_folders = [Path(place).absolute() for place in sys.path if place]
        places = [str(package.parent), *map(str, import_folders)]
        try:
            self.process = subprocess.Popen(
                [sys.executable or "python", "-I", "-S", "-c", _BEGIN],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env={**os.environ, **_ALONE},
            )
            self.requests.write(json.dumps([places, str(package), PREPARATIONS]).encode() + b"\n")
            self.requests.flush()
        except (OSError, RuntimeError) as problem:
            raise _FailedCall(f"{_NO_CHILD} ({reason_of(problem)})") from None
        self.overdue = False

    def await_start(self) -> None:
        """Wait for the interpreter to start. Raises _FailedCall if it does not."""
        try:
            kind, _ = self.answer(_START, 1 << 10)
        except (_FailedCall, _OutdatedChild):
            kind = b""
        if kind != _END:
            self.end()
            raise _FailedCall(_NO_CHILD)

    @property
    def requests(self) -> BinaryIO:
        assert self.process.stdin is not None
        return self.process.stdin  # type: ignore[return-value]

    @property
    def answers(self) -> BinaryIO:
        assert self.process.stdout is not None
        return self.process.stdout  # type: ignore[return-value]

    def ask(self, kind: bytes, content: bytes = b"") -> None:
        """Send a message. Raises _OutdatedChild if the child has ended."""
        try:
            self.requests.write(_HEAD.pack(kind, len(content)) + content)
            self.requests.flush()
        except OSError:
            raise _OutdatedChild from None

    def begin(self, request: bytes, limits: ChildLimits) -> tuple[bytes, bytes]:
        """Send a call and return the first answer."""
        self.ask(_CALL, request)
        return self.answer(limits, limits.output)

    def answer(self, limits: ChildLimits, most: int) -> tuple[bytes, bytes]:
        """Kind and content of the next answer; raises _FailedCall if the child ends, is overdue, or sends too much."""
        patience = threading.Timer(_WAITING * limits.seconds, self._end_overdue)
        patience.start()
        try:
            head = self.answers.read(_HEAD.size)
            kind, size = _HEAD.unpack(head) if len(head) == _HEAD.size else (b"", 0)
            if size > most:
                raise _FailedCall(f"its content takes more than {_amount(most)} once read")
            content = self.answers.read(size)
        finally:
            patience.cancel()
        if not kind or len(content) < size:
            raise _FailedCall(self._end_reason(limits))
        return kind, content

    def _end_overdue(self) -> None:
        self.overdue = True
        self.process.kill()

    def _end_reason(self, limits: ChildLimits) -> str:
        self.process.kill()  # it has closed its output; a child that has ended already is left alone
        code = self.process.wait()
        if self.overdue:
            return f"reading it took longer than {number(_WAITING * limits.seconds)} s"
        if code == -getattr(signal, "SIGXCPU", 0):
            return f"reading it took more than {number(limits.seconds)} s of processor time"
        if code == -getattr(signal, "SIGALRM", 0):
            raise _OutdatedChild
        with contextlib.suppress(ValueError):
            return f"its reader crashed ({signal.Signals(-code).name})"
        return f"its reader ended with code {code}"

    def end(self) -> None:
        """End the process."""
        self.process.kill()
        self.process.wait()
        for pipe in (self.requests, self.answers):
            with contextlib.suppress(OSError):  # what was not sent to it is lost
                pipe.close()


_idle: dict[int, list[_Child]] = {}
"""Idle children by the process that started them: a fork of this process uses none of its parent's."""
_lock = threading.Lock()


def _taken() -> _Child:
    """An idle child of this process, or a new one."""
    with _lock:
        mine = _idle.setdefault(os.getpid(), [])
        while mine:
            child = mine.pop()
            if child.process.poll() is None:
                return child
            child.end()
    child = _Child()
    child.await_start()
    return child


def _returned(child: _Child) -> None:
    """Keep one idle child."""
    with _lock:
        mine = _idle.setdefault(os.getpid(), [])
        if not mine:
            mine.append(child)
            return
    child.end()


@atexit.register
def end_children() -> None:
    """End the idle children of this process."""
    with _lock:
        mine = _idle.pop(os.getpid(), [])
    for child in mine:
        child.end()


def _answers(
    target: str, args: tuple[Any, ...], limits: ChildLimits, error_of: Callable[[str], TwistWrenchError], *, whole: bool
) -> Iterator[Any]:
    """Items of a call: the result alone if ``whole``, else those of the iterator that it returns."""
    request = pickle.dumps((target, args, limits, whole, _folder()), protocol=5)
    try:
        child, kind, content = _begun(request, limits)
    except _FailedCall as problem:
        raise error_of(str(problem)) from None
    left, serves = limits.output, False
    try:
        while kind == _ITEM:
            left -= len(content)
            yield _plain(content)
            child.ask(_MORE)
            kind, content = child.answer(limits, left)
        serves = True
        if kind == _ERROR:
            raise _error_from(*_plain(content))
        if kind == _REASON:
            raise error_of(str(_plain(content)))
    except GeneratorExit:
        with contextlib.suppress(_FailedCall, _OutdatedChild):  # the caller wants no more items
            child.ask(_STOP)
            serves = child.answer(limits, left)[0] == _END
        raise
    except (_FailedCall, _OutdatedChild) as problem:
        raise error_of(str(problem) or "its reader ended early") from None
    finally:
        if serves:
            _returned(child)
        else:
            child.end()


def _error_from(name: str, text: str, *arguments: Any) -> TwistWrenchError:
    """Error of this library by its name, with the arguments in its text."""
    kind = getattr(errors, name) if name in errors.__all__ else TwistWrenchError
    given = [Argument(*one) for one in arguments]
    if issubclass(kind, TwistWrenchError):
        return kind(text, *given)
    return TwistWrenchError(text, *given)


def _parts(problem: TwistWrenchError) -> tuple[Any, ...]:
    """Text of an error, and its arguments as plain data."""
    text, *arguments = problem.args or ("",)
    if not all(isinstance(one, Argument) for one in arguments):
        return (str(problem),)
    return str(text), *((one.name,) if one.value is ... else (one.name, one.value) for one in arguments)


def _folder() -> str:
    """Working folder; the root if it has been removed."""
    try:
        return str(Path.cwd())
    except OSError:
        return os.path.abspath(os.sep)  # noqa: PTH100


def _begun(request: bytes, limits: ChildLimits) -> tuple[_Child, bytes, bytes]:
    """Child with its first answer; a child that ended while idle is replaced."""
    while True:
        child = _taken()
        try:
            return child, *child.begin(request, limits)
        except _OutdatedChild:
            child.end()
        except BaseException:
            child.end()
            raise


class _PlainData(pickle.Unpickler):
    """Reader of numbers, texts, lists, dictionaries and NumPy arrays; no other class can be named."""

    def find_class(self, module: str, name: str) -> Any:
        if (module.replace("numpy.core", "numpy._core"), name) in _ARRAYS:
            return super().find_class(module, name)
        raise pickle.UnpicklingError(f"{module}.{name} is not plain data")


_ARRAYS = {
    ("numpy", "ndarray"), ("numpy", "dtype"), ("numpy._core.numeric", "_frombuffer"),
    ("numpy._core.multiarray", "_reconstruct"), ("numpy._core.multiarray", "scalar"),
}  # fmt: skip


def _plain(content: bytes) -> Any:
    try:
        return _PlainData(io.BytesIO(content)).load()
    except Exception as problem:  # any error of the unpickler: the child is not trusted
        raise _FailedCall(f"its reader returned what is not plain data ({reason_of(problem)})") from None


def _amount(size: int) -> str:
    if size >= 1 << 28:
        return f"{number(size / 2**30)} GiB"
    return f"{number(size / 2**20)} MiB"


_BEGIN = """
import json, sys, types
sys.path[:], folder, preparations = json.loads(sys.stdin.buffer.readline())
package = types.ModuleType("twistwrench")
package.__path__ = [folder]
sys.modules["twistwrench"] = package
from twistwrench.core.child_process import serve
serve(sys.stdin.buffer, preparations)
"""
"""Beginning of a child: the package's modules can be imported without the package's own imports, and no folder but those of
the parent is searched."""


def serve(requests: BinaryIO, preparations: Sequence[tuple[str, Sequence[Any]]] = ()) -> None:
    """Serve calls until the input ends, after the preparations."""
    with contextlib.suppress(ValueError):
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends its child
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints is no answer
    _set_limit("RLIMIT_CORE", 0)
    for target, args in preparations:
        _function(target)(*args)
    alarm = getattr(signal, "alarm", lambda _seconds: None)

    def received() -> tuple[bytes, bytes]:
        head = requests.read(_HEAD.size)
        if len(head) < _HEAD.size:
            raise SystemExit
        kind, size = _HEAD.unpack(head)
        return kind, requests.read(size)

    def answer(kind: bytes, value: Any = None) -> None:
        content = pickle.dumps(value, protocol=5)
        answers.write(_HEAD.pack(kind, len(content)))
        answers.write(content)
        answers.flush()

    answer(_END)
    while True:
        alarm(_IDLE)
        kind, request = received()
        alarm(0)
        if kind != _CALL:
            continue
        try:
            for item in _items(request):
                answer(_ITEM, item)
                if received()[0] == _STOP:
                    break
            answer(_END)
        except TwistWrenchError as problem:
            answer(_ERROR, (type(problem).__name__, *_parts(problem)))
        except MemoryError:
            answer(_REASON, "it needs more memory than its reader may use")
        except Exception as problem:  # any error of a foreign reader is an error of the file
            answer(_REASON, reason_of(problem))


def loaded_packages() -> list[str]:
    """Names of the imported packages and modules, without those within packages."""
    return sorted(name for name in sys.modules if "." not in name)


def _items(request: bytes) -> Iterator[Any]:
    """Items of a call, each under the limits of processor time and memory."""
    target, args, limits, whole, folder = pickle.loads(request)
    function = _function(target)
    os.chdir(folder)  # paths are relative to the parent's
    _limit_memory(limits.memory)
    _limit_time(limits.seconds)
    if whole:
        yield function(*args)
        return
    for item in function(*args):
        yield item
        _limit_time(limits.seconds)


def _function(target: str) -> Callable[..., Any]:
    """Function ``module:name``."""
    module, _, name = target.partition(":")
    function: Callable[..., Any] = attrgetter(name)(importlib.import_module(module))
    return function


def _limit_time(seconds: float) -> None:
    _set_limit("RLIMIT_CPU", math.ceil(time.process_time() + seconds))


def _limit_memory(memory: int) -> None:
    """Limit the memory beyond that in use now. Linux counts memory that can be written, not the code of libraries."""
    with contextlib.suppress(OSError, IndexError, ValueError):
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[5])
        _set_limit("RLIMIT_DATA", pages * os.sysconf("SC_PAGE_SIZE") + memory)


def _set_limit(name: str, value: int) -> None:
    """Lower or raise a limit of this process up to the system's; systems without it are left as they are."""
    try:
        import resource
    except ImportError:
        return
    kind = getattr(resource, name, None)
    if kind is None:
        return
    with contextlib.suppress(OSError, ValueError):
        most = resource.getrlimit(kind)[1]
        resource.setrlimit(kind, (value if most == resource.RLIM_INFINITY else min(value, most), most))
