"""Motions: paths of joints and poses, time scalings, and the fastest timing of a path. Modern Robotics chapter 9."""

from __future__ import annotations

from ..mechanics.algorithms.time_scalings import (
    PosePath,
    cubic,
    quintic,
    s_curve,
    screw_path,
    straight_path,
    trapezoid,
    uniform,
)
from ..motion.bounds import Violation, bounds_of
from .fastest import Fastest, fastest
from .paths import JointPath, follow_poses, joint_line, spline
from .trajectory import Trajectory, fitted, move, violations

__all__ = [
    "Fastest",
    "JointPath",
    "PosePath",
    "Trajectory",
    "Violation",
    "bounds_of",
    "cubic",
    "fastest",
    "fitted",
    "follow_poses",
    "joint_line",
    "move",
    "quintic",
    "s_curve",
    "screw_path",
    "spline",
    "straight_path",
    "trapezoid",
    "uniform",
    "violations",
]
