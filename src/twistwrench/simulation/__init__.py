"""Simulation of robots under torques, wrenches, friction and contacts, with error estimates.

The entry point is ``robot.simulate``. This package holds the types of its arguments and results.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..robot.doors import RobotDoors
from .contact import JointStops, Plane
from .events import Event, Happening
from .preparation import SimulationBatch
from .result import SimulationResult
from .schemes import METHODS, Partitioned, Tableau
from .torque_laws import BatchComputedTorque, BatchPD

if TYPE_CHECKING:
    from .rollout import Rollout
    from .rollout_gradient import RolloutGradient

PD, ComputedTorque = BatchPD, BatchComputedTorque  # former names
simulate = RobotDoors.simulate

__all__ = [
    "METHODS",
    "BatchComputedTorque",
    "BatchPD",
    "Event",
    "Happening",
    "JointStops",
    "Partitioned",
    "Plane",
    "Rollout",
    "RolloutGradient",
    "SimulationBatch",
    "SimulationResult",
    "Tableau",
    "simulate",
]


def __getattr__(name: str) -> object:  # simulations need no rollouts
    if name not in ("Rollout", "RolloutGradient"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from . import rollout

    return getattr(rollout, name)
