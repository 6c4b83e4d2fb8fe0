"""Arrays of files in NumPy's formats, npy and npz; archives of ``simulate --npz`` are motions."""

from __future__ import annotations

import json
import math
import weakref
import zipfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from ...core.errors import TrajectoryError
from ...core.third_party import third_party_errors
from ...core.typing import Array
from ..column_names import STATES, SUFFIX, time_column
from ..log_table import check_ratio, slices
from .columnar_file import ArrayFile
from .file_ends import FileEnds
from .stored_array import StoredArray, check_unpacked, is_line


def array_header(file: BinaryIO) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Shape, True if columns are stored first, and type of an array in NumPy's format; leaves the file at the first number."""
    if np.lib.format.read_magic(file) == (1, 0):
        read_header = np.lib.format.read_array_header_1_0
    else:
        read_header = np.lib.format.read_array_header_2_0
    shape, columns_first, dtype = read_header(file)
    if any(length < 0 for length in shape):
        raise ValueError(f"a shape of {shape}")
    return shape, columns_first, dtype


def _stored_array(path: Path, open_file: Callable[[], BinaryIO]) -> StoredArray:
    """Array in NumPy's format, by rows; a column-major array (n, k) is read whole."""
    with open_file() as file:
        shape, columns_first, dtype = array_header(file)
        offset = file.tell()
    if is_line(shape):
        shape = (math.prod(shape),)
    is_read_whole = columns_first and len(shape) > 1
    if is_read_whole:
        check_unpacked(path, math.prod(shape) * max(_FLOAT64_SIZE, dtype.itemsize))  # float64 after reading
    row_count, *shape_of_row = shape or (0,)  # a single number has no rows
    bytes_per_row = dtype.itemsize * math.prod(shape_of_row)

    def read_portions(row_limit: int) -> Iterator[Array]:
        """Portions of up to ``row_limit`` rows."""
        with open_file() as file:
            if is_read_whole:
                array = np.lib.format.read_array(file, allow_pickle=False)
                for rows in slices(len(array), row_limit):
                    yield array[rows]
                return
            file.seek(offset)
            for rows in slices(row_count, row_limit):
                size = (rows.stop - rows.start) * bytes_per_row
                data = file.read(size)
                if len(data) < size:
                    raise TrajectoryError(
                        f"{path}: has fewer rows than the {row_count} of its header. Is the file cut short?"
                    )
                yield np.frombuffer(data, dtype).reshape(-1, *shape_of_row)

    return StoredArray(shape, dtype, read_portions)


def read_npy(file: FileEnds) -> tuple[Mapping[str, StoredArray], tuple[str, ...]]:
    """Array of an npy file, by the prefix of its columns' names; fields of an array are columns with names of their own."""
    array = _stored_array(file.path, file.open)
    has_fields = bool(array.dtype.names)
    prefix = "" if has_fields else "column"
    return {prefix: array}, ()


def read_npz(file: FileEnds) -> tuple[Mapping[str, StoredArray], tuple[str, ...]]:
    """Arrays of an npz file."""
    open_archives: weakref.WeakValueDictionary[Path, zipfile.ZipFile] = weakref.WeakValueDictionary()

    def get_archive() -> zipfile.ZipFile:
        """Archive that is open as long as one of its members is."""
        archive = open_archives.get(file.path)
        if archive is None:
            archive = zipfile.ZipFile(file.open())
            open_archives[file.path] = archive
        return archive

    def open_member(name: str) -> BinaryIO:
        return get_archive().open(name)  # type: ignore[return-value]

    arrays = {}
    archive = get_archive()  # this reference keeps it open while the headers are read
    for name in archive.namelist():
        if name.endswith(".npy"):
            arrays[name.removesuffix(".npy")] = _stored_array(file.path, partial(open_member, name))
    return arrays, ()


def check_archive(file: FileEnds) -> None:
    """Raise TrajectoryError if an archive of NumPy is far smaller than the arrays that their headers announce."""
    arrays, _ = read_npz(file)
    size = 0
    for array in arrays.values():
        size += math.prod(array.shape) * max(_FLOAT64_SIZE, array.dtype.itemsize)
    check_unpacked(file.path, size)
    check_ratio(file.path, size, file.size)


_FLOAT64_SIZE = 8
"""Size of a number as float64 [bytes]."""
_FORMAT_MARK = "twistwrench simulation"
"""Text at the beginning of the entry ``format`` of archives of ``simulate --npz``."""
_MAX_MARK_BYTES = 1 << 12
"""Largest number of bytes of the entry ``format`` that are read."""


def is_simulation(file: FileEnds) -> bool:
    """True if ``simulate --npz`` wrote the archive; also True if the archive cannot be read."""
    try:
        with file.open() as stream, zipfile.ZipFile(stream) as archive:
            if "format.npy" not in archive.namelist():
                return False
            with archive.open("format.npy") as entry:
                shape, _, dtype = array_header(entry)  # type: ignore[arg-type]
                data = entry.read(min(_MAX_MARK_BYTES, dtype.itemsize))
            encoding = "utf-32-be" if dtype.byteorder == ">" else "utf-32-le"
            is_single_text = shape == () and dtype.kind == "U"
            return is_single_text and data.decode(encoding).startswith(_FORMAT_MARK)
    except Exception:  # any NumPy error: the later read reports it
        return True


def simulation_file(file: FileEnds) -> ArrayFile:
    """Motion from an archive of ``simulate --npz``; raises TrajectoryError."""
    path = file.path
    advice = "Give one that a simulation wrote, whole, or a CSV file."
    unreadable = f"{path}: an archive that cannot be read as a motion"
    with third_party_errors(lambda reason: TrajectoryError(f"{unreadable}: {reason}. {advice}")):
        check_archive(file)
        with file.open() as stream, np.load(stream, allow_pickle=False) as archive:
            if not str(archive["format"]).startswith(_FORMAT_MARK):
                raise TrajectoryError(f"{path}: an archive of NumPy, but not one that a simulation wrote.")
            names = json.loads(str(archive["said"]))
            times = np.asarray(archive["times"], float)[:, None]
            header = [time_column(names["coordinate_names"])]
            blocks = [times]  # columns of the table
            for part in STATES:
                names_key = "coordinate_names" if part == "q" else "velocity_names"
                part_names = names[names_key]
                header += [f"{name}{SUFFIX[part]}" for name in part_names]
                blocks.append(np.asarray(archive[part], float).reshape(len(times), len(part_names)))
    motion = ArrayFile.from_table(path, header, np.concatenate(blocks, axis=1), file.size)
    return replace(motion, plan=True)  # computed, and not recorded
