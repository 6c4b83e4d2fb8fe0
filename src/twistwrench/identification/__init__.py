"""Identification: masses, inertias, friction and motor inertias of a robot from logs of its motion, with honest intervals."""

from __future__ import annotations

from .block_deviations import GroupCovariance
from .consistent_robot import ConsistentRobot
from .evidence import LogDoubt
from .held_out import HeldOut, HeldOutRows
from .identified_robot import IdentifiedRobot
from .left_out import without_links
from .log_side import MotorSide, motor_side, read_motion
from .parameter_groups import BaseParameters
from .robot_identification import identify
from .setting_choice import FitSettings
from .unknown_parameters import UnknownParameters

__all__ = [
    "BaseParameters",
    "ConsistentRobot",
    "FitSettings",
    "GroupCovariance",
    "HeldOut",
    "HeldOutRows",
    "IdentifiedRobot",
    "LogDoubt",
    "MotorSide",
    "UnknownParameters",
    "identify",
    "motor_side",
    "read_motion",
    "without_links",
]
