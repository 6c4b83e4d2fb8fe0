"""Torques and wrenches that are functions, asked at more times within a step than the method asks them, along its motion."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..core.printed_numbers import printed
from ..core.probe_rule import ProbeRule, left_out
from ..errors import SimulationError
from ..typing import Array
from .accuracy import Extent
from .forces import System
from .step_doubling import lasting

Path = Callable[[Array], Array]
"""From shares (m,) of a step to the states (m, size) then."""

_Step = tuple[float, Array, Array, Array]
"""Its time, the states before and after, and the torques held by a controller."""

_MOST_KEPT = 100_000
"""Steps that are kept until the run is over, so that nothing is asked before; of more, the first are looked at on the way."""


_AT_ONCE = 256
"""Steps that are looked at together."""


class ForceProbes:
    """The functions of a run, and the times at which they are asked: see :class:`~twistwrench.core.probe_rule.ProbeRule`."""

    def __init__(self, system: System, times: Array, weights: Array, spacing: float) -> None:
        self.system, self.rule = system, ProbeRule(times, weights, spacing)

    def impulse(self, t: float, h: float, path: Path) -> Array | None:
        """What a step from t leaves out of the impulse of the functions, (nv,) [N m s or N s]; None if nothing.

        Raises SimulationError where a function fails at one of the times.
        """
        if not self.system.functions or not self.rule.needed(h):
            return None
        shares, weights = self.rule.shares(h)
        times, states = t + h * shares, path(shares)
        missing = np.zeros(self.system.nv)
        for _, forces in self.system.functions:
            missing += left_out(weights, forces(times, states))
        return h * missing if missing.any() else None

    def impulses(self, t: Array, h: float, y: Array, after: Array) -> Array:
        """The same of n steps from times (n,) along straight lines from states (n, size) to others, (n, nv)."""
        missing = np.zeros((len(t), self.system.nv))
        if not self.system.functions or not self.rule.needed(h):
            return missing
        shares, weights = self.rule.shares(h)
        times = t[:, None] + h * shares
        states = (y[:, None] + shares[:, None] * (after - y)[:, None]).reshape(-1, y.shape[1])
        for _, forces in self.system.functions:
            missing += left_out(weights, forces(times.ravel(), states).reshape(*times.shape, -1))
        return h * missing

    def change(self, q: Array, dq: Array, impulse: Array) -> Array:
        """The changes of velocity (..., nv) that impulses (..., nv) make."""
        forward = self.system.robot.forward_dynamics
        return np.asarray(forward(q, dq, impulse) - forward(q, dq, np.zeros_like(impulse)))

    def furthest(self, t: float, h: float, path: Path) -> tuple[str, float]:
        """Which function is furthest from its usual value in a step from t, and when [s]."""
        shares, _ = self.rule.shares(h)
        states, found = path(shares), (-1.0, "", t)
        for name, forces in self.system.functions:
            values = forces(t + h * shares, states)
            far = np.abs(values - np.median(values, axis=0)).max(axis=1)
            found = max(found, (float(far.max()), name, t + h * float(shares[int(far.argmax())])))
        return found[1:]


class UnseenForces:
    """What all steps of one length ``h`` leave out, added up; found out when the run is over, as by step doubling."""

    def __init__(self, probes: ForceProbes, h: float) -> None:
        self.probes, self.h = probes, h
        self._sum = np.zeros(probes.system.nv)
        self._steps: list[_Step] = []
        self._worst: tuple[Array, _Step] | None = None

    def note(self, t: float, y: Array, after: Array) -> None:
        """Take note of a step from y at t to the state after it."""
        if self.probes.system.functions:
            self._steps.append((t, y, after, self.probes.system.held))
            if len(self._steps) == _MOST_KEPT:
                self._add_up()

    def note_block(self, times: Array, states: Array, held: Array) -> None:
        """Take note of n steps from times (n,) through states (n + 1, size) under torques (nv,) or (n, nv) of a controller."""
        if self.probes.system.functions:
            kept, torques = states.copy(), np.array(np.broadcast_to(held, (len(times), held.shape[-1])))
            self._steps += zip(times.tolist(), kept[:-1], kept[1:], torques, strict=True)
            if len(self._steps) >= _MOST_KEPT:
                self._add_up()

    def error(self, extent: Extent, end: float) -> Array | None:
        """(nv,) rad or m, what a run to ``end`` [s] is off by for it.

        Each change lasts as errors of velocity do in step doubling. A joint that does not move at all would keep it to
        the end. None where nothing is left out.
        """
        self._add_up()
        if self._worst is None:
            return None
        change, (t, _, after, held) = self._worst
        system = self.probes.system
        before, system.held = (system.held, system.applied, system.evaluations), held
        try:
            lasts = lasting(system, system.moving, t + self.h, after, change)
        except SimulationError:
            lasts = np.array(np.inf)
        finally:
            system.held, system.applied, system.evaluations = before
        return np.asarray(np.minimum(np.where(extent.rests, end, extent.spans), lasts) * self._sum)

    def remark(self) -> str:
        """What to know of it, where the steps are too long for it."""
        if self._worst is None:
            return ""
        t, y, after, _ = self._worst[1]
        what, time = self.probes.furthest(t, self.h, _straight(y, after))
        return (
            f"{what} changes within steps of {printed(self.h, 3)} s in a way that the method does not see, most of all about "
            f"t = {printed(time)} s: take a smaller dt"
        )

    def _add_up(self) -> None:
        system, found = self.probes.system, []
        for first in range(0, len(self._steps), _AT_ONCE):
            some = self._steps[first : first + _AT_ONCE]
            found += [
                (missing, step) for missing, step in zip(self._impulses(some), some, strict=True) if missing.any()
            ]
        self._steps = []
        if not found:
            return
        states = np.array([step[1] for _, step in found])
        change = self.probes.change(states[:, : system.nq], states[:, system.moving], np.array([m for m, _ in found]))
        self._sum += np.abs(change).sum(axis=0)
        largest = int(np.abs(change).max(axis=1).argmax())
        if self._worst is None or np.abs(change[largest]).max() > np.abs(self._worst[0]).max():
            self._worst = change[largest], found[largest][1]

    def _impulses(self, steps: list[_Step]) -> Array:
        """What steps leave out, (n, nv); nothing where a function fails at other times than those of the run."""
        t, y, after = (np.array(x) for x in list(zip(*steps, strict=True))[:3])
        try:
            return self.probes.impulses(t, self.h, y, after)
        except SimulationError:
            if len(steps) == 1:
                return np.zeros((1, self.probes.system.nv))
            return np.concatenate([self._impulses([step]) for step in steps])


def _straight(y: Array, after: Array) -> Path:
    return lambda shares: y + shares[:, None] * (after - y)
