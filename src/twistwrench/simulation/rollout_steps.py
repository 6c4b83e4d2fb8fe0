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
"""Operations between two checks for a keyboard interrupt: about 0.3 s."""
SLOWDOWN_OF_SMALL_BATCH = 3
"""Slowdown for batches that leave most vector lanes unused."""
LANES = 16
"""Samples are distributed in multiples of this: whole blocks for every processor."""


def take_all_steps(robot: Robot, inputs: Inputs, results: list[Array]) -> list[Array]:
    """Take all steps; returns the results, with the states written into them."""
    samples, n = math.prod(inputs.batch), len(inputs.plan.state)
    arrays = []
    for x in inputs.arrays:
        shared = any(np.may_share_memory(x, result) for result in results)
        arrays.append(x.copy() if shared else x)
    flat = [x.reshape(samples, *x.shape[-2:]) for x in results]  # views: the results are contiguous
    states, torques = flat[:n], flat[n:]
    for state, start in zip(states, arrays, strict=False):
        state[:, 0] = start
    outputs = (*(state[:, 1:] for state in states), *torques)
    run_steps(kernel_of(robot, inputs.plan), arrays, inputs.ranks, outputs, inputs.steps)
    return results


def run_steps(
    kernel: Any, arrays: Sequence[Array], ranks: Sequence[int], outputs: tuple[Array, ...], steps: int
) -> None:
    """Take the steps of a recurrence, in parts of the batch; the first axis of all outputs is that of the samples."""
    with np.errstate(all="ignore"):  # overflow in unstable steps is detected and reported
        for inputs, results, count in _slices(kernel, arrays, ranks, outputs, steps):
            batch_threads.share(kernel, _parts(kernel, inputs, ranks, results, count))


def _slices(
    kernel: Any, arrays: Sequence[Array], ranks: Sequence[int], outputs: tuple[Array, ...], steps: int
) -> Iterator[tuple[Sequence[Array], tuple[Array, ...], int]]:
    """Slices of the steps, between which Ctrl-C is handled; each begins where the previous one ended."""
    owner = owner_of(kernel)
    scan = owner.given if owner is not None else None
    samples, kept = outputs[0].shape[:2]
    if not (owner is not None and isinstance(scan, Scan) and samples and kept) or (
        scan.hidden and len(scan.table) == 1
    ):
        yield arrays, outputs, steps
        return
    operations = owner.cost * len(scan.table) * LANES * SLOWDOWN_OF_SMALL_BATCH
    most = max(1, int(OPERATIONS_PER_CALL / operations))
    n, every = scan.visible, steps // kept
    states, step_inputs, step_ranks = list(arrays[:n]), arrays[n:], ranks[n:]
    rows = max(1, most // every)  # stored states in a slice; long intervals between two are divided too
    for row in range(0, kept, rows):
        begin, end = row * every, min(kept, row + rows) * every
        results = [x[:, row : row + rows] for x in outputs]
        portion = end - begin if every <= most else most
        for first in range(begin, end, portion):
            last = min(end, first + portion)
            inputs = []
            for x, rank in zip(step_inputs, step_ranks, strict=True):
                inputs.append(x[(slice(None),) * (x.ndim - rank) + (slice(first, last),)])
            reports = results[n:]
            if first > begin:  # reports are those of the first step of an interval
                reports = list(map(np.empty_like, reports))
            yield (*states, *inputs), (*results[:n], *reports), last - first
            states = [x[:, -1].copy() for x in results[:n]]


def _parts(
    kernel: Any, arrays: Sequence[Array], ranks: Sequence[int], outputs: tuple[Array, ...], steps: int
) -> Iterator[Part]:
    """Parts of the batch, one for each thread, short enough to handle Ctrl-C between two."""
    samples, owner = len(outputs[0]), owner_of(kernel)
    rows = max(samples, 1)
    if owner is not None:
        if outputs[0].dtype == np.float32:
            owner.address(SINGLE)  # compiled before the threads start, where exceptions propagate
        stages = len(owner.given.table) if isinstance(owner.given, Scan) else 1
        rows = min(int(OPERATIONS_PER_CALL / (owner.cost * stages * steps)), -(-samples // batch_threads.get_threads()))
        rows = max(LANES, rows // LANES * LANES)
    for first in range(0, samples, rows):
        samples_of_part = slice(first, first + rows)
        inputs = [x if x.ndim == rank else x[samples_of_part] for x, rank in zip(arrays, ranks, strict=True)]
        yield Part(tuple(inputs), tuple(x[samples_of_part] for x in outputs))


def kernel_of(robot: Robot, plan: StepPlan) -> Any:
    """Compiled steps of a plan, cached with the robot."""

    def build() -> Any:
        robot.engine.require_invertible()
        return compile_form(plan.recurrence(), "rollout", f"Rollouts of {robot.name}, compiled: {plan.method}.")

    return robot.engine.cache(plan.key, build)


def room_for(inputs: Inputs, out: Any) -> list[Array]:
    """Arrays for the results: new ones or the caller's; raises ShapeError if these do not fit."""
    shapes, dtype = inputs.shapes, np.dtype(inputs.dtype)
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
    """The caller's arrays, if the results fit."""

    def fits(x: Any, shape: tuple[int, ...]) -> bool:
        flags = type(x) is np.ndarray and x.flags.writeable and x.flags.c_contiguous
        return bool(flags) and x.shape == shape and x.dtype == dtype

    wanted = ", ".join(f"{name} {shape}" for name, shape in zip(("q", "dq", "tau"), shapes, strict=False))
    described = f"of type {type(out).__name__}"
    if isinstance(out, tuple):
        described = ", ".join(f"{getattr(x, 'dtype', type(x).__name__)} {np.shape(x)}" for x in out)
    if not isinstance(out, tuple) or len(out) != len(shapes) or not all(map(fits, out, shapes)):
        raise ShapeError(
            f"out= is {described}. Give a tuple of {dtype.name} arrays in C order that can be written to: {wanted}; "
            "or leave it out."
        )
    if any(np.may_share_memory(x, y) for x, y in combinations(out, 2)):
        raise ShapeError("out= has arrays that share memory.")
    return list(out)
