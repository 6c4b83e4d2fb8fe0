"""The adjoint of a step of a rollout, as a program: from the slopes of a cost by the state after the step to those before it.

With x1 = f(x0, u) a step, τ the torques applied in it, and λ the slopes of a cost by a state, through all later ones,

    (1)  λ0 = l + A' λ1 + C' m,       A = ∂x1/∂x0,  C = ∂τ/∂x0
    (2)  ∂cost/∂u = B' λ1 + D' m,     B = ∂x1/∂u,   D = ∂τ/∂u

with l and m the cost's own slopes by x0 and by τ. All this is one sweep of reverse mode through the program of the step, so no
matrix is made. Slopes by configurations are along robot.add: entries nv, not nq.

Sources: Bryson and Ho, Applied Optimal Control (1975), section 2.2, and Griewank and Walther, Evaluating Derivatives (2008),
chapter 3.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..algorithms.coordinate_rates import velocity_map
from ..program import autodiff
from ..program.recurrence import Recurrence, Source
from ..program.trace import trace
from ..robot.derivative_options import Chart
from ..typing import Array
from .step_program import Plan, Ports


@dataclass(frozen=True)
class StepAdjoint:
    """The adjoint of the steps of one plan."""

    plan: Plan

    @property
    def by(self) -> Ports:
        """What is given for each step and has slopes, with the shapes of these: all but dt and limits."""
        known = {"dt", "torque limits"}
        return [
            (name, (self.plan.model.nv,) if name == "q_des" else shape)
            for name, shape in self.plan.given
            if name not in known
        ]

    @property
    def recurrence(self) -> Recurrence:
        """(1) and (2), from the last step to the first: the states are λ, by q and by dq, and (2) is said of each step.

        Given for each step: q twice (as angles and as coordinates), dq, all that the step was given, l by q and by dq, and
        m where torques are said.
        """
        nq, nv = self.plan.model.nq, self.plan.model.nv
        states: Ports = [("slope by q", (nv,)), ("slope by dq", (nv,))]
        given: Ports = [("angles", (nq,)), ("q", (nq,)), ("dq", (nv,)), *self.plan.given]
        given += [("cost by q", (nv,)), ("cost by dq", (nv,)), *[("cost by tau", (nv,))] * self.plan.says_torques]
        said = [f"slope by {name}" for name, _ in self.by]
        program = trace(self._on_symbols, [*states, *given], [*(name for name, _ in states), *said])
        return Recurrence(program, (Source("state", 0), Source("state", 1), *[Source("given")] * len(given)), visible=2)

    def _on_symbols(
        self, by_q1: Array, by_dq1: Array, angles: Array, q: Array, dq: Array, *given: Any
    ) -> tuple[Array, ...]:
        model, count = self.plan.model, len(self.plan.given)
        step, cost = given[:count], given[count:]
        q1, *rest = self.plan.step(angles, q, dq, *step)
        weights = [*(by_q1 @ velocity_map(model, q1)), *by_dq1, *(e for m in cost[2:] for e in m)]
        moved = Chart((model.nv,), {**Chart.of(angles, model).known, **Chart.of(q, model).known})
        inputs = dict(zip([name for name, _ in self.plan.given], step, strict=True))
        charts = [Chart.of(inputs[name], model if name == "q_des" else None) for name, _ in self.by]
        chart = Chart.joined([moved, Chart.of(dq), *charts])
        owner = dq[0].trace
        results = [owner.lift(e) for part in (q1, *rest) for e in part]
        slopes = autodiff.gradient(results, weights, chart.known, math.prod(chart.shape))
        sizes = [model.nv, model.nv, *(math.prod(shape) for _, shape in self.by)]
        before_q, before_dq, *by = np.split(slopes, np.cumsum(sizes)[:-1])
        return before_q + cost[0], before_dq + cost[1], *by
