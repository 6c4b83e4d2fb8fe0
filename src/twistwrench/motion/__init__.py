"""Motions: readers of motion files, differentiation of samples with noise estimates, and consistency checks."""

from .motion_log import LogRows, MotionLog

__all__ = ["LogRows", "MotionLog"]
