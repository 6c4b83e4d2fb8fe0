"""Robot dynamics in the notation of Modern Robotics, for any robot file, compiled per robot to SIMD kernels."""

from __future__ import annotations

import importlib as _importlib
import typing as _typing

from .core import verdict as _verdict  # noqa: F401  hears Ctrl-C from here on, before all that takes time
from .core.errors import (
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
    ShapeWarning,
    SimulationError,
    SingularMassMatrixError,
    TrajectoryError,
    TwistWrenchError,
    UnknownNameError,
    ValueRangeError,
)
from .core.version import __version__ as __version__
from .robot import Robot, from_dh, from_mujoco, from_pinocchio, from_screws, load, save

__all__ = [
    "Ad",
    "CacheWarning",
    "ConstraintError",
    "ConstraintWarning",
    "FrameError",
    "InertiaError",
    "KernelError",
    "MissingExtraError",
    "ModelBuilder",
    "ModelError",
    "ModelWarning",
    "Motion",
    "Motor",
    "NotFoundError",
    "PathError",
    "Pose",
    "RigidBody",
    "Robot",
    "RobotFileError",
    "ShapeError",
    "ShapeWarning",
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
    "check",
    "check_each",
    "check_log",
    "derive",
    "differentiate",
    "doctor",
    "excite",
    "find",
    "from_dh",
    "from_mujoco",
    "from_pinocchio",
    "from_screws",
    "get_threads",
    "identify",
    "info",
    "join",
    "load",
    "move",
    "move_covariance",
    "payload",
    "robots",
    "save",
    "screws",
    "se3",
    "set_threads",
    "size_drives",
    "so3",
    "verify",
]

if _typing.TYPE_CHECKING:
    from . import calibration as calibration
    from . import control as control
    from . import diagnosis as diagnosis
    from . import identification as identification
    from . import modern_robotics as modern_robotics
    from . import robots as robots
    from . import sensing as sensing
    from . import simulation as simulation
    from . import sizing as sizing
    from . import statics as statics
    from . import symbolic as symbolic
    from . import testing as testing
    from . import trajectories as trajectories
    from . import viz as viz
    from .compiler.runtime.batch_threads import get_threads as get_threads
    from .compiler.runtime.batch_threads import set_threads as set_threads
    from .diagnosis.report import DoctorReport as DoctorReport
    from .diagnosis.report import doctor as doctor
    from .identification.exciting_trajectory import ExcitingMotion as ExcitingMotion
    from .identification.exciting_trajectory import excite as excite
    from .identification.identify import identify as identify
    from .identification.result import IdentifiedRobot as IdentifiedRobot
    from .mechanics.bodies.inertia import SpatialInertia as SpatialInertia
    from .mechanics.bodies.rigid_body import RigidBody as RigidBody
    from .mechanics.lie import axis as screws
    from .mechanics.lie import se3 as se3
    from .mechanics.lie import so3 as so3
    from .mechanics.lie.adjoint import Ad as Ad
    from .mechanics.lie.adjoint import ad as ad
    from .mechanics.lie.twist_wrench import Pose as Pose
    from .mechanics.lie.twist_wrench import Twist as Twist
    from .mechanics.lie.twist_wrench import Wrench as Wrench
    from .mechanics.lie.twist_wrench import move_covariance as move_covariance
    from .mechanics.model.actuators import Motor as Motor
    from .mechanics.model.builder import ModelBuilder as ModelBuilder
    from .motion.motion import Motion as Motion
    from .reports.check import check as check
    from .reports.checked_motions import check_each as check_each
    from .reports.info import RobotReport as RobotReport
    from .reports.info import info as info
    from .reports.log_report import LogReport as LogReport
    from .reports.log_report import check_log as check_log
    from .reports.torque_report import TorqueReport as TorqueReport
    from .robot import convert as convert
    from .robot import pointwise as pointwise
    from .robot.differentiate import differentiate as differentiate
    from .robot.export.written import Saved as Saved
    from .robot.export.written import Written as Written
    from .robots.cell import RobotCell as RobotCell
    from .robots.cell import join as join
    from .robots.finding import find as find
    from .robots.known_robots import KnownRobots as KnownRobots
    from .simulation.result import SimulationResult as SimulationResult
    from .sizing.choice import Sizing as Sizing
    from .sizing.sizing import size_drives as size_drives
    from .statics.payload_report import PayloadReport as PayloadReport
    from .statics.payload_report import payload as payload
    from .symbolic.derivation import Derivation as Derivation
    from .symbolic.derivation import derive as derive
    from .testing.verify import VerifyReport as VerifyReport
    from .testing.verify import verify as verify
    from .trajectories.move_report import MoveReport as MoveReport
    from .trajectories.move_report import move as move

_MODULES = {
    **{
        name: name
        for name in ("calibration", "control", "diagnosis", "identification", "modern_robotics", "robots", "sensing")
    },
    **{name: name for name in ("simulation", "sizing", "statics", "symbolic", "testing", "trajectories", "viz")},
    "convert": "robot.convert",
    "pointwise": "robot.pointwise",
    "screws": "mechanics.lie.axis",
    "se3": "mechanics.lie.se3",
    "so3": "mechanics.lie.so3",
}
"""Modules that ``tw.statics`` and similar names import on first use."""

_NAMES = {
    "Ad": "mechanics.lie.adjoint",
    "RobotCell": "robots.cell",
    "Derivation": "symbolic.derivation",
    "ExcitingMotion": "identification.exciting_trajectory",
    "IdentifiedRobot": "identification.result",
    "ModelBuilder": "mechanics.model.builder",
    "DoctorReport": "diagnosis.report",
    "KnownRobots": "robots.known_robots",
    "LogReport": "reports.log_report",
    "Motion": "motion.motion",
    "MoveReport": "trajectories.move_report",
    "Motor": "mechanics.model.actuators",
    "Pose": "mechanics.lie.twist_wrench",
    "PayloadReport": "statics.payload_report",
    "RigidBody": "mechanics.bodies.rigid_body",
    "RobotReport": "reports.info",
    "Saved": "robot.export.written",
    "SimulationResult": "simulation.result",
    "Sizing": "sizing.choice",
    "SpatialInertia": "mechanics.bodies.inertia",
    "Twist": "mechanics.lie.twist_wrench",
    "Written": "robot.export.written",
    "Wrench": "mechanics.lie.twist_wrench",
    "TorqueReport": "reports.torque_report",
    "VerifyReport": "testing.verify",
    "ad": "mechanics.lie.adjoint",
    "check": "reports.check",
    "check_log": "reports.log_report",
    "check_each": "reports.checked_motions",
    "derive": "symbolic.derivation",
    "differentiate": "robot.differentiate",
    "doctor": "diagnosis.report",
    "excite": "identification.exciting_trajectory",
    "find": "robots.finding",
    "identify": "identification.identify",
    "info": "reports.info",
    "join": "robots.cell",
    "get_threads": "compiler.runtime.batch_threads",
    "move": "trajectories.move_report",
    "move_covariance": "mechanics.lie.twist_wrench",
    "payload": "statics.payload_report",
    "set_threads": "compiler.runtime.batch_threads",
    "size_drives": "sizing.sizing",
    "verify": "testing.verify",
}
"""Modules of other names, imported on first use: the first torque of a robot needs none of them."""


def __getattr__(name: str) -> object:
    if name in _MODULES:
        attribute: object = _importlib.import_module(f"{__name__}.{_MODULES[name]}")
    elif name in _NAMES:
        module = _importlib.import_module(f"{__name__}.{_NAMES[name]}")
        attribute = getattr(module, name)
    else:
        raise _missing(name)
    globals()[name] = attribute  # later uses do not call this function
    return attribute


def _missing(name: str) -> AttributeError:
    """Error for a name that the package does not have, with the call to write instead."""
    if name.startswith("_"):
        return AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from .core.first_calls import missing_attribute
    from .robots import names

    if name.lower() in names():
        return AttributeError(
            f"module {__name__!r} has no attribute {name!r}: use tw.robots.{name.lower()}()", name=None
        )
    return missing_attribute(f"module {__name__!r}", name, "module", __dir__())


def __dir__() -> list[str]:
    return sorted({*__all__, *_MODULES, *(name for name in globals() if name.startswith("__"))})
