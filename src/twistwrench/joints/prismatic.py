"""Prismatic joints: they slide along an axis."""

from __future__ import annotations

from .screw_joint import ScrewJoint


class Prismatic(ScrewJoint):
    """Slides along its axis."""

    kind = "prismatic"
    turns = False
