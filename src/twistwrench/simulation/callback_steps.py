"""Compiled steps with torques, wrenches or controllers as Python callbacks."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..compiler.ir.loops import Scan
from ..compiler.runtime.dispatch import Rows, bind_calls
from ..core.typing import Array
from .compiled_steps import TABLEAUS, CompiledSteps, StepPlan, stages
from .forces import ControlLaw, System

if TYPE_CHECKING:
    from .run import Run


class CallbackSteps(CompiledSteps):
    """Steps of one method with callbacks for torques or wrenches; its kernel computes one stage per call."""

    @staticmethod
    def recurrence(plan: StepPlan) -> Scan:
        """Compiled loop over stages; for methods with one stage, over steps."""
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
        """States after ``count`` stages of a step, and accelerations at its start."""
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
        """Inputs of a stage at states (..., size) except its length, with callbacks evaluated there."""
        s = self.system
        given = {"tau": s.held, **self.constants}
        for name, law in self.laws:
            q, dq = y[..., : s.nq].copy(), y[..., s.moving].copy()
            found = law(t, q, dq) if y.ndim == 1 else law.values(np.broadcast_to(t, len(y)), q, dq)
            given[name] = s.held + found if name == "tau" else found
        return [given[name] for name in self.names]


# ── Buffers for a block of steps with callbacks, and the prepared calls

Evaluation = tuple[ControlLaw, Array, Array | None]
"""Function to evaluate, destination of its result, and an optional addend."""

Stage = tuple[float, int, Array, Array, list[Evaluation]]
"""Kernel call: fraction of its step, index, coordinates and velocities, and the functions to evaluate."""


SHORT, LONG = 128, 512
"""Numbers of steps in a block: a longer block takes longer to prepare, a shorter one is stored in more parts."""


class CallbackRows:
    """Block of m steps: states, given torques, and the calls for each step."""

    def __init__(self, steps: CompiledSteps, m: int) -> None:
        s = steps.system
        laws, shares = steps.laws, steps.shares
        self.every = n = len(shares)
        """Calls per step."""
        own = np.arange(m * n)
        step, one = own // n, np.zeros(m * n, int)
        self.states = np.zeros((m * n + 1, s.size))
        """States at the start of each call, and after the last one."""
        self.ddq = np.zeros((m * n, s.nv))
        self.held = np.zeros((m, s.nv))
        """(m, nv), torques of the controller plus constant torques."""
        self._h = np.zeros(1)
        self._constants = {name: x[None].copy() for name, x in steps.constants.items()}
        given: dict[str, Rows] = {name: (x, one) for name, x in self._constants.items()}
        given["tau"] = self.held, step
        given |= {name: (np.zeros((m * n, *law.shape)), own) for name, law in laws}
        self.given = given["tau"][0]
        """Torques of each call, or of each step if only a controller varies them."""
        self.tau = self.given[:: len(self.given) // m]
        """(m, nv), torques at the start of each step."""
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
        """Gaps of the contacts at the start of each call."""
        said = [(self.ddq, own), (self.gaps, own)][: 1 + bool(s.contacts)]
        operands = [*states, (self._h, one), *named, *after, *said]
        first = len(states) + 1
        self.call = bind_calls(
            steps.kernel, operands, first + steps.names.index("tau"), first + len(named) + len(steps.cuts)
        )
        """Makes a call, with torques if given, and returns the peak after it."""

        self._rows = {name: given[name][0] for name, _ in laws}
        q, dq = (self.states[:-1, cut] for cut in steps.cuts[:2])
        self._calls = [*zip(shares * m, own.tolist(), q, dq, strict=True)]
        self.sole: ControlLaw | None = None
        """The only callback, if it gives the torques of every call."""
        self.steps: list[list[Stage]] = []
        """Calls of each step."""
        self._plain: list[list[Stage]] = []

    @classmethod
    @contextmanager
    def pooled(
        cls, steps: CompiledSteps, controller: ControlLaw | None, constant: Array, n: int
    ) -> Iterator[CallbackRows]:
        """Rows for a run of n steps, cached with the robot for the next run because the setup is slow."""
        m = SHORT if n <= 2 * SHORT else LONG
        key = "callback rows", type(steps).__name__, m, *steps.plan.key, *(name for name, _ in steps.laws)
        free: list[CallbackRows] = steps.system.robot.engine.cache(key, list)
        try:
            rows = free.pop()
        except IndexError:  # all in use, by nested simulations or other threads
            rows = cls(steps, m)
        rows._begin(steps, controller, constant)
        yield rows
        rows.steps = rows._plain  # keeps no reference to callbacks
        rows.sole = None
        free.append(rows)

    def _begin(self, steps: CompiledSteps, controller: ControlLaw | None, constant: Array) -> None:
        """Numbers and callbacks of a run."""
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
"""rad/s or m/s: larger speeds indicate an unstable step."""
_LOOKS = 100
"""Smallest number of progress reports of a run."""


def run_compiled_blocks(run: Run, steps: CompiledSteps) -> None:
    """Take the steps of a run while they are stable; the rest is left to single steps."""
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
    """Store the next m steps of a run, by states (m + 1, size), up to an unstable one or the end; True if all are stored."""
    m, after, speeds = len(ddq), states[1:], states[1:, run.system.moving]
    if not (speeds.max() < FASTEST and speeds.min() > -FASTEST and np.isfinite(after).all()):  # cheaper than by row
        m = int((np.isfinite(after).all(axis=1) & (np.abs(speeds).max(axis=1) < FASTEST)).argmin())
    states, stable = states[: m + 1], m == len(ddq)
    gaps = _gaps(run, gaps[:m], states[-1])
    if run.detector is not None:
        gaps[0] = run.detector.gaps  # as at the last check: rounding errors do not begin a contact
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
    """Locate events in a step from y at t; returns the time after t at which one ends the run, or None."""
    if t == 0.0 and run.leaves_at_once(y, after, run.h):
        return 0.0
    return run.locate_event(t, [(run.h, after)], partial(steps.after, t, y))


def end_in_step(run: Run, steps: CompiledSteps, end: float, ddq: Array, tau: Array) -> None:
    """End a run in its next step at a time ``end`` after its start, where its values are ``ddq`` and ``tau``."""
    t, y = run.last
    if run.steps % run.every == 0:
        run.record.keep(t, y, ddq, tau)
    if not run.stopped:
        run.finish(t, end, partial(steps.after, t, y))


def keep_steps(run: Run, states: Array, ddq: Array, tau: Array, held: Array, gaps: Array) -> None:
    """Store and record the next m steps of a run, by their states (m + 1, size).

    Torques, and torques ``held`` for a controller, are (nv,) for all or (m, nv); gaps are (m + 1, contacts).
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
    """Take all steps of a run, to its end or to an event that ends it; raises SimulationError if a callback fails."""
    system = run.system
    with CallbackRows.pooled(steps, run.controller, run.constant, run.n) as rows:
        while run.steps < run.n:
            if _take_block(run, steps, rows):
                return
    t, y = run.last
    system.rates(t, y, run.rate)
    run.keep(t, y)


def _take_block(run: Run, steps: CompiledSteps, rows: CallbackRows) -> bool:
    """Take one block of steps, or the remaining ones; True if an event ended the run."""
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
                    if not peak < bound:  # NaN from torques that are not finite fails too
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
    """Gaps of the contacts at the start of each of m steps and after the last one, (m + 1, contacts)."""
    q = run.system.split(last)[0]
    return np.concatenate([begun, [[contact.gap(q) for contact in run.system.contacts]]])
