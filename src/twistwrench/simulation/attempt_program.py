"""One step of Dormand and Prince's method as a program, and what it is judged by, for constant torques and wrenches.

A stage is the program of :mod:`.simulated_step`'s rates, taken seven times; the rates of all stages are kept, for the error and
the dense output. What the step is judged by is what :mod:`.adaptive` and :mod:`.stiffness` say.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..algorithms.recursion import zeros
from ..program.program import Program
from ..program.recurrence import Recurrence, Source
from ..program.trace import trace
from ..typing import Array
from .forces import WORKS
from .simulated_step import SimulatedStep
from .step_program import Ports
from .tableau import DORMAND_PRINCE

STAGES = len(DORMAND_PRINCE.b)


@dataclass(frozen=True)
class AttemptedStep(SimulatedStep):
    """What a step of Dormand and Prince's method is made of, quaternions as they come."""

    @property
    def stages(self) -> int:
        """Evaluations of forward dynamics, those at the beginning left out: its rates are given."""
        return STAGES - 1

    def recurrence(self) -> Recurrence:
        """The program, whose states are q, dq, W and the rates (7, size) of the stages, the first of them given."""
        given, model = self.given, self.model
        shapes = [(model.nq,), (model.nv,), (len(WORKS),)]
        size = model.nq + model.nv + len(WORKS)
        state: Ports = [("angles", shapes[0]), ("q", shapes[0]), ("dq", shapes[1])]
        starts: Ports = list(zip(("q at start", "dq at start", "work at start"), shapes, strict=True))
        rest: Ports = [*starts, ("K", (STAGES, size)), ("stage", (2 * STAGES,))]
        fed = [Source("state", k) for k in (0, 0, 1)] + [Source("start", k) for k in range(3)]
        fed += [Source("state", 3), Source("stage")]
        program = trace(self._attempt, [*state, *rest, *given], ["q", "dq", "work", "rates"])
        sources = (*fed, *[Source("given")] * len(given))
        return Recurrence(program, sources, visible=4, table=_rows())

    def _attempt(
        self, angles: Array, _q: Array, dq: Array, q0: Array, dq0: Array, work0: Array, K: Array, row: Array, h: Any,
        *given: Array,
    ) -> tuple[Array, ...]:  # fmt: skip
        """The rates at a stage, written into K by the first half of a row, and the next stage, by its second half."""
        rate = np.concatenate(self.rates(angles, dq, given))
        here, ahead = row[:STAGES], row[STAGES:]
        K = np.array([K[0]] + [K[i] + here[i] * (rate - K[i]) for i in range(1, STAGES)], object)
        y = np.concatenate([q0, dq0, work0]) + h * (ahead @ K)
        nq, nv = self.model.nq, self.model.nv
        return y[:nq], y[nq : nq + nv], y[nq + nv :], K


def _rows() -> tuple[tuple[float, ...], ...]:
    """Which rate each stage is, and the weights of all that lead to the next one, from the last to the end."""
    a, b, *_ = DORMAND_PRINCE.numbers
    rows = []
    for i in range(STAGES):
        here, ahead = np.zeros(STAGES), np.zeros(STAGES)
        here[i] = float(i > 0)
        if i + 1 < STAGES:
            ahead[: i + 1] = a[i + 1][: i + 1]
        else:
            ahead[:] = b
        rows.append((*map(float, here), *map(float, ahead)))
    return tuple(rows)


def judgement(nq: int, nv: int) -> Program:
    """The program of what a step is judged by: its error (size,), and size, steepness, distance and speed (4,), squared."""
    judged, size = nq + nv, nq + nv + len(WORKS)
    a, *_ = DORMAND_PRINCE.numbers
    weights = DORMAND_PRINCE.numbers[3]

    def judge(y: Array, y1: Array, K: Array, h: Any, rtol: Any, atol: Any) -> tuple[Array, Array]:
        error = h * (weights @ K)
        largest = np.array([abs(x).clip(abs(x1), np.inf) for x, x1 in zip(y, y1, strict=True)], object)
        share = (error / (atol + rtol * largest))[:judged]
        steep = (K[-1] - K[-2])[:judged]
        away = (y1 - y - h * (a[-2][: STAGES - 2] @ K[:-2]))[:judged]
        speeds = y1[nq:judged]
        found = zeros(4)
        found[:] = (share @ share) * (1.0 / judged), h * h * (steep @ steep), away @ away, speeds @ speeds
        return error, found

    ports: Ports = [("y", (size,)), ("y1", (size,)), ("K", (STAGES, size)), ("h", ()), ("rtol", ()), ("atol", ())]
    return trace(judge, ports, ["error", "judgement"])
