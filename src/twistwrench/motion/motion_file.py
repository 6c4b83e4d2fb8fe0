"""Motion files of any format as columns with names, before a robot is known; several files as one, ``a.csv+b.csv``.

:mod:`.motion_log` assigns the columns to the coordinates of a robot.
Equal column names of several files get the quantity in their file's name: ``Joint_1`` of ``pos_data.csv`` and
``curr_data.csv`` become ``Joint_1`` and ``Joint_1.torque``. Without one, the file's name is prefixed: ``left:Joint_1``.
"""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from ..core.errors import TrajectoryError, TwistWrenchError
from ..core.files import as_path
from ..core.text import Argument
from ..core.typing import Array
from ..mechanics.model.model import Model
from .column_names import PART_OF, SUFFIX, split_unit, time_factor, time_meaning, unit_since_1970
from .columns import absent_joints
from .coordinates import Coordinates
from .log_table import slices, table_of
from .readers import format_of
from .readers.columnar_file import ArrayFile
from .readers.csv_reader import CsvFile
from .readers.file_ends import FileEnds

JOINS = "+"
_PART_OF = PART_OF | dict.fromkeys(("curr", "current", "currents"), "tau")
"""Quantities by words in a file name."""
_SAME_STAMPS = 1e-6
"""Tolerance of equal stamps [s]."""


@dataclass(frozen=True, eq=False)
class JoinedFile:
    """Files of one motion, joined by columns."""

    path: Path
    header: tuple[str, ...]
    parts: tuple[MotionFile, ...]
    places: tuple[tuple[int, int], ...]
    """File index and column index of each column of the header."""
    stamps: tuple[int | None, ...]
    """Time column of each file."""
    size: int
    notes: tuple[str, ...] = ()

    @classmethod
    def open(cls, path: str | Path, reader: Callable[[str], MotionFile]) -> JoinedFile:
        """Open the files in ``a.csv+b.csv``; raises TrajectoryError and the errors of their readers."""
        names = [name.strip() for name in str(path).split(JOINS)]
        if not all(names):
            raise TrajectoryError(
                f"{path}: files of one motion are written a.csv{JOINS}b.csv, with a name on both sides."
            )
        parts = tuple(map(reader, names))
        stamps = tuple(_time_of(part.header) for part in parts)
        if None in stamps and {*stamps} != {None}:
            without_time = parts[stamps.index(None)]
            raise TrajectoryError(
                f"{without_time.path}: has no column of time, and the file it is joined with has one. Both need one, or "
                "neither."
            )
        places, cells, size, notes = [], list[str](), 0, list[str]()
        for k, part in enumerate(parts):
            size += part.size
            notes += part.notes
            for column, cell in enumerate(part.header):
                if k == 0 or column != stamps[k]:
                    places.append((k, column))
                    cells.append(cell)
        count = Counter(cells)
        header = []
        for cell, (k, _) in zip(cells, places, strict=True):
            if cell and count[cell] > 1:
                cell = _distinct_name(cell, parts[k].path)
            header.append(cell)
        return cls(Path(str(path)), tuple(header), parts, tuple(places), stamps, size, tuple(notes))

    def check_columns(self) -> None:
        """Raise TrajectoryError if all files have the same columns, which means several logs of one robot."""
        cells = frozenset(self.parts[0].header)
        names = []
        for part in self.parts:
            if cells != {*part.header}:
                return
            if any(":" not in _distinct_name(cell, part.path) for cell in cells):  # the file's name has a quantity
                return
            names.append(str(part.path))
        raise TrajectoryError(
            f"{self.path}: the files have the same columns, as several logs have. '+' joins the columns of one motion. "
            f"Give logs one by one: {' '.join(names)}"
        )

    def table(self, used: Sequence[int]) -> Array:
        """Table (n, len(used)) of the given columns, resampled at the stamps of the first file if stamps differ."""
        requested = np.array(self.places, int).reshape(-1, 2)[list(used)]
        file_of, column_of = requested.T
        tables, times = list[Array](), list[Array | None]()
        for k, (part, stamp) in enumerate(zip(self.parts, self.stamps, strict=True)):
            columns = column_of[file_of == k].tolist()
            if stamp is None:
                times.append(None)
                tables.append(part.table(columns))
            else:
                table = part.table([*columns, stamp])
                times.append(table[:, -1] * _seconds(part.header[stamp], table[:, -1]))
                tables.append(table[:, :-1])
        common = self._common_rows(tables, times)
        order = _requested_order(file_of)
        first = times[0]
        other_stamps = list(times)
        """Stamps of each file; None if its rows are those of the first file."""
        for k, time in enumerate(times):
            if _same_stamps(time, first):
                other_stamps[k] = None

        def portions() -> Iterator[Array]:
            for s in slices(len(common)):
                rows = np.arange(s.start, s.stop)[common[s]]
                if rows.size:
                    parts = []
                    for table, stamps in zip(tables, other_stamps, strict=True):
                        if stamps is None or first is None:
                            parts.append(table[rows])
                        else:
                            parts.append(_resample(table, stamps, first[rows]))
                    yield np.concatenate(parts, axis=1)[:, order]

        return table_of(portions(), len(used), self.path)

    def first(self, column: int) -> Array:
        """First numbers of a column."""
        file, own = self.places[column]
        return self.parts[file].first(own)

    def place(self, row: int) -> str:
        """Description of a row's place, ``row 3``."""
        return f"row {row + 1}"

    def _common_rows(self, tables: list[Array], times: list[Array | None]) -> Array:
        """Mask (n,) of rows of the first file within the times of all others; raises TrajectoryError on mismatch."""
        first = times[0]
        if first is None:
            if len({*map(len, tables)}) == 1:
                return np.ones(len(tables[0]), bool)
            counts = [f"{part.path.name} {len(table)}" for part, table in zip(self.parts, tables, strict=True)]
            raise TrajectoryError(
                f"{self.path}: files without a time are joined row by row, and their rows differ: {', '.join(counts)}. Cut "
                "them alike, or give each a column of time."
            )
        begin, end = -np.inf, np.inf
        for stamps in times:
            if stamps is not None and len(stamps):
                begin, end = max(begin, float(stamps[0])), min(end, float(stamps[-1]))
        common = (first >= begin) & (first <= end)
        if not common.any():
            raise TrajectoryError(
                f"{self.path}: the stamps of the files do not overlap, so they are not one recording."
            )
        return np.asarray(common)


def _same_stamps(time: Array | None, first: Array | None) -> bool:
    """True if stamps are equal within their tolerance, or if there are none."""
    if time is None or first is None:
        return True
    return len(time) == len(first) and bool(np.abs(time - first).max() <= _SAME_STAMPS)


def _resample(table: Array, time: Array, new_times: Array) -> Array:
    """Interpolate a table (n, k) with stamps (n,) at increasing times (m,)."""
    begin = max(0, int(np.searchsorted(time, new_times[0])) - 1)
    end = int(np.searchsorted(time, new_times[-1], side="right")) + 1
    columns = [np.interp(new_times, time[begin:end], x) for x in table[begin:end].T]
    return np.array(columns).reshape(-1, len(new_times)).T


def _requested_order(file_of: Array) -> Array:
    """Permutation of columns from the order of files to the requested one; ``file_of`` are the files of the columns."""
    return np.argsort(np.argsort(file_of, kind="stable"), kind="stable")


def _time_of(header: Sequence[str]) -> int | None:
    """Most certain time column of a file."""
    ranks = {}
    for k, cell in enumerate(header):
        meaning = time_meaning(split_unit(cell)[0])
        if meaning is not None:
            ranks[k] = meaning[0]
    return min(ranks, key=ranks.__getitem__, default=None)


def _seconds(cell: str, stamps: Array) -> float:
    """Factor of a time column to seconds, by its name, or by its numbers if they count from 1970."""
    name, unit = split_unit(cell)
    meaning = time_meaning(name)
    if not unit and meaning is not None:
        unit = meaning[1]
    return time_factor(unit or unit_since_1970(stamps) or "s") or 1.0


def _distinct_name(cell: str, path: Path) -> str:
    """Name of a column that several files have: with the suffix of the quantity in the file's name, else after that name."""
    stem = path.name.split(".")[0]
    words = re.findall(r"[^\W\d_]+", stem.casefold())
    suffixes = {SUFFIX[_PART_OF[word]] for word in words if word in _PART_OF}
    if len(suffixes) != 1:
        return f"{stem}:{cell}"
    name, unit = split_unit(cell)
    return _with_unit(name + suffixes.pop(), unit)


def _with_unit(name: str, unit: str | None) -> str:
    """Name of a column with its unit in brackets, if it has one."""
    if not unit:
        return name
    return f"{name} [{unit}]"


MotionFile = CsvFile | ArrayFile | JoinedFile


def open_motion_file(
    path: str | Path, topic: str | None = None, episode: int | None = None, command_topic: str | None = None
) -> MotionFile:
    """Open a motion file for any robot: CSV, arrays, tables, ROS recordings, or several files, ``a.csv+b.csv``.

    ``topic`` selects a topic of a ROS recording, ``command_topic`` that of its commands, and ``episode`` an episode of a
    LeRobot dataset. Raises TrajectoryError, NotFoundError and MissingExtraError.
    """
    place = as_path(path)
    if JOINS in str(path) and not os.path.exists(place):  # noqa: PTH110  False if the text cannot be a path
        return JoinedFile.open(
            path, partial(open_motion_file, topic=topic, episode=episode, command_topic=command_topic)
        )
    ends = FileEnds.from_path(place)
    form = format_of(place, ends.start)
    chosen_options: dict[str, Any] = {}
    for name, value in (("topic", topic), ("command_topic", command_topic), ("episode", episode)):
        if value is None:
            continue
        chosen_options[name] = value
        if form is None or name not in form.options:
            raise TrajectoryError(f"{path}: {_PURPOSES[name]}, and this is none. Leave it out.", Argument(name))
    if form is None:
        return CsvFile.open(ends)
    module, function = form.opener.split(":")
    opener = getattr(import_module(f".readers.{module}", __package__), function)
    opened: MotionFile = opener(ends, **chosen_options)
    return opened


_PURPOSES = {
    "topic": "{0} is for recordings of ROS",
    "command_topic": "{0} is for recordings of ROS",
    "episode": "{0} is for LeRobot datasets in parquet",
}


def text_columns(file: MotionFile) -> tuple[int, ...]:
    """Columns of a file that hold words in place of numbers; arrays and recordings leave these out of their header."""
    if isinstance(file, CsvFile):
        return file.text_columns()
    if isinstance(file, JoinedFile):
        columns_of = [text_columns(part) for part in file.parts]
        columns = []
        for k, (part, column) in enumerate(file.places):
            if column in columns_of[part]:
                columns.append(k)
        return tuple(columns)
    return ()


def with_sums(file: MotionFile, columns: Mapping[str, str]) -> MotionFile:
    """Append the sums in ``columns``, such as ``J3+J2`` or ``J3-J2``, to the file's columns."""
    sums = _sums(file, columns)
    if not sums:
        return file
    header, terms_of = list(file.header), list[Terms]()
    for k in range(len(header)):
        terms_of.append([(k, 1.0)])
    for name, terms in sums.items():
        terms_of.append(terms)
        _, unit = split_unit(file.header[terms[0][0]])
        header.append(_with_unit(name, unit))

    def read(used: Sequence[int]) -> Iterator[Array]:
        required = set[int]()
        for column in used:
            required.update(dict(terms_of[column]))
        columns = sorted(required)
        table = file.table(columns)
        for s in slices(len(table)):
            totals = np.zeros((len(table[s]), len(used)))
            for total, column in zip(totals.T, used, strict=True):
                for k, sign in terms_of[column]:
                    total += sign * table[s, columns.index(k)]
            yield totals

    if isinstance(file, ArrayFile):
        return replace(file, header=tuple(header), read=read)
    return ArrayFile(file.path, tuple(header), file.size, read, file.notes)


Terms = list[tuple[int, float]]
"""Terms of a sum of columns: index and sign."""
_SIGNS = {"": 1.0, "+": 1.0, "-": -1.0}


def _sums(file: MotionFile, columns: Mapping[str, str]) -> dict[str, Terms]:
    """Sums of columns by their names. Raises TrajectoryError for columns of several units."""
    indices: dict[str, int] = {}
    for k, cell in enumerate(file.header):
        indices.setdefault(split_unit(cell)[0], k)
    sums = {}
    for name in columns.values():
        parts = re.findall(r"(^|[+-])([^+-]+)", name)
        terms, units = [], set()
        for sign, part in parts:
            column = indices.get(split_unit(part)[0])
            if column is not None:
                terms.append((column, _SIGNS[sign]))
                units.add(split_unit(file.header[column])[1])
        if split_unit(name)[0] in indices or len(parts) < 2 or len(terms) < len(parts):
            continue
        sums[name] = terms
        if len(units) > 1:
            raise TrajectoryError(f"{file.path}: the columns of {name} have several units. Add columns of one unit.")
    return sums


def moves_motors(path: str | Path | MotionFile) -> bool:
    """True if the file has columns for the motors of elastic joints; False if it cannot be opened."""
    try:
        header = _opened_file(path).header
    except TwistWrenchError:
        return False
    return any(name.strip().endswith(".motor") for name in header)


def _opened_file(file: str | Path | MotionFile) -> MotionFile:
    """The file, opened if it is a path."""
    if isinstance(file, str | Path):
        return open_motion_file(file)
    return file


def joints_without_column(
    path: str | Path | MotionFile, model: Model, columns: Mapping[str, str] | None = None
) -> tuple[str, ...]:
    """Joints of a model without a column in the file's header; ``columns`` as in :meth:`MotionLog.open`."""
    file = _opened_file(path)
    joints = [b.joint.name for b in model.leaders if b.joint.nv]
    return absent_joints(file.header, Coordinates.from_model(model), joints, columns or {}, file.path)
