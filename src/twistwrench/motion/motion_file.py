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

import numpy as np

from ..core.errors import TrajectoryError, TwistWrenchError
from ..core.files import as_path
from ..core.text import Argument
from ..core.typing import Array
from ..mechanics.model.model import Model
from .column_names import PART_OF, SUFFIX, split_unit, time_factor, time_meaning, unit_since_1970
from .columns import absent_joints
from .coordinates import Coordinates
from .log_table import FileEnds, slices, table_of
from .readers import format_of
from .readers.array_files import ArrayFile
from .readers.csv_reader import CsvFile

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
        parts = tuple(reader(name) for name in names)
        stamps = tuple(_time_of(part.header) for part in parts)
        with_time = [s is not None for s in stamps]
        if any(with_time) and not all(with_time):
            bare = parts[with_time.index(False)]
            raise TrajectoryError(
                f"{bare.path}: has no column of time, and the file it is joined with has one. Both need one, or neither."
            )
        places = [(k, c) for k, part in enumerate(parts) for c in range(len(part.header)) if k == 0 or c != stamps[k]]
        cells = [parts[k].header[c] for k, c in places]
        twice = {cell for cell, count in Counter(filter(None, cells)).items() if count > 1}
        header = [
            _distinct(cell, parts[k].path) if cell in twice else cell
            for cell, (k, _) in zip(cells, places, strict=True)
        ]
        size, notes = sum(part.size for part in parts), tuple(note for part in parts for note in part.notes)
        return cls(Path(str(path)), tuple(header), parts, tuple(places), stamps, size, notes)

    def check_columns(self) -> None:
        """Raise TrajectoryError if all files have the same columns, which means several logs of one robot."""
        first, *others = ({*part.header} for part in self.parts)
        meant = any(":" not in _distinct(cell, part.path) for part in self.parts for cell in first)
        if all(other == first for other in others) and not meant:
            names = [str(part.path) for part in self.parts]
            raise TrajectoryError(
                f"{self.path}: the files have the same columns, as several logs have. '+' joins the columns of one motion. "
                f"Give logs one by one: {' '.join(names)}"
            )

    def table(self, used: Sequence[int]) -> Array:
        """Table (n, len(used)) of the given columns, resampled at the stamps of the first file if stamps differ."""
        wanted = [self.places[k] for k in used]
        tables, times = list[Array](), list[Array | None]()
        for k, (part, stamp) in enumerate(zip(self.parts, self.stamps, strict=True)):
            own = [c for file, c in wanted if file == k]
            whole = part.table(own if stamp is None else [*own, stamp])
            times.append(None if stamp is None else whole[:, -1] * _seconds(part.header[stamp], whole[:, -1]))
            tables.append(whole[:, : len(own)])
        rows, columns, first = self._matched(tables, times), _in_order(wanted), times[0]
        alike = [
            first is None or t is None or (len(t) == len(first) and bool(np.abs(t - first).max() <= _SAME_STAMPS))
            for t in times
        ]

        def portions() -> Iterator[Array]:
            for s in slices(len(rows)):
                kept = np.arange(s.start, s.stop)[rows[s]]
                if not kept.size:
                    continue
                found = [
                    table[kept] if same or t is None or first is None else _resampled(table, t, first[kept])
                    for table, t, same in zip(tables, times, alike, strict=True)
                ]
                yield np.concatenate(found, axis=1)[:, columns]

        return table_of(portions(), len(used), self.path)

    def first(self, column: int) -> Array:
        """First numbers of a column."""
        file, own = self.places[column]
        return self.parts[file].first(own)

    def place(self, row: int) -> str:
        """Description of a row's place, ``row 3``."""
        return f"row {row + 1}"

    def _matched(self, tables: list[Array], times: list[Array | None]) -> Array:
        """Mask (n,) of rows of the first file within the times of all others; raises TrajectoryError on mismatch."""
        first = times[0]
        if first is None:
            counts = [len(table) for table in tables]
            if len(set(counts)) > 1:
                said = ", ".join(f"{part.path.name} {n}" for part, n in zip(self.parts, counts, strict=True))
                raise TrajectoryError(
                    f"{self.path}: files without a time are joined row by row, and their rows differ: {said}. Cut them alike, "
                    "or give each a column of time."
                )
            return np.ones(counts[0], bool)
        begin = max(float(t[0]) for t in times if t is not None and len(t))
        end = min(float(t[-1]) for t in times if t is not None and len(t))
        kept = (first >= begin) & (first <= end)
        if not kept.any():
            raise TrajectoryError(
                f"{self.path}: the stamps of the files do not overlap, so they are not one recording."
            )
        return np.asarray(kept)


def _resampled(table: Array, time: Array, at: Array) -> Array:
    """Interpolate a table (n, k) with stamps (n,) at increasing times (m,)."""
    near = slice(max(0, int(np.searchsorted(time, at[0])) - 1), int(np.searchsorted(time, at[-1], side="right")) + 1)
    return np.array([np.interp(at, time[near], x) for x in table[near].T]).reshape(-1, len(at)).T


def _in_order(wanted: Sequence[tuple[int, int]]) -> Array:
    """Permutation of columns from file order to the requested order."""
    return np.argsort(np.argsort([file for file, _ in wanted], kind="stable"), kind="stable")


def _time_of(header: Sequence[str]) -> int | None:
    """Most certain time column of a file."""
    ranked = sorted(
        (rank[0], k) for k, cell in enumerate(header) if (rank := time_meaning(split_unit(cell)[0])) is not None
    )
    return ranked[0][1] if ranked else None


def _seconds(cell: str, stamps: Array) -> float:
    """Factor of a time column to seconds, by its name, or by its numbers if they count from 1970."""
    name, unit = split_unit(cell)
    said = unit or (time_meaning(name) or (0, None))[1] or unit_since_1970(stamps)
    return (time_factor(said) or 1.0) if said else 1.0


def _distinct(cell: str, path: Path) -> str:
    stem = path.name.split(".")[0]
    said = {SUFFIX[_PART_OF[word]] for word in re.findall(r"[^\W\d_]+", stem.casefold()) if word in _PART_OF}
    if len(said) != 1:
        return f"{stem}:{cell}"
    name, unit = split_unit(cell)
    return f"{name}{said.pop()}" + (f" [{unit}]" if unit else "")


# ── Opening a file by its name and first bytes

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
    wanted = {"topic": topic, "command_topic": command_topic, "episode": episode}
    given = {name: value for name, value in wanted.items() if value is not None}
    for name in given:
        if form is None or name not in form.options:
            raise TrajectoryError(f"{path}: {_PURPOSES[name]}, and this is none. Leave it out.", Argument(name))
    if form is None:
        return CsvFile.open(ends)
    module, function = form.opener.split(":")
    opener = getattr(import_module(f".readers.{module}", __package__), function)
    opened: MotionFile = opener(ends, **given)
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
        found = [text_columns(part) for part in file.parts]
        return tuple(k for k, (part, column) in enumerate(file.places) if column in found[part])
    return ()


def with_sums(file: MotionFile, columns: Mapping[str, str]) -> MotionFile:
    """Append the sums in ``columns``, such as ``J3+J2`` or ``J3-J2``, to the file's columns."""
    plain = {split_unit(cell)[0]: k for k, cell in reversed([*enumerate(file.header)])}
    sums: dict[str, list[tuple[int, float]]] = {}
    for name in columns.values():
        parts = re.findall(r"(^|[+-])([^+-]+)", name)
        terms = [(plain.get(split_unit(part)[0]), -1.0 if sign == "-" else 1.0) for sign, part in parts]
        if split_unit(name)[0] in plain or len(terms) < 2 or any(k is None for k, _ in terms):
            continue
        sums[name] = [(k, sign) for k, sign in terms if k is not None]
        units = {split_unit(file.header[k])[1] for k, _ in sums[name]}
        if len(units) > 1:
            raise TrajectoryError(f"{file.path}: the columns of {name} have several units. Add columns of one unit.")
    if not sums:
        return file
    own = len(file.header)
    every = [*([(k, 1.0)] for k in range(own)), *sums.values()]
    units_of = (split_unit(file.header[terms[0][0]])[1] for terms in sums.values())
    labels = [f"{name} [{unit}]" if unit else name for name, unit in zip(sums, units_of, strict=True)]

    def read(used: Sequence[int]) -> Iterator[Array]:
        needed = sorted({k for column in used for k, _ in every[column]})
        table = file.table(needed)
        for s in slices(len(table)):
            rows = [sum(sign * table[s, needed.index(k)] for k, sign in every[column]) for column in used]
            yield np.stack(rows, axis=1)

    header = (*file.header, *labels)
    if isinstance(file, ArrayFile):
        return replace(file, header=header, read=read)
    return ArrayFile(file.path, header, file.size, read, file.notes)


def moves_motors(path: str | Path | MotionFile) -> bool:
    """True if the file has columns for the motors of elastic joints; False if it cannot be opened."""
    try:
        file = open_motion_file(path) if isinstance(path, str | Path) else path
    except TwistWrenchError:
        return False
    return any(name.strip().endswith(".motor") for name in file.header)


def joints_without_column(
    path: str | Path | MotionFile, model: Model, columns: Mapping[str, str] | None = None
) -> tuple[str, ...]:
    """Joints of a model without a column in the file's header; ``columns`` as in :meth:`MotionLog.open`."""
    file = open_motion_file(path) if isinstance(path, str | Path) else path
    joints = [b.joint.name for b in model.leaders if b.joint.nv]
    return absent_joints(file.header, Coordinates.from_model(model), joints, columns or {}, file.path)
