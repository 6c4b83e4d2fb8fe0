"""CSV files out: a header, and rows of numbers that lose no digit."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from numpy.typing import NDArray

from ..outputs import replacing

Array = NDArray[Any]

__all__ = ["TableFile"]

_PORTION = 4096


@dataclass(frozen=True, eq=False)
class TableFile:
    """A CSV file that rows are being added to."""

    file: BinaryIO

    @staticmethod
    @contextlib.contextmanager
    def writing(path: str | Path | None, header: Sequence[str]) -> Iterator[TableFile | None]:
        """Begin a file with that header, and finish it on leaving; None, and nothing written, if there is no path."""
        if path is None:
            yield None
            return
        with replacing(path) as scratch, scratch.open("wb") as file:
            file.write((",".join(header) + "\n").encode())
            yield TableFile(file)

    def write(self, rows: Array) -> None:
        """Add rows (n, columns), each number with the digits that give it back exactly."""
        # repr of a float is its shortest exact decimal; joining lists is three times as fast as np.savetxt.
        for k in range(0, len(rows), _PORTION):  # a number takes ten times its memory while it is text
            lines = [",".join(map(repr, row)) for row in rows[k : k + _PORTION].tolist()]
            self.file.write(("\n".join(lines) + "\n").encode("ascii"))
