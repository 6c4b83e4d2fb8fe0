"""All that acts on the robot, and the rates of its state that follow.

The state is one vector y = (q, dq, W): coordinates, velocities, and the work done so far by the torques of the joints, by
friction, by wrenches and by contacts. Works are integrated by the method that moves the robot, so that

    drift = E(t) - E(0) - W(t)

is the method's own error and nothing else.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core import arguments
from ..errors import ShapeError
from ..robot.wrench_arguments import wrench_at
from ..screws.wrench import Wrench
from ..typing import Array
from .braked_step import BrakedStep
from .eased_friction import EasedFriction
from .manifold import Manifold
from .robot_contact import RobotContact
from .user_functions import Law

if TYPE_CHECKING:
    from ..robot import Robot

WORKS = ("torques", "friction", "wrenches", "contacts")
"""What does work, in the order of the last entries of a state."""


class System:
    """A robot and what acts on it: y' = f(t, y)."""

    takes_many = True
    """Whether :meth:`of_many` serves."""

    def __init__(
        self,
        robot: Robot,
        *,
        tau: Law | None = None,
        wrenches: Mapping[str, Law] | None = None,
        contacts: Sequence[RobotContact] = (),
        friction: EasedFriction | None = None,
    ) -> None:
        self.robot, self.manifold = robot, Manifold(robot)
        self.nq, self.nv = robot.nq, robot.nv
        self.moving = slice(robot.nq, robot.nq + robot.nv)
        self.size = robot.nq + robot.nv + len(WORKS)
        self.tau, self.wrenches, self.contacts, self.friction = tau, dict(wrenches or {}), tuple(contacts), friction
        self.functions = self._functions()
        """What is given as a function: its name, and its generalised forces (m, nv) at times (m,) and states (m, size)."""
        self.braked: BrakedStep | None = None
        """Steps that take friction and gains of the rates at their end; rates are then those of such a step."""
        self._last: tuple[float, float, Array, Array, Array, Array, Array] | None = None
        self.held = np.zeros(robot.nv)
        """What the controller said last, (nv)."""
        self.applied = self.held
        """The torques at the joints when forces were last asked for, (nv)."""
        self.evaluations = 0

    def split(self, y: Array) -> tuple[Array, Array]:
        """q and dq of a state."""
        return y[: self.nq], y[self.moving]

    def allowed_velocities(self, y: Array) -> Array:
        """The velocities (..., nv) of states (..., size), what violates constraints taken away; an open robot has none."""
        return y[..., self.moving]

    def forces(self, t: float, q: Array, dq: Array, powers: Array) -> Array:
        """The generalised force of everything but gravity and springs, (nv); its powers are written to ``powers`` (4,) [W]."""
        tau = self._torques(t, q, dq)
        self.applied, total = tau, tau
        powers[0] = tau @ dq
        if self.friction is not None:
            total = self.friction.left(dq, tau)
            powers[1] = total @ dq - powers[0]
        for k, push in self._pushes(t, q, dq, q):
            total = total + push
            powers[k] += push @ dq
        return total

    def braked_step(self, t: float, y: Array, h: float, powers: Array) -> Array:
        """The velocities after a step of length ``h`` from a state; powers as by :meth:`forces`, their means over the step."""
        assert self.braked is not None
        last = self._last
        if last is not None and last[:2] == (t, h) and last[2] is self.held and np.array_equal(last[3], y):
            v, self.applied, powers[:] = last[4:]
            return v
        q, dq = self.split(y)
        middle = self.braked.middle(self.manifold, q, dq, h)
        pushes = list(self._pushes(t, q, dq, middle))
        push = sum((x for _, x in pushes), np.zeros(self.nv))
        v, self.applied, lost = self.braked(middle, dq, h, self._torques(t, q, dq), push)
        mean = 0.5 * (dq + v)
        powers[:] = self.applied @ mean, lost @ mean, 0.0, 0.0
        for k, x in pushes:
            powers[k] += x @ mean
        self._last = t, h, self.held, y.copy(), v, self.applied, powers.copy()
        return v

    def _functions(self) -> list[tuple[str, Callable[[Array, Array], Array]]]:
        def values(law: Law, times: Array, states: Array) -> Array:
            return law.values(times, states[:, : self.nq], states[:, self.moving])

        def pushes(frame: str, law: Law, times: Array, states: Array) -> Array:
            return self.robot.wrench_torques(states[:, : self.nq], values(law, times, states), frame)

        found: list[tuple[str, Callable[[Array, Array], Array]]] = []
        if self.tau is not None:
            found.append(("tau", partial(values, self.tau)))
        found += [(f"the wrench at {f!r}", partial(pushes, f, law)) for f, law in self.wrenches.items() if law.varies]
        return found

    def _torques(self, t: float, q: Array, dq: Array) -> Array:
        """Those of the controller and of ``tau``, (nv,)."""
        return self.held if self.tau is None else self.held + self.tau(t, q, dq)

    def _pushes(self, t: float, q: Array, dq: Array, at: Array) -> Iterator[tuple[int, Array]]:
        """What each wrench, at the place ``at`` (nq,), and each contact does to the joints, (nv,), and where its power goes."""
        for frame, law in self.wrenches.items():
            yield 2, self.robot.wrench_torques(at, law(t, q, dq), frame)
        for contact in self.contacts:
            touched = contact.torques(q, dq)
            if touched is not None:
                yield 3, touched

    def rates(self, t: float, y: Array, out: Array) -> None:
        """Write f(t, y) into ``out``."""
        self.evaluations += 1
        q, dq, powers = y[: self.nq], y[self.moving], out[-4:]
        powers[:] = 0.0
        self.manifold.rates(q, dq, out[: self.nq])
        if self.braked is not None:
            h = self.braked.usual
            out[self.moving] = (self.braked_step(t, y, h, powers) - dq) / h
            return
        force = self.forces(t, q, dq, powers)
        out[self.moving] = self.robot.forward_dynamics(q, dq, force)

    def of_many(self, times: Array, states: Array) -> tuple[Array, Array]:
        """Accelerations and torques at the joints, (m, nv), at times (m,) and states (m, size); an open robot's."""
        self.evaluations += len(states)
        q, dq = states[:, : self.nq], states[:, self.moving]
        tau = total = (
            np.broadcast_to(self.held, dq.shape) if self.tau is None else self.held + self.tau.values(times, q, dq)
        )
        if self.friction is not None:
            total = self.friction.left(dq, total)
        for frame, law in self.wrenches.items():
            F = law.values(times, q, dq) if law.varies else law(0.0, q, dq)
            total = total + self.robot.wrench_torques(q, F, frame)
        for contact in self.contacts:
            touched = contact.torques(q, dq)
            if touched is not None:
                total = total + touched
        return np.asarray(self.robot.forward_dynamics(q, dq, total)), tau

    def accelerations(self, t: float, y: Array) -> Array:
        """Of a state, (nv,)."""
        rate = np.zeros(self.size)
        self.rates(t, y, rate)
        return rate[self.moving]


def torque_law(tau: Any, nv: int) -> tuple[Array, Law | None]:
    """Constant torques (nv), and torques as a function; one of them is nothing."""
    if tau is None:
        return np.zeros(nv), None
    if callable(tau):
        return np.zeros(nv), Law.of(tau, "tau", (nv,), ", a torque for each velocity")
    return np.array(arguments.finite(arguments.one(tau, "tau", nv), "tau", nv), float), None


def wrench_laws(robot: Robot, wrenches: Any) -> dict[str, Law]:
    """A law for each frame of ``{frame: (m, f) or a function}``, what the world applies to the robot there."""
    if wrenches is None:
        return {}
    if not isinstance(wrenches, Mapping):
        raise ShapeError("wrench_on_robot is a dict {frame: (m, f) or a function of (t, q, dq)}.")
    found = {}
    for frame, given in wrenches.items():
        robot.model.frame(frame)
        what = f"the wrench at {frame!r}"
        if callable(given) and not isinstance(given, Wrench):
            found[frame] = Law.of(given, what, (6,), ", (m, f), moment first")
        else:
            labelled = wrench_at(robot.model, frame, given)  # checks a label
            F = np.array(arguments.finite(arguments.one(labelled, what, 6), what, 6), float)
            found[frame] = Law(lambda _t, _q, _dq, F=F: F, what, (6,), varies=False)  # type: ignore[misc]
    return found
