"""Robots: quantities, the engine that compiles them, and the class with its methods."""

from .kernels.exponentials import install
from .load import from_dh, from_mujoco, from_pinocchio, from_screws, load
from .robot import Robot
from .save import save

__all__ = ["Robot", "from_dh", "from_mujoco", "from_pinocchio", "from_screws", "load", "save"]

install()
