"""How the cells of a line of a CSV file are told apart: commas, semicolons, tabs or blanks."""

from __future__ import annotations

import csv
import math
import re
from dataclasses import dataclass

from ..core.csv_writer import meant_text

_NUMBER = re.compile(r"[ \t]*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?[ \t]*")
_SEPARATORS = (";", "\t", ",", None)
_DECIMAL_COMMA = re.compile(r"\s*[+-]?\d*,\d+\s*")


def is_number(cell: str, *, decimal_comma: bool = False) -> bool:
    """Whether a cell is a finite decimal number and nothing else.

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
    """What stands between the cells of a line; None for blanks. A comma marks decimals wherever it separates nothing."""

    separator: str | None = ","

    @classmethod
    def of(cls, header: str, row: str | None) -> Dialect:
        """That of a header and the row below it (None if there is none): the one that cuts both into as many cells."""
        cut = {s: cls(s).cells(header) for s in _SEPARATORS}
        many = {s: len(cells) for s, cells in cut.items() if len(cells) > 1}
        if not many:  # one column
            return cls(";") if row is not None and _DECIMAL_COMMA.fullmatch(row) else cls()
        if set(many) == {None} and row is not None and len(row.split()) == 1:  # one column, with a blank in its name
            return cls()
        for s, count in many.items():
            if row is not None and len(cls(s).cells(row)) == count:
                return cls(s)
        return cls(next(s for s in (";", "\t", ",", None) if s in many))

    def cells(self, line: str) -> list[str]:
        """The cells of one line without the blanks about them; a quote that never ends counts as a character."""
        if self.separator is None:
            return [cell.strip('"') for cell in line.split()]
        try:
            cells = next(csv.reader([line], delimiter=self.separator, skipinitialspace=True, strict=True), [])
        except csv.Error:
            cells = line.split(self.separator)
        return [meant_text(cell.strip()) for cell in cells]

    def has_decimal_commas(self, text: str | bytes) -> bool:
        """Whether commas in a text are decimal ones."""
        return self.separator != "," and ("," in text if isinstance(text, str) else b"," in text)

    def number(self, cell: str) -> float | None:
        """The finite number of a cell, with a decimal comma where commas separate nothing; None for what is none.

        >>> Dialect(";").number("-0,5"), Dialect(";").number("0.5"), Dialect(",").number("1e3"), Dialect(",").number("x")
        (-0.5, 0.5, 1000.0, None)
        """
        comma = self.has_decimal_commas(cell)
        value = float(cell.replace(",", ".")) if is_number(cell, decimal_comma=comma) else math.inf
        return value if math.isfinite(value) else None

    @property
    def name(self) -> str:
        """As it is called in a sentence."""
        return {",": "commas", ";": "semicolons", "\t": "tabs", None: "blanks"}[self.separator]
