"""Runs of rows of a table that can only be read from its beginning: kept as its blocks pass by."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from ..typing import Array


def passing_runs(tables: Callable[[], Iterable[Array]], count: int, rows: int, *, whole: bool) -> list[Array]:
    """Up to ``count`` runs of ``rows`` rows spread evenly over blocks of a table, which are passed over twice.

    All rows as one run where ``whole``, or where there are no more.

    >>> blocks = [np.arange(6.0).reshape(3, 2), np.arange(6.0, 14.0).reshape(4, 2)]
    >>> [run[:, 0].tolist() for run in passing_runs(lambda: blocks, 2, 2, whole=False)]
    [[0.0, 2.0], [10.0, 12.0]]
    """
    total = 0 if whole else sum(len(table) for table in tables())
    if whole or total <= count * rows:
        return [np.concatenate(list(tables()))]
    firsts = [(total - rows) * k // max(1, count - 1) for k in range(count)]
    runs: list[list[Array]] = [[] for _ in firsts]
    at = 0
    for table in tables():
        for k, first in enumerate(firsts):
            inside = table[max(0, first - at) : max(0, first + rows - at)]
            if len(inside):
                runs[k].append(inside.copy())
        at += len(table)
    return [np.concatenate(run) for run in runs]
