"""Confinement of this process to one folder: files elsewhere, named by robot files, logs or options, stay untouched.

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

_WRITE_FLAGS = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
_WRITE_MODES = set("wxa+")
"""Letters of the mode of an opened file that may be written."""
_PATHS_OF_CHANGES = {
    "os.chmod": 1, "os.chown": 1, "os.link": 2, "os.mkdir": 1, "os.remove": 1, "os.rename": 2, "os.rmdir": 1,
    "os.setxattr": 1, "os.symlink": 2, "os.truncate": 1, "os.utime": 1,
}  # fmt: skip
"""Number of paths among the first arguments of each audit event that changes the file system."""
_REFUSED_EVENTS = (
    "os.exec", "os.fork", "os.forkpty", "os.posix_spawn", "os.spawn", "os.startfile", "os.system", "pty.spawn",
    "socket.bind", "socket.connect", "socket.getaddrinfo", "socket.sendto", "webbrowser.open",
)  # fmt: skip
"""Audit events that are always refused: connections, and programs other than the readers' processes."""
_PUBLIC_PATHS = (
    "/usr", "/lib", "/lib64", "/dev/null", "/dev/urandom", "/etc/fonts", "/etc/localtime", "/etc/mime.types",
    "/proc/cpuinfo", "/proc/meminfo", "/proc/self/statm", "/sys/devices/system/cpu", "/System/Library", "/Library/Fonts",
    r"C:\Windows",
)  # fmt: skip
"""Files of the system that are the same for all users."""
_MESH_VARIABLES = ("AMENT_PREFIX_PATH", "ROS_PACKAGE_PATH")
"""Environment variables with folders of meshes beside a robot file's own."""
_MAX_NAME_LENGTH = 200
"""Number of characters of a file name in a message."""


class Folder:
    """The folder that the files of a server lie in."""

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path).resolve()
        if not self.path.is_dir():
            raise ValueRangeError(f"{str(path)!r} is not a folder. Give the one with the robot files and logs.")

    def require(self, name: str, flag: str) -> None:
        """Raise ValueRangeError unless a path, or all files of a pattern or folder, lie in the folder, links resolved."""
        short_name = name[:_MAX_NAME_LENGTH]
        if name.startswith("~") or name == "-" or "\0" in name:
            raise ValueRangeError(
                f"{flag} {short_name!r} is not a path in the folder of this server, {str(self.path)!r}."
            )
        path = self.path / name  # an absolute name replaces the folder
        is_inside = ".." not in path.parts
        if is_inside:
            is_inside = all(self._contains(file) for file in (path, *self._matching_files(name)))
        if not is_inside:
            raise ValueRangeError(
                f"{flag} {short_name!r} lies outside the folder of this server, {str(self.path)!r}. Copy the file into it."
            )

    def _matching_files(self, name: str) -> Iterable[Path]:
        """Paths that a name or a pattern stands for, and all files in them if they are folders."""
        paths = [self.path / name]
        is_pattern = any(sign in name for sign in "*?[")
        if is_pattern and not Path(name).is_absolute():
            paths = list(self.path.glob(name))
        for path in paths:
            yield path
            if path.is_dir():
                yield from path.rglob("*")

    def _contains(self, path: Path) -> bool:
        """True if the path lies in the folder, links resolved."""
        try:
            return path.resolve().is_relative_to(self.path)
        except (OSError, RuntimeError):  # links in a circle
            return False

    def confine(self) -> None:
        """Confine this process and its children to the folder for good, and make it the working folder."""
        temporary_folder = tempfile.mkdtemp(prefix="twistwrench-")
        atexit.register(shutil.rmtree, temporary_folder, ignore_errors=True)
        working_folder = str(Path.cwd())
        readable_paths = [*_PUBLIC_PATHS, *_installation(working_folder), *_fetched_robots()]
        writable_paths = [str(self.path), temporary_folder, *_caches()]
        for name in _MESH_VARIABLES:
            os.environ.pop(name, None)
        os.chdir(self.path)
        arguments = (readable_paths, writable_paths, temporary_folder)
        child_process.PREPARATIONS.append((f"{__name__}:confine", arguments))
        confine(*arguments)


def confine(readable_paths: Sequence[str], writable_paths: Sequence[str], temporary_folder: str) -> None:
    """Refuse files elsewhere, connections, and processes other than those of readers, until the process ends."""
    tempfile.tempdir = temporary_folder
    sys.dont_write_bytecode = True
    sys.addaudithook(_Guard(readable_paths, writable_paths))


class _Guard:
    """Audit hook of the confinement."""

    def __init__(self, readable_paths: Sequence[str], writable_paths: Sequence[str]) -> None:
        self.writable_folders = tuple(Path(path).resolve() for path in writable_paths)
        self.readable_folders = (*self.writable_folders, *(Path(path).resolve() for path in readable_paths))

    def __call__(self, event: str, args: tuple[Any, ...]) -> None:
        """Check one event of the interpreter."""
        if event == "open":
            path, mode, flags = args
            writes_by_mode = mode is not None and not _WRITE_MODES.isdisjoint(mode)
            writes_by_flags = flags is not None and bool(flags & _WRITE_FLAGS)
            writes = writes_by_mode or writes_by_flags
            self._check(path, self.writable_folders if writes else self.readable_folders)
        elif event in ("os.listdir", "os.scandir"):
            folder = args[0]
            self._check(folder, self.readable_folders)
        elif event in _PATHS_OF_CHANGES:
            path_count = _PATHS_OF_CHANGES[event]
            for path in args[:path_count]:
                self._check(path, self.writable_folders)
        else:
            starts_program = event == "subprocess.Popen" and args[0] != sys.executable  # readers are Python processes
            if event in _REFUSED_EVENTS or starts_program:
                raise PermissionError(errno.EACCES, "this server opens no connections and starts no programs")

    def _check(self, path: Any, folders: Sequence[Path]) -> None:
        """Raise PermissionError unless the path lies in one of the folders."""
        if path is None or isinstance(path, int):  # the working folder, and files that are open
            return
        resolved = Path(os.fsdecode(path)).resolve()
        is_allowed = str(resolved) == os.devnull or any(resolved.is_relative_to(folder) for folder in folders)
        if not is_allowed:
            raise PermissionError(errno.EACCES, "it lies outside the folder of this server", os.fsdecode(path))


def _installation(working_folder: str) -> list[str]:
    """Folders of Python, of this package and of packages it uses. The working folder, which sys.path may have, is left out."""
    python = [sys.prefix, sys.base_prefix, *sysconfig.get_paths().values()]
    this_package = str(Path(__file__).parents[2])
    packages = [this_package, *site.getsitepackages(), site.getusersitepackages(), *sys.path]
    return [folder for folder in (*python, *packages) if folder not in ("", os.sep, working_folder)]


def _fetched_robots() -> list[str]:
    """Folder of the robots that ``robot_descriptions`` has fetched."""
    return [os.environ.get("ROBOT_DESCRIPTIONS_CACHE") or str(Path("~/.cache/robot_descriptions").expanduser())]


def _caches() -> list[str]:
    """Folders that compiled code and lists of fonts are kept in."""
    font_folder = os.environ.get("MPLCONFIGDIR")
    if font_folder:
        folders = [font_folder]
    else:
        folders = [str(Path.home() / ".cache" / "matplotlib"), str(Path.home() / ".config" / "matplotlib")]
    code_folder = object_cache.folder()
    if code_folder is not None:
        folders.append(str(code_folder))
    return folders
