"""Blocks of compiled steps in a run, with and without callbacks: their results are stored up to an event or the end."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ..core.typing import Array
from .callback_steps import CallbackRows
from .compiled_steps import CompiledSteps
from .methods.schemes import MAX_SPEED

if TYPE_CHECKING:
    from .run import Run

MIN_PROGRESS_REPORTS = 100
"""Smallest number of progress reports of a run."""


def run_compiled_blocks(run: Run, steps: CompiledSteps) -> None:
    """Take the steps of a run while they are stable. From an unstable step on, single steps follow, with their messages."""
    system = run.system
    block_size = steps.most
    if run.tick is not None:
        block_size = min(block_size, max(1, run.n // MIN_PROGRESS_REPORTS))
    while run.steps < run.n:
        evaluations_before = system.evaluations
        _, y = run.last
        states, ddq, gaps = steps.advance(y, min(block_size, run.n - run.steps))
        system.evaluations = evaluations_before  # use_block counts the evaluations of the steps that are used
        if not use_block(run, steps, states, ddq, gaps):
            return
    t, y = run.last
    run.record.keep(t, y, steps.accelerations(t, y), system.held)


def use_block(run: Run, steps: CompiledSteps, states: Array, ddq: Array, gaps: Array) -> bool:
    """Store the next steps of a run up to the first that is unstable or ends the run; True if all are stored.

    ``states`` (m + 1, size) are the states before, between and after m steps; ``ddq`` (m, nv) and ``gaps`` (m, contacts)
    belong to the starts of the steps.
    """
    m = _count_stable_steps(run, states)
    all_stable = m == len(ddq)
    states = states[: m + 1]
    gaps = _append_last_gaps(run, gaps[:m], states[-1])
    if run.detector is not None:
        gaps[0] = run.detector.gaps  # as at the last check: rounding errors do not begin a contact
    used_count = m
    end: float | None = None
    if m:
        used_count, end = _first_end(run, steps, states, gaps)
    evaluated_count = used_count if end is None else used_count + 1  # with the step that ends the run
    run.system.evaluations += steps.stages * evaluated_count
    held = run.system.held
    keep_steps(run, states[: used_count + 1], ddq[:used_count], held, held, gaps[: used_count + 1])
    if end is not None:
        end_in_step(run, steps, end, ddq[used_count], held)
    elif run.tick is not None and m:
        t, _ = run.last
        run.tick(t)
    return end is None and all_stable


def _count_stable_steps(run: Run, states: Array) -> int:
    """Number of steps before an unstable one, by their states (m + 1, size)."""
    states_after = states[1:]
    speeds = states_after[:, run.system.moving]
    is_slow = speeds.max() < MAX_SPEED and speeds.min() > -MAX_SPEED  # cheaper than by row
    if is_slow and np.isfinite(states_after).all():
        return len(states_after)
    is_stable = np.isfinite(states_after).all(axis=1) & (np.abs(speeds).max(axis=1) < MAX_SPEED)
    return int(is_stable.argmin())  # first False


def _first_end(run: Run, steps: CompiledSteps, states: Array, gaps: Array) -> tuple[int, float | None]:
    """Number of steps before the one that ends the run, and the time of the end after the start of that step.

    If no event ends the run: the number of all steps, and None.
    """
    first_step = run.steps
    m = len(states) - 1
    if run.detector is None:
        return m, None
    if first_step == 0 and run.leaves_at_once(states[0], states[1], run.h):
        return 0, 0.0
    for k in run.detector.steps_with_passings(states, gaps):
        end = locate_event(run, steps, (first_step + k) * run.h, states[k], states[k + 1])
        if end is not None:
            return k, end
    return m, None


def locate_event(run: Run, steps: CompiledSteps, t: float, y: Array, y1: Array) -> float | None:
    """Locate events in a step from y at t to y1; returns the time after t at which one ends the run, or None."""
    if t == 0.0 and run.leaves_at_once(y, y1, run.h):
        return 0.0
    state_at = partial(steps.after, t, y)
    return run.locate_event(t, [(run.h, y1)], state_at)


def end_in_step(run: Run, steps: CompiledSteps, end: float, ddq: Array, tau: Array) -> None:
    """End a run in its next step, a time ``end`` after the step's start; ``ddq`` and ``tau`` are of that start."""
    t, y = run.last
    if run.steps % run.every == 0:
        run.record.keep(t, y, ddq, tau)
    if not run.stopped:
        run.finish(t, end, partial(steps.after, t, y))


def keep_steps(run: Run, states: Array, ddq: Array, tau: Array, held: Array, gaps: Array) -> None:
    """Store the next m steps of a run, by their states (m + 1, size), and check their errors.

    Torques ``tau``, and the controller's torques ``held``, are (nv,) for all steps or (m, nv); gaps are (m + 1, contacts).
    """
    system = run.system
    first_step = run.steps
    m = len(ddq)
    if not m:
        return
    step_numbers = np.arange(first_step, first_step + m + 1)
    times = np.asarray(step_numbers * run.h, float)
    if step_numbers[-1] == run.n:
        times[-1] = run.end  # without rounding
    kept = slice(-first_step % run.every, m, run.every)  # every so many steps of the whole run
    if tau.ndim > 1:
        tau = tau[kept]
    run.record.keep_block(times[kept], states[kept], ddq[kept], tau)
    contacts_worked = states[1:, -1] != states[:-1, -1]  # the last entry is the work of contacts
    has_changed = run.contact_durations.block(times[1:], gaps[1:], contacts_worked)
    if system.dry_friction is not None:
        signs = np.sign(states[:, system.moving])
        is_reversed = signs[1:] != signs[:-1]
        has_changed |= is_reversed[:, system.dry_friction.dry].any(axis=1)
    run.doubling.note_block(times[:-1], states, held, ddq, has_changed)
    run.force_check.note_block(times[:-1], states, held)
    run.steps = first_step + m
    run.last = float(times[-1]), states[-1].copy()


def run_callback_blocks(run: Run, steps: CompiledSteps) -> None:
    """Take all steps of a run, to its end or to an event that ends it; raises SimulationError if a callback fails."""
    system = run.system
    with CallbackRows.from_pool(steps, run.controller, run.constant, run.n) as rows:
        while run.steps < run.n:
            if _take_block(run, steps, rows):
                return
    t, y = run.last
    system.rates(t, y, run.rate)
    run.keep(t, y)


def _take_block(run: Run, steps: CompiledSteps, rows: CallbackRows) -> bool:
    """Take one block of steps, or the remaining ones; True if an event ended the run."""
    system = run.system
    first_step = run.steps
    h = run.h
    detects_events = run.detector is not None
    tick = run.tick
    states = rows.states[:: rows.calls_per_step]
    _, states[0] = run.last
    call = rows.call
    sole = rows.sole  # the only callback, if it gives all torques
    max_squared_speed = MAX_SPEED**2
    function = None if sole is None else sole.function
    done = 0  # number of steps to be stored
    sampled = 0  # number of steps whose torques of the controller are known
    end: float | None = None
    try:
        for stages in rows.steps[: run.n - first_step]:
            begin = (first_step + done) * h
            for share, k, q, dq, evaluations in stages:
                t = begin + share * h
                for law, row, base in evaluations:
                    row[...] = law(t, q, dq) if base is None else base + law(t, q, dq)
                if function is None or sole is None:
                    squared_speed = call(k)
                else:
                    try:
                        torques = function(t, q.copy(), dq.copy())
                    except Exception as problem:
                        raise sole.failure(t, problem) from problem
                    squared_speed = call(k, torques)
                    if squared_speed is None:  # not a plain array
                        squared_speed = call(k, sole.require_finite(t, torques))
                    if not squared_speed < max_squared_speed:  # NaN from torques that are not finite fails too
                        sole.require_finite(t, rows.given[k])
            if not squared_speed < max_squared_speed:
                sampled = done + 1
                run.require_stable(begin, run.time(first_step + done + 1), states[done + 1])
            if detects_events:
                sampled = done + 1
                system.held = rows.held[done].copy()
                end = locate_event(run, steps, begin, states[done], states[done + 1])
                if end is not None:
                    break
            done += 1
            if tick is not None:
                tick(run.time(first_step + done))
    finally:
        _keep_block(run, steps, rows, done, max(sampled, done))
    if end is not None:
        end_in_step(run, steps, end, rows.ddq[done * rows.calls_per_step], rows.tau[done])
    return end is not None


def _keep_block(run: Run, steps: CompiledSteps, rows: CallbackRows, done: int, sampled: int) -> None:
    """Store the steps that are ``done``, and the controller's torques in the last one ``sampled``, which may have failed."""
    if sampled:
        run.system.held = rows.held[sampled - 1].copy()
    run.system.evaluations += steps.stages * sampled
    stride = rows.calls_per_step
    states, ddq = rows.states[::stride], rows.ddq[::stride]
    gaps = _append_last_gaps(run, rows.gaps[::stride][:done], states[done])
    keep_steps(run, states[: done + 1], ddq[:done], rows.tau[:done], rows.held[:done], gaps)


def _append_last_gaps(run: Run, start_gaps: Array, last_state: Array) -> Array:
    """Gaps (m + 1, contacts) at the starts of m steps, and in the state after the last one."""
    q, *_ = run.system.split(last_state)
    last_gaps = [contact.gap(q) for contact in run.system.contacts]
    return np.concatenate([start_gaps, [last_gaps]])
