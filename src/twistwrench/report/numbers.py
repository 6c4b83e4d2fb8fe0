"""Decimal numbers from text, a block at a time: eight digits of every number in a handful of integer operations.

A number like ``-0.612345`` is taken as the integer 0612345 over 10^6. Both are exact in float64 up to 15 digits, so
their quotient is the correctly rounded value, the one ``float("-0.612345")`` gives. What does not fit the pattern (an
exponent, more digits) goes through ``float`` by itself: how numbers are written changes the speed, never the result.
"""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

__all__ = ["parse_table"]

_COMMA, _DOT, _MINUS, _NEWLINE = 44, 46, 45, 10
_PAD = b"0" * 16  # so that the eight or sixteen bytes that end at a number's end are always there
_BYTES = np.uint64(0x0101010101010101)
_POWERS = 10.0 ** np.arange(17)


def parse_table(text: bytes, columns: int) -> Array | None:
    """Rows of ``columns`` comma-separated numbers, a line each and every line ended → (rows, columns).

    None when the text is anything else: the caller then looks for the line to blame.
    """
    if b"_" in text:  # Python's float would take 1_000
        return None
    fast = _parse_plain_decimals(text, columns)
    if fast is not None:
        return fast
    try:
        table = np.loadtxt(io.BytesIO(text), delimiter=",", comments=None, ndmin=2)
    except ValueError:
        return None
    return np.asarray(table) if table.shape[1] == columns else None


def _parse_plain_decimals(text: bytes, columns: int) -> Array | None:
    """As :func:`parse_table`, for blocks where nearly every number is plain digits; None for all others."""
    padded = _PAD + text
    raw = np.frombuffer(padded, np.uint8)
    marks = np.flatnonzero((raw == _COMMA) | (raw == _DOT) | (raw == _NEWLINE))
    kinds = raw[marks]
    ends_at = np.flatnonzero(kinds != _DOT)  # which marks end a number
    ends = marks[ends_at]
    if ends.size % columns or ends.size == 0:
        return None
    kinds = kinds[ends_at].reshape(-1, columns)
    if (kinds[:, :-1] != _COMMA).any() or (kinds[:, -1] != _NEWLINE).any():
        return None
    dots = np.diff(ends_at, prepend=-1) - 1  # points in each number: 0 or 1, or it is no number
    starts = np.concatenate([[len(_PAD)], ends[:-1] + 1])
    after_point = np.where(dots == 1, ends - marks[ends_at - 1] - 1, 0)

    negative = raw[starts] == _MINUS
    # The same text without points: every number is then an unbroken run of digits, and ends where its end moved to.
    digits = padded.translate(None, b".")
    ends_moved = ends - np.cumsum(dots)
    length = ends - starts - dots - negative
    mantissa, bad = _integers(digits, ends_moved, length)
    bad |= (dots > 1) | (length < 1) | (length > 15)
    wrong = np.flatnonzero(bad)
    if wrong.size > 0.05 * bad.size:
        return None
    values = mantissa / _POWERS[np.minimum(after_point, 16)]
    np.negative(values, out=values, where=negative)
    for k in wrong:
        try:
            values[k] = float(padded[starts[k] : ends[k]])
        except ValueError:
            return None
    return np.asarray(values.reshape(-1, columns))


def _integers(digits: bytes, ends: Array, length: Array) -> tuple[Array, Array]:
    """The ``length`` ≤ 16 digits before each of ``ends`` as float64, and whether any of them was no digit."""
    # Every eight consecutive bytes as one integer, by a view whose items overlap.
    words = np.ndarray((len(digits) - 7,), np.dtype("<u8"), digits, strides=(1,))
    low, bad = _eight_digits(words[ends - 8], np.minimum(length, 8))
    value = low.astype(float)
    if (length > 8).any():
        high, also_bad = _eight_digits(words[ends - 16], np.clip(length - 8, 0, 8))
        value += 1e8 * high
        bad |= also_bad
    return value, bad


def _eight_digits(word: Array, count: Array) -> tuple[Array, Array]:
    """The last ``count`` of eight characters (the highest bytes) as an integer, and whether one of them is no digit."""
    word = word ^ (np.uint64(0x30) * _BYTES)  # '0'…'9' become 0…9
    # Forget the characters before the number; shifting by 64 in one step would be undefined, so in two.
    drop = ((8 - np.maximum(count, 0)) * 4).astype(np.uint64)
    word = word >> drop >> drop << drop << drop
    bad = ((word + np.uint64(0x76) * _BYTES) | word) & (np.uint64(0x80) * _BYTES) != 0
    # Neighbours pair up three times: 8 digits, 4 numbers below 100, 2 below 10⁴, 1 below 10⁸.
    word = (word * np.uint64(10) + (word >> np.uint64(8))) & np.uint64(0x00FF00FF00FF00FF)
    word = (word * np.uint64(100) + (word >> np.uint64(16))) & np.uint64(0x0000FFFF0000FFFF)
    word = (word * np.uint64(10000) + (word >> np.uint64(32))) & np.uint64(0x00000000FFFFFFFF)
    return word, bad
