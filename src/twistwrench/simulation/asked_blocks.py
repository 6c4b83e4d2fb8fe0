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

BLOCK = 64
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
    first, h, system = run.steps, run.h, run.system
    watched, tick = run.watch is not None, run.tick
    states = rows.states[:: rows.every]
    states[0] = run.last[1]
    peaks = rows.peaks.data
    call, sizes, strides = rows.calls.function, rows.calls.sizes, rows.calls.strides
    ndarray, double, bound = np.ndarray, np.dtype(float), FASTEST**2
    done = sampled = 0
    end: float | None = None
    try:
        for stages, after in rows.steps[: run.n - first]:
            begin = (first + done) * h
            for share, place, q, dq, asks in stages:
                t = begin + share * h
                for function, row, law, base, shows in asks:
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
                        and (shows or found.dot(found) < inf)
                    ):
                        row[...] = found
                    else:
                        row[...] = law.checked(t, found)
                call(place, sizes, strides, None)
            if not peaks[after] < bound:
                _require_numbers(begin, h, stages)
                sampled = done + 1
                run.require_stable(begin, run.time(first + done + 1), states[done + 1])
            if watched:
                sampled, system.held = done + 1, rows.held[done].copy()
                if first + done == 0 and run.leaves_at_once(states[0], states[1], h):
                    end = 0.0
                    break
                end = run.looked(begin, [(h, states[done + 1])], partial(steps.after, begin, states[done]))
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
    for share, _, _, _, asks in stages:
        for _, row, law, _, _ in asks:
            law.checked(begin + share * h, row)
