"""Floor of a page under a robot let go: spheres that enclose its links, and the pedestal that its reach needs."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..core.numbers import number
from ..core.typing import Array
from ..mechanics.model.model import BASE
from .scene import Scene
from .sliders import sliders_of

_MAX_SPHERES = 6
"""Maximum number of spheres of a link."""
_POSE_COUNT = 512
"""Number of random configurations whose lowest point gives the height of the pedestal."""
_MIN_RADIUS = 1e-9
"""Radius in place of zero, for a body without extent beside its axis [m]."""
_HEIGHT_FACTOR = 1.15
"""Factor of the height of the pedestal, since random configurations do not reach the lowest possible point."""
_MAX_STANDING_GAP = 0.02
"""Distance from the floor, as a share of the robot's size, within which a base stands on it."""


def spheres_of(scene: Scene) -> list[dict[str, Any]]:
    """Spheres of equal radius along the longest axis of each moving body's shapes, with body, middle and radius [m].

    The radius is the largest distance of a vertex from the axis, so that the spheres enclose the body's flanks.
    """
    spheres: list[dict[str, Any]] = []
    for k in range(len(scene.robot.model.bodies)):
        shapes = [shape for shape in scene.shapes if shape.body == k and shape.layer == "looks"]
        if not shapes:
            continue
        points_of_shapes = []
        for shape in shapes:
            R, p = shape.pose[:3, :3], shape.pose[:3, 3]
            points_of_shapes.append(shape.surface.vertices @ R.T + p)
        points = np.concatenate(points_of_shapes)
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        _, principal_axes = np.linalg.eigh(np.cov(points.T))
        axis = principal_axes[:, -1]  # of the largest variance
        positions_along_axis = (points - middle) @ axis
        vectors_from_axis = points - middle - positions_along_axis[:, None] * axis
        radius = float(np.linalg.norm(vectors_from_axis, axis=1).max())
        first_position = positions_along_axis.min() + radius
        last_position = positions_along_axis.max() - radius
        positions = np.array([(first_position + last_position) / 2])  # of the spheres' centres along the axis
        if last_position > first_position:
            length = last_position - first_position
            interval_count = np.ceil(length / max(radius, _MIN_RADIUS))  # intervals are at most a radius long
            sphere_count = int(np.clip(interval_count + 1, 1, _MAX_SPHERES))
            positions = np.linspace(first_position, last_position, sphere_count)
        for position in positions:
            centre = middle + position * axis
            spheres.append({"body": k, "middle": centre.tolist(), "radius": radius})
    return spheres


def pedestal_of(scene: Scene, spheres: list[dict[str, Any]], floor: float) -> float:
    """Height [m] by which an arm that stands on the floor is raised so that its links swing freely; 0 for other robots."""
    model = scene.robot.model
    has_free_base = any(not body.joint.driven and body.parent == BASE for body in model.bodies)
    if not spheres or has_free_base:
        return 0.0
    max_gap = _MAX_STANDING_GAP * scene.size
    base_shapes = [shape for shape in scene.shapes if shape.body == BASE]
    base_surfaces = [shape.surface.placed(shape.pose) for shape in base_shapes]
    base_heights = [surface.vertices[:, 2].min() for surface in base_surfaces]
    if min(base_heights, default=0.0) > floor + max_gap:  # the arm hangs
        return 0.0
    needed_height = floor - _lowest_height(scene, spheres)
    if needed_height <= max_gap:
        return 0.0
    return float(number(_HEIGHT_FACTOR * needed_height, 2))


def _lowest_height(scene: Scene, spheres: list[dict[str, Any]]) -> float:
    """Height of the lowest point of the spheres over random configurations, with joints past their stops."""
    q = np.array(scene.robot.random_configuration(0, _POSE_COUNT))
    rng = np.random.default_rng(0)
    for slider in sliders_of(scene.robot.model):
        if slider["unit"] == "°" and "turn" not in slider:  # an angle, not part of a quaternion
            q[:, slider["q"]] = rng.uniform(-np.pi, np.pi, _POSE_COUNT)
    poses = scene.body_poses(q)
    heights: list[Array] = []
    for sphere in spheres:
        T = poses[:, sphere["body"]]
        middle_heights = T[:, 2, :3] @ sphere["middle"] + T[:, 2, 3]
        heights.append(middle_heights - sphere["radius"])
    return float(np.nanmin(heights))
