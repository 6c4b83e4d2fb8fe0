"""MJCF, MuJoCo's description of models: bodies in bodies, with joints, geoms and defaults.

See https://mujoco.readthedocs.io. Read as MuJoCo's compiler means it, by what it says of bodies, joints and drives;
contacts, looks and sensors are passed over.
"""

from __future__ import annotations

from .reader import read_mjcf

__all__ = ["read_mjcf"]
