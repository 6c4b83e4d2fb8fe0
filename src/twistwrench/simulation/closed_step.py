"""One step of a closed robot as a program: constrained dynamics, the method, and back onto the constraints, traced together.

Simulations and rollouts take the same steps. The state is q and dq, what steps left to be taken away so far, and, in
simulations, the works done.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from ..algorithms.constraints import Constraint, constrained_dynamics, kept
from ..algorithms.coordinate_rates import coordinate_rates
from ..algorithms.friction import eased, torque_past_eased_friction
from ..algorithms.integration import add
from ..algorithms.loop_projection import LoopRows, projected
from ..algorithms.switches import largest, positive, smallest
from ..algorithms.weighted_svd import SAFE
from ..program.recurrence import Recurrence, Source
from ..program.trace import trace
from ..typing import Array
from .forces import WORKS
from .simulated_step import TABLEAUS, SimulatedStep
from .step_program import Ports

WIDEST, FASTEST, OPEN, PIVOT, GOOD = range(5)
"""What is passed on beside q and dq: the largest gap [rad or m] and rate of one that a step left before they were taken away,
the largest gap after that, the smallest pivot of A M⁻¹ A' over its usual size, and 1 while all steps end on the constraints."""
KEPT = 5
SMALL, SHRUNK = 1e-2, 0.25
"""Of its usual size: a pivot that is small; and where the smallest pivot is small and one step leaves less
than this part of it, its root has halved: another step as long would be at the singular configuration, or beyond it."""


@dataclass(frozen=True)
class ClosedStep(SimulatedStep):
    """What a step on constraints is made of."""

    loops: LoopRows = field(default_factory=lambda: LoopRows((), ()))
    usual: tuple[float, ...] = ()
    """The usual size of each pivot of A M⁻¹ A'."""
    allowed: tuple[float, ...] = ()
    """How far each row that has a position may be open after a step, rad or m."""
    works: bool = False
    """Whether works and accelerations are asked for, as in simulations."""

    @property
    def key(self) -> tuple[Any, ...]:
        """Plans of one robot with one key are one program."""
        return "closed step", super(SimulatedStep, self).key, self.loops, self.works

    @property
    def state_sizes(self) -> tuple[int, ...]:
        """How many numbers each part of the state is."""
        return self.model.nq, self.model.nv, KEPT, *[len(WORKS)] * self.works

    @property
    def eases(self) -> bool:
        """Friction is eased by every method."""
        return self.friction

    @cached_property
    def _held(self) -> tuple[Constraint, ...]:
        return kept(self.loops.constraints, self.loops.independent)

    def recurrence(self) -> Recurrence:
        """The program, and where its inputs come from."""
        parts = ["q", "dq", "kept", *["work"] * self.works]
        state: Ports = [(name, (size,)) for name, size in zip(parts, self.state_sizes, strict=True)]
        said = ["ddq"] * self.works + ["tau"] * self.says_torques
        program = trace(self._step, [*state, *self.given], [*parts, *said])
        fed = [Source("state", k) for k in range(len(parts))] + [Source("given")] * len(self.given)
        return Recurrence(program, tuple(fed), visible=len(parts))

    # ── on symbols ──

    def _step(self, q: Array, dq: Array, passed: Array, *rest: Any) -> tuple[Array, ...]:
        """One step by :class:`.schemes.RungeKutta` or :class:`.schemes.SemiImplicit`, and back onto the constraints."""
        count = 2 + self.works
        start, (h, *given) = (q, dq, *rest[: self.works]), rest[self.works :]
        first, tau = self._motion(q, dq, given)
        if self.method in TABLEAUS:
            a, b, _, _, _ = TABLEAUS[self.method].numbers
            stages = [first]
            for i in range(1, len(b)):
                q_i, dq_i = _along(start[:2], h, a[i], stages)
                stages.append(self._motion(q_i, dq_i, given)[0])
            q1, dq1, *work = _along(start, h, b, [stage[:count] for stage in stages])
        else:
            _, ddq, powers = first
            dq1, work = dq + h * ddq, [x + h * powers for x in start[2:]]
            q1 = add(self.model, q, h * dq1)
        _, plant, _ = self._models(given)
        q1, dq1, *left = projected(plant, q1, dq1, self.loops.constraints, self.loops.independent)
        said = (first[1],) * self.works + (tau,) * self.says_torques
        return q1, dq1, self._passed_on(passed, *left), *work, *said

    def _motion(self, q: Array, dq: Array, given: Sequence[Array]) -> tuple[tuple[Array, Array, Array], Array]:
        """Rates of coordinates, velocities and works; and the torques."""
        known, plant, rest = self._models(given)
        tau = force = self._torques(known, q, q, dq, rest)
        if self.friction:
            force = torque_past_eased_friction(plant, dq, tau, eased(dq, rest["creep"]))
        ddq = constrained_dynamics(plant, q, dq, force, self._pushed(rest), self._held)[0]
        powers = self._powers(plant, q, dq, tau, force - tau, rest)
        return (coordinate_rates(self.model, q) @ dq, ddq, powers), tau

    def _passed_on(self, before: Array, gaps: Array, rates: Array, after: Array, pivots: Array) -> Array:
        """What is passed on to the next step; :func:`lost` says the same of numbers."""
        pivot: Any = smallest(pivots / np.array(self.usual), np.inf)
        beyond = after / np.array(self.allowed) if self.allowed else after
        gone = (1.0 - positive(SMALL - pivot) * positive(SHRUNK * before[PIVOT] - pivot)) * (
            1.0 - positive(SAFE - pivot)
        )
        good = before[GOOD] * gone * (1.0 - positive(largest(beyond, 0.0) - 1.0))
        said = largest(gaps, before[WIDEST]), largest(rates, before[FASTEST]), largest(after, before[OPEN]), pivot, good
        return np.array(said, object)


def _along(start: Sequence[Array], h: Any, weights: Array, stages: Sequence[tuple[Array, ...]]) -> list[Array]:
    """x + h Σ w_i k_i of each part of the state."""
    return [
        x + h * sum(float(w) * stage[part] for w, stage in zip(weights, stages, strict=False) if w)
        for part, x in enumerate(start)
    ]


def lost(pivot: Array, earlier: Array | float) -> Array:
    """Whether the constraints lose rank after a step, or would in the next, by the smallest pivots after it and before."""
    return ~(pivot >= SAFE) | ((pivot < SMALL) & (pivot < SHRUNK * earlier))
