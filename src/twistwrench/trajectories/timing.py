"""s(t) of the fastest timing, from the pieces of x(s) = ds²."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..typing import Array
from .collocation import Cell

_GAUSS, _WEIGHTS = np.polynomial.legendre.leggauss(16)
_GAUSS, _WEIGHTS = 0.5 * (_GAUSS + 1.0), 0.5 * _WEIGHTS
_AT_ONCE = 2048
"""Samples whose numbers at the points of Gauss's rule fit into a near cache."""


@dataclass(frozen=True, eq=False)
class FastestScaling:
    """s(t) with ds² the pieces' x(s); rate and acceleration are x's own, so limits hold wherever it is asked."""

    cells: tuple[Cell, ...]
    name: str = "fastest"

    @cached_property
    def _low(self) -> Array:
        return np.array([c.low for c in self.cells])

    @cached_property
    def _size(self) -> Array:
        return np.array([c.high - c.low for c in self.cells])

    @cached_property
    def _x(self) -> Array:
        return np.stack([c.x for c in self.cells])

    @cached_property
    def _flipped(self) -> Array:
        """Whether a piece slows down: then its time is counted from its end."""
        return np.array([c.x.sum() < c.x[0] for c in self.cells])

    @cached_property
    def times(self) -> Array:
        """When each piece begins, and the end; (n + 1,) s."""
        k = np.arange(len(self.cells))
        return np.concatenate([[0.0], np.cumsum(self._since(k, np.ones(len(k))))])

    @property
    def duration(self) -> float:
        """T [s]."""
        return float(self.times[-1])

    def _square(self, k: Array, z: Array) -> Array:
        """x at the share z of piece k; (n), (n, m) → (n, m)."""
        out = np.zeros(np.shape(z))
        for c in self._x[k].T[::-1]:
            out = out * z + c[:, None]
        return np.maximum(out, 0.0)

    @cached_property
    def _whole(self) -> Array:
        """∫ ds/√x over each piece, counted from where it is slowest."""
        k = np.arange(len(self.cells))
        one = np.ones(len(k))
        return np.where(self._flipped, self._integral(k, one, -1.0), self._integral(k, one, 1.0))

    def _since(self, k: Array, z: Array) -> Array:
        """∫ ds/√x over the first share z of piece k; (n), (n) → (n)."""
        flipped = self._flipped[k]
        found = self._integral(k, np.where(flipped, 1.0 - z, z), np.where(flipped, -1.0, 1.0)[:, None])
        return np.where(flipped, self._whole[k] - found, found)

    def _integral(self, k: Array, z: Array, way: Array | float) -> Array:
        """∫ ds/√x over the share z from the beginning, or for ``way`` -1 the end; ζ = z w² takes away the root at rest."""
        w = _GAUSS[None, :]
        at = z[:, None] * w * w
        with np.errstate(divide="ignore", invalid="ignore"):
            f = 2 * w / np.sqrt(self._square(k, np.where(way > 0, at, 1.0 - at)))
        # Row by row, so that what is found at one sample does not depend on how many others there are.
        return self._size[k] * z * np.vecdot(np.where(np.isfinite(f), f, 0.0), _WEIGHTS)

    def __call__(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """s, ds/dt and d²s/dt² at t [s]; (...) → (...) each. Before 0 and after T it rests at the ends."""
        given = np.asarray(arguments.real(t, "t"), float)
        flat = np.clip(given.ravel(), 0.0, self.duration)
        known = ~np.isnan(flat)
        flat = np.where(known, flat, 0.0)
        k = np.clip(np.searchsorted(self.times, flat, side="right") - 1, 0, len(self.cells) - 1)
        since, z = flat - self.times[k], np.empty(len(k))
        for first in range(0, len(k), _AT_ONCE):
            some = slice(first, first + _AT_ONCE)
            z[some] = self._inverted(k[some], since[some])
        x = self._square(k, z[:, None])[:, 0]
        u = np.zeros(len(k))
        for n in range(self._x.shape[1] - 1, 0, -1):
            u = u * z + n * self._x[k, n]
        u = 0.5 * u / self._size[k]
        outside = (given.ravel() < 0) | (given.ravel() > self.duration)
        lost = np.where(known, 0.0, np.nan)
        s = self._low[k] + z * self._size[k]
        out = (s, np.where(outside, 0.0, np.sqrt(x)), np.where(outside, 0.0, u))
        return tuple((y + lost).reshape(given.shape) for y in out)  # type: ignore[return-value]

    def _inverted(self, k: Array, since: Array) -> Array:
        """The share z of piece k covered in the time ``since``: Newton's method kept within a bracket."""
        whole = np.diff(self.times)[k]
        low, high = np.zeros(len(k)), np.ones(len(k))
        share = np.clip(since / np.where(whole > 0, whole, 1.0), 0.0, 1.0)
        begins, ends = self._x[k, 0] == 0, k == len(self.cells) - 1
        z = np.where(begins, share**2, np.where(ends, 1.0 - (1.0 - share) ** 2, share))
        left = np.arange(len(k))  # samples whose share is not known yet
        for _ in range(60):
            mine, at = k[left], z[left]
            off = self._since(mine, at) - since[left]
            low[left] = np.where(off <= 0, at, low[left])
            high[left] = np.where(off >= 0, at, high[left])
            rate = np.sqrt(self._square(mine, at[:, None])[:, 0])
            step = at - off * rate / self._size[mine]
            new = np.where((step > low[left]) & (step < high[left]), step, 0.5 * (low[left] + high[left]))
            new = np.where(off == 0, at, new)
            z[left] = new
            left = left[np.abs(new - at) > 4e-16 * np.maximum(new, 1e-3)]
            if not len(left):
                break
        return z
