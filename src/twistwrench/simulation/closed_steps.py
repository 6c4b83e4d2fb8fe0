"""Steps of a closed robot under constant torques and wrenches, many in one call."""

from __future__ import annotations

import numpy as np

from ..robot.model_kernels import compiled
from ..typing import Array
from .closed_step import FASTEST, GOOD, KEPT, PIVOT, WIDEST
from .closed_system import ClosedSystem, Loops
from .compiled_steps import CompiledSteps, acts_by_itself
from .forces import System
from .simulated_step import SIMULATED
from .step_program import Plan
from .torque_laws import GivenTorque

LARGEST = 30_000
"""Operations of a step from which it is not compiled: that takes a second or two, more than most simulations without."""
BLOCK = 2000
"""Steps between two looks at whether the user wants to stop: some 10 ms."""


class ClosedSteps(CompiledSteps):
    """The steps of one method under the constant torques and wrenches of a closed system."""

    loops: Loops

    @classmethod
    def of(cls, system: System, method: str, order: int, h: float) -> ClosedSteps | None:
        """The steps in machine code; None where something is a function, a contact, or a step is too long to be compiled."""
        if not isinstance(system, ClosedSystem) or method not in SIMULATED:
            return None
        if system.functions or system.contacts or not acts_by_itself(system):
            return None
        loops, robot = system.loops, system.robot
        acting = Plan(
            robot.model, GivenTorque(), method, frames=tuple(system.wrenches), friction=system.friction is not None
        )
        plan = loops.step_of(acting, works=True)
        if not (effort := loops.effort(plan.stages)) <= LARGEST:
            return None
        doc = f"Steps of {robot.name} on its constraints, compiled: {method}."
        kernel = robot.engine.kept(plan.key, lambda: compiled(plan.recurrence(), "closed steps", doc))
        found = cls(system, plan, order, h, kernel, effort)
        found.most, found.loops = BLOCK, loops
        return found

    def take(self, y: Array, steps: int, h: float | None = None) -> tuple[Array, Array, Array]:
        """As :meth:`.CompiledSteps.take`; states are no numbers from a step on that ends off the constraints."""
        s, loops = self.system, self.loops
        lengths = np.full(steps, self.h if h is None else h)
        batch = (*y.shape[:-1], steps)
        states, kept, ddq = (
            np.empty((*y.shape[:-1], steps + 1, s.size)),
            np.empty((*batch, KEPT)),
            np.empty((*batch, s.nv)),
        )
        states[..., 0, :] = y
        Y = states[..., 1:, :]
        begun = np.zeros((*y.shape[:-1], KEPT))
        begun[..., PIVOT], begun[..., GOOD] = loops.smallest(y), 1.0
        q, dq, work = self.cuts
        given = [np.broadcast_to(x, (steps, *x.shape)) for x in self.told()]
        with np.errstate(all="ignore"):
            self.kernel(
                y[..., q], y[..., dq], begun, y[..., work], lengths, *given,
                out=(Y[..., q], Y[..., dq], kept, Y[..., work], ddq),
            )  # fmt: skip
        good = kept[..., GOOD] > 0.5
        Y[~good] = np.nan
        if h is None and good.any():
            last = kept[int(good.sum()) - 1]
            loops.note(last[WIDEST], last[FASTEST])
        s.evaluations += self.stages * steps
        return states, ddq, np.empty((*batch, 0))
