"""Robot dynamics in the notation of Modern Robotics, for any robot file, compiled per robot to SIMD kernels."""

from __future__ import annotations

from . import robots
from .bodies.inertia import SpatialInertia
from .bodies.rigid_body import RigidBody
from .errors import (
    FrameError,
    InertiaError,
    KernelError,
    MissingExtraError,
    ModelError,
    ModelWarning,
    NotFoundError,
    RobotFileError,
    ShapeError,
    SingularMassMatrixError,
    TrajectoryError,
    TwistWrenchError,
    UnknownNameError,
    ValueRangeError,
)
from .lie import se3, so3
from .lie.adjoint import Ad, ad
from .robot import Robot, from_screws, load
from .screws.pose import Pose
from .screws.twist import Twist
from .screws.wrench import Wrench

__version__ = "0.1.0"

__all__ = [
    "Ad",
    "FrameError",
    "InertiaError",
    "KernelError",
    "MissingExtraError",
    "ModelError",
    "ModelWarning",
    "NotFoundError",
    "Pose",
    "RigidBody",
    "Robot",
    "RobotFileError",
    "ShapeError",
    "SingularMassMatrixError",
    "SpatialInertia",
    "TrajectoryError",
    "Twist",
    "TwistWrenchError",
    "UnknownNameError",
    "ValueRangeError",
    "Wrench",
    "ad",
    "from_screws",
    "load",
    "robots",
    "se3",
    "so3",
]
