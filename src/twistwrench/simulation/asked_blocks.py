"""The part of a run that machine code takes between calls of Python: controllers, torques and wrenches, and events."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..typing import Array
from .asked_rows import AskedRows
from .compiled_steps import CompiledSteps
from .step_blocks import FASTEST, end_in_step, keep_steps, look_in_step

if TYPE_CHECKING:
    from .run import Run


def take_asked(run: Run, steps: CompiledSteps) -> None:
    """Take all steps of a run, to its end or to an event that ends it. Raises SimulationError where a function fails."""
    system = run.system
    with AskedRows.lent(steps, run.controller, run.constant, run.n) as rows:
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
    call, sole, bound = rows.call, rows.sole, FASTEST**2
    function = None if sole is None else sole.function
    done = sampled = 0
    end: float | None = None
    try:
        for stages in rows.steps[: run.n - first]:
            begin = (first + done) * h
            for share, k, q, dq, asks in stages:
                t = begin + share * h
                for law, row, base in asks:
                    row[...] = law(t, q, dq) if base is None else base + law(t, q, dq)
                if function is None or sole is None:
                    peak = call(k)
                else:
                    try:
                        found = function(t, q.copy(), dq.copy())
                    except Exception as problem:
                        raise sole.failure(t, problem) from problem
                    peak = call(k, found)
                    if peak is None:  # it is no plain array
                        peak = call(k, sole.checked(t, found))
                    if not peak < bound:  # the work of torques that are no numbers is none
                        sole.checked(t, rows.given[k])
            if not peak < bound:
                sampled = done + 1
                run.require_stable(begin, run.time(first + done + 1), states[done + 1])
            if watched:
                sampled, system.held = done + 1, rows.held[done].copy()
                end = look_in_step(run, steps, begin, states[done], states[done + 1])
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
        ddq = rows.ddq[:: rows.every]
        gaps = _gaps(run, rows, states[done], done)
        keep_steps(run, states[: done + 1], ddq[:done], rows.tau[:done], rows.held[:done], gaps)
    if end is not None:
        end_in_step(run, steps, end, ddq[done], rows.tau[done])
    return end is not None


def _gaps(run: Run, rows: AskedRows, last: Array, done: int) -> Array:
    """How far each contact is from touching as each step begins and after the last one, (done + 1, contacts)."""
    q = run.system.split(last)[0]
    return np.concatenate([rows.gaps[:: rows.every][:done], [[contact.gap(q) for contact in run.system.contacts]]])
