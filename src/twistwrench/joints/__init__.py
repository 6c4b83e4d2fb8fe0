"""Joint types, one file each, all with the same functions: the only place that knows which types there are."""

from __future__ import annotations

from collections.abc import Mapping

from .ball import Ball
from .fixed import Fixed
from .floating import Floating
from .helical import Helical
from .joint import ChartEntry, Joint, Slider
from .planar import Planar
from .prismatic import Prismatic
from .revolute import Continuous, Revolute
from .rotor import RotorJoint

__all__ = ["JOINT_TYPES", "ChartEntry", "Fixed", "Floating", "Joint", "RotorJoint", "Slider"]

JOINT_TYPES: Mapping[str, type[Joint]] = {
    joint.kind: joint for joint in (Revolute, Continuous, Prismatic, Helical, Planar, Floating, Ball)
}
"""The types of moving joints that may be named. ``fixed`` joints are fused away; rotors come with actuators."""
