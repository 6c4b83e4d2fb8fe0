"""Steps in machine code whose torques or wrenches are functions in Python, asked before each stage of a step."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from ..program.recurrence import Recurrence
from ..typing import Array
from .compiled_steps import CompiledSteps
from .simulated_step import TABLEAUS, SimulatedStep
from .step_program import stages
from .user_functions import Law


class AskedSteps(CompiledSteps):
    """The steps of one method under torques and wrenches of which some are functions; its kernel takes one stage a call."""

    @staticmethod
    def recurrence(plan: SimulatedStep) -> Recurrence:
        """What is compiled: a stage, which of a method of one stage is a step."""
        return plan.one_stage() if plan.stages > 1 else plan.recurrence()

    @property
    def shares(self) -> list[float]:
        """The times of the stages, as shares of a step."""
        return [float(c) for c in TABLEAUS[self.plan.method].c] if self.stages > 1 else [0.0]

    @property
    def table(self) -> Array:
        """What leads from each stage to the next, (stages, 5)."""
        return np.array(stages(TABLEAUS[self.plan.method]))

    def laws(self) -> Iterator[tuple[str, Law]]:
        """The functions, and what each of them gives, by its name in the plan."""
        if self.system.tau is not None:
            yield "tau", self.system.tau
        for frame, law in self.system.wrenches.items():
            if law.varies:
                yield f"wrench at {frame}", law

    def after(self, t: Any, y: Array, h: float) -> Array:
        """The states a time h after states (..., size) at times t."""
        return self._stepped(t, y, h, len(self.shares))[0]

    def begun(self, t: Any, y: Array, h: float) -> tuple[Array, Array]:
        """The same, and the accelerations (..., nv) at these states."""
        if self.system.braked is not None:
            return self.after(t, y, h), self.accelerations(t, y)
        return self._stepped(t, y, h, len(self.shares))

    def accelerations(self, t: Any, y: Array) -> Array:
        """Of states (..., size) at times t, (..., nv), those that a step begins with."""
        return self._stepped(t, y, self.h, 1)[1]

    def _stepped(self, t: Any, y: Array, h: float, count: int) -> tuple[Array, Array]:
        """States after so many stages of a step, and the accelerations that it begins with."""
        if self.stages == 1:
            states, ddq, _ = self.taken(y, 1, h, self._given(t, y))
            return states[..., 1, :], ddq[..., 0, :]
        s, x, sums, begun = self.system, y, np.zeros_like(y), None
        start = [y[..., None, cut] for cut in self.cuts]
        for share, row in zip(self.shares[:count], self.table, strict=False):
            given = [g[..., None, :] for g in self._given(t + share * h, x)]
            after, summed = np.empty((2, *y.shape[:-1], 1, s.size))
            ddq = np.empty((*y.shape[:-1], 1, s.nv))
            state, added, end, total = ([part[..., cut] for cut in self.cuts] for part in (x, sums, after, summed))
            said = (ddq, np.empty((*ddq.shape[:-1], len(s.contacts)))) if s.contacts else (ddq,)
            out = (*end, np.empty(after.shape[:-1]), *total, *said)
            self.kernel(*state, 0.0, *added, *start, row[None], np.array([h]), *given, out=out)
            x, sums = after[..., 0, :], summed[..., 0, :]
            begun = ddq[..., 0, :] if begun is None else begun
        s.evaluations += count
        assert begun is not None
        return x, begun

    def _given(self, t: Any, y: Array) -> list[Array]:
        """What a stage at states (..., size) is given but its length, functions asked there."""
        s = self.system
        given = {"tau": s.held, **self.constants}
        for name, law in self.laws():
            q, dq = y[..., : s.nq].copy(), y[..., s.moving].copy()
            found = law(t, q, dq) if y.ndim == 1 else law.values(np.broadcast_to(t, len(y)), q, dq)
            given[name] = s.held + found if name == "tau" else found
        return [given[name] for name in self.names]
