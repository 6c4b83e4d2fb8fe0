"""Adaptive Dormand–Prince steps: trial steps, step control, dense output, and detection of stiffness.

Source: Hairer, Nørsett and Wanner, Solving Ordinary Differential Equations I, section II.4.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..compiler.ir.loops import Scan, Source
from ..compiler.ir.tracer import trace
from ..compiler.runtime.dispatch import Rows, bind_calls, can_bind_calls
from ..compiler.runtime.gufunc import owner_of
from ..core.errors import SimulationError
from ..core.numbers import printed, residual
from ..core.text import argument
from ..core.typing import Array
from ..mechanics.algorithms.recursion import zeros
from ..robot.engine import compile_form
from .accuracy import ForceQuadrature
from .callback_steps import FASTEST
from .compiled_steps import Ports, StepPlan, acts_by_itself, constants
from .forces import WORKS, System
from .schemes import DORMAND_PRINCE, RungeKutta

if TYPE_CHECKING:
    from .run import Run

STAGES = len(DORMAND_PRINCE.b)


@dataclass(frozen=True)
class TrialStep(StepPlan):
    """Trial step of the Dormand–Prince method, without normalisation of quaternions."""

    @property
    def stages(self) -> int:
        """Evaluations of forward dynamics, except the first stage, whose rates are inputs."""
        return STAGES - 1

    def recurrence(self) -> Scan:
        """Loop with the states q, dq, W, the rates (7, size) of the stages, error (size,) and step statistics (4,).

        Of the rates, only the first are inputs; error and statistics are outputs only. The tolerances follow the step's
        length and the other inputs.
        """
        model = self.model
        shapes = [(model.nq,), (model.nv,), (len(WORKS),)]
        size = model.nq + model.nv + len(WORKS)
        state: Ports = [("angles", shapes[0]), ("q", shapes[0]), ("dq", shapes[1])]
        starts: Ports = list(zip(("q at start", "dq at start", "work at start"), shapes, strict=True))
        rest: Ports = [*starts, ("K", (STAGES, size)), ("stage", (2 * STAGES,))]
        given = [*self.given, ("rtol", ()), ("atol", ())]
        fed = [Source("state", k) for k in (0, 0, 1)] + [Source("start", k) for k in range(3)]
        fed += [Source("state", 3), Source("stage")]
        names = ["q", "dq", "work", "rates", "error", "judgement"]
        program = trace(self._attempt, [*state, *rest, *given], names)
        return Scan(program, (*fed, *[Source("given")] * len(given)), visible=6, table=_rows())

    def _attempt(
        self,
        angles: Array,
        _q: Array,
        dq: Array,
        q0: Array,
        dq0: Array,
        work0: Array,
        K: Array,
        row: Array,
        h: Any,
        *given: Any,
    ) -> tuple[Array, ...]:
        """Write the rates of a stage into K, by the first half of a row; its second half gives the next stage or the end."""
        *acting, rtol, atol = given
        rate = np.concatenate(self._rates(angles, angles, dq, acting)[0])
        here, ahead = row[:STAGES], row[STAGES:]
        K = np.array([K[0]] + [K[i] + here[i] * (rate - K[i]) for i in range(1, STAGES)], object)
        y = np.concatenate([q0, dq0, work0])
        y1 = y + h * (ahead @ K)
        nq, nv = self.model.nq, self.model.nv
        judged = judgement(slice(nq, nq + nv), y, y1, K, h, rtol, atol)
        return y1[:nq], y1[nq : nq + nv], y1[nq + nv :], K, *judged


def _rows() -> tuple[tuple[float, ...], ...]:
    """For each stage the index of its rate and the weights of the next stage; the last row is the end of the step."""
    a, b, *_ = DORMAND_PRINCE.numbers
    rows = []
    for i in range(STAGES):
        here, ahead = np.zeros(STAGES), np.zeros(STAGES)
        here[i] = float(i > 0)
        if i + 1 < STAGES:
            ahead[: i + 1] = a[i + 1][: i + 1]
        else:
            ahead[:] = b
        rows.append((*map(float, here), *map(float, ahead)))
    return tuple(rows)


def judgement(moving: slice, y: Array, y1: Array, K: Array, h: Any, rtol: Any, atol: Any) -> tuple[Array, Array]:
    """Error (size,) of a step from y to y1, and squared norm, steepness, distance and speed (4,)."""
    mine = slice(0, moving.stop)
    a, _, _, weights, _ = DORMAND_PRINCE.numbers
    error = h * (weights @ K)
    largest = np.array([abs(x).clip(abs(x1), np.inf) for x, x1 in zip(y, y1, strict=True)], object)
    share = (error / (atol + rtol * largest))[mine]
    steep = (K[-1] - K[-2])[mine]
    away = (y1 - y - h * (a[-2][: STAGES - 2] @ K[:-2]))[mine]
    found = zeros(4)
    found[:] = (share @ share) * (1.0 / moving.stop), h * h * (steep @ steep), away @ away, y1[moving] @ y1[moving]
    return error, found


# ── Compiled trial steps

ROWS = 256
"""Number of rows in the buffer; accepted steps stay there until their dense output is evaluated."""


class TrialSteps:
    """Steps of any length under the constant torques and wrenches of a system, and buffers for their results.

    Rows before :attr:`count` are accepted steps; the next row is the last trial step.
    """

    def __init__(self, system: System, plan: TrialStep, kernel: Any, tolerances: tuple[float, float]) -> None:
        self.system, self.plan, self.count = system, plan, 0
        self._total = np.zeros(system.size)
        m, size = ROWS, system.size
        self.states, self.rates = np.zeros((m, size)), np.zeros((m, STAGES, size))
        self.errors, self.judgements = np.zeros((m, size)), np.zeros((m, 4))
        """(m, size), (m, 7, size), (m, size), (m, 4): states after the steps, rates of the stages, errors and statistics."""
        self._y, self._K, self._h = np.zeros((1, size)), np.zeros((1, STAGES, size)), np.zeros(1)
        self._given = {"tau": np.zeros((1, system.nv)), **{k: x[None] for k, x in constants(system, plan).items()}}
        self._held: Array | None = None
        one, own = np.zeros(m, int), np.arange(m)
        cuts = slice(0, system.nq), system.moving, slice(system.nq + system.nv, size)
        states, after = ([(x[:, cut], which) for cut in cuts] for x, which in ((self._y, one), (self.states, own)))
        judged = [(self.errors, own), (self.judgements, own)]
        named = [(self._given[name], one) for name, _ in plan.given[1:]]
        limits = [(np.array([x]), one) for x in tolerances]
        inputs: list[Rows] = [*states, (self._K, one), *judged, (self._h, one), *named, *limits]
        outputs: list[Rows] = [*after, (self.rates, own), *judged]
        self._call = _calls(kernel, inputs, outputs, [name for name, _ in plan.given].index("tau") + 6)

    @classmethod
    def build(cls, system: System, tolerances: tuple[float, float]) -> TrialSteps | None:
        """Trial steps; None if there are callbacks or contacts, or compilation is impossible."""
        if system.functions or not acts_by_itself(system):
            return None
        robot, plan = system.robot, TrialStep.from_system(system, "dopri5")

        def build() -> Any:
            robot.engine.require_invertible()
            doc = f"Steps of {robot.name}, compiled: dopri5."
            return compile_form(plan.recurrence(), "attempted step", doc, scalar=True)

        kernel = robot.engine.cache(plan.key, build)
        return None if owner_of(kernel) is None else cls(system, plan, kernel, tolerances)

    def attempt(self, _t: float, y: Array, rate: Array, h: float) -> tuple[float, float, float, float]:
        """Try a step from a state and its rates (size,): norm of its error, steepness, distance, and squared speed."""
        if self.count == ROWS:
            self.restart()
        s, k = self.system, self.count
        if self._held is not s.held:
            self._held = s.held
            self._given["tau"][0] = s.held
        self._y[0], self._K[0, 0], self._h[0] = y, rate, h
        self._call(k)
        s.evaluations += self.plan.stages
        square, steep, away, speed = self.judgements[k].tolist()
        return math.sqrt(square), math.sqrt(steep), math.sqrt(away), speed

    def accept(self) -> None:
        """Accept the last trial step."""
        self.count += 1

    def restart(self) -> None:
        """Reuse the rows of the accepted steps."""
        self._total = self.total
        self.count = 0

    @property
    def total(self) -> Array:
        """Sum of the estimated errors of all accepted steps (size,)."""
        return np.asarray(self._total + np.abs(self.errors[: self.count]).sum(axis=0))


def _calls(kernel: Any, inputs: list[Rows], outputs: list[Rows], tau: int) -> Callable[[int], Any]:
    """Function that makes call k of a kernel, from and to rows of arrays."""
    if can_bind_calls(kernel):
        return bind_calls(kernel, [*inputs, *outputs], tau, len(inputs) + len(outputs) - 1)

    def call(k: int) -> None:
        *states, lengths = (x[which[k]] for x, which in inputs[:7])
        given = (x[which[k]][None] for x, which in inputs[7:])
        kernel(*states, lengths[None], *given, out=tuple(x[which[k]][None] for x, which in outputs))

    return call


class FunctionTrials:
    """Trial steps in Python with torque or wrench callbacks; one row of each buffer of :class:`TrialSteps`."""

    count = 0

    def __init__(self, system: System, scheme: RungeKutta, tolerances: tuple[float, float]) -> None:
        self.system, self.scheme, self.tolerances = system, scheme, tolerances
        self.total = np.zeros(system.size)
        self.states = self.rates = self.errors = np.zeros((1, system.size))

    def attempt(self, t: float, y: Array, rate: Array, h: float) -> tuple[float, float, float, float]:
        """Try a step from a state and its rates (size,): norm of its error, steepness, distance; the speed is unknown."""
        scheme, mine, (rtol, atol) = self.scheme, slice(0, self.system.size - len(WORKS)), self.tolerances
        y1 = scheme.step(t, y, h, rate)
        K = scheme.K.copy()
        error = h * np.dot(scheme.error, K)
        self.states, self.rates, self.errors = y1[None], K[None], error[None]
        share = error / (atol + rtol * np.maximum(np.abs(y), np.abs(y1)))
        z = y + h * np.dot(scheme.a[-2], K[:-2])
        steep, away = h * float(np.linalg.norm((K[-1] - K[-2])[mine])), float(np.linalg.norm((y1 - z)[mine]))
        return float(np.sqrt(np.mean(np.square(share[mine])))), steep, away, np.nan

    def accept(self) -> None:
        """Add the error of the last trial step."""
        self.total += np.abs(self.errors[0])


# ── Stiffness

# The last two stages of the Dormand–Prince method are at the end of the step, at two states z and y1. The difference of
# their rates divided by the difference of the states estimates the largest eigenvalue λ; the method is stable up to h λ
# ≈ 3.3. Source: Hairer and Wanner, Solving Ordinary Differential Equations II, section IV.2.

_EDGE = 3.25
"""Value of h λ above which stability limits the step."""
_WINDOW = 3000
"""Number of trial steps between two checks of the progress: a few seconds."""
_STIFF_SHARE = 0.1
"""Fraction of steps limited by stability above which the equations count as stiff."""
_MOST_TO_COME = 100_000
"""Estimated number of remaining steps above which a stiff run is ended: more than a minute."""


class Stiffness:
    """Trial steps since the last check, and the number limited by stability."""

    def __init__(self, system: System, trials: TrialSteps | FunctionTrials, duration: float) -> None:
        self.system, self.trials, self.duration = system, trials, duration
        self._tried = self._at_edge = 0
        self._begin = 0.0

    def note(self, t: float, h: float, steep: float, away: float) -> None:
        """Record two states at a distance of ``away``, whose rates differ by ``steep`` / h."""
        self._tried += 1
        self._at_edge += steep > _EDGE * away > 0.0
        if self._tried < _WINDOW:
            return
        mean = (t - self._begin) / self._tried
        if self._at_edge > _STIFF_SHARE * self._tried and self.duration - t > _MOST_TO_COME * mean:
            K = self.trials.rates[self.trials.count]
            raise SimulationError(self._words(t, h, mean, (K[-1] - K[-2])[self.system.moving]))
        self._tried, self._at_edge, self._begin = 0, 0, t

    def _words(self, t: float, h: float, mean: float, change: Array) -> str:
        names, friction = self.system.robot.model.velocity_names, self.system.friction
        worst = int(np.argmax(np.abs(change)))
        often = f"some {printed((self.duration - t) / mean, 1)}" if mean > 0.0 else "endlessly many"
        stiff = f"at t = {printed(t)} s the equations are stiff"
        said = f"{stiff}: stability needs steps of {residual(h)} s, {often} more to the end"
        if friction is not None and friction.dry[worst]:
            return (
                f"{said}. Dry friction of joint {names[worst]!r} is eased off below {printed(friction.creep[worst], 2)} "
                "rad/s or m/s, "
                f"which is steep for so light a joint. Take {argument('method', 'semi_implicit')}, in whose "
                "steps friction stops joints and "
                "holds them; or, in Python, a larger creep=."
            )
        return (
            f"{said}, most of all in joint {names[worst]!r}: a torque, a wrench or a contact there is steep for so light a "
            f"joint. Take less gain or stiffness, or {argument('method', 'semi_implicit')}, which takes "
            "viscous friction, and the kd of a "
            "tw.control.PD given as tau=, at the end of its steps."
        )


# ── Step-size control. Hairer, Nørsett and Wanner, volume I, section II.4

_SAFETY, _SHRINK, _GROW = 0.9, 0.2, 5.0


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
        h = min(self.h or self._first(y, rate, until - t), self.longest)
        grow = _GROW
        while True:
            t1 = until if t + 1.01 * h >= until else t + h
            step = t1 - t
            size, steep, away, self.speed = trials.attempt(t, y, rate, step)
            self.stiffness.note(t, step, steep, away)
            y1, K = trials.states[trials.count], trials.rates[trials.count]
            if size <= 1.0 and self.system.functions:
                size = max(size, self._unseen(t, step, y, y1, K))
            if size <= 1.0:
                factor = min(grow, max(_SHRINK, _SAFETY * size**self.power)) if size > 0 else grow
                if step >= 0.99 * h or factor < 1.0:  # a step cut short by `until` does not predict the next one
                    self.h = step * factor
                trials.accept()
                self.rate_after = K[-1]
                self.last = (t, step, y, K)
                return t1, y1
            self.rejected += 1
            grow = 1.0
            h = step * (max(_SHRINK, _SAFETY * size**self.power) if np.isfinite(size) else 0.1)
            if h < 1e-14 * max(t, 1e-3):
                bad = np.abs(trials.errors[trials.count] / self._allowed(y, y1))[self.system.moving]
                worst = int(np.argmax(np.where(np.isfinite(bad), bad, np.inf)))
                raise SimulationError(
                    f"at t = {printed(t, 9)} s steps shrink below {residual(h)} s and still miss the tolerance, most of "
                    f"all in joint {self.system.robot.model.velocity_names[worst]!r}: a force there jumps, or grows "
                    "without bound. Make it continuous, or take a method of fixed steps."
                )

    def between(self, times: Array) -> Array:
        """States (m, size) at times (m,) within the last step, by dense output."""
        t0, h, y0, K = self.last
        y = y0 + h * _dense(((times - t0) / h)[:, None], self.scheme.dense.T @ K)
        for one in y:
            self.system.manifold.normalise(one[: self.system.nq])
        return y

    def _allowed(self, y: Array, y1: Array) -> Array:
        return self.atol + self.rtol * np.maximum(np.abs(y), np.abs(y1))

    def judged(self, spans: Array) -> Array:
        """Estimated error of all steps with order 4, (nv,) [rad or m]; velocity errors times ``spans`` (nv) [s]."""
        off = self.trials.total
        return np.asarray(self.system.manifold.errors(off[: self.system.nq]) + spans * off[self.system.moving])

    def _unseen(self, t: float, h: float, y: Array, y1: Array, K: Array) -> float:
        """Impulse of callbacks between the stages of a step, as a change of velocity relative to the tolerance."""
        Q = self.scheme.dense.T @ K
        missing = self.probes.impulses(t, h, lambda shares: y + h * _dense(shares[:, None], Q))
        if not missing.any():
            return 0.0
        change = self.probes.change(*self.system.split(y), missing)
        return float(np.sqrt(np.mean(np.square(change / self._allowed(y, y1)[self.system.moving]))))

    def _first(self, y: Array, rate: Array, span: float) -> float:
        """Initial step in which linear extrapolation changes the state by 1 %; 1e-6 s if the state or its rate is tiny."""
        scale = self.atol + self.rtol * np.abs(y)
        judged = slice(0, self.system.size - len(WORKS))
        d0, d1 = (float(np.sqrt(np.mean(np.square((x / scale)[judged])))) for x in (y, rate))
        h = 1e-6 if min(d0, d1) < 1e-5 or not np.isfinite(d1) else 0.01 * d0 / d1
        return min(h, span, self.longest)


def _dense(share: Any, Q: Array) -> Array:
    """Mean rate (..., size) from the start of a step to a fraction (..., 1) of it, times the fraction."""
    return np.asarray(share ** np.arange(1, len(Q) + 1) @ Q)


# ── Steps without observers: dense output in one batch

_NUMBERS = 2_000_000
"""Largest number of entries of the states evaluated at once."""


def run_dense(run: Run, stepper: Stepper, trials: TrialSteps) -> None:
    """Take the steps of a run from its stored first state to its end, to a limit, or to a failure."""
    system, end = run.system, run.end
    (t, y), rate = run.last, run.rate.copy()
    waiting = _Waiting(run, stepper, trials)
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
            if trials.count == ROWS or waiting.many:
                if waiting.keep():
                    return
                trials.restart()
    except (SimulationError, KeyboardInterrupt) as problem:
        if waiting.keep() and isinstance(problem, SimulationError):  # the run ended before the failure
            return
        raise
    if not waiting.keep():
        run.keep_all(np.array([t]), y[None])


class _Waiting:
    """Accepted steps whose dense output is not yet stored and checked; their rows are those of the trials."""

    def __init__(self, run: Run, stepper: Stepper, trials: TrialSteps) -> None:
        self.run, self.trials, self.dense, self.kept = run, trials, stepper.scheme.dense, 1
        """Number of stored states."""
        self.steps: list[tuple[float, float, int, int]] = []
        """Start time and length of each step [s]; evaluations and rejected steps up to its end."""
        self.first = run.last[1].copy()
        """State at the start of the first step."""
        self._most = max(1, _NUMBERS // (5 * run.system.size))
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
        most = self._most if run.detector is None else run.n  # nothing is stored before all is checked
        while True:
            due = np.arange(self.kept, min(self.kept + most, int(t1[-1] / spacing) + 2)) * spacing
            due = due[(due < t1[-1] - near) & (due < run.end)]
            if not len(due) and run.detector is None:
                break
            k = np.searchsorted(t1 - near, due, side="right")
            since = due - t0[k]
            since[np.abs(since) <= near] = 0.0
            states = dense_states(before[k], lengths[k], since / lengths[k], (weights[k] for weights in Q[::-1]))
            for mine in system.robot.model.quaternions:
                states[:, mine] /= np.linalg.norm(states[:, mine], axis=1, keepdims=True)
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
        passed, gaps, margins = run.detector.passed(np.concatenate([between, trials.states[:n]])[order])
        evaluations = run.system.evaluations
        for j in np.unique(owners[order][passed]).tolist():
            (t, h, _, _), mine, after = self.steps[j], slice(first[j], first[j + 1]), trials.states[j]
            run.detector.stand(gaps[first[j] + j], margins[first[j] + j])
            points = list(zip(since[mine].tolist(), between[mine], strict=True))
            run.rate[:] = trials.rates[j, 0]
            at = run.along(t, before[j])
            end = run.locate_event(t, [*points, (h, after)], at)
            if end is None:
                continue
            looked = run.system.evaluations - evaluations
            run.system.evaluations, run.rejected = self.steps[j][2] + looked, self.steps[j][3]
            run.steps, run.last, trials.count = run.steps - (n - j), (t, before[j].copy()), j + 1
            kept = int(np.searchsorted(since[mine], end)) + first[j]
            some = slice(0, kept)
            times = np.array([step[0] for step in self.steps])[k[some]] + since[some]
            run.keep_all(times, between[some])
            run.finish(t, end, at)
            return True
        run.detector.stand(gaps[-1], margins[-1])
        return False


def dense_states(before: Array, lengths: Array, shares: Array, weights: Iterator[Array]) -> Array:
    """y + h (θ w1 + θ² w2 + …), (m, size), at fractions θ (m,) of steps h (m,) from y (m, size); weights in falling powers."""
    found, shares = next(weights), shares[:, None]
    for w in weights:
        found *= shares
        found += w
    found *= shares * lengths[:, None]
    found += before
    return found


# ── Steps between controller samples, each with dense output


def run_adaptive(run: Run, stepper: Stepper) -> None:
    """Take adaptive steps, between the samples of a controller if there is one; states in between by dense output."""
    run.stepper = stepper
    y = run.begin()
    t, k, spacing = 0.0, 0, run.h * run.every
    end = run.end
    run.sample(t, y)
    run.system.rates(t, y, run.rate)
    run.keep(t, y)
    if isinstance(stepper.trials, TrialSteps) and run.without_callbacks:
        run_dense(run, stepper, stepper.trials)
        return
    kept = 1
    while t < end:
        until = (k + 1) * run.h if run.controller is not None and k + 1 < run.n else end
        t1, y1 = stepper.step(t, y, run.rate, until)
        run.rejected, rate1 = stepper.rejected, stepper.rate_after
        y1 = run.checked(t, t1, y1)
        if t == 0.0 and run.leaves_at_once(y, y1, t1):
            return
        begin = kept
        while kept * spacing < t1 - 1e-12 * end and kept * spacing < end:
            kept += 1
        times = np.arange(begin, kept) * spacing
        between = stepper.between(times) if len(times) else np.zeros((0, len(y)))
        points = list(zip((times - t).tolist(), between, strict=True))
        if run.detector is not None and run.ended(t, y, [*points, (t1 - t, y1)], points):
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
