"""Revolute and continuous joints: they turn about an axis, between limits or without end."""

from __future__ import annotations

from .screw_joint import ScrewJoint


class Revolute(ScrewJoint):
    """Turns about its axis."""

    kind = "revolute"


class Continuous(ScrewJoint):
    """Turns about its axis without limits."""

    kind = "continuous"
    wraps = (0,)
