"""A search on whole arrays, a NumPy kernel a step: the fallback where nothing compiles, and the oracle."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..program.search import ALLOWED, ATTEMPTS, TIMES, Search
from ..typing import Array
from .numpy import NumpyKernel


class NumpySearch:
    """Callable like the compiled ufunc of the same search; settings and places are those of all samples."""

    def __init__(self, search: Search, name: str, doc: str) -> None:
        self.search, self.__name__, self.__doc__ = search, name, doc
        self.signature = search.signature
        self.kernel = NumpyKernel(search.program, name, doc)

    def __repr__(self) -> str:
        return f"<NumpySearch {self.__name__!r} {self.signature}>"

    def __call__(
        self, target: Array, start: Array, settings: Array, places: Array, reached: Array, out: Any = None
    ) -> tuple[Array, ...]:
        """Make all attempts."""
        s = self.search
        size, rank = s.x.size, len(s.target.shape)
        batch = np.broadcast_shapes(target.shape[: target.ndim - rank], start.shape[:-1])
        wanted = np.broadcast_to(target, (*batch, *s.target.shape)).reshape(-1, s.target.size)
        x = np.minimum(np.maximum(np.broadcast_to(start, (*batch, size)).reshape(-1, size), s.least), s.most)
        given = np.concatenate([wanted, np.broadcast_to(self._allowed(settings), (len(x), self._count()))], axis=1)
        passed = self._attempt(given, x, int(settings[TIMES]))
        starts, rows = np.ones(len(x)), np.flatnonzero(_goes_on(passed[:, size]))
        gap = wanted[rows][:, list(s.near), None] - reached
        far = (settings[ALLOWED + self._count() :, None] * (gap * gap)).sum(axis=1)
        for _ in range(int(settings[ATTEMPTS])):
            if not len(rows):
                break
            nearest = np.argmin(far, axis=1)
            far[np.arange(len(rows)), nearest] = np.inf
            found, before = self._attempt(given[rows], places[nearest], int(settings[TIMES])), passed[rows]
            new, old = found[:, size + 1], before[:, size + 1]
            better = ~_goes_on(found[:, size]) | (new < old) | (np.isnan(old) & ~np.isnan(new))
            passed[rows] = np.where(better[:, None], found, before)
            starts[rows] += 1
            left = _goes_on(found[:, size])
            rows, far = rows[left], far[left]
        results = passed[:, :size], np.concatenate([starts[:, None], passed[:, size:-2]], axis=1)
        shaped = [a.reshape((*batch, -1)) for a in results]
        if out is not None:
            for place, a in zip(out, shaped, strict=True):
                place[...] = a
            return tuple(out)
        return tuple(shaped)

    def _count(self) -> int:
        return self.search.program.inputs[-1].size - self.search.target.size

    def _allowed(self, settings: Array) -> Array:
        return settings[ALLOWED : ALLOWED + self._count()]

    def _attempt(self, given: Array, x: Array, times: int) -> Array:
        """Steps from starts until there, or until nothing gets nearer: what the last ones pass on."""
        passed = np.concatenate([x, np.broadcast_to(self.search.begins, (len(x), len(self.search.begins)))], axis=1)
        rows = np.arange(len(x))
        for _ in range(times):
            x, passed[rows] = self.kernel(x, x, passed[rows], given[rows])
            goes = passed[rows, -1] > 0.0
            rows, x = rows[goes], x[goes]
            if not len(rows):
                break
        return passed


def _goes_on(there: Array) -> Array:
    """Where there is more to look for: neither there nor refused."""
    return np.asarray(~((there < 0) | (there > 0)))
