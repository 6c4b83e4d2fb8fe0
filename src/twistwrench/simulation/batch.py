"""Simulations from many states: each is what it is alone, and where nothing asks Python they take their steps together."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.printed_numbers import residual
from ..errors import ShapeError, SimulationError, TwistWrenchError, ValueRangeError
from ..typing import Array
from .compiled_steps import CompiledSteps
from .preparation import prepare
from .result import SimulationResult
from .run import Run
from .schemes import ADAPTIVE
from .simulated import carried_out
from .step_blocks import use_block
from .user_functions import require_arguments

if TYPE_CHECKING:
    from ..robot import Robot


@dataclass(frozen=True, eq=False, repr=False)
class SimulationBatch:
    """Simulations from a batch of states, each of its own length. Printing it says how many came to the end."""

    results: tuple[SimulationResult, ...]
    """One for each state, in the order of the flattened batch."""
    shape: tuple[int, ...]
    """Of the batch."""

    def __getitem__(self, index: int | tuple[int, ...]) -> SimulationResult:
        places = index if isinstance(index, tuple) else (index,)
        if len(places) != len(self.shape):
            raise ValueRangeError(f"the batch has shape {self.shape}; give one index for each of its axes.")
        return self.results[int(np.arange(len(self.results)).reshape(self.shape)[places])]

    def __len__(self) -> int:
        return len(self.results)

    def __iter__(self) -> Iterator[SimulationResult]:
        return iter(self.results)

    @property
    def completed(self) -> Array:
        """Which came to the end of their duration, (...) bool."""
        return np.array([found.completed for found in self.results]).reshape(self.shape)

    @property
    def ends(self) -> Array:
        """The time of the last state of each, (...) s."""
        return np.array([found.times[-1] for found in self.results]).reshape(self.shape)

    def __repr__(self) -> str:
        if not self.results:
            return "<SimulationBatch: no simulations>"
        first, done = self.results[0], int(self.completed.sum())
        said = [f"{len(self)} simulations, {done} reached the end"]
        if done < len(self):
            k = int(np.argmin(self.completed.ravel()))
            where = ", ".join(map(str, np.unravel_index(k, self.shape))) if self.shape else ""
            said.append(f"the first of the others, [{where}]: {self.results[k].stopped}")
        said.append(f"drift of energy at most {residual(np.max([found.relative_drift for found in self.results]))}")
        remarks = dict.fromkeys(remark for found in self.results for remark in found.remarks)
        said += [f"note: {remark}" for remark in list(remarks)[:3]]
        return f"<SimulationBatch of {first.robot!r}, {first.method}: {'; '.join(said)}>"


def simulate_batch(robot: Robot, *start: Any, **options: Any) -> SimulationBatch:
    """Simulations from many states; see :meth:`twistwrench.Robot.simulate_batch`."""
    asked = inspect.signature(robot.simulate).bind(*start, **options)
    asked.apply_defaults()
    given = asked.arguments
    q, dq, shape = _starts(robot, given.pop("q0"), given.pop("dq0"))
    progress = given.pop("progress")
    if progress is not None:
        require_arguments(progress, "progress", ("the share done, from 0 to 1",))
    runs = []
    for place, one, rates in zip(np.ndindex(shape), q, dq, strict=True):
        try:
            runs.append(prepare(robot, one, rates, **given, progress=None, loops=None))
        except TwistWrenchError as problem:
            if place == (0,) * len(shape) or "q0" not in str(problem):
                raise
            raise type(problem)(f"simulation {list(place)} of the batch: {problem}") from None
    with np.errstate(all="ignore"):  # what a step too long makes of the numbers is found and said
        _advance(runs)
    results: list[SimulationResult] = []
    for run in runs:
        try:
            results.append(carried_out(run))
        except SimulationError as problem:  # its result says so, and the others go on
            results.append(cast("SimulationResult", problem.result))
        if progress is not None:
            progress(len(results) / len(runs))
    return SimulationBatch(tuple(results), shape)


def _starts(robot: Robot, q0: ArrayLike | None, dq0: ArrayLike | None) -> tuple[Array, Array, tuple[int, ...]]:
    """Configurations (n, nq) and velocities (n, nv) of all, and the shape of the batch."""
    q = robot.neutral if q0 is None else arguments.finite(q0, "q0", robot.nq, names=robot.coordinate_names)
    dq = np.zeros(robot.nv) if dq0 is None else arguments.finite(dq0, "dq0", robot.nv, names=robot.model.velocity_names)
    try:
        shape = np.broadcast_shapes(q.shape[:-1], dq.shape[:-1])
    except ValueError:
        raise ShapeError(f"q0 has shape {q.shape} and dq0 {dq.shape}, whose batch shapes do not go together.") from None
    every = (np.broadcast_to(x, (*shape, x.shape[-1])).reshape(-1, x.shape[-1]) for x in (q, dq))
    return *every, shape  # type: ignore[return-value]


def _advance(runs: list[Run]) -> None:
    """Take the steps of all runs side by side as far as they are compiled, stable and not ended; each goes on by itself."""
    if len(runs) < 2 or runs[0].method == ADAPTIVE or not runs[0].asks_nobody:
        return
    first = runs[0]
    made = [CompiledSteps.of(run.system, run.method, run.scheme.order, run.h) for run in runs]
    going = [(run, steps) for run, steps in zip(runs, made, strict=True) if steps is not None]
    for run, _ in going:
        run.begin()
    wide = going[0][1].side_by_side() if going else None
    while wide is not None and going and (left := first.n - going[0][0].steps):
        counted = first.system.evaluations
        given = [np.array(told) for told in zip(*(steps.told() for _, steps in going), strict=True)]
        states = np.array([run.last[1] for run, _ in going])
        found = wide.taken(states, min(max(1, wide.most // len(going)), left), first.h, given)
        first.system.evaluations = counted
        going = [both for both, *mine in zip(going, *found, strict=True) if use_block(*both, *mine)]
