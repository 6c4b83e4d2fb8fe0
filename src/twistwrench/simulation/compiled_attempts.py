"""Attempted steps of Dormand and Prince's method in machine code, and what each is judged by."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..kernels.row_calls import Rows, calls_rows, row_calls
from ..kernels.ufunc import owner_of
from ..robot.model_kernels import compiled
from ..typing import Array
from .attempt_program import STAGES, AttemptedStep
from .compiled_steps import acts_by_itself, constants, rubs
from .forces import System
from .torque_laws import GivenTorque

ROWS = 256
"""Steps that there is room for; those accepted wait there for the states between them to be made."""


class CompiledAttempts:
    """Steps of any length under the constant torques and wrenches of a system, and room for what comes of them.

    The rows before :attr:`count` are the steps accepted, the next one is the last that was tried.
    """

    def __init__(self, system: System, plan: AttemptedStep, kernel: Any, tolerances: tuple[float, float]) -> None:
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
    def of(cls, system: System, tolerances: tuple[float, float]) -> CompiledAttempts | None:
        """None where something is a function, a contact, or cannot be compiled."""
        if system.functions or not acts_by_itself(system):
            return None
        robot = system.robot
        acting: dict[str, Any] = {
            "frames": tuple(system.wrenches),
            "friction": rubs(system),
            "contacts": system.contacts,
        }
        plan = AttemptedStep(robot.model, GivenTorque(), "dopri5", **acting)

        def made() -> Any:
            robot.engine.require_invertible()
            doc = f"Steps of {robot.name}, compiled: dopri5."
            return compiled(plan.recurrence(), "attempted step", doc, lone=True)

        kernel = robot.engine.kept(plan.key, made)
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
        """What all steps accepted were judged to be off by, added up, (size,)."""
        return np.asarray(self._total + np.abs(self.errors[: self.count]).sum(axis=0))


def _calls(kernel: Any, inputs: list[Rows], outputs: list[Rows], taken: int) -> Callable[[int], Any]:
    """A function that makes call k of a kernel, from and to rows of arrays."""
    if calls_rows(kernel):
        return row_calls(kernel, [*inputs, *outputs], taken, len(inputs) + len(outputs) - 1)

    def call(k: int) -> None:
        *states, lengths = (x[which[k]] for x, which in inputs[:7])
        given = (x[which[k]][None] for x, which in inputs[7:])
        kernel(*states, lengths[None], *given, out=tuple(x[which[k]][None] for x, which in outputs))

    return call
