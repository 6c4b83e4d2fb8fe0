"""CSV files of numbers: dialects, block reader with bounded memory, and errors with line numbers."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import BinaryIO

import numpy as np

from ...core.errors import NotFoundError, TrajectoryError, ValueRangeError
from ...core.files import as_path
from ...core.tables import unescape_cell
from ...core.typing import Array
from ..column_names import PART_OF, SUFFIX
from ..log_table import table_of
from .file_ends import FileEnds
from .text_source import TextSource

_NUMBER = re.compile(r"[ \t]*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?[ \t]*")
"""Decimal number, with a point if it has decimals."""
_SEPARATORS = (";", "\t", ",", None)
"""Separators in order of preference; None for blanks."""
_NUMBER_WITH_COMMA = re.compile(r"\s*[+-]?\d*,\d+\s*")
"""Number with a decimal comma."""
_MAX_QUOTED_LENGTH = 60
"""Largest number of characters of a line that an error quotes."""
_MAX_QUOTED_CELL = 40
"""Number of characters of a cell that an error quotes."""


def is_number(cell: str, *, decimal_comma: bool = False) -> bool:
    """True if a cell is a finite decimal number.

    >>> is_number(" -1.5e3 "), is_number("1_000"), is_number("0,5"), is_number("0,5", decimal_comma=True)
    (True, False, False, True)
    """
    if decimal_comma:
        if "." in cell:
            return False
        cell = cell.replace(",", ".")
    return _NUMBER.fullmatch(cell) is not None


@dataclass(frozen=True)
class Dialect:
    """Cell separator; None for blanks. Commas are decimal marks unless they are the separator."""

    separator: str | None = ","

    @classmethod
    def from_header(cls, header: str, row: str | None) -> Dialect:
        """Dialect with as many cells in the header as in the ``row`` below it, which is None if there is no row."""
        header_counts = {}  # number of cells by separator
        for separator in _SEPARATORS:
            count = len(cls(separator).cells(header))
            if count > 1:
                header_counts[separator] = count
        if not header_counts:  # one column
            if row is not None and _NUMBER_WITH_COMMA.fullmatch(row):
                return cls(";")  # any separator but a comma
            return cls()
        if row is not None:
            only_blanks_separate = set(header_counts) == {None}
            if only_blanks_separate and len(row.split()) == 1:  # one column, with a blank in its name
                return cls()
            for separator, count in header_counts.items():
                if len(cls(separator).cells(row)) == count:
                    return cls(separator)
        return cls(min(header_counts, key=_SEPARATORS.index))

    def cells(self, line: str) -> list[str]:
        """Cells of a line, stripped of blanks; an unclosed quote is an ordinary character."""
        if self.separator is None:
            return [cell.strip('"') for cell in line.split()]
        try:
            cells = next(csv.reader([line], delimiter=self.separator, skipinitialspace=True, strict=True), [])
        except csv.Error:
            cells = line.split(self.separator)
        return [unescape_cell(cell.strip()) for cell in cells]

    def has_decimal_commas(self, text: str | bytes) -> bool:
        """True if a text contains decimal commas."""
        if self.separator == ",":
            return False
        if isinstance(text, str):
            return "," in text
        return b"," in text

    def number(self, cell: str) -> float | None:
        """Finite number in a cell, with a decimal comma unless commas are the separator; None for other text.

        >>> Dialect(";").number("-0,5"), Dialect(";").number("0.5"), Dialect(",").number("1e3"), Dialect(",").number("x")
        (-0.5, 0.5, 1000.0, None)
        """
        decimal_comma = self.has_decimal_commas(cell)
        if not is_number(cell, decimal_comma=decimal_comma):
            return None
        value = float(cell.replace(",", "."))
        if not math.isfinite(value):
            return None
        return value

    @property
    def name(self) -> str:
        """Name for use in a sentence."""
        return {",": "commas", ";": "semicolons", "\t": "tabs", None: "blanks"}[self.separator]


_MISSING_NUMBERS = ("nan", "inf", "infinity")
"""Words for a missing number, with or without a sign."""


def blame(
    text: bytes, path: Path, line: int, header: Sequence[str], used: Sequence[int], dialect: Dialect
) -> TrajectoryError:
    """Error for the first faulty line of ``text``, in which at least one line is faulty.

    ``line`` is the line number in the file at which the text begins; ``used`` are the indices of the columns that are read.
    """
    decimal_comma = dialect.has_decimal_commas(text)
    lines = text.decode("utf-8", "replace").split("\n")
    names = [header[k] for k in used]

    def missing_field(raw: str) -> str | None:
        """Text on the first missing number of a line; None if none is missing, or if the line has another fault."""
        cells = dialect.cells(raw)
        if _is_skipped(raw) or len(cells) != len(header):
            return None
        return _missing_field([cells[k] for k in used], names, decimal_comma=decimal_comma)

    for index, raw in enumerate(lines):
        if _is_skipped(raw):
            continue
        missing_text = missing_field(raw)
        if missing_text:
            last_index = index  # of the lines below that lack a number too
            while last_index + 1 < len(lines) and missing_field(lines[last_index + 1]):
                last_index += 1
            end = ". Samples must be finite: fill or remove the row."
            if last_index > index:
                end = f", and so on to line {line + last_index}. Samples must be finite: fill or remove these rows."
            return TrajectoryError(f"{path}: line {line + index}{missing_text}{end}")
        fault = _bytes_fault(raw)
        if fault is None:
            fault = _shape_fault(raw, header, dialect)
        if fault is None:
            cells = dialect.cells(raw)
            fault = _number_fault([cells[k] for k in used], names, decimal_comma=decimal_comma)
        if fault is not None:
            return TrajectoryError(f"{path}: line {line + index}{fault}")
    return TrajectoryError(f"{path}: rows that cannot be read as numbers. Save it as plain CSV.")


def _is_skipped(raw: str) -> bool:
    """True if a line is blank or a comment."""
    return not raw.strip() or raw.lstrip(" \t").startswith("#")


def _missing_field(fields: Sequence[str], names: Sequence[str], *, decimal_comma: bool) -> str | None:
    """Text on the first non-finite field, if all others are numbers; otherwise None."""
    first_text = None
    for name, field in zip(names, fields, strict=True):
        if field.lower().lstrip("+-") in _MISSING_NUMBERS:
            is_missing = True
        elif is_number(field, decimal_comma=decimal_comma):
            is_missing = not math.isfinite(float(field.replace(",", ".")))
        else:
            return None
        if is_missing and first_text is None:
            first_text = f", column {name!r} is {field[:_MAX_QUOTED_CELL]!r}"
    return first_text


def _bytes_fault(raw: str) -> str | None:
    """Text on characters that no text file has; None if there are none."""
    if "\ufffd" in raw:  # the replacement of bytes that are not UTF-8
        return f" is not UTF-8 text: {_clip(raw)}. Save it as CSV in UTF-8."
    for character in raw:
        is_control = character < " " or character == "\x7f"
        if is_control and character != "\t":
            return (
                f" has a control character, {character!r}: {_clip(raw)}. The file may be damaged or binary; write the row "
                "again."
            )
    return None


def _shape_fault(raw: str, header: Sequence[str], dialect: Dialect) -> str | None:
    """Text on a line with another number of cells than the header, or with an open quote; None for other lines."""
    fields = dialect.cells(raw)
    if raw.count('"') % 2:
        return f" has a quote that never ends: {_clip(raw)}. Remove the quote."
    if len(fields) == len(header):
        return None
    if dialect.separator == "," and ";" in raw:
        return f": semicolons between values: {_clip(raw)}, and commas in the header. Separate all rows as the header."
    counts = f" has {len(fields)} values, and the header names {len(header)} columns: {_clip(raw)}."
    if len(fields) < len(header):
        return f"{counts} The row is cut short; complete or remove it."
    seems_decimal_comma = dialect.separator == "," and len(fields) >= 2 * len(header) - 1  # two cells for each number
    if seems_decimal_comma:
        return (
            f"{counts} If commas are decimal marks here, separate values by semicolons, or write decimals with a point "
            "(0.5, not 0,5)."
        )
    return f"{counts} Remove the extra cells."


def _number_fault(fields: Sequence[str], names: Sequence[str], *, decimal_comma: bool) -> str | None:
    """Text on the first field that is not a number; None if all are numbers."""
    for name, field in zip(names, fields, strict=True):
        if is_number(field, decimal_comma=decimal_comma) or field.lower().lstrip("+-") in _MISSING_NUMBERS:
            continue
        column = f", column {name!r}"
        quoted_field = repr(field[:_MAX_QUOTED_CELL])
        if "_" in field:
            return f"{column} is {quoted_field}. Numbers are written without underscores."
        if decimal_comma and "." in field:
            return f"{column} is {quoted_field}, with a point where other rows have decimal commas. Write all of them alike."
        if "," in field and not decimal_comma and is_number(field, decimal_comma=True):
            return f"{column} is {quoted_field}. Where commas separate values, decimals are written with a point (0.5)."
        fault = "is blank"
        if field:
            fault = f"is {quoted_field}, which is not a number"
        return f"{column} {fault}. Every row needs a number such as -0.25 in every column that is used."
    return None


def _clip(raw: str) -> str:
    """Line in quotes; a long line is cut, with an ellipsis."""
    if len(raw) > _MAX_QUOTED_LENGTH:
        raw = raw[: _MAX_QUOTED_LENGTH - 3] + "…"
    return repr(raw)


_CONTROL_CHARACTERS = bytes(code for code in range(32) if code not in (9, 10)) + b"\x7f"
"""Control characters of ASCII, except tabs and newlines."""
_COMMENTS = re.compile(rb"^[ \t]*(#[^\n]*)?$", re.MULTILINE)
"""Comments and blanks that fill a line."""


def parse_block(text: bytes, dialect: Dialect, column_count: int, used: Sequence[int]) -> Array | None:
    """Parse the ``used`` columns of lines with ``column_count`` cells → (rows, len(used)), with the values of ``float()``.

    Blank lines and lines that begin with # are skipped. Returns None if a line has another number of cells, or a used
    cell is not a finite number.
    """
    if text.translate(None, _CONTROL_CHARACTERS) != text:  # some were removed
        return None
    if b"#" in text:
        text = _COMMENTS.sub(b"", text)
    is_plain = text.isascii() and b'"' not in text
    if dialect.has_decimal_commas(text):
        is_plain = is_plain and b"." not in text
        if is_plain:
            text = text.replace(b",", b".")
    table = None
    if is_plain:
        table = _parse_with_numpy(text, dialect, column_count, used)
    if table is None:
        table = _parse_cells(text, dialect, column_count, used)
    return table


def normalise_newlines(text: bytes) -> bytes:
    """Convert line ends to newlines, including the last; b"" for blank text."""
    if b"\r" in text:
        text = text.replace(b"\r\n", b"\n")
    if text.isspace() or not text:
        return b""
    if not text.endswith(b"\n"):
        text += b"\n"
    return text


def _parse_with_numpy(text: bytes, dialect: Dialect, column_count: int, used: Sequence[int]) -> Array | None:
    """Parse by NumPy's reader, as :func:`parse_block`; None if it cannot read the text, or might read it otherwise."""
    if not text.strip():
        return np.zeros((0, len(used)))
    uses_all_columns = len(used) == column_count
    if not uses_all_columns and not _has_equal_lines(text, dialect, column_count):
        return None
    try:
        table = np.loadtxt(
            io.BytesIO(text),
            delimiter=dialect.separator,
            comments=None,
            usecols=None if uses_all_columns else list(used),
            ndmin=2,
        )
    except (ValueError, IndexError, OverflowError):
        return None
    if uses_all_columns and table.shape[1] == column_count:
        table = table[:, list(used)]
    if table.shape[1] != len(used) or not np.isfinite(table).all():
        return None
    return np.asarray(table)


def _has_equal_lines(text: bytes, dialect: Dialect, column_count: int) -> bool:
    """True if every line has ``column_count`` cells, except blank lines."""
    if dialect.separator is None:
        return all(len(line.split()) in (0, column_count) for line in text.split(b"\n"))
    characters = np.frombuffer(text, np.uint8)
    is_newline = characters == ord("\n")
    after_newlines = np.flatnonzero(is_newline) + 1
    line_starts = np.r_[0, after_newlines][:-1]  # no line starts after the last newline
    is_separator = characters == ord(dialect.separator)
    separator_counts = np.add.reduceat(is_separator, line_starts, dtype=np.int64)
    is_blank = is_newline[line_starts]
    has_all_cells = separator_counts == column_count - 1
    return bool((has_all_cells | is_blank).all())


def _parse_cells(text: bytes, dialect: Dialect, column_count: int, used: Sequence[int]) -> Array | None:
    """Parse cell by cell: handles quotes, text in unused columns, and mixed decimal commas and points."""
    try:
        lines = text.decode("utf-8").split("\n")
    except UnicodeDecodeError:
        return None
    decimal_comma = dialect.has_decimal_commas(text)
    rows = []
    for line in lines:
        if not line.strip():
            continue
        cells = dialect.cells(line)
        if len(cells) != column_count:
            return None
        row = [cells[k] for k in used]
        if not all(is_number(cell, decimal_comma=decimal_comma) for cell in row):
            return None
        rows.append([float(cell.replace(",", ".")) for cell in row])
    table = np.array(rows, float).reshape(len(rows), len(used))
    if not np.isfinite(table).all():
        return None
    return table


_BLOCK_SIZE = 1 << 18
"""Bytes that are read at once: a parsed block fits into the processor's cache."""
_MAX_LINE_SIZE = 1 << 22
"""Longest line [bytes]."""
_MIN_LINES_ABOVE = 8
"""Number of lines above the last one with which its decimals are compared."""


class EmptyTableError(TrajectoryError):
    """Error of an empty file."""


@contextmanager
def table_errors(path: str | Path, what: str, form: str) -> Iterator[None]:
    """Convert errors of a CSV file to NotFoundError or ValueRangeError; ``what`` and ``form`` are its content, for messages."""
    try:
        yield
    except NotFoundError:
        raise NotFoundError(f"no {what} {str(path)!r}. Give a CSV file: {form}.") from None
    except EmptyTableError:
        raise ValueRangeError(f"{path}: the {what} is empty. Give a CSV file: {form}.") from None
    except TrajectoryError as error:
        raise ValueRangeError(str(error)) from None


@dataclass(frozen=True, eq=False)
class CsvFile:
    """CSV file whose header has been read; rows are read on demand."""

    source: TextSource
    header: tuple[str, ...]
    header_line: int
    """Line number of the header, from 1."""
    data_offset: int
    """Offset of the first row [bytes]."""
    dialect: Dialect
    seems_cut: bool = False
    """True if the last line lacks a line end, and its last number has fewer decimals than the lines above."""

    @classmethod
    def open(cls, path: str | Path | FileEnds) -> CsvFile:
        r"""Read the header and detect the cell separator from the row below it.

        Supports commas, semicolons, tabs or blanks; decimal commas if commas are not the separator; UTF-8 or UTF-16;
        plain or gzip. Lines that begin with # are comments. If there is no other header, the comment directly above the
        rows is the header, as written by ``numpy.savetxt``. Raises :class:`~twistwrench.NotFoundError` and
        :class:`~twistwrench.TrajectoryError`.
        """
        ends = path
        if not isinstance(ends, FileEnds):
            ends = FileEnds.from_path(as_path(ends))
        source = TextSource.from_ends(ends)
        with source.open() as file:
            first_line, comment = _header(file, source.path)
            row = next(_rows(file), None)
        dialect = Dialect.from_header(first_line.text, row)
        seems_cut = _seems_cut(source.ends.after(first_line.end_offset), dialect)
        header_line = first_line
        header = dialect.cells(first_line.text)
        if comment is not None and all(map(_is_any_number, header)):  # the first line is a row
            names = dialect.cells(comment.text)
            if len(names) == len(header) and not any(map(_is_any_number, names)):
                header = names
                header_line = comment
        has_ros_names = any(_ROS_NAME.fullmatch(cell) for cell in header)
        if row is not None and has_ros_names:
            with source.open() as file:
                file.seek(header_line.end_offset)
                rows = _first_rows(file, dialect, len(header))
            header = _ros_header(header, rows, source.path)
        return cls(source, tuple(header), header_line.number, header_line.end_offset, dialect, seems_cut)

    @property
    def path(self) -> Path:
        """Path of the file."""
        return self.source.path

    @property
    def size(self) -> int:
        """Size of the text [bytes]."""
        return self.source.size

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentence for a file that seems to be truncated; else empty."""
        if not self.seems_cut:
            return ()
        return (
            "The last line does not end, and its last number has fewer decimals than those above: the file seems to be cut "
            "short there. Complete or remove the row.",
        )

    def table(self, used: Sequence[int]) -> Array:
        """Table (n, len(used)) of the given columns; raises TrajectoryError for truncated rows and invalid numbers."""
        return table_of(self._portions(used), len(used), self.path)

    def first(self, column: int) -> Array:
        """Numbers of a column in the first block of the file."""
        no_rows = np.zeros((0, 1))
        portion = next(self._portions([column]), no_rows)
        return portion[:, 0]

    def _portions(self, used: Sequence[int]) -> Iterator[Array]:
        """Portions (n, len(used)) of the given columns."""
        line = self.header_line + 1
        with self.source.open() as file:
            file.seek(self.data_offset)
            for lines in _lines(file, self.path):
                text = normalise_newlines(lines)
                table = parse_block(text, self.dialect, len(self.header), used)
                if table is None:
                    raise blame(text, self.path, line, self.header, used, self.dialect)
                yield table
                line += lines.count(b"\n")

    def text_columns(self) -> tuple[int, ...]:
        """Columns with only words or blanks in the first rows, such as states (RUN)."""
        with self.source.open() as file:
            file.seek(self.data_offset)
            rows = _first_rows(file, self.dialect, len(self.header))
        columns = zip(*rows, strict=True)
        return tuple(k for k, cells in enumerate(columns) if all(map(_is_word, cells)))

    def place(self, row: int) -> str:
        """Place of a row, by its index in the table, as ``line 12``."""
        row_count = 0  # of the rows read before
        line = self.header_line
        with self.source.open() as file:
            file.seek(self.data_offset)
            for raw in file:
                line += 1
                if not _is_row(raw):
                    continue
                if row_count == row:
                    break
                row_count += 1
        return f"line {line}"

    def rows(self) -> Iterator[tuple[int, list[str]]]:
        """Line numbers (from 1) and cells of the lines of a short file, without blank lines and comments.

        Raises TrajectoryError for a line whose number of cells differs from the header's, and for a long file.
        """
        with self.source.open() as file:
            file.seek(self.data_offset)
            text = file.read(_MAX_LINE_SIZE + 1)
        if len(text) > _MAX_LINE_SIZE:
            raise TrajectoryError(f"{self.path}: has more than {_MAX_LINE_SIZE} bytes, too many for such a table.")
        lines = normalise_newlines(text).split(b"\n")
        for line, raw in enumerate(lines, self.header_line + 1):
            if _is_row(raw):
                cells = self.dialect.cells(_decode(raw, self.path, line))
                if len(cells) != len(self.header):
                    raise blame(raw, self.path, line, self.header, (), self.dialect)
                yield line, cells


def _is_word(cell: str) -> bool:
    """True if a cell is blank or a word, except the words for a missing number."""
    if not cell:
        return True
    return cell[0].isalpha() and cell.lower() not in _MISSING_NUMBERS


def _is_any_number(cell: str) -> bool:
    """True if a cell is a number with a decimal point or a decimal comma."""
    return is_number(cell) or is_number(cell, decimal_comma=True)


@dataclass(frozen=True)
class _HeaderLine:
    """Line of a file that may be its header."""

    text: str
    number: int
    """Line number, from 1."""
    end_offset: int
    """Offset of the next line [bytes]."""


def _header(file: BinaryIO, path: Path) -> tuple[_HeaderLine, _HeaderLine | None]:
    """First line that is neither blank nor a comment, and the last comment above it; None without one."""
    comment = None
    number = 0
    while raw := file.readline(_MAX_LINE_SIZE):
        number += 1
        text = _decode(raw, path, number).strip(" \r\n")
        if not text.strip():
            continue
        if not text.lstrip().startswith("#"):
            return _HeaderLine(text, number, file.tell()), comment
        comment = _HeaderLine(text.strip().lstrip("#").strip(), number, file.tell())
    raise EmptyTableError(
        f"{path}: the file is empty. A motion file has a header, time and joint names separated by commas, then rows."
    )


def _rows(file: BinaryIO) -> Iterator[str]:
    """Yield lines that are neither blank nor comments."""
    while raw := file.readline(_MAX_LINE_SIZE):
        text = raw.decode("utf-8", "replace").strip(" \r\n")
        if text.strip() and not text.lstrip().startswith("#"):
            yield text


def _first_rows(file: BinaryIO, dialect: Dialect, column_count: int) -> list[list[str]]:
    """Cells of the first rows; rows with another number of cells than ``column_count`` are left out."""
    rows = map(dialect.cells, islice(_rows(file), _MAX_ROWS_READ))
    return [cells for cells in rows if len(cells) == column_count]


_ROS_NAME = re.compile(r"field\.name(\d+)")
"""Column of joint names by ``rostopic echo -p``."""
_ROS_QUANTITY = re.compile(r"field\.(position|velocity|effort)(\d+)")
"""Column of a joint's quantity by ``rostopic echo -p``."""
_MAX_ROWS_READ = 1000
"""Number of rows inspected for constant joint names and for columns of text."""


def _ros_header(cells: list[str], rows: list[list[str]], path: Path) -> list[str]:
    """Replace the columns ``field.nameN`` of ``rostopic echo -p`` by a header with the joint names in their cells."""
    joint_by_number = {}  # by the number in the name of a column
    for k, cell in enumerate(cells):
        match = _ROS_NAME.fullmatch(cell)
        if match is None or not rows:
            continue
        joint_names = [row[k] for row in rows]
        first_name = joint_names[0]
        joint_by_number[match[1]] = first_name
        for row, name in enumerate(joint_names, start=1):
            if name and name != first_name:
                raise TrajectoryError(
                    f"{path}: row {row} names a joint {name!r} where the first row names another, so that "
                    "several programs wrote joint states here. Record one of them: rostopic echo -p --filter."
                )
    header = []
    for cell in cells:
        match = _ROS_QUANTITY.fullmatch(cell)
        if match:
            quantity, number = match.groups()
            joint = joint_by_number.get(number)
            if joint:
                header.append(joint + SUFFIX[PART_OF[quantity]])
                continue
        header.append(cell)
    return header


def _seems_cut(end: bytes, dialect: Dialect) -> bool:
    """True if a file, of which ``end`` are the last bytes, ends in a number with fewer decimals than the lines above."""
    _, *lines = end.decode("utf-8", "replace").split("\n")  # the first one may be incomplete
    if len(lines) <= _MIN_LINES_ABOVE or not lines[-1].strip():
        return False
    decimal_counts = []
    for line in lines[-_MIN_LINES_ABOVE - 1 :]:
        if line.strip():
            cells = dialect.cells(line)
            last_cell = cells[-1] if cells else ""
            _, mark, decimals = last_cell.replace(",", ".").rpartition(".")
            decimal_counts.append(len(decimals) if mark else 0)
    *counts_above, last_count = decimal_counts
    are_equal_above = len(set(counts_above)) == 1
    return are_equal_above and last_count < counts_above[0]


def _decode(raw: bytes, path: Path, number: int) -> str:
    """Text of a line with this number, without a byte-order mark; raises TrajectoryError."""
    if len(raw) >= _MAX_LINE_SIZE:
        raise _long_line(path)
    try:
        if number == 1:
            return raw.decode("utf-8-sig")
        return raw.decode("utf-8")
    except UnicodeDecodeError:
        raise TrajectoryError(f"{path}: line {number} is not UTF-8 text. Save it as CSV in UTF-8.") from None


def _is_row(raw: bytes) -> bool:
    """True if a line is neither blank nor a comment."""
    return bool(raw.strip()) and not raw.lstrip(b" \t").startswith(b"#")


def _lines(file: BinaryIO, path: Path) -> Iterator[bytes]:
    """Yield blocks of whole lines."""
    remainder = b""
    while block := file.read(_BLOCK_SIZE):
        text = remainder + block
        end_of_lines = text.rfind(b"\n") + 1  # 0 without a newline
        if not end_of_lines and len(text) > _MAX_LINE_SIZE:
            raise _long_line(path)
        remainder = text[end_of_lines:]
        if end_of_lines:
            yield text[:end_of_lines]
    if remainder:
        yield remainder


def _long_line(path: Path) -> TrajectoryError:
    """Error for a line that is longer than the largest line."""
    return TrajectoryError(f"{path}: a line of more than {_MAX_LINE_SIZE} bytes. Rows must end in newlines.")
