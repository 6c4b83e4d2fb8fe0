"""The part of a run that machine code takes between calls of Python: controllers, torques and wrenches, and events."""

from __future__ import annotations

from functools import partial
from math import inf
from typing import TYPE_CHECKING

import numpy as np

from .asked_rows import AskedRows, Stage
from .compiled_steps import CompiledSteps
from .step_blocks import FASTEST, keep_steps

if TYPE_CHECKING:
    from collections.abc import Sequence

    from .run import Run

BLOCK = 128
"""Steps whose states are kept and looked at together; what is prepared once for them costs a tenth of a millisecond."""


def take_asked(run: Run, steps: CompiledSteps) -> None:
    """Take all steps of a run, to its end or to an event that ends it. Raises SimulationError where a function fails."""
    system = run.system
    rows = AskedRows(steps, run.controller, run.constant, min(BLOCK, run.n))
    while run.steps < run.n:
        if _take_block(run, steps, rows):
            return
    t, y = run.last
    system.rates(t, y, run.rate)
    run.keep(t, y)


def _take_block(run: Run, steps: CompiledSteps, rows: AskedRows) -> bool:
    """As many steps as there are rows, or are left; whether an event ended the run."""
    first, h, whole, system = run.steps, run.h, rows.every == 1, run.system
    watched, tick = run.watch is not None, run.tick
    states = rows.states[:: rows.every]
    states[0] = run.last[1]
    call, sizes, strides = rows.calls.function, rows.calls.sizes, rows.calls.strides
    ndarray, double, bound = np.ndarray, np.dtype(float), FASTEST**2
    done = sampled = 0
    end: float | None = None
    try:
        for stages, after in rows.steps[: run.n - first]:
            begin = (first + done) * h
            for share, place, q, dq, asks in stages:
                t = begin + share * h
                for function, row, law, base in asks:
                    try:
                        found = function(t, q.copy(), dq.copy())
                    except Exception as problem:
                        raise law.failure(t, problem) from problem
                    if base is not None:
                        row[...] = base + law.checked(t, found)
                    elif (
                        type(found) is ndarray
                        and found.dtype is double
                        and found.shape == row.shape
                        and (whole or found.dot(found) < inf)
                    ):
                        row[...] = found  # a NaN in it makes the work of the step NaN
                    else:
                        row[...] = law.checked(t, found)
                call(place, sizes, strides, None)
            if not after.dot(after) < bound:
                _require_numbers(begin, h, stages)
                sampled = done + 1
                run.require_stable(begin, run.time(first + done + 1), after)
            if watched:
                sampled, system.held = done + 1, rows.held[done].copy()
                if first + done == 0 and run.leaves_at_once(states[0], after, h):
                    end = 0.0
                    break
                end = run.looked(begin, [(h, after)], partial(steps.after, begin, states[done]))
                if end is not None:
                    break
            done += 1
            if tick is not None:
                tick(run.time(first + done))
    finally:
        sampled = max(sampled, done)
        if sampled:
            system.held = rows.held[sampled - 1].copy()
        system.evaluations += steps.stages * sampled
        ddq, began = rows.ddq[:: rows.every], slice(done, done + 1)
        if done:
            keep_steps(run, states[: done + 1], ddq[:done], rows.tau[:done], rows.held[:done])
    if end is None:
        return False
    if run.steps % run.every == 0:
        run.record.keep_block(np.array([begin]), states[began], ddq[began], rows.tau[began])
    if not run.stopped:
        run.finish(begin, end, partial(steps.after, begin, states[done]))
    return True


def _require_numbers(begin: float, h: float, stages: Sequence[Stage]) -> None:
    """Raise SimulationError where a function gave what is no number in a step."""
    for stage in stages:
        for ask in stage.asks:
            ask.law.checked(begin + stage.share * h, ask.row)
