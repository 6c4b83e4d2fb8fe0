"""Steps of rollouts: kernels, parts of the batch for the threads, and memory for the results."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

from ..compiler.ir.loops import Scan
from ..compiler.lowering.target_machine import SINGLE
from ..compiler.runtime import batch_threads
from ..compiler.runtime.batch_threads import Part
from ..compiler.runtime.gufunc import owner_of
from ..compiler.runtime.result_pool import result_arrays
from ..core.errors import ShapeError, ValueRangeError
from ..core.numbers import printed
from ..core.typing import Array
from ..robot.engine import compile_form
from .compiled_steps import StepPlan
from .rollout_inputs import Inputs

if TYPE_CHECKING:
    from ..robot import Robot

OPERATIONS_PER_CALL = 5e9
"""Number of operations between two checks for a keyboard interrupt: about 0.3 s."""
SLOWDOWN_OF_SMALL_BATCH = 3
"""Slowdown for batches that leave most vector lanes unused."""
LANES = 16
"""Number of samples in a block; every processor gets whole blocks."""


def take_all_steps(robot: Robot, inputs: Inputs, results: list[Array]) -> list[Array]:
    """Take all steps; returns the results, with the states written into them."""
    samples = math.prod(inputs.batch)
    state_parts = len(inputs.plan.state)
    arrays = []
    for x in inputs.arrays:
        is_overwritten = any(np.may_share_memory(x, result) for result in results)
        arrays.append(x.copy() if is_overwritten else x)
    flat_results = [x.reshape(samples, *x.shape[-2:]) for x in results]  # views: the results are contiguous
    states, torques = flat_results[:state_parts], flat_results[state_parts:]
    for state, start in zip(states, arrays, strict=False):  # the first inputs are the parts of the first state
        state[:, 0] = start
    outputs = (*(state[:, 1:] for state in states), *torques)
    run_steps(kernel_of(robot, inputs.plan), arrays, inputs.ranks, outputs, inputs.steps)
    return results


def run_steps(
    kernel: Any, arrays: Sequence[Array], ranks: Sequence[int], outputs: tuple[Array, ...], steps: int
) -> None:
    """Take the steps of a recurrence, in parts of the batch.

    ``arrays`` are its inputs, and ``ranks`` their numbers of axes without that of the samples, which is the first axis of
    all outputs.
    """
    with np.errstate(all="ignore"):  # overflow in unstable steps is detected and reported
        for inputs, results, step_count in _step_slices(kernel, arrays, ranks, outputs, steps):
            batch_threads.share(kernel, _batch_parts(kernel, inputs, ranks, results, step_count))


def _step_slices(
    kernel: Any, arrays: Sequence[Array], ranks: Sequence[int], outputs: tuple[Array, ...], steps: int
) -> Iterator[tuple[Sequence[Array], tuple[Array, ...], int]]:
    """Slices of the steps, between which Ctrl-C is handled; each begins where the previous one ended.

    A slice has its inputs, its outputs and its number of steps.
    """
    owner = owner_of(kernel)
    scan = owner.given if owner is not None else None
    samples, kept = outputs[0].shape[:2]
    if owner is None or not isinstance(scan, Scan) or not samples or not kept:
        yield arrays, outputs, steps
        return
    if scan.hidden and len(scan.table) == 1:  # hidden results start at zero, so that no slice could go on with them
        yield arrays, outputs, steps
        return
    operations_per_step = owner.cost * len(scan.table) * LANES * SLOWDOWN_OF_SMALL_BATCH
    max_steps = max(1, int(OPERATIONS_PER_CALL / operations_per_step))
    state_parts = scan.visible
    every = steps // kept  # steps from one stored state to the next
    states, step_inputs = list(arrays[:state_parts]), arrays[state_parts:]
    step_ranks = ranks[state_parts:]
    rows = max(1, max_steps // every)  # stored states of a slice; an interval between two may be divided too
    for row in range(0, kept, rows):
        begin, end = row * every, min(kept, row + rows) * every
        results = [x[:, row : row + rows] for x in outputs]
        portion = end - begin if every <= max_steps else max_steps
        for first in range(begin, end, portion):
            stop = min(end, first + portion)
            inputs = []
            for x, rank in zip(step_inputs, step_ranks, strict=True):
                leading_axes = (slice(None),) * (x.ndim - rank)
                inputs.append(x[(*leading_axes, slice(first, stop))])
            reports = results[state_parts:]
            if first > begin:  # reports are those of the first step of an interval
                reports = list(map(np.empty_like, reports))
            yield (*states, *inputs), (*results[:state_parts], *reports), stop - first
            states = [x[:, -1].copy() for x in results[:state_parts]]


def _batch_parts(
    kernel: Any, arrays: Sequence[Array], ranks: Sequence[int], outputs: tuple[Array, ...], steps: int
) -> Iterator[Part]:
    """Parts of the batch, one for each thread, short enough to handle Ctrl-C between two."""
    samples = len(outputs[0])
    owner = owner_of(kernel)
    part_size = max(samples, 1)
    if owner is not None:
        if outputs[0].dtype == np.float32:
            owner.address(SINGLE)  # compiled before the threads start, where exceptions propagate
        stages = len(owner.given.table) if isinstance(owner.given, Scan) else 1
        max_samples = int(OPERATIONS_PER_CALL / (owner.cost * stages * steps))
        samples_per_thread = math.ceil(samples / batch_threads.get_threads())
        blocks = min(max_samples, samples_per_thread) // LANES
        part_size = max(LANES, blocks * LANES)
    for first in range(0, samples, part_size):
        part = slice(first, first + part_size)
        inputs = [x if x.ndim == rank else x[part] for x, rank in zip(arrays, ranks, strict=True)]
        yield Part(tuple(inputs), tuple(x[part] for x in outputs))


def kernel_of(robot: Robot, plan: StepPlan) -> Any:
    """Compiled steps of a plan, cached with the robot."""

    def build() -> Any:
        robot.engine.require_invertible()
        return compile_form(plan.recurrence(), "rollout", f"Rollouts of {robot.name}, compiled: {plan.method}.")

    return robot.engine.cache(plan.key, build)


def room_for(inputs: Inputs, out: Any) -> list[Array]:
    """Arrays for the results: new ones or the caller's; raises ShapeError if the caller's do not fit."""
    shapes = inputs.shapes
    dtype = np.dtype(inputs.dtype)
    if out is not None:
        return _callers_arrays(out, shapes, dtype)
    try:
        return list(result_arrays(shapes, dtype))
    except (MemoryError, ValueError):
        size = sum(map(math.prod, shapes)) * dtype.itemsize
        raise ValueRangeError(
            f"the states of this rollout take {printed(size / 1e9, 3)} GB, more than there is. Keep fewer with every=, or "
            "take fewer samples at a time."
        ) from None


def _callers_arrays(out: Any, shapes: list[tuple[int, ...]], dtype: Any) -> list[Array]:
    """The caller's arrays; raises ShapeError unless the results fit into them."""

    def fits(x: Any, shape: tuple[int, ...]) -> bool:
        if type(x) is not np.ndarray or not x.flags.writeable or not x.flags.c_contiguous:
            return False
        return x.shape == shape and x.dtype == dtype

    expected = ", ".join(f"{name} {shape}" for name, shape in zip(("q", "dq", "tau"), shapes, strict=False))
    given = f"of type {type(out).__name__}"
    if isinstance(out, tuple):
        given = ", ".join(f"{getattr(x, 'dtype', type(x).__name__)} {np.shape(x)}" for x in out)
    if not isinstance(out, tuple) or len(out) != len(shapes) or not all(map(fits, out, shapes)):
        raise ShapeError(
            f"out= is {given}. Give a tuple of {dtype.name} arrays in C order that can be written to: {expected}; "
            "or leave it out."
        )
    if any(np.may_share_memory(x, y) for x, y in combinations(out, 2)):
        raise ShapeError("out= has arrays that share memory.")
    return list(out)
