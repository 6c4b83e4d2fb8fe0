"""Identification: parameters of a robot from logs of its motion, with intervals that hold, and motions that excite them."""

from __future__ import annotations

from ..core.doubts import Doubt
from ..core.estimation.covariance import GroupCovariance
from ..core.estimation.cross_validation import HeldOut, HeldOutRows
from .consistent import ConsistentRobot
from .essential_groups import EssentialGroups
from .exciting_trajectory import ExcitingMotion, exciting_trajectory
from .hyperparameters import FitSettings
from .identify import identify, measured_causes
from .parameters import BaseParameters, UnknownParameters
from .payload import IdentifiedPayload, MotorSide, motor_side, read_motion
from .result import IdentifiedRobot, without_links
from .servos.identify_servos import identify_servos, simulated_servo_log
from .servos.result import IdentifiedServos

__all__ = [
    "BaseParameters",
    "ConsistentRobot",
    "Doubt",
    "EssentialGroups",
    "ExcitingMotion",
    "FitSettings",
    "GroupCovariance",
    "HeldOut",
    "HeldOutRows",
    "IdentifiedPayload",
    "IdentifiedRobot",
    "IdentifiedServos",
    "MotorSide",
    "UnknownParameters",
    "exciting_trajectory",
    "identify",
    "identify_servos",
    "measured_causes",
    "motor_side",
    "read_motion",
    "simulated_servo_log",
    "without_links",
]
