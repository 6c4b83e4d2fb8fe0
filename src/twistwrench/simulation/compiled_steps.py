"""Steps of a run in machine code, many in one call, where nothing that acts on the robot is a function in Python."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..kernels.interpreter import compiles
from ..kernels.ufunc import owner_of
from ..program.recurrence import Recurrence
from ..robot.model_kernels import compiled
from ..typing import Array
from .forces import System
from .simulated_step import SIMULATED, SimulatedStep
from .torque_laws import GivenTorque

_IN_ONE_CALL = 5e8
"""Operations between two looks at whether the user wants to stop: some hundredths of a second."""
_TOUCHING = 64
"""Points and joints that run into something, up to which steps are compiled: each is written out."""
_NUMBERS = 2_000_000
"""Numbers that the states of one call may be."""


def acts_by_itself(system: System) -> bool:
    """Whether what acts on a robot follows from its state by laws of its own but for functions, and steps can be compiled."""
    gained = system.braked is not None and system.braked.gained
    touching = sum(contact.size for contact in system.contacts)
    return not gained and touching <= _TOUCHING and compiles()


def rubs(system: System) -> bool:
    """Whether there is friction."""
    return system.friction is not None or (system.braked is not None and system.braked.friction)


def constants(system: System, plan: SimulatedStep) -> dict[str, Array]:
    """What a step is given but its length and functions, by the names of the plan."""
    nothing = np.zeros(0)
    given = {
        f"wrench at {frame}": law(0.0, nothing, nothing) for frame, law in system.wrenches.items() if not law.varies
    }
    if plan.eases and system.friction is not None:
        given["creep"] = system.friction.creep
    for k, contact in enumerate(plan.contacts):
        given |= {f"{name} of contact {k}": x for name, x in contact.numbers.items()}
    return given


class CompiledSteps:
    """The steps of one method, under the torques held by a system and its constant wrenches."""

    takes_many = True

    def __init__(self, system: System, plan: SimulatedStep, order: int, h: float, kernel: Any, effort: float) -> None:
        self.system, self.plan, self.order, self.h, self.kernel = system, plan, order, h, kernel
        self.stages = plan.stages
        """Evaluations of forward dynamics in a step."""
        self.most = max(1, int(min(_IN_ONE_CALL / (effort * self.stages), _NUMBERS / (system.size + system.nv))))
        """Steps to take in one call."""
        self.names = [name for name, _ in plan.given[1:]]
        """Of what a step is given but its length."""
        self.constants = constants(system, plan)
        self.cuts = slice(0, system.nq), system.moving, slice(system.nq + system.nv, system.size)
        """The parts of a state."""

    @classmethod
    def of(cls, system: System, method: str, order: int, h: float) -> CompiledSteps | None:
        """The steps of a system in machine code; None where there is a contact, or they cannot be compiled."""
        if method not in SIMULATED or not acts_by_itself(system):
            return None
        model = system.robot.model
        acting: dict[str, Any] = {
            "frames": tuple(system.wrenches),
            "friction": rubs(system),
            "contacts": system.contacts,
        }
        plan = SimulatedStep(model, GivenTorque(), method, **acting)
        return cls._with_kernel(system, plan, order, h, lone=True)

    @classmethod
    def _with_kernel(
        cls, system: System, plan: SimulatedStep, order: int, h: float, *, lone: bool
    ) -> CompiledSteps | None:
        """The same, for one state at a time or for many side by side."""
        robot = system.robot

        def made() -> Any:
            robot.engine.require_invertible()
            doc = f"Steps of {robot.name}, compiled: {plan.method}."
            return compiled(cls.recurrence(plan), "simulated step", doc, lone=lone)

        kernel = robot.engine.kept((*plan.key, cls.__name__, lone), made)
        owner = owner_of(kernel)
        return None if owner is None else cls(system, plan, order, h, kernel, owner.effort)

    def side_by_side(self) -> CompiledSteps:
        """The same steps compiled for many states at once: the numbers of a state do not depend on its neighbours."""
        return self._with_kernel(self.system, self.plan, self.order, self.h, lone=False) or self

    @staticmethod
    def recurrence(plan: SimulatedStep) -> Recurrence:
        """What is compiled: whole steps."""
        return plan.recurrence()

    def take(self, y: Array, steps: int, h: float | None = None) -> tuple[Array, Array, Array]:
        """States before and after each step, (..., steps + 1, size), and what is said of each as it begins.

        That is the accelerations (..., steps, nv), and how far each contact is from touching, (..., steps, contacts).
        ``y`` (..., size) is the first of these states.
        """
        return self.taken(y, steps, self.h if h is None else h, self.told())

    def told(self) -> list[Array]:
        """What a step is given but its length, where nothing of it is a function."""
        given = {"tau": self.system.held, **self.constants}
        return [given[name] for name in self.names]

    def taken(self, y: Array, steps: int, h: float, given: Sequence[Array]) -> tuple[Array, Array, Array]:
        """The same, where ``given`` (..., n) are told for all of the steps but their length."""
        s = self.system
        Y, ddq = np.empty((*y.shape[:-1], steps + 1, s.size)), np.empty((*y.shape[:-1], steps, s.nv))
        Y[..., 0, :] = y
        after = Y[..., 1:, :]
        rows = [x[..., None, :] for x in given]
        if steps > 1:
            rows = [np.broadcast_to(x, (*x.shape[:-2], steps, x.shape[-1])) for x in rows]
        before, ends = ([x[..., cut] for cut in self.cuts] for x in (y, after))
        gaps = np.empty((*ddq.shape[:-1], len(s.contacts)))
        said = (ddq, gaps) if s.contacts else (ddq,)
        self.kernel(*before, 0.0, np.full(steps, h), *rows, out=(*ends, np.empty(ddq.shape[:-1]), *said))
        s.evaluations += self.stages * steps
        return Y, ddq, gaps

    def after(self, _t: Any, y: Array, h: float) -> Array:
        """The states a time h after states (..., size)."""
        return self.take(y, 1, h)[0][..., 1, :]

    def begun(self, t: Any, y: Array, h: float) -> tuple[Array, Array]:
        """The same, and the accelerations (..., nv) at these states."""
        if self.system.braked is not None:  # whose accelerations are those of a step of the usual length
            return self.after(t, y, h), self.accelerations(t, y)
        Y, ddq, _ = self.take(y, 1, h)
        return Y[..., 1, :], ddq[..., 0, :]

    def accelerations(self, _t: Any, y: Array) -> Array:
        """Of states (..., size), (..., nv), those that a step begins with."""
        found = self.take(y, 1, self.h)[1][..., 0, :]
        self.system.evaluations += 1 - self.stages  # of the step only what it begins with was asked for
        return found
