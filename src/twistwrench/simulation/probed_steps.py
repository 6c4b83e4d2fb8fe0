"""Which steps of a run are taken again after it, to see what they are off by, and what is kept of them until then."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from ..typing import Array

_LEAST = 32
"""Steps probed of a run, if it has so many."""
_SPACING = 50
"""Steps between two that are probed, in a long run. A probe is the work of 2.5 steps, of 6 for a method of one evaluation."""
MOST_PROBED = 2000
"""Steps probed of a run, and as many again in which a contact begins or ends."""


@dataclass(frozen=True, eq=False)
class ProbedSteps:
    """Steps of a run: number, time, state before and after, torques held by the controller; of one, or of m with an axis."""

    numbers: Any
    t: Any
    y: Array
    after: Array
    held: Array
    """(nv,) of all of them, or (m, nv)."""
    begun: Array
    """(m, nv), the accelerations that they begin with."""

    def __getitem__(self, which: Any) -> ProbedSteps:
        held = self.held if self.held.ndim == 1 else self.held[which]
        return ProbedSteps(
            self.numbers[which], self.t[which], self.y[which], self.after[which], held, self.begun[which]
        )

    @classmethod
    def of_all(cls, parts: list[ProbedSteps]) -> ProbedSteps:
        """All steps of several."""
        if len(parts) == 1:
            return parts[0]
        numbers, times, before, after, begun = (
            np.concatenate(x) for x in zip(*((p.numbers, p.t, p.y, p.after, p.begun) for p in parts), strict=True)
        )
        held = parts[0].held
        if any(p.held is not held for p in parts) or held.ndim > 1:
            held = np.concatenate([np.broadcast_to(p.held, (len(p.t), p.held.shape[-1])) for p in parts])
        return cls(numbers, times, before, after, held, begun)


@lru_cache(maxsize=16)
def probed_steps(n: int) -> tuple[int, ...]:
    """Which of n steps are probed: the first ones closely, then one of each block, at places that have no period.

    >>> probed_steps(3000)[:9]
    (0, 1, 2, 4, 8, 16, 32, 80, 111)
    """
    spacing = max(min(n // _LEAST, _SPACING), n // MOST_PROBED, 1)
    found, k = [], 0
    while k < min(spacing, n):
        found.append(k)
        k = max(2 * k, 1)
    for block in range(1, -(-n // spacing)):
        k = block * spacing + int(spacing * (block * 0.6180339887498949 % 1.0))  # the golden section
        if k < n:
            found.append(k)
    return tuple(sorted(found))
