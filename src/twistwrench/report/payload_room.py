"""How heavy a payload may be along a motion: torques are linear in its mass, so the least quotient of all samples is that."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..core.printed_numbers import number, seconds
from ..typing import Array
from .limit_doubts import unlimited
from .loaded_robot import LoadedRobot, least_torque_per_kilogram


@dataclass(frozen=True)
class PayloadRoom:
    """The largest mass of the one payload with which every torque of a motion is within its limit."""

    mass: float
    """kg."""
    joint: str
    """The joint that is then at its limit."""
    time: float
    """When [s]."""

    @property
    def words(self) -> str:
        """A sentence; the mass is rounded down."""
        step = 10.0 ** (math.floor(math.log10(self.mass)) - 3) if self.mass > 0 else 1.0
        most = number(math.floor(self.mass / step) * step)
        when = f"{self.joint} reaches its limit at t = {seconds(self.time)} s"
        return f"By the joints' torque limits, a payload there may have up to {most} kg: {when}."


class PayloadRoomTally:
    """Takes in torques, in any portions.

    It tells nothing of several payloads, and where friction grows with the load, which makes torques no straight line.
    """

    def __init__(self, load: LoadedRobot, effort: Array) -> None:
        laws = load.bare.model.friction
        self.asked = len(load.payloads) == 1 and load.payloads[0].mass > 0 and not (load.friction and laws.load.any())
        followers = [load.bare.model.bodies[i] for i in load.bare.model.limited_followers]
        self._names = (*load.bare.model.velocity_names, *(body.joint.name for body in followers))
        self._load, self._effort = load, np.array([*effort, *(body.effort for body in followers)], float)
        self._share, self._joint, self._time = math.inf, 0, math.nan
        self._alone = True
        self._carried = np.zeros(len(self._names))
        self._least = load.payloads[0].mass * least_torque_per_kilogram(load.bare.model) if self.asked else 0.0

    def add(self, time: Array, torques: Array, carried: Array) -> None:
        """Torques (n, nv + k) at times (n,), of joints and of followers with limits, and what the payload adds to them."""
        alone = torques - carried
        self._carried = np.maximum(self._carried, np.abs(carried).max(axis=0, initial=0.0))
        self._alone = self._alone and bool((np.abs(alone) <= self._effort).all())
        limit = np.copysign(self._effort, carried)
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.where(
                np.abs(carried) > self._least, (limit - alone) / carried, np.inf
            )  # alone + share carried = limit
        row, joint = np.unravel_index(int(np.nanargmin(share)), share.shape)
        if share[row, joint] < self._share:
            self._share, self._joint, self._time = float(share[row, joint]), int(joint), float(time[row])

    def result(self) -> PayloadRoom | None:
        """None where it cannot be told: a joint that it loads has no limit, or the robot alone is beyond one."""
        if not self.asked or not self._alone or not math.isfinite(self._share):
            return None
        nv = self._load.bare.nv
        if unlimited(self._load.bare.model, self._effort[:nv], self._carried[:nv]):
            return None
        return PayloadRoom(self._share * self._load.payloads[0].mass, self._names[self._joint], self._time)
