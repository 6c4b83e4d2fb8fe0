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
"""Number of operations between two checks for a keyboard interrupt, which take about 0.3 s."""
SLOWDOWN_OF_SMALL_BATCH = 3
"""Factor of the time of batches that leave most vector lanes unused."""
LANES = 16
"""Number of samples in a block; every processor gets whole blocks."""


def take_all_steps(robot: Robot, inputs: Inputs, results: list[Array]) -> list[Array]:
    """Take all steps; returns the arrays ``results``, into which states and torques are written."""
    sample_count = math.prod(inputs.batch)
    state_part_count = len(inputs.plan.state)
    arrays = []
    for x in inputs.arrays:
        is_overwritten = any(np.may_share_memory(x, result) for result in results)
        arrays.append(x.copy() if is_overwritten else x)
    flat_results = [x.reshape(sample_count, *x.shape[-2:]) for x in results]  # views: the results are contiguous
    states = flat_results[:state_part_count]
    torques = flat_results[state_part_count:]
    for state, start in zip(states, arrays, strict=False):  # the first inputs are the parts of the first state
        state[:, 0] = start
    states_after_steps = [state[:, 1:] for state in states]
    outputs = (*states_after_steps, *torques)
    run_steps(kernel_of(robot, inputs.plan), arrays, inputs.ranks, outputs, inputs.steps)
    return results


def run_steps(
    kernel: Any, arrays: Sequence[Array], ranks: Sequence[int], outputs: tuple[Array, ...], steps: int
) -> None:
    """Take the steps of a recurrence, in parts of the batch.

    ``arrays`` are the inputs of the kernel. ``ranks`` are their numbers of axes without the axis of samples, which is the first
    axis of all outputs.
    """
    with np.errstate(all="ignore"):  # overflow in unstable steps is detected and reported
        for inputs, results, step_count in _step_slices(kernel, arrays, ranks, outputs, steps):
            batch_threads.share(kernel, _batch_parts(kernel, inputs, ranks, results, step_count))


def _step_slices(
    kernel: Any, arrays: Sequence[Array], ranks: Sequence[int], outputs: tuple[Array, ...], steps: int
) -> Iterator[tuple[Sequence[Array], tuple[Array, ...], int]]:
    """Slices of the steps, between which Ctrl-C is handled: inputs, outputs and number of steps of each.

    Each slice begins with the last state of the previous one.
    """
    owner = owner_of(kernel)
    scan = owner.given if owner is not None else None
    sample_count, stored_count = outputs[0].shape[:2]
    if owner is None or not isinstance(scan, Scan) or not sample_count or not stored_count:
        yield arrays, outputs, steps
        return
    if scan.hidden and len(scan.table) == 1:  # hidden results start at zero, so that no slice could go on with them
        yield arrays, outputs, steps
        return
    operations_per_step = owner.cost * len(scan.table) * LANES * SLOWDOWN_OF_SMALL_BATCH
    max_steps = max(1, int(OPERATIONS_PER_CALL / operations_per_step))
    state_part_count = scan.visible
    steps_per_state = steps // stored_count  # from one stored state to the next
    states = list(arrays[:state_part_count])
    step_inputs = arrays[state_part_count:]
    step_ranks = ranks[state_part_count:]
    states_per_slice = max(1, max_steps // steps_per_state)  # an interval between two stored states may be divided too
    for first_state in range(0, stored_count, states_per_slice):
        next_state = min(stored_count, first_state + states_per_slice)
        begin = first_state * steps_per_state
        end = next_state * steps_per_state
        results = [x[:, first_state:next_state] for x in outputs]
        slice_length = end - begin if steps_per_state <= max_steps else max_steps
        for first_step in range(begin, end, slice_length):
            stop = min(end, first_step + slice_length)
            inputs = []
            for x, rank in zip(step_inputs, step_ranks, strict=True):
                leading_axes = (slice(None),) * (x.ndim - rank)
                inputs.append(x[(*leading_axes, slice(first_step, stop))])
            reports = results[state_part_count:]
            if first_step > begin:  # only reports of the first step of an interval are stored
                reports = list(map(np.empty_like, reports))
            yield (*states, *inputs), (*results[:state_part_count], *reports), stop - first_step
            states = [x[:, -1].copy() for x in results[:state_part_count]]


def _batch_parts(
    kernel: Any, arrays: Sequence[Array], ranks: Sequence[int], outputs: tuple[Array, ...], steps: int
) -> Iterator[Part]:
    """Parts of the batch, one for each thread, short enough to handle Ctrl-C between two parts."""
    sample_count = len(outputs[0])
    owner = owner_of(kernel)
    part_size = max(sample_count, 1)
    if owner is not None:
        if outputs[0].dtype == np.float32:
            owner.address(SINGLE)  # only to compile: before the threads start, exceptions propagate
        stage_count = len(owner.given.table) if isinstance(owner.given, Scan) else 1
        max_samples = int(OPERATIONS_PER_CALL / (owner.cost * stage_count * steps))
        samples_per_thread = math.ceil(sample_count / batch_threads.get_threads())
        block_count = min(max_samples, samples_per_thread) // LANES
        part_size = max(LANES, block_count * LANES)
    for first_sample in range(0, sample_count, part_size):
        part = slice(first_sample, first_sample + part_size)
        inputs = [x if x.ndim == rank else x[part] for x, rank in zip(arrays, ranks, strict=True)]
        yield Part(tuple(inputs), tuple(x[part] for x in outputs))


def kernel_of(robot: Robot, plan: StepPlan) -> Any:
    """Compiled steps of a plan, cached with the robot."""

    def build() -> Any:
        robot.engine.require_invertible()
        return compile_form(plan.recurrence(), "rollout", f"Rollouts of {robot.name}, compiled: {plan.method}.")

    return robot.engine.cache(plan.key, build)


def room_for(inputs: Inputs, out: Any) -> list[Array]:
    """Arrays for the results: the caller's ``out``, or new ones if it is None; raises ShapeError if ``out`` does not fit."""
    shapes = inputs.shapes
    dtype = np.dtype(inputs.dtype)
    if out is not None:
        return _callers_arrays(out, shapes, dtype)
    try:
        return list(result_arrays(shapes, dtype))
    except (MemoryError, ValueError):
        size = sum(map(math.prod, shapes)) * dtype.itemsize  # bytes
        raise ValueRangeError(
            f"the states of this rollout take {printed(size / 1e9, 3)} GB, more than there is. Keep fewer with every=, or "
            "take fewer samples at a time."
        ) from None


def _callers_arrays(out: Any, shapes: list[tuple[int, ...]], dtype: Any) -> list[Array]:
    """The caller's arrays as a list; raises ShapeError unless the results fit into them."""

    def fits(x: Any, shape: tuple[int, ...]) -> bool:
        """True if a result of this shape can be written into x without a copy."""
        if type(x) is not np.ndarray or not x.flags.writeable or not x.flags.c_contiguous:
            return False
        return x.shape == shape and x.dtype == dtype

    expected = ", ".join(f"{name} {shape}" for name, shape in zip(("q", "dq", "tau"), shapes, strict=False))
    given = f"of type {type(out).__name__}"
    if isinstance(out, tuple):
        given = ", ".join(f"{getattr(x, 'dtype', type(x).__name__)} {np.shape(x)}" for x in out)
    all_fit = isinstance(out, tuple) and len(out) == len(shapes) and all(map(fits, out, shapes))
    if not all_fit:
        raise ShapeError(
            f"out= is {given}. Give a tuple of {dtype.name} arrays in C order that can be written to: {expected}; "
            "or leave it out."
        )
    if any(np.may_share_memory(x, y) for x, y in combinations(out, 2)):
        raise ShapeError("out= has arrays that share memory.")
    return list(out)
