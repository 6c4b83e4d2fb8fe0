"""What the steps of a run are off by: some of them are taken again, in two halves.

The state after a step of length h and that after two of h/2 from the same state differ by (1 - 2^-p) of what the step is off
by, for a method of order p. Friction, contacts and torques that are functions act in the halves as they do in the step. Source:
Hairer, Nørsett and Wanner, Solving Ordinary Differential Equations I, section II.4, "Richardson extrapolation".

The halves are taken after the run, so they change nothing in it, whatever a function remembers of its calls. A controller is
not asked again: its torque is that of the step.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..errors import SimulationError
from .forces import System
from .schemes import Scheme

Array = NDArray[np.float64]

_LEAST = 32
"""Steps probed of a run, if it has so many."""
_SPACING = 50
"""Steps between two that are probed, in a long run. A probe is the work of 2.5 steps, of 6 for a method of one evaluation."""
_MOST = 2000
"""Steps probed of a run, and as many again in which a contact begins or ends."""
_ROUNDING = 1e-14


@dataclass(frozen=True, eq=False)
class _Step:
    """One step of the run: from y at t to ``after``, under the torques ``held`` by the controller."""

    number: int
    t: float
    y: Array
    after: Array
    held: Array


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
        self._due = probed_steps(n)
        self._next: int | None = next(self._due, None)
        self._spread: list[_Step] = []
        self._changed: list[_Step] = []
        self.steps = self._changes = 0
        self._last: _Step | None = None

    def note(self, t: float, y: Array, after: Array, held: Array, *, changed: bool) -> None:
        """Take note of a step, the next one; ``changed``: a contact begins or ends in it, or dry friction changes sides."""
        step = _Step(self.steps, t, y, after, held)
        self.steps += 1
        if step.number == self._next:
            self._spread.append(step)
            self._next = next(self._due, None)
        if changed:
            for one in (self._last, step):
                if one is not None and (not self._changed or self._changed[-1].number < one.number):
                    self._changes += 1
                    if len(self._changed) < _MOST:
                        self._changed.append(one)
        self._last = step

    def errors(self, system: System, scheme: Scheme, spans: Array) -> Array | None:
        """What all steps are off by, all together and signs left out, (nv,) [rad or m]; None where no step could be probed.

        An error of velocity counts as the way it makes in ``spans`` (nv) [s], or until friction and damping have ended it.
        """
        special = {step.number for step in self._changed}
        before = system.held, system.applied, system.evaluations
        try:
            spread = self._probe(system, scheme, [s for s in self._spread if s.number not in special], spans)
            changed = self._probe(system, scheme, self._changed, spans)
            if spread is None and changed is None:
                return None
            total = self._late(system, scheme, spans)
        finally:
            system.held, system.applied, system.evaluations = before
        if spread is not None:
            total += (1.0 - self._changes / self.steps) * _integral(*spread, self.steps)
        if changed is not None:
            total += self._changes * changed[1].mean(axis=0)
        return total

    def _probe(self, system: System, scheme: Scheme, steps: list[_Step], spans: Array) -> tuple[Array, Array] | None:
        """The numbers (m,) of the steps that could be taken in halves, and how far off they were, (m, nv)."""
        numbers, pairs, times = [], [], []
        for step in steps:
            system.held = step.held
            try:
                take = self._lagging if self.lagging else self._halves
                halves = take(system, scheme, step)
                lasts = lasting(system, step.t + self.h, step.after, halves[system.moving] - step.after[system.moving])
            except SimulationError:  # a function that fails at other times than those of the run
                continue
            if np.isfinite(halves).all():
                numbers.append(step.number)
                pairs.append((step.after, halves))
                times.append(lasts)
        if not pairs:
            return None
        whole, halved = (np.array(x) for x in zip(*pairs, strict=True))
        q, v = slice(0, system.nq), system.moving
        places = _above_rounding(system.robot.subtract(whole[:, q], halved[:, q]), whole[:, q])
        speeds = _above_rounding(whole[:, v] - halved[:, v], whole[:, v])
        off = places + np.minimum(spans, np.array(times)[:, None]) * speeds
        return np.array(numbers, float), off / (1.0 - 0.5**scheme.order)

    def _late(self, system: System, scheme: Scheme, spans: Array) -> Array:
        """What it does that the first velocities of a lagging method are too late: they were given for the start itself."""
        if not self.lagging:
            return np.zeros(system.nv)
        first = min([*self._spread[:1], *self._changed[:1]], key=lambda step: step.number)
        system.held = first.held
        late = self._half(system, scheme, first.t, first.y)[system.moving] - first.y[system.moving]
        return np.asarray(np.minimum(spans, lasting(system, first.t, first.y, late)) * np.abs(late))

    def _halves(self, system: System, scheme: Scheme, step: _Step) -> Array:
        """The state after two steps of half the length."""
        return self._half(system, scheme, step.t + 0.5 * self.h, self._half(system, scheme, step.t, step.y))

    def _half(self, system: System, scheme: Scheme, t: float, y: Array) -> Array:
        rate = np.zeros(system.size)
        system.rates(t, y, rate)
        y = scheme.step(t, y, 0.5 * self.h, rate)
        system.manifold.normalise(y[: system.nq])
        return y

    def _lagging(self, system: System, scheme: Scheme, step: _Step) -> Array:
        """The same for a method whose velocities are those of h/2 before, and with half the step those of h/4 before.

        Taken for errors, these differences would add up over a run, while they cancel: the velocities are brought from the
        one time to the other before the halves, and back after them, by the accelerations over a half step.
        """
        v, start, end = system.moving, step.y.copy(), step.after
        start[v] += 0.5 * (self._half(system, scheme, step.t, step.y)[v] - step.y[v])
        halves = self._halves(system, scheme, replace(step, y=start))
        halves[v] -= 0.5 * (self._half(system, scheme, step.t + self.h, end)[v] - end[v])
        return halves


def lasting(system: System, t: float, y: Array, off: Array) -> float:
    """About how long a difference of velocities (nv) lasts, by the accelerations it brings [s]; inf where nothing damps it."""
    if not off.any():
        return np.inf
    moved, rates = y.copy(), np.zeros((2, system.size))
    moved[system.moving] += off
    system.rates(t, y, rates[0])
    system.rates(t, moved, rates[1])
    damped = -float(off @ (rates[1] - rates[0])[system.moving])
    return float(off @ off) / damped if damped > 0.0 else np.inf


def _above_rounding(off: Array, of: Array) -> Array:
    """The sizes of differences (m, nv) of numbers (m, k), those of rounding left out."""
    return np.where(np.abs(off) > _ROUNDING * np.abs(of).max(axis=1, keepdims=True), np.abs(off), 0.0)


def _integral(numbers: Array, off: Array, n: int) -> Array:
    """The sum over steps 0 … n - 1 of what is known at some of them, straight between these; (m,), (m, k) → (k,)."""
    edges = np.concatenate([[-0.5], 0.5 * (numbers[1:] + numbers[:-1]), [n - 0.5]])
    return np.asarray(np.diff(edges) @ off)
