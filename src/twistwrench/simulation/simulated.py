"""A simulation as a whole: it is prepared, goes, and whatever ends it, what was computed is given."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.printed_numbers import printed
from ..errors import SimulationError
from .closed_system import Loops
from .preparation import prepare
from .result import SimulationResult
from .run import Run

if TYPE_CHECKING:
    from ..robot import Robot


def simulated(robot: Robot, *start: Any, loops: Loops | None = None, **given: Any) -> SimulationResult:
    """The result of :meth:`twistwrench.Robot.simulate`; ``loops`` are constraints to keep to."""
    return carried_out(prepare(robot, *start, **given, loops=loops))


def carried_out(run: Run) -> SimulationResult:
    """The result of a run that is prepared. What ends it early has all up to there in its ``.result``."""
    try:
        with np.errstate(all="ignore"):  # what a step too long makes of the numbers is found and said
            run.go()
            run.judge()
    except SimulationError as problem:
        with np.errstate(all="ignore"):
            run.judge()
        problem.result = run.result(str(problem), completed=False)
        raise
    except KeyboardInterrupt as interrupt:
        interrupt.result = run.result("interrupted", completed=False)  # type: ignore[attr-defined]
        raise
    return run.result(run.stopped or f"reached the end, {printed(run.end)} s", completed=not run.stopped)
