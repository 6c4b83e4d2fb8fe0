"""MJCF, MuJoCo's description of models: bodies in bodies, with joints, geoms and defaults.

See https://mujoco.readthedocs.io. Bodies, joints and drives are read as MuJoCo's compiler reads them; contacts, visuals
and sensors are ignored.
"""

from __future__ import annotations

from .reader import read_mjcf

__all__ = ["read_mjcf"]
