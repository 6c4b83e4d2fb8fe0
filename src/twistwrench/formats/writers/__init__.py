"""Writers: a model as the text of a robot file, with a list of losses."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from ...mechanics.model.model import Model
from .mjcf import write_mjcf
from .sdf import write_sdf
from .urdf import write_urdf
from .written import RobotDocument

__all__ = ["SUFFIXES", "WRITERS", "RobotDocument", "write_mjcf", "write_sdf", "write_urdf"]

WRITERS: Mapping[str, Callable[[Model], RobotDocument]] = {"urdf": write_urdf, "mjcf": write_mjcf, "sdf": write_sdf}
"""The formats that are written, each with its writer."""
SUFFIXES: Mapping[str, str] = {".urdf": "urdf", ".xml": "mjcf", ".mjcf": "mjcf", ".sdf": "sdf", ".world": "sdf"}
"""Format of each suffix."""
