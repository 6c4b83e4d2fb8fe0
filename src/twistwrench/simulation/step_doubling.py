"""What the steps of a run are off by: some of them are taken again, in two halves.

The state after a step of length h and that after two of h/2 from the same state differ by (1 - 2^-p) of what the step is off
by, for a method of order p. Friction, contacts and torques that are functions act in the halves as they do in the step. Source:
Hairer, Nørsett and Wanner, Solving Ordinary Differential Equations I, section II.4, "Richardson extrapolation".

The halves are taken after the run, so they change nothing in it, whatever a function remembers of its calls. A controller is
not asked again: its torque is that of the step.
"""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..errors import SimulationError
from .forces import System
from .probed_steps import MOST_PROBED, ProbedSteps, probed_steps

Array = NDArray[np.float64]

_ROUNDING = 1e-14


class Accelerations(Protocol):
    """What a motion obeys."""

    def accelerations(self, t: float, y: Array, /) -> Array:
        """Of a state (size,), (nv,)."""


class Flow(Accelerations, Protocol):
    """Steps of one method, one by one or many at once."""

    @property
    def order(self) -> int:
        """Of the method."""

    @property
    def takes_many(self) -> bool:
        """Whether states and times may have an axis of their own before."""

    def after(self, t: float, y: Array, h: float, /) -> Array:
        """The state a time h later, quaternions of unit length."""

    def begun(self, t: float, y: Array, h: float, /) -> tuple[Array, Array]:
        """The same, and the accelerations (nv,) at the state."""


class StepDoubling:
    """The steps of a run that are to be probed, and what they turn out to be off by."""

    def __init__(self, n: int, h: float, *, lagging: bool) -> None:
        self.h, self.lagging = h, lagging
        """Whether velocities are those of half a step before: see :meth:`_lagging`."""
        self._ordered = probed_steps(n)
        self._due = frozenset(self._ordered)
        self._spread: list[ProbedSteps] = []
        self._changed: list[ProbedSteps] = []
        self.steps = self._changes = 0
        self._last: tuple[float, Array, Array, Array, Array] | None = None
        """The last step, unless it is among those that changed: time, state before and after, torques, accelerations."""

    def note(self, t: float, y: Array, after: Array, held: Array, begun: Array, *, changed: bool) -> None:
        """Take note of a step, the next one; ``changed``: a contact begins or ends in it, or dry friction changes sides."""
        if changed or self.steps in self._due:
            self.note_block(np.array([t]), np.array([y, after]), held, begun[None], np.array([changed]))
        else:
            self._last = t, y, after, held, begun.copy()
            self.steps += 1

    def note_block(
        self, times: Array, states: Array, held: Array, begun: Array, changed: NDArray[np.bool_]
    ) -> None:  # fmt: skip
        """Take note of the next m steps, from times (m,) through states (m + 1, size); ``changed`` (m,) as of one step.

        ``held`` is (nv,) or (m, nv), ``begun`` (m, nv) are the accelerations as they begin. A step before one that changes
        counts as such a one.
        """
        first, m = self.steps, len(times)

        def those(which: Any) -> ProbedSteps:
            mine = held if held.ndim == 1 else held[which]
            return ProbedSteps(which + first, times[which], states[which], states[which + 1], mine, begun[which])

        k = bisect_left(self._ordered, first)
        due = self._ordered[k : bisect_left(self._ordered, first + m, k)]
        if due:
            self._spread.append(those(np.array(due) - first))
        marked = False
        if changed.any():
            if changed[0] and self._last is not None:
                t, y, after, mine, ddq = self._last
                self._mark(ProbedSteps(np.array([first - 1]), np.array([t]), y[None], after[None], mine, ddq[None]))
            both = changed.copy()
            both[:-1] |= changed[1:]
            marked = bool(both[-1])
            self._mark(those(np.flatnonzero(both)))
        mine = held if held.ndim == 1 else held[-1].copy()
        last = float(times[-1]), states[-2].copy(), states[-1].copy(), mine, begun[-1].copy()
        self._last = None if marked else last
        self.steps = first + m

    def _mark(self, steps: ProbedSteps) -> None:
        """Count steps as such in which something changes, and keep them to be probed while they are not too many."""
        left = MOST_PROBED - min(self._changes, MOST_PROBED)
        self._changes += len(steps.numbers)
        if left:
            self._changed.append(steps[:left])

    def errors(self, system: System, flow: Flow, spans: Array) -> Array | None:
        """What all steps are off by, all together and signs left out, (nv,) [rad or m]; None where no step could be probed.

        An error of velocity counts as the way it makes in ``spans`` (nv) [s], or until friction and damping have ended it.
        """
        before = system.held, system.applied, system.evaluations
        try:
            every = self._spread
            if self._changed:
                special = ProbedSteps.of_all(self._changed).numbers
                every = [some[~np.isin(some.numbers, special)] for some in every]
            spread = self._probe(system, flow, every, spans)
            changed = self._probe(system, flow, self._changed, spans)
            if spread is None and changed is None:
                return None
            total = self._late(system, flow, spans)
        finally:
            system.held, system.applied, system.evaluations = before
        if spread is not None:
            total += (1.0 - self._changes / self.steps) * _integral(*spread, self.steps)
        if changed is not None:
            total += self._changes * changed[1].mean(axis=0)
        return total

    def _probe(self, system: System, flow: Flow, parts: list[ProbedSteps], spans: Array) -> tuple[Array, Array] | None:
        """The numbers (m,) of the steps that could be taken in halves, and how far off they were, (m, nv)."""
        found, parts = [], [some for some in parts if len(some.numbers)]
        if not parts:
            return None
        steps = ProbedSteps.of_all(parts)
        left = [steps] if flow.takes_many else [steps[k] for k in range(len(steps.numbers))]
        for step in left:
            system.held = step.held
            try:
                halves, begun = (self._lagging if self.lagging else self._halves)(system, flow, step)
                change = (halves - step.after)[..., system.moving]
                lasts = lasting(flow, system.moving, step.t + self.h, step.after, change, begun)
            except SimulationError:  # a function that fails at other times than those of the run
                if np.ndim(step.t):
                    left += [steps[k] for k in range(len(steps.numbers))]
                continue
            found.append((step.numbers, step.after, halves, lasts))
        if not found:
            return None
        numbers, whole, halved, times = found[0] if len(found) == 1 else map(np.array, zip(*found, strict=True))
        numbers, times = np.atleast_1d(numbers), np.atleast_1d(times)
        whole, halved = whole.reshape(-1, system.size), halved.reshape(-1, system.size)
        good = np.isfinite(halved).all(axis=1)
        if not good.all():
            numbers, whole, halved, times = numbers[good], whole[good], halved[good], times[good]
        if not len(numbers):
            return None
        q, v = slice(0, system.nq), system.moving
        places = _above_rounding(system.robot.subtract(whole[:, q], halved[:, q]), whole[:, q])
        speeds = _above_rounding(whole[:, v] - halved[:, v], whole[:, v])
        off = places + np.minimum(spans, times[:, None]) * speeds
        return numbers, off / (1.0 - 0.5**flow.order)

    def _late(self, system: System, flow: Flow, spans: Array) -> Array:
        """What it does that the first velocities of a lagging method are too late: they were given for the start itself."""
        if not self.lagging:
            return np.zeros(system.nv)
        first, v = self._spread[0][0], system.moving
        system.held = first.held
        late = 0.5 * self.h * first.begun
        return np.asarray(np.minimum(spans, lasting(flow, v, first.t, first.y, late, first.begun)) * np.abs(late))

    def _halves(self, _system: System, flow: Flow, step: ProbedSteps) -> tuple[Array, Array | None]:
        """The state after two steps of half the length; the accelerations after the whole step are not known."""
        half = 0.5 * self.h
        return flow.after(step.t + half, flow.after(step.t, step.y, half), half), None

    def _lagging(self, system: System, flow: Flow, step: ProbedSteps) -> tuple[Array, Array | None]:
        """The same for a method whose velocities are those of h/2 before, and with half the step those of h/4 before.

        Taken for errors, these differences would add up over a run, while they cancel: the velocities are brought from the
        one time to the other before the halves, and back after them, by the accelerations over a half step. Those after the
        whole step are known then. A velocity brought to another time violates constraints by as much as these turn: that is no
        error, and is taken away.
        """
        v, start, end, half = (..., system.moving), step.y.copy(), step.after, 0.5 * self.h
        start[v] += 0.5 * half * step.begun
        halves, _ = self._halves(system, flow, replace(step, y=start))
        later, begun = flow.begun(step.t + self.h, end, half)
        halves[v] -= 0.5 * (later[v] - end[v])
        halves[v] = system.allowed_velocities(halves)
        return halves, begun


def lasting(flow: Accelerations, moving: slice, t: Any, y: Array, off: Array, begun: Array | None = None) -> Array:
    """About how long differences of velocities (..., nv) last, by the accelerations they bring, (...) s; inf undamped.

    ``begun`` are the accelerations at y, if they are known.
    """
    moved = y.copy()
    moved[..., moving] += off
    damped = -np.vecdot(off, flow.accelerations(t, moved) - (flow.accelerations(t, y) if begun is None else begun))
    with np.errstate(all="ignore"):
        return np.where(damped > 0.0, np.vecdot(off, off) / damped, np.inf)


def _above_rounding(off: Array, of: Array) -> Array:
    """The sizes of differences (m, nv) of numbers (m, k), those of rounding left out."""
    return np.where(np.abs(off) > _ROUNDING * np.abs(of).max(axis=1, keepdims=True), np.abs(off), 0.0)


def _integral(numbers: Array, off: Array, n: int) -> Array:
    """The sum over steps 0 … n - 1 of what is known at some of them, straight between these; (m,), (m, k) → (k,)."""
    edges = np.concatenate([[-0.5], 0.5 * (numbers[1:] + numbers[:-1]), [n - 0.5]])
    return np.asarray(np.diff(edges) @ off)
