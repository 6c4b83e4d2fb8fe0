"""Trial steps of Dormand and Prince's method in compiled code, and their error measures.

A stage is the program of :mod:`.simulated_step`'s rates, taken seven times; the rates of all stages are kept, for the error and
the dense output. What the step is judged by is what :mod:`.adaptive` and :mod:`.stiffness` say.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..algorithms.recursion import zeros
from ..ir.loops import Scan, Source
from ..ir.tracer import trace
from ..robot.engine import compiled
from ..runtime.dispatch import Rows, bind_calls, can_bind_calls
from ..runtime.gufunc import owner_of
from ..typing import Array
from .compiled_steps import Ports, SimulatedStep, acts_by_itself, constants, rubs
from .forces import WORKS, System
from .schemes import DORMAND_PRINCE
from .torque_laws import GivenTorque

STAGES = len(DORMAND_PRINCE.b)


@dataclass(frozen=True)
class TrialStep(SimulatedStep):
    """Trial step of Dormand and Prince's method, quaternions not normalised."""

    @property
    def stages(self) -> int:
        """Evaluations of forward dynamics, those at the beginning left out: its rates are given."""
        return STAGES - 1

    def recurrence(self) -> Scan:
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
        return Scan(program, (*fed, *[Source("given")] * len(given)), visible=6, table=_rows())

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
    """Index of the rate of each stage, and the weights that lead to the next one, from the last to the end."""
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
    """Error (size,) of a step from y to y1, and squared size, steepness, distance and speed (4,)."""
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


# ── Compiled trial steps

ROWS = 256
"""Steps that there is room for; those accepted wait there for the states between them to be made."""


class TrialSteps:
    """Steps of any length under the constant torques and wrenches of a system, and room for what comes of them.

    The rows before :attr:`count` are the steps accepted, the next one is the last that was tried.
    """

    def __init__(self, system: System, plan: TrialStep, kernel: Any, tolerances: tuple[float, float]) -> None:
        self.system, self.plan, self.count = system, plan, 0
        self._total = np.zeros(system.size)
        m, size = ROWS, system.size
        self.states, self.rates = np.zeros((m, size)), np.zeros((m, STAGES, size))
        self.errors, self.judgements = np.zeros((m, size)), np.zeros((m, 4))
        """(m, size), (m, 7, size), (m, size), (m, 4): states after the steps, rates of the stages, errors and judgements."""
        self._y, self._K, self._h = np.zeros((1, size)), np.zeros((1, STAGES, size)), np.zeros(1)
        self._given = {"tau": np.zeros((1, system.nv)), **{k: x[None] for k, x in constants(system, plan).items()}}
        self._held: Array | None = None
        one, own = np.zeros(m, int), np.arange(m)
        cuts = slice(0, system.nq), system.moving, slice(system.nq + system.nv, size)
        states, after = ([(x[:, cut], which) for cut in cuts] for x, which in ((self._y, one), (self.states, own)))
        judged = [(self.errors, own), (self.judgements, own)]
        named = [(self._given[name], one) for name, _ in plan.given[1:]]
        limits = [(np.array([x]), one) for x in tolerances]
        inputs: list[Rows] = [*states, (self._K, one), *judged, (self._h, one), *named, *limits]
        outputs: list[Rows] = [*after, (self.rates, own), *judged]
        self._call = _calls(kernel, inputs, outputs, [name for name, _ in plan.given].index("tau") + 6)

    @classmethod
    def build(cls, system: System, tolerances: tuple[float, float]) -> TrialSteps | None:
        """None where something is a function, a contact, or cannot be compiled."""
        if system.functions or not acts_by_itself(system):
            return None
        robot = system.robot
        acting: dict[str, Any] = {
            "frames": tuple(system.wrenches),
            "friction": rubs(system),
            "contacts": system.contacts,
        }
        plan = TrialStep(robot.model, GivenTorque(), "dopri5", **acting)

        def made() -> Any:
            robot.engine.require_invertible()
            doc = f"Steps of {robot.name}, compiled: dopri5."
            return compiled(plan.recurrence(), "attempted step", doc, scalar=True)

        kernel = robot.engine.cached(plan.key, made)
        return None if owner_of(kernel) is None else cls(system, plan, kernel, tolerances)

    def take(self, y: Array, rate: Array, h: float) -> list[float]:
        """Try a step from a state and its rates (size,); its judgement (4)."""
        if self.count == ROWS:
            self.restart()
        s, k = self.system, self.count
        if self._held is not s.held:
            self._held = s.held
            self._given["tau"][0] = s.held
        self._y[0], self._K[0, 0], self._h[0] = y, rate, h
        self._call(k)
        s.evaluations += self.plan.stages
        found: list[float] = self.judgements[k].tolist()
        return found

    def accept(self) -> None:
        """Keep the step that was tried last."""
        self.count += 1

    def restart(self) -> None:
        """Give the rows of the steps accepted to the next ones."""
        self._total = self.total
        self.count = 0

    @property
    def total(self) -> Array:
        """Estimated errors of all accepted steps, added up, (size,)."""
        return np.asarray(self._total + np.abs(self.errors[: self.count]).sum(axis=0))


def _calls(kernel: Any, inputs: list[Rows], outputs: list[Rows], taken: int) -> Callable[[int], Any]:
    """A function that makes call k of a kernel, from and to rows of arrays."""
    if can_bind_calls(kernel):
        return bind_calls(kernel, [*inputs, *outputs], taken, len(inputs) + len(outputs) - 1)

    def call(k: int) -> None:
        *states, lengths = (x[which[k]] for x, which in inputs[:7])
        given = (x[which[k]][None] for x, which in inputs[7:])
        kernel(*states, lengths[None], *given, out=tuple(x[which[k]][None] for x, which in outputs))

    return call
