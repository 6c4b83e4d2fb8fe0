"""The motion in an archive that ``simulate --npz`` wrote, as a table under a header."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..core.files import as_path
from ..core.foreign_errors import foreign_errors
from ..errors import NotFoundError, TrajectoryError
from ..typing import Array
from .column_names import time_column
from .column_suffixes import SUFFIX
from .row_block import Block

_MARK = "twistwrench simulation"
_ROWS = 1 << 14


def is_archive(path: Path) -> bool:
    """Whether the file begins as archives of NumPy do; False for what cannot be read."""
    try:
        if not path.is_file():  # a pipe would lose what is read of it here
            return False
        with path.open("rb") as file:
            return file.read(2) == b"PK"
    except (OSError, ValueError):
        return False


def is_simulation(path: Path) -> bool:
    """Whether the archive is one that ``simulate --npz`` wrote; False for what cannot be read."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            return "format" in archive and str(archive["format"]).startswith(_MARK)
    except Exception:  # whatever NumPy raises: reading it says what is wrong
        return True


@dataclass(frozen=True, eq=False)
class NpzFile:
    """A motion that is in memory whole."""

    path: Path
    header: tuple[str, ...]
    table: Array
    size: int
    """Of the file [bytes]."""

    @classmethod
    def open(cls, path: str | Path) -> NpzFile:
        """Read it all; raises :class:`~twistwrench.NotFoundError` and :class:`~twistwrench.TrajectoryError`."""
        path = as_path(path)
        if not path.is_file():
            raise NotFoundError(f"no motion file {str(path)!r}. Give the path of a CSV file.")
        advice = "Give one that simulate --npz wrote, whole, or a CSV file."
        unreadable = f"{path}: an archive that cannot be read as a motion"
        with foreign_errors(lambda reason: TrajectoryError(f"{unreadable}: {reason}. {advice}")):
            header, table = _read(path)
        bad = ~np.isfinite(table).all(axis=1)
        if bad.any():
            raise TrajectoryError(
                f"{path}: row {int(bad.argmax()) + 1} has a number that is not finite. Remove the row."
            )
        return cls(path, tuple(header), table, path.stat().st_size)

    def blocks(self, used: Sequence[int]) -> Iterator[Block]:
        """All rows, in blocks: of the ``used`` columns."""
        for k in range(0, len(self.table), _ROWS):
            rows = self.table[k : k + _ROWS, list(used)]
            if not np.isfinite(rows).all():
                raise TrajectoryError(self._gap(rows, k, used))
            share = len(rows) / len(self.table)
            yield Block(rows, int(self.size * share), lambda row, k=k: f"row {k + row + 1}")  # type: ignore[misc]

    def _gap(self, rows: Array, first: int, used: Sequence[int]) -> str:
        """What is not finite in ``rows``, of which the first has that number; a DataFrame's, as files are read whole."""
        odd = ~np.isfinite(rows)
        row = int(odd.any(axis=1).argmax())
        column, count = int(odd[row].argmax()), int(odd.any(axis=1).sum())
        more = f", and {count - 1} more row{'s' if count > 2 else ''} here" if count > 1 else ""
        return (
            f"{self.path}: row {first + row + 1}, column {self.header[used[column]]!r} is {rows[row, column]}{more}. Samples "
            "must be finite: frame.dropna() leaves such rows out, frame.interpolate() fills them."
        )

    def excerpts(self, used: Sequence[int], count: int, rows: int) -> list[Block] | None:
        """None: it is read whole."""
        del used, count, rows
        return None


def _read(path: Path) -> tuple[list[str], Array]:
    with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
        if not str(archive["format"]).startswith(_MARK):
            raise TrajectoryError(f"{path}: an archive of NumPy, but not one that simulate --npz wrote.")
        said = json.loads(str(archive["said"]))
        columns, header = [np.asarray(archive["times"], float)[:, None]], [time_column(said["coordinate_names"])]
        for part, ending in SUFFIX.items():
            values, names = (
                np.asarray(archive[part], float),
                said["coordinate_names" if part == "q" else "velocity_names"],
            )
            header += [f"{name}{ending}" for name in names]
            columns.append(values.reshape(len(columns[0]), len(names)))
        return header, np.concatenate(columns, axis=1)
