"""Loops that a robot file closes, offered: the model is a tree, and a robot is closed by ``robot.close``."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class OfferedClosure:
    """Two frames that the file holds on each other: ``robot.close(closure.frame_a, closure.frame_b, closure.rows)``."""

    frame_a: str
    """One of them."""
    frame_b: str
    """The other."""
    rows: str = "wx wy wz vx vy vz"
    """The rows of the frames' relative twist that are held at zero."""
