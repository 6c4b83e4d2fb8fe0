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
"""Number of stages of a step."""


@dataclass(frozen=True)
class TrialStep(StepPlan):
    """Trial step of the Dormand–Prince method, without normalisation of quaternions."""

    @property
    def stages(self) -> int:
        """Number of evaluations of forward dynamics; the first stage needs none, since its rates are inputs."""
        return STAGES - 1

    def recurrence(self) -> Scan:
        """Loop over the stages, with the states q, dq, W, the rates (7, size), error (size,) and statistics (4,) of a step.

        The rates of the first stage are inputs; error and statistics are outputs only. The inputs are the step's length,
        the inputs of the plan, and the tolerances.
        """
        model = self.model
        nq, nv = model.nq, model.nv
        works = len(WORKS)
        inputs = [*self.inputs, ("rtol", ()), ("atol", ())]
        ports: Ports = [("angles", (nq,)), ("q", (nq,)), ("dq", (nv,))]
        ports += [("q at start", (nq,)), ("dq at start", (nv,)), ("work at start", (works,))]
        ports += [("K", (STAGES, nq + nv + works)), ("stage", (2 * STAGES,)), *inputs]
        sources = [Source("state", k) for k in (0, 0, 1)]  # angles are q, too
        sources += [Source("start", k) for k in range(3)]
        sources += [Source("state", 3), Source("stage"), *[Source("given")] * len(inputs)]
        names = ["q", "dq", "work", "rates", "error", "judgement"]
        program = trace(self._attempt, ports, names)
        return Scan(program, tuple(sources), visible=len(names), table=_stage_table())

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
        """Write the rates of a stage into K, and take the step to the next stage or to the end.

        The first half of ``row`` is 1 at the stage; the second half has the weights of the step.
        """
        *forces, rtol, atol = inputs
        rates, _, _ = self._rates(angles, angles, dq, forces)
        rate = np.concatenate(rates)
        is_stage, weights = row[:STAGES], row[STAGES:]
        later_rates = [K[i] + is_stage[i] * (rate - K[i]) for i in range(1, STAGES)]
        K = np.array([K[0], *later_rates], object)
        y = np.concatenate([q0, dq0, work0])
        y1 = y + h * (weights @ K)
        nq, nv = self.model.nq, self.model.nv
        moving = slice(nq, nq + nv)
        error, statistics = error_and_statistics(moving, y, y1, K, h, rtol, atol)
        return y1[:nq], y1[nq : nq + nv], y1[nq + nv :], K, error, statistics


def _stage_table() -> tuple[tuple[float, ...], ...]:
    """Row of each stage: 1 at its own place, then the weights of the next stage, or of the step after the last stage.

    The first stage has no 1, since its rates are inputs.
    """
    a, b, *_ = DORMAND_PRINCE.numbers
    rows = []
    for i in range(STAGES):
        is_stage = np.zeros(STAGES)
        weights = np.zeros(STAGES)
        if i > 0:
            is_stage[i] = 1.0
        if i + 1 < STAGES:
            weights[: i + 1] = a[i + 1][: i + 1]
        else:
            weights[:] = b
        rows.append((*map(float, is_stage), *map(float, weights)))
    return tuple(rows)


def error_and_statistics(
    moving: slice, y: Array, y1: Array, K: Array, h: Any, rtol: Any, atol: Any
) -> tuple[Array, Array]:
    """Error (size,) of a step from y to y1, and squares of its norm, of steepness, distance and speed (4,).

    Steepness is h |k_7 - k_6|. Distance is between the states of the last two stages. Both are without works.
    """
    motion = slice(0, moving.stop)
    a, _, _, weights, _ = DORMAND_PRINCE.numbers
    error = h * (weights @ K)
    larger_magnitudes = [abs(x).clip(abs(x1), np.inf) for x, x1 in zip(y, y1, strict=True)]  # of both ends
    larger_state = np.array(larger_magnitudes, object)
    relative_error = (error / (atol + rtol * larger_state))[motion]
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


BUFFER_ROWS = 256
"""Number of rows in a buffer; accepted steps stay there until their dense output is evaluated."""


class TrialSteps:
    """Steps of any length under the constant torques and wrenches of a system, and buffers for their results.

    Rows before :attr:`count` are accepted steps; the next row is the last trial step.
    """

    def __init__(self, system: System, plan: TrialStep, kernel: Any, tolerances: tuple[float, float]) -> None:
        self.system = system
        self.plan = plan
        self.count = 0
        """Number of accepted steps in the buffers."""
        self._total = np.zeros(system.size)
        """Sum of the errors of accepted steps that have left the buffers."""
        m, size = BUFFER_ROWS, system.size
        self.states = np.zeros((m, size))
        """States after the steps."""
        self.rates = np.zeros((m, STAGES, size))
        """Rates of the stages."""
        self.errors = np.zeros((m, size))
        self.statistics = np.zeros((m, 4))
        self._y = np.zeros((1, size))
        self._K = np.zeros((1, STAGES, size))
        self._h = np.zeros(1)
        self._tau = np.zeros((1, system.nv))
        self._held: Array | None = None
        """Torques of the controller that stand in the inputs."""
        # An input or output is an array and its row for each call k: always row 0, or row k.
        first_row = np.zeros(m, int)
        own_row = np.arange(m)
        works = slice(system.nq + system.nv, size)
        parts_of_state = (slice(0, system.nq), system.moving, works)
        rows_before = [(self._y[:, part], first_row) for part in parts_of_state]
        rows_after = [(self.states[:, part], own_row) for part in parts_of_state]
        error_rows = [(self.errors, own_row), (self.statistics, own_row)]
        values = {"tau": self._tau}
        for name, constant in constants(system, plan).items():
            values[name] = constant[None]
        plan_inputs = [(values[name], first_row) for name, _ in plan.inputs[1:]]
        tolerance_inputs = [(np.array([tolerance]), first_row) for tolerance in tolerances]
        inputs: list[Rows] = [*rows_before, (self._K, first_row), *error_rows, (self._h, first_row)]
        plan_input_names = [name for name, _ in plan.inputs]
        first_plan_input = len(inputs) - 1  # the length of the step, which is the first input of the plan
        tau_input = first_plan_input + plan_input_names.index("tau")
        inputs += [*plan_inputs, *tolerance_inputs]
        outputs: list[Rows] = [*rows_after, (self.rates, own_row), *error_rows]
        self._call = _row_caller(kernel, inputs, outputs, tau_input)

    @classmethod
    def build(cls, system: System, tolerances: tuple[float, float]) -> TrialSteps | None:
        """Trial steps; None if there are callbacks or contacts, or compilation is impossible."""
        if system.functions or not can_compile_steps(system):
            return None
        robot = system.robot
        plan = TrialStep.from_system(system, "dopri5")

        def build() -> Any:
            robot.engine.require_invertible()
            doc = f"Steps of {robot.name}, compiled: dopri5."
            return compile_form(plan.recurrence(), "attempted step", doc, scalar=True)

        kernel = robot.engine.cache(plan.key, build)
        if owner_of(kernel) is None:
            return None
        return cls(system, plan, kernel, tolerances)

    def attempt(self, _t: float, y: Array, rate: Array, h: float) -> tuple[float, float, float, float]:
        """Try a step from a state and its rates (size,); returns norm of the error, steepness, distance and squared speed."""
        if self.full:
            self.restart()
        s = self.system
        k = self.count
        if self._held is not s.held:
            self._held = s.held
            self._tau[0] = s.held
        self._y[0] = y
        self._K[0, 0] = rate
        self._h[0] = h
        self._call(k)
        s.evaluations += self.plan.stages
        squared_error, squared_steepness, squared_distance, squared_speed = self.statistics[k].tolist()
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


_STATE_INPUTS = 7
"""Number of the first inputs: three parts of the state, K, error, statistics and length."""


def _row_caller(kernel: Any, inputs: list[Rows], outputs: list[Rows], tau_input: int) -> Callable[[int], Any]:
    """Function that makes call k of a kernel, from and to rows of arrays; ``tau_input`` is the index of the torques."""
    if can_bind_calls(kernel):
        return bind_calls(kernel, [*inputs, *outputs], tau_input, len(inputs) + len(outputs) - 1)

    def call(k: int) -> None:
        *states, length = [x[rows[k]] for x, rows in inputs[:_STATE_INPUTS]]
        values = [x[rows[k]][None] for x, rows in inputs[_STATE_INPUTS:]]
        results = [x[rows[k]][None] for x, rows in outputs]
        kernel(*states, length[None], *values, out=tuple(results))

    return call


class FunctionTrials:
    """Trial steps in Python with torque or wrench callbacks; one row of each buffer of :class:`TrialSteps`."""

    count = 0

    def __init__(self, system: System, scheme: RungeKutta, tolerances: tuple[float, float]) -> None:
        self.system = system
        self.scheme = scheme
        self.tolerances = tolerances
        self.total = np.zeros(system.size)
        no_row = np.zeros((1, system.size))  # replaced by the first attempt
        self.states = no_row
        self.rates = no_row
        self.errors = no_row

    def attempt(self, t: float, y: Array, rate: Array, h: float) -> tuple[float, float, float, float]:
        """Try a step from a state and its rates (size,); returns norm of the error, steepness, distance and NaN."""
        scheme = self.scheme
        motion = slice(0, self.system.size - len(WORKS))
        rtol, atol = self.tolerances
        y1 = scheme.step(t, y, h, rate)
        K = scheme.K.copy()
        error = h * np.dot(scheme.error, K)
        self.states = y1[None]
        self.rates = K[None]
        self.errors = error[None]
        relative_error = error / (atol + rtol * np.maximum(np.abs(y), np.abs(y1)))
        y_of_stage_before = y + h * np.dot(scheme.a[-2], K[:-2])
        error_norm = float(np.sqrt(np.mean(np.square(relative_error[motion]))))
        steepness = h * float(np.linalg.norm((K[-1] - K[-2])[motion]))
        distance = float(np.linalg.norm((y1 - y_of_stage_before)[motion]))
        return error_norm, steepness, distance, np.nan

    def accept(self) -> None:
        """Add the error of the last trial step."""
        self.total += np.abs(self.errors[0])
