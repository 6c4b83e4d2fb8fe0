"""Rows to lanes and back with AVX2: as :mod:`.rows`, in machine instructions. A register takes ``lanes`` rows of one column."""

from __future__ import annotations

from .avx2_code import Avx2Code
from .processor import Precision


class _Columns:
    def __init__(self, code: Avx2Code, port: int, columns: int, precision: Precision) -> None:
        self.code, self.port, self.columns, self.bytes = code, port, columns, precision.bytes
        self.width = 16 // precision.bytes
        self.half = self.width
        """Rows in half a register: row r of the lower half lies beside row r + half of the upper."""

    def offset(self, row: int, column: int) -> int:
        return (row * self.columns + column) * self.bytes

    def transposed(self, v: list[int]) -> list[int]:
        """Transpose the squares in both halves of ``width`` registers; its own inverse."""
        code = self.code
        if self.width == 2:
            return [code.binary("vunpckl", v[0], v[1]), code.binary("vunpckh", v[0], v[1])]
        a, b = code.binary("vunpckl", v[0], v[1]), code.binary("vunpckl", v[2], v[3])
        c, d = code.binary("vunpckh", v[0], v[1]), code.binary("vunpckh", v[2], v[3])
        return [code.pairs(which, x, y) for x, y in ((a, b), (c, d)) for which in ("vunpckl", "vunpckh")]


class ColumnLoader(_Columns):
    """Columns of an input array; a piece of 128 bits a row is loaded at the first use of one of its columns."""

    def __init__(self, code: Avx2Code, port: int, columns: int, precision: Precision) -> None:
        super().__init__(code, port, columns, precision)
        self.ready: dict[int, int] = {}

    def column(self, c: int) -> int:
        """The register's value that holds the column."""
        if c not in self.ready:
            start = min(c - c % self.width, self.columns - self.width)
            if start < 0:
                self.ready[c] = self._gathered(c)
            else:
                for k, value in enumerate(self._loaded(start)):
                    self.ready.setdefault(start + k, value)
        return self.ready[c]

    def _loaded(self, start: int) -> list[int]:
        rows = []
        for r in range(self.half):
            low = self.code.load(self.port, self.offset(r, start))
            rows.append(self.code.insert(low, self.port, self.offset(r + self.half, start)))
        return self.transposed(rows)

    def _gathered(self, c: int) -> int:
        return self.code.gathered(self.port, [self.offset(row, c) for row in range(2 * self.half)])


class ColumnStorer(_Columns):
    """Columns of an output array, stored in tiles as wide as a register as soon as these are complete."""

    def __init__(self, code: Avx2Code, port: int, columns: int, precision: Precision) -> None:
        super().__init__(code, port, columns, precision)
        self.lanes = 2 * self.half
        self.span = next((n for n in (self.lanes, self.width) if columns >= n), 1)
        starts = [*range(0, columns - self.span + 1, self.span)]
        if columns % self.span:
            starts.append(columns - self.span)
        self.missing = dict.fromkeys(starts, self.span)
        self.ready: dict[int, int] = {}

    def put(self, c: int, value: int) -> None:
        """Hand over one column, once."""
        self.ready[c] = value
        for start in sorted({c - c % self.span, self.columns - self.span}):
            if start in self.missing and start <= c < start + self.span:
                self.missing[start] -= 1
                if not self.missing[start]:
                    self._store(start)

    def _store(self, start: int) -> None:
        v = [self.ready[start + k] for k in range(self.span)]
        if self.span == 1:
            self.code.scatter(v[0], self.port, [self.offset(row, start) for row in range(self.lanes)])
        else:
            self._store_tile(start, v)

    def _store_tile(self, start: int, v: list[int]) -> None:
        code, half = self.code, self.half
        if self.code.is_constant(v):
            for row in range(self.lanes):
                self.code.store(v[0], self.port, self.offset(row, start), whole=self.span == self.lanes)
            return
        left = self.transposed(v[:half])
        if self.span == self.width:
            for r, x in enumerate(left):
                code.store(x, self.port, self.offset(r, start), whole=False)
                code.store_upper(x, self.port, self.offset(r + half, start))
            return
        right = self.transposed(v[half:])
        for r, (x, y) in enumerate(zip(left, right, strict=True)):
            code.store(code.joined(x, y, 0x20), self.port, self.offset(r, start), whole=True)
            code.store(code.joined(x, y, 0x31), self.port, self.offset(r + half, start), whole=True)
