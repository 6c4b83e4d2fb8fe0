"""Columnar file of a motion whose header has been read, and whose rows are read in portions."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from ...core.errors import TrajectoryError
from ...core.third_party import third_party_errors
from ...core.typing import Array
from ..log_table import table_of


def unreadable_rows(path: Path, row: int, reason: str) -> TrajectoryError:
    """Error for a file that cannot be read from ``row`` on, counted from 0."""
    return TrajectoryError(f"{path}: cannot be read from row {row + 1} on: {reason}. Is the file cut short?")


@dataclass(frozen=True, eq=False)
class ArrayFile:
    """Columnar file whose header has been read."""

    path: Path
    header: tuple[str, ...]
    size: int
    """Size [bytes]."""
    read: Callable[[Sequence[int]], Iterator[Array]]
    """Function of the numbers of k columns that yields portions (n, k) of their rows."""
    notes: tuple[str, ...] = ()
    """Sentences about ignored content of the file."""
    advice: str = "remove the row"
    """Remedy for non-finite numbers."""
    epoch: int = 0
    """Stamp [ns] of time 0 of a ROS recording."""
    dataset: str = ""
    """Unit of a LeRobot dataset's positions by its metadata: ``degrees``, ``radians``, ``range`` or ``unknown``."""
    plan: bool = False
    """True if the file is a plan, such as a JointTrajectory, and not a recording."""

    @classmethod
    def from_table(
        cls, path: Path, header: Sequence[str], table: Array, size: int, notes: Sequence[str] = ()
    ) -> ArrayFile:
        """File whose table (n, k) is in memory."""

        def read(used: Sequence[int]) -> Iterator[Array]:
            yield table[:, list(used)]

        return cls(path, tuple(header), size, read, tuple(notes))

    def table(self, used: Sequence[int]) -> Array:
        """Table (n, len(used)) of the columns with the numbers ``used``; raises TrajectoryError for non-finite numbers."""
        return table_of(self._portions(used), len(used), self.path)

    def first(self, column: int) -> Array:
        """First portion (n,) of a column; empty if the file has no rows."""
        no_rows = np.zeros((0, 1))
        portion = next(self._portions([column]), no_rows)
        return portion[:, 0]

    def place(self, row: int) -> str:
        """Text with the place of a row, ``row 3`` for row 2: rows are counted from 0, and from 1 in texts."""
        return f"row {row + 1}"

    def _portions(self, used: Sequence[int]) -> Iterator[Array]:
        """Portions (n, len(used)) of the given columns; raises TrajectoryError for non-finite numbers."""
        first_row = 0
        portions = self.read(used)
        while True:
            with third_party_errors(partial(unreadable_rows, self.path, first_row)):
                portion = next(portions, None)
            if portion is None:
                return
            if not np.isfinite(portion).all():
                raise self._not_finite_error(portion, used, first_row)
            yield portion
            first_row += len(portion)

    def _not_finite_error(self, portion: Array, used: Sequence[int], first_row: int) -> TrajectoryError:
        """Error for the first number of a portion that is not finite; the portion begins at ``first_row`` of the file."""
        is_bad = ~np.isfinite(portion)
        bad_rows = np.flatnonzero(is_bad.any(axis=1))
        bad_row = int(bad_rows[0])
        bad_column = int(np.flatnonzero(is_bad[bad_row])[0])
        other_rows_text = ""
        other_count = len(bad_rows) - 1
        if other_count == 1:
            other_rows_text = ", and 1 more row here"
        elif other_count > 1:
            other_rows_text = f", and {other_count} more rows here"
        return TrajectoryError(
            f"{self.path}: row {first_row + bad_row + 1}, column {self.header[used[bad_column]]!r} is "
            f"{portion[bad_row, bad_column]}{other_rows_text}. Samples must be finite: {self.advice}."
        )
