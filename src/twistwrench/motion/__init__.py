"""Motions: readers of motion files, differentiation of samples with noise estimates, and consistency checks."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .motion_log import LogRows as LogRows
    from .motion_log import MotionLog as MotionLog
    from .readers.ros_recordings import between_points as between_points

__all__ = ["LogRows", "MotionLog", "between_points"]


def __getattr__(name: str) -> object:  # a reader in a child process needs no logs
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    if name == "between_points":
        from .readers.ros_recordings import between_points

        return between_points
    from . import motion_log

    return getattr(motion_log, name)
