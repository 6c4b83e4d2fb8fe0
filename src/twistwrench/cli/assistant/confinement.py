"""Confinement of this process to one folder: what robot files, logs and options name elsewhere is neither read nor written.

An audit hook checks every file that the interpreter opens, in this process and in the child processes of readers. Beside the
folder, the installation and public files of the system are read, and the caches of compiled code and of fonts are written.
"""

from __future__ import annotations

import atexit
import errno
import os
import shutil
import site
import sys
import sysconfig
import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from ...core import child_process, object_cache
from ...core.errors import ValueRangeError

_WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
_CHANGES = {
    "os.chmod": 1, "os.chown": 1, "os.link": 2, "os.mkdir": 1, "os.remove": 1, "os.rename": 2, "os.rmdir": 1,
    "os.setxattr": 1, "os.symlink": 2, "os.truncate": 1, "os.utime": 1,
}  # fmt: skip
"""Audit events that change the file system, by the number of paths among their first arguments."""
_REFUSED = (
    "os.exec", "os.fork", "os.forkpty", "os.posix_spawn", "os.spawn", "os.startfile", "os.system", "pty.spawn",
    "socket.bind", "socket.connect", "socket.getaddrinfo", "socket.sendto", "webbrowser.open",
)  # fmt: skip
_PUBLIC = (
    "/usr", "/lib", "/lib64", "/dev/null", "/dev/urandom", "/etc/fonts", "/etc/localtime", "/etc/mime.types",
    "/proc/cpuinfo", "/proc/meminfo", "/proc/self/statm", "/sys/devices/system/cpu", "/System/Library", "/Library/Fonts",
    r"C:\Windows",
)  # fmt: skip
"""Files of the system that are the same for all users."""
_ENVIRONMENT = ("AMENT_PREFIX_PATH", "ROS_PACKAGE_PATH")
"""Environment variables with further folders of meshes."""


class Folder:
    """The folder that the files of a server lie in."""

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path).resolve()
        if not self.path.is_dir():
            raise ValueRangeError(f"{str(path)!r} is not a folder. Give the one with the robot files and logs.")

    def require(self, name: str, flag: str) -> None:
        """Raise ValueRangeError unless a path, or all files of a pattern or folder, lie in the folder, links resolved."""
        outside = (
            f"{flag} {name[:200]!r} lies outside the folder of this server, {str(self.path)!r}. Copy the file into it."
        )
        if name.startswith("~") or name == "-" or "\0" in name:
            raise ValueRangeError(
                f"{flag} {name[:200]!r} is not a path in the folder of this server, {str(self.path)!r}."
            )
        given = self.path / name
        if ".." in given.parts or any(not self._holds(path) for path in (given, *self._found(name))):
            raise ValueRangeError(outside)

    def _found(self, name: str) -> Iterable[Path]:
        """Files of a pattern, and all that a folder holds."""
        places = [self.path / name]
        if not Path(name).is_absolute() and any(sign in name for sign in "*?["):
            places = list(self.path.glob(name))
        for place in places:
            yield place
            if place.is_dir():
                yield from place.rglob("*")

    def _holds(self, path: Path) -> bool:
        try:
            return path.resolve().is_relative_to(self.path)
        except (OSError, RuntimeError):  # links in a circle
            return False

    def confine(self) -> None:
        """Confine this process and its children to the folder for good, and make it the working folder."""
        private = tempfile.mkdtemp(prefix="twistwrench-")
        atexit.register(shutil.rmtree, private, ignore_errors=True)
        own_folder = str(Path.cwd())
        readable = [*_PUBLIC, *_installation(own_folder), *_robots()]
        writable = [str(self.path), private, *_caches()]
        for name in _ENVIRONMENT:
            os.environ.pop(name, None)
        os.chdir(self.path)
        child_process.PREPARATIONS.append((f"{__name__}:confine", (readable, writable, private)))
        confine(readable, writable, private)


def confine(readable: Sequence[str], writable: Sequence[str], temporary: str) -> None:
    """Refuse files elsewhere, connections, and processes other than those of readers, until the process ends."""
    tempfile.tempdir = temporary
    sys.dont_write_bytecode = True
    sys.addaudithook(_Guard(readable, writable))


class _Guard:
    """Audit hook of the confinement."""

    def __init__(self, readable: Sequence[str], writable: Sequence[str]) -> None:
        self.writable = tuple(Path(path).resolve() for path in writable)
        self.readable = (*self.writable, *(Path(path).resolve() for path in readable))

    def __call__(self, event: str, args: tuple[Any, ...]) -> None:
        """Check one event of the interpreter."""
        if event == "open":
            path, mode, flags = args
            writes = bool(set(mode or "") & set("wxa+")) or bool((flags or 0) & _WRITES)
            self._check(path, self.writable if writes else self.readable)
        elif event in ("os.listdir", "os.scandir"):
            self._check(args[0], self.readable)
        elif event in _CHANGES:
            for path in args[: _CHANGES[event]]:
                self._check(path, self.writable)
        elif event in _REFUSED or (event == "subprocess.Popen" and args[0] != sys.executable):
            raise PermissionError(errno.EACCES, "this server opens no connections and starts no programs")

    def _check(self, path: Any, places: Sequence[Path]) -> None:
        if path is None or isinstance(path, int):  # the working folder, and files that are open
            return
        place = Path(os.fsdecode(path)).resolve()
        if str(place) != os.devnull and not any(place.is_relative_to(folder) for folder in places):
            raise PermissionError(errno.EACCES, "it lies outside the folder of this server", os.fsdecode(path))


def _installation(own_folder: str) -> list[str]:
    """Folders of Python, of this package and of those it uses."""
    own = [sys.prefix, sys.base_prefix, str(Path(__file__).parents[2]), *sysconfig.get_paths().values()]
    packages = [*site.getsitepackages(), site.getusersitepackages(), *sys.path]
    return [place for place in (*own, *packages) if place not in ("", os.sep, own_folder)]


def _robots() -> list[str]:
    """Folder of the robots that ``robot_descriptions`` has fetched."""
    return [os.environ.get("ROBOT_DESCRIPTIONS_CACHE") or str(Path("~/.cache/robot_descriptions").expanduser())]


def _caches() -> list[str]:
    """Folders that compiled code and lists of fonts are kept in."""
    fonts, code = os.environ.get("MPLCONFIGDIR"), object_cache.folder()
    folders = [str(Path.home() / ".cache" / "matplotlib"), str(Path.home() / ".config" / "matplotlib")]
    if fonts:
        folders = [fonts]
    if code is not None:
        folders.append(str(code))
    return folders
