"""Child process that reads files one by one, under limits: of memory, of processor time, and of places that it may reach.

It takes a line of JSON for each file, ``{"door": name, "path": path, "folder": folder}``, and answers with a line: how the
reading ended, the message, and what was found against the rules. It ends by a signal if a reader crashes or takes too long.
"""

from __future__ import annotations

import ctypes
import json
import os
import signal
import struct
import sys
import sysconfig
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

MEMORY = int(1.5 * 2**30)
"""Memory in use at most [bytes]."""
SPARE = 2 * 2**30
"""Addresses that a reader may take beyond those of the process at rest [bytes]; a claim that is never used counts."""
FILE_SIZE = 2**30
"""Largest temporary file [bytes]."""

_SYSTEM = ("/proc/", "/sys/", "/usr/share/zoneinfo", "/etc/localtime", "/usr/lib/locale", "/etc/ld.so")
_DEVICES = ("/dev/null", "/dev/urandom")
_FORBIDDEN = (
    "os.system", "os.exec", "os.spawn", "os.posix_spawn", "pty.spawn", "socket.connect", "socket.bind", "socket.getaddrinfo", "socket.sendto", "urllib.Request",
    "http.client.connect", "ftplib.connect", "webbrowser.open", "pickle.find_class", "sqlite3.enable_load_extension", "sqlite3.load_extension", "os.setxattr", "os.kill",
)  # fmt: skip
_ARRAYS = (("numpy._core.numeric", "_frombuffer"), ("numpy.core.numeric", "_frombuffer"), ("numpy", "dtype"))
"""All that a child process of the library may send: arrays."""
_QUESTIONS = (["uname", "-p"], ["lscpu"])
"""Programs that libraries ask about the processor: Python's platform, and NumPy 2.0 when its tests are imported."""
_CHANGES = (
    "os.remove",
    "os.rename",
    "os.rmdir",
    "os.mkdir",
    "os.symlink",
    "os.link",
    "os.chmod",
    "os.truncate",
    "shutil.rmtree",
    "shutil.move",
    "shutil.copyfile",
)


def _is_harmless(event: str, arguments: tuple[Any, ...]) -> bool:
    """True for arrays that a child of the library sends, and for the end of a child."""
    if event == "os.kill":
        return _is_child(arguments[0])
    return event == "pickle.find_class" and arguments in _ARRAYS


def _is_child(pid: int) -> bool:
    """True for a child process, which a reader may end; an ended one that was not waited for is still a child."""
    try:
        status = Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return False
    return int(status.rpartition(")")[2].split()[1]) == os.getpid()


class Guard:
    """What a reader does outside its folder, found by Python's audit events and by the system's own watch of a folder."""

    def __init__(self, scratch: Path, outside: Path) -> None:
        self.folder = ""
        self.found: list[str] = []
        self.scratch = f"{scratch.resolve()}/"
        self.outside = outside
        roots = {
            *sys.path,
            *sysconfig.get_paths().values(),
            sys.prefix,
            sys.base_prefix,
            str(Path(__file__).parents[1]),
        }
        roots |= {os.path.realpath(root) for root in roots if root}
        self.cache = f"{os.path.realpath(os.environ['TWISTWRENCH_CACHE_DIR'])}/"
        self.code = tuple(f"{root.rstrip('/')}/" for root in roots if root)
        self.watch = self._watch()
        sys.addaudithook(self.heard)

    def _watch(self) -> int:
        """Descriptor of inotify for all that happens in the folder outside; -1 where the system has none."""
        if not sys.platform.startswith("linux"):
            return -1
        libc = ctypes.CDLL(None, use_errno=True)
        watch = libc.inotify_init1(os.O_NONBLOCK)
        libc.inotify_add_watch(watch, str(self.outside).encode(), 0x1 | 0x2 | 0x20 | 0x100 | 0x200)
        return watch

    def heard(self, event: str, arguments: tuple[Any, ...]) -> None:
        if not self.folder or _is_harmless(event, arguments):
            return
        if event == "open":
            self._opened(*arguments[:3])
        elif event in _FORBIDDEN:
            self._note(event, arguments)
        elif event == "subprocess.Popen":
            own = os.path.realpath(str(arguments[0])) == os.path.realpath(
                sys.executable
            )  # a reader in a child of its own
            if not own and arguments[1] not in _QUESTIONS:
                self._note(event, arguments)
        elif event in _CHANGES:
            names = [name for name in arguments if isinstance(name, str | bytes)]
            if not all(os.fsdecode(name).startswith((self.scratch, self.folder, self.cache)) for name in names):
                self._note(event, arguments)

    def _opened(self, path: Any, mode: Any, flags: Any) -> None:
        if not isinstance(path, str | bytes):
            return  # a descriptor
        name = os.path.realpath(os.fsdecode(path))
        writes = bool(flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)) if isinstance(flags, int) else False
        mine = (self.scratch, self.folder, self.cache)
        if f"{name}/".startswith(mine) or name in _DEVICES:
            return
        if writes and f"{name}/" == self.scratch:
            return  # a temporary file without a name
        if not writes and (name.startswith(self.code) or name.startswith(_SYSTEM)):
            return
        if writes and "__pycache__" in name:
            return
        self._note("writes" if writes else "opens", (name,))

    def _note(self, event: str, arguments: tuple[Any, ...]) -> None:
        self.found.append(f"{event} {arguments!r}"[:400])

    @contextmanager
    def of(self, folder: Path) -> Iterator[None]:
        self.found.clear()
        self.folder = f"{folder.resolve()}/"
        try:
            yield
        finally:
            self.folder = ""
            if self.watch >= 0:
                try:
                    data = os.read(self.watch, 1 << 16)
                except BlockingIOError:
                    data = b""
                if data:
                    size = struct.unpack_from("=iIII", data)[3]
                    self.found.append(f"reaches {data[16 : 16 + size].rstrip(bytes(1)).decode()!r} outside its folder")


def _limit(seconds: float) -> None:
    """End of the process by SIGPROF after so much processor time; 0 takes the limit away."""
    signal.setitimer(signal.ITIMER_PROF, seconds)


def _memory_now() -> int:
    with open("/proc/self/status", encoding="ascii") as file:
        return next((1024 * int(line.split()[1]) for line in file if line.startswith("VmHWM")), 0)


def _forget_peak() -> None:
    with open("/proc/self/clear_refs", "w", encoding="ascii") as file:
        file.write("5")


def _confine() -> None:
    """Limits of the next file: addresses beyond those of now, which libraries take when they are imported, and sizes of files."""
    import resource

    with open("/proc/self/statm", encoding="ascii") as file:
        pages = int(file.read().split()[0])
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + SPARE, resource.RLIM_INFINITY))
    resource.setrlimit(resource.RLIMIT_FSIZE, (FILE_SIZE, resource.RLIM_INFINITY))


def _unreadable(text: str) -> str:
    """What is wrong with a message: too long, control characters, or characters that no encoding has; empty if nothing is."""
    from .doors import LONGEST

    if len(text) > LONGEST:
        return f"a message of {len(text)} characters"
    odd = sorted(
        {
            c
            for c in text
            if (c < " " and c != "\n")
            or "\x7f" <= c <= "\x9f"
            or "\ud800" <= c <= "\udfff"
            or c in "\u2028\u2029\u202e\u202d"
        }
    )
    return f"a message with the characters {odd!a}" if odd else ""


def _memory_error_in(problem: BaseException | None) -> bool:
    while problem is not None:
        if isinstance(problem, MemoryError):
            return True
        problem = problem.__cause__ or problem.__context__
    return False


def read(job: dict[str, Any], guard: Guard, seconds: float) -> dict[str, Any]:
    """Outcome of one file."""
    import twistwrench as tw

    from . import misdeeds
    from .doors import DOORS, Fault

    door = DOORS.get(job["door"]) or getattr(misdeeds, job["door"])
    ended, text, problems = "read", "", list[str]()
    linux = sys.platform.startswith("linux")
    if linux:
        _confine()
        _forget_peak()
    began = time.process_time()
    _limit(seconds)
    with guard.of(Path(job["folder"])), warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        try:
            door(Path(job["path"]))
        except tw.TwistWrenchError as error:
            ended, text = f"refused: {type(error).__name__}", str(error)
            if _memory_error_in(error):
                problems.append("asks for more memory than the limit")
        except Fault as fault:
            ended, text = "fault", str(fault)
            problems.append(str(fault))
        except BaseException as error:
            ended, text = f"outside the tree: {type(error).__name__}", str(error)
            problems.append(f"{type(error).__name__}: {error}"[:300])
    _limit(0)
    taken = time.process_time() - began
    problems += guard.found[:3]
    texts = [text, *(str(w.message) for w in said if issubclass(w.category, (tw.ModelWarning, tw.CacheWarning)))]
    problems += [wrong for each in texts if ended != "fault" and (wrong := _unreadable(each))]
    problems += ["a text of a file outside is in the message"] if any("SECRET" in each for each in texts) else []
    peak = _memory_now() if linux else 0
    if peak > MEMORY:
        problems.append(f"takes {peak / 2**20:.0f} MiB of memory")
    return {"ended": ended, "text": text[:2000], "problems": problems, "peak": peak, "seconds": taken}


def main() -> None:
    answers = os.fdopen(os.dup(1), "w", encoding="ascii")
    devnull = os.open(os.devnull, os.O_WRONLY)
    os.dup2(devnull, 1)  # what libraries print is not an answer
    scratch, outside, seconds = Path(sys.argv[1]), Path(sys.argv[2]), float(sys.argv[3])
    from . import doors  # noqa: F401

    guard = Guard(scratch, outside)
    for line in sys.stdin:
        answer = read(json.loads(line), guard, seconds)
        answers.write(json.dumps(answer) + "\n")
        answers.flush()


if __name__ == "__main__":
    main()
