"""Choices among numbers without a branch, on numbers and on symbols."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from .friction import signs


def positive(x: Any) -> Any:
    """1 where a number is above 0, else 0."""
    s = signs(np.array([x], object))[0]
    return 0.5 * (s + s * s)


def either(which: Any, a: Any, b: Any) -> Any:
    """a where ``which`` is 1, b where it is 0: to the bit, for numbers that are finite."""
    return which * a + (1.0 - which) * b


def largest(numbers: Iterable[Any], least: Any) -> Any:
    """The largest size among numbers, ``least`` at least; NaN where one is."""
    for x in numbers:
        least = abs(x).clip(least, np.inf) if hasattr(x, "clip") else max(abs(x), least)
    return least


def smallest(numbers: Iterable[Any], most: Any) -> Any:
    """The smallest of numbers, ``most`` at most; NaN where one is."""
    for x in numbers:
        most = x.clip(-np.inf, most) if hasattr(x, "clip") else min(x, most)
    return most
