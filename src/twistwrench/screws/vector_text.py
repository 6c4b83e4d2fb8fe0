"""Vectors as a reader wants them: few digits, no minus zeros, no noise beside what is large."""

from __future__ import annotations

import numpy as np

from ..typing import Array

_NOISE = 1e-12


def without_noise(x: Array, scale: float | None = None) -> Array:
    """Numbers with what is below 1e-12 of ``scale``, of the largest of them if None, made zero: what rounding left there."""
    size = np.abs(x[np.isfinite(x)]).max(initial=0.0) if scale is None else scale
    return np.where(np.abs(x) <= _NOISE * size, 0.0, x) + 0.0  # no minus zeros


def tuple_of(x: Array) -> str:
    """A vector (n,) of numbers or symbols in brackets.

    >>> tuple_of(np.array([0.1 + 0.2, 1e-17, -2.0]))
    '(0.3, 0, -2)'
    """
    if x.dtype == object:
        return f"({', '.join(map(str, x))})"
    return f"({', '.join(f'{value:.6g}' for value in without_noise(x))})"
