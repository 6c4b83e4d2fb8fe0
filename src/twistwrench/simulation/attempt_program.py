"""One step of Dormand and Prince's method as a program, and what it is judged by, for constant torques and wrenches.

A stage is the program of :mod:`.simulated_step`'s rates, taken seven times; the rates of all stages are kept, for the error and
the dense output. What the step is judged by is what :mod:`.adaptive` and :mod:`.stiffness` say.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..algorithms.recursion import zeros
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
        """The program, whose states are q, dq, W, the rates (7, size) of the stages, error (size,) and judgement (4,).

        Of the rates the first are given; error and judgement go in as any numbers, and nothing takes them. After the step's
        length and all else that is given come the tolerances.
        """
        model = self.model
        shapes = [(model.nq,), (model.nv,), (len(WORKS),)]
        size = model.nq + model.nv + len(WORKS)
        state: Ports = [("angles", shapes[0]), ("q", shapes[0]), ("dq", shapes[1])]
        starts: Ports = list(zip(("q at start", "dq at start", "work at start"), shapes, strict=True))
        rest: Ports = [*starts, ("K", (STAGES, size)), ("stage", (2 * STAGES,))]
        given = [*self.given, ("rtol", ()), ("atol", ())]
        fed = [Source("state", k) for k in (0, 0, 1)] + [Source("start", k) for k in range(3)]
        fed += [Source("state", 3), Source("stage")]
        names = ["q", "dq", "work", "rates", "error", "judgement"]
        program = trace(self._attempt, [*state, *rest, *given], names)
        return Recurrence(program, (*fed, *[Source("given")] * len(given)), visible=6, table=_rows())

    def _attempt(
        self, angles: Array, _q: Array, dq: Array, q0: Array, dq0: Array, work0: Array, K: Array, row: Array, h: Any,
        *given: Any,
    ) -> tuple[Array, ...]:  # fmt: skip
        """The rates at a stage, written into K by the first half of a row, and the next stage, by its second half.

        The last stage is at the end of the step, and so is what comes after it: then it is judged.
        """
        *acting, rtol, atol = given
        rate = np.concatenate(self.rates(angles, dq, acting))
        here, ahead = row[:STAGES], row[STAGES:]
        K = np.array([K[0]] + [K[i] + here[i] * (rate - K[i]) for i in range(1, STAGES)], object)
        y = np.concatenate([q0, dq0, work0])
        y1 = y + h * (ahead @ K)
        nq, nv = self.model.nq, self.model.nv
        judged = judgement(slice(nq, nq + nv), y, y1, K, h, rtol, atol)
        return y1[:nq], y1[nq : nq + nv], y1[nq + nv :], K, *judged


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


def judgement(moving: slice, y: Array, y1: Array, K: Array, h: Any, rtol: Any, atol: Any) -> tuple[Array, Array]:
    """What a step from y to y1 is judged by: its error (size,), and size, steepness, distance and speed (4,), squared."""
    mine = slice(0, moving.stop)
    a, _, _, weights, _ = DORMAND_PRINCE.numbers
    error = h * (weights @ K)
    largest = np.array([abs(x).clip(abs(x1), np.inf) for x, x1 in zip(y, y1, strict=True)], object)
    share = (error / (atol + rtol * largest))[mine]
    steep = (K[-1] - K[-2])[mine]
    away = (y1 - y - h * (a[-2][: STAGES - 2] @ K[:-2]))[mine]
    found = zeros(4)
    found[:] = (share @ share) * (1.0 / moving.stop), h * h * (steep @ steep), away @ away, y1[moving] @ y1[moving]
    return error, found
