"""Motions: paths of joints and poses, time scalings, and the fastest timing of a path. Modern Robotics chapter 9."""

from __future__ import annotations

from ..algorithms.pose_paths import PosePath, screw_path, straight_path
from ..algorithms.time_scalings import cubic, quintic, trapezoid, uniform
from ..motion.bounds import Bounds, bounds_of
from ..motion.violations import Violation
from .cartesian import follow_poses
from .fastest import Fastest, fastest
from .limit_checks import violations
from .paths import JointPath, joint_line, spline
from .trajectory import Trajectory, fitted, move

__all__ = [
    "Bounds",
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
    "screw_path",
    "spline",
    "straight_path",
    "trapezoid",
    "uniform",
    "violations",
]
