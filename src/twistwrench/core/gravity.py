"""Default gravity, and the weight of a kilogram."""

from __future__ import annotations

GRAVITY = (0.0, 0.0, -9.81)
"""Acceleration of gravity in a frame whose z axis points up [m/s²]. MR section 8.1."""

STRENGTH = -GRAVITY[2]
"""Magnitude of gravity [m/s²]."""

KGF = 9.80665
"""Weight of a kilogram, for files with kilograms as a unit of force [N]."""
