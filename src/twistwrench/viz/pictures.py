"""Pictures of pages: plots as SVG, and the robot with a marked joint."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeAlias

from ..core.answers.page import MarkedJoint, Picture
from . import style

if TYPE_CHECKING:
    from ..robot import Robot
    from .scene import Scene

Plot: TypeAlias = Callable[[Any], object]
"""A function of the file to write."""


def plot_picture(title: str, plot: Plot) -> Picture:
    """Picture of a plot for a page."""
    return Picture(title, style.page_svg(plot))


def robot_picture(robot: Robot, q: Any, marked: MarkedJoint | None, title: str, scene: Scene | None = None) -> Picture:
    """Picture of the robot at a configuration (None: a typical one), with a marked joint."""
    from .plots.robot_picture import still

    if marked is None:
        return Picture(title, still(robot, q, scene=scene))
    image = still(robot, q, marked.joint, marked.label, mark=marked.style, scene=scene)
    return Picture(f"{title}; {marked.caption}", image)
