"""A motion in a CSV file, read in blocks: columns of time, of coordinates, optionally of ``.vel`` and ``.acc``."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from ..errors import NotFoundError, TrajectoryError, ValueRangeError
from ..model.model import Model
from .columns import Columns
from .coordinates import Coordinates
from .faults import blame
from .numbers import parse_table

Array = NDArray[Any]

__all__ = ["Motion", "Trajectory", "moves_motors"]

_BLOCK = 1 << 18  # bytes read at a time: what parsing makes of them stays in the processor's cache
_LONGEST_LINE = 1 << 22
_NO_ROTATION = 1e-6  # norm of a quaternion


@dataclass(frozen=True, eq=False)
class Motion:
    """Consecutive samples of a motion, in SI units; ``dq`` and ``ddq`` are None where the file has none."""

    time: Array
    """(n,) s."""
    q: Array
    """(n, nq)."""
    dq: Array | None
    """(n, nv)."""
    ddq: Array | None
    """(n, nv)."""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A motion file that has been opened once to read its header; the rows stay in the file."""

    path: Path
    columns: Columns
    header_line: int
    """Line of the header, counting from 1."""
    data_offset: int
    """Where the line after the header begins [bytes]."""
    size: int
    """Size of the file [bytes]."""

    @classmethod
    def open(cls, path: str | Path, model: Model, *, degrees: bool = False, locked: Sequence[str] = ()) -> Trajectory:
        """Read and check the header; angles of the file are in degrees if ``degrees``, and columns of ``locked`` joints
        are ignored.

        Raises :class:`~twistwrench.NotFoundError` and :class:`~twistwrench.TrajectoryError`.
        """
        path = Path(path)
        if model.nv == 0:
            raise ValueRangeError(
                f"robot {model.name!r} has no joint that moves, so no motion fits. Lock fewer joints."
            )
        if path.is_dir():
            raise TrajectoryError(f"{path}: is a folder. Give the CSV file of the motion itself.")
        try:
            with path.open("rb") as file:
                header, line, offset = _header(file, path)
                size = file.seek(0, 2)
        except FileNotFoundError:
            raise NotFoundError(f"no motion file {str(path)!r}. Give the path of a CSV file.") from None
        except OSError as problem:
            raise TrajectoryError(f"{path}: cannot be read: {problem.strerror}. A regular file is needed.") from None
        columns = Columns.of(header, Coordinates.of(model), f"{path}: line {line}", degrees=degrees, locked=locked)
        return cls(path, columns, line, offset, size)

    def tables(self, progress: Callable[[int], None] | None = None) -> Iterator[Array]:
        """The rows in blocks (n, columns), as the numbers stand in the file; ``progress`` is told the bytes of each.

        Numbers are checked to be numbers and finite, rows to be whole, and time to increase.
        """
        line, last = self.header_line + 1, -np.inf
        with self.path.open("rb") as file:
            file.seek(self.data_offset)
            for text, size in _lines(file, self.path):
                table = self._table(text, line, last)
                if len(table):
                    last = float(table[-1, self.columns.time])
                    yield table
                line += text.count(b"\n")
                if progress:
                    progress(size)
        if last == -np.inf:
            raise TrajectoryError(
                f"{self.path}: no rows after the header of line {self.header_line}. Give at least one."
            )

    def excerpts(self, count: int, rows: int) -> list[Array]:
        """Up to ``count`` runs of consecutive rows (n, columns) spread evenly over the file, its ends included.

        Each has about ``rows`` rows; a short file comes whole, as one. Values are checked as in :meth:`tables`.
        """
        width = self._bytes_per_row() * rows
        body = self.size - self.data_offset
        if body <= count * width:
            return [np.concatenate(list(self.tables()))]
        found = []
        with self.path.open("rb") as file:
            for k in range(count):
                file.seek(self.data_offset + (body - width) * k // (count - 1))
                if k:
                    file.readline()  # the rest of a line that was cut
                text = file.read(width)
                try:
                    found.append(self._table(text[: text.rfind(b"\n") + 1], 0, -np.inf))
                except TrajectoryError:
                    for _ in self.tables():  # fails at the same row, and knows its line
                        pass
                    raise
        return [table for table in found if len(table)]

    def motion(self, table: Array) -> Motion:
        """Sort the columns of a table (n, columns) into q, dq and ddq, in SI units."""
        take = self.columns.take
        return Motion(table[:, self.columns.time].copy(), take(table, "q"), take(table, "dq"), take(table, "ddq"))

    def _bytes_per_row(self) -> int:
        with self.path.open("rb") as file:
            file.seek(self.data_offset)
            text = file.read(_BLOCK)
        return max(1, len(text) // max(1, text.count(b"\n")))

    def _table(self, text: bytes, line: int, last: float) -> Array:
        text = _tidy(text)
        if not text:
            return np.zeros((0, len(self.columns.header)))
        table = parse_table(text, len(self.columns.header))
        good = table is not None and bool(np.isfinite(table).all())
        if table is None or not good or not _increases(table[:, self.columns.time], last):
            raise blame(text, self.path, line, self.columns.header, self.columns.time, last)
        for place in self.columns.quaternions:
            none = np.linalg.norm(table[:, place], axis=1) < _NO_ROTATION
            if none.any():
                rows = [k for k, row in enumerate(text.splitlines()) if row.strip()]
                raise TrajectoryError(
                    f"{self.path}: line {line + rows[int(none.argmax())]}, column {self.columns.header[place[0]]!r}: the "
                    "quaternion is zero, which is no rotation. Write 1, 0, 0, 0 for none, or remove the row."
                )
        return table


def _increases(time: Array, last: float) -> bool:
    return bool(time[0] > last and (time[1:] > time[:-1]).all())


def _tidy(text: bytes) -> bytes:
    """Lines that end in a newline alone, the last one too; b"" if nothing but blanks is there."""
    if b"\r" in text:
        text = text.replace(b"\r\n", b"\n")
    if text.isspace() or not text:
        return b""
    return text if text.endswith(b"\n") else text + b"\n"


def moves_motors(path: str | Path) -> bool:
    """Whether the file has columns for the motors of elastic joints; what is wrong with it is said when it is opened."""
    try:
        with Path(path).open("rb") as file:
            names = _header(file, Path(path))[0]
    except (OSError, TrajectoryError):
        return False
    return any(name.strip().endswith(".motor") for name in names)


def _header(file: BinaryIO, path: Path) -> tuple[str, int, int]:
    """The first line that is neither blank nor a comment, its number, and where the next one begins."""
    number = 0
    while raw := file.readline(_LONGEST_LINE):
        number += 1
        try:
            text = raw.decode("utf-8-sig" if number == 1 else "utf-8").strip()
        except UnicodeDecodeError:
            raise TrajectoryError(
                f"{path}: line {number} is not UTF-8 text. Save the motion as CSV in UTF-8."
            ) from None
        if text and not text.startswith("#"):
            return text, number, file.tell()
    raise TrajectoryError(
        f"{path}: the file is empty. A motion file has a header, time and joint names separated by commas, then rows."
    )


def _lines(file: BinaryIO, path: Path) -> Iterator[tuple[bytes, int]]:
    """Blocks of whole lines, and how many bytes were read for each."""
    rest = b""
    while text := file.read(_BLOCK):
        size, text = len(text), rest + text
        cut = text.rfind(b"\n") + 1
        if not cut and len(text) > _LONGEST_LINE:
            raise TrajectoryError(f"{path}: a line of more than {_LONGEST_LINE} bytes. Rows must end in newlines.")
        rest = text[cut:]
        if cut:
            yield text[:cut], size
    if rest:
        yield rest, len(rest)
