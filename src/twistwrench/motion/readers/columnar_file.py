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
    """Error for rows that cannot be read, counted from 0."""
    return TrajectoryError(f"{path}: cannot be read from row {row + 1} on: {reason}. Is the file cut short?")


@dataclass(frozen=True, eq=False)
class ArrayFile:
    """Columnar file whose header has been read."""

    path: Path
    header: tuple[str, ...]
    size: int
    """Size [bytes]."""
    read: Callable[[Sequence[int]], Iterator[Array]]
    """Function that yields portions (n, k) of the rows of some columns."""
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
        """File with columns (n, k) in memory."""
        return cls(path, tuple(header), size, lambda used: iter([table[:, list(used)]]), tuple(notes))

    def table(self, used: Sequence[int]) -> Array:
        """Table (n, len(used)) of the given columns; raises TrajectoryError for non-finite numbers."""
        return table_of(self._portions(used), len(used), self.path)

    def first(self, column: int) -> Array:
        """First portion of a column."""
        return next(self._portions([column]), np.zeros((0, 1)))[:, 0]

    def place(self, row: int) -> str:
        """Description of a row's place, ``row 3``."""
        return f"row {row + 1}"

    def _portions(self, used: Sequence[int]) -> Iterator[Array]:
        row, portions = 0, self.read(used)
        while True:
            with third_party_errors(partial(unreadable_rows, self.path, row)):
                table = next(portions, None)
            if table is None:
                return
            if not np.isfinite(table).all():
                raise self._not_finite(table, used, row)
            yield table
            row += len(table)

    def _not_finite(self, table: Array, used: Sequence[int], row: int) -> TrajectoryError:
        """Error for the first number of a portion that is not finite; the portion begins with ``row``."""
        not_finite = ~np.isfinite(table)
        bad_rows = np.flatnonzero(not_finite.any(axis=1))
        bad, count = int(bad_rows[0]), len(bad_rows)
        k = int(not_finite[bad].argmax())
        more = ""
        if count > 1:
            more = f", and {count - 1} more row{'s' * (count > 2)} here"
        return TrajectoryError(
            f"{self.path}: row {row + bad + 1}, column {self.header[used[k]]!r} is {table[bad, k]}{more}. Samples must be "
            f"finite: {self.advice}."
        )
