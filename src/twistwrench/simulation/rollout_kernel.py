"""The kernel of a rollout, room for its results, and the call: in parts of the batch."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.printed_numbers import printed
from ..errors import ShapeError, ValueRangeError
from ..kernels import threads
from ..kernels.batch_split import Part
from ..kernels.results import room
from ..kernels.ufunc import owner_of
from ..program.recurrence import Recurrence
from ..robot.model_kernels import compiled
from ..targets.processor import SINGLE
from ..typing import Array
from .rollout_inputs import Inputs
from .step_program import Plan

if TYPE_CHECKING:
    from ..robot import Robot

IN_ONE_CALL = 5e9
"""Operations between two looks at whether the user wants to stop: some 0.3 s."""
ALONE = 3
"""So many times slower are the operations of a few samples, which leave most lanes idle."""
LANES = 16
"""Samples are shared out in multiples of this: whole blocks on every processor."""


def room_for(given: Inputs, out: Any) -> list[Array]:
    """Arrays for the results: fresh ones, or the caller's. Raises ShapeError where they do not fit."""
    return _fresh(given.shapes, given.dtype) if out is None else _lent(out, given.shapes, given.dtype)


def computed(robot: Robot, given: Inputs, results: list[Array]) -> None:
    """Take all steps, and write the states into the results."""
    samples = math.prod(given.batch)
    arrays = [x.copy() if any(np.may_share_memory(x, place) for place in results) else x for x in given.arrays]
    states = len(given.plan.state_sizes)
    flat = [x.reshape(samples, *x.shape[-2:]) for x in results]  # views: the results have no gaps
    for x, start in zip(flat[:states], arrays, strict=False):
        x[:, 0] = start
    outputs = (*(x[:, 1:] for x in flat[:states]), *flat[states:])
    take(kernel_of(robot, given.plan), arrays, given.ranks, outputs, given.steps)


def take(kernel: Any, arrays: Sequence[Array], ranks: Sequence[int], outputs: tuple[Array, ...], steps: int) -> None:
    """Take the steps of a recurrence, in parts of the batch; the first axis of all outputs counts the samples."""
    with np.errstate(all="ignore"):  # what a step too long makes of the numbers is found and said
        for some, places, count in _slices(kernel, arrays, ranks, outputs, steps):
            threads.share(kernel, _parts(kernel, some, ranks, places, count))


def _slices(
    kernel: Any, arrays: Sequence[Array], ranks: Sequence[int], outputs: tuple[Array, ...], steps: int
) -> Iterator[tuple[Sequence[Array], tuple[Array, ...], int]]:
    """Of the steps: so that Ctrl-C is heard between two. Each begins with the states that the one before it ended with."""
    owner = owner_of(kernel)
    made = owner.given if owner is not None else None
    samples, kept = outputs[0].shape[:2]
    if not (owner is not None and isinstance(made, Recurrence) and samples and kept) or (
        made.hidden and len(made.table) == 1
    ):
        yield arrays, outputs, steps
        return
    most = max(1, int(IN_ONE_CALL / (owner.effort * len(made.table) * LANES * ALONE)))
    every, states, rest = steps // kept, list(arrays[: made.visible]), arrays[made.visible :]
    rows = max(1, most // every)  # kept ones in a slice; a long way from one to the next is cut itself
    for row in range(0, kept, rows):
        begin, end = row * every, min(kept, row + rows) * every
        places = tuple(x[:, row : row + rows] for x in outputs)
        portion = end - begin if every <= most else most
        for first in range(begin, end, portion):
            last = min(end, first + portion)
            given = (
                x[(slice(None),) * (x.ndim - rank) + (slice(first, last),)]
                for x, rank in zip(rest, ranks[made.visible :], strict=True)
            )
            said = places[made.visible :] if first == begin else tuple(map(np.empty_like, places[made.visible :]))
            yield (*states, *given), (*places[: made.visible], *said), last - first
            states = [x[:, -1].copy() for x in places[: made.visible]]


def _parts(
    kernel: Any, arrays: Sequence[Array], ranks: Sequence[int], outputs: tuple[Array, ...], steps: int
) -> Iterator[Part]:
    """Of the batch: for as many threads as there are, and so that Ctrl-C is heard between two."""
    samples, owner = len(outputs[0]), owner_of(kernel)
    rows = max(samples, 1)
    if owner is not None:
        if outputs[0].dtype == np.float32:
            owner.address(SINGLE)  # compiled before it is shared out, and here, where an exception can leave
        stages = len(owner.given.table) if isinstance(owner.given, Recurrence) else 1
        rows = min(int(IN_ONE_CALL / (owner.effort * stages * steps)), -(-samples // threads.get_threads()))
        rows = max(LANES, rows // LANES * LANES)
    for first in range(0, samples, rows):
        some = slice(first, first + rows)
        inputs = (x if x.ndim == rank else x[some] for x, rank in zip(arrays, ranks, strict=True))
        yield Part(tuple(inputs), tuple(x[some] for x in outputs))


def kernel_of(robot: Robot, plan: Plan) -> Any:
    """The compiled steps of a plan, made once for a robot."""

    def made() -> Any:
        robot.engine.require_invertible()
        return compiled(plan.recurrence(), "rollout", f"Rollouts of {robot.name}, compiled: {plan.method}.")

    return robot.engine.kept(plan.key, made)


def _fresh(shapes: list[tuple[int, ...]], dtype: Any) -> list[Array]:
    try:
        return list(room(shapes, np.dtype(dtype)))
    except (MemoryError, ValueError):
        size = sum(map(math.prod, shapes)) * np.dtype(dtype).itemsize
        raise ValueRangeError(
            f"the states of this rollout take {printed(size / 1e9, 3)} GB, more than there is. Keep fewer with every=, or "
            "take fewer samples at a time."
        ) from None


def _lent(out: Any, shapes: list[tuple[int, ...]], dtype: Any) -> list[Array]:
    """The caller's arrays, if the results fit in."""
    wanted = ", ".join(f"{name} {shape}" for name, shape in zip(("q", "dq", "tau"), shapes, strict=False))
    fit = (
        isinstance(out, tuple)
        and len(out) == len(shapes)
        and all(
            type(x) is np.ndarray
            and x.shape == shape
            and x.dtype == dtype
            and x.flags.writeable
            and x.flags.c_contiguous
            for x, shape in zip(out, shapes, strict=True)
        )
    )
    if not fit:
        given = (
            ", ".join(f"{getattr(x, 'dtype', type(x).__name__)} {np.shape(x)}" for x in out)
            if isinstance(out, tuple)
            else f"of type {type(out).__name__}"
        )
        raise ShapeError(
            f"out= is {given}. Give a tuple of {np.dtype(dtype).name} arrays in C order that can be written to: {wanted}; "
            "or leave it out."
        )
    if any(np.may_share_memory(x, y) for k, x in enumerate(out) for y in out[:k]):
        raise ShapeError("out= has arrays that share memory.")
    return list(out)
