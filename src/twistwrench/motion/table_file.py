"""CSV files out: a header, and rows of numbers that lose no digit."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..core.csv_writer import CsvWriter
from ..outputs import replacing
from ..typing import Array


@dataclass(frozen=True, eq=False)
class TableFile:
    """A CSV file that rows are being added to."""

    writer: CsvWriter

    @staticmethod
    @contextlib.contextmanager
    def writing(path: str | Path | None, header: Sequence[str]) -> Iterator[TableFile | None]:
        """Begin a file with that header, and finish it on leaving; None, and nothing written, if there is no path."""
        if path is None:
            yield None
            return
        with replacing(path) as scratch, scratch.open("wb") as file:
            writer = CsvWriter(file)
            writer.row(header)
            yield TableFile(writer)

    def write(self, rows: Array) -> None:
        """Add rows (n, columns), each number with the digits that give it back exactly."""
        self.writer.numbers(rows)
