"""Statics: wrenches, payloads and footholds from joint torques, and clearance between links. Modern Robotics section 5.2."""

from __future__ import annotations

from .clearance import Clearance
from .contacts import Contact
from .equilibrium import (
    Equilibrium,
    TorqueWrench,
    body_equilibrium,
    least_norm_contact_forces,
    robot_equilibrium,
    wrench_from_torques,
)
from .force_capability import (
    LargestWrench,
    WrenchEllipsoid,
    WrenchPolytope,
    largest_wrench,
    weakest_direction,
    wrench_ellipsoid,
    wrench_polytope,
)
from .payload import (
    LargestPayload,
    PayloadMap,
    RegionPayload,
    largest_payload,
    payload_in_region,
    payload_map,
    torques_per_kilogram,
)
from .reactions import BearingLoads, MountingLoad, bearing_loads, bolt_circle, mounting_load
from .support import Support, hold, support

__all__ = [
    "BearingLoads",
    "Clearance",
    "Contact",
    "Equilibrium",
    "LargestPayload",
    "LargestWrench",
    "MountingLoad",
    "PayloadMap",
    "RegionPayload",
    "Support",
    "TorqueWrench",
    "WrenchEllipsoid",
    "WrenchPolytope",
    "bearing_loads",
    "body_equilibrium",
    "bolt_circle",
    "hold",
    "largest_payload",
    "largest_wrench",
    "least_norm_contact_forces",
    "mounting_load",
    "payload_in_region",
    "payload_map",
    "robot_equilibrium",
    "support",
    "torques_per_kilogram",
    "weakest_direction",
    "wrench_ellipsoid",
    "wrench_from_torques",
    "wrench_polytope",
]
