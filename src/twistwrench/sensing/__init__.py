"""Six-axis force-torque sensors: prediction of readings, identification of the load, and compensation."""

from __future__ import annotations

from .compensation import Compensation, compensate
from .contact_detection import (
    CollisionThreshold,
    contact_nearest,
    contact_on_plane,
    contact_on_sphere,
    residual_moment,
)
from .files import read_log, read_sensor, write_log, write_sensor
from .identification import identify
from .log import ReadingLog
from .poses import PoseProposal, propose_poses
from .result import Identification
from .sensor import ForceTorqueSensor, gravity_in_frame
from .simulated_logs import lively_motion, simulate

__all__ = [
    "CollisionThreshold",
    "Compensation",
    "ForceTorqueSensor",
    "Identification",
    "PoseProposal",
    "ReadingLog",
    "compensate",
    "contact_nearest",
    "contact_on_plane",
    "contact_on_sphere",
    "gravity_in_frame",
    "identify",
    "lively_motion",
    "propose_poses",
    "read_log",
    "read_sensor",
    "residual_moment",
    "simulate",
    "write_log",
    "write_sensor",
]
