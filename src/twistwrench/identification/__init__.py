"""Identification: numbers of a robot from logs of its motion, with honest intervals, and motions whose logs tell most."""

from __future__ import annotations

from .block_deviations import GroupCovariance
from .consistent_robot import ConsistentRobot
from .essential_groups import EssentialGroups
from .evidence import LogDoubt
from .exciting_motion import ExcitingMotion
from .exciting_trajectory import exciting_trajectory
from .gathering import gather
from .held_out import HeldOut, HeldOutRows
from .identified_payload import IdentifiedPayload
from .identified_robot import IdentifiedRobot
from .information import Information
from .left_out import without_links
from .log_side import MotorSide, motor_side, read_motion
from .parameter_groups import BaseParameters
from .robot_identification import identify
from .setting_trial import FitSettings
from .unknown_parameters import UnknownParameters

__all__ = [
    "BaseParameters",
    "ConsistentRobot",
    "EssentialGroups",
    "ExcitingMotion",
    "FitSettings",
    "GroupCovariance",
    "HeldOut",
    "HeldOutRows",
    "IdentifiedPayload",
    "IdentifiedRobot",
    "Information",
    "LogDoubt",
    "MotorSide",
    "UnknownParameters",
    "exciting_trajectory",
    "gather",
    "identify",
    "motor_side",
    "read_motion",
    "without_links",
]
