"""Statics: what torques a robot's joints can turn into wrenches, payloads, and footholds. Modern Robotics section 5.2."""

from __future__ import annotations

from .contacts import Contact
from .directions import LargestWrench, largest_wrench, weakest_direction
from .ellipsoid import WrenchEllipsoid, wrench_ellipsoid
from .equilibrium import Equilibrium, body_equilibrium, robot_equilibrium
from .map import PayloadMap, payload_map
from .payload import LargestPayload, RegionPayload, largest_payload, payload_in_region, torques_per_kilogram
from .polytope import WrenchPolytope, wrench_polytope
from .torques import TorqueWrench, wrench_from_torques

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
