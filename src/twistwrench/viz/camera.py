"""A camera for pictures on paper: triangles projected, shaded, and sorted from far to near."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..model.model import BASE
from ..typing import Array

if TYPE_CHECKING:
    from .scene import Scene, Shape
    from .surface import Surface

_SUN = np.array([0.35, -0.45, 0.85]) / np.linalg.norm([0.35, -0.45, 0.85])
_SHADOW = (0.80, 0.82, 0.85)
FAR = 2.6
"""How far off cameras stand, in sizes of what they look at."""
_SHADOWS = 1500
"""Triangles whose shadow is drawn."""
_ALPHA = {"looks": 1.0, "inertia": 0.3}


@dataclass(frozen=True, eq=False)
class Camera:
    """Camera that looks at a point of the base frame from some distance, turned about z and raised."""

    target: Array
    """The point it looks at (3,) [m]."""
    distance: float
    """From the target [m]."""
    azimuth: float = -0.9
    """About z [rad]."""
    elevation: float = 0.35
    """Above the horizontal [rad]."""

    def axes(self) -> Array:
        """Axes of the picture: right, up and back as rows.

        Returns
        -------
        axes : (3, 3) array, in the base frame

        Examples
        --------
        >>> Camera(np.zeros(3), 2.0).axes().shape
        (3, 3)
        """
        (c, s), (ca, sa) = (
            (np.cos(self.elevation), np.sin(self.elevation)),
            (np.cos(self.azimuth), np.sin(self.azimuth)),
        )
        back = np.array([c * ca, c * sa, s])
        right = np.array([-sa, ca, 0.0])
        return np.stack([right, np.cross(back, right), back])

    def project(self, points: ArrayLike) -> tuple[Array, Array]:
        """Perspective projection: where points are in the picture, and how far away.

        Parameters
        ----------
        points : (..., 3) array_like, in the base frame [m]

        Returns
        -------
        places : (..., 2) array, in metres at the target
        depths : (...) array [m]

        Examples
        --------
        >>> places, depths = Camera(np.zeros(3), 2.0).project([0.0, 0.0, 0.0])
        >>> places.tolist(), float(depths)
        ([0.0, 0.0], 2.0)
        """
        seen = (np.asarray(points) - self.target) @ self.axes().T
        away = np.maximum(self.distance - seen[..., 2], 1e-3 * self.distance)
        return seen[..., :2] * (self.distance / away)[..., None], away


def overview(scene: Scene, poses: Array, azimuth: float = -0.9, elevation: float = 0.35) -> tuple[Camera, float]:
    """A camera that looks at all of the poses (n, nq), from not too near, and the height of their lowest point."""
    bounds = np.stack([scene.bounds(q) for q in poses])
    low, high = bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)
    size = max(scene.size, float(np.linalg.norm(high - low)))
    return Camera((low + high) / 2, FAR * size, azimuth, elevation), float(low[2])


class Painter:
    """A scene as polygons of one picture after another; the floor is at height ``floor``."""

    def __init__(self, scene: Scene, camera: Camera, floor: float) -> None:
        self.scene, self.camera, self.floor = scene, camera, floor
        shown = {"looks"} if scene.dressed or scene.doubtful else {"looks", "inertia"}
        self.parts = [(s, s.surface.placed(s.pose)) for s in scene.shapes if s.layer in shown]
        self.shades = [(s, s.surface.placed(s.pose)) for s in scene.thinned(_SHADOWS).shapes if s.layer == "looks"]

    def paint(self, q: Array) -> tuple[Array, Array]:
        """Triangles (k, 3, 2) with their colours (k, 4), far ones first, shadows before all; q (nq,)."""
        poses = self.scene.body_poses(q)
        corners = np.concatenate([_moved(shape, s, poses) for shape, s in self.parts])
        colours = np.concatenate(
            [np.tile((*shape.colour, _ALPHA[shape.layer]), (len(s.faces), 1)) for shape, s in self.parts]
        )
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
        eye = self.camera.target + self.camera.distance * self.camera.axes()[2]
        facing = np.einsum("ij,ij->i", normals, eye - corners.mean(axis=1))
        near = (facing > 0) | (colours[:, 3] == 1.0)  # of what can be seen through, the near side alone
        corners, colours, facing, normals = corners[near], colours[near], facing[near], normals[near]
        normals = normals * np.where(facing < 0, -1.0, 1.0)[:, None]
        light = 0.50 + 0.16 * normals[:, 2] + 0.46 * np.maximum(normals @ _SUN, 0.0)
        colours[:, :3] = np.clip(colours[:, :3] * light[:, None], 0.0, 1.0)
        flat, away = self.camera.project(corners)
        order = np.argsort(-away.mean(axis=1))
        fallen = np.concatenate([_moved(shape, s, poses) for shape, s in self.shades])
        fallen = fallen - (fallen[..., 2:] - self.floor) * (_SUN / _SUN[2])
        shadow = self.camera.project(fallen)[0]
        dark = np.tile((*_SHADOW, 1.0), (len(shadow), 1))
        return np.concatenate([shadow, flat[order]]), np.concatenate([dark, colours[order]])

    def grid(self, size: float) -> Array:
        """Lines on the floor, (k, 2, 2)."""
        step = 10.0 ** np.floor(np.log10(size / 4))
        count = int(np.ceil(0.9 * size / step))
        middle = np.round(self.camera.target[:2] / step) * step
        far = count * step
        along = np.arange(-count, count + 1) * step
        ends = np.array([[-far, far]]) + np.zeros((len(along), 1))
        across = np.stack([along, along], axis=1)
        lines = np.concatenate([np.stack([ends, across], axis=-1), np.stack([across, ends], axis=-1)]) + middle
        whole = np.concatenate([lines, np.full((*lines.shape[:-1], 1), self.floor)], axis=-1)
        return self.camera.project(whole)[0]


def _moved(shape: Shape, surface: Surface, poses: Array) -> Array:
    """The corners of a shape's triangles (k, 3, 3) in the base frame."""
    corners = surface.vertices[surface.faces]
    if shape.body == BASE:
        return corners
    T = poses[shape.body]
    return np.asarray(corners @ T[:3, :3].T + T[:3, 3])
