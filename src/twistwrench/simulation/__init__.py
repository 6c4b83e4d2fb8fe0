"""Simulation of robots under torques, wrenches, friction and contacts, with error estimates.

The entry point is ``robot.simulate``. This package holds the types of its arguments and results.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from ..robot.doors import RobotDoors
from .batch import SimulationBatch
from .contact import JointStops, Plane
from .events import Event, Happening
from .methods.schemes import METHODS
from .methods.tableaus import Partitioned, Tableau
from .result import SimulationResult
from .torque_laws import BatchComputedTorque, BatchPD

if TYPE_CHECKING:
    from ..mechanics.bodies.free_body import Flight
    from .closed import ClosedSimulation
    from .rollout import Rollout
    from .rollout_gradient import RolloutGradient

PD = BatchPD  # former name
ComputedTorque = BatchComputedTorque  # former name
simulate = RobotDoors.simulate

__all__ = [
    "METHODS",
    "BatchComputedTorque",
    "BatchPD",
    "ClosedSimulation",
    "Event",
    "Flight",
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


_MODULES_ON_FIRST_USE = {
    "ClosedSimulation": "simulation.closed",
    "Flight": "mechanics.bodies.free_body",
    "Rollout": "simulation.rollout",
    "RolloutGradient": "simulation.rollout",
}
"""Module of each type that most simulations do not need; it is imported when the type is first used."""


def __getattr__(name: str) -> object:
    if name not in _MODULES_ON_FIRST_USE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"twistwrench.{_MODULES_ON_FIRST_USE[name]}"), name)
