"""Robots: quantities, the engine that compiles them, and the class that has them as methods."""

from . import exponential_kernels
from .from_objects import from_mujoco, from_pinocchio
from .load import from_dh, from_screws, load
from .robot import Robot
from .save import save

__all__ = ["Robot", "from_dh", "from_mujoco", "from_pinocchio", "from_screws", "load", "save"]

exponential_kernels.install()
