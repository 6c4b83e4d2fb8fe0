"""The force that a motion needs at a floating base. Nothing drives one, so it is of contacts that were not given."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from ..core.gravity import STRENGTH
from ..core.printed_numbers import percent, quantity
from ..model.model import BASE, Model

_SHARE = 0.05
"""Of the robot's weight: less is what masses in files and derived accelerations are off by."""
_WEIGHTLESS = 0.001
"""Of what the robot would weigh on earth: less is rounding and noise of the log where gravity is weak, or none."""
_SURE = 5.0
"""Standard deviations."""


class PeakTorque(Protocol):
    """The largest torque that one velocity needs."""

    @property
    def peak(self) -> float:
        """N m or N."""

    @property
    def uncertainty(self) -> float:
        """Its standard deviation."""

    @property
    def unit(self) -> str:
        """``N m`` or ``N``."""


def missing_force(model: Model, joints: Sequence[PeakTorque]) -> float:
    """The largest force that a floating base needs from outside [N]; 0 where the base is none, or that is next to nothing."""
    rows = [
        joints[k]
        for body in model.leaders
        if body.parent == BASE and not body.joint.driven
        for k in range(body.v_index, body.v_index + body.joint.nv)
    ]
    forces = [max(abs(j.peak) - _SURE * j.uncertainty, 0.0) for j in rows if j.unit == "N"]
    largest = max(forces, default=0.0)
    least = max(_SHARE * _weight(model), _WEIGHTLESS * STRENGTH * model.moving_mass)
    return largest if largest > least else 0.0


def force_in_words(model: Model, force: float) -> str:
    """How much the base needs."""
    weight = _weight(model)
    share = f", {percent(force / weight)} of the robot's weight" if weight else ""
    return f"Nothing drives the base, but the motion needs {quantity(force, 'N')} there{share}"


def force_remark(model: Model, joints: Sequence[PeakTorque]) -> str:
    """What that means, and what to do about it; empty where no force is missing."""
    if not (force := missing_force(model, joints)):
        return ""
    return (
        f"{force_in_words(model, force)}. The joints' torques lack what contacts take: constant wrenches are given with "
        "--wrench-on-robot FRAME:…, others in Python, to robot.inverse_dynamics. If something holds the base in truth, as a "
        "stand does, the torques are right."
    )


def _weight(model: Model) -> float:
    return model.moving_mass * float(np.linalg.norm(model.gravity))
