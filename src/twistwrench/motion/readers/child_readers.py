"""Readers of motion files with foreign C code, in a limited child process: Arrow, HDF5, SQLite and the packers of recordings.

A damaged or hostile file may end the child, but not this process, which raises a TrajectoryError. Rows arrive in
portions.
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

_FOREIGN_SUFFIXES = (".h5", ".hdf5", ".parquet", ".feather", ".arrow")
"""Suffixes of files that a foreign library decodes."""
_HDF5_MARKS = (b"\x89HDF", b"MATLAB 7.3")
"""A MAT file is an HDF5 file if one of these texts is in its header."""
_MAT_HEADER_BYTES = 128
"""Length of the header of a MAT file."""
_BASE_SECONDS = 30.0
"""Processor time that each reader may take [s]."""
_SECONDS_PER_BYTE = 1e-6
"""Further processor time for each byte of the file [s]. ROS recordings take the longest, 1e-7 s."""
_BASE_MEMORY = 1 << 30
"""Memory that each reader may take [bytes]."""
_MEMORY_PER_BYTE = 32
"""Further memory for each byte of the file [bytes], for ROS messages as Python objects."""


def arrays_file(file: FileEnds, episode: int | None = None) -> ArrayFile:
    """Open a file of arrays, in a child process if a foreign library decodes it and the sandbox is on."""
    suffix = file.path.suffix.lower()
    if suffix == ".mat":
        is_foreign = any(mark in file.start[:_MAT_HEADER_BYTES] for mark in _HDF5_MARKS)
    else:
        is_foreign = suffix in _FOREIGN_SUFFIXES
    if is_foreign and sandboxed():
        return array_file_in_child(file.path, episode)
    return array_file(file, episode)


def recording_file(file: FileEnds, topic: str | None = None, command_topic: str | None = None) -> ArrayFile:
    """Open a recording of ROS, in a child process if the sandbox is on."""
    from .ros_recordings import ros_file

    if sandboxed():
        return ros_file_in_child(file.path, topic, command_topic)
    return ros_file(file.path, topic, command_topic)


def array_file_in_child(path: Path, episode: int | None) -> ArrayFile:
    """As :func:`.array_file`, with the file decoded in a child process."""
    limits = _limits(path)
    suffix = path.suffix.lower().removeprefix(".")
    header, size, notes, dataset = run_in_child(
        f"{__name__}:head_of_arrays",
        str(path),
        episode,
        limits=limits,
        error_of=lambda reason: TrajectoryError(f"{path}: cannot be read as {suffix}: {reason}."),
    )

    def read_portions(used_columns: Sequence[int]) -> Iterator[Array]:
        row = 0  # first row that has not arrived; errors name it
        portions = stream_from_child(
            f"{__name__}:rows_of_arrays",
            str(path),
            episode,
            tuple(used_columns),
            limits=limits,
            error_of=lambda reason: unreadable_rows(path, row, reason),
        )
        for portion in portions:
            yield portion
            row += len(portion)

    return ArrayFile(path, tuple(header), size, read_portions, tuple(notes), dataset=dataset)


def ros_file_in_child(path: Path, topic: str | None, command_topic: str | None = None) -> ArrayFile:
    """As :func:`.ros_file`, with the recording decoded in a child process."""
    stream = stream_from_child(  # what :func:`recording` yields in the child
        f"{__name__}:recording",
        str(path),
        topic,
        command_topic,
        limits=_limits(path),
        error_of=lambda reason: TrajectoryError(f"{path}: cannot be read as a recording of ROS: {reason}."),
    )
    header, size, notes, epoch, plan = next(stream)  # the rows follow
    table = table_of(stream, len(header), path)
    read_portions = partial(_columns_of, table)
    return ArrayFile(path, tuple(header), size, read_portions, tuple(notes), epoch=epoch, plan=plan)


def _columns_of(table: Array, used_columns: Sequence[int]) -> Iterator[Array]:
    """Columns of a table, as a single portion."""
    return iter([table[:, list(used_columns)]])


def _limits(path: Path) -> ChildLimits:
    """Limits of a child that reads a file, or the files of a folder."""
    size = 0
    if path.is_dir():
        size = sum(file.stat().st_size for file in path.iterdir() if file.is_file())
    elif path.is_file():
        size = path.stat().st_size
    processor_time = _BASE_SECONDS + _SECONDS_PER_BYTE * size
    memory = _BASE_MEMORY + _MEMORY_PER_BYTE * size
    return ChildLimits(processor_time, memory, output=2 * most_unpacked(size))


# ── In the child


def head_of_arrays(path: str, episode: int | None) -> tuple[Any, ...]:
    """Header, size, notes and dataset of a file of arrays, as :class:`ArrayFile` has them."""
    file = _file_of_arrays(path, episode)
    return file.header, file.size, file.notes, file.dataset


def rows_of_arrays(path: str, episode: int | None, used: Sequence[int]) -> Iterator[Array]:
    """Rows of the ``used`` columns, by index, in portions."""
    return _file_of_arrays(path, episode).read(used)


def _file_of_arrays(path: str, episode: int | None) -> ArrayFile:
    return array_file(FileEnds.from_path(Path(path)), episode)


def recording(path: str, topic: str | None, command_topic: str | None) -> Iterator[Any]:
    """Yield a tuple of header, size, notes, epoch and plan of a recording, then its rows in portions."""
    from .ros_recordings import ros_file

    file = ros_file(Path(path), topic, command_topic)
    yield file.header, file.size, file.notes, file.epoch, file.plan
    (table,) = file.read(range(len(file.header)))  # recordings are read as one portion
    for rows in slices(len(table)):
        yield table[rows]
