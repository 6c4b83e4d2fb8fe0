"""Six-axis force-torque sensors: prediction of readings, identification of the load, and compensation."""

from __future__ import annotations

from .contact_detection import CollisionThreshold, contact_nearest, contact_on_plane, contact_on_sphere
from .files import read_log, read_sensor, write_log, write_sensor
from .identification import identify
from .log import ReadingLog
from .poses import PoseProposal, propose_poses, simulate
from .result import Identification
from .sensor import ForceTorqueSensor

__all__ = [
    "CollisionThreshold",
    "ForceTorqueSensor",
    "Identification",
    "PoseProposal",
    "ReadingLog",
    "contact_nearest",
    "contact_on_plane",
    "contact_on_sphere",
    "identify",
    "propose_poses",
    "read_log",
    "read_sensor",
    "simulate",
    "write_log",
    "write_sensor",
]
