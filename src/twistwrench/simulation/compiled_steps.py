"""Steps of a run in machine code, many in one call, where nothing that acts on the robot is a function in Python."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..kernels.interpreter import compiles
from ..kernels.ufunc import owner_of
from ..robot.engine import compiled
from ..typing import Array
from .forces import System
from .simulated_step import SIMULATED, SimulatedStep
from .torque_laws import GivenTorque

_IN_ONE_CALL = 5e8
"""Operations between two looks at whether the user wants to stop: some hundredths of a second."""
_NUMBERS = 2_000_000
"""Numbers that the states of one call may be."""


def asks_nothing(system: System) -> bool:
    """Whether all that acts on a robot is constant, or follows from its state by laws of its own, and steps can be compiled."""
    varies = system.tau is not None or any(law.varies for law in system.wrenches.values())
    return not (varies or system.contacts) and compiles()


def rubs(system: System) -> bool:
    """Whether there is friction."""
    return system.friction is not None or (system.braked is not None and system.braked.friction)


def constants(system: System, plan: SimulatedStep) -> list[Array]:
    """What a step is given but its length."""
    given = [system.held, *(law(0.0, np.zeros(0), np.zeros(0)) for law in system.wrenches.values())]
    if plan.eases and system.friction is not None:
        given.append(system.friction.creep)
    return given


class CompiledSteps:
    """The steps of one method under the constant torques and wrenches of a system."""

    takes_many = True

    def __init__(self, system: System, plan: SimulatedStep, order: int, h: float, kernel: Any, effort: float) -> None:
        self.system, self.order, self.h, self.kernel = system, order, h, kernel
        self.stages = plan.stages
        """Evaluations of forward dynamics in a step."""
        self.most = max(1, int(min(_IN_ONE_CALL / (effort * self.stages), _NUMBERS / (system.size + system.nv))))
        """Steps to take in one call."""
        self.given = constants(system, plan)
        self._given: tuple[int, list[Array]] = (-1, [])

    @classmethod
    def of(cls, system: System, method: str, order: int, h: float) -> CompiledSteps | None:
        """The steps of a system in machine code; None where something is a function, a contact, or cannot be compiled."""
        if method not in SIMULATED or not asks_nothing(system):
            return None
        robot = system.robot
        frames = tuple(system.wrenches)
        plan = SimulatedStep(robot.model, GivenTorque(), method, frames=frames, friction=rubs(system))

        def made() -> Any:
            robot.engine.require_invertible()
            return compiled(plan.recurrence(), "simulated step", f"Steps of {robot.name}, compiled: {method}.")

        kernel = robot.engine.kept(plan.key, made)
        owner = owner_of(kernel)
        return None if owner is None else cls(system, plan, order, h, kernel, owner.effort)

    def take(self, y: Array, steps: int, h: float | None = None) -> tuple[Array, Array]:
        """States after each step, (..., steps, size), and accelerations as each begins, (..., steps, nv); y (..., size)."""
        s = self.system
        Y, ddq = np.empty((*y.shape[:-1], steps, s.size)), np.empty((*y.shape[:-1], steps, s.nv))
        lengths = np.full(steps, self.h if h is None else h)
        given = self._given_for(steps)
        cuts = slice(0, s.nq), s.moving, slice(s.nq + s.nv, s.size)
        self.kernel(*(y[..., cut] for cut in cuts), lengths, *given, out=(*(Y[..., cut] for cut in cuts), ddq))
        s.evaluations += self.stages * steps
        return Y, ddq

    def _given_for(self, steps: int) -> list[Array]:
        """What is given for each of so many steps."""
        if self._given[0] != steps:
            self._given = steps, [np.broadcast_to(x, (steps, *x.shape)) for x in self.given]
        return self._given[1]

    def after(self, _t: float, y: Array, h: float) -> Array:
        """The states a time h after states (..., size)."""
        return self.take(y, 1, h)[0][..., 0, :]

    def accelerations(self, _t: float, y: Array) -> Array:
        """Of states (..., size), (..., nv), those that a step begins with."""
        found = self.take(y, 1, self.h)[1][..., 0, :]
        self.system.evaluations += 1 - self.stages  # of the step only what it begins with was asked for
        return found
