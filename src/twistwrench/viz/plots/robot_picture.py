"""Pictures of a robot drawn by Matplotlib: camera, painter of triangles, and stills."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ...core import arguments
from ...core.colours import COLOURS, Style
from ...core.errors import ShapeError
from ...core.glossary import complete
from ...core.numbers import over_limit
from ...core.typing import Array
from ...mechanics.model.model import BASE
from ...reports.drawn_motion import DrawnMotion
from .. import style
from ..scene import Scene, Shape, scene_of
from ..starting_pose import starting_pose

if TYPE_CHECKING:
    from ...robot import Robot
    from ...shapes.surface import Surface

_LIGHT_DIRECTION = np.array([0.35, -0.45, 0.85])
_TO_LIGHT = _LIGHT_DIRECTION / np.linalg.norm(_LIGHT_DIRECTION)
"""Unit vector towards the light."""
_AMBIENT_LIGHT = 0.50
"""Brightness of a surface that no light reaches, as a share of its colour."""
_SKY_LIGHT = 0.16
"""Additional brightness of a surface that faces upward; less for one that faces downward."""
_DIRECT_LIGHT = 0.46
"""Additional brightness of a surface that faces the light."""
_MIN_NORMAL = 1e-300
"""Length of a normal in place of zero, for triangles without area."""
_MIN_DEPTH_SHARE = 1e-3
"""Smallest depth of a point, as a share of the camera's distance; points behind the camera get it, too."""
_SHADOW_COLOUR = (0.80, 0.82, 0.85)
"""Red, green and blue of shadows, from 0 to 1."""
CAMERA_DISTANCE = 2.6
"""Camera distance as a multiple of the scene size."""
_MAX_SHADOW_TRIANGLES = 1500
"""Maximum number of triangles that cast a shadow."""
MAX_TRIANGLES = 5000
"""Maximum number of triangles of a robot in a picture."""
_OPACITY = {"looks": 1.0, "inertia": 0.3}
"""Opacity of shapes, by layer; 1 is opaque."""


@dataclass(frozen=True, eq=False)
class Camera:
    """Camera at some distance from a target point in the base frame, with azimuth about z and elevation.

    Examples
    --------
    >>> camera = Camera(np.zeros(3), 2.0)
    >>> camera.axes().shape, camera.project([0.0, 0.0, 0.0])[1].item()
    ((3, 3), 2.0)
    """

    target: Array
    """Target point (3,) [m]."""
    distance: float
    """Distance from the target [m]."""
    azimuth: float = -0.9
    """Azimuth about z [rad]."""
    elevation: float = 0.35
    """Elevation above the horizontal [rad]."""

    def axes(self) -> Array:
        """Axes of the picture as rows: right, up and back.

        Returns
        -------
        axes : (3, 3) array, in the base frame
        """
        cos_e, sin_e = np.cos(self.elevation), np.sin(self.elevation)
        cos_a, sin_a = np.cos(self.azimuth), np.sin(self.azimuth)
        back = np.array([cos_e * cos_a, cos_e * sin_a, sin_e])
        right = np.array([-sin_a, cos_a, 0.0])
        return np.stack([right, np.cross(back, right), back])

    def project(self, points: ArrayLike) -> tuple[Array, Array]:
        """Perspective projection to picture coordinates and depths.

        Parameters
        ----------
        points : (..., 3) array_like, in the base frame [m]

        Returns
        -------
        places : (..., 2) array, in metres at the target
        depths : (...) array [m]
        """
        in_camera = (np.asarray(points) - self.target) @ self.axes().T
        depths = np.maximum(self.distance - in_camera[..., 2], _MIN_DEPTH_SHARE * self.distance)
        return in_camera[..., :2] * (self.distance / depths)[..., None], depths


def overview(scene: Scene, poses: Array, azimuth: float = -0.9, elevation: float = 0.35) -> tuple[Camera, float]:
    """Camera that shows all poses (n, nq) from a minimum distance, and the height of their lowest point."""
    bounds = np.stack([scene.bounds(q) for q in poses])  # (poses, 2, 3): lowest and highest corner of each
    low = bounds[:, 0].min(axis=0)
    high = bounds[:, 1].max(axis=0)
    size = max(scene.size, float(np.linalg.norm(high - low)))
    return Camera((low + high) / 2, CAMERA_DISTANCE * size, azimuth, elevation), float(low[2])


class Painter:
    """Painter of a scene as polygons, picture by picture; the floor is at height ``floor``."""

    def __init__(self, scene: Scene, camera: Camera, floor: float) -> None:
        self.scene = scene
        self.camera = camera
        self.floor = floor
        layers = {"looks"} if scene.dressed or scene.doubtful else {"looks", "inertia"}
        drawn_shapes = [shape for shape in scene.shapes if shape.layer in layers]
        coarse_scene = scene.decimated(_MAX_SHADOW_TRIANGLES)
        shadow_shapes = [shape for shape in coarse_scene.shapes if shape.layer == "looks"]
        self.parts = [(shape, shape.surface.placed(shape.pose)) for shape in drawn_shapes]
        """Drawn shapes with their surfaces in the frame of the body."""
        self.shades = [(shape, shape.surface.placed(shape.pose)) for shape in shadow_shapes]
        """Shapes that cast shadows, with their surfaces in the frame of the body."""

    def paint(self, q: Array) -> tuple[Array, Array]:
        """Triangles (k, 3, 2) with colours (k, 4) at q (nq,): first shadows, then shapes from far to near."""
        poses = self.scene.body_poses(q)
        corners = _corners_of_shapes(self.parts, poses)
        colours_by_part = []
        for shape, surface in self.parts:
            colour = (*shape.colour, _OPACITY[shape.layer])
            colours_by_part.append(np.tile(colour, (len(surface.faces), 1)))
        colours = np.concatenate(colours_by_part)
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        normals /= np.maximum(lengths, _MIN_NORMAL)
        _, _, back = self.camera.axes()
        eye = self.camera.target + self.camera.distance * back
        towards_eye = np.einsum("ij,ij->i", normals, eye - corners.mean(axis=1))  # above 0 for front faces
        is_shown = (towards_eye > 0) | (colours[:, 3] == 1.0)  # transparent shapes show front faces only
        corners = corners[is_shown]
        colours = colours[is_shown]
        towards_eye = towards_eye[is_shown]
        normals = normals[is_shown]
        sides = np.where(towards_eye < 0, -1.0, 1.0)  # back faces are lit from their own side
        normals = normals * sides[:, None]
        direct_light = np.maximum(normals @ _TO_LIGHT, 0.0)
        brightness = _AMBIENT_LIGHT + _SKY_LIGHT * normals[:, 2] + _DIRECT_LIGHT * direct_light
        colours[:, :3] = np.clip(colours[:, :3] * brightness[:, None], 0.0, 1.0)
        triangles, depths = self.camera.project(corners)
        far_to_near = np.argsort(-depths.mean(axis=1))
        shading_corners = _corners_of_shapes(self.shades, poses)
        heights = shading_corners[..., 2:] - self.floor
        light_per_height = _TO_LIGHT / _TO_LIGHT[2]  # way of the light for a height of 1
        corners_on_floor = shading_corners - heights * light_per_height
        shadows, _ = self.camera.project(corners_on_floor)
        shadow_colours = np.tile((*_SHADOW_COLOUR, 1.0), (len(shadows), 1))
        all_triangles = np.concatenate([shadows, triangles[far_to_near]])
        return all_triangles, np.concatenate([shadow_colours, colours[far_to_near]])

    def grid(self, size: float) -> Array:
        """Grid lines on the floor, (k, 2, 2), for a scene of this size [m]."""
        step = 10.0 ** np.floor(np.log10(size / 4))  # power of ten, with at least four cells in the scene
        count = int(np.ceil(0.9 * size / step))  # on each side, so that the grid is nearly twice the scene
        middle = np.round(self.camera.target[:2] / step) * step
        half_width = count * step
        offsets = np.arange(-count, count + 1) * step
        ends = np.array([[-half_width, half_width]]) + np.zeros((len(offsets), 1))
        both_offsets = np.stack([offsets, offsets], axis=1)
        lines_along_x = np.stack([ends, both_offsets], axis=-1)
        lines_along_y = np.stack([both_offsets, ends], axis=-1)
        lines = np.concatenate([lines_along_x, lines_along_y]) + middle
        heights = np.full((*lines.shape[:-1], 1), self.floor)
        lines_in_picture, _ = self.camera.project(np.concatenate([lines, heights], axis=-1))
        return lines_in_picture


def _corners_of_shapes(shapes: Sequence[tuple[Shape, Surface]], poses: Array) -> Array:
    """Corners of the triangles of all shapes, with their surfaces, in the base frame; (k, 3, 3)."""
    return np.concatenate([_base_corners(shape, surface, poses) for shape, surface in shapes])


def _base_corners(shape: Shape, surface: Surface, poses: Array) -> Array:
    """Corners of a shape's triangles (k, 3, 3) in the base frame."""
    corners = surface.vertices[surface.faces]
    if shape.body == BASE:
        return corners
    T = poses[shape.body]
    return np.asarray(corners @ T[:3, :3].T + T[:3, 3])


_MIN_SHADE = 0.28
"""Strength of the colours of the palest pose, from 0 to 1."""


def draw(
    axes: style.Axes,
    robot: Robot,
    q: ArrayLike,
    *,
    azimuth: float = -0.9,
    elevation: float = 0.35,
    floor: float | None = None,
    inertia: bool = True,
    scene: Scene | None = None,
) -> Camera:
    """Draw a robot into Matplotlib axes, at one configuration or at several of a motion.

    Parameters
    ----------
    axes : Matplotlib's Axes
    q : (nq,) or (n, nq) array_like, configurations; the first is drawn palest
    azimuth : float, of the camera about z [rad]
    elevation : float, above the horizontal [rad]
    floor : float, optional, height of the floor for the shadow [m]; None: below the lowest point of the robot
    inertia : bool, draw inertia ellipsoids of bodies without visuals

    Returns
    -------
    camera : Camera
        Its ``project`` maps points (..., 3) [m] of the base frame to the axes.

    Examples
    --------
    >>> import twistwrench as tw
    >>> from twistwrench.viz.style import figure
    >>> from twistwrench.viz import draw
    >>> with figure(4, 3, "two poses") as drawn:
    ...     camera = draw(drawn.subplots(), tw.robots.planar_2r(), [[0.0, 0.5], [0.3, 0.8]])
    >>> camera.project([0.0, 0.0, 0.0])[0].shape
    (2,)
    """
    style.require_matplotlib("Drawing a robot")
    from matplotlib.collections import PolyCollection

    poses = np.atleast_2d(arguments.finite(q, "draw: q", robot.nq, names=robot.coordinate_names))
    if poses.ndim > 2 or not len(poses):
        raise ShapeError(f"draw: q has shape {np.shape(q)}, expected ({robot.nq},), or (n, {robot.nq}) for n poses.")
    if scene is None:
        scene = scene_of(robot)
    camera, floor_height = overview(scene, poses, azimuth, elevation)
    if floor is not None:
        floor_height = arguments.number(floor, "draw: floor")
    painter = Painter(scene, camera, floor_height)
    shadow_count = sum(len(surface.faces) for _, surface in painter.shades)
    for k, pose in enumerate(poses):
        triangles, colours = painter.paint(pose)
        shade = 1.0
        if len(poses) > 1:
            shade = _MIN_SHADE + (1.0 - _MIN_SHADE) * (k + 1) / len(poses)
        colours[:, :3] = 1.0 - shade * (1.0 - colours[:, :3])
        edges = np.where(colours[:, 3:] < 1.0, 0.0, colours)  # edges hide seams of opaque shapes
        is_shadow = np.arange(len(triangles)) < shadow_count
        is_opaque = colours[:, 3] == 1.0  # only inertia ellipsoids are not
        is_shape = ~is_shadow & (inertia | is_opaque)
        layers = ((is_shadow, 1), (is_shape, 2))  # shadows lie below all poses
        for mask, layer in layers:
            options: dict[str, Any] = {"facecolors": colours[mask], "edgecolors": edges[mask], "linewidths": 0.3}
            axes.add_collection(PolyCollection(list(triangles[mask]), zorder=layer, **options))
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.set_axis_off()
    return camera


def still(
    robot: Robot,
    q: ArrayLike | None = None,
    joint: str | None = None,
    label: str = "",
    *,
    mark: Style = Style.POINTED,
    scene: Scene | None = None,
) -> bytes:
    """Picture of a robot at one configuration, with the link moved by ``joint`` in the colour ``mark``.

    Parameters
    ----------
    q : (nq,) array_like, optional, configuration; None: neutral, within the limits
    joint : str, optional, highlighted joint
    label : str, label of the joint
    mark : Style, meaning of the colour: over a limit, near it, or only named

    Returns
    -------
    image : bytes, PNG with a transparent background

    Examples
    --------
    >>> import twistwrench as tw
    >>> still(tw.robots.planar_2r(), [0.3, 0.5], "joint2", "joint2")[1:4]
    b'PNG'
    """
    q = starting_pose(robot) if q is None else np.asarray(q, float)
    if scene is None:
        scene = scene_of(robot)
    marked_bodies = _bodies_of_joint(robot, joint)
    shapes = []
    for shape in scene.shapes:
        if shape.body in marked_bodies and shape.layer == "looks":
            shape = replace(shape, colour=COLOURS[mark].scene)
        shapes.append(shape)
    with style.figure(6.4, 4.6, "", "Drawing the report") as drawn:
        axes = drawn.subplots()
        scene = replace(scene, shapes=tuple(shapes)).decimated(MAX_TRIANGLES)
        azimuth = _broadest_azimuth(scene, q)
        camera = draw(axes, robot, q, scene=scene, inertia=False, azimuth=azimuth)
        if label and marked_bodies:
            origin = scene.body_poses(q)[marked_bodies[0], :3, 3]
            (x, y), _ = camera.project(origin)
            _write_label(axes, float(x), float(y), label, COLOURS[mark].plot)
        buffer = BytesIO()
        drawn.savefig(buffer, format="png", dpi=150, transparent=True, bbox_inches="tight")
    return buffer.getvalue()


def _bodies_of_joint(robot: Robot, joint: str | None) -> list[int]:
    """Indices of the bodies moved by a joint, or by the joints of a coupled motor of this name; empty for None."""
    names = {joint}
    for coupling in robot.model.couplings:
        if joint in [coupling.label(motor) for motor in coupling.motors]:
            names.update(coupling.joints)
    return [k for k, body in enumerate(robot.model.bodies) if body.joint.name in names]


def _write_label(axes: style.Axes, x: float, y: float, label: str, colour: str) -> None:
    """Write a label beside the picture, on the side of a point to which a line leads."""
    left, right = axes.get_xlim()
    low, high = axes.get_ylim()
    height = (y - low) / (high - low)  # as a fraction of the axes
    place = (-0.02, height)  # just outside the axes
    alignment = "right"
    if x > (left + right) / 2:
        place = (1.02, height)
        alignment = "left"
    axes.annotate(
        label, (x, y), place, textcoords="axes fraction", ha=alignment, va="center", color=colour, fontsize=11,
        fontweight="bold", arrowprops={"arrowstyle": "-", "color": colour, "linewidth": 1.0},
    )  # fmt: skip


def first_frame(scene: Scene, q: Array, motion: DrawnMotion | None, width: int, max_bytes: int) -> bytes:
    """First frame of a page as WebP, of a given width in pixels and limited in bytes.

    Links of joints that pass their torque limits on the motion are red.

    Returns
    -------
    image : bytes

    Raises
    ------
    MissingExtraError
        Matplotlib is not installed.
    """
    from PIL import Image

    if motion is not None:
        scene = mark_overloaded_links(scene, motion)
    png = still(scene.robot, q, scene=scene)
    with Image.open(BytesIO(png)) as image:
        thumbnail = image.convert("RGBA")
        thumbnail.thumbnail((width, width))
        for quality in (80, 60, 40, 20):  # the best one that fits, or the last
            buffer = BytesIO()
            thumbnail.save(buffer, "WEBP", quality=quality)
            if buffer.tell() <= max_bytes:
                break
    return buffer.getvalue()


def _broadest_azimuth(scene: Scene, q: Array) -> float:
    """Azimuth [rad] of the view in which the origins of the robot's bodies take the largest area, of four views."""
    poses = scene.body_poses(q)
    origins = poses[np.isfinite(poses[:, 0, 3]), :3, 3]
    points = np.concatenate([np.zeros((1, 3)), origins])
    middle = points.mean(axis=0)
    azimuths = [Camera.azimuth + k * np.pi / 4 for k in (0, 1, -1, 2)]  # the usual one first
    views = [Camera(middle, CAMERA_DISTANCE * scene.size, azimuth) for azimuth in azimuths]

    def picture_area(view: Camera) -> float:
        points_in_picture, _ = view.project(points)
        return float(np.prod(np.ptp(points_in_picture, axis=0)))

    return max(views, key=picture_area).azimuth


def mark_overloaded_links(scene: Scene, motion: DrawnMotion) -> Scene:
    """Scene without inertia ellipsoids, with links of joints over their torque limits in red."""
    effort = motion.limits.effort
    shares = motion.peaks / np.where(effort > 0, effort, np.inf)  # an effort of 0 means that no limit is known
    is_over = over_limit(shares)
    overloaded_bodies = set()
    for k, body in enumerate(scene.robot.model.bodies):
        _, velocities = body.places
        if not body.follows and is_over[velocities].any():
            overloaded_bodies.add(k)
    shapes = []
    for shape in scene.shapes:
        if shape.layer != "looks":
            continue
        if shape.body in overloaded_bodies:
            shape = replace(shape, colour=COLOURS[Style.OVER].scene)
        shapes.append(shape)
    return replace(scene, shapes=tuple(shapes))


complete(globals())
