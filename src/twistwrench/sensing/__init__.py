"""Six-axis force-torque sensors: predicting, identifying and removing what the tool itself does to the readings."""

from __future__ import annotations

from .contact_detection import CollisionThreshold, contact_nearest, contact_on_plane, contact_on_sphere
from .identification import identify
from .identified import Identification
from .log import ReadingLog
from .log_file import read_log, write_log
from .poses import PoseProposal, propose_poses
from .sensor import ForceTorqueSensor
from .sensor_file import read_sensor, write_sensor
from .synthetic_log import simulate

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
