"""Loops of a closed robot in inverse kinematics: rows, start configurations, closure errors."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ...core.errors import ConstraintError
from ...core.typing import Array
from ...mechanics.algorithms.constraints import Closure
from ...mechanics.algorithms.loop_closure import LoopRows
from ..constraint_methods import MAX_CLOSED_GAP
from .closures import some_configurations
from .tolerances import gap_units

if TYPE_CHECKING:
    from ..doors import ConstrainedRobot

PROJECTION_ROUNDS = 4
"""Number of alternating projections of starts into the limits and onto the loops."""


class LoopClosureSolver:
    """Loops of one closed robot in a search for poses."""

    def __init__(self, closed: ConstrainedRobot) -> None:
        self.closed = closed
        self.rows = LoopRows(closed.constraints, closed.independent)
        self.units = gap_units(closed)
        twist_rows = [k for c in closed.constraints if isinstance(c, Closure) for k in c.rows]
        self.kinds = [twist_rows[n] for n in self.rows.indices[0]]
        """Index in a twist of each row."""
        self.allowed = tuple((MAX_CLOSED_GAP * self.units[self.rows.indices[0]]).tolist())
        """Largest gap of each row, rad or m."""

    @cached_property
    def start(self) -> Array:
        """A configuration with the loops closed; raises ConstraintError if none is found."""
        try:
            return np.asarray(some_configurations(self.closed, None)[0])
        except ConstraintError as problem:
            raise ConstraintError(
                f"inverse_kinematics: {str(problem).partition('. ')[0]}. Give q0, a configuration near a closed one."
            ) from None

    @property
    def key(self) -> tuple[object, ...]:
        """Cache key: searches of one robot with equal keys are shared."""
        return self.rows.constraints, self.rows.independent

    def close(self, q: Array) -> Array:
        """Configurations (n, nq) moved onto the loops; unchanged if no closed configuration is found."""
        closed_q, gaps = self.closed.settled(q, MAX_CLOSED_GAP)
        return np.where((gaps <= MAX_CLOSED_GAP)[:, None], closed_q, q)

    def closed_starts(self, starts: Array, inside: Callable[[Array], Array]) -> Array:
        """Configurations (n, nq) with closed loops inside the limits, from configurations that may be open.

        Those from which none is found are moved half and then a quarter of the way towards one from which one is found.
        """
        robot = self.closed.open()

        def close_inside(q: Array) -> tuple[Array, Array]:
            for _ in range(PROJECTION_ROUNDS):
                q = inside(self.close(q))
            q = self.close(q)
            return q, (inside(q) == q).all(axis=-1) & (self.search_gaps(q)[1] <= MAX_CLOSED_GAP)

        q, good = close_inside(starts)
        for part in (0.5, 0.25):
            if good.all() or not good.any():
                break
            rows = np.flatnonzero(~good)
            closed_rows = np.resize(np.flatnonzero(good), len(rows))
            step = part * robot.subtract(starts[rows], q[closed_rows])
            q[rows], good[rows] = close_inside(robot.add(q[closed_rows], step))
        rows = np.flatnonzero(~good)
        if good.any():
            q[rows] = q[np.resize(np.flatnonzero(good), len(rows))]
        return inside(q)

    def search_gaps(self, q: Array) -> tuple[Array, Array]:
        """Gaps of the search's rows (n, rows), and the largest gap relative to its unit (n,)."""
        gaps = self.closed.gaps(q)
        return gaps[:, self.rows.indices[0]], np.abs(gaps / self.units).max(axis=-1, initial=0.0)
