"""The motion of a closed robot: that of a simulation, with the forces of its constraints, and how well it kept to them."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.printed_numbers import residual
from ..errors import SimulationError, UnknownNameError
from ..robot import closed_robot_checks as checks
from ..typing import Array
from .closed_system import CLOSED_METHODS, Loops
from .result import SimulationResult
from .simulated import simulated

if TYPE_CHECKING:
    from ..robot.closed_robot import ClosedRobot


@dataclass(frozen=True, eq=False, repr=False)
class ClosedSimulation(SimulationResult):
    """A simulated motion of a closed robot. What it has beside :class:`SimulationResult` is read from no file."""

    row_names: tuple[str, ...] = ()
    """Of the entries of lam."""
    lam: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """(n, k) N m or N, λ of each state: what the robot applies where it is held."""
    gap: Array = field(default_factory=lambda: np.zeros(0))
    """(n,) rad or m, by how much the loops are open at most, in each state."""
    gap_before: float = 0.0
    """rad or m, the largest gap that a step left; it was closed at the end of the step."""
    slip_before: float = 0.0
    """rad/s or m/s, the largest rate A dq that a step left; it was taken away likewise."""

    def __repr__(self) -> str:
        held = f"gap {residual(self.gap.max(initial=0.0))}, before projection {residual(self.gap_before)}"
        return f"{super().__repr__()[:-1]}; {held}>"


def simulate_closed(closed: ClosedRobot, q0: Any, *start: Any, method: str | None, **given: Any) -> ClosedSimulation:
    """Simulation of a closed robot from one state; see :meth:`twistwrench.Robot.simulate`."""
    method = "rk4" if method is None else method
    if method not in CLOSED_METHODS:
        raise UnknownNameError.of("method", method, CLOSED_METHODS)
    loops = Loops(closed) if closed.independent else None
    if q0 is None:
        q0 = checks.some_configurations(closed, closed.robot.neutral)[0]
    try:
        found = simulated(closed.robot, q0, *start, method=method, loops=loops, **given)
    except (SimulationError, KeyboardInterrupt) as problem:
        if isinstance(result := getattr(problem, "result", None), SimulationResult):
            problem.result = _held(result, closed, loops)  # type: ignore[union-attr]
        raise
    return _held(found, closed, loops)


def _held(found: SimulationResult, closed: ClosedRobot, loops: Loops | None) -> ClosedSimulation:
    """The result with what its constraints did; ``loops`` is None where no row of them holds anything."""
    known = {f.name: getattr(found, f.name) for f in fields(SimulationResult) if f.init}
    gaps = np.abs(closed.gaps(found.q)).max(axis=-1, initial=0.0)
    if loops is None:
        lam = np.zeros((len(found), len(closed.sizes)))
        return ClosedSimulation(**known, row_names=closed.row_names, lam=lam, gap=gaps)
    lam = loops.system.multipliers(found.times, found.q, found.dq, found.tau)
    return ClosedSimulation(
        **known, row_names=closed.row_names, lam=lam, gap=gaps, gap_before=loops.widest, slip_before=loops.fastest
    )
