"""Compiled steps with torques, wrenches or controllers as Python callbacks, and buffers for a block of them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiler.ir.loops import Scan
from ..compiler.runtime.dispatch import Rows, bind_calls
from ..core.typing import Array
from .compiled_steps import TABLEAUS, CompiledSteps, StepPlan, stages
from .forces import ControlLaw, System


class CallbackSteps(CompiledSteps):
    """Steps of one method with callbacks for torques or wrenches; its kernel computes one stage per call."""

    @staticmethod
    def recurrence(plan: StepPlan) -> Scan:
        """Compiled loop over stages; for methods with one stage, over steps."""
        return plan.one_stage() if plan.stages > 1 else plan.recurrence()

    def __init__(self, system: System, plan: StepPlan, order: int, h: float, kernel: Any, cost: float) -> None:
        super().__init__(system, plan, order, h, kernel, cost)
        if self.stages > 1:
            tableau = TABLEAUS[plan.method]
            self.shares = list(map(float, tableau.c))  # fraction of the step at which each stage is evaluated
            self.table = np.array(stages(tableau))
        if system.tau is not None:
            self.laws.append(("tau", system.tau))
        for frame, law in system.wrenches.items():
            if law.varies:
                self.laws.append((f"wrench at {frame}", law))

    def take_stages(self, t: Any, y: Array, h: float, count: int) -> tuple[Array, Array]:
        """States (..., size) after ``count`` stages of a step from y, and accelerations (..., nv) at its start."""
        if self.stages == 1:
            states, ddq, _ = self.advance_with(y, 1, h, self._inputs_at(t, y))
            return states[..., 1, :], ddq[..., 0, :]
        s = self.system
        stage_state = y
        rate_sums = np.zeros_like(y)
        start_ddq = np.zeros(0)
        start_parts = self.parts(y[..., None, :])
        peak = 0.0  # peaks of single stages are not used
        for k, coefficients in enumerate(self.table[:count]):
            stage_inputs = self._inputs_at(t + self.shares[k] * h, stage_state)
            inputs = [value[..., None, :] for value in stage_inputs]
            next_state, next_sums = np.empty((2, *y.shape[:-1], 1, s.size))
            ddq = np.empty((*y.shape[:-1], 1, s.nv))
            reports = [ddq]
            if s.contacts:
                reports.append(np.empty((*ddq.shape[:-1], len(s.contacts))))  # gaps
            next_peak = np.empty(next_state.shape[:-1])
            out = (*self.parts(next_state), next_peak, *self.parts(next_sums), *reports)
            state_parts, sum_parts = self.parts(stage_state), self.parts(rate_sums)
            step = np.array([h])
            self.kernel(*state_parts, peak, *sum_parts, *start_parts, coefficients[None], step, *inputs, out=out)
            stage_state, rate_sums = next_state[..., 0, :], next_sums[..., 0, :]
            if k == 0:
                start_ddq = ddq[..., 0, :]
        s.evaluations += count
        return stage_state, start_ddq

    def _inputs_at(self, t: Any, y: Array) -> list[Array]:
        """Inputs of a stage, without its length h; callbacks are evaluated at the states y (..., size)."""
        s = self.system
        inputs = {"tau": s.held, **self.constants}
        for name, law in self.laws:
            q, dq = y[..., : s.nq].copy(), y[..., s.moving].copy()
            if y.ndim == 1:
                value = law(t, q, dq)
            else:
                value = law.values(np.broadcast_to(t, len(y)), q, dq)
            if name == "tau":
                value = s.held + value
            inputs[name] = value
        return [inputs[name] for name in self.names]


Evaluation = tuple[ControlLaw, Array, Array | None]
"""Function to evaluate, destination of its result, and an optional addend."""

Stage = tuple[float, int, Array, Array, list[Evaluation]]
"""Kernel call: fraction of its step, index of the call, q (nq), dq (nv), and the functions to evaluate before it."""


SHORT_BLOCK = 128  # steps: quick to prepare
LONG_BLOCK = 512  # steps: stored in fewer parts


class CallbackRows:
    """Block of m steps with n kernel calls each: states, torques, and the calls of each step."""

    def __init__(self, steps: CompiledSteps, m: int) -> None:
        s = steps.system
        self.calls_per_step = len(steps.shares)
        n = self.calls_per_step
        calls = np.arange(m * n)  # index of each call
        step_of_call = calls // n
        first_row = np.zeros(m * n, int)  # index 0 for each call: arrays with one row
        self.states = np.zeros((m * n + 1, s.size))
        """States at the start of each call, and after the last one."""
        self.ddq = np.zeros((m * n, s.nv))
        """Accelerations at the start of each call."""
        self.held = np.zeros((m, s.nv))
        """(m, nv), torques of the controller plus constant torques."""
        self._h = np.zeros(1)
        self._constants = {name: x[None].copy() for name, x in steps.constants.items()}
        inputs: dict[str, Rows] = {name: (x, first_row) for name, x in self._constants.items()}
        inputs["tau"] = self.held, step_of_call
        for name, law in steps.laws:
            inputs[name] = np.zeros((m * n, *law.shape)), calls
        self.given, _ = inputs["tau"]
        """Given torques: a row for each call, or for each step if only a controller varies them."""
        self.tau = self.given[:: len(self.given) // m]
        """(m, nv), torques at the start of each step."""
        self.peaks = np.zeros(m * n + 1)
        """Peak of each row of ``states``: see :meth:`.StepPlan._with_peak`."""
        state_inputs = [*_parts(steps, self.states, calls), (self.peaks, calls)]
        state_outputs = [*_parts(steps, self.states, calls + 1), (self.peaks, calls + 1)]
        if n > 1:
            rate_sums = np.zeros_like(self.states)
            state_inputs += _parts(steps, rate_sums, calls)
            state_outputs += _parts(steps, rate_sums, calls + 1)
            state_inputs += _parts(steps, self.states, step_of_call * n)  # at the start of the step
            state_inputs.append((steps.table, calls % n))
        named_inputs = [inputs[name] for name in steps.names]
        self.gaps = np.zeros((m * n, len(s.contacts)))
        """Gaps of the contacts at the start of each call."""
        reports: list[Rows] = [(self.ddq, calls)]
        if s.contacts:
            reports.append((self.gaps, calls))
        operands = [*state_inputs, (self._h, first_row), *named_inputs, *state_outputs, *reports]
        # positions among the operands
        first_named = len(state_inputs) + 1
        torque_operand = first_named + steps.names.index("tau")
        peak_operand = first_named + len(named_inputs) + len(steps.cuts)
        self.call = bind_calls(steps.kernel, operands, torque_operand, peak_operand)
        """Function of the index of a call, and torques if given: makes the call and returns the peak after it."""

        self._law_values = {name: inputs[name][0] for name, _ in steps.laws}
        q, dq, _ = steps.parts(self.states[:-1])
        share_of_call = steps.shares * m  # a list, repeated for each step
        # The first four entries of each Stage:
        self._calls = list(zip(share_of_call, calls.tolist(), q, dq, strict=True))
        self.sole: ControlLaw | None = None
        """The only callback, if it gives the torques of every call."""
        self.steps: list[list[Stage]] = []
        """Calls of each step."""
        self._plain_steps: list[list[Stage]] = []
        """Calls of each step without functions to evaluate; empty until they are used."""

    @classmethod
    @contextmanager
    def from_pool(
        cls, steps: CompiledSteps, controller: ControlLaw | None, constant: Array, n: int
    ) -> Iterator[CallbackRows]:
        """Rows for a run of n steps, cached with the robot for the next run because the setup is slow."""
        m = SHORT_BLOCK if n <= 2 * SHORT_BLOCK else LONG_BLOCK
        key = "callback rows", type(steps).__name__, m, *steps.plan.key, *(name for name, _ in steps.laws)
        free_rows: list[CallbackRows] = steps.system.robot.engine.cache(key, list)
        try:
            rows = free_rows.pop()
        except IndexError:  # all in use, by nested simulations or other threads
            rows = cls(steps, m)
        rows._begin(steps, controller, constant)
        yield rows
        rows.steps = rows._plain_steps  # rows in the cache keep no callbacks alive
        rows.sole = None
        free_rows.append(rows)

    def _begin(self, steps: CompiledSteps, controller: ControlLaw | None, constant: Array) -> None:
        """Set the numbers and callbacks of a run; ``constant`` are its constant torques (nv,)."""
        laws = steps.laws
        n = self.calls_per_step
        self._h[0] = steps.h
        self.held[:] = constant
        for name, x in steps.constants.items():
            self._constants[name][0] = x
        self.sole = None
        law_names = [name for name, _ in laws]
        if controller is None and law_names == ["tau"]:
            _, self.sole = laws[0]
        if controller is not None and not laws and not constant.any():
            self.sole = controller
        has_callbacks = controller is not None or bool(laws)
        if self.sole is not None or not has_callbacks:
            if not self._plain_steps:
                self._plain_steps = self._steps([[] for _ in self._calls])
            self.steps = self._plain_steps
            return
        evaluations: list[list[Evaluation]] = [[] for _ in self._calls]
        if controller is not None:
            for k, row in enumerate(self.held):
                evaluations[k * n].append((controller, row, constant))  # before the first call of step k
        for name, law in laws:
            adds_to_controller = controller is not None and name == "tau"
            for k, row in enumerate(self._law_values[name]):
                addend = self.held[k // n] if adds_to_controller else None
                evaluations[k].append((law, row, addend))
        self.steps = self._steps(evaluations)

    def _steps(self, evaluations: list[list[Evaluation]]) -> list[list[Stage]]:
        """Calls of each step with their evaluations."""
        n = self.calls_per_step
        calls = [(*call, own) for call, own in zip(self._calls, evaluations, strict=True)]
        return [calls[k : k + n] for k in range(0, len(calls), n)]


def _parts(steps: CompiledSteps, states: Array, rows: NDArray[np.intp]) -> list[Rows]:
    """Parts of states (m, size), each with ``rows``, the index of the row that each call uses."""
    return [(part, rows) for part in steps.parts(states)]
