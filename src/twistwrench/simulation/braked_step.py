"""The step of velocities that rollouts take, as a kernel of its own for simulations, whose forces come from Python."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ..algorithms.velocity_step import velocity_step
from ..model.base_parameters import regrouped
from ..program.program import Program
from ..program.trace import trace
from ..robot.model_kernels import compiled
from ..typing import Array
from .eased_friction import rubs_dry
from .manifold import Manifold

if TYPE_CHECKING:
    from ..robot import Robot


class BrakedStep:
    """:func:`~twistwrench.algorithms.velocity_step.velocity_step` of one robot, compiled."""

    def __init__(self, robot: Robot, usual: float, *, friction: bool, gains: Array | None) -> None:
        self.usual, self.friction, self.gained = usual, friction, gains is not None
        """The length of a step [s], unless said otherwise; whether there is friction; whether there are gains."""
        self.dry = rubs_dry(robot.model) & friction
        """Joints with dry friction, (nv,)."""
        self.gains = np.zeros(robot.nv) if gains is None else gains
        self._robot = robot

    @cached_property
    def kernel(self) -> Any:
        """(q, dq, h, tau, push, gains) to velocities, torques applied and those of friction; made where it is needed."""
        robot = self._robot

        def made() -> Any:
            robot.engine.require_invertible()
            doc = f"Velocities of {robot.name} after a step, compiled."
            return compiled(_program(robot, self.friction, self.gained), "braked step", doc)

        return robot.engine.kept(("braked step", self.friction, self.gained), made)

    def middle(self, manifold: Manifold, q: Array, dq: Array, h: float) -> Array:
        """Where the velocities change, (nq,): halfway with friction, at the beginning without."""
        return manifold.move(q, 0.5 * h * dq) if self.friction else q

    def end(self, manifold: Manifold, middle: Array, v: Array, h: float) -> Array:
        """Where the step ends, (nq,)."""
        return manifold.move(middle, (0.5 * h if self.friction else h) * v)

    def __call__(self, q: Array, dq: Array, h: float, tau: Array, push: Array) -> tuple[Array, Array, Array]:
        """Velocities after the step, torques applied in it, and those of friction; ``push`` is what else acts on the joints."""
        v, applied, lost = self.kernel(q, dq, h, tau, push, self.gains)
        return v, applied, lost


def _program(robot: Robot, friction: bool, gained: bool) -> Program:
    model, nv = regrouped(robot.model), robot.nv

    def step(q: Array, dq: Array, h: Any, tau: Array, push: Array, gains: Array) -> tuple[Array, Array, Array]:
        return velocity_step(model, q, dq, h, tau, gains=gains if gained else None, friction=friction, push=push)

    rest = [(name, (nv,)) for name in ("tau", "push", "gains")]
    return trace(step, [("q", (robot.nq,)), ("dq", (nv,)), ("h", ()), *rest], ["v", "applied", "friction"])
