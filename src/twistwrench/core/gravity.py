"""Gravity where nothing else is said."""

from __future__ import annotations

GRAVITY = (0.0, 0.0, -9.81)
"""Acceleration of gravity in a frame whose z axis points up [m/s²]. MR section 8.1."""
