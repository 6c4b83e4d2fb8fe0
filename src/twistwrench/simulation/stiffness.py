"""Stiffness: forces so steep that an explicit method must keep its steps short to be stable, whatever its tolerance.

The last two stages of Dormand and Prince's method are at the end of the step, at two states z and y1. The difference of their
rates over the difference of the states estimates the largest eigenvalue λ of the equations, and the method is stable up to
h λ of about 3.3. Source: Hairer and Wanner, Solving Ordinary Differential Equations II, section IV.2.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..core.printed_numbers import printed, residual
from ..errors import SimulationError
from ..typing import Array
from .forces import WORKS, System
from .schemes import RungeKutta

_EDGE = 3.25
"""h λ above which a step is as long as stability allows."""
_WINDOW = 3000
"""Steps tried between two looks at how far they lead: some seconds."""
_STIFF_SHARE = 0.1
"""Share of the steps of a window at the edge of stability from which the equations are stiff there."""
_MOST_TO_COME = 100_000
"""Steps still to be taken from which a stiff run is ended: more than a minute."""


class Stiffness:
    """The steps tried since the last look, and how many of them were as long as stability allows."""

    def __init__(self, system: System, scheme: RungeKutta, duration: float) -> None:
        self.system, self.scheme, self.duration = system, scheme, duration
        self._tried = self._at_edge = 0
        self._begin = 0.0
        self.stages: Callable[[], Array] = lambda: scheme.K
        """The rates of the stages of the last step tried."""

    def look(self, t: float, h: float, y: Array, y1: Array) -> None:
        """Take note of a step from y at t that was tried. Raises SimulationError where the run would hardly end."""
        K, moving = self.scheme.K, slice(0, self.system.size - len(WORKS))
        z = y + h * np.dot(self.scheme.a[-2], K[:-2])
        self.note(t, h, h * float(np.linalg.norm((K[-1] - K[-2])[moving])), float(np.linalg.norm((y1 - z)[moving])))

    def note(self, t: float, h: float, steep: float, away: float) -> None:
        """The same, of two states so far away from each other, whose rates differ by ``steep`` / h."""
        self._tried += 1
        self._at_edge += steep > _EDGE * away > 0.0
        if self._tried < _WINDOW:
            return
        mean = (t - self._begin) / self._tried
        if self._at_edge > _STIFF_SHARE * self._tried and self.duration - t > _MOST_TO_COME * mean:
            K = self.stages()
            raise SimulationError(self._words(t, h, mean, (K[-1] - K[-2])[self.system.moving]))
        self._tried, self._at_edge, self._begin = 0, 0, t

    def _words(self, t: float, h: float, mean: float, change: Array) -> str:
        names, friction = self.system.robot.model.velocity_names, self.system.friction
        worst = int(np.argmax(np.abs(change)))
        often = f"some {printed((self.duration - t) / mean, 1)}" if mean > 0.0 else "endlessly many"
        stiff = f"at t = {printed(t)} s the equations are stiff"
        said = f"{stiff}: stability needs steps of {residual(h)} s, {often} more to the end"
        if friction is not None and friction.dry[worst]:
            return (
                f"{said}. Dry friction of joint {names[worst]!r} is eased off below {printed(friction.creep[worst], 2)} "
                "rad/s or m/s, "
                'which is steep for so light a joint. Take method="semi_implicit", in whose steps friction stops joints and '
                "holds them; or a larger creep=."
            )
        return (
            f"{said}, most of all in joint {names[worst]!r}: a torque, a wrench or a contact there is steep for so light a "
            'joint. Take less gain or stiffness, or method="semi_implicit", which takes viscous friction, and the kd of a '
            "tw.control.PD given as tau=, at the end of its steps."
        )
