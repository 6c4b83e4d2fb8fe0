"""Steps of a closed robot under constant torques, many in one call: dynamics, method and projection traced together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..algorithms.constraints import constrained_dynamics
from ..algorithms.coordinate_rates import coordinate_rates
from ..algorithms.friction import eased, torque_past_eased_friction
from ..algorithms.integration import add
from ..algorithms.loop_projection import projected
from ..model.base_parameters import regrouped
from ..program.recurrence import Recurrence, Source
from ..program.trace import trace
from ..robot.engine import compiled
from ..typing import Array
from .closed_system import ClosedSystem
from .compiled_steps import CompiledSteps
from .forces import System
from .tableau import EULER, RK4

TABLES = {"rk4": RK4, "euler": EULER}
COMPILED_METHODS = (*TABLES, "semi_implicit")
"""Those whose steps are compiled."""
LARGEST = 30_000
"""Operations of a step from which it is not compiled: that takes a second or two, more than most simulations without."""
BLOCK = 2000
"""Steps between two looks at whether the user wants to stop: some 10 ms."""


class ClosedSteps(CompiledSteps):
    """The steps of one method under constant torques. The kernel's state: q, dq, and the work of torques and of friction."""

    def __init__(self, system: ClosedSystem, method: str, order: int, h: float) -> None:
        self.system: ClosedSystem = system
        self.loops, self.method, self.order, self.h = system.loops, method, order, h
        self.model = regrouped(system.robot.model)
        self.stages = len(TABLES[method].b) if method in TABLES else 1
        self.rubs = system.friction is not None
        self.most = BLOCK
        creep = np.ones(system.nv) if system.friction is None else system.friction.creep
        self.given = [system.held, creep]

    @classmethod
    def of(cls, system: System, method: str, order: int, h: float) -> ClosedSteps | None:
        """The steps in machine code; None where something else acts, or a step is too long to be compiled."""
        if not isinstance(system, ClosedSystem) or method not in COMPILED_METHODS:
            return None
        found = cls(system, method, order, h)
        asks = system.functions or system.wrenches or system.contacts
        if asks or not found.loops.effort(found.stages) <= LARGEST:
            return None
        closed = found.loops.closed
        key = "closed steps", closed.constraints, closed.independent, method, found.rubs
        found.kernel = system.robot.engine.kept(key, found._made)
        return found

    def _made(self) -> Any:
        nq, nv, name = self.model.nq, self.model.nv, self.system.robot.name
        state = [("q", (nq,)), ("dq", (nv,)), ("work", (2,))]
        given = [("dt", ()), ("tau", (nv,)), ("creep", (nv,))]
        names = ["q", "dq", "work", "before", "rates", "after", "pivots"]
        sources = (*(Source("state", k) for k in range(3)), *[Source("given")] * 3)
        doc = f"Steps of {name} on its constraints, compiled: {self.method}."
        program = trace(self._step, [*state, *given], names)
        return compiled(Recurrence(program, sources, visible=3), "closed steps", doc)

    def take(self, y: Array, steps: int, h: float | None = None) -> tuple[Array, Array]:
        """States after each step, (..., steps, size), not numbers from one that ends off the constraints; and accelerations."""
        s, loops = self.system, self.loops
        lengths = np.broadcast_to(np.float64(self.h if h is None else h), steps)
        given = (lengths, *(np.broadcast_to(x, (steps, *x.shape)) for x in self.given))
        rows, gaps = len(loops.closed.independent), sum(loops.with_gap)
        batch = (*y.shape[:-1], steps)
        Y, said = np.zeros((*batch, s.size)), [np.empty((*batch, k)) for k in (gaps, rows, gaps, rows)]
        parts = [slice(0, s.nq), s.moving, slice(s.done.start, s.done.start + 2)]
        with np.errstate(all="ignore"):
            self.kernel(*(y[..., part] for part in parts), *given, out=(*(Y[..., part] for part in parts), *said))
        before, rates, after, pivots = said
        good = np.logical_and.accumulate(loops.good(y, after, pivots), axis=-1)
        Y[~good] = np.nan
        if h is None:
            loops.note(before[good], rates[good])
        s.evaluations += self.stages * steps
        begins = np.concatenate([y[..., None, :], Y[..., :-1, :]], axis=-2)
        return Y, s.constant_accelerations(begins)

    def accelerations(self, _t: float, y: Array) -> Array:
        """Of states (..., size), (..., nv)."""
        self.system.evaluations += 1
        return self.system.constant_accelerations(y)

    # ── on symbols ──

    def _step(self, q: Array, dq: Array, work: Array, h: Any, tau: Array, creep: Array) -> tuple[Array, ...]:
        """One step by :class:`.schemes.RungeKutta` or :class:`.schemes.SemiImplicit`, and back onto the constraints."""
        if self.method in TABLES:
            a, b, _, _, _ = TABLES[self.method].numbers
            stages = [self._rates(q, dq, tau, creep)]
            for i in range(1, len(b)):
                q_i, dq_i = self._along((q, dq), h, a[i], stages)
                stages.append(self._rates(q_i, dq_i, tau, creep))
            q1, dq1, work1 = self._along((q, dq, work), h, b, stages)
        else:
            _, ddq, powers = self._rates(q, dq, tau, creep)
            dq1, work1 = dq + h * ddq, work + h * powers
            q1 = add(self.model, q, h * dq1)
        closed = self.loops.closed
        q1, dq1, *said = projected(self.model, q1, dq1, closed.constraints, closed.independent)
        return q1, dq1, work1, *said

    @staticmethod
    def _along(start: tuple[Array, ...], h: Any, weights: Array, stages: Sequence[tuple[Array, ...]]) -> list[Array]:
        """x + h Σ w_i k_i of each part of the state."""
        return [
            x + h * sum(float(w) * stage[part] for w, stage in zip(weights, stages, strict=False) if w)
            for part, x in enumerate(start)
        ]

    def _rates(self, q: Array, dq: Array, tau: Array, creep: Array) -> tuple[Array, Array, Array]:
        left = torque_past_eased_friction(self.model, dq, tau, eased(dq, creep)) if self.rubs else tau
        ddq = constrained_dynamics(self.model, q, dq, left, None, self.loops.kept)[0]
        return coordinate_rates(self.model, q) @ dq, ddq, np.array([tau @ dq, (left - tau) @ dq])
