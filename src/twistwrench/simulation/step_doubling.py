"""What the steps of a run are off by: some of them are taken again, in two halves.

The state after a step of length h and that after two of h/2 from the same state differ by (1 - 2^-p) of what the step is off
by, for a method of order p. Friction, contacts and torques that are functions act in the halves as they do in the step. Source:
Hairer, Nørsett and Wanner, Solving Ordinary Differential Equations I, section II.4, "Richardson extrapolation".

The halves are taken after the run, so they change nothing in it, whatever a function remembers of its calls. A controller is
not asked again: its torque is that of the step.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..errors import SimulationError
from .forces import System

Array = NDArray[np.float64]

_LEAST = 32
"""Steps probed of a run, if it has so many."""
_SPACING = 50
"""Steps between two that are probed, in a long run. A probe is the work of 2.5 steps, of 6 for a method of one evaluation."""
_MOST = 2000
"""Steps probed of a run, and as many again in which a contact begins or ends."""
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


@dataclass(frozen=True, eq=False)
class _Step:
    """One step of the run: from y at t to ``after``, under the torques ``held`` by the controller."""

    number: Any
    t: Any
    y: Array
    after: Array
    held: Array

    @classmethod
    def of_all(cls, steps: list[_Step]) -> _Step:
        """Steps as one, with an axis of steps first; torques have none where they are the same object."""
        numbers, times, before, after = zip(*((s.number, s.t, s.y, s.after) for s in steps), strict=True)
        same = all(s.held is steps[0].held for s in steps)
        held = steps[0].held if same else np.array([s.held for s in steps])
        return cls(np.array(numbers), np.array(times), np.array(before), np.array(after), held)


def probed_steps(n: int) -> Iterator[int]:
    """Which of n steps are probed: the first ones closely, then one of each block, at places that have no period.

    >>> list(probed_steps(3000))[:9]
    [0, 1, 2, 4, 8, 16, 32, 80, 111]
    """
    spacing = max(min(n // _LEAST, _SPACING), n // _MOST, 1)
    k = 0
    while k < min(spacing, n):
        yield k
        k = max(2 * k, 1)
    for block in range(1, -(-n // spacing)):
        k = block * spacing + int(spacing * (block * 0.6180339887498949 % 1.0))  # the golden section
        if k < n:
            yield k


class StepDoubling:
    """The steps of a run that are to be probed, and what they turn out to be off by."""

    def __init__(self, n: int, h: float, *, lagging: bool) -> None:
        self.h, self.lagging = h, lagging
        """Whether velocities are those of half a step before: see :meth:`_lagging`."""
        self._ordered = sorted(probed_steps(n))
        self._due = frozenset(self._ordered)
        self._spread: list[_Step] = []
        self._changed: list[_Step] = []
        self.steps = self._changes = 0
        self._last: _Step | None = None

    def note(self, t: float, y: Array, after: Array, held: Array, *, changed: bool) -> None:
        """Take note of a step, the next one; ``changed``: a contact begins or ends in it, or dry friction changes sides."""
        step = _Step(self.steps, t, y, after, held)
        self.steps += 1
        if step.number in self._due:
            self._spread.append(step)
        if changed:
            for one in (self._last, step):
                if one is not None and (not self._changed or self._changed[-1].number < one.number):
                    self._changes += 1
                    if len(self._changed) < _MOST:
                        self._changed.append(one)
        self._last = step

    def note_block(self, times: Array, states: Array, held: Array, changed: NDArray[np.bool_]) -> None:
        """Take note of the next n steps, from times (n,) through states (n + 1, size); ``changed`` (n,) as of one step."""
        first, n = self.steps, len(times)
        ordered = self._ordered
        noted = {k - first for k in ordered[bisect_left(ordered, first) : bisect_left(ordered, first + n)]}
        noted |= {*np.flatnonzero(changed).tolist(), *np.flatnonzero(changed[1:]).tolist(), n - 1}  # and those before
        for k in sorted(noted):
            self.steps = first + k
            mine = held if held.ndim == 1 else held[k].copy()
            self.note(float(times[k]), states[k].copy(), states[k + 1].copy(), mine, changed=bool(changed[k]))

    def errors(self, system: System, flow: Flow, spans: Array) -> Array | None:
        """What all steps are off by, all together and signs left out, (nv,) [rad or m]; None where no step could be probed.

        An error of velocity counts as the way it makes in ``spans`` (nv) [s], or until friction and damping have ended it.
        """
        special = {step.number for step in self._changed}
        before = system.held, system.applied, system.evaluations
        try:
            spread = self._probe(system, flow, [s for s in self._spread if s.number not in special], spans)
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

    def _probe(self, system: System, flow: Flow, steps: list[_Step], spans: Array) -> tuple[Array, Array] | None:
        """The numbers (m,) of the steps that could be taken in halves, and how far off they were, (m, nv)."""
        found = []
        left = [_Step.of_all(steps)] if steps and flow.takes_many else list(steps)
        for step in left:
            system.held = step.held
            try:
                halves = (self._lagging if self.lagging else self._halves)(system, flow, step)
                change = (halves - step.after)[..., system.moving]
                lasts = lasting(flow, system.moving, step.t + self.h, step.after, change)
            except SimulationError:  # a function that fails at other times than those of the run
                if np.ndim(step.t):
                    left += steps
                continue
            found.append((step.number, step.after, halves, lasts))
        if not found:
            return None
        numbers, whole, halved, times = (np.array(x, float) for x in zip(*found, strict=True))
        whole, halved = whole.reshape(-1, system.size), halved.reshape(-1, system.size)
        good = np.isfinite(halved).all(axis=1)
        if not good.any():
            return None
        whole, halved, times = whole[good], halved[good], times.ravel()[good]
        q, v = slice(0, system.nq), system.moving
        places = _above_rounding(system.robot.subtract(whole[:, q], halved[:, q]), whole[:, q])
        speeds = _above_rounding(whole[:, v] - halved[:, v], whole[:, v])
        off = places + np.minimum(spans, times[:, None]) * speeds
        return numbers.ravel()[good], off / (1.0 - 0.5**flow.order)

    def _late(self, system: System, flow: Flow, spans: Array) -> Array:
        """What it does that the first velocities of a lagging method are too late: they were given for the start itself."""
        if not self.lagging:
            return np.zeros(system.nv)
        first, v = min([*self._spread[:1], *self._changed[:1]], key=lambda step: step.number), system.moving
        system.held = first.held
        late = flow.after(first.t, first.y, 0.5 * self.h)[v] - first.y[v]
        return np.asarray(np.minimum(spans, lasting(flow, v, first.t, first.y, late)) * np.abs(late))

    def _halves(self, _system: System, flow: Flow, step: _Step) -> Array:
        """The state after two steps of half the length."""
        half = 0.5 * self.h
        return flow.after(step.t + half, flow.after(step.t, step.y, half), half)

    def _lagging(self, system: System, flow: Flow, step: _Step) -> Array:
        """The same for a method whose velocities are those of h/2 before, and with half the step those of h/4 before.

        Taken for errors, these differences would add up over a run, while they cancel: the velocities are brought from the
        one time to the other before the halves, and back after them, by the accelerations over a half step.
        """
        v, start, end, half = (..., system.moving), step.y.copy(), step.after, 0.5 * self.h
        start[v] += 0.5 * (flow.after(step.t, step.y, half)[v] - step.y[v])
        halves = self._halves(system, flow, replace(step, y=start))
        halves[v] -= 0.5 * (flow.after(step.t + self.h, end, half)[v] - end[v])
        return halves


def lasting(flow: Accelerations, moving: slice, t: Any, y: Array, off: Array) -> Array:
    """About how long differences of velocities (..., nv) last, by the accelerations they bring, (...) s; inf undamped."""
    moved = y.copy()
    moved[..., moving] += off
    damped = -np.vecdot(off, flow.accelerations(t, moved) - flow.accelerations(t, y))
    with np.errstate(all="ignore"):
        return np.where(damped > 0.0, np.vecdot(off, off) / damped, np.inf)


def _above_rounding(off: Array, of: Array) -> Array:
    """The sizes of differences (m, nv) of numbers (m, k), those of rounding left out."""
    return np.where(np.abs(off) > _ROUNDING * np.abs(of).max(axis=1, keepdims=True), np.abs(off), 0.0)


def _integral(numbers: Array, off: Array, n: int) -> Array:
    """The sum over steps 0 … n - 1 of what is known at some of them, straight between these; (m,), (m, k) → (k,)."""
    edges = np.concatenate([[-0.5], 0.5 * (numbers[1:] + numbers[:-1]), [n - 0.5]])
    return np.asarray(np.diff(edges) @ off)
