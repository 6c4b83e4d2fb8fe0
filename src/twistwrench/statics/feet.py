"""Feet of legged robots: their frames, the corners of their soles."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import ShapeError, ValueRangeError
from ..core.glossary import complete
from ..core.gravity import vertical_axis
from ..core.numbers import vector
from ..core.typing import Array
from ..mechanics.lie import se3
from ..mechanics.model.legs import frame_poses, legs_of
from ..mechanics.model.model import BASE
from ..robot.base import require_robot
from .contacts import Contact, tangents

if TYPE_CHECKING:
    from ..robot import Robot
    from ..shapes.solids import Solid

_FOOT_WORDS = ("foot", "sole", "ankle", "wheel", "toe")
"""Words in the names of frames at which a leg stands."""
_SENSOR_WORDS = ("bumper", "sensor", "fsr", "tactel", "imu", "camera")
"""Words in the names of frames of sensors, at which a leg does not stand."""
_SAME_HEIGHT = 0.01
"""Height above the lowest frame of a leg up to which a frame may be the foot [m]."""
_SOLE_HEIGHT = 0.005
"""Height above the lowest point of a shape up to which its corners belong to the sole [m]."""
_MAX_CORNERS = 8
"""Largest number of corners of a sole."""
MIN_SOLE_WIDTH = 1e-3
"""Width below which the lowest points of a shape are one point or a line [m]."""


def upward(robot: Robot) -> Array:
    """Normal (3,) of a level floor in the base frame: the world's vertical axis."""
    return vertical_axis(robot.model.gravity)


def find_feet(robot: Robot, q: ArrayLike | None = None) -> tuple[str, ...]:
    """Frames at which a legged robot stands: the lowest frame of each leg, or a frame as low that has the name of a foot.

    Parameters
    ----------
    q : (nq,) array_like, optional, configuration in which heights are compared; None: neutral

    Returns
    -------
    frames : tuple of str, empty if the robot does not look legged

    Notes
    -----
    Legs are branches of two joints or more that reach the lowest frames of the robot in its neutral configuration, well below
    everything that is fixed to the base. The base need not be floating in the file.

    Examples
    --------
    >>> import twistwrench as tw
    >>> find_feet(tw.robots.quadruped()), find_feet(tw.robots.ur5())
    (('FL_foot', 'FR_foot', 'RL_foot', 'RR_foot'), ())
    """
    model = require_robot(robot, "find_feet").model
    if q is None:
        q = robot.neutral
    else:
        q = arguments.finite(arguments.one(q, "q", robot.nq), "q", robot.nq)
    poses = frame_poses(model, np.asarray(q, float))
    up = upward(robot)
    feet = []
    for links in legs_of(model):
        heights = {name: float(poses[name][:3, 3] @ up) for name in links}
        max_height = min(heights.values()) + _SAME_HEIGHT
        low_links = [name for name in links if heights[name] <= max_height]
        links_without_sensors = [name for name in low_links if not _has_word(name, _SENSOR_WORDS)]
        candidates = links_without_sensors or low_links
        links_named_foot = [name for name in candidates if _has_word(name, _FOOT_WORDS)]
        shaped_links = [name for name in links_named_foot if name in model.shaped]
        preferred_links = shaped_links or links_named_foot or candidates
        feet.append(preferred_links[-1])  # the farthest along the leg
    return tuple(dict.fromkeys(feet))  # each once


def _has_word(name: str, words: Sequence[str]) -> bool:
    """True if a name contains one of the words, in any case."""
    return any(word in name.lower() for word in words)


def sole(
    robot: Robot,
    frame: str,
    friction: float,
    size: Sequence[float] | None = None,
    at: ArrayLike = (0.0, 0.0, 0.0),
    *,
    q: ArrayLike | None = None,
    normal: ArrayLike | None = None,
) -> tuple[Contact, ...]:
    """Contacts of a foot at the corners of its shape's lowest face, or of a rectangle; without a shape, one at the frame.

    Parameters
    ----------
    friction : float, Coulomb coefficient of the ground
    size : (length, width), optional, rectangle along x and y of the frame [m]; None: from the shape in the robot's file
    at : (3,) array_like, middle of the rectangle, or place of the point, in the frame [m]
    q : (nq,) array_like, optional, configuration that shows which side of the shape is below; None: neutral
    normal : (3,) array_like, optional, of the ground, in the base frame; None: the world's vertical axis

    Returns
    -------
    contacts : tuple of Contact, with this normal

    Notes
    -----
    The lowest face is the convex hull of the shape's lowest 5 mm, with at most eight corners. A ball stands on one point. A
    shape whose mesh is missing is left out.

    Examples
    --------
    >>> import twistwrench as tw
    >>> dog = tw.robots.quadruped()
    >>> len(sole(dog, "FL_foot", 0.6)), len(sole(dog, "FL_foot", 0.6, size=(0.1, 0.05)))
    (1, 4)
    """
    _require_moving_frame(robot, frame)
    middle = arguments.finite(arguments.one(at, "at", 3), "at", 3)
    if normal is None:
        normal = upward(robot)
    radius = 0.0
    if size is not None:
        length, width = arguments.one(size, "size", 2).tolist()
        length = arguments.positive(length, "the size of a sole", "m")
        width = arguments.positive(width, "the size of a sole", "m")
        offsets = 0.5 * np.array([(length, width, 0), (length, -width, 0), (-length, -width, 0), (-length, width, 0)])
        points = [np.asarray(middle + offset) for offset in offsets]
    else:
        points, radius = _lowest_face(robot, frame, q)
        if not points:  # the frame has no shape
            points = [np.asarray(middle, float)]
    return tuple(Contact(point, normal, friction, frame, radius=radius) for point in points)


def wheel(robot: Robot, frame: str, friction: float, *, normal: ArrayLike | None = None) -> Contact:
    """Contact of a wheel at its lowest point, in any rotation of the wheel; at the frame if the file has no shape.

    Parameters
    ----------
    frame : str, at the wheel's centre
    friction : float, Coulomb coefficient of the ground; 0 for a caster
    normal : (3,) array_like, optional, of the ground, in the base frame; None: the world's vertical axis

    Returns
    -------
    contact : Contact

    Examples
    --------
    >>> import twistwrench as tw
    >>> wheel(tw.robots.quadruped(), "FL_foot", 0.6).radius
    0.0
    """
    _require_moving_frame(robot, frame)
    points, ball_radius = _lowest_face(robot, frame, None)
    down = _down_in_frame(robot, frame, robot.neutral)
    depth = max((float(point @ down) for point in points), default=0.0)  # below the wheel's centre [m]
    if normal is None:
        normal = upward(robot)
    wheel_radius = max(depth + ball_radius, 0.0)
    return Contact((0.0, 0.0, 0.0), normal, friction, frame, radius=wheel_radius)


def _down_in_frame(robot: Robot, frame: str, q: Array) -> Array:
    """Direction (3,) of the floor in a frame of the robot in a configuration."""
    poses = frame_poses(robot.model, q)
    R = poses[frame][:3, :3]
    return np.asarray(-R.T @ upward(robot))


def _require_moving_frame(robot: Robot, frame: str) -> None:
    """Raise ValueRangeError for a frame that is fixed to the base."""
    if require_robot(robot, "sole").model.frame(frame).body == BASE:
        raise ValueRangeError(f"{frame!r} is fixed to the base of robot {robot.name!r}. Give a frame of a leg.")


def patch(
    frame: str | None,
    corners: ArrayLike,
    normal: ArrayLike,
    friction: float,
    push: float = np.inf,
    pull: float = 0.0,
) -> tuple[Contact, ...]:
    """Contacts at the corners of a pad, a suction cup or a flange, which share the largest force and the preload.

    Parameters
    ----------
    frame : str, optional, link that carries the pad; None for one body
    corners : (k, 3) array_like, in the frame [m]
    normal : (3,) array_like, into the held body
    push : float, largest sum of the normal forces [N]
    pull : float, force that pulls all corners together [N]

    Returns
    -------
    contacts : tuple of Contact, of one group

    Examples
    --------
    >>> ring = patch(None, [(0.02, 0, 0), (-0.01, 0.017, 0), (-0.01, -0.017, 0)], (0, 0, 1), 0.5, pull=60.0)
    >>> ring[0].pull, len({contact.group for contact in ring})
    (20.0, 1)
    """
    points = arguments.finite(corners, "corners", 3)
    if points.ndim != 2:
        raise ShapeError(f"corners have the shape {points.shape}. Give (k, 3), a point each [m].")
    centre = points.mean(axis=0)
    direction = arguments.finite(normal, "normal", 3)
    group = f"patch at {vector(centre)} towards {vector(direction)}"
    pull_of_corner = pull / len(points)
    return tuple(Contact(point, normal, friction, frame, push, pull_of_corner, group) for point in points)


def _lowest_face(robot: Robot, frame: str, q: ArrayLike | None) -> tuple[list[Array], float]:
    """Corners of the lowest face of a frame's shape, in the frame, and 0; for balls, their centres and their radius.

    The lowest faces in the neutral configuration and in q are compared; the wider one is returned, or the face in q if both
    are equally wide. Without a shape there are no corners.
    """
    T = np.asarray(robot.model.frame(frame).pose)
    shapes = [(se3.inverse(T) @ link_pose, solids) for link_pose, solids in _solids_at(robot, frame)]
    if not any(solids for _, solids in shapes):
        return [], 0.0
    corners, radius = _face_towards(shapes, _down_in_frame(robot, frame, robot.neutral))
    if q is None:
        return corners, radius
    corners_in_q, radius_in_q = _face_towards(shapes, _down_in_frame(robot, frame, np.asarray(q, float)))
    if _width(corners_in_q) >= _width(corners):
        return corners_in_q, radius_in_q
    return corners, radius


def _width(corners: Sequence[Array]) -> float:
    """Largest extent of corners (3,) along an axis [m]."""
    return float(np.ptp(corners, axis=0).max())


def _solids_at(robot: Robot, frame: str) -> Iterator[tuple[Array, Sequence[Solid]]]:
    """Pose in the body, and shapes, of a link; if the link has no shape, of each link that is fixed to it.

    Visual shapes are taken only if there are no collision shapes.
    """
    from ..shapes.meshes import MeshFiles
    from ..shapes.reader import read_shapes
    from ..shapes.solids import SolidReader

    model = robot.model
    shapes_by_link = {shapes.link: shapes for shapes in read_shapes(model)}
    mesh_files = MeshFiles(Path(model.source) if model.source else None)
    reader = SolidReader(mesh_files)
    body = model.frame(frame).body
    frames_of_body = [name for name, other in model.frames.items() if other.body == body]
    for links in ([frame], frames_of_body):
        solids_by_link = {name: reader.read(shapes_by_link[name]).solids for name in links if name in shapes_by_link}
        for role in ("collision", "visual"):
            solids_of_role: dict[str, list[Solid]] = {}
            for name, solids in solids_by_link.items():
                solids_of_role[name] = [solid for solid in solids if solid.shape.role == role]
            if any(solids_of_role.values()):
                for name, solids_of_link in solids_of_role.items():
                    yield np.asarray(model.frames[name].pose), solids_of_link
                return


def _radius(solid: Solid) -> float:
    """Radius of a ball [m]; 0 for other shapes, which end in corners."""
    if solid.shape.kind != "sphere":
        return 0.0
    return solid.shape.sizes[0]  # the radius comes first


def _face_towards(shapes: Sequence[tuple[Array, Sequence[Solid]]], down: Array) -> tuple[list[Array], float]:
    """Corners of the lowest face of shapes, and 0; if the lowest shapes are balls of one radius, their centres and radius.

    The face is the hull of all points within 5 mm of the lowest point, moved to the height of the lowest point. ``down`` is the
    direction of the floor.
    """
    solid_points = [(solid, _points_towards(T, solid, down)) for T, solids in shapes for solid in solids]
    largest_depth = max(float((points @ down).max()) for _, points in solid_points)
    sole_depth = largest_depth - _SOLE_HEIGHT
    points_of_lowest = []
    radii = set()
    for solid, points_of_solid in solid_points:
        if (points_of_solid @ down).max() >= sole_depth:
            points_of_lowest.append(points_of_solid)
            radii.add(_radius(solid))
    points = np.concatenate(points_of_lowest)
    radius = radii.pop() if len(radii) == 1 else 0.0
    sole_points = points[points @ down >= sole_depth]
    axes = tangents(down)
    plane_corners = _corners(sole_points @ axes.T)
    depth = largest_depth - radius
    return [np.asarray(corner @ axes + depth * down) for corner in plane_corners], radius


def _points_towards(T: Array, solid: Solid, down: Array) -> Array:
    """Corners (k, 3) of a shape in the frame in which its link has pose T; for a ball, its lowest point."""
    if solid.shape.kind == "sphere":
        ball_pose = T @ solid.shape.pose
        lowest_point = np.asarray(ball_pose[:3, 3] + _radius(solid) * down)
        return lowest_point[None]
    return np.asarray(solid.points @ T[:3, :3].T + T[:3, 3])


def _corners(points: Array) -> Array:
    """Corners (k, 2) of the convex hull of points (n, 2); two ends if the hull is a line, the middle if it is a point.

    While there are too many corners, the corner is dropped that has the smallest triangle with its neighbours.
    """
    from scipy.spatial import ConvexHull

    centre = points.mean(axis=0)
    _, singular_values, axes = np.linalg.svd(points - centre, full_matrices=False)
    along_axes = (points - centre) @ axes.T  # coordinates along the principal axes
    is_wide = np.ptp(along_axes, axis=0) > MIN_SOLE_WIDTH
    if not is_wide.any() or not len(singular_values):
        return centre[None]
    if not is_wide.all():  # a line
        along_line = along_axes[:, int(np.argmax(is_wide))]
        ends = [int(along_line.argmin()), int(along_line.argmax())]
        return points[ends]
    hull = points[ConvexHull(points).vertices]
    while len(hull) > _MAX_CORNERS:
        u = hull - np.roll(hull, 1, axis=0)  # from the corner before
        v = np.roll(hull, -1, axis=0) - hull  # to the corner after
        doubled_areas = np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
        hull = np.delete(hull, int(doubled_areas.argmin()), axis=0)
    return np.asarray(hull)


complete(globals())
