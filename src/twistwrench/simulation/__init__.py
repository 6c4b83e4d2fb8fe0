"""Simulation: how a robot moves under torques, wrenches, friction and contacts, by integrators that say how far they are off.

``robot.simulate`` is the door; what it takes beside numbers and functions, and what it gives, is here.
"""

from __future__ import annotations

from .batch import SimulationBatch, SimulationOptions
from .contact import JointStops, Plane
from .events import Event, Happening
from .result import SimulationResult
from .rollout import Rollout
from .schemes import METHODS
from .simulate import simulate
from .tableau import Partitioned, Tableau
from .torque_laws import BatchComputedTorque, BatchPD

PD, ComputedTorque = BatchPD, BatchComputedTorque  # former names

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
    "SimulationBatch",
    "SimulationOptions",
    "SimulationResult",
    "Tableau",
    "simulate",
]
