"""Rotations and rigid motions: SO(3), SE(3), their algebras and adjoints. NumPy operators only, so they can be traced."""

from __future__ import annotations
