"""Types that signatures everywhere share."""

from __future__ import annotations

from typing import Any, TypeAlias

from numpy.typing import NDArray

__all__ = ["Array"]

Array: TypeAlias = NDArray[Any]
"""An array of NumPy's, of float64 or float32 unless stated otherwise; of symbols where a function is traced."""
