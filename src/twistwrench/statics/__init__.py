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
from .feet import base_from_stance, find_feet, patch, sole, wheel
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
    "base_from_stance",
    "bearing_loads",
    "body_equilibrium",
    "bolt_circle",
    "find_feet",
    "hold",
    "largest_payload",
    "largest_wrench",
    "least_norm_contact_forces",
    "mounting_load",
    "patch",
    "payload_in_region",
    "payload_map",
    "robot_equilibrium",
    "sole",
    "support",
    "torques_per_kilogram",
    "weakest_direction",
    "wheel",
    "wrench_ellipsoid",
    "wrench_from_torques",
    "wrench_polytope",
]
