"""Rows at which one joint leaves its path and is back in the next row: no motion does that, whatever the noise.

e_i is how far q_i is from the straight line between its neighbours. A corner of a path is one large e; a single wrong row of
size d is e = (-d/2, d, -d/2), beyond all that the rest of the log has.
"""

from __future__ import annotations

import math

import numpy as np

from ..core.printed_numbers import printed, seconds
from ..listing import listed
from ..typing import Array

_BEYOND = 5.0
"""Times the largest e of the rest of the log, from which the wrong row explains itself."""
_ALIKE = 0.25
"""How far the neighbours' e may be from -d/2, as a share of d: the path goes on beside the glitch."""
_ROUNDING, _NO_COUNT = 1e-6, 1e-2
"""rad or m: what is smaller is not told from rounded numbers, and what is larger is no count of an encoder that flickers."""
_COUNTS = 3.0
"""Times the least step of the log, from which it is no such count either."""
_MOST = 50
"""Candidates that are kept for a joint; with more the log is rough, and not one row wrong."""
_LISTED = 3


class SingleRowGlitches:
    """A tally over the rows of a motion, which come in any portions."""

    def __init__(self, count: int, turns: Array) -> None:
        """``count`` joints, of which those that turn (k,) bool may step by a full turn."""
        self._turns = turns
        self._tail: tuple[Array, Array] = np.empty(0), np.empty((0, count))
        self._largest, self._least_step = np.zeros(count), np.full(count, np.inf)
        self._found: list[list[tuple[float, float]]] = [[] for _ in range(count)]
        """Of each joint the candidates: |d|, time."""

    def add(self, time: Array, q: Array) -> None:
        """Take in consecutive rows, (n,) and (n, k)."""
        t, q = np.r_[self._tail[0], time], np.concatenate([self._tail[1], q])
        self._tail = t[-6:], q[-6:]  # so that each row is looked at once, with two e on either side
        if len(t) < 7:
            return
        curves = q.copy()
        curves[:, self._turns] = np.unwrap(q[:, self._turns], axis=0)
        steps = np.abs(np.diff(curves, axis=0))
        self._least_step = np.minimum(self._least_step, np.where(steps > 0, steps, np.inf).min(axis=0))
        share = ((t[1:-1] - t[:-2]) / (t[2:] - t[:-2]))[:, None]
        e = curves[1:-1] - curves[:-2] - share * (curves[2:] - curves[:-2])
        d = e[1:-1]
        beside = np.maximum(np.abs(e[:-2] + d / 2), np.abs(e[2:] + d / 2))
        candidate = (np.abs(d) > _ROUNDING) & (beside < _ALIKE * np.abs(d))
        touched = candidate[:-2] | candidate[1:-1] | candidate[2:]
        self._largest = np.maximum(self._largest, np.where(touched, 0.0, np.abs(e[2:-2])).max(axis=0))
        for row, k in np.argwhere(candidate[1:-1]).tolist():
            found = abs(float(e[row + 2, k])), float(t[row + 3])
            self._found[k] = sorted([*self._found[k], found], reverse=True)[:_MOST]

    def result(self) -> list[tuple[int, list[tuple[float, float]]]]:
        """Each joint that has such rows, with (size, time) of these, the largest first."""
        found = []
        for k, candidates in enumerate(self._found):
            bound = max(_BEYOND * float(self._largest[k]), min(_COUNTS * float(self._least_step[k]), _NO_COUNT))
            wrong = [(size, time) for size, time in candidates if size > bound]
            if wrong and len(wrong) < _MOST:
                found.append((k, wrong))
        return found

    def sentences(self, names: list[str], angular: Array) -> list[str]:
        """A sentence for each joint."""
        said = []
        for k, wrong in self.result():
            size = f"{printed(math.degrees(wrong[0][0]), 3)} degrees" if angular[k] else f"{printed(wrong[0][0], 3)} m"
            when = listed((f"{seconds(time, 4)} s" for _, time in wrong), _LISTED)
            said.append(
                f"{names[k]} leaves its path by {size} for a single row, and is back in the next, at t = {when}: "
                "remove the row"
            )
        return said
