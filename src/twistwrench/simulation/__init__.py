"""Simulation of robots under torques, wrenches, friction and contacts, with estimates of the error.

``robot.simulate`` is the door; what it takes beside numbers and functions, and what it gives, is here.
"""

from __future__ import annotations

from ..robot.shared_methods import SharedMethods
from .contact import JointStops, Plane
from .events import Event, Happening
from .preparation import SimulationBatch
from .result import SimulationResult
from .rollout import Rollout
from .rollout_gradient import RolloutGradient
from .schemes import METHODS, Partitioned, Tableau
from .torque_laws import BatchComputedTorque, BatchPD

PD, ComputedTorque = BatchPD, BatchComputedTorque  # former names
simulate = SharedMethods.simulate

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
