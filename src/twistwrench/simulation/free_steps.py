"""The steps of an adaptive run that nothing looks at: the states between them are made many at once."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from ..typing import Array
from .step_blocks import FASTEST

if TYPE_CHECKING:
    from .adaptive import Stepper
    from .compiled_attempts import CompiledAttempts
    from .run import Run

_NUMBERS = 2_000_000
"""Numbers that the states made at once may be."""


def take_freely(run: Run, stepper: Stepper, attempts: CompiledAttempts) -> None:
    """Take the steps of a run from its first state, which is kept, to its end."""
    system, end = run.system, run.end
    (t, y), rate = run.last, run.rate.copy()
    waiting = _Waiting(run, attempts, stepper.scheme.dense)
    checks, flat = bool(system.robot.model.quaternions), system.manifold.flat
    try:
        while t < end:
            t1, y1 = stepper.step(t, y, rate, end)
            run.rejected = stepper.rejected
            if checks or not stepper.speed < FASTEST**2:
                y1 = run.checked(t, t1, y1)
            waiting.times.append(t)
            waiting.lengths.append(stepper.last[1])
            t, y, rate = t1, y1, stepper.rate_after
            if not flat:
                rate = rate.copy()
                system.manifold.rates(*system.split(y), out=rate[: system.nq])
            run.advance(t, y)
            if attempts.count == 0:
                waiting.keep()
    finally:
        waiting.keep()
    run.record.keep(t, y, system.constant_accelerations(y[None])[0], system.held)


class _Waiting:
    """Steps whose states between are still to be kept: when they begin, and how long they are; their rows are the attempts'."""

    def __init__(self, run: Run, attempts: CompiledAttempts, dense: Array) -> None:
        self.run, self.attempts, self.dense, self.kept = run, attempts, dense, 1
        """How many states are kept."""
        self.times: list[float] = []
        self.lengths: list[float] = []
        self.first = run.last[1].copy()
        """The state that the first of them begins in."""

    def keep(self) -> None:
        """Keep the states at all times that are due within the steps, by the dense output."""
        run, system, n = self.run, self.run.system, len(self.times)
        if not n:
            return
        spacing, near = run.h * run.every, 1e-12 * run.end
        t0, lengths = np.array(self.times), np.array(self.lengths)
        t1 = np.append(t0[1:], run.last[0])
        before = np.concatenate([self.first[None], self.attempts.states[: n - 1]])
        Q = np.tensordot(self.dense.T, self.attempts.rates[:n], axes=(1, 1))
        self.times, self.lengths, self.first = [], [], run.last[1].copy()
        most = max(1, _NUMBERS // (5 * system.size))
        while True:
            due = np.arange(self.kept, min(self.kept + most, int(t1[-1] / spacing) + 2)) * spacing
            due = due[(due < t1[-1] - near) & (due < run.end)]
            if not len(due):
                return
            k = np.searchsorted(t1 - near, due, side="right")
            since = due - t0[k]
            since[np.abs(since) <= near] = 0.0
            states = dense_states(before[k], lengths[k], since / lengths[k], (weights[k] for weights in Q[::-1]))
            for mine in system.robot.model.quaternions:
                states[:, mine] /= np.linalg.norm(states[:, mine], axis=1, keepdims=True)
            run.record.keep_block(t0[k] + since, states, system.constant_accelerations(states), system.held)
            self.kept += len(due)


def dense_states(before: Array, lengths: Array, shares: Array, weights: Iterator[Array]) -> Array:
    """y + h (θ w1 + θ² w2 + …), (m, size), at shares θ (m,) of steps of h (m,) from y (m, size).

    The weights are those of the highest power first, (m, size) each.
    """
    found, shares = next(weights), shares[:, None]
    for w in weights:
        found *= shares
        found += w
    found *= shares * lengths[:, None]
    found += before
    return found
