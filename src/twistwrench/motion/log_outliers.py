"""Samples that smoothing removed although they are no noise: knocks and glitches, far from the curve for their column."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..typing import Array
from .smoothing import smooth

_FAR = 6.0
_MAD = 1.4826  # standard deviations a median absolute deviation of normal noise makes


@dataclass(frozen=True)
class Stray:
    """What is known of one column's stray samples."""

    column: int
    """Which of the smoothed columns."""
    count: int
    time: float
    """Of the farthest [s]."""
    sigmas: float
    """How far that one is from the curve, in standard deviations, with its sign."""
    off: float
    """The same in SI units."""
    matters: bool = True
    """Whether any of them could be a torque beyond a limit."""


class Strays:
    """Running count of them, from rows that come in any portions."""

    def __init__(self) -> None:
        self._found: dict[int, Stray] = {}

    def add(self, time: Array, stray: Array, matters: Array) -> None:
        """Take in times (n,) and distances (n, k, 2) as :func:`strays` gives them, or (n, 0), and which (n, k) matter."""
        if not stray.any():
            return
        for k in np.flatnonzero(stray[:, :, 0].any(axis=0)).tolist():
            sigmas, off = stray[:, k].T
            row = int(np.abs(sigmas).argmax())
            new = Stray(
                k,
                int(np.count_nonzero(sigmas)),
                float(time[row]),
                float(sigmas[row]),
                float(off[row]),
                bool(matters[:, k].any()),
            )
            old = self._found.get(k)
            if old is not None:
                far = max(old, new, key=lambda s: abs(s.sigmas))
                new = replace(far, count=old.count + new.count, matters=old.matters or new.matters)
            self._found[k] = new

    def result(self) -> tuple[Stray, ...]:
        """The farthest first."""
        return tuple(sorted(self._found.values(), key=lambda s: -abs(s.sigmas)))


def strays(residual: Array, spread: Array, strengths: Array) -> Array:
    """Residuals (n, k) over their spread (n, k), and as they are, (n, k, 2).

    0 but where they are beyond 6 of it and the farthest for their neighbourhood.
    """
    from scipy.ndimage import maximum_filter1d

    found = np.zeros((*residual.shape, 2))
    for k in np.flatnonzero(spread.any(axis=0) & (strengths > 0)).tolist():
        off = residual[:, k] / spread[:, k]
        size = np.abs(off)
        if not (size > _FAR).any():
            continue
        # A glitch pulls the curve towards itself, and so its neighbours away from the curve, by less than half as much.
        reach = 2 * math.ceil(3.0 * strengths[k] ** (1 / 6)) + 1
        far = (size > _FAR) & (size > 0.5 * maximum_filter1d(size, reach, mode="nearest"))
        found[far, k, 0], found[far, k, 1] = off[far], residual[far, k]
    return found


def residual_spread(
    times: Sequence[Array], parts: Sequence[Array], strengths: Array, step: float, least: Array
) -> Array:
    """Robust standard deviation (k,) of the samples about the smoothed curve, at least ``least``; 0 where none is smoothed."""
    found = np.zeros(len(strengths))
    for k in np.flatnonzero(strengths).tolist():
        off = [x[:, k] - smooth(t, x[:, k], float(strengths[k]), step) for t, x in zip(times, parts, strict=True)]
        found[k] = max(_MAD * float(np.median(np.abs(np.concatenate(off)))), float(least[k]))
    return found
