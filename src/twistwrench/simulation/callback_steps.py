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
            self.shares, self.table = list(map(float, tableau.c)), np.array(stages(tableau))
        if system.tau is not None:
            self.laws.append(("tau", system.tau))
        self.laws += [(f"wrench at {frame}", law) for frame, law in system.wrenches.items() if law.varies]

    def take_stages(self, t: Any, y: Array, h: float, count: int) -> tuple[Array, Array]:
        """States after ``count`` stages of a step, and accelerations at its start."""
        if self.stages == 1:
            states, ddq, _ = self.advance_with(y, 1, h, self._inputs_at(t, y))
            return states[..., 1, :], ddq[..., 0, :]
        s = self.system
        x, sums, accelerations = y, np.zeros_like(y), np.zeros(0)
        start = self.parts(y[..., None, :])
        for k, row in enumerate(self.table[:count]):
            inputs = [number[..., None, :] for number in self._inputs_at(t + self.shares[k] * h, x)]
            after, summed = np.empty((2, *y.shape[:-1], 1, s.size))
            ddq = np.empty((*y.shape[:-1], 1, s.nv))
            reports = [ddq]
            if s.contacts:
                reports.append(np.empty((*ddq.shape[:-1], len(s.contacts))))
            out = (*self.parts(after), np.empty(after.shape[:-1]), *self.parts(summed), *reports)
            state, added = self.parts(x), self.parts(sums)
            self.kernel(*state, 0.0, *added, *start, row[None], np.array([h]), *inputs, out=out)
            x, sums = after[..., 0, :], summed[..., 0, :]
            if k == 0:
                accelerations = ddq[..., 0, :]
        s.evaluations += count
        return x, accelerations

    def _inputs_at(self, t: Any, y: Array) -> list[Array]:
        """Inputs of a stage at states (..., size) except its length, with callbacks evaluated there."""
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
"""Kernel call: fraction of its step, index, coordinates and velocities, and the functions to evaluate."""


SHORT_BLOCK, LONG_BLOCK = 128, 512
"""Numbers of steps in a block: a longer block takes longer to prepare, a shorter one is stored in more parts."""


class CallbackRows:
    """Block of m steps: states, given torques, and the calls for each step."""

    def __init__(self, steps: CompiledSteps, m: int) -> None:
        s = steps.system
        laws, shares = steps.laws, steps.shares
        self.calls_per_step = n = len(shares)
        calls = np.arange(m * n)
        step, only_row = calls // n, np.zeros(m * n, int)
        self.states = np.zeros((m * n + 1, s.size))
        """States at the start of each call, and after the last one."""
        self.ddq = np.zeros((m * n, s.nv))
        self.held = np.zeros((m, s.nv))
        """(m, nv), torques of the controller plus constant torques."""
        self._h = np.zeros(1)
        self._constants = {name: x[None].copy() for name, x in steps.constants.items()}
        inputs: dict[str, Rows] = {name: (x, only_row) for name, x in self._constants.items()}
        inputs["tau"] = self.held, step
        for name, law in laws:
            inputs[name] = np.zeros((m * n, *law.shape)), calls
        self.given = inputs["tau"][0]
        """Torques of each call, or of each step if only a controller varies them."""
        self.tau = self.given[:: len(self.given) // m]
        """(m, nv), torques at the start of each step."""
        self.peaks = np.zeros(m * n + 1)
        """Peaks of these states: see :meth:`.StepPlan._with_peak`."""
        before = [*_parts(steps, self.states, calls), (self.peaks, calls)]
        after = [*_parts(steps, self.states, calls + 1), (self.peaks, calls + 1)]
        if n > 1:
            sums = np.zeros_like(self.states)
            before += _parts(steps, sums, calls)
            after += _parts(steps, sums, calls + 1)
            before += [*_parts(steps, self.states, step * n), (steps.table, calls % n)]
        named = [inputs[name] for name in steps.names]
        self.gaps = np.zeros((m * n, len(s.contacts)))
        """Gaps of the contacts at the start of each call."""
        reports: list[Rows] = [(self.ddq, calls)]
        if s.contacts:
            reports.append((self.gaps, calls))
        operands = [*before, (self._h, only_row), *named, *after, *reports]
        first = len(before) + 1
        self.call = bind_calls(
            steps.kernel, operands, first + steps.names.index("tau"), first + len(named) + len(steps.cuts)
        )
        """Makes a call, with torques if given, and returns the peak after it."""

        self._rows = {name: inputs[name][0] for name, _ in laws}
        q, dq, _ = steps.parts(self.states[:-1])
        self._calls = [*zip(shares * m, calls.tolist(), q, dq, strict=True)]
        self.sole: ControlLaw | None = None
        """The only callback, if it gives the torques of every call."""
        self.steps: list[list[Stage]] = []
        """Calls of each step."""
        self._plain: list[list[Stage]] = []
        """Calls of each step without functions to evaluate."""

    @classmethod
    @contextmanager
    def from_pool(
        cls, steps: CompiledSteps, controller: ControlLaw | None, constant: Array, n: int
    ) -> Iterator[CallbackRows]:
        """Rows for a run of n steps, cached with the robot for the next run because the setup is slow."""
        m = SHORT_BLOCK if n <= 2 * SHORT_BLOCK else LONG_BLOCK
        key = "callback rows", type(steps).__name__, m, *steps.plan.key, *(name for name, _ in steps.laws)
        free: list[CallbackRows] = steps.system.robot.engine.cache(key, list)
        try:
            rows = free.pop()
        except IndexError:  # all in use, by nested simulations or other threads
            rows = cls(steps, m)
        rows._begin(steps, controller, constant)
        yield rows
        rows.steps = rows._plain  # keeps no reference to callbacks
        rows.sole = None
        free.append(rows)

    def _begin(self, steps: CompiledSteps, controller: ControlLaw | None, constant: Array) -> None:
        """Numbers and callbacks of a run."""
        laws, n = steps.laws, self.calls_per_step
        self._h[0], self.held[:] = steps.h, constant
        for name, x in steps.constants.items():
            self._constants[name][0] = x
        self.sole = None
        if controller is None and [name for name, _ in laws] == ["tau"]:
            self.sole = laws[0][1]
        if controller is not None and not laws and not constant.any():
            self.sole = controller
        if self.sole is not None or not (controller or laws):
            self._plain = self._plain or self._steps([[] for _ in self._calls])
            self.steps = self._plain
            return
        evaluations: list[list[Evaluation]] = [[] for _ in self._calls]
        if controller is not None:
            for k, row in enumerate(self.held):
                evaluations[k * n].append((controller, row, constant))
        for name, law in laws:
            added = controller is not None and name == "tau"
            for k, row in enumerate(self._rows[name]):
                evaluations[k].append((law, row, self.held[k // n] if added else None))
        self.steps = self._steps(evaluations)

    def _steps(self, evaluations: list[list[Evaluation]]) -> list[list[Stage]]:
        """Calls of each step with their evaluations."""
        n = self.calls_per_step
        calls = [(*call, own) for call, own in zip(self._calls, evaluations, strict=True)]
        return [calls[k : k + n] for k in range(0, len(calls), n)]


def _parts(steps: CompiledSteps, states: Array, rows: NDArray[np.intp]) -> list[Rows]:
    """Columns of the parts of states (m, size), with the row of each call."""
    return [(part, rows) for part in steps.parts(states)]
