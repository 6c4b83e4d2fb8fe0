"""Robot dynamics in the notation of Modern Robotics, for any robot file, compiled per robot to SIMD kernels."""

from __future__ import annotations

from . import robots
from .bodies.inertia import SpatialInertia
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
    "Robot",
    "RobotFileError",
    "ShapeError",
    "SingularMassMatrixError",
    "SpatialInertia",
    "TrajectoryError",
    "TwistWrenchError",
    "UnknownNameError",
    "ValueRangeError",
    "ad",
    "from_screws",
    "load",
    "robots",
    "se3",
    "so3",
]
