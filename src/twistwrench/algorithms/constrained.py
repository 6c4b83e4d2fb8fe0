"""What constrained dynamics gives, by name. Modern Robotics section 8.7."""

from __future__ import annotations

from typing import Any, NamedTuple

from numpy.typing import NDArray

Array = NDArray[Any]

__all__ = ["ConstrainedMotion", "ConstrainedTorques", "MotionForceSplit"]


class ConstrainedMotion(NamedTuple):
    """Accelerations q̈ (..., nv), and λ (..., k), N m and N."""

    ddq: Array
    lam: Array


class ConstrainedTorques(NamedTuple):
    """Torques τ (..., nv), zero at joints without a motor, and λ (..., k), N m and N."""

    tau: Array
    lam: Array


class MotionForceSplit(NamedTuple):
    """Torques that move the robot, Pτ, and torques that only press on its constraints, (1 - P)τ; (..., nv) each."""

    motion: Array
    force: Array
