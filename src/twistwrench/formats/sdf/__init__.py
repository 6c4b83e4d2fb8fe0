"""SDFormat, the description of models and worlds of Gazebo and Drake; see http://sdformat.org/spec."""

from __future__ import annotations

from .reader import read_sdf

__all__ = ["read_sdf"]
