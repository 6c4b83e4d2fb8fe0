"""Compiled steps with torques, wrenches or controllers as Python callbacks."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..ir.loops import Scan
from ..runtime.dispatch import Rows, bind_calls
from ..typing import Array
from .compiled_steps import TABLEAUS, CompiledSteps, StepPlan, stages
from .forces import ControlLaw, System

if TYPE_CHECKING:
    from .run import Run


class CallbackSteps(CompiledSteps):
    """The steps of one method under torques and wrenches of which some are functions; its kernel takes one stage a call."""

    @staticmethod
    def recurrence(plan: StepPlan) -> Scan:
        """Return the compiled loop: one stage, which is a step for methods of one stage."""
        return plan.one_stage() if plan.stages > 1 else plan.recurrence()

    def __init__(self, system: System, plan: StepPlan, order: int, h: float, kernel: Any, cost: float) -> None:
        super().__init__(system, plan, order, h, kernel, cost)
        if self.stages > 1:
            tableau = TABLEAUS[plan.method]
            self.shares, self.table = [float(c) for c in tableau.c], np.array(stages(tableau))
        if system.tau is not None:
            self.laws.append(("tau", system.tau))
        self.laws += [(f"wrench at {frame}", law) for frame, law in system.wrenches.items() if law.varies]

    def stepped(self, t: Any, y: Array, h: float, count: int) -> tuple[Array, Array]:
        """States after ``count`` stages of a step, and the accelerations at its beginning."""
        if self.stages == 1:
            states, ddq, _ = self.advance_with(y, 1, h, self._given(t, y))
            return states[..., 1, :], ddq[..., 0, :]
        s, x, sums, begun = self.system, y, np.zeros_like(y), None
        start = [y[..., None, cut] for cut in self.cuts]
        for share, row in zip(self.shares[:count], self.table, strict=False):
            given = [g[..., None, :] for g in self._given(t + share * h, x)]
            after, summed = np.empty((2, *y.shape[:-1], 1, s.size))
            ddq = np.empty((*y.shape[:-1], 1, s.nv))
            state, added, end, total = ([part[..., cut] for cut in self.cuts] for part in (x, sums, after, summed))
            said = (ddq, np.empty((*ddq.shape[:-1], len(s.contacts)))) if s.contacts else (ddq,)
            out = (*end, np.empty(after.shape[:-1]), *total, *said)
            self.kernel(*state, 0.0, *added, *start, row[None], np.array([h]), *given, out=out)
            x, sums = after[..., 0, :], summed[..., 0, :]
            begun = ddq[..., 0, :] if begun is None else begun
        s.evaluations += count
        assert begun is not None
        return x, begun

    def _given(self, t: Any, y: Array) -> list[Array]:
        """Inputs of a stage at states (..., size) but its length, with functions evaluated there."""
        s = self.system
        given = {"tau": s.held, **self.constants}
        for name, law in self.laws:
            q, dq = y[..., : s.nq].copy(), y[..., s.moving].copy()
            found = law(t, q, dq) if y.ndim == 1 else law.values(np.broadcast_to(t, len(y)), q, dq)
            given[name] = s.held + found if name == "tau" else found
        return [given[name] for name in self.names]


# ── Buffers of a block of steps with callbacks, and the prepared calls

Evaluation = tuple[ControlLaw, Array, Array | None]
"""Function to evaluate, destination of its result, and an addend, if any."""

Stage = tuple[float, int, Array, Array, list[Evaluation]]
"""A kernel call: share of its step, number, coordinates and velocities, and the functions to evaluate."""


SHORT, LONG = 128, 512
"""Steps whose states are kept and looked at together: more are prepared for longer, fewer are kept in more parts."""


class CallbackRows:
    """A block of m steps: their states, the torques given, and what is to be done for each of them."""

    def __init__(self, steps: CompiledSteps, m: int) -> None:
        s = steps.system
        laws, shares = steps.laws, steps.shares
        self.every = n = len(shares)
        """Calls that make a step."""
        own = np.arange(m * n)
        step, one = own // n, np.zeros(m * n, int)
        self.states = np.zeros((m * n + 1, s.size))
        """At the beginning of each call, and after the last one."""
        self.ddq = np.zeros((m * n, s.nv))
        self.held = np.zeros((m, s.nv))
        """(m, nv), what the controller gives and what is constant."""
        self._h = np.zeros(1)
        self._constants = {name: x[None].copy() for name, x in steps.constants.items()}
        given: dict[str, Rows] = {name: (x, one) for name, x in self._constants.items()}
        given["tau"] = self.held, step
        given |= {name: (np.zeros((m * n, *law.shape)), own) for name, law in laws}
        self.given = given["tau"][0]
        """The torques of each call; of each step where no function but a controller gives them."""
        self.tau = self.given[:: len(self.given) // m]
        """(m, nv), the torques as each step begins."""
        self.peaks = np.zeros(m * n + 1)
        """Peaks of these states: see :func:`.compiled_steps.ended`."""
        states, after = ([*self._parts(steps, which), (self.peaks, which)] for which in (own, own + 1))
        if n > 1:
            sums = np.zeros_like(self.states)
            states += [(sums[:, cut], own) for cut in steps.cuts]
            after += [(sums[:, cut], own + 1) for cut in steps.cuts]
            states += [*self._parts(steps, step * n), (steps.table, own % n)]
        named = [given[name] for name in steps.names]
        self.gaps = np.zeros((m * n, len(s.contacts)))
        """Gaps of the contacts as each call begins."""
        said = [(self.ddq, own), (self.gaps, own)][: 1 + bool(s.contacts)]
        operands = [*states, (self._h, one), *named, *after, *said]
        first = len(states) + 1
        self.call = bind_calls(
            steps.kernel, operands, first + steps.names.index("tau"), first + len(named) + len(steps.cuts)
        )
        """Makes a call, with torques of its own if they are given, and gives the peak after it."""

        self._rows = {name: given[name][0] for name, _ in laws}
        q, dq = (self.states[:-1, cut] for cut in steps.cuts[:2])
        self._calls = [*zip(shares * m, own.tolist(), q, dq, strict=True)]
        self.sole: ControlLaw | None = None
        """The only function, if it gives the torques of every call."""
        self.steps: list[list[Stage]] = []
        """Calls of each step."""
        self._plain: list[list[Stage]] = []

    @classmethod
    @contextmanager
    def pooled(
        cls, steps: CompiledSteps, controller: ControlLaw | None, constant: Array, n: int
    ) -> Iterator[CallbackRows]:
        """Rows for a run of n steps, kept by its robot for the next one: what points to them takes long to prepare."""
        m = SHORT if n <= 2 * SHORT else LONG
        key = "callback rows", type(steps).__name__, m, *steps.plan.key, *(name for name, _ in steps.laws)
        free: list[CallbackRows] = steps.system.robot.engine.cached(key, list)
        try:
            rows = free.pop()
        except IndexError:  # all are in use: a function that is called may simulate itself, and so may another thread
            rows = cls(steps, m)
        rows._begin(steps, controller, constant)
        yield rows
        rows.steps = rows._plain  # no function is kept
        rows.sole = None
        free.append(rows)

    def _begin(self, steps: CompiledSteps, controller: ControlLaw | None, constant: Array) -> None:
        """Numbers and functions of a run."""
        self._h[0], self.held[:], laws, n = steps.h, constant, steps.laws, self.every
        for name, x in steps.constants.items():
            self._constants[name][0] = x
        if controller is not None:
            self.sole = None if laws or constant.any() else controller
        else:
            self.sole = laws[0][1] if [name for name, _ in laws] == ["tau"] else None
        if self.sole is not None or not (controller or laws):
            self._plain = self._plain or self._steps([[] for _ in self._calls])
            self.steps = self._plain
            return
        evaluations: list[list[Evaluation]] = [[] for _ in self._calls]
        if controller is not None:
            for k, row in enumerate(self.held):
                evaluations[k * n].append((controller, row, constant))
        for name, law in laws:
            added = controller is not None and name == "tau"
            for k, row in enumerate(self._rows[name]):
                evaluations[k].append((law, row, self.held[k // n] if added else None))
        self.steps = self._steps(evaluations)

    def _steps(self, evaluations: list[list[Evaluation]]) -> list[list[Stage]]:
        every = [(*call, mine) for call, mine in zip(self._calls, evaluations, strict=True)]
        return [every[k : k + self.every] for k in range(0, len(every), self.every)]

    def _parts(self, steps: CompiledSteps, which: NDArray[np.intp]) -> list[Rows]:
        return [(self.states[:, cut], which) for cut in steps.cuts]


# ── Compiled part of a run: blocks of steps, stored results and end

FASTEST = 1e6
"""rad/s or m/s: what no robot reaches, and a step that is too long soon does."""
_LOOKS = 100
"""Number of blocks of a run after which progress is reported, at least."""


def run_compiled_blocks(run: Run, steps: CompiledSteps) -> None:
    """Take the steps of a run as long as they are stable: from the first one that is not they are to be taken one by one."""
    system = run.system
    most = steps.most if run.tick is None else min(steps.most, max(1, run.n // _LOOKS))
    while run.steps < run.n:
        counted = system.evaluations
        found = steps.advance(run.last[1], min(most, run.n - run.steps))
        system.evaluations = counted
        if not use_block(run, steps, *found):
            return
    t, y = run.last
    run.record.keep(t, y, steps.accelerations(t, y), system.held)


def use_block(run: Run, steps: CompiledSteps, states: Array, ddq: Array, gaps: Array) -> bool:
    """Keep the next m steps of a run, by states (m + 1, size), up to one that is unstable or ends it; True if none is."""
    m, after, speeds = len(ddq), states[1:], states[1:, run.system.moving]
    if not (speeds.max() < FASTEST and speeds.min() > -FASTEST and np.isfinite(after).all()):  # row by row takes longer
        m = int((np.isfinite(after).all(axis=1) & (np.abs(speeds).max(axis=1) < FASTEST)).argmin())
    states, stable = states[: m + 1], m == len(ddq)
    gaps = _gaps(run, gaps[:m], states[-1])
    if run.detector is not None:
        gaps[0] = run.detector.gaps  # as at the last check: rounding does not begin a contact
    first, end, used = run.steps, None, m
    if run.detector is not None and m:
        at_once = first == 0 and run.leaves_at_once(states[0], states[1], run.h)
        for k in (0,) if at_once else run.detector.passings(states, gaps):
            end = 0.0 if at_once else locate_event(run, steps, (first + k) * run.h, states[k], states[k + 1])
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


def locate_event(run: Run, steps: CompiledSteps, t: float, y: Array, after: Array) -> float | None:
    """Look for events in a step from y at t; how long after t one ends the run, if one does."""
    if t == 0.0 and run.leaves_at_once(y, after, run.h):
        return 0.0
    return run.locate_event(t, [(run.h, after)], partial(steps.after, t, y))


def end_in_step(run: Run, steps: CompiledSteps, end: float, ddq: Array, tau: Array) -> None:
    """End a run in its next step, which begins with ``ddq`` and ``tau``, a time ``end`` after that."""
    t, y = run.last
    if run.steps % run.every == 0:
        run.record.keep(t, y, ddq, tau)
    if not run.stopped:
        run.finish(t, end, partial(steps.after, t, y))


def keep_steps(run: Run, states: Array, ddq: Array, tau: Array, held: Array, gaps: Array) -> None:
    """Keep and note the next m steps of a run, by the states (m + 1, size) between them.

    Torques, also those ``held`` for a controller, are (nv,) for all or (m, nv), gaps (m + 1, contacts).
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
    changed = run.contact_durations.block(times[1:], gaps[1:], states[1:, -1] != states[:-1, -1])
    if system.dry_friction is not None:
        signs = np.sign(states[:, system.moving])
        changed |= (signs[1:] != signs[:-1])[:, system.dry_friction.dry].any(axis=1)
    run.doubling.note_block(times[:-1], states, held, ddq, changed)
    run.force_check.note_block(times[:-1], states, held)
    run.steps, run.last = first + m, (float(times[-1]), states[-1].copy())


# ── Compiled steps between callbacks: controllers, torques, wrenches, events


def run_callback_blocks(run: Run, steps: CompiledSteps) -> None:
    """Take all steps of a run, to its end or to an event that ends it. Raises SimulationError where a function fails."""
    system = run.system
    with CallbackRows.pooled(steps, run.controller, run.constant, run.n) as rows:
        while run.steps < run.n:
            if _take_block(run, steps, rows):
                return
    t, y = run.last
    system.rates(t, y, run.rate)
    run.keep(t, y)


def _take_block(run: Run, steps: CompiledSteps, rows: CallbackRows) -> bool:
    """Take as many steps as there are rows, or are left; True if an event ended the run."""
    first, h, system = run.steps, run.h, run.system
    watched, tick = run.detector is not None, run.tick
    states = rows.states[:: rows.every]
    states[0] = run.last[1]
    call, sole, bound = rows.call, rows.sole, FASTEST**2
    function = None if sole is None else sole.function
    done = sampled = 0
    end: float | None = None
    try:
        for stages in rows.steps[: run.n - first]:
            begin = (first + done) * h
            for share, k, q, dq, evaluations in stages:
                t = begin + share * h
                for law, row, base in evaluations:
                    row[...] = law(t, q, dq) if base is None else base + law(t, q, dq)
                if function is None or sole is None:
                    peak = call(k)
                else:
                    try:
                        found = function(t, q.copy(), dq.copy())
                    except Exception as problem:
                        raise sole.failure(t, problem) from problem
                    peak = call(k, found)
                    if peak is None:  # not a plain array
                        peak = call(k, sole.checked(t, found))
                    if not peak < bound:  # torques that are not finite make the work NaN
                        sole.checked(t, rows.given[k])
            if not peak < bound:
                sampled = done + 1
                run.require_stable(begin, run.time(first + done + 1), states[done + 1])
            if watched:
                sampled, system.held = done + 1, rows.held[done].copy()
                end = locate_event(run, steps, begin, states[done], states[done + 1])
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
        gaps = _gaps(run, rows.gaps[:: rows.every][:done], states[done])
        keep_steps(run, states[: done + 1], ddq[:done], rows.tau[:done], rows.held[:done], gaps)
    if end is not None:
        end_in_step(run, steps, end, ddq[done], rows.tau[done])
    return end is not None


def _gaps(run: Run, begun: Array, last: Array) -> Array:
    """Gaps of the contacts as each of m steps begins and after the last one, (m + 1, contacts)."""
    q = run.system.split(last)[0]
    return np.concatenate([begun, [[contact.gap(q) for contact in run.system.contacts]]])
