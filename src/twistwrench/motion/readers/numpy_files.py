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
    """Shape, column-major flag and type of an array in NumPy's format; leaves the file at the first number."""
    read = np.lib.format.read_array_header_2_0
    if np.lib.format.read_magic(file) == (1, 0):
        read = np.lib.format.read_array_header_1_0
    shape, columns_first, dtype = read(file)
    if any(n < 0 for n in shape):
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
        check_unpacked(path, math.prod(shape) * max(8, dtype.itemsize))
    rows, *inner = shape or (0,)
    width = dtype.itemsize * math.prod(inner)

    def portions(row_limit: int) -> Iterator[Array]:
        with open_file() as file:
            if is_read_whole:
                x = np.lib.format.read_array(file, allow_pickle=False)
                yield from (x[s] for s in slices(len(x), row_limit))
                return
            file.seek(offset)
            for s in slices(rows, row_limit):
                data = file.read((s.stop - s.start) * width)
                if len(data) < (s.stop - s.start) * width:
                    raise TrajectoryError(
                        f"{path}: has fewer rows than the {rows} of its header. Is the file cut short?"
                    )
                yield np.frombuffer(data, dtype).reshape(-1, *inner)

    return StoredArray(shape, dtype, portions)


def read_npy(file: FileEnds) -> tuple[Mapping[str, StoredArray], tuple[str, ...]]:
    """Array of an npy file; columns of an array with fields have the names of these."""
    array = _stored_array(file.path, file.open)
    return {"" if array.dtype.names else "column": array}, ()


def read_npz(file: FileEnds) -> tuple[Mapping[str, StoredArray], tuple[str, ...]]:
    """Arrays of an npz file."""
    opened: weakref.WeakValueDictionary[Path, zipfile.ZipFile] = weakref.WeakValueDictionary()

    def archive() -> zipfile.ZipFile:
        """Archive that is open as long as one of its members is."""
        return opened.get(file.path) or opened.setdefault(file.path, zipfile.ZipFile(file.open()))

    def member(name: str) -> BinaryIO:
        return archive().open(name)  # type: ignore[return-value]

    arrays = {}
    open_archive = archive()  # keeps the archive open meanwhile
    for name in open_archive.namelist():
        if name.endswith(".npy"):
            arrays[name.removesuffix(".npy")] = _stored_array(file.path, partial(member, name))
    return arrays, ()


def check_archive(file: FileEnds) -> None:
    """Raise TrajectoryError if the arrays of an archive of NumPy, by their headers, are out of proportion to the file."""
    arrays, _ = read_npz(file)
    size = sum(math.prod(array.shape) * max(8, array.dtype.itemsize) for array in arrays.values())
    check_unpacked(file.path, size)
    check_ratio(file.path, size, file.size)


_MARK = "twistwrench simulation"
_MARK_BYTES = 1 << 12
"""Text at the beginning of the entry ``format`` of archives of ``simulate --npz``, and bytes of it that are read."""


def is_simulation(file: FileEnds) -> bool:
    """True if ``simulate --npz`` wrote the archive; also True if the archive cannot be read."""
    try:
        with file.open() as whole, zipfile.ZipFile(whole) as archive:
            if "format.npy" not in archive.namelist():
                return False
            with archive.open("format.npy") as mark:
                shape, _, dtype = array_header(mark)  # type: ignore[arg-type]
                text = mark.read(min(_MARK_BYTES, dtype.itemsize))
            coding = "utf-32-be" if dtype.byteorder == ">" else "utf-32-le"
            return shape == () and dtype.kind == "U" and text.decode(coding).startswith(_MARK)
    except Exception:  # any NumPy error: the later read reports it
        return True


def simulation_file(file: FileEnds) -> ArrayFile:
    """Motion from an archive of ``simulate --npz``; raises TrajectoryError."""
    path = file.path
    advice = "Give one that a simulation wrote, whole, or a CSV file."
    unreadable = f"{path}: an archive that cannot be read as a motion"
    with third_party_errors(lambda reason: TrajectoryError(f"{unreadable}: {reason}. {advice}")):
        check_archive(file)
        with file.open() as whole, np.load(whole, allow_pickle=False) as archive:
            if not str(archive["format"]).startswith(_MARK):
                raise TrajectoryError(f"{path}: an archive of NumPy, but not one that a simulation wrote.")
            names = json.loads(str(archive["said"]))
            times = np.asarray(archive["times"], float)[:, None]
            columns, header = [times], [time_column(names["coordinate_names"])]
            for part in STATES:
                part_names = names["coordinate_names" if part == "q" else "velocity_names"]
                header += [f"{name}{SUFFIX[part]}" for name in part_names]
                columns.append(np.asarray(archive[part], float).reshape(len(times), len(part_names)))
    motion = ArrayFile.from_table(path, header, np.concatenate(columns, axis=1), file.size)
    return replace(motion, plan=True)  # computed, and not recorded
