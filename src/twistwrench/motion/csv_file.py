"""A CSV file of numbers under a header, read in blocks of lines: memory stays bounded however long it is."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from ..core.files import as_path
from ..errors import NotFoundError, TrajectoryError, ValueRangeError
from .csv_dialect import Dialect, is_number
from .csv_errors import blame
from .csv_numbers import parse_block, tidy
from .row_block import Block
from .text_source import TextSource

_BLOCK = 1 << 18  # bytes read at a time: what parsing makes of them stays in the processor's cache
_LONGEST_LINE = 1 << 22
_TAIL, _LINES_ABOVE = 1 << 14, 8


class EmptyTableError(TrajectoryError):
    """A file without a line that says anything."""


@contextmanager
def table_errors(path: str | Path, what: str, form: str) -> Iterator[None]:
    """Say of a table that is no motion what it is: ``what`` was looked for, and what it has to look like (``form``).

    Raises NotFoundError, and ValueRangeError in place of TrajectoryError.
    """
    try:
        yield
    except NotFoundError:
        raise NotFoundError(f"no {what} {str(path)!r}. Give a CSV file: {form}.") from None
    except EmptyTableError:
        raise ValueRangeError(f"{path}: the {what} is empty. Give a CSV file: {form}.") from None
    except TrajectoryError as problem:
        raise ValueRangeError(str(problem)) from None


@dataclass(frozen=True, eq=False)
class CsvFile:
    """A file whose header has been read; the rows stay in it."""

    source: TextSource
    header: tuple[str, ...]
    header_line: int
    """Line of the header, counting from 1."""
    data_offset: int
    """Where the first row begins [bytes]."""
    dialect: Dialect
    seems_cut: bool = False
    """Whether the last line has no end, and its last number fewer decimals than all of those above: 0.5 below 0.123."""

    @classmethod
    def open(cls, path: str | Path) -> CsvFile:
        r"""Read the header, and see from the row below it how cells are separated.

        Commas, semicolons, tabs or blanks; decimal commas where commas separate nothing; UTF-8 or UTF-16; packed by gzip or
        not. Lines that begin with # are comments, but for one right above rows without another header: it is theirs, as
        ``numpy.savetxt`` writes it. Raises :class:`~twistwrench.NotFoundError` and :class:`~twistwrench.TrajectoryError`.

        Examples
        --------
        >>> import pathlib, tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = pathlib.Path(folder, "log.csv")
        ...     _ = path.write_text("time;elbow [deg]\n0;1,5\n1;2,5\n")
        ...     file = CsvFile.open(path)
        ...     file.header, [block.table.tolist() for block in file.blocks([0, 1])]
        (('time', 'elbow [deg]'), [[[0.0, 1.5], [1.0, 2.5]]])
        """
        source = TextSource.of(as_path(path))
        with source.open() as file:
            text, line, offset, comment = _header(file, source.path)
            row = _first_row(file)
            dialect = Dialect.of(text, row)
            cut = _seems_cut(file, source.size, offset, dialect)
        cells = dialect.cells(text)
        if comment is not None and all(map(_numeric, cells)):
            names = dialect.cells(comment[0])
            if len(names) == len(cells) and not any(map(_numeric, names)):
                cells, line, offset = names, *comment[1:]
        return cls(source, tuple(cells), line, offset, dialect, cut)

    @property
    def path(self) -> Path:
        """Of the file."""
        return self.source.path

    @property
    def size(self) -> int:
        """Of its text [bytes]."""
        return self.source.size

    @property
    def notes(self) -> tuple[str, ...]:
        """A sentence where the file seems to be cut short."""
        if not self.seems_cut:
            return ()
        return (
            "The last line does not end, and its last number has fewer decimals than those above: the file seems to be cut "
            "short there. Complete or remove the row.",
        )

    def blocks(self, used: Sequence[int]) -> Iterator[Block]:
        """All rows, in blocks: of the ``used`` columns. Rows are checked to be whole, and numbers to be finite numbers."""
        line = self.header_line + 1
        with self.source.open() as file:
            file.seek(self.data_offset)
            for text, size in _lines(file, self.path):
                yield self._block(text, size, line, used)
                line += text.count(b"\n")

    def rows(self) -> Iterator[tuple[int, list[str]]]:
        """The number of each line of a short file, counting from 1, and its cells; no blank lines and comments.

        Raises TrajectoryError for a line with another number of cells than the header, and for a long file.
        """
        with self.source.open() as file:
            file.seek(self.data_offset)
            text = file.read(_LONGEST_LINE + 1)
        if len(text) > _LONGEST_LINE:
            raise TrajectoryError(f"{self.path}: has more than {_LONGEST_LINE} bytes, too many for such a table.")
        for line, raw in enumerate(tidy(text).split(b"\n"), self.header_line + 1):
            if _is_row(raw):
                cells = self.dialect.cells(_decoded(raw, self.path, line))
                if len(cells) != len(self.header):
                    raise blame(raw, self.path, line, self.header, (), self.dialect)
                yield line, cells

    def excerpts(self, used: Sequence[int], count: int, rows: int) -> list[Block] | None:
        """Up to ``count`` runs of about ``rows`` consecutive rows spread evenly over the file, its ends included.

        Their rows' places are unknown. None of a file so short that it is better read whole.
        """
        width = self._bytes_per_row() * rows
        body = self.size - self.data_offset
        if body <= count * width:
            return None
        found = []
        with self.source.open() as file:
            for k in range(count):
                file.seek(self.data_offset + (body - width) * k // (count - 1))
                if k:
                    file.readline(_LONGEST_LINE)  # the rest of a line that was cut
                text = file.read(width)
                found.append(self._block(text[: text.rfind(b"\n") + 1], 0, 0, used))
        return found

    def _bytes_per_row(self) -> int:
        with self.source.open() as file:
            file.seek(self.data_offset)
            text = file.read(_BLOCK)
        return max(1, len(text) // max(1, text.count(b"\n")))

    def _block(self, text: bytes, size: int, line: int, used: Sequence[int]) -> Block:
        text = tidy(text)
        table = parse_block(text, self.dialect, len(self.header), used)
        if table is None:
            raise blame(text, self.path, line, self.header, used, self.dialect)

        def place(row: int) -> str:
            lines = [k for k, raw in enumerate(text.split(b"\n")) if _is_row(raw)]
            return f"line {line + lines[row]}"

        return Block(table, size, place)


def _numeric(cell: str) -> bool:
    return is_number(cell) or is_number(cell, decimal_comma=True)


def _header(file: BinaryIO, path: Path) -> tuple[str, int, int, tuple[str, int, int] | None]:
    """The first line that is neither blank nor a comment, its number, and where the next one begins.

    The fourth is the comment before it: its text, its number, and where the next line begins; None without one.
    """
    comment, number = None, 0
    while raw := file.readline(_LONGEST_LINE):
        number += 1
        text = _decoded(raw, path, number).strip(" \r\n")
        if not text.strip():
            continue
        if not text.lstrip().startswith("#"):
            return text, number, file.tell(), comment
        comment = (text.strip().lstrip("#").strip(), number, file.tell())
    raise EmptyTableError(
        f"{path}: the file is empty. A motion file has a header, time and joint names separated by commas, then rows."
    )


def _first_row(file: BinaryIO) -> str | None:
    while raw := file.readline(_LONGEST_LINE):
        text = raw.decode("utf-8", "replace").strip(" \r\n")
        if text.strip() and not text.lstrip().startswith("#"):
            return text
    return None


def _seems_cut(file: BinaryIO, size: int, offset: int, dialect: Dialect) -> bool:
    file.seek(max(offset, size - _TAIL))
    lines = file.read(_TAIL).decode("utf-8", "replace").split("\n")[1:]
    if len(lines) <= _LINES_ABOVE or not lines[-1].strip():
        return False
    ends = [dialect.cells(line)[-1:] for line in lines[-_LINES_ABOVE - 1 :] if line.strip()]
    digits = [len(re.split("[.,]", end[0])[-1]) if end and re.search("[.,]", end[0]) else 0 for end in ends]
    return len(set(digits[:-1])) == 1 and digits[-1] < digits[0]


def _decoded(raw: bytes, path: Path, number: int) -> str:
    if len(raw) >= _LONGEST_LINE:
        raise _long_line(path)
    try:
        return raw.decode("utf-8-sig" if number == 1 else "utf-8")
    except UnicodeDecodeError:
        raise TrajectoryError(f"{path}: line {number} is not UTF-8 text. Save it as CSV in UTF-8.") from None


def _is_row(raw: bytes) -> bool:
    """Whether a line is neither blank nor a comment."""
    return bool(raw.strip()) and not raw.lstrip(b" \t").startswith(b"#")


def _lines(file: BinaryIO, path: Path) -> Iterator[tuple[bytes, int]]:
    """Blocks of whole lines, and how many bytes were read for each."""
    rest = b""
    while text := file.read(_BLOCK):
        size, text = len(text), rest + text
        cut = text.rfind(b"\n") + 1
        if not cut and len(text) > _LONGEST_LINE:
            raise _long_line(path)
        rest = text[cut:]
        if cut:
            yield text[:cut], size
    if rest:
        yield rest, len(rest)


def _long_line(path: Path) -> TrajectoryError:
    return TrajectoryError(f"{path}: a line of more than {_LONGEST_LINE} bytes. Rows must end in newlines.")
