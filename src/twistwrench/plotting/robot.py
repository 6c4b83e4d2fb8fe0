"""A robot in the axes of a figure: one pose, or several of a motion, the earlier ones paler."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..errors import ShapeError
from ..viz.movie import Camera, Painter, overview
from ..viz.scene import Scene, scene_of
from .style import require_matplotlib

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..robot import Robot

_PALEST = 0.28


def draw(
    axes: Axes,
    robot: Robot,
    q: ArrayLike,
    *,
    azimuth: float = -0.9,
    elevation: float = 0.35,
    floor: float | None = None,
    inertia: bool = True,
    scene: Scene | None = None,
) -> Camera:
    """Draw a robot into Matplotlib's axes, at one configuration or at some of a motion."""
    require_matplotlib("Drawing a robot")
    from matplotlib.collections import PolyCollection

    poses = np.atleast_2d(arguments.finite(q, "draw: q", robot.nq, names=robot.coordinate_names))
    if poses.ndim > 2 or not len(poses):
        raise ShapeError(f"draw: q has shape {np.shape(q)}, expected ({robot.nq},), or (n, {robot.nq}) for n poses.")
    scene = scene_of(robot) if scene is None else scene
    camera, lowest = overview(scene, poses, azimuth, elevation)
    painter = Painter(scene, camera, lowest if floor is None else arguments.number(floor, "draw: floor"))
    shadows = sum(len(surface.faces) for _, surface in painter.shades)
    for k, pose in enumerate(poses):
        triangles, colours = painter.paint(pose)
        shade = _PALEST + (1.0 - _PALEST) * (k + 1) / len(poses) if len(poses) > 1 else 1.0
        colours[:, :3] = 1.0 - shade * (1.0 - colours[:, :3])
        edges = np.where(colours[:, 3:] < 1.0, 0.0, colours)  # hides the seams of what is solid
        under = np.arange(len(triangles)) < shadows  # no pose shades another
        for shown, order in ((under, 1), (~under & (inertia | (colours[:, 3] == 1.0)), 2)):
            look: dict[str, Any] = {
                "facecolors": colours[shown],
                "edgecolors": edges[shown],
                "linewidths": 0.3,
                "zorder": order,
            }
            axes.add_collection(PolyCollection(list(triangles[shown]), **look))
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.set_axis_off()
    return camera
