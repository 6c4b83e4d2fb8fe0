"""A closed robot's simulation under way: blocks of compiled steps, where nothing asks Python in between."""

from __future__ import annotations

import numpy as np

from ..typing import Array
from .closed_steps import COMPILED_METHODS, ClosedSteps
from .closed_system import ClosedSystem
from .run import FASTEST, Run
from .step_doubling import probed_steps

BLOCK = 2000
"""Steps between two looks at progress and at whether the user wants to stop: some 10 ms."""


class ClosedRun(Run):
    """One simulation of a closed robot."""

    system: ClosedSystem

    def fixed(self) -> None:
        """Steps of one length, compiled where torques are constant and nothing else is to be watched or acts."""
        system = self.system
        asks = system.functions or system.wrenches or system.contacts or self.watch or self.controller
        if asks or self.method not in COMPILED_METHODS:
            return super().fixed()
        steps = ClosedSteps(system.loops, self.method, rubs=system.friction is not None)
        return super().fixed() if steps.kernel is None else self._in_blocks(steps)

    def _in_blocks(self, steps: ClosedSteps) -> None:
        """All steps; one that ends too fast or off the constraints is taken again by itself, which mends it or says why."""
        k, y, due = 0, self._begin(), np.fromiter(probed_steps(self.n), int)
        while k < self.n:
            states, good = self._block(steps, min(BLOCK, self.n - k), y)
            self._note(k, states[: good + 1], due)
            if good + 1 < len(states):
                t, y = self.last
                self.system.rates(t, y, self.rate)
                after = self._checked(t, self._time(k + good + 1), self.scheme.step(t, y, self.h, self.rate))
                self._note(k + good, np.array([y, after]), due)
            k, y = self.steps, self.last[1]
            self.tick(self.last[0])
        self._keep_at(self.end, y)

    def _time(self, k: int) -> float:
        return k * self.h if k < self.n else self.end

    def _block(self, steps: ClosedSteps, n: int, y: Array) -> tuple[Array, int]:
        """The states of n steps from y, (n + 1, size), y the first, and how many of the steps are good."""
        s = self.system
        creep = np.ones(s.nv) if s.friction is None else s.friction.creep
        start = y[: s.nq], y[s.moving], y[s.done][:2]
        q, dq, work, *said = steps.taken(n, self.h, start, s.held, creep)
        states = np.zeros((n + 1, s.size))
        states[0] = y
        states[1:, : s.nq], states[1:, s.moving], states[1:, s.done][:, :2] = q, dq, work
        good = s.loops.good(y, *said) & (np.abs(dq).max(axis=1) < FASTEST) & np.isfinite(q).all(axis=1)
        return states, n if good.all() else int(good.argmin())

    def _note(self, k: int, states: Array, due: Array) -> None:
        """Keep the first states of steps k and on that are to be kept, and take note of those that are probed."""
        n, s = len(states) - 1, self.system
        kept = np.arange(-k % self.every, n, self.every)
        q, dq = states[kept, : s.nq], states[kept][:, s.moving]
        ddq = s.accelerations_of(q, dq, np.broadcast_to(s.held, dq.shape))
        times = ((k + kept) * self.h).tolist()
        self.record.rows.extend(zip(times, states[kept], ddq, [s.held] * len(kept), strict=True))
        for i in due[(due >= k) & (due < k + n)].tolist():
            self.doubling.steps = i
            self.doubling.note(i * self.h, states[i - k], states[i - k + 1], s.held, changed=False)
        self.doubling.steps = self.steps = k + n
        self.last = self._time(k + n), states[n]
        s.evaluations += n * len(self.scheme.asked[0])
