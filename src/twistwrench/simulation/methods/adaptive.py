"""Adaptive Dormand–Prince steps of a run: step control and dense output.

Source: Hairer, Nørsett and Wanner, Solving Ordinary Differential Equations I, section II.4.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import SimulationError
from ...core.numbers import printed, residual
from ...core.typing import Array
from ..accuracy.missed_impulses import ForceQuadrature
from ..forces import WORKS, System
from .schemes import MAX_SPEED, RungeKutta
from .stiffness import Stiffness
from .tableaus import DORMAND_PRINCE
from .trial_steps import FunctionTrials, TrialSteps

if TYPE_CHECKING:
    from ..run import Run

_SAFETY, MIN_STEP_FACTOR, MAX_STEP_FACTOR = 0.9, 0.2, 5.0
"""Factor on the step that the error allows; smallest and largest ratio of a step to the one before it."""


class Stepper:
    """Dormand–Prince method with step-size control by tolerances, and its last step."""

    def __init__(
        self, system: System, rtol: float, atol: float, longest: float, spacing: float, duration: float,
        *, trials: TrialSteps | None = None,
    ) -> None:  # fmt: skip
        self.system, self.scheme = system, RungeKutta(system, DORMAND_PRINCE)
        self.probes = ForceQuadrature(system, *self.scheme.quadrature, spacing)
        self.rtol, self.atol, self.longest = rtol, atol, longest
        self.trials = trials or FunctionTrials(system, self.scheme, (rtol, atol))
        self.stiffness = Stiffness(system, self.trials, duration)
        self.power = -1.0 / (DORMAND_PRINCE.embedded_order + 1)
        self.h, self.rejected = 0.0, 0
        self.speed = 0.0
        """Sum of squared velocities after the last step."""
        self.rate_after = np.zeros(0)
        """f at the end of the last step; used by the dense output."""
        self.last: tuple[float, float, Array, Array] = (0.0, 0.0, np.zeros(0), np.zeros(0))

    def step(self, t: float, y: Array, rate: Array, until: float) -> tuple[float, Array]:
        """Time and state after one accepted step, not beyond ``until``."""
        trials = self.trials
        h = min(self.h or self._first_step(y, rate, until - t), self.longest)
        max_factor = MAX_STEP_FACTOR
        while True:
            t1 = until if t + 1.01 * h >= until else t + h
            step = t1 - t
            error, steepness, distance, self.speed = trials.attempt(t, y, rate, step)
            self.stiffness.note(t, step, steepness, distance)
            y1, K = trials.states[trials.count], trials.rates[trials.count]
            if error <= 1.0 and self.system.functions:
                error = max(error, self._missed_change(t, step, y, y1, K))
            if error <= 1.0:
                factor = max_factor
                if error > 0:
                    factor = min(max_factor, self._step_factor(error))
                if step >= 0.99 * h or factor < 1.0:  # a step cut short by `until` does not predict the next one
                    self.h = step * factor
                trials.accept()
                self.rate_after = K[-1]
                self.last = (t, step, y, K)
                return t1, y1
            self.rejected += 1
            max_factor = 1.0
            h = step * (self._step_factor(error) if np.isfinite(error) else 0.1)
            if h < 1e-14 * max(t, 1e-3):
                raise self._failure(t, h, y, y1)

    def _step_factor(self, error: float) -> float:
        """Ratio of the next step to this one, by the norm of this one's error."""
        return max(MIN_STEP_FACTOR, _SAFETY * error**self.power)

    def _failure(self, t: float, h: float, y: Array, y1: Array) -> SimulationError:
        """Error for steps that shrink without end."""
        errors = np.abs(self.trials.errors[self.trials.count] / self._tolerance(y, y1))[self.system.moving]
        worst = int(np.argmax(np.where(np.isfinite(errors), errors, np.inf)))
        return SimulationError(
            f"at t = {printed(t, 9)} s steps shrink below {residual(h)} s and still miss the tolerance, most of "
            f"all in joint {self.system.robot.model.velocity_names[worst]!r}: a force there jumps, or grows "
            "without bound. Make it continuous, or take a method of fixed steps."
        )

    def between(self, times: Array) -> Array:
        """States (m, size) at times (m,) within the last step, by dense output."""
        t0, h, y0, K = self.last
        y = y0 + h * _dense(((times - t0) / h)[:, None], self.scheme.dense.T @ K)
        for state in y:
            self.system.manifold.normalise(state[: self.system.nq])
        return y

    def _tolerance(self, y: Array, y1: Array) -> Array:
        """Allowed error of each entry of a state."""
        return self.atol + self.rtol * np.maximum(np.abs(y), np.abs(y1))

    def total_error(self, spans: Array) -> Array:
        """Estimated error of all steps with order 4, (nv,) [rad or m]; velocity errors times ``spans`` (nv) [s]."""
        errors = self.trials.total
        return np.asarray(self.system.manifold.errors(errors[: self.system.nq]) + spans * errors[self.system.moving])

    def _missed_change(self, t: float, h: float, y: Array, y1: Array, K: Array) -> float:
        """Impulse of callbacks between the stages of a step, as a change of velocity relative to the tolerance."""
        Q = self.scheme.dense.T @ K
        missing = self.probes.impulses(t, h, lambda shares: y + h * _dense(shares[:, None], Q))
        if not missing.any():
            return 0.0
        change = self.probes.change(*self.system.split(y), missing)
        return float(np.sqrt(np.mean(np.square(change / self._tolerance(y, y1)[self.system.moving]))))

    def _first_step(self, y: Array, rate: Array, span: float) -> float:
        """Initial step in which linear extrapolation changes the state by 1 %; 1e-6 s if the state or its rate is tiny."""
        scale = self.atol + self.rtol * np.abs(y)
        motion = slice(0, self.system.size - len(WORKS))
        d0 = float(np.sqrt(np.mean(np.square((y / scale)[motion]))))
        d1 = float(np.sqrt(np.mean(np.square((rate / scale)[motion]))))
        tiny = min(d0, d1) < 1e-5 or not np.isfinite(d1)
        h = 1e-6 if tiny else 0.01 * d0 / d1
        return min(h, span, self.longest)


def _dense(share: Any, Q: Array) -> Array:
    """Mean rate (..., size) from the start of a step to a fraction (..., 1) of it, times the fraction."""
    return np.asarray(share ** np.arange(1, len(Q) + 1) @ Q)


MAX_ENTRIES = 2_000_000
"""Largest number of entries of the states evaluated at once."""


def run_dense(run: Run, stepper: Stepper, trials: TrialSteps) -> None:
    """Take the steps of a run from its stored first state to its end, to a limit, or to a failure."""
    system, end = run.system, run.end
    (t, y), rate = run.last, run.rate.copy()
    waiting = _DueSteps(run, stepper, trials)
    checks, flat = bool(system.robot.model.quaternions), system.manifold.flat
    try:
        while t < end:
            t1, y1 = stepper.step(t, y, rate, end)
            run.rejected = stepper.rejected
            if checks or not stepper.speed < MAX_SPEED**2:
                y1 = run.stable_state(t, t1, y1)
            if t == 0.0 and run.leaves_at_once(y, y1, t1):
                return
            waiting.add(t, stepper.last[1])
            t, y, rate = t1, y1, stepper.rate_after
            if not flat:
                rate = rate.copy()
                system.manifold.rates(*system.split(y), out=rate[: system.nq])
            run.advance(t, y)
            if trials.full or waiting.many:
                if waiting.keep():
                    return
                trials.restart()
    except (SimulationError, KeyboardInterrupt) as problem:
        if waiting.keep() and isinstance(problem, SimulationError):  # the run ended before the failure
            return
        raise
    if not waiting.keep():
        run.keep_all(np.array([t]), y[None])


class _DueSteps:
    """Accepted steps whose dense output is not yet stored and checked; their rows are those of the trials."""

    def __init__(self, run: Run, stepper: Stepper, trials: TrialSteps) -> None:
        self.run, self.trials, self.dense, self.kept = run, trials, stepper.scheme.dense, 1
        """Number of stored states."""
        self.steps: list[tuple[float, float, int, int]] = []
        """Start time and length of each step [s]; evaluations and rejected steps up to its end."""
        self.first = run.last[1].copy()
        """State at the start of the first step."""
        self._most = max(1, MAX_ENTRIES // (5 * run.system.size))
        """Largest number of states evaluated at once."""

    @property
    def many(self) -> bool:
        """True if enough states are due to be stored now."""
        return self.run.last[0] > (self.kept + self._most) * self.run.h * self.run.every

    def add(self, t: float, h: float) -> None:
        """Add the step from t that was accepted last."""
        self.steps.append((t, h, self.run.system.evaluations, self.run.rejected))

    def keep(self) -> bool:
        """Store the states at all times due within the steps, by dense output; True if the run ends there."""
        run, system, n = self.run, self.run.system, len(self.steps)
        if not n:
            return False
        spacing, near = run.h * run.every, 1e-12 * run.end
        t0, lengths = np.array([step[:2] for step in self.steps]).T
        t1 = np.append(t0[1:], run.last[0])
        before = np.concatenate([self.first[None], self.trials.states[: n - 1]])
        Q = np.tensordot(self.dense.T, self.trials.rates[:n], axes=(1, 1))
        most = self._most
        if run.detector is not None:
            most = run.n  # nothing is stored before all is checked
        while True:
            due = np.arange(self.kept, min(self.kept + most, int(t1[-1] / spacing) + 2)) * spacing
            due = due[(due < t1[-1] - near) & (due < run.end)]
            if not len(due) and run.detector is None:
                break
            k = np.searchsorted(t1 - near, due, side="right")
            since = due - t0[k]
            since[np.abs(since) <= near] = 0.0
            states = dense_states(before[k], lengths[k], since / lengths[k], (weights[k] for weights in Q[::-1]))
            for quaternion in system.robot.model.quaternions:
                states[:, quaternion] /= np.linalg.norm(states[:, quaternion], axis=1, keepdims=True)
            if run.detector is not None and self._ends(before, k, since, states):
                return True
            run.keep_all(t0[k] + since, states)
            self.kept += len(due)
            if run.detector is not None:
                break
        self.steps, self.first = [], run.last[1].copy()
        return False

    def _ends(self, before: Array, k: NDArray[np.intp], since: Array, between: Array) -> bool:
        """True if a step ends the run, by the states ``between`` (m, size) in steps k (m,); later ones are then discarded."""
        run, trials, n = self.run, self.trials, len(self.steps)
        assert run.detector is not None
        first = np.searchsorted(k, np.arange(n + 1)).tolist()
        owners = np.concatenate([k, np.arange(n)])
        order = np.argsort(owners, kind="stable")  # states within a step, then the one after it
        passes, gaps, margins = run.detector.mark_passings(np.concatenate([between, trials.states[:n]])[order])
        evaluations = run.system.evaluations
        for j in np.unique(owners[order][passes]).tolist():
            (t, h, _, _), own_rows, after = self.steps[j], slice(first[j], first[j + 1]), trials.states[j]
            run.detector.stand(gaps[first[j] + j], margins[first[j] + j])
            points = list(zip(since[own_rows].tolist(), between[own_rows], strict=True))
            run.rate[:] = trials.rates[j, 0]
            at = run.along(t, before[j])
            end = run.locate_event(t, [*points, (h, after)], at)
            if end is None:
                continue
            evaluations_of_search = run.system.evaluations - evaluations
            run.system.evaluations, run.rejected = self.steps[j][2] + evaluations_of_search, self.steps[j][3]
            run.steps, run.last, trials.count = run.steps - (n - j), (t, before[j].copy()), j + 1
            kept = slice(0, int(np.searchsorted(since[own_rows], end)) + first[j])
            times = np.array([step[0] for step in self.steps])[k[kept]] + since[kept]
            run.keep_all(times, between[kept])
            run.finish(t, end, at)
            return True
        run.detector.stand(gaps[-1], margins[-1])
        return False


def dense_states(before: Array, lengths: Array, shares: Array, weights: Iterator[Array]) -> Array:
    """y + h (θ w1 + θ² w2 + …), (m, size), at fractions θ (m,) of steps h (m,) from y (m, size); weights in falling powers."""
    states, shares = next(weights), shares[:, None]
    for w in weights:
        states *= shares
        states += w
    states *= shares * lengths[:, None]
    states += before
    return states


def run_adaptive(run: Run, stepper: Stepper) -> None:
    """Take adaptive steps, between the samples of a controller if there is one; states in between by dense output."""
    run.stepper = stepper
    y = run.begin()
    t, k, spacing, end = 0.0, 0, run.h * run.every, run.end
    run.sample(t, y)
    run.system.rates(t, y, run.rate)
    run.keep(t, y)
    if isinstance(stepper.trials, TrialSteps) and run.without_callbacks:
        run_dense(run, stepper, stepper.trials)
        return
    kept = 1
    while t < end:
        until = end
        if run.controller is not None and k + 1 < run.n:
            until = (k + 1) * run.h
        t1, y1 = stepper.step(t, y, run.rate, until)
        run.rejected, rate1 = stepper.rejected, stepper.rate_after
        y1 = run.stable_state(t, t1, y1)
        if t == 0.0 and run.leaves_at_once(y, y1, t1):
            return
        begin = kept
        while kept * spacing < t1 - 1e-12 * end and kept * spacing < end:
            kept += 1
        times = np.arange(begin, kept) * spacing
        between = np.zeros((0, len(y)))
        if len(times):
            between = stepper.between(times)
        points = list(zip((times - t).tolist(), between, strict=True))
        if run.detector is not None and run.end_at_event(t, y, [*points, (t1 - t, y1)], points):
            return
        run.keep_all(t + (times - t), between)
        t, y = t1, y1
        run.advance(t, y)
        due = abs(kept * spacing - t) <= 1e-12 * end and t < end
        kept += due
        if run.controller is not None and t == until and t < end:
            k += 1
            run.sample(t, y)
            run.system.rates(t, y, run.rate)
            if due:
                run.keep(t, y)
            continue
        run.rate[:] = rate1
        run.system.manifold.rates(*run.system.split(y), out=run.rate[: run.system.nq])
        if due:
            run.keep_at(t, y)
    run.keep_at(t, y)
