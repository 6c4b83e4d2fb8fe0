"""Columns of mimic joints, beside what their leaders' columns say: a log in which they go elsewhere is of another robot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..core.printed_numbers import number, seconds
from ..joints.units import unit_of
from ..typing import Array
from .coordinates import Follower

_SHARE = 0.1
"""Of how far the joint goes: less is play, and the error of a coupling."""
_LEAST = {True: 0.02, False: 0.002}
"""rad where the joint turns, else m, that are never told."""


class FollowerColumn(NamedTuple):
    """A column of a mimic joint."""

    follower: Follower
    column: int
    """Of the table."""
    factor: float
    """What takes it to SI units."""


class FollowerTally:
    """How far columns are from what their leaders' say, over rows that come in any portions."""

    def __init__(self, columns: Sequence[FollowerColumn]) -> None:
        self._columns = tuple(columns)
        count = len(self._columns)
        self._least, self._most = np.full(count, math.inf), np.full(count, -math.inf)
        self._off = [(0.0, 0.0)] * count
        """The largest distance of each, and when."""

    def add(self, time: Array, q: Array, table: Array) -> None:
        """Consecutive rows: times (n,), coordinates (n, nq), and the table they are from."""
        for k, (follower, column, factor) in enumerate(self._columns):
            logged, led = factor * table[:, column], follower.ratio * q[:, follower.leader] + follower.offset
            self._least[k] = min(self._least[k], float(logged.min()), float(led.min()))
            self._most[k] = max(self._most[k], float(logged.max()), float(led.max()))
            off = np.abs(logged - led)
            row = int(off.argmax())
            self._off[k] = max(self._off[k], (float(off[row]), float(time[row])))

    def sentences(self) -> list[str]:
        """A sentence for each that goes elsewhere."""
        said = []
        for k, (follower, _, _) in enumerate(self._columns):
            off, when = self._off[k]
            if off > max(_LEAST[follower.angular], _SHARE * float(self._most[k] - self._least[k])):
                said.append(
                    f"{follower.name} is {number(off)} {unit_of('q', follower.angular)} from where its leader takes it, at t = "
                    f"{seconds(when)} s: correct its <mimic>, or load the robot with its mimic joints independent"
                )
        return said
