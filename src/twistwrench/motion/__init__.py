"""Motions: how files of them are read, how rates come from samples and how noisy those are, and what contradicts itself."""

from .motion_log import LogRows, MotionLog

__all__ = ["LogRows", "MotionLog"]
