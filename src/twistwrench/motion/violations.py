"""The one check of a motion against limits: which are passed, by how much, and when it is worst."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..core.printed_numbers import number
from ..model.limits import margin
from ..model.mimic import follower_torques
from ..typing import Array
from .bounds import Bounds
from .column_extremes import Extreme

if TYPE_CHECKING:
    from ..model.model import Model
    from ..robot import Robot

KINDS = ("position", "velocity", "acceleration", "torque")


@dataclass(frozen=True)
class Violation:
    """A limit that a motion passes, and where it does so most."""

    joint: str
    """Name of the joint."""
    kind: str
    """``position``, ``velocity``, ``acceleration`` or ``torque``."""
    value: float
    """The value, in the unit of the limit."""
    limit: float
    """With the sign of the value, where it limits a magnitude."""
    time: float
    """s."""

    @property
    def by(self) -> float:
        """How far beyond, above zero, in the unit of the limit."""
        return abs(self.value - self.limit)

    def __str__(self) -> str:
        return (
            f"{self.joint}: {self.kind} {number(self.value, 5)} beyond {number(self.limit, 5)} at {number(self.time)} s"
        )


class LimitCheck:
    """Takes in states, in any portions, and tells the limits they pass.

    Joints of several coordinates have no limits of position: theirs are infinite. Values past a limit by less than
    ``bounds.tolerance`` are at it.
    """

    def __init__(self, model: Model, bounds: Bounds) -> None:
        self.model, self.bounds = model, bounds
        self._worst = {kind: Extreme(model.nv) for kind in KINDS}
        self._values = {kind: np.zeros(model.nv) for kind in KINDS}
        self._followers = [model.bodies[i] for i in model.limited_followers]
        self._borne, self._borne_signed = Extreme(len(self._followers)), np.zeros(len(self._followers))

    def add(self, time: Array, q: Array, dq: Array, ddq: Array | None = None, tau: Array | None = None) -> None:
        """States at times (n,): q (n, nq), dq, ddq and torques (n, nv); None: not looked at."""
        for kind, values in zip(KINDS, (self.model.positions(q), dq, ddq, tau), strict=True):
            if values is None:
                continue
            for joint, row in self._worst[kind].add(time, self.bounds.excess(kind, values)):
                self._values[kind][joint] = values[row, joint]

    def add_dynamics(self, robot: Robot, time: Array, q: Array, dq: Array, ddq: Array) -> None:
        """Take in what mimic joints with a limit of effort bear in these states, friction left out."""
        if self._followers:
            self.add_borne(time, follower_torques(self.model, np.asarray(robot.joint_wrenches(q, dq, ddq))))

    def add_borne(self, time: Array, borne: Array) -> None:
        """Take in what those joints bear (n, k) at times (n,)."""
        for k, row in self._borne.add(time, np.abs(borne)):
            self._borne_signed[k] = borne[row, k]

    def violations(self) -> tuple[Violation, ...]:
        """The limits passed, worst first by their share of the limit."""
        found = []
        for kind, worst in self._worst.items():
            allowed = self.bounds.tolerance(kind)
            for k in np.flatnonzero(worst.value > allowed):
                value = float(self._values[kind][k])
                share = float(worst.value[k] / allowed[k]) if allowed[k] > 0 else np.inf
                limit = self._limit(kind, int(k), value)
                name = self.model.velocity_names[k]
                found.append((share, Violation(name, kind, value, limit, float(worst.time[k]))))
        for i, body in enumerate(self._followers):
            value, beyond = float(self._borne_signed[i]), float(self._borne.value[i] - body.effort)
            slack = float(margin(body.effort))
            if beyond > slack:
                limit, time = float(np.copysign(body.effort, value)), float(self._borne.time[i])
                found.append((beyond / slack, Violation(body.joint.name, "torque", value, limit, time)))
        return tuple(v for _, v in sorted(found, key=lambda item: -item[0]))

    def _limit(self, kind: str, k: int, value: float) -> float:
        if kind == "position":
            return float(self.bounds.upper[k] if value > self.bounds.upper[k] else self.bounds.lower[k])
        return float(np.copysign(self.bounds.limit(kind)[k], value))
