"""Statics: what torques a robot's joints can turn into wrenches, payloads, and footholds. Modern Robotics section 5.2."""

from __future__ import annotations

from .contacts import Contact
from .ellipsoid import WrenchEllipsoid, wrench_ellipsoid
from .equilibrium import Equilibrium, body_equilibrium, robot_equilibrium
from .force_directions import LargestWrench, largest_wrench, weakest_direction
from .holding_torques import TorqueWrench, wrench_from_torques
from .payload import LargestPayload, RegionPayload, largest_payload, payload_in_region, torques_per_kilogram
from .payload_map import PayloadMap, payload_map
from .polytope import WrenchPolytope, wrench_polytope

__all__ = [
    "Contact",
    "Equilibrium",
    "LargestPayload",
    "LargestWrench",
    "PayloadMap",
    "RegionPayload",
    "TorqueWrench",
    "WrenchEllipsoid",
    "WrenchPolytope",
    "body_equilibrium",
    "largest_payload",
    "largest_wrench",
    "payload_in_region",
    "payload_map",
    "robot_equilibrium",
    "torques_per_kilogram",
    "weakest_direction",
    "wrench_ellipsoid",
    "wrench_from_torques",
    "wrench_polytope",
]
