"""Joint types, one file per family, with a common interface."""

from __future__ import annotations

from collections.abc import Mapping

from .fixed_joint import Fixed
from .joint import ChartEntry, Joint, Slider
from .multi_dof import Ball, Floating, Planar
from .screw_joint import Continuous, Helical, Prismatic, Revolute, RotorJoint

__all__ = ["JOINT_TYPES", "ChartEntry", "Fixed", "Floating", "Joint", "Planar", "RotorJoint", "Slider"]

JOINT_TYPES: Mapping[str, type[Joint]] = {
    joint.kind: joint for joint in (Revolute, Continuous, Prismatic, Helical, Planar, Floating, Ball)
}
"""Types of moving joints by name. ``fixed`` joints are fused into links; rotors come with actuators."""
