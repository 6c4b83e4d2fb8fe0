"""Simulation of robots under torques, wrenches, friction and contacts, with error estimates.

The entry point is ``robot.simulate``. This package holds the types of its arguments and results.
"""

from __future__ import annotations

from ..robot.doors import RobotDoors
from .contact import JointStops, Plane
from .events import Event, Happening
from .preparation import SimulationBatch
from .result import SimulationResult
from .rollout import Rollout
from .rollout_gradient import RolloutGradient
from .schemes import METHODS, Partitioned, Tableau
from .torque_laws import BatchComputedTorque, BatchPD

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
