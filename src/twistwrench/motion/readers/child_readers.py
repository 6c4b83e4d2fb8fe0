"""Readers of motion files with foreign C code, in a limited child process: Arrow, HDF5, SQLite and the packers of recordings.

A damaged or hostile file ends the child, and here in a TrajectoryError. Rows arrive in portions.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from ...core.child_process import ChildLimits, run_in_child, sandboxed, stream_from_child
from ...core.errors import TrajectoryError
from ...core.typing import Array
from ..log_table import most_unpacked, slices, table_of
from .array_files import array_file
from .columnar_file import ArrayFile, unreadable_rows
from .file_ends import FileEnds

_FOREIGN = (".h5", ".hdf5", ".parquet", ".feather", ".arrow")
_HDF5 = b"\x89HDF", b"MATLAB 7.3"
_SECONDS, _SECONDS_A_BYTE = 30.0, 1e-6
"""Processor time of a reader: constant, and per byte of the file [s]. Recordings of ROS take the longest, 1e-7 s."""
_MEMORY, _MEMORY_A_BYTE = 1 << 30, 32
"""Memory of a reader [bytes]: constant, and per byte of the file, for messages of ROS as objects of Python."""


def arrays_file(file: FileEnds, episode: int | None = None) -> ArrayFile:
    """Open a file of arrays: in a child process if a foreign library decodes it, and the sandbox is on."""
    foreign = file.path.suffix.lower() in _FOREIGN
    if file.path.suffix.lower() == ".mat":
        foreign = any(mark in file.start[:128] for mark in _HDF5)
    return array_file_in_child(file.path, episode) if foreign and sandboxed() else array_file(file, episode)


def recording_file(file: FileEnds, topic: str | None = None, command_topic: str | None = None) -> ArrayFile:
    """Open a recording of ROS: in a child process if the sandbox is on."""
    from .ros_recordings import ros_file

    return (ros_file_in_child if sandboxed() else ros_file)(file.path, topic, command_topic)


def array_file_in_child(path: Path, episode: int | None) -> ArrayFile:
    """As :func:`.array_file`, with the file decoded in a child process."""
    limits = _limits(path)
    suffix = path.suffix.lower()[1:]
    header, size, notes, dataset = run_in_child(
        f"{__name__}:head_of_arrays",
        str(path),
        episode,
        limits=limits,
        error_of=lambda reason: TrajectoryError(f"{path}: cannot be read as {suffix}: {reason}."),
    )

    def read(used: Sequence[int]) -> Iterator[Array]:
        row = 0
        portions = stream_from_child(
            f"{__name__}:rows_of_arrays",
            str(path),
            episode,
            tuple(used),
            limits=limits,
            error_of=lambda reason: unreadable_rows(path, row, reason),
        )
        for portion in portions:
            yield portion
            row += len(portion)

    return ArrayFile(path, tuple(header), size, read, tuple(notes), dataset=dataset)


def ros_file_in_child(path: Path, topic: str | None, command_topic: str | None = None) -> ArrayFile:
    """As :func:`.ros_file`, with the recording decoded in a child process."""
    items = stream_from_child(
        f"{__name__}:recording",
        str(path),
        topic,
        command_topic,
        limits=_limits(path),
        error_of=lambda reason: TrajectoryError(f"{path}: cannot be read as a recording of ROS: {reason}."),
    )
    header, size, notes, epoch, plan = next(items)
    table = table_of(items, len(header), path)
    read = partial(_columns_of, table)
    return ArrayFile(path, tuple(header), size, read, tuple(notes), epoch=epoch, plan=plan)


def _columns_of(table: Array, used: Sequence[int]) -> Iterator[Array]:
    return iter([table[:, list(used)]])


def _limits(path: Path) -> ChildLimits:
    size = 0
    if path.is_dir():
        size = sum(file.stat().st_size for file in path.iterdir() if file.is_file())
    elif path.is_file():
        size = path.stat().st_size
    return ChildLimits(
        _SECONDS + _SECONDS_A_BYTE * size, _MEMORY + _MEMORY_A_BYTE * size, output=2 * most_unpacked(size)
    )


# ── In the child


def head_of_arrays(path: str, episode: int | None) -> tuple[Any, ...]:
    """Header, size, notes and unit of a file of arrays."""
    file = _file_of_arrays(path, episode)
    return file.header, file.size, file.notes, file.dataset


def rows_of_arrays(path: str, episode: int | None, used: Sequence[int]) -> Iterator[Array]:
    """Portions of the rows of some columns."""
    return _file_of_arrays(path, episode).read(used)


def _file_of_arrays(path: str, episode: int | None) -> ArrayFile:
    return array_file(FileEnds.from_path(Path(path)), episode)


def recording(path: str, topic: str | None, command_topic: str | None) -> Iterator[Any]:
    """Header, size, notes, epoch and whether it is a plan, then portions of the rows of a recording."""
    from .ros_recordings import ros_file

    file = ros_file(Path(path), topic, command_topic)
    yield file.header, file.size, file.notes, file.epoch, file.plan
    (table,) = file.read(range(len(file.header)))
    for s in slices(len(table)):
        yield table[s]
