"""Identification: masses, inertias, friction and motor inertias of a robot from logs of its motion, with honest intervals."""

from __future__ import annotations

from .block_deviations import GroupCovariance
from .evidence import LogDoubt
from .held_out import HeldOut
from .identified_robot import IdentifiedRobot
from .log_side import MotorSide
from .parameter_groups import BaseParameters
from .robot_identification import identify
from .setting_choice import FitSettings
from .unknown_parameters import UnknownParameters

__all__ = [
    "BaseParameters",
    "FitSettings",
    "GroupCovariance",
    "HeldOut",
    "IdentifiedRobot",
    "LogDoubt",
    "MotorSide",
    "UnknownParameters",
    "identify",
]
