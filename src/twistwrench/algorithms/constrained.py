"""What constrained dynamics gives, by name. Modern Robotics section 8.7."""

from __future__ import annotations

from typing import NamedTuple

from ..typing import Array


class ConstrainedMotion(NamedTuple):
    """Accelerations q̈ (..., nv), and λ (..., k), N m and N."""

    ddq: Array
    """Accelerations (..., nv), rad/s² or m/s²."""
    lam: Array
    """Multipliers λ (..., k), N m or N, one for each row of A."""


class ConstrainedTorques(NamedTuple):
    """Torques τ (..., nv), zero at joints without a motor, and λ (..., k), N m and N."""

    tau: Array
    """Joint torques (..., nv), N m or N, zero at joints without a motor."""
    lam: Array
    """Multipliers λ (..., k), N m or N, one for each row of A."""


class MotionForceSplit(NamedTuple):
    """Torques that move the robot, Pτ, and torques that only press on its constraints, (1 - P)τ; (..., nv) each."""

    motion: Array
    """Torques that move the robot, Pτ; (..., nv), N m or N."""
    force: Array
    """Torques that only press on the constraints, (1 - P)τ; (..., nv), N m or N."""


class ConstrainedDerivatives(NamedTuple):
    """Derivatives of the torques of the independent joints along motions that keep to the constraints; (..., m, m) each."""

    tau_by_q: Array
    """By the independent coordinates, the others going along."""
    tau_by_dq: Array
    """By the independent velocities."""
    tau_by_ddq: Array
    """By the independent accelerations: the mass matrix that the motors see."""
