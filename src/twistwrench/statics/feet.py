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

_FOOT_WORDS = "foot", "sole", "ankle", "wheel", "toe"
"""Words in the names of frames at which a leg stands."""
_SENSOR_WORDS = "bumper", "sensor", "fsr", "tactel", "imu", "camera"
"""Words in the names of frames that a leg carries, and does not stand on."""
_SAME_HEIGHT = 0.01
"""Height above the lowest frame of a leg within which a frame named as a foot is preferred [m]."""
_SOLE = 0.005
"""Height above the lowest point of a shape up to which its corners belong to the sole [m]."""
_CORNERS = 8
"""Most corners of a sole."""
MIN_SOLE_WIDTH = 1e-3
"""Width below which the lowest points of a shape are one point or a line [m]."""


def upward(robot: Robot) -> Array:
    """Normal (3,) of a level floor in the base frame: the world's vertical axis. Gravity may lean from it, as on a slope."""
    return vertical_axis(robot.model.gravity)


def find_feet(robot: Robot, q: ArrayLike | None = None) -> tuple[str, ...]:
    """Frames at which a legged robot stands: of each leg the lowest frame, or the one beside it that is named as a foot.

    Parameters
    ----------
    q : (nq,) array_like, optional, configuration in which heights are compared; None: neutral

    Returns
    -------
    frames : tuple of str, empty if the robot does not look legged

    Notes
    -----
    Legs are branches of two joints or more that reach the lowest frames of the robot in its neutral configuration, well below
    everything that is fixed to the base; the file need not say that its base floats.

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
    poses, up = frame_poses(model, np.asarray(q, float)), upward(robot)
    feet = []
    for links in legs_of(model):
        heights = {name: float(poses[name][:3, 3] @ up) for name in links}
        lowest = min(heights.values())
        near = [name for name in links if heights[name] <= lowest + _SAME_HEIGHT]
        near = [name for name in near if not _has_word(name, _SENSOR_WORDS)] or near
        with_foot_name = [name for name in near if _has_word(name, _FOOT_WORDS)]
        with_shape = [name for name in with_foot_name if name in model.shaped]
        feet.append((with_shape or with_foot_name or near)[-1])
    return tuple(dict.fromkeys(feet))


def _has_word(name: str, words: Sequence[str]) -> bool:
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
    """Contacts of a foot: corners of its shape's lowest face, of a rectangle, or one point at the frame without a shape.

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
    shape whose mesh is missing counts as none.

    Examples
    --------
    >>> import twistwrench as tw
    >>> dog = tw.robots.quadruped()
    >>> len(sole(dog, "FL_foot", 0.6)), len(sole(dog, "FL_foot", 0.6, size=(0.1, 0.05)))
    (1, 4)
    """
    _moving_frame(robot, frame)
    middle = arguments.finite(arguments.one(at, "at", 3), "at", 3)
    if normal is None:
        normal = upward(robot)
    if size is not None:
        sizes = arguments.one(size, "size", 2).tolist()
        length, width = (arguments.positive(x, "the size of a sole", "m") for x in sizes)
        offsets = 0.5 * np.array([(length, width, 0), (length, -width, 0), (-length, -width, 0), (-length, width, 0)])
        points, radius = [np.asarray(middle + offset) for offset in offsets], 0.0
    else:
        points, radius = _lowest_face(robot, frame, q)
        points = points or [np.asarray(middle, float)]
    return tuple(Contact(point, normal, friction, frame, radius=radius) for point in points)


def wheel(robot: Robot, frame: str, friction: float, *, normal: ArrayLike | None = None) -> Contact:
    """Contact of a wheel at its lowest point, however it has turned; at the frame if the file has no shape.

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
    _moving_frame(robot, frame)
    points, radius = _lowest_face(robot, frame, None)
    up = frame_poses(robot.model, robot.neutral)[frame][:3, :3].T @ upward(robot)
    depth = max((-float(point @ up) for point in points), default=0.0)
    if normal is None:
        normal = upward(robot)
    return Contact((0.0, 0.0, 0.0), normal, friction, frame, radius=max(depth + radius, 0.0))


def _moving_frame(robot: Robot, frame: str) -> None:
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
    """Contacts of a pad, a suction cup or a flange: its corners, which share the largest force and the preload.

    Parameters
    ----------
    frame : str, optional, link that carries it; None for one body
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
    group = f"patch at {vector(points.mean(axis=0))} towards {vector(arguments.finite(normal, 'normal', 3))}"
    return tuple(Contact(p, normal, friction, frame, push, pull / len(points), group) for p in points)


def _lowest_face(robot: Robot, frame: str, q: ArrayLike | None) -> tuple[list[Array], float]:
    """Corners of a frame's shape at its lowest side, in the frame, or the centres of balls and their radius.

    Of those in two configurations, the wider are taken.
    """
    T = np.asarray(robot.model.frame(frame).pose)
    shapes = [(se3.inverse(T) @ link, solids) for link, solids in _solids_at(robot, frame)]
    if not any(solids for _, solids in shapes):
        return [], 0.0
    configurations = [robot.neutral]
    if q is not None:
        configurations.append(np.asarray(q, float))
    faces = []
    for configuration in configurations:
        down = -frame_poses(robot.model, configuration)[frame][:3, :3].T @ upward(robot)
        faces.append(_face_towards(shapes, down))
    return max(reversed(faces), key=lambda face: float(np.ptp(face[0], axis=0).max()))  # of equal ones the last


def _solids_at(robot: Robot, frame: str) -> Iterator[tuple[Array, Sequence[Solid]]]:
    """Poses in the body, and shapes, of a link; of all links fixed to it if it has none of its own."""
    from ..shapes.meshes import MeshFiles
    from ..shapes.reader import read_shapes
    from ..shapes.solids import SolidReader

    model = robot.model
    described = {shapes.link: shapes for shapes in read_shapes(model)}
    reader = SolidReader(MeshFiles(Path(model.source) if model.source else None))
    siblings = [name for name, other in model.frames.items() if other.body == model.frame(frame).body]
    for links in ([frame], siblings):
        solids_by_link = {name: reader.read(described[name]).solids for name in links if name in described}
        for role in ("collision", "visual"):
            with_role = {}
            for name, solids in solids_by_link.items():
                with_role[name] = [solid for solid in solids if solid.shape.role == role]
            if any(with_role.values()):
                for name, role_solids in with_role.items():
                    yield np.asarray(model.frames[name].pose), role_solids
                return


def _radius(solid: Solid) -> float:
    """Radius of a ball [m]; 0 for other shapes, which end in corners."""
    if solid.shape.kind == "sphere":
        return solid.shape.sizes[0]
    return 0.0


def _face_towards(shapes: Sequence[tuple[Array, Sequence[Solid]]], down: Array) -> tuple[list[Array], float]:
    """Corners, at the lowest height, of the hull of what lies within 5 mm of it; of balls their centres, and the radius."""
    solid_points = [(solid, _points_towards(T, solid, down)) for T, solids in shapes for solid in solids]
    lowest = max(float((points @ down).max()) for _, points in solid_points)
    near_points, radii = [], set()
    for solid, points_of_solid in solid_points:
        if (points_of_solid @ down).max() >= lowest - _SOLE:
            near_points.append(points_of_solid)
            radii.add(_radius(solid))
    points = np.concatenate(near_points)
    radius = 0.0
    if len(radii) == 1:
        radius = radii.pop()
    axes = tangents(down)
    corners = _corners(points[points @ down >= lowest - _SOLE] @ axes.T)
    return [np.asarray(corner @ axes + (lowest - radius) * down) for corner in corners], radius


def _points_towards(T: Array, solid: Solid, down: Array) -> Array:
    """Corners (k, 3) of a shape; of a ball the lowest point."""
    if solid.shape.kind == "sphere":
        return np.asarray((T @ solid.shape.pose)[:3, 3] + solid.shape.sizes[0] * down)[None]
    return np.asarray(solid.points @ T[:3, :3].T + T[:3, 3])


def _corners(flat: Array) -> Array:
    """Corners (k, 2) of the convex hull of points in a plane; ends of a line, or the middle of a point."""
    from scipy.spatial import ConvexHull

    centre = flat.mean(axis=0)
    _, widths, axes = np.linalg.svd(flat - centre, full_matrices=False)
    along = (flat - centre) @ axes.T
    wide = np.ptp(along, axis=0) > MIN_SOLE_WIDTH
    if not wide.any() or not len(widths):
        return centre[None]
    if not wide.all():
        first = int(np.argmax(wide))
        return flat[[int(along[:, first].argmin()), int(along[:, first].argmax())]]
    hull = flat[ConvexHull(flat).vertices]
    while len(hull) > _CORNERS:
        before, after = np.roll(hull, 1, axis=0), np.roll(hull, -1, axis=0)
        u, v = hull - before, after - hull
        hull = np.delete(hull, int(np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]).argmin()), axis=0)
    return np.asarray(hull)


complete(globals())
