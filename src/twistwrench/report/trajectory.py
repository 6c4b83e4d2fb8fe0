"""Motions in files; they live in :mod:`twistwrench.motion.trajectory`."""

from ..motion.trajectory import Motion, Trajectory, moves_motors

__all__ = ["Motion", "Trajectory", "moves_motors"]
