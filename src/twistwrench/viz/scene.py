"""Scenes of a robot: surfaces fixed to its bodies, from its file, or a skeleton from its dimensions."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..core.errors import InertiaError, ModelWarning
from ..core.typing import Array
from ..mechanics.algorithms.recursion import base_poses, joint_poses
from ..mechanics.lie import se3, so3
from ..mechanics.model.model import BASE, Body, Model
from ..shapes.surface import Colour, Surface, box, cylinder, ellipsoid, sphere
from ..shapes.visuals import Visual, read_visuals

if TYPE_CHECKING:
    from ..mechanics.bodies.inertia import SpatialInertia
    from ..mechanics.joints import Joint
    from ..robot import Robot

Part = tuple[int, Surface, tuple[float, float, float]]
"""Part of a skeleton: index of a body, surface in the body's frame, colour."""

# Colours of the parts of a skeleton and of payloads, as red, green, blue from 0 to 1.
TUBE = (0.86, 0.88, 0.90)
JOINT = (0.23, 0.27, 0.33)
GROUND = (0.55, 0.59, 0.64)
ELLIPSOID = (0.20, 0.46, 0.72)
PAYLOAD = (0.84, 0.37, 0.0)
_MAX_LISTED_LINKS = 4
"""Largest number of links in a note."""
_TUBE_RADIUS = 0.022
"""Radius of a tube, as a share of the robot's size."""
_STEEL_DENSITY = 7850.0
"""Density of the balls that represent point masses [kg/m³]."""
_MIN_SIZE = 1e-6
"""Extent of the joints, frames and masses [m] below which it is not the size of the robot."""


@dataclass(frozen=True, eq=False)
class Skeleton:
    """Parts that represent a robot without visuals."""

    looks: list[Part]
    """Tubes, joints and the ground."""
    ellipsoids: list[Part]
    """Ellipsoids with each body's mass and moments."""
    size: float
    """Diagonal of the box around joints, frames and masses [m]."""


def skeleton(model: Model) -> Skeleton:
    """Parts of all bodies except rotors, and of a fixed base."""
    bodies = {k: body for k, body in enumerate(model.bodies) if body.joint.moves_body}
    points = _key_points(model)
    all_points = np.concatenate([np.zeros((1, 3)), *points.values()])
    size = float(np.linalg.norm(np.ptp(all_points, axis=0)))
    if size < _MIN_SIZE:  # a single floating body: twice the longest axis of its ellipsoid
        lengths = [4.0 * _semi_axes(body.inertia).max() for body in bodies.values() if body.inertia.mass > 0]
        size = max(lengths, default=1.0)
    thickness = _TUBE_RADIUS * size  # unit of all thicknesses
    looks: list[Part] = []
    child_joints: dict[int, list[Array]] = {k: [] for k in (BASE, *bodies)}  # points in the frame of the parent
    for k, body in bodies.items():
        joint_point = _axis_point(body.joint)
        child_joints[body.parent].append(body.placement[:3, :3] @ joint_point + body.placement[:3, 3])
        looks += _parts(k, _joint_surfaces(body.joint, joint_point, thickness), JOINT)
        looks += _parts(body.parent, _rail_surfaces(model, body, size, thickness), TUBE)
    for k, body in bodies.items():  # tubes from the joint of each body to the joints of its children
        start = _axis_point(body.joint)
        if body.joint.nv > 1 and body.inertia.mass > 0:  # a floating body has no axis
            start = np.array(body.inertia.com, float)
        ends = child_joints[k]
        if not ends:
            ends = _outermost_point(model, k, start)
        for end in ends:
            looks += _parts(k, _tube_surfaces(start, end, thickness), TUBE)
    if all(body.joint.driven or body.parent != BASE for body in bodies.values()):  # the base is fixed
        foot_pose = se3.pose(np.eye(3), [0, 0, -0.25 * thickness])
        looks.append((BASE, cylinder(2.6 * thickness, 0.5 * thickness).placed(foot_pose), GROUND))
        for end in child_joints[BASE]:
            looks += _parts(BASE, _tube_surfaces(np.zeros(3), end, thickness), GROUND)
    ellipsoids: list[Part] = []
    for k, body in bodies.items():
        ellipsoids += _parts(k, equal_inertia_ellipsoid(body.inertia), ELLIPSOID)
    bodies_with_looks = {k for k, _, _ in looks}
    # A body without tubes, such as a single floating one, looks like its ellipsoid.
    looks += [(k, surface, TUBE) for k, surface, _ in ellipsoids if k not in bodies_with_looks]
    return Skeleton(looks, ellipsoids, size)


def equal_inertia_ellipsoid(G: SpatialInertia) -> list[Surface]:
    """Uniform ellipsoid with the mass, centre and moments of G, in its frame; empty without mass.

    With principal moments I: a² = 5 (I_b + I_c - I_a) / (2 m). Points and rods have no such ellipsoid, so semi-axes are
    at least the radius of a steel ball of the same mass.
    """
    if not G.mass > 0:
        return []
    try:
        _, R = G.principal()
    except (InertiaError, ValueError):
        return []  # no real body has this inertia
    return [ellipsoid(_semi_axes(G)).placed(se3.pose(R, G.com))]


def _semi_axes(G: SpatialInertia) -> Array:
    """Semi-axes (3,) of the ellipsoid [m]; see :func:`equal_inertia_ellipsoid`."""
    I, _ = G.principal()
    squares = 5.0 * (I.sum() - 2.0 * I) / (2.0 * G.mass)
    return np.asarray(np.sqrt(np.maximum(squares, _ball_radius(G.mass) ** 2)))


def _ball_radius(mass: float) -> float:
    """Radius of a steel ball [m]."""
    return float((3.0 * mass / (4.0 * math.pi * _STEEL_DENSITY)) ** (1 / 3))


def _key_points(model: Model) -> dict[int, Array]:
    """Points (n, 3) of each body in the base frame, with the robot neutral: of its joint, its mass and its frames."""
    poses: dict[int, Array] = {BASE: np.eye(4)}
    body_points: dict[int, list[Array]] = {BASE: []}  # in the frame of the body
    q = model.neutral
    for k, body in enumerate(model.bodies):
        coordinates = body.joint.neutral
        if body.joint.nq == 1:  # a follower depends on its leader
            q_indices, _ = body.places
            coordinates = body.ratio * q[q_indices] + body.offset
        poses[k] = poses[body.parent] @ body.placement @ np.asarray(body.joint.pose(coordinates), float)
        body_points[k] = [_axis_point(body.joint)]
        if body.inertia.mass > 0:
            body_points[k].append(np.array(body.inertia.com, float))
    for frame in model.frames.values():
        body_points[frame.body].append(frame.pose[:3, 3])
    base_points = {}
    for k, points in body_points.items():
        if points:
            base_points[k] = np.stack(points) @ poses[k][:3, :3].T + poses[k][:3, 3]
    return base_points


def _axis_point(joint: Joint) -> Array:
    """Point of a revolute joint's axis nearest to the child's origin; the origin for other joints."""
    screw = joint.axes[0]
    w, v = screw[:3], screw[3:]
    if joint.nv != 1 or not w.any():
        return np.zeros(3)
    return np.asarray(so3.cross(w, v) / (w @ w))


def _parts(body: int, surfaces: Iterable[Surface], colour: Colour) -> list[Part]:
    """Parts of a body with the same colour."""
    return [(body, surface, colour) for surface in surfaces]


def _outermost_point(model: Model, k: int, start: Array) -> list[Array]:
    """Point where the tube of a last body ends, in a list: the farthest of its frames and its centre of mass; empty if none."""
    points = [frame.pose[:3, 3] for frame in model.frames.values() if frame.body == k]
    G = model.bodies[k].inertia
    if G.mass > 0:
        points.append(np.array(G.com, float))
    if not points:
        return []
    return [max(points, key=lambda point: float(np.linalg.norm(point - start)))]


def _joint_surfaces(joint: Joint, point: Array, thickness: float) -> list[Surface]:
    """Short cylinder along the axis of a revolute joint, or box around a prismatic joint; empty for other joints."""
    if joint.nv != 1:
        return []
    screw = joint.axes[0]
    w, v = screw[:3], screw[3:]
    if w.any():
        surface = cylinder(1.45 * thickness, 3.4 * thickness)  # radius and length, wider than a tube
        axis = w
    else:
        surface = box((2.6 * thickness, 2.6 * thickness, 4.0 * thickness))  # longest along the axis
        axis = v
    return [surface.placed(se3.pose(turned_z(axis), point))]


def _rail_surfaces(model: Model, body: Body, size: float, thickness: float) -> list[Surface]:
    """Rail of a sliding body in its parent's frame, between its limits; empty for other bodies.

    An end without a limit is a quarter of the robot's size from the middle.
    """
    screw = body.joint.axes[0]
    w, v = screw[:3], screw[3:]
    if body.joint.nv != 1 or w.any():
        return []
    limits = np.array([model.limits.lower[body.v_index], model.limits.upper[body.v_index]])
    ends = limits * body.ratio + body.offset  # a follower moves by the ratio to its leader
    default_ends = [-size / 4, size / 4]
    ends = np.where(np.isfinite(ends), np.clip(ends, -size, size), default_ends)
    R, origin = body.placement[:3, :3], body.placement[:3, 3]
    start = R @ (ends[0] * v) + origin
    end = R @ (ends[1] * v) + origin
    return _tube_surfaces(start, end, 0.5 * thickness)


def _tube_surfaces(start: Array, end: Array, thickness: float) -> list[Surface]:
    """Tube with round ends between two points; empty if they are close."""
    length = float(np.linalg.norm(end - start))
    if length < 0.5 * thickness:
        return []
    T = se3.pose(turned_z(end - start), (start + end) / 2)
    radius = 0.8 * thickness
    return [cylinder(radius, length, round_ends=True).placed(T)]


def turned_z(direction: Array) -> Array:
    """Rotation (3, 3) that takes z to ``direction`` (3,), which may have any non-zero length."""
    z = np.asarray(direction, float) / np.linalg.norm(direction)
    x = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = x - z * (z @ x)
    x = x / np.linalg.norm(x)
    return np.stack([x, so3.cross(z, x), z], axis=1)


# ── Shapes and scenes

_MIN_TRIANGLES = 60
"""Minimum number of triangles per shape in a decimated scene."""
_MIN_DOUBTFUL_SHARE = 0.8
"""Length of an inertia ellipsoid, over the robot's size, above which it is doubtful."""


@dataclass(frozen=True, eq=False)
class Shape:
    """Surface of one colour fixed to a body."""

    body: int
    """Body index; ``BASE`` for shapes that do not move."""
    surface: Surface
    """Vertices and triangles."""
    pose: Array
    """Pose (4, 4) in the frame of the body."""
    colour: Colour
    """Red, green, blue, 0 to 1."""
    layer: str
    """``looks`` for visuals; ``inertia`` for the ellipsoid with each body's mass and moments."""


@dataclass(frozen=True, eq=False)
class Scene:
    """Scene: a robot and its shapes.

    Examples
    --------
    >>> import twistwrench as tw
    >>> scene = scene_of(tw.robots.planar_2r())
    >>> scene.body_poses([0.0, 0.0]).shape, scene.bounds([0.0, 0.0]).shape
    ((2, 4, 4), (2, 3))
    >>> len(scene.decimated(100).shapes) == len(scene.shapes)
    True
    """

    robot: Robot
    """The robot."""
    shapes: tuple[Shape, ...]
    """Drawn shapes."""
    remarks: tuple[str, ...]
    """Remarks on shapes that could not be drawn as in the file."""
    size: float
    """Length to which marks and cameras are scaled [m]: the diagonal of the neutral robot's bounding box."""
    dressed: bool
    """True if the file has visuals for any body."""

    @property
    def doubtful(self) -> tuple[str, ...]:
        """Links with an implausible inertia ellipsoid: about as long as the robot, and too long for their own shape.

        If all mass is within a distance ρ of its centre, semi-axes are at most √5 ρ, as for mass at both ends of a rod. A
        slender uniform rod has 1.29 ρ.
        """
        bodies = self.robot.model.bodies
        lengths: dict[int, float] = {}  # length of the ellipsoid of each body
        max_distances: dict[int, float] = {}  # ρ of the shapes of each body
        for shape in self.shapes:
            if shape.layer == "inertia" and shape.body != BASE:
                lengths[shape.body] = float(np.ptp(shape.surface.vertices, axis=0).max())
        for shape in self.shapes:
            if shape.layer == "looks" and shape.body in lengths:
                points = shape.surface.vertices @ shape.pose[:3, :3].T + shape.pose[:3, 3]
                distances = np.linalg.norm(points - bodies[shape.body].inertia.com, axis=1)
                distance_so_far = max_distances.get(shape.body, 0.0)
                max_distances[shape.body] = max(distance_so_far, float(distances.max()))
        doubtful_links: list[str] = []
        for k, length in lengths.items():
            max_length = 2.0 * math.sqrt(5.0) * max_distances.get(k, 0.0)  # twice the largest semi-axis
            if length > max(_MIN_DOUBTFUL_SHARE * self.size, max_length):
                doubtful_links.append(bodies[k].link)
        return tuple(doubtful_links)

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes for a viewer: the remarks, and implausible ellipsoids."""
        if not self.doubtful or len(self.robot.model.bodies) < 2:
            return self.remarks
        links = ", ".join(self.doubtful[:_MAX_LISTED_LINKS])
        if len(self.doubtful) > _MAX_LISTED_LINKS:
            links += ", …"
        noun = "a body" if len(self.doubtful) == 1 else "bodies"
        return *self.remarks, f"Inertia of {links}: the file gives that of {noun} about as long as the whole robot."

    def body_poses(self, q: ArrayLike) -> Array:
        """Poses T_s,body of the moving bodies, for any batch of q.

        Parameters
        ----------
        q : (nq,) array_like, configuration

        Returns
        -------
        T : (nbodies, 4, 4) array; rotors, which are not drawn, are NaN
        """
        link_poses = np.asarray(self.robot.link_poses(q), float)
        link_index = {link: k for k, link in enumerate(self.robot.link_names)}
        model = self.robot.model
        bodies_without_frame = []  # indices of bodies between the joints of one link
        body_poses = np.full((*link_poses.shape[:-3], len(model.bodies), 4, 4), np.nan)
        for k, body in enumerate(model.bodies):
            if body.link in link_index:
                body_poses[..., k, :, :] = link_poses[..., link_index[body.link], :, :]
            elif body.joint.moves_body:
                bodies_without_frame.append(k)
        if bodies_without_frame:
            q = np.asarray(q, float)
            for batch_index in np.ndindex(q.shape[:-1]):
                T = base_poses(model, joint_poses(model, q[batch_index]))
                for k in bodies_without_frame:
                    body_poses[(*batch_index, k)] = T[k]
        return body_poses

    def bounds(self, q: ArrayLike, layer: str = "looks") -> Array:
        """Bounding box of the shapes at a configuration.

        Parameters
        ----------
        q : (nq,) array_like, configuration
        layer : "looks" or "inertia"

        Returns
        -------
        corners : (2, 3) array, lower and upper corner in the base frame [m]
        """
        poses = self.body_poses(q)
        vertices = []
        for shape in self.shapes:
            if shape.layer == layer:
                T = shape.pose
                if shape.body != BASE:
                    T = poses[shape.body] @ T
                vertices.append(shape.surface.placed(T).vertices)
        if not vertices:  # a cube of one metre in place of nothing
            return np.array([[-0.5, -0.5, -0.5], [0.5, 0.5, 0.5]])
        points = np.concatenate(vertices)
        return np.stack([points.min(axis=0), points.max(axis=0)])

    def decimated(self, most: int) -> Scene:
        """Scene with at most about ``most`` triangles of visuals; all shapes are reduced by the same factor.

        Parameters
        ----------
        most : int

        Returns
        -------
        scene : Scene
        """
        total_triangles = sum(len(shape.surface.faces) for shape in self.shapes if shape.layer == "looks")
        if total_triangles <= most:
            return self
        decimated_by_id: dict[int, Surface] = {}  # shapes that share a surface share its decimation
        for shape in self.shapes:
            triangle_count = max(_MIN_TRIANGLES, math.floor(most * len(shape.surface.faces) / total_triangles))
            decimated_by_id.setdefault(id(shape.surface), shape.surface.decimated(triangle_count))
        shapes = [replace(shape, surface=decimated_by_id[id(shape.surface)]) for shape in self.shapes]
        return replace(self, shapes=tuple(shapes))


def scene_of(robot: Robot, *, meshes: bool = True) -> Scene:
    """Scene of a robot: visuals of its file if available, otherwise joints, tubes and inertia ellipsoids.

    Parameters
    ----------
    robot : Robot
    meshes : bool
        Draw the file's meshes; otherwise joints, tubes and ellipsoids of inertia.

    Returns
    -------
    scene : Scene

    Warns
    -----
    ModelWarning
        Visuals of the file are missing; issued once.

    Examples
    --------
    >>> import twistwrench as tw
    >>> scene = scene_of(tw.robots.planar_2r())
    >>> {shape.layer for shape in scene.shapes} == {"looks", "inertia"}
    True
    >>> scene.body_poses([0.0, 0.0]).shape
    (2, 4, 4)
    """
    model = robot.model
    visuals: list[Visual] = []
    remarks: list[str] = []
    if meshes:
        visuals, remarks = read_visuals(model)
    shapes = []
    bodies_with_visuals = set()
    for visual in visuals:
        frame = model.frames[visual.link]
        if len(visual.surface.faces):
            shapes.append(Shape(frame.body, visual.surface, frame.pose @ visual.pose, visual.colour, "looks"))
            bodies_with_visuals.add(frame.body)
    body_frame = np.eye(4)
    robot_skeleton = skeleton(model)
    for body, surface, colour in robot_skeleton.looks:
        if body in bodies_with_visuals:
            continue
        # Beside visuals, only bodies with mass are drawn: massless ones and the base may have no shape on purpose.
        has_mass = body != BASE and model.bodies[body].inertia.mass > 0
        if has_mass or not bodies_with_visuals:
            shapes.append(Shape(body, surface, body_frame, colour, "looks"))
    for body, surface, colour in robot_skeleton.ellipsoids:
        shapes.append(Shape(body, surface, body_frame, colour, "inertia"))
    for name, inertia in model.payloads:
        if inertia.mass > 0:  # steel ball of the same mass
            frame = model.all_frames[name]
            ball = sphere(_ball_radius(inertia.mass)).placed(se3.pose(np.eye(3), inertia.com))
            shapes.append(Shape(frame.body, ball, frame.pose, PAYLOAD, "looks"))
    if remarks:
        warnings.warn(f"robot {robot.name!r}: {'. '.join(remarks)}.", ModelWarning, stacklevel=2)
    scene = Scene(robot, tuple(shapes), tuple(remarks), robot_skeleton.size, bool(bodies_with_visuals))
    diagonal = float(np.linalg.norm(np.ptp(scene.bounds(model.neutral), axis=0)))
    return replace(scene, size=diagonal or 1.0)  # 1 m for a single point
