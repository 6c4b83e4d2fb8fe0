"""The part of a run that machine code takes: blocks of steps, what is kept of each, and where it stops."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ..typing import Array
from .compiled_steps import CompiledSteps

if TYPE_CHECKING:
    from .run import Run

FASTEST = 1e6
"""rad/s or m/s: what no robot reaches, and a step that is too long soon does."""
_LOOKS = 100
"""Blocks of a run of which progress is told, at least."""


def take_blocks(run: Run, steps: CompiledSteps) -> None:
    """Take the steps of a run as long as they are stable: from the first one that is not they are to be taken one by one."""
    system = run.system
    most = steps.most if run.tick is None else min(steps.most, max(1, run.n // _LOOKS))
    while run.steps < run.n:
        counted = system.evaluations
        found = steps.take(run.last[1], min(most, run.n - run.steps))
        system.evaluations = counted
        if not use_block(run, steps, *found):
            return
    t, y = run.last
    run.record.keep(t, y, steps.accelerations(t, y), system.held)


def use_block(run: Run, steps: CompiledSteps, states: Array, ddq: Array, gaps: Array) -> bool:
    """Keep the next m steps of a run, by states (m + 1, size), up to one that is unstable or ends it; whether none is.

    ``ddq`` (m, nv) and ``gaps`` (m, contacts) are said of the beginnings of steps.
    """
    m = _stable_steps(states[1:], run.system.moving)
    states, stable = states[: m + 1], m == len(ddq)
    gaps = _all_gaps(run, gaps[:m], states[-1])
    first, end, used = run.steps, None, m
    if run.watch is not None and m:
        at_once = first == 0 and run.leaves_at_once(states[0], states[1], run.h)
        for k in (0,) if at_once else run.watch.passings(states, gaps):
            end = 0.0 if at_once else look_in_step(run, steps, (first + k) * run.h, states[k], states[k + 1])
            if end is not None:
                used = k
                break
    run.system.evaluations += steps.stages * (used + (end is not None))
    keep_steps(run, states[: used + 1], ddq[:used], run.system.held, run.system.held, gaps[: used + 1])
    if end is not None:
        end_in_step(run, steps, end, ddq[used], run.system.held)
    elif run.tick is not None and m:
        run.tick(run.last[0])
    return end is None and stable


def _all_gaps(run: Run, begun: Array, last: Array) -> Array:
    """How far each contact is from touching at the beginnings of m steps and after them, (m + 1, contacts)."""
    if not (contacts := run.system.contacts) or run.watch is None:
        return np.zeros((len(begun) + 1, 0))
    q = run.system.split(last)[0]
    found = np.concatenate([begun, [[contact.gap(q) for contact in contacts]]])
    found[0] = run.watch.gaps  # as they were looked at last: rounding is no contact
    return found


def _stable_steps(Y: Array, moving: slice) -> int:
    """How many states (m, size) there are up to the first with an entry that is no number, or velocities out of reach."""
    if abs(float(Y[:, moving].max())) < FASTEST and float(Y[:, moving].min()) > -FASTEST and np.isfinite(Y).all():
        return len(Y)  # row by row takes ten times as long
    return int((np.isfinite(Y).all(axis=1) & (np.abs(Y[:, moving]).max(axis=1) < FASTEST)).argmin())


def look_in_step(run: Run, steps: CompiledSteps, t: float, y: Array, after: Array) -> float | None:
    """Look for events in a step from y at t; how long after t one ends the run, if one does."""
    if t == 0.0 and run.leaves_at_once(y, after, run.h):
        return 0.0
    return run.looked(t, [(run.h, after)], partial(steps.after, t, y))


def end_in_step(run: Run, steps: CompiledSteps, end: float, ddq: Array, tau: Array) -> None:
    """End a run in its next step, which begins with ``ddq`` and ``tau``, a time ``end`` after that."""
    t, y = run.last
    if run.steps % run.every == 0:
        run.record.keep(t, y, ddq, tau)
    if not run.stopped:
        run.finish(t, end, partial(steps.after, t, y))


def keep_steps(run: Run, states: Array, ddq: Array, tau: Array, held: Array, gaps: Array) -> None:
    """Keep and note the next m steps of a run, by the states (m + 1, size) between them.

    ``ddq`` and ``tau`` are those of their beginnings, ``held`` the torques of the controller; one for all, or (m, nv).
    ``gaps`` (m + 1, contacts) are those of the states.
    """
    system, first, m = run.system, run.steps, len(ddq)
    if not m:
        return
    numbers = np.arange(first, first + m + 1)
    times = np.asarray(numbers * run.h, float)
    if numbers[-1] == run.n:
        times[-1] = run.end
    kept = slice(-first % run.every, m, run.every)
    run.record.keep_block(times[kept], states[kept], ddq[kept], tau if tau.ndim == 1 else tau[kept])
    changed = run.touches.block(times[1:], gaps[1:], states[1:, -1] != states[:-1, -1])
    if system.braked is not None:
        signs = np.sign(states[:, system.moving])
        changed |= (signs[1:] != signs[:-1])[:, system.braked.dry].any(axis=1)
    run.doubling.note_block(times[:-1], states, held, ddq, changed)
    run.unseen.note_block(times[:-1], states, held)
    run.steps, run.last = first + m, (float(times[-1]), states[-1].copy())
