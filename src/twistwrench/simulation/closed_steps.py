"""Steps of a closed robot under constant torques, many in one call: dynamics, method and projection traced together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

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
from .tableau import EULER, RK4

if TYPE_CHECKING:
    from .closed_system import Loops

TABLES = {"rk4": RK4, "euler": EULER}
COMPILED_METHODS = (*TABLES, "semi_implicit")
"""Those whose steps are compiled."""
LARGEST = 30_000
"""Operations of a step from which it is not compiled: that takes a second or two, more than most simulations without."""


class ClosedSteps:
    """The steps of one robot by one method. State: q, dq, and the work of torques and of friction."""

    def __init__(self, loops: Loops, method: str, *, rubs: bool) -> None:
        self.loops, self.method, self.rubs = loops, method, rubs
        closed = loops.closed
        self.model = regrouped(closed.robot.model)
        key = "closed steps", closed.constraints, closed.independent, method, rubs
        self.kernel = closed.robot.engine.kept(key, self._made)
        """None where a step is too long to be compiled."""

    def _made(self) -> Any:
        nq, nv, name = self.model.nq, self.model.nv, self.loops.closed.robot.name
        state = [("q", (nq,)), ("dq", (nv,)), ("work", (2,))]
        given = [("dt", ()), ("tau", (nv,)), ("creep", (nv,))]
        names = ["q", "dq", "work", "before", "rates", "after", "pivots"]
        stages = len(TABLES[self.method].b) if self.method in TABLES else 1
        if not self.loops.effort(stages) <= LARGEST:
            return None
        program = trace(self._step, [*state, *given], names)
        sources = (*(Source("state", k) for k in range(3)), *[Source("given")] * 3)
        doc = f"Steps of {name} on its constraints, compiled: {self.method}."
        return compiled(Recurrence(program, sources, visible=3), "closed steps", doc)

    def taken(self, n: int, h: float, start: tuple[Array, Array, Array], tau: Array, creep: Array) -> Any:
        """q, dq and work after each of n steps, and what :func:`.projected` says of each."""
        nv = self.model.nv
        given = (np.broadcast_to(h, (n,)), np.broadcast_to(tau, (n, nv)), np.broadcast_to(creep, (n, nv)))
        k = len(self.loops.closed.independent), sum(self.loops.with_gap)
        out = [np.empty((n, m)) for m in (self.model.nq, nv, 2, k[1], k[0], k[1], k[0])]
        return self.kernel(*start, *given, out=tuple(out))

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
