"""The loops of a closed robot as inverse kinematics closes them: the rows, where to start, and how far they are open."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..algorithms.constraints import Closure
from ..algorithms.loop_projection import LoopRows
from ..typing import Array
from .closed_robot_checks import some_configurations
from .constraint_sizes import CLOSED, gap_units

if TYPE_CHECKING:
    from .closed_robot import ClosedRobot


class SearchedLoops:
    """The loops of one closed robot in a search for poses."""

    def __init__(self, closed: ClosedRobot) -> None:
        self.closed = closed
        self.rows = LoopRows(closed.constraints, closed.independent)
        self.units = gap_units(closed)
        mine = self.rows.places[0]
        self.kinds = [[k for c in closed.constraints if isinstance(c, Closure) for k in c.rows][n] for n in mine]
        """Of each row, its number in a twist."""
        self.allowed = tuple((CLOSED * self.units[mine]).tolist())
        """How far each row may be open, rad or m."""
        self.start = some_configurations(closed, None)[0]
        """A configuration with the loops closed."""

    @property
    def key(self) -> tuple[object, ...]:
        """Searches of one robot with one key are one."""
        return self.rows.constraints, self.rows.independent

    def settled(self, q: Array) -> Array:
        """The configurations (n, nq) on the loops, those from which none is found as they were."""
        found, left = self.closed.settled(q, CLOSED)
        return np.where((left <= CLOSED)[:, None], found, q)

    def open_by(self, q: Array) -> tuple[Array, Array]:
        """Gaps of the rows of the search (n, rows), and the widest of all, over its unit (n,)."""
        gaps = self.closed.gaps(q)
        return gaps[:, self.rows.places[0]], np.abs(gaps / self.units).max(axis=-1, initial=0.0)
