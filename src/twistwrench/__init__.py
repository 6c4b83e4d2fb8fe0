"""Robot dynamics in the notation of Modern Robotics, for any robot file, compiled per robot to SIMD kernels."""

from __future__ import annotations

import importlib as _importlib
import typing as _typing

from . import robots
from .bodies.inertia import SpatialInertia
from .bodies.rigid_body import RigidBody
from .errors import (
    CacheWarning,
    ConstraintError,
    ConstraintWarning,
    FrameError,
    InertiaError,
    KernelError,
    MissingExtraError,
    ModelError,
    ModelWarning,
    NotFoundError,
    PathError,
    RobotFileError,
    ShapeError,
    SimulationError,
    SingularMassMatrixError,
    TrajectoryError,
    TwistWrenchError,
    UnknownNameError,
    ValueRangeError,
)
from .kernels.threads import get_threads, set_threads
from .lie import se3, so3
from .lie.adjoint import Ad, ad
from .robot import Robot, from_dh, from_drake, from_mujoco, from_pinocchio, from_rtb, from_screws, load, save
from .robot.differentiate import differentiate
from .robots.finding import find
from .screws.pose import Pose
from .screws.twist import Twist
from .screws.wrench import Wrench

__version__ = "0.1.0"

__all__ = [
    "Ad",
    "CacheWarning",
    "ConstraintError",
    "ConstraintWarning",
    "FrameError",
    "InertiaError",
    "KernelError",
    "MissingExtraError",
    "ModelError",
    "ModelWarning",
    "Motion",
    "NotFoundError",
    "PathError",
    "Pose",
    "RigidBody",
    "Robot",
    "RobotFileError",
    "ShapeError",
    "SimulationError",
    "SingularMassMatrixError",
    "SpatialInertia",
    "TrajectoryError",
    "Twist",
    "TwistWrenchError",
    "UnknownNameError",
    "ValueRangeError",
    "Wrench",
    "ad",
    "differentiate",
    "doctor",
    "find",
    "from_dh",
    "from_drake",
    "from_mujoco",
    "from_pinocchio",
    "from_rtb",
    "from_screws",
    "get_threads",
    "load",
    "robots",
    "save",
    "se3",
    "set_threads",
    "so3",
]

if _typing.TYPE_CHECKING:
    from . import control as control
    from . import convert as convert
    from . import cuda as cuda
    from . import diagnosis as diagnosis
    from . import identification as identification
    from . import modern_robotics as modern_robotics
    from . import pointwise as pointwise
    from . import sensing as sensing
    from . import simulation as simulation
    from . import statics as statics
    from . import symbolic as symbolic
    from . import testing as testing
    from . import trajectories as trajectories
    from . import viz as viz
    from .diagnosis.examination import doctor as doctor
    from .motion.motion import Motion as Motion

_LATER = (
    "control",
    "convert",
    "cuda",
    "diagnosis",
    "identification",
    "modern_robotics",
    "pointwise",
    "sensing",
    "simulation",
    "statics",
    "symbolic",
    "testing",
    "trajectories",
    "viz",
)
"""Modules that ``tw.statics`` and its like import when first asked for: they need more than a robot does."""


def __getattr__(name: str) -> object:
    if name in _LATER:
        return _importlib.import_module(f"{__name__}.{name}")
    if name == "Motion":
        return _importlib.import_module(f"{__name__}.motion.motion").Motion
    if name == "doctor":
        return _importlib.import_module(f"{__name__}.diagnosis.examination").doctor
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*__all__, *_LATER, *(name for name in globals() if name.startswith("__"))})
