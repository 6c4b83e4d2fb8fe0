"""Where the power goes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..core.printed_numbers import printed
from ..typing import Array


class PowerBalance(NamedTuple):
    """Powers into the mechanism, W; what leaves it is negative, and they add up to zero."""

    joints: Array
    """τ'dq, from the joints."""
    motion: Array
    """Into motion: minus the rate of kinetic and potential energy, springs' included."""
    wrenches: Array
    """At the wrenches: minus what the robot does to the world there."""
    friction: Array
    """Lost in the joints."""

    def __str__(self) -> str:
        if np.ndim(self.joints):
            return f"<PowerBalance of states {np.shape(self.joints)}>"
        parts = ", ".join(f"{name} {printed(float(value), 4, signed=True)} W" for name, value in self._asdict().items())
        return f"into the mechanism from: {parts}"


def power_balance(dq: Array, tau: Array, moving: Array, pushing: Array, lost: Array) -> PowerBalance:
    """From the torques τ and what they are spent on: M ddq + h, Σ J'F, and friction; (..., nv) each."""
    return PowerBalance(*(np.sum(x * dq, axis=-1) for x in (tau, -moving, -pushing, -lost)))
