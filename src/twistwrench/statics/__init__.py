"""Statics: wrenches, payloads and footholds from joint torques, and clearance between links. Modern Robotics section 5.2."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from .support import Support, hold, support  # imported now, since file and function have the same name

if TYPE_CHECKING:
    from .clearance import Clearance
    from .contacts import Contact
    from .equilibrium import Equilibrium, body_equilibrium, least_norm_contact_forces, robot_equilibrium
    from .feet import find_feet, patch, sole, wheel
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
    from .stance import base_from_stance
    from .torque_wrench import TorqueWrench, wrench_from_torques

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

_FILES = {
    "Clearance": "clearance",
    "Contact": "contacts",
    "Equilibrium": "equilibrium",
    "body_equilibrium": "equilibrium",
    "least_norm_contact_forces": "equilibrium",
    "robot_equilibrium": "equilibrium",
    "find_feet": "feet",
    "patch": "feet",
    "sole": "feet",
    "wheel": "feet",
    "LargestWrench": "force_capability",
    "WrenchEllipsoid": "force_capability",
    "WrenchPolytope": "force_capability",
    "largest_wrench": "force_capability",
    "weakest_direction": "force_capability",
    "wrench_ellipsoid": "force_capability",
    "wrench_polytope": "force_capability",
    "LargestPayload": "payload",
    "PayloadMap": "payload",
    "RegionPayload": "payload",
    "largest_payload": "payload",
    "payload_in_region": "payload",
    "payload_map": "payload",
    "torques_per_kilogram": "payload",
    "BearingLoads": "reactions",
    "MountingLoad": "reactions",
    "bearing_loads": "reactions",
    "bolt_circle": "reactions",
    "mounting_load": "reactions",
    "base_from_stance": "stance",
    "TorqueWrench": "torque_wrench",
    "wrench_from_torques": "torque_wrench",
}
"""File of each name. It is imported on first use: clearance reads shapes, which a command about feet does not need."""


def __getattr__(name: str) -> object:
    if name not in _FILES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value: object = getattr(import_module(f".{_FILES[name]}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
