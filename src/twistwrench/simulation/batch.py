"""Simulations from many states, batched if there are no callbacks."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import ShapeError, SimulationError, TwistWrenchError, ValueRangeError
from ..core.numbers import residual
from ..core.typing import Array
from ..robot.base import require_robot
from .blocks import use_block
from .compiled_steps import CompiledSteps
from .forces import require_arguments
from .methods.schemes import ADAPTIVE
from .preparation import build_run, run_to_end
from .result import SimulationResult
from .run import Run

if TYPE_CHECKING:
    from ..robot import Robot


_MAX_LISTED_REMARKS = 3
"""Largest number of remarks in the text of a batch."""


@dataclass(frozen=True, eq=False, repr=False)
class SimulationBatch:
    """Simulations from a batch of states; simulations may end at different times. Its text has the number that completed."""

    results: tuple[SimulationResult, ...]
    """One result for each state, in the order of the flattened batch."""
    shape: tuple[int, ...]
    """Shape of the batch."""

    def __getitem__(self, index: int | tuple[int, ...]) -> SimulationResult:
        indices = index if isinstance(index, tuple) else (index,)
        if len(indices) != len(self.shape):
            raise ValueRangeError(f"the batch has shape {self.shape}; give one index for each of its axes.")
        numbers = np.arange(len(self.results)).reshape(self.shape)
        return self.results[int(numbers[indices])]

    def __len__(self) -> int:
        return len(self.results)

    def __iter__(self) -> Iterator[SimulationResult]:
        return iter(self.results)

    @property
    def completed(self) -> Array:
        """True for simulations that reached the end of their duration, (...) bool."""
        return np.array([result.completed for result in self.results]).reshape(self.shape)

    @property
    def ends(self) -> Array:
        """Time of the last state of each simulation, (...) s."""
        return np.array([result.times[-1] for result in self.results]).reshape(self.shape)

    def __repr__(self) -> str:
        if not self.results:
            return "<SimulationBatch: no simulations>"
        first = self.results[0]
        completed_count = int(self.completed.sum())
        parts = [f"{len(self)} simulations, {completed_count} reached the end"]
        if completed_count < len(self):
            k = int(np.argmin(self.completed.ravel()))  # the first that did not
            indices = np.unravel_index(k, self.shape) if self.shape else ()
            index_text = ", ".join(map(str, indices))
            parts.append(f"the first of the others, [{index_text}]: {self.results[k].stopped}")
        largest_drift = np.max([result.relative_drift for result in self.results])
        parts.append(f"drift of energy at most {residual(largest_drift)}")
        distinct_remarks: dict[str, None] = {}  # in the order of the results
        for result in self.results:
            distinct_remarks |= dict.fromkeys(result.remarks)
        parts += [f"note: {remark}" for remark in list(distinct_remarks)[:_MAX_LISTED_REMARKS]]
        return f"<SimulationBatch of {first.robot!r}, {first.method}: {'; '.join(parts)}>"


def simulate_batch(robot: Robot, *start: Any, **options: Any) -> SimulationBatch:
    """Simulations from many states; see :meth:`twistwrench.Robot.simulate_batch`."""
    require_robot(robot, "simulate_batch")
    call = inspect.signature(robot.simulate).bind(*start, **options)
    call.apply_defaults()
    options = call.arguments
    q, dq, shape = _starts(robot, options.pop("q0"), options.pop("dq0"))
    progress = options.pop("progress")
    if progress is not None:
        require_arguments(progress, "progress", ("the share done, from 0 to 1",))
    runs = []
    for index, q0, dq0 in zip(np.ndindex(shape), q, dq, strict=True):
        try:
            runs.append(build_run(robot, q0, dq0, **options, progress=None, loops=None))
        except TwistWrenchError as problem:
            is_first = not any(index)
            if is_first or "q0" not in str(problem):  # then all simulations have the same error
                raise
            raise type(problem)(f"simulation {list(index)} of the batch: {problem}") from None
    with np.errstate(all="ignore"):  # overflow in unstable steps is detected and reported
        _advance_together(runs)
    results: list[SimulationResult] = []
    for run in runs:
        try:
            results.append(run_to_end(run))
        except SimulationError as problem:  # recorded in its result; the others continue
            results.append(cast("SimulationResult", problem.result))
        if progress is not None:
            progress(len(results) / len(runs))
    return SimulationBatch(tuple(results), shape)


def _starts(robot: Robot, q0: ArrayLike | None, dq0: ArrayLike | None) -> tuple[Array, Array, tuple[int, ...]]:
    """Initial configurations (n, nq) and velocities (n, nv) of all simulations, and the shape of the batch."""
    q, dq = robot.neutral, np.zeros(robot.nv)
    if q0 is not None:
        q = arguments.finite(q0, "q0", robot.nq, names=robot.coordinate_names)
    if dq0 is not None:
        dq = arguments.finite(dq0, "dq0", robot.nv, names=robot.model.velocity_names)
    try:
        shape = np.broadcast_shapes(q.shape[:-1], dq.shape[:-1])
    except ValueError:
        raise ShapeError(f"q0 has shape {q.shape} and dq0 {dq.shape}, whose batch shapes do not go together.") from None
    all_q = np.broadcast_to(q, (*shape, robot.nq)).reshape(-1, robot.nq)
    all_dq = np.broadcast_to(dq, (*shape, robot.nv)).reshape(-1, robot.nv)
    return all_q, all_dq, shape


def _advance_together(runs: list[Run]) -> None:
    """Take the steps of all runs side by side in compiled code, until each run ends or becomes unstable.

    Runs that cannot be advanced together are not changed; each then continues alone.
    """
    if len(runs) < 2:
        return
    first = runs[0]  # all have the same options
    if first.method == ADAPTIVE or not first.without_callbacks:
        return
    running = []
    for run in runs:
        steps = CompiledSteps.build(run.system, run.method, run.scheme.order, run.h)
        if steps is not None:
            running.append((run, steps))
    for run, _ in running:
        run.begin()
    if not running:
        return
    _, first_steps = running[0]
    batched_steps = first_steps.side_by_side()
    while running:
        any_run, _ = running[0]  # all have taken as many steps
        remaining_steps = first.n - any_run.steps
        if not remaining_steps:
            return
        evaluations = first.system.evaluations
        inputs = [steps.inputs() for _, steps in running]
        stacked_inputs = [np.array(values) for values in zip(*inputs, strict=True)]
        states = np.array([run.last[1] for run, _ in running])
        max_steps = max(1, batched_steps.most // len(running))
        block_size = min(max_steps, remaining_steps)
        results = batched_steps.advance_with(states, block_size, first.h, stacked_inputs)
        first.system.evaluations = evaluations  # use_block counts the evaluations of each run
        still_running = []
        for (run, steps), *own_results in zip(running, *results, strict=True):
            if use_block(run, steps, *own_results):
                still_running.append((run, steps))
        running = still_running
