"""Joints whose angles are logged within one turn: how far they go with the turns added, and whether their limits allow it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..core.printed_numbers import printed
from ..typing import Array

if TYPE_CHECKING:
    from ..model.limits import Limits


class TurnsLeftOut:
    """A tally over the angles (n, k) of joints, which come in any portions; turns are added to joints that are ``counted``."""

    def __init__(self, counted: NDArray[np.bool_], size: tuple[float, float]) -> None:
        """``size`` are the least and the largest step [rad] that is taken for a full turn."""
        self._counted, self._size = counted, size
        self._turned = np.zeros(len(counted))
        self._lowest, self._highest = np.full(len(counted), math.inf), np.full(len(counted), -math.inf)

    def add(self, q: Array, moved: Array) -> None:
        """Angles (n, k) that begin with the last of those before, and the steps (n - 1, k) between them."""
        size = np.abs(moved)
        turns = np.where((size > self._size[0]) & (size < self._size[1]) & self._counted, -np.sign(moved), 0.0)
        turned = self._turned + np.concatenate([np.zeros((1, len(self._turned))), np.cumsum(turns, axis=0)])
        self._turned = turned[-1]
        there = q + math.tau * turned
        self._lowest = np.minimum(self._lowest, there.min(axis=0))
        self._highest = np.maximum(self._highest, there.max(axis=0))

    def sentences(
        self, wrapped: NDArray[np.bool_], places: NDArray[np.int_], names: Sequence[str], limits: Limits
    ) -> list[str]:
        """A sentence for each joint that was ``wrapped`` (k,) and is within its limits after no whole number of turns.

        ``places`` (k,) are those of the joints among ``names`` and limits.
        """
        said = []
        for k in np.flatnonzero(wrapped).tolist():
            j, low, high = int(places[k]), float(self._lowest[k]), float(self._highest[k])
            lower, upper, slack = (float(x[j]) for x in (limits.lower, limits.upper, limits.tolerance))
            if not (math.isfinite(lower) and math.isfinite(upper)):
                continue
            first = math.ceil((lower - slack - low) / math.tau)
            if high + math.tau * first > upper + slack:
                said.append(
                    f"{names[j]} steps by about a full turn, as angles do that are logged within one turn; it then turns by "
                    f"{printed(high - low, 4)} rad in all, which its limits, {printed(lower, 4)} to {printed(upper, 4)}, do "
                    "not allow: log the angle without wrapping"
                )
        return said
