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
"""Number of times that starts are moved onto the loops and then into the limits."""
_FRACTIONS_OF_WAY = (0.5, 0.25)
"""Parts of the way from a closed configuration to a failed start at which another start is tried, in order."""


class LoopClosureSolver:
    """Loops of one closed robot in a search for poses."""

    def __init__(self, closed: ConstrainedRobot) -> None:
        self.closed = closed
        self.rows = LoopRows(closed.constraints, closed.independent)
        self.units = gap_units(closed)
        """Unit of the gap of each position row, rad or m."""
        twist_rows: list[int] = []
        for constraint in closed.constraints:
            if isinstance(constraint, Closure):
                twist_rows += constraint.rows
        self._searched_rows = self.rows.indices[0]
        """Indices of the search's rows among the position rows of all closures."""
        self.kinds = [twist_rows[k] for k in self._searched_rows]
        """Index in a twist of each row of the search."""
        self.allowed = tuple((MAX_CLOSED_GAP * self.units[self._searched_rows]).tolist())
        """Largest gap of each row of the search, rad or m."""

    @cached_property
    def start(self) -> Array:
        """A configuration with the loops closed; raises ConstraintError if none is found."""
        try:
            closed_configurations = some_configurations(self.closed, None)
            return np.asarray(closed_configurations[0])
        except ConstraintError as error:
            first_sentence, _, _ = str(error).partition(". ")
            raise ConstraintError(
                f"inverse_kinematics: {first_sentence}. Give q0, a configuration near a closed one."
            ) from None

    @property
    def key(self) -> tuple[object, ...]:
        """Cache key: searches of one robot with equal keys are shared."""
        return self.rows.constraints, self.rows.independent

    def close(self, q: Array) -> Array:
        """Configurations (n, nq) moved onto the loops; unchanged if no closed configuration is found."""
        closed_q, gaps = self.closed.settled(q, MAX_CLOSED_GAP)
        is_closed = gaps <= MAX_CLOSED_GAP
        return np.where(is_closed[:, None], closed_q, q)

    def closed_starts(self, starts: Array, inside: Callable[[Array], Array]) -> Array:
        """Configurations (n, nq) with closed loops inside the limits, from configurations that may be open.

        If the search from a start fails, it is repeated from points between this start and a closed configuration of another
        start. If these fail, too, the closed configuration itself is returned. ``inside`` clips configurations to their limits.
        """
        robot = self.closed.open()

        def close_inside(q: Array) -> tuple[Array, Array]:
            """Configurations near q, and a mask (n,) of those that are closed and inside the limits."""
            for _ in range(PROJECTION_ROUNDS):
                q = inside(self.close(q))
            q = self.close(q)
            _, largest_gaps = self.search_gaps(q)
            is_inside = (inside(q) == q).all(axis=-1)
            return q, is_inside & (largest_gaps <= MAX_CLOSED_GAP)

        q, is_good = close_inside(starts)
        for fraction in _FRACTIONS_OF_WAY:
            if is_good.all() or not is_good.any():
                break
            failed_rows = np.flatnonzero(~is_good)
            good_rows = np.resize(np.flatnonzero(is_good), len(failed_rows))  # repeated if there are fewer
            step = fraction * robot.subtract(starts[failed_rows], q[good_rows])
            q[failed_rows], is_good[failed_rows] = close_inside(robot.add(q[good_rows], step))
        if is_good.any():
            failed_rows = np.flatnonzero(~is_good)
            good_rows = np.resize(np.flatnonzero(is_good), len(failed_rows))
            q[failed_rows] = q[good_rows]
        return inside(q)

    def search_gaps(self, q: Array) -> tuple[Array, Array]:
        """Gaps of the search's rows (n, rows), and the largest gap (n,) of all rows relative to its unit."""
        gaps = self.closed.gaps(q)
        relative_gaps = np.abs(gaps / self.units)
        return gaps[:, self._searched_rows], relative_gaps.max(axis=-1, initial=0.0)
