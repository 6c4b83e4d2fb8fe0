"""The loops of a closed robot as inverse kinematics closes them: the rows, where to start, and how far they are open."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..algorithms.constraints import Closure
from ..algorithms.loop_projection import LoopRows
from ..errors import ConstraintError
from ..typing import Array
from .closed_robot_checks import some_configurations
from .constraint_sizes import CLOSED, gap_units

if TYPE_CHECKING:
    from collections.abc import Callable

    from .closed_robot import ClosedRobot


ROUNDS = 4
"""Times that starts are brought into the limits and onto the loops again."""


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

    @cached_property
    def start(self) -> Array:
        """A configuration with the loops closed; ConstraintError where none is found."""
        try:
            return np.asarray(some_configurations(self.closed, None)[0])
        except ConstraintError as problem:
            raise ConstraintError(
                f"inverse_kinematics: {str(problem).partition('. ')[0]}. Give q0, a configuration near a closed one."
            ) from None

    @property
    def key(self) -> tuple[object, ...]:
        """Searches of one robot with one key are one."""
        return self.rows.constraints, self.rows.independent

    def settled(self, q: Array) -> Array:
        """The configurations (n, nq) on the loops, those from which none is found as they were."""
        found, left = self.closed.settled(q, CLOSED)
        return np.where((left <= CLOSED)[:, None], found, q)

    def places(self, some: Array, inside: Callable[[Array], Array]) -> Array:
        """Configurations (n, nq) with the loops closed inside the limits, got from some that are not closed.

        Those from which none is found go towards one from which one is, half of the way and a quarter.
        """
        robot = self.closed.robot

        def closed(q: Array) -> tuple[Array, Array]:
            for _ in range(ROUNDS):
                q = inside(self.settled(q))
            found = self.settled(q)
            return found, (inside(found) == found).all(axis=-1) & (self.open_by(found)[1] <= CLOSED)

        q, good = closed(some)
        for part in (0.5, 0.25):
            if good.all() or not good.any():
                break
            rows = np.flatnonzero(~good)
            known = np.resize(np.flatnonzero(good), len(rows))
            q[rows], good[rows] = closed(robot.add(q[known], part * robot.subtract(some[rows], q[known])))
        rows = np.flatnonzero(~good)
        if good.any():
            q[rows] = q[np.resize(np.flatnonzero(good), len(rows))]
        return inside(q)

    def open_by(self, q: Array) -> tuple[Array, Array]:
        """Gaps of the rows of the search (n, rows), and the widest of all, over its unit (n,)."""
        gaps = self.closed.gaps(q)
        return gaps[:, self.rows.places[0]], np.abs(gaps / self.units).max(axis=-1, initial=0.0)
