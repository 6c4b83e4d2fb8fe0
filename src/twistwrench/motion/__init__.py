"""Motions in files: how they are read, which column is what, and what in them contradicts itself."""

from .trajectory import Motion, Trajectory

__all__ = ["Motion", "Trajectory"]
