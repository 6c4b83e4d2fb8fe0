"""Trial steps of the Dormand–Prince method, compiled or with Python callbacks.

Source: Hairer, Nørsett and Wanner, Solving Ordinary Differential Equations I, section II.4.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...compiler.ir.loops import Scan, Source
from ...compiler.ir.tracer import trace
from ...compiler.runtime.dispatch import Rows, bind_calls, can_bind_calls
from ...compiler.runtime.gufunc import owner_of
from ...core.typing import Array
from ...mechanics.algorithms.recursion import zeros
from ...robot.engine import compile_form
from ..compiled_steps import Ports, StepPlan, can_compile_steps, constants
from ..forces import WORKS, System
from .schemes import RungeKutta
from .tableaus import DORMAND_PRINCE

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
        nq, nv, works = model.nq, model.nv, len(WORKS)
        inputs = [*self.inputs, ("rtol", ()), ("atol", ())]
        ports: Ports = [("angles", (nq,)), ("q", (nq,)), ("dq", (nv,))]
        ports += [("q at start", (nq,)), ("dq at start", (nv,)), ("work at start", (works,))]
        ports += [("K", (STAGES, nq + nv + works)), ("stage", (2 * STAGES,)), *inputs]
        sources = [Source("state", k) for k in (0, 0, 1)]
        sources += [Source("start", k) for k in range(3)]
        sources += [Source("state", 3), Source("stage"), *[Source("given")] * len(inputs)]
        names = ["q", "dq", "work", "rates", "error", "judgement"]
        program = trace(self._attempt, ports, names)
        return Scan(program, tuple(sources), visible=6, table=_rows())

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
        *inputs: Any,
    ) -> tuple[Array, ...]:
        """Write the rates of a stage into K, by the first half of a row; its second half gives the next stage or the end."""
        *forces, rtol, atol = inputs
        rate = np.concatenate(self._rates(angles, angles, dq, forces)[0])
        here, ahead = row[:STAGES], row[STAGES:]
        K = np.array([K[0]] + [K[i] + here[i] * (rate - K[i]) for i in range(1, STAGES)], object)
        y = np.concatenate([q0, dq0, work0])
        y1 = y + h * (ahead @ K)
        nq, nv = self.model.nq, self.model.nv
        error, statistics = judgement(slice(nq, nq + nv), y, y1, K, h, rtol, atol)
        return y1[:nq], y1[nq : nq + nv], y1[nq + nv :], K, error, statistics


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
    motion = slice(0, moving.stop)
    a, _, _, weights, _ = DORMAND_PRINCE.numbers
    error = h * (weights @ K)
    largest = np.array([abs(x).clip(abs(x1), np.inf) for x, x1 in zip(y, y1, strict=True)], object)
    relative_error = (error / (atol + rtol * largest))[motion]
    rate_change = (K[-1] - K[-2])[motion]
    distance = (y1 - y - h * (a[-2][: STAGES - 2] @ K[:-2]))[motion]
    statistics = zeros(4)
    statistics[:] = (
        (relative_error @ relative_error) * (1.0 / moving.stop),
        h * h * (rate_change @ rate_change),
        distance @ distance,
        y1[moving] @ y1[moving],
    )
    return error, statistics


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
        self._tau = np.zeros((1, system.nv))
        self._held: Array | None = None
        """Torques of the controller that stand in the inputs."""
        only_row, rows = np.zeros(m, int), np.arange(m)
        cuts = slice(0, system.nq), system.moving, slice(system.nq + system.nv, size)
        before = [(self._y[:, cut], only_row) for cut in cuts]
        after = [(self.states[:, cut], rows) for cut in cuts]
        statistics = [(self.errors, rows), (self.judgements, rows)]
        values = {"tau": self._tau}
        for name, x in constants(system, plan).items():
            values[name] = x[None]
        named = [(values[name], only_row) for name, _ in plan.inputs[1:]]
        limits = [(np.array([x]), only_row) for x in tolerances]
        inputs: list[Rows] = [*before, (self._K, only_row), *statistics, (self._h, only_row), *named, *limits]
        outputs: list[Rows] = [*after, (self.rates, rows), *statistics]
        self._call = _row_caller(kernel, inputs, outputs, list(dict(plan.inputs)).index("tau") + 6)

    @classmethod
    def build(cls, system: System, tolerances: tuple[float, float]) -> TrialSteps | None:
        """Trial steps; None if there are callbacks or contacts, or compilation is impossible."""
        if system.functions or not can_compile_steps(system):
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
        if self.full:
            self.restart()
        s, k = self.system, self.count
        if self._held is not s.held:
            self._held = s.held
            self._tau[0] = s.held
        self._y[0], self._K[0, 0], self._h[0] = y, rate, h
        self._call(k)
        s.evaluations += self.plan.stages
        squared_error, squared_steepness, squared_distance, squared_speed = self.judgements[k].tolist()
        return math.sqrt(squared_error), math.sqrt(squared_steepness), math.sqrt(squared_distance), squared_speed

    @property
    def full(self) -> bool:
        """True if there is no row for another step."""
        return self.count == len(self.states)

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


def _row_caller(kernel: Any, inputs: list[Rows], outputs: list[Rows], tau: int) -> Callable[[int], Any]:
    """Function that makes call k of a kernel, from and to rows of arrays."""
    if can_bind_calls(kernel):
        return bind_calls(kernel, [*inputs, *outputs], tau, len(inputs) + len(outputs) - 1)

    def call(k: int) -> None:
        *states, length = [x[rows[k]] for x, rows in inputs[:7]]
        values = [x[rows[k]][None] for x, rows in inputs[7:]]
        results = [x[rows[k]][None] for x, rows in outputs]
        kernel(*states, length[None], *values, out=tuple(results))

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
        scheme, motion, (rtol, atol) = self.scheme, slice(0, self.system.size - len(WORKS)), self.tolerances
        y1 = scheme.step(t, y, h, rate)
        K = scheme.K.copy()
        error = h * np.dot(scheme.error, K)
        self.states, self.rates, self.errors = y1[None], K[None], error[None]
        relative_error = error / (atol + rtol * np.maximum(np.abs(y), np.abs(y1)))
        z = y + h * np.dot(scheme.a[-2], K[:-2])
        error_norm = float(np.sqrt(np.mean(np.square(relative_error[motion]))))
        steepness = h * float(np.linalg.norm((K[-1] - K[-2])[motion]))
        return error_norm, steepness, float(np.linalg.norm((y1 - z)[motion])), np.nan

    def accept(self) -> None:
        """Add the error of the last trial step."""
        self.total += np.abs(self.errors[0])
