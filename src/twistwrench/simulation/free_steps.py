"""The steps of an adaptive run that nothing looks at: the states between them are made many at once."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..errors import SimulationError
from ..typing import Array
from .compiled_attempts import ROWS
from .step_blocks import FASTEST

if TYPE_CHECKING:
    from .adaptive import Stepper
    from .compiled_attempts import CompiledAttempts
    from .run import Run

_NUMBERS = 2_000_000
"""Numbers that the states made at once may be."""


def take_freely(run: Run, stepper: Stepper, attempts: CompiledAttempts) -> None:
    """Take the steps of a run from its first state, which is kept, to its end, to a limit, or to where it fails."""
    system, end = run.system, run.end
    (t, y), rate = run.last, run.rate.copy()
    waiting = _Waiting(run, stepper, attempts)
    checks, flat = bool(system.robot.model.quaternions), system.manifold.flat
    try:
        while t < end:
            t1, y1 = stepper.step(t, y, rate, end)
            run.rejected = stepper.rejected
            if checks or not stepper.speed < FASTEST**2:
                y1 = run.checked(t, t1, y1)
            if t == 0.0 and run.leaves_at_once(y, y1, t1):
                return
            waiting.add(t, stepper.last[1])
            t, y, rate = t1, y1, stepper.rate_after
            if not flat:
                rate = rate.copy()
                system.manifold.rates(*system.split(y), out=rate[: system.nq])
            run.advance(t, y)
            if attempts.count == ROWS or waiting.many:
                if waiting.keep():
                    return
                attempts.restart()
    except (SimulationError, KeyboardInterrupt) as problem:
        if waiting.keep() and isinstance(problem, SimulationError):  # the run had ended before it failed
            return
        raise
    if not waiting.keep():
        run.keep_all(np.array([t]), y[None])


class _Waiting:
    """Steps whose states between are still to be kept, and looked at: their rows are the attempts'."""

    def __init__(self, run: Run, stepper: Stepper, attempts: CompiledAttempts) -> None:
        self.run, self.attempts, self.dense, self.kept = run, attempts, stepper.scheme.dense, 1
        """How many states are kept."""
        self.steps: list[tuple[float, float, int, int]] = []
        """When each begins and how long it is [s]; evaluations and steps rejected up to its end."""
        self.first = run.last[1].copy()
        """The state that the first of them begins in."""
        self._most = max(1, _NUMBERS // (5 * run.system.size))
        """States that are made at once."""

    @property
    def many(self) -> bool:
        """Whether so many states are due that they should not wait."""
        return self.run.last[0] > (self.kept + self._most) * self.run.h * self.run.every

    def add(self, t: float, h: float) -> None:
        """The step from t that was accepted last."""
        self.steps.append((t, h, self.run.system.evaluations, self.run.rejected))

    def keep(self) -> bool:
        """Keep the states at all times that are due within the steps, by the dense output; whether the run ends there."""
        run, system, n = self.run, self.run.system, len(self.steps)
        if not n:
            return False
        spacing, near = run.h * run.every, 1e-12 * run.end
        t0, lengths = np.array([step[:2] for step in self.steps]).T
        t1 = np.append(t0[1:], run.last[0])
        before = np.concatenate([self.first[None], self.attempts.states[: n - 1]])
        Q = np.tensordot(self.dense.T, self.attempts.rates[:n], axes=(1, 1))
        most = self._most if run.watch is None else run.n  # nothing is kept before all is looked at
        while True:
            due = np.arange(self.kept, min(self.kept + most, int(t1[-1] / spacing) + 2)) * spacing
            due = due[(due < t1[-1] - near) & (due < run.end)]
            if not len(due) and run.watch is None:
                break
            k = np.searchsorted(t1 - near, due, side="right")
            since = due - t0[k]
            since[np.abs(since) <= near] = 0.0
            states = dense_states(before[k], lengths[k], since / lengths[k], (weights[k] for weights in Q[::-1]))
            for mine in system.robot.model.quaternions:
                states[:, mine] /= np.linalg.norm(states[:, mine], axis=1, keepdims=True)
            if run.watch is not None and self._ends(before, k, since, states):
                return True
            run.keep_all(t0[k] + since, states)
            self.kept += len(due)
            if run.watch is not None:
                break
        self.steps, self.first = [], run.last[1].copy()
        return False

    def _ends(self, before: Array, k: NDArray[np.intp], since: Array, between: Array) -> bool:
        """Whether a step ends the run: then the states up to there are kept, and what came after it is forgotten.

        ``between`` (m, size) are the states kept in steps k (m,), so long after these begin.
        """
        run, attempts, n = self.run, self.attempts, len(self.steps)
        assert run.watch is not None
        first = np.searchsorted(k, np.arange(n + 1)).tolist()
        owners = np.concatenate([k, np.arange(n)])
        order = np.argsort(owners, kind="stable")  # those in a step, then the one after it
        passed, gaps, margins = run.watch.passed(np.concatenate([between, attempts.states[:n]])[order])
        evaluations = run.system.evaluations
        for j in np.unique(owners[order][passed]).tolist():
            (t, h, _, _), mine, after = self.steps[j], slice(first[j], first[j + 1]), attempts.states[j]
            run.watch.stand(gaps[first[j] + j], margins[first[j] + j])
            points = list(zip(since[mine].tolist(), between[mine], strict=True))
            run.rate[:] = attempts.rates[j, 0]
            at = run.along(t, before[j])
            end = run.looked(t, [*points, (h, after)], at)
            if end is None:
                continue
            looked = run.system.evaluations - evaluations
            run.system.evaluations, run.rejected = self.steps[j][2] + looked, self.steps[j][3]
            run.steps, run.last, attempts.count = run.steps - (n - j), (t, before[j].copy()), j + 1
            kept = int(np.searchsorted(since[mine], end)) + first[j]
            some = slice(0, kept)
            times = np.array([step[0] for step in self.steps])[k[some]] + since[some]
            run.keep_all(times, between[some])
            run.finish(t, end, at)
            return True
        run.watch.stand(gaps[-1], margins[-1])
        return False


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
