"""Motion files of any format as columns with names, before a robot is known; several files as one, ``a.csv+b.csv``.

:mod:`.motion_log` assigns the columns to the coordinates of a robot. Equal column names of several files get the quantity
in their file's name: ``Joint_1`` of ``pos_data.csv`` and ``curr_data.csv`` become ``Joint_1`` and ``Joint_1.torque``. If
the file's name has no quantity, it is prefixed: ``left:Joint_1``.
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
"""Separator of the names of several files of one motion."""
_PART_OF_FILE_WORD = PART_OF | dict.fromkeys(("curr", "current", "currents"), "tau")
"""Quantities by words in a file name."""
_STAMP_TOLERANCE = 1e-6
"""Tolerance of equal stamps [s]."""


@dataclass(frozen=True, eq=False)
class JoinedFile:
    """Files of one motion, joined by columns."""

    path: Path
    header: tuple[str, ...]
    parts: tuple[MotionFile, ...]
    places: tuple[tuple[int, int], ...]
    """File index, and column index in that file, of each column of the header."""
    stamps: tuple[int | None, ...]
    """Index of each file's time column; None for files without one."""
    size: int
    """Size of all files [bytes]."""
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
        time_columns = tuple(_time_column_of(part.header) for part in parts)
        only_some_have_time = None in time_columns and {*time_columns} != {None}
        if only_some_have_time:
            part_without_time = parts[time_columns.index(None)]
            raise TrajectoryError(
                f"{part_without_time.path}: has no column of time, and the file it is joined with has one. Both need one, or "
                "neither."
            )
        places: list[tuple[int, int]] = []
        cells: list[str] = []
        notes: list[str] = []
        for file_index, part in enumerate(parts):
            notes += part.notes
            for column, cell in enumerate(part.header):
                is_repeated_time = file_index > 0 and column == time_columns[file_index]
                if not is_repeated_time:
                    places.append((file_index, column))
                    cells.append(cell)
        cell_counts = Counter(cells)
        header = []
        for cell, (file_index, _) in zip(cells, places, strict=True):
            name = cell
            if cell and cell_counts[cell] > 1:
                name = _distinct_name(cell, parts[file_index].path)
            header.append(name)
        size = sum(part.size for part in parts)
        return cls(Path(str(path)), tuple(header), parts, tuple(places), time_columns, size, tuple(notes))

    def check_columns(self) -> None:
        """Raise TrajectoryError if all files have the same columns: they are several logs of one robot."""
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
        """Table (n, len(used)) of the columns ``used``, resampled at the stamps of the first file if stamps differ."""
        all_places = np.array(self.places, int).reshape(-1, 2)  # also without columns
        file_of_column, column_in_file = all_places[list(used)].T
        tables: list[Array] = []
        times: list[Array | None] = []
        for file_index, (part, stamp_column) in enumerate(zip(self.parts, self.stamps, strict=True)):
            columns = column_in_file[file_of_column == file_index].tolist()
            if stamp_column is None:
                times.append(None)
                tables.append(part.table(columns))
            else:
                table = part.table([*columns, stamp_column])
                stamps = table[:, -1]  # requested last
                times.append(stamps * _seconds_per_unit(part.header[stamp_column], stamps))
                tables.append(table[:, :-1])
        is_common = self._common_rows(tables, times)
        order = _requested_order(file_of_column)
        first_times = times[0]
        # Times of each file that is resampled; None if its rows are those of the first file.
        resampled_times = [None if _have_same_stamps(time, first_times) else time for time in times]

        def joined_portions() -> Iterator[Array]:
            """Portions of the table, with the columns in the order of ``used``."""
            for block in slices(len(is_common)):
                rows = np.arange(block.start, block.stop)[is_common[block]]
                if not rows.size:
                    continue
                portion_by_file = []
                for table, own_times in zip(tables, resampled_times, strict=True):
                    if own_times is None or first_times is None:
                        portion_by_file.append(table[rows])
                    else:
                        portion_by_file.append(_resample(table, own_times, first_times[rows]))
                portion = np.concatenate(portion_by_file, axis=1)
                yield portion[:, order]

        return table_of(joined_portions(), len(used), self.path)

    def first(self, column: int) -> Array:
        """First few numbers of a column."""
        file_index, column_in_file = self.places[column]
        return self.parts[file_index].first(column_in_file)

    def place(self, row: int) -> str:
        """Place of a row in words: ``row 3`` for index 2."""
        return f"row {row + 1}"

    def _common_rows(self, tables: list[Array], times: list[Array | None]) -> Array:
        """True for the rows (n,) of the first file within the times of all others; raises TrajectoryError if there are none."""
        first_times = times[0]
        if first_times is None:
            if len({*map(len, tables)}) == 1:
                return np.ones(len(tables[0]), bool)
            counts = [f"{part.path.name} {len(table)}" for part, table in zip(self.parts, tables, strict=True)]
            raise TrajectoryError(
                f"{self.path}: files without a time are joined row by row, and their rows differ: {', '.join(counts)}. Cut "
                "them alike, or give each a column of time."
            )
        begin, end = -np.inf, np.inf
        for own_times in times:
            if own_times is not None and len(own_times):
                begin = max(begin, float(own_times[0]))
                end = min(end, float(own_times[-1]))
        is_common = (first_times >= begin) & (first_times <= end)
        if not is_common.any():
            raise TrajectoryError(
                f"{self.path}: the stamps of the files do not overlap, so they are not one recording."
            )
        return np.asarray(is_common)


def _have_same_stamps(time: Array | None, first_times: Array | None) -> bool:
    """True if the times of two files are equal within the tolerance of stamps, or if the files have no times."""
    if time is None or first_times is None:
        return True
    return len(time) == len(first_times) and bool(np.abs(time - first_times).max() <= _STAMP_TOLERANCE)


def _resample(table: Array, time: Array, new_times: Array) -> Array:
    """Interpolate a table (n, k) with stamps (n,) at increasing times (m,)."""
    # Rows around the new times only, as tables may be long.
    begin = max(0, int(np.searchsorted(time, new_times[0])) - 1)
    end = int(np.searchsorted(time, new_times[-1], side="right")) + 1
    columns = [np.interp(new_times, time[begin:end], column) for column in table[begin:end].T]
    return np.array(columns).reshape(-1, len(new_times)).T


def _requested_order(file_of_column: Array) -> Array:
    """Indices that bring columns from the order of files to the requested one.

    ``file_of_column`` has the file of each requested column.
    """
    requested_by_file_order = np.argsort(file_of_column, kind="stable")
    return np.argsort(requested_by_file_order, kind="stable")  # the inverse permutation


def _time_column_of(header: Sequence[str]) -> int | None:
    """Index of a file's column that most certainly is its time; None without one."""
    ranks = {}  # by column; 0 is most certain
    for column, cell in enumerate(header):
        name, _ = split_unit(cell)
        meaning = time_meaning(name)
        if meaning is not None:
            ranks[column], _ = meaning
    return min(ranks, key=ranks.__getitem__, default=None)


def _seconds_per_unit(cell: str, stamps: Array) -> float:
    """Factor of a time column to seconds: by its unit, or by its numbers if they count from 1970; otherwise 1."""
    name, unit = split_unit(cell)
    meaning = time_meaning(name)
    if not unit and meaning is not None:
        _, unit = meaning
    known_unit = unit or unit_since_1970(stamps) or "s"
    return time_factor(known_unit) or 1.0


def _distinct_name(cell: str, path: Path) -> str:
    """Distinct name of a column that several files have.

    It gets the suffix of the quantity in the file's name. If that name has no quantity, it becomes a prefix.
    """
    stem, _, _ = path.name.partition(".")
    words = re.findall(r"[^\W\d_]+", stem.casefold())
    suffixes = {SUFFIX[_PART_OF_FILE_WORD[word]] for word in words if word in _PART_OF_FILE_WORD}
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
    file_path = as_path(path)
    if JOINS in str(path) and not os.path.exists(file_path):  # noqa: PTH110  False if the text cannot be a path
        reader = partial(open_motion_file, topic=topic, episode=episode, command_topic=command_topic)
        return JoinedFile.open(path, reader)
    ends = FileEnds.from_path(file_path)
    file_format = format_of(file_path, ends.start)
    given_options: dict[str, Any] = {}
    for name, value in (("topic", topic), ("command_topic", command_topic), ("episode", episode)):
        if value is None:
            continue
        given_options[name] = value
        if file_format is None or name not in file_format.options:
            raise TrajectoryError(f"{path}: {_PURPOSES[name]}, and this is none. Leave it out.", Argument(name))
    if file_format is None:
        return CsvFile.open(ends)
    module, function = file_format.opener.split(":")
    opener = getattr(import_module(f".readers.{module}", __package__), function)
    file: MotionFile = opener(ends, **given_options)
    return file


_PURPOSES = {  # in error messages
    "topic": "{0} is for recordings of ROS",
    "command_topic": "{0} is for recordings of ROS",
    "episode": "{0} is for LeRobot datasets in parquet",
}


def text_columns(file: MotionFile) -> tuple[int, ...]:
    """Columns of a file that hold words in place of numbers; arrays and recordings leave these out of their header."""
    if isinstance(file, CsvFile):
        return file.text_columns()
    if isinstance(file, JoinedFile):
        text_columns_by_file = [text_columns(part) for part in file.parts]
        columns = []
        for k, (file_index, column) in enumerate(file.places):
            if column in text_columns_by_file[file_index]:
                columns.append(k)
        return tuple(columns)
    return ()


def with_sums(file: MotionFile, columns: Mapping[str, str]) -> MotionFile:
    """File with additional columns: the sums among the values of ``columns``, such as ``J3+J2`` or ``J3-J2``."""
    sums = _sums(file, columns)
    if not sums:
        return file
    header = list(file.header)
    terms_by_column: list[Terms] = [[(k, 1.0)] for k in range(len(header))]
    for name, terms in sums.items():
        terms_by_column.append(terms)
        first_column, _ = terms[0]
        _, unit = split_unit(file.header[first_column])
        header.append(_with_unit(name, unit))

    def read_portions(used: Sequence[int]) -> Iterator[Array]:
        """Portions (rows, len(used)) of the columns ``used``, among which are sums."""
        required_columns: set[int] = set()
        for column in used:
            required_columns.update(k for k, _ in terms_by_column[column])
        file_columns = sorted(required_columns)
        table = file.table(file_columns)
        for rows in slices(len(table)):
            portion = np.zeros((len(table[rows]), len(used)))
            for total, column in zip(portion.T, used, strict=True):  # total is a view: the portion changes
                for k, sign in terms_by_column[column]:
                    total += sign * table[rows, file_columns.index(k)]
            yield portion

    if isinstance(file, ArrayFile):
        return replace(file, header=tuple(header), read=read_portions)
    return ArrayFile(file.path, tuple(header), file.size, read_portions, file.notes)


Terms = list[tuple[int, float]]
"""Terms of a sum of columns: pairs of a column's index and a factor, 1 or -1."""
_SIGNS = {"": 1.0, "+": 1.0, "-": -1.0}


def _sums(file: MotionFile, columns: Mapping[str, str]) -> dict[str, Terms]:
    """Sums of columns by their names. Raises TrajectoryError for columns of several units."""
    column_by_name: dict[str, int] = {}
    unit_by_column: dict[int, str | None] = {}
    for k, cell in enumerate(file.header):
        cell_name, unit_by_column[k] = split_unit(cell)
        column_by_name.setdefault(cell_name, k)
    sums = {}
    for name in columns.values():
        name_without_unit, _ = split_unit(name)
        signs_and_names = re.findall(r"(^|[+-])([^+-]+)", name)  # of the terms; the first may have no sign
        terms: Terms = []
        for sign, term_text in signs_and_names:
            term_name, _ = split_unit(term_text)
            if term_name in column_by_name:
                terms.append((column_by_name[term_name], _SIGNS[sign]))
        is_column = name_without_unit in column_by_name
        has_unknown_terms = len(terms) < len(signs_and_names)
        is_single_term = len(signs_and_names) < 2
        if is_column or has_unknown_terms or is_single_term:
            continue
        sums[name] = terms
        units = {unit_by_column[column] for column, _ in terms}
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
    joints = [body.joint.name for body in model.leaders if body.joint.nv]
    return absent_joints(file.header, Coordinates.from_model(model), joints, columns or {}, file.path)
