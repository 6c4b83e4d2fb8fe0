"""A robot with closed loops and what acts on it: its rates are those of constrained dynamics, its steps end on the constraints.

    q̈ and λ of  τ = M q̈ + h + A'λ,  A q̈ + (dA/dt) dq = 0       (MR section 8.7)

hold the acceleration only, so after each step q and dq are projected: see :mod:`twistwrench.algorithms.loop_projection`.
"""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numpy as np

from ..algorithms.constraints import kept, with_gaps
from ..algorithms.loop_projection import LoopRows, projected
from ..algorithms.weighted_svd import SAFE, doubtful
from ..core.printed_numbers import printed
from ..errors import SimulationError, ValueRangeError
from ..kernels.ufunc import owner_of
from ..program.trace import trace
from ..robot import closed_robot_checks as checks
from ..robot.constraint_sizes import CLOSED, gap_units
from ..robot.model_kernels import compiled
from ..typing import Array
from .adaptive import Stepper
from .closed_step import SMALL, ClosedStep, lost
from .forces import WORKS, System
from .schemes import ADAPTIVE, Scheme
from .step_program import Plan

if TYPE_CHECKING:
    from ..robot.closed_robot import ClosedRobot

CLOSED_METHODS = (ADAPTIVE, "rk4", "semi_implicit", "euler")
"""Those whose steps ask for nothing but rates; the variational ones know the open robot alone."""


class Loops:
    """The constraints of a closed robot as a simulation keeps to them, and what its steps left to be taken away."""

    def __init__(self, closed: ClosedRobot) -> None:
        self.closed, robot = closed, closed.robot
        self.with_gap = with_gaps(closed.constraints)
        self.kept = kept(closed.constraints, closed.independent)
        self._nq = robot.nq
        self._moving = slice(robot.nq, robot.nq + robot.nv)
        self._units = gap_units(closed)
        self._sizes = closed.sizes[list(closed.independent)] ** 2
        self._project = robot.engine.kept(("projection", closed.constraints, closed.independent), self._compiled)
        self.dynamics = robot.kernel("constrained_dynamics", constraints=self.kept)
        self.widest = self.fastest = 0.0
        """The largest gap [rad or m] and the largest rate of one [rad/s, m/s] that a step left, before they were taken away."""
        self.system: ClosedSystem
        """What acts on the robot, once it is known."""

    def _compiled(self) -> Any:
        closed, robot = self.closed, self.closed.robot

        def program(q: Array, dq: Array) -> tuple[Array, ...]:
            return projected(robot.model, q, dq, closed.constraints, closed.independent)

        names = ["q", "dq", "before", "rates", "after", "pivots"]
        doc = f"States of {robot.name} near its constraints, brought onto them, compiled."
        return compiled(trace(program, [("q", (robot.nq,)), ("dq", (robot.nv,))], names), "projection", doc)

    def effort(self, stages: int) -> float:
        """About how many operations a step of so many stages is; inf where nothing is compiled."""
        owners = owner_of(self._project), owner_of(self.dynamics)
        return sum(n * owner.effort if owner else np.inf for n, owner in zip((1, stages), owners, strict=True))

    def begin(self, y: Array) -> None:
        """Bring the first state onto the constraints, in place; ConstraintError where it is far from them."""
        q, dq = y[: self._nq], y[self._moving]
        checks.require_met(self.closed, q, dq)
        with np.errstate(all="ignore"):  # an inverse there may be none of
            smallest = self.smallest(y)
        if not smallest >= SAFE:
            raise ValueRangeError(
                "q0 is a singular configuration: the constraints lose rank there, and no motion goes on from it in one way "
                f"only. closed.rank(q0) is {int(self.closed.rank(q))}, usually {len(self.closed.independent)}: start elsewhere."
            )
        self.onto(0.0, y)
        self.widest = self.fastest = 0.0

    def smallest(self, y: Array) -> Array:
        """The smallest pivot of A M⁻¹ A' over its usual size, of states (..., size); 0 where the constraints lose rank."""
        return np.asarray(self.projected(y[..., : self._nq], y[..., self._moving])[-1])

    def projected(self, q: Array, dq: Array) -> tuple[Array, Array, Array]:
        """q (..., nq) and dq (..., nv) on the constraints, and the smallest pivot over its usual size (...)."""
        q, dq, *_, pivots = self._project(q, dq)
        return q, dq, (pivots / self._sizes).min(axis=-1, initial=np.inf)

    def step(self, t: float, h: float, y: Array, y1: Array) -> None:
        """Bring the state after a step from y at t onto the constraints, in place."""
        if not np.isfinite(y1).all():  # said where steps are looked at
            return
        smallest = self.onto(t + h, y1)
        if not smallest >= SMALL and lost(np.array(smallest), self.smallest(y)):
            raise SimulationError(
                f"at t = {printed(t + h, 9)} s the constraints lose rank: {', '.join(self.closed.row_names)} hold the "
                "robot in fewer directions at a singular configuration, from which the motion may go on in several ways. "
                "Change the mechanism or the motion so that it stays away, or take a smaller dt where it only comes near."
            )

    def step_of(self, plan: Plan, *, works: bool = False) -> ClosedStep:
        """The step of a plan, on the constraints."""
        made_of = {each.name: getattr(plan, each.name) for each in fields(Plan)}
        rows = LoopRows(self.closed.constraints, self.closed.independent)
        usual, allowed = (tuple(x.tolist()) for x in (self._sizes, CLOSED * self._units))
        return ClosedStep(**made_of, loops=rows, usual=usual, allowed=allowed, works=works)

    def note(self, gap: float, rate: float) -> None:
        """Take note of the largest that a step left to be taken away, gap and rate."""
        self.widest, self.fastest = max(self.widest, float(gap)), max(self.fastest, float(rate))

    def onto(self, t: float, y: Array) -> float:
        """Bring a state onto the constraints, in place; gives the smallest pivot over its usual size."""
        q, dq, before, rates, after, pivots = self._project(y[: self._nq], y[self._moving])
        gap = float(np.abs(before).max(initial=0.0))
        if not np.abs(after / self._units).max(initial=0.0) <= CLOSED:
            found, left = self.closed.settled(y[None, : self._nq], CLOSED)
            if not (left[0] <= CLOSED and gap <= 1.0):
                raise SimulationError(
                    f"at t = {printed(t, 9)} s the loops cannot be closed again: the step left a gap of {printed(gap, 3)} "
                    f"(rad or m), and {printed(left[0], 3)} remains. Take a smaller dt."
                )
            q, dq, _, rates, _, pivots = self._project(found[0], y[self._moving])
        y[: self._nq], y[self._moving] = q, dq
        self.note(gap, np.abs(rates).max(initial=0.0))
        return float((pivots / self._sizes).min(initial=np.inf))


class ClosedSystem(System):
    """A closed robot and what acts on it: y' = f(t, y)."""

    takes_many = False

    def __init__(self, loops: Loops, **acting: Any) -> None:
        super().__init__(loops.closed.robot, **acting)
        self.done = slice(self.size - len(WORKS), self.size)
        """The works of a state."""
        self.loops, loops.system = loops, self

    def rates(self, t: float, y: Array, out: Array) -> None:
        """Write f(t, y) into ``out``."""
        self.evaluations += 1
        q, dq, powers = y[: self.nq], y[self.moving], out[-4:]
        powers[:] = 0.0
        self.manifold.rates(q, dq, out[: self.nq])
        out[self.moving] = self.loops.dynamics(q, dq, self.forces(t, q, dq, powers))[0]

    def allowed_velocities(self, y: Array) -> Array:
        """As :meth:`.System.allowed_velocities`: by the projection that ends a step."""
        with np.errstate(all="ignore"):  # a state that is no numbers has none
            return self.loops.projected(y[..., : self.nq], y[..., self.moving])[1]

    def multipliers(self, times: Array, q: Array, dq: Array, tau: Array) -> Array:
        """λ of states under the torques tau and all else that acts, (n, k); wrenches that are functions are asked again."""
        if not len(times):
            return np.zeros((0, len(self.loops.closed.sizes)))
        total = tau if self.friction is None else self.friction.left(dq, tau)
        for frame, law in self.wrenches.items():
            total = total + self.robot.wrench_torques(q, law.values(times, q, dq), frame)
        for contact in self.contacts:
            touched = contact.torques(q, dq)
            if touched is not None:
                total = total + touched
        _, lam, pivots = self.loops.dynamics(q, dq, total)
        closed = self.loops.closed
        if len(closed.independent) == len(closed.sizes) and not doubtful(pivots, closed.sizes).any():
            return np.asarray(lam)
        return np.asarray(closed.forward_dynamics(q, dq, total).lam)


class ClosedScheme:
    """A one-step method whose steps end on the constraints."""

    def __init__(self, scheme: Scheme, loops: Loops) -> None:
        self.scheme, self.loops = scheme, loops
        self.order, self.asked = scheme.order, scheme.asked

    @property
    def lagging(self) -> bool:
        """As of the method itself."""
        return self.scheme.lagging

    def step(self, t: float, y: Array, h: float, rate: Array, /) -> Array:
        """The state a time ``h`` later."""
        y1 = self.scheme.step(t, y, h, rate)
        self.loops.step(t, h, y, y1)
        return y1


class ClosedStepper(Stepper):
    """Dormand and Prince's method, whose steps and the states between them end on the constraints."""

    def __init__(self, loops: Loops, *rest: float) -> None:
        super().__init__(loops.system, *rest)
        self.loops = loops

    def step(self, t: float, y: Array, rate: Array, until: float) -> tuple[float, Array]:
        """Time and state after one step that is accepted, not beyond ``until``."""
        t1, y1 = super().step(t, y, rate, until)
        self.loops.step(t, t1 - t, y, y1)
        return t1, y1

    def between(self, times: Array) -> Array:
        """The states (m, size) at times (m,) within the last step."""
        states = super().between(times)
        for t, y in zip(times.tolist(), states, strict=True):
            self.loops.onto(t, y)
        return states
