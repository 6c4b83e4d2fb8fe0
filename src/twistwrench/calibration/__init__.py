"""Calibration of the geometry of an arm from measured poses, positions, distances or touches of its tip."""

from __future__ import annotations

from .calibrate import calibrate
from .factory import FactoryCalibration, factory
from .measurements import Measurements
from .poses import MeasuringPoses, measuring_poses
from .result import CalibratedRobot

__all__ = [
    "CalibratedRobot",
    "FactoryCalibration",
    "Measurements",
    "MeasuringPoses",
    "calibrate",
    "factory",
    "measuring_poses",
]
