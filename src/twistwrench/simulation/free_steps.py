"""The steps of an adaptive run that nothing looks at: the states between them are made many at once."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..typing import Array
from .step_blocks import FASTEST

if TYPE_CHECKING:
    from .adaptive import Stepper
    from .run import Run

_STEPS = 256
"""Steps that wait for the states between them to be made."""
_NUMBERS = 2_000_000
"""Numbers that the states made at once may be."""


def take_freely(run: Run, stepper: Stepper) -> None:
    """Take the steps of a run from its first state, which is kept, to its end."""
    system, end = run.system, run.end
    (t, y), rate = run.last, run.rate.copy()
    waiting = _Waiting(run, stepper.scheme.dense)
    try:
        while t < end:
            t1, y1 = stepper.step(t, y, rate, end)
            run.rejected = stepper.rejected
            if not stepper.speed < FASTEST**2 or system.robot.model.quaternions:
                y1 = run.checked(t, t1, y1)
            waiting.steps.append(stepper.last)
            t, y, rate = t1, y1, stepper.rate_after
            if not system.manifold.flat:
                rate = rate.copy()
                system.manifold.rates(*system.split(y), out=rate[: system.nq])
            run.advance(t, y)
            if len(waiting.steps) == _STEPS:
                waiting.keep()
    finally:
        waiting.keep()
    run.record.keep_block(np.array([t]), y[None], system.constant_accelerations(y[None]), system.held)


class _Waiting:
    """Steps whose states between are still to be kept: time, length, state before and rates of each."""

    def __init__(self, run: Run, dense: Array) -> None:
        self.run, self.dense, self.kept = run, dense, 1
        """How many states are kept."""
        self.steps: list[tuple[float, float, Array, Array]] = []

    def keep(self) -> None:
        """Keep the states at all times that are due within the steps, by the dense output."""
        if not self.steps:
            return
        run, system = self.run, self.run.system
        spacing, near = run.h * run.every, 1e-12 * run.end
        t0, lengths, before, K = (np.array(x) for x in zip(*self.steps, strict=True))
        t1 = np.append(t0[1:], run.last[0])
        self.steps = []
        most = max(1, _NUMBERS // (5 * system.size))
        while True:
            due = np.arange(self.kept, min(self.kept + most, int(t1[-1] / spacing) + 2)) * spacing
            due = due[(due < t1[-1] - near) & (due < run.end)]
            if not len(due):
                return
            k = np.searchsorted(t1 - near, due, side="right")
            since = due - t0[k]
            since[np.abs(since) <= near] = 0.0
            share = (since / lengths[k])[:, None]
            Q = self.dense.T @ K
            powers = share ** np.arange(1, len(self.dense.T) + 1)
            states = before[k] + lengths[k][:, None] * (powers[:, None] @ Q[k])[:, 0]
            for mine in system.robot.model.quaternions:
                states[:, mine] /= np.linalg.norm(states[:, mine], axis=1, keepdims=True)
            run.record.keep_block(t0[k] + since, states, system.constant_accelerations(states), system.held)
            self.kept += len(due)
