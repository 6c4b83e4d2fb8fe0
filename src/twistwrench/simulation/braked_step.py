"""The step of velocities that rollouts take, as a kernel of its own for simulations, whose forces come from Python."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..algorithms.velocity_step import velocity_step
from ..model.regroup import regrouped
from ..program.program import Program
from ..program.trace import trace
from .manifold import Manifold

if TYPE_CHECKING:
    from ..robot import Robot

Array = NDArray[Any]

__all__ = ["BrakedStep"]


class BrakedStep:
    """:func:`~twistwrench.algorithms.velocity_step.velocity_step` of one robot, compiled."""

    def __init__(self, robot: Robot, usual: float, *, friction: bool, gains: Array | None) -> None:
        from ..robot import _make_kernel

        self.usual, self.friction = usual, friction
        """The length of a step [s], unless said otherwise."""
        self.gains = np.zeros(robot.nv) if gains is None else gains
        key = "braked step", friction, gains is not None
        if key not in robot._kernels:
            robot._require_invertible()
            doc = f"Velocities of {robot.name} after a step, compiled."
            robot._kernels[key] = _make_kernel(_program(robot, friction, gains is not None), "braked step", doc)
        self.kernel = robot._kernels[key]

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
