"""Gravity where nothing else is said, and the weight of a kilogram: the one place of both."""

from __future__ import annotations

GRAVITY = (0.0, 0.0, -9.81)
"""Acceleration of gravity in a frame whose z axis points up [m/s²]. MR section 8.1."""

STRENGTH = -GRAVITY[2]
"""Its size [m/s²]."""

KGF = 9.80665
"""The weight of a kilogram where kilograms are a unit of force [N]."""
