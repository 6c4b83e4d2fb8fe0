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

_SAFETY = 0.9
"""Factor on the step that the error allows."""
MIN_STEP_FACTOR = 0.2
"""Smallest ratio of a step to the one before it."""
MAX_STEP_FACTOR = 5.0
"""Largest ratio of a step to the one before it."""
_FACTOR_AFTER_OVERFLOW = 0.1
"""Ratio of a step to the one before it if the error of the latter is not finite."""
_MIN_RELATIVE_STEP = 1e-14
"""Smallest step, relative to the time; shorter steps are a failure."""
_MIN_TIME_SCALE = 1e-3
"""Least time to which the smallest step is relative [s]."""
_LONGER_LAST_STEP = 1.01
"""Ratio up to which a step is longer than it should be rather than a tiny step before the end."""
_MIN_SHARE_OF_STEP = 0.99
"""Ratio of a step to the step that the error allows, below which the step is shortened."""
_FIRST_CHANGE = 0.01
"""Relative change of the state in the first step."""
_MIN_SIZE_OF_STATE = 1e-5
"""Size of the state or its rate, in tolerances, below which the first step has a fixed length."""
_FIRST_STEP_IF_TINY = 1e-6
"""Length of the first step if the state or its rate is tiny [s]."""
_ROUNDING_OF_TIME = 1e-12
"""Largest difference of two equal times, relative to the duration."""


class Stepper:
    """Dormand–Prince method with step-size control by tolerances, and its last step."""

    def __init__(
        self, system: System, rtol: float, atol: float, longest: float, spacing: float, duration: float,
        *, trials: TrialSteps | None = None,
    ) -> None:  # fmt: skip
        self.system = system
        self.scheme = RungeKutta(system, DORMAND_PRINCE)
        self.probes = ForceQuadrature(system, *self.scheme.quadrature, spacing)
        self.rtol = rtol
        self.atol = atol
        self.longest = longest
        self.trials = trials or FunctionTrials(system, self.scheme, (rtol, atol))
        self.stiffness = Stiffness(system, self.trials, duration)
        self.power = -1.0 / (DORMAND_PRINCE.embedded_order + 1)
        """Exponent of the error in the ratio of the next step to this step."""
        self.h = 0.0
        """Length of the next step [s]; 0 before the first."""
        self.rejected = 0
        """Number of rejected steps."""
        self.speed = 0.0
        """Sum of squared velocities after the last step."""
        self.rate_after = np.zeros(0)
        """f at the end of the last step; used by the dense output."""
        self.last: tuple[float, float, Array, Array] = (0.0, 0.0, np.zeros(0), np.zeros(0))
        """Start time, length, first state and stage rates K of the last accepted step."""

    def step(self, t: float, y: Array, rate: Array, until: float) -> tuple[float, Array]:
        """Time and state after one accepted step, not beyond ``until``; ``rate`` is f(t, y)."""
        trials = self.trials
        h = self.h
        if not h:
            h = self._first_step(y, rate, until - t)
        h = min(h, self.longest)
        max_factor = MAX_STEP_FACTOR
        while True:
            reaches_end = t + _LONGER_LAST_STEP * h >= until
            t1 = until if reaches_end else t + h  # end of the step
            step = t1 - t
            error, steepness, distance, self.speed = trials.attempt(t, y, rate, step)
            self.stiffness.note(t, step, steepness, distance)
            y1 = trials.states[trials.count]
            K = trials.rates[trials.count]
            if error <= 1.0 and self.system.functions:
                error = max(error, self._missed_change(t, step, y, y1, K))
            if error <= 1.0:
                factor = max_factor
                if error > 0:
                    factor = min(max_factor, self._step_factor(error))
                is_shortened = step < _MIN_SHARE_OF_STEP * h  # by ``until``: such a step does not predict the next step
                if not is_shortened or factor < 1.0:
                    self.h = step * factor
                trials.accept()
                self.rate_after = K[-1]
                self.last = (t, step, y, K)
                return t1, y1
            self.rejected += 1
            max_factor = 1.0  # the step after a rejected one does not grow
            factor = _FACTOR_AFTER_OVERFLOW
            if np.isfinite(error):
                factor = self._step_factor(error)
            h = step * factor
            if h < _MIN_RELATIVE_STEP * max(t, _MIN_TIME_SCALE):
                raise self._failure(t, h, y, y1)

    def _step_factor(self, error: float) -> float:
        """Ratio of the next step to this step, by the norm of the error of this step."""
        return max(MIN_STEP_FACTOR, _SAFETY * error**self.power)

    def _failure(self, t: float, h: float, y: Array, y1: Array) -> SimulationError:
        """Error message for steps that shrink without end, with the joint of the largest error."""
        relative_errors = np.abs(self.trials.errors[self.trials.count] / self._tolerance(y, y1))
        velocity_errors = relative_errors[self.system.moving]
        finite_or_inf = np.where(np.isfinite(velocity_errors), velocity_errors, np.inf)  # nan counts as the largest
        worst = int(np.argmax(finite_or_inf))
        return SimulationError(
            f"at t = {printed(t, 9)} s steps shrink below {residual(h)} s and still miss the tolerance, most of "
            f"all in joint {self.system.robot.model.velocity_names[worst]!r}: a force there jumps, or grows "
            "without bound. Make it continuous, or take a method of fixed steps."
        )

    def between(self, times: Array) -> Array:
        """States (m, size) at times (m,) within the last step, by dense output."""
        t0, h, y0, K = self.last
        shares = ((times - t0) / h)[:, None]
        y = y0 + h * _dense_change(shares, self.scheme.dense.T @ K)
        for state in y:
            self.system.manifold.normalise(state[: self.system.nq])
        return y

    def _tolerance(self, y: Array, y1: Array) -> Array:
        """Allowed error of each entry of a state."""
        return self.atol + self.rtol * np.maximum(np.abs(y), np.abs(y1))

    def total_error(self, spans: Array) -> Array:
        """Sum of the estimated errors of all steps with order 4, (nv,) [rad or m].

        An error of a velocity counts as the error of a position after the time in ``spans`` (nv,) [s].
        """
        errors = self.trials.total
        position_errors = self.system.manifold.errors(errors[: self.system.nq])
        return np.asarray(position_errors + spans * errors[self.system.moving])

    def _missed_change(self, t: float, h: float, y: Array, y1: Array, K: Array) -> float:
        """Change (rms) of the velocities that callbacks cause between the stages of a step, relative to the tolerance."""
        Q = self.scheme.dense.T @ K
        missed_impulse = self.probes.impulses(t, h, lambda shares: y + h * _dense_change(shares[:, None], Q))
        if not missed_impulse.any():
            return 0.0
        change = self.probes.change(*self.system.split(y), missed_impulse)
        allowed_change = self._tolerance(y, y1)[self.system.moving]
        return float(np.sqrt(np.mean(np.square(change / allowed_change))))

    def _first_step(self, y: Array, rate: Array, span: float) -> float:
        """Initial step in which linear extrapolation changes the state by 1 %; 1e-6 s if the state or its rate is tiny."""
        scale = self.atol + self.rtol * np.abs(y)
        motion = slice(0, self.system.size - len(WORKS))  # coordinates and velocities
        state_size = float(np.sqrt(np.mean(np.square((y / scale)[motion]))))  # in tolerances
        rate_size = float(np.sqrt(np.mean(np.square((rate / scale)[motion]))))
        is_tiny = min(state_size, rate_size) < _MIN_SIZE_OF_STATE or not np.isfinite(rate_size)
        h = _FIRST_STEP_IF_TINY if is_tiny else _FIRST_CHANGE * state_size / rate_size
        return min(h, span, self.longest)


def _dense_change(shares: Any, Q: Array) -> Array:
    """Change θ Q_1 + θ² Q_2 + … of a state, divided by the step, up to fractions θ (..., 1) of the step: (..., size)."""
    return np.asarray(shares ** np.arange(1, len(Q) + 1) @ Q)


MAX_DENSE_ENTRIES = 2_000_000
"""Largest number of entries of all arrays of states evaluated at once."""
_ARRAYS_OF_STATES = 5
"""Number of arrays of this size that an evaluation may hold at once."""


def run_dense(run: Run, stepper: Stepper, trials: TrialSteps) -> None:
    """Take the steps of a run from its stored first state to its end, to a limit, or to a failure."""
    system = run.system
    end = run.end
    t, y = run.last
    rate = run.rate.copy()
    due_steps = _DueSteps(run, stepper, trials)
    has_quaternions = bool(system.robot.model.quaternions)
    is_flat = system.manifold.flat
    try:
        while t < end:
            t1, y1 = stepper.step(t, y, rate, end)
            run.rejected = stepper.rejected
            if has_quaternions or not stepper.speed < MAX_SPEED**2:
                y1 = run.stable_state(t, t1, y1)
            if t == 0.0 and run.leaves_at_once(y, y1, t1):
                return
            _, h, _, _ = stepper.last
            due_steps.add(t, h)
            t, y = t1, y1
            rate = stepper.rate_after
            if not is_flat:  # the rates of normalised quaternions differ from those of the last stage
                rate = rate.copy()
                system.manifold.rates(*system.split(y), out=rate[: system.nq])
            run.advance(t, y)
            if trials.full or due_steps.are_many:
                run_has_ended = due_steps.store()
                if run_has_ended:
                    return
                trials.restart()
    except (SimulationError, KeyboardInterrupt) as problem:
        run_has_ended = due_steps.store()
        if run_has_ended and isinstance(problem, SimulationError):  # before the failure
            return
        raise
    run_has_ended = due_steps.store()
    if not run_has_ended:
        run.keep_all(np.array([t]), y[None])


class _DueSteps:
    """Accepted steps whose dense output is not yet stored and checked; step j is row j of the trials."""

    def __init__(self, run: Run, stepper: Stepper, trials: TrialSteps) -> None:
        self.run = run
        self.trials = trials
        self.dense = stepper.scheme.dense
        self.stored_count = 1
        """Number of stored states."""
        self.steps: list[tuple[float, float, int, int]] = []
        """Start time and length of each step [s]; evaluations and rejected steps up to its end."""
        _, first_state = run.last
        self.first_state = first_state.copy()
        """State at the start of the first step."""
        self._max_states = max(1, MAX_DENSE_ENTRIES // (_ARRAYS_OF_STATES * run.system.size))
        """Largest number of states evaluated at once."""

    @property
    def are_many(self) -> bool:
        """True if so many states are due that they are stored now."""
        t, _ = self.run.last
        return t > (self.stored_count + self._max_states) * self.run.h * self.run.every

    def add(self, t: float, h: float) -> None:
        """Add the step from t that was accepted last."""
        self.steps.append((t, h, self.run.system.evaluations, self.run.rejected))

    def store(self) -> bool:
        """Store the states at all times due within the steps, by dense output; True if the run ends there."""
        run = self.run
        n = len(self.steps)
        if not n:
            return False
        spacing = run.h * run.every
        rounding = _ROUNDING_OF_TIME * run.end
        t0 = np.array([t for t, _, _, _ in self.steps])
        lengths = np.array([h for _, h, _, _ in self.steps])
        end_time, _ = run.last
        t1 = np.append(t0[1:], end_time)
        before = np.concatenate([self.first_state[None], self.trials.states[: n - 1]])  # states at t0
        Q = np.tensordot(self.dense.T, self.trials.rates[:n], axes=(1, 1))  # (powers, n, size)
        max_states = self._max_states
        if run.detector is not None:
            max_states = run.n  # all at once, as nothing is stored before all is checked
        while True:
            stop = min(self.stored_count + max_states, int(t1[-1] / spacing) + 2)
            due_times = np.arange(self.stored_count, stop) * spacing
            due_times = due_times[(due_times < t1[-1] - rounding) & (due_times < run.end)]
            if not len(due_times) and run.detector is None:
                break
            k = np.searchsorted(t1 - rounding, due_times, side="right")  # step of each due time
            time_in_step = due_times - t0[k]
            time_in_step[np.abs(time_in_step) <= rounding] = 0.0
            weights_from_highest_power = (weights[k] for weights in Q[::-1])
            states = dense_states(before[k], lengths[k], time_in_step / lengths[k], weights_from_highest_power)
            for quaternion in run.system.robot.model.quaternions:
                states[:, quaternion] /= np.linalg.norm(states[:, quaternion], axis=1, keepdims=True)
            if run.detector is not None and self._end_at_event(before, k, time_in_step, states):
                return True
            run.keep_all(t0[k] + time_in_step, states)
            self.stored_count += len(due_times)
            if run.detector is not None:
                break
        self.steps = []
        _, last_state = run.last
        self.first_state = last_state.copy()
        return False

    def _end_at_event(self, before: Array, k: NDArray[np.intp], time_in_step: Array, between: Array) -> bool:
        """End the run at the first event in the steps that ends it, and discard later states; False if there is none.

        ``before`` (n, size) are the states at the starts of the steps. ``between`` (m, size) are the states to be stored:
        in the steps k (m,), at the times ``time_in_step`` (m,) after the starts of these steps.
        """
        run = self.run
        trials = self.trials
        n = len(self.steps)
        assert run.detector is not None
        first_row = np.searchsorted(k, np.arange(n + 1)).tolist()  # of each step in ``between``
        step_of_state = np.concatenate([k, np.arange(n)])
        order = np.argsort(step_of_state, kind="stable")  # states within a step, then the state after it
        states_in_order = np.concatenate([between, trials.states[:n]])[order]
        passes, gaps, margins = run.detector.mark_passings(states_in_order)
        evaluations_before = run.system.evaluations
        steps_with_passings = np.unique(step_of_state[order][passes])
        for j in steps_with_passings.tolist():
            t, h, evaluations_of_step, rejected_of_step = self.steps[j]
            rows = slice(first_row[j], first_row[j + 1])
            row_before = first_row[j] + j  # gaps have one row more for each step before, and one at the beginning
            run.detector.store_values(gaps[row_before], margins[row_before])
            points = list(zip(time_in_step[rows].tolist(), between[rows], strict=True))
            run.rate[:] = trials.rates[j, 0]
            state_at = run.along(t, before[j])
            end = run.locate_event(t, [*points, (h, trials.states[j])], state_at)
            if end is None:
                continue
            evaluations_of_search = run.system.evaluations - evaluations_before
            run.system.evaluations = evaluations_of_step + evaluations_of_search
            run.rejected = rejected_of_step
            run.steps -= n - j
            run.last = t, before[j].copy()
            trials.count = j + 1
            rows_before_end = slice(0, int(np.searchsorted(time_in_step[rows], end)) + first_row[j])
            starts = np.array([start for start, _, _, _ in self.steps])
            times = starts[k[rows_before_end]] + time_in_step[rows_before_end]
            run.keep_all(times, between[rows_before_end])
            run.finish(t, end, state_at)
            return True
        run.detector.store_values(gaps[-1], margins[-1])
        return False


def dense_states(before: Array, lengths: Array, shares: Array, weights: Iterator[Array]) -> Array:
    """States y + h (θ w_1 + θ² w_2 + …), (m, size), at fractions θ (m,) of steps with the lengths h (m,) from y (m, size).

    ``before`` are the y, and ``weights`` the w (m, size), from the highest power down; the array of the highest power is
    overwritten. They are summed by Horner's rule.
    """
    theta = shares[:, None]
    states = next(weights)
    for w in weights:
        states *= theta
        states += w
    states *= theta * lengths[:, None]
    states += before
    return states


def run_adaptive(run: Run, stepper: Stepper) -> None:
    """Take adaptive steps, between the samples of a controller if there is one; states in between by dense output."""
    run.stepper = stepper
    y = run.begin()
    t = 0.0
    end = run.end
    spacing = run.h * run.every
    rounding = _ROUNDING_OF_TIME * end
    run.sample(t, y)
    run.system.rates(t, y, run.rate)
    run.keep(t, y)
    if isinstance(stepper.trials, TrialSteps) and run.without_callbacks:
        run_dense(run, stepper, stepper.trials)
        return
    stored_count = 1  # number of stored states
    sample_number = 0  # of the last sample of the controller
    while t < end:
        until = end
        if run.controller is not None and sample_number + 1 < run.n:
            until = (sample_number + 1) * run.h
        t1, y1 = stepper.step(t, y, run.rate, until)
        run.rejected = stepper.rejected
        rate1 = stepper.rate_after
        y1 = run.stable_state(t, t1, y1)
        if t == 0.0 and run.leaves_at_once(y, y1, t1):
            return
        first_due = stored_count
        while stored_count * spacing < t1 - rounding and stored_count * spacing < end:
            stored_count += 1
        times = np.arange(first_due, stored_count) * spacing
        between = np.zeros((0, len(y)))
        if len(times):
            between = stepper.between(times)
        points = list(zip((times - t).tolist(), between, strict=True))
        if run.detector is not None and run.end_at_event(t, y, [*points, (t1 - t, y1)], points):
            return
        run.keep_all(t + (times - t), between)
        t, y = t1, y1
        run.advance(t, y)
        is_due = abs(stored_count * spacing - t) <= rounding and t < end
        stored_count += is_due
        if run.controller is not None and t == until and t < end:
            sample_number += 1
            run.sample(t, y)
            run.system.rates(t, y, run.rate)
            if is_due:
                run.keep(t, y)
            continue
        run.rate[:] = rate1
        run.system.manifold.rates(*run.system.split(y), out=run.rate[: run.system.nq])
        if is_due:
            run.keep_at(t, y)
    run.keep_at(t, y)
