"""Attempted steps of Dormand and Prince's method in machine code, and what each is judged by."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..kernels.ufunc import owner_of
from ..robot.model_kernels import compiled
from ..typing import Array
from .attempt_program import STAGES, AttemptedStep, judgement
from .compiled_steps import acts_by_itself, constants, rubs
from .forces import System
from .torque_laws import GivenTorque


class CompiledAttempts:
    """Steps of any length under the constant torques and wrenches of a system."""

    def __init__(
        self, system: System, plan: AttemptedStep, kernel: Any, judge: Any, tolerances: tuple[float, float]
    ) -> None:
        self.system, self.plan, self.kernel, self.judge, self.tolerances = system, plan, kernel, judge, tolerances
        self.constants = [x[None] for x in constants(system, plan).values()]
        self._given_rates = np.zeros((STAGES, system.size))

    @classmethod
    def of(cls, system: System, tolerances: tuple[float, float]) -> CompiledAttempts | None:
        """None where something is a function, a contact, or cannot be compiled."""
        if system.functions or not acts_by_itself(system):
            return None
        robot = system.robot
        frames = tuple(system.wrenches)
        plan = AttemptedStep(robot.model, GivenTorque(), "dopri5", frames=frames, friction=rubs(system))

        def made() -> Any:
            robot.engine.require_invertible()
            return compiled(plan.recurrence(), "attempted step", f"Steps of {robot.name}, compiled: dopri5.")

        def judging() -> Any:
            return compiled(judgement(robot.nq, robot.nv), "judgement", f"What steps of {robot.name} are judged by.")

        kernel = robot.engine.kept(plan.key, made)
        judge = robot.engine.kept("judgement", judging)
        return None if owner_of(kernel) is None else cls(system, plan, kernel, judge, tolerances)

    def take(self, y: Array, rate: Array, h: float) -> tuple[Array, Array, Array, Array]:
        """From a state and its rates (size,): the state after, rates (7, size), error (size,) and judgement (4,)."""
        s, K = self.system, self._given_rates
        K[0] = rate
        nq, n = s.nq, s.nq + s.nv
        Y, rates = np.empty((1, s.size)), np.empty((1, STAGES, s.size))
        out = Y[:, :nq], Y[:, nq:n], Y[:, n:], rates
        self.kernel(y[:nq], y[nq:n], y[n:], K, np.array([h]), s.held[None], *self.constants, out=out)
        s.evaluations += self.plan.stages
        y1, K = Y[0], rates[0]
        error, judged = self.judge(y, y1, K, h, *self.tolerances)
        return y1, K, error, judged
