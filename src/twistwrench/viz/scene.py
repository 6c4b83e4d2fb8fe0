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

TUBE, JOINT, GROUND, ELLIPSOID = (0.86, 0.88, 0.90), (0.23, 0.27, 0.33), (0.55, 0.59, 0.64), (0.20, 0.46, 0.72)
PAYLOAD = (0.84, 0.37, 0.0)
"""Colour of payloads, as red, green, blue from 0 to 1."""
_THICKNESS = 0.022
"""Radius of a tube, as a share of the robot's size."""
_STEEL = 7850.0
"""kg/m³: density of the balls that represent point masses."""


@dataclass(frozen=True, eq=False)
class Skeleton:
    """Parts (body, surface in its frame, colour)."""

    looks: list[Part]
    ellipsoids: list[Part]
    size: float
    """Diagonal of the box around joints, frames and masses [m]."""


def skeleton(model: Model) -> Skeleton:
    """Parts of all bodies except rotors, and of a fixed base."""
    bodies = {k: b for k, b in enumerate(model.bodies) if b.joint.moves_body}
    points = _points(model)
    all_points = np.concatenate([np.zeros((1, 3)), *points.values()])
    size = float(np.linalg.norm(np.ptp(all_points, axis=0)))
    if size < 1e-6:  # a single floating body: size from its inertia
        lengths = [4.0 * _semi_axes(b.inertia).max() for b in bodies.values() if b.inertia.mass > 0]
        size = max(lengths, default=1.0)
    r = _THICKNESS * size
    looks: list[Part] = []
    ends: dict[int, list[Array]] = {k: [] for k in (BASE, *bodies)}
    for k, b in bodies.items():
        start = _axis_point(b.joint)
        ends[b.parent].append(b.placement[:3, :3] @ start + b.placement[:3, 3])
        looks += _parts(k, _joint(b.joint, start, r), JOINT)
        looks += _parts(b.parent, _rail(model, b, size, r), TUBE)
    for k, b in bodies.items():
        start = _axis_point(b.joint)
        if b.joint.nv > 1 and b.inertia.mass > 0:
            start = np.array(b.inertia.com, float)
        for end in ends[k] or _far_ends(model, k, start):
            looks += _parts(k, _tube(start, end, r), TUBE)
    if all(b.joint.driven or b.parent != BASE for b in bodies.values()):
        looks.append((BASE, cylinder(2.6 * r, 0.5 * r).placed(se3.pose(np.eye(3), [0, 0, -0.25 * r])), GROUND))
        for end in ends[BASE]:
            looks += _parts(BASE, _tube(np.zeros(3), end, r), GROUND)
    ellipsoids: list[Part] = []
    for k, b in bodies.items():
        ellipsoids += _parts(k, equal_inertia_ellipsoid(b.inertia), ELLIPSOID)
    with_looks = {k for k, *_ in looks}  # a single floating body has no other shape than its ellipsoid
    looks += [(k, s, TUBE) for k, s, _ in ellipsoids if k not in with_looks]
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
        return []
    return [ellipsoid(_semi_axes(G)).placed(se3.pose(R, G.com))]


def _semi_axes(G: SpatialInertia) -> Array:
    I, _ = G.principal()
    squares = 5.0 * (I.sum() - 2.0 * I) / (2.0 * G.mass)
    return np.asarray(np.sqrt(np.maximum(squares, _ball(G.mass) ** 2)))


def _ball(mass: float) -> float:
    return float((3.0 * mass / (4.0 * math.pi * _STEEL)) ** (1 / 3))


def _points(model: Model) -> dict[int, Array]:
    """Points of each body (its joint, frames and mass) in the base frame with all joints at zero; (k, 3)."""
    poses: dict[int, Array] = {BASE: np.eye(4)}
    own_points: dict[int, list[Array]] = {BASE: []}
    q = model.neutral
    for k, b in enumerate(model.bodies):
        coordinates = b.joint.neutral
        if b.joint.nq == 1:
            coordinates = b.ratio * q[b.places[0]] + b.offset
        poses[k] = poses[b.parent] @ b.placement @ np.asarray(b.joint.pose(coordinates), float)
        own_points[k] = [_axis_point(b.joint)]
        if b.inertia.mass > 0:
            own_points[k].append(np.array(b.inertia.com, float))
    for frame in model.frames.values():
        own_points[frame.body].append(frame.pose[:3, 3])
    points = {}
    for k, own in own_points.items():
        if own:
            points[k] = np.stack(own) @ poses[k][:3, :3].T + poses[k][:3, 3]
    return points


def _axis_point(joint: Joint) -> Array:
    """Point of a revolute joint's axis nearest to the child's origin; the origin for other joints."""
    w, v = joint.axes[0, :3], joint.axes[0, 3:]
    if joint.nv != 1 or not w.any():
        return np.zeros(3)
    return np.asarray(so3.cross(w, v) / (w @ w))


def _parts(body: int, surfaces: Iterable[Surface], colour: Colour) -> list[Part]:
    """Parts of a body with the same colour."""
    return [(body, surface, colour) for surface in surfaces]


def _far_ends(model: Model, k: int, start: Array) -> list[Array]:
    """End of the tube of a last body: its farthest frame, or its centre of mass."""
    places = [f.pose[:3, 3] for f in model.frames.values() if f.body == k]
    G = model.bodies[k].inertia
    if G.mass > 0:
        places.append(np.array(G.com, float))
    if not places:
        return []
    return [max(places, key=lambda place: float(np.linalg.norm(place - start)))]


def _joint(joint: Joint, point: Array, r: float) -> list[Surface]:
    """Short cylinder along the axis of a revolute joint, box around a prismatic joint."""
    if joint.nv != 1:
        return []
    w, v = joint.axes[0, :3], joint.axes[0, 3:]
    if w.any():
        return [cylinder(1.45 * r, 3.4 * r).placed(se3.pose(turned_z(w), point))]
    return [box((2.6 * r, 2.6 * r, 4.0 * r)).placed(se3.pose(turned_z(v), point))]


def _rail(model: Model, body: Body, size: float, r: float) -> list[Surface]:
    """Rail of a sliding body in its parent's frame, between its limits, or half the robot's size long."""
    axis = body.joint.axes[0]
    if body.joint.nv != 1 or axis[:3].any():
        return []
    ends = np.array([model.limits.lower[body.v_index], model.limits.upper[body.v_index]]) * body.ratio + body.offset
    ends = np.where(np.isfinite(ends), np.clip(ends, -size, size), [-size / 4, size / 4])
    R, origin = body.placement[:3, :3], body.placement[:3, 3]
    low, high = R @ (ends[0] * axis[3:]) + origin, R @ (ends[1] * axis[3:]) + origin
    return _tube(low, high, 0.5 * r)


def _tube(start: Array, end: Array, r: float) -> list[Surface]:
    length = float(np.linalg.norm(end - start))
    if length < 0.5 * r:
        return []
    T = se3.pose(turned_z(end - start), (start + end) / 2)
    return [cylinder(0.8 * r, length, round_ends=True).placed(T)]


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
    """Characteristic length of marks and cameras [m]: the diagonal of the neutral robot's bounding box."""
    dressed: bool
    """True if the file has visuals for any body."""

    @property
    def doubtful(self) -> tuple[str, ...]:
        """Links with an inertia ellipsoid about as long as the robot, and longer than that of any body of their own shape.

        Mass within a distance ρ of its centre has semi-axes of at most √5 ρ (all mass at both ends of a rod). A slender
        uniform rod has 1.29 ρ.
        """
        bodies, lengths, reach = self.robot.model.bodies, dict[int, float](), dict[int, float]()
        for shape in self.shapes:
            if shape.layer == "inertia" and shape.body != BASE:
                lengths[shape.body] = float(np.ptp(shape.surface.vertices, axis=0).max())
        for shape in self.shapes:
            if shape.layer == "looks" and shape.body in lengths:
                points = shape.surface.vertices @ shape.pose[:3, :3].T + shape.pose[:3, 3]
                distances = np.linalg.norm(points - bodies[shape.body].inertia.com, axis=1)
                reach[shape.body] = max(reach.get(shape.body, 0.0), float(distances.max()))
        doubtful = []
        for k, length in lengths.items():
            if length > max(0.8 * self.size, 2.0 * math.sqrt(5.0) * reach.get(k, 0.0)):
                doubtful.append(bodies[k].link)
        return tuple(doubtful)

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes for a viewer: the remarks, and implausible ellipsoids."""
        if not self.doubtful or len(self.robot.model.bodies) < 2:
            return self.remarks
        links = ", ".join(self.doubtful[:4])
        if len(self.doubtful) > 4:
            links += ", …"
        size = "a body" if len(self.doubtful) == 1 else "bodies"
        return *self.remarks, f"Inertia of {links}: the file gives that of {size} about as long as the whole robot."

    def body_poses(self, q: ArrayLike) -> Array:
        """Poses T_s,body of the moving bodies, for any batch of q.

        Parameters
        ----------
        q : (nq,) array_like, configuration

        Returns
        -------
        T : (nbodies, 4, 4) array; rotors, which are not drawn, are NaN
        """
        poses = np.asarray(self.robot.link_poses(q), float)
        place = {link: k for k, link in enumerate(self.robot.link_names)}
        model, unnamed = self.robot.model, []
        body_poses = np.full((*poses.shape[:-3], len(model.bodies), 4, 4), np.nan)
        for k, body in enumerate(model.bodies):
            if body.link in place:
                body_poses[..., k, :, :] = poses[..., place[body.link], :, :]
            elif body.joint.moves_body:  # between the joints of one link, without a frame
                unnamed.append(k)
        if unnamed:
            q = np.asarray(q, float)
            for row in np.ndindex(q.shape[:-1]):
                T = base_poses(model, joint_poses(model, q[row]))
                for k in unnamed:
                    body_poses[(*row, k)] = T[k]
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
        corners = []
        for shape in self.shapes:
            if shape.layer == layer:
                T = shape.pose
                if shape.body != BASE:
                    T = poses[shape.body] @ T
                corners.append(shape.surface.placed(T).vertices)
        if not corners:
            return np.array([[-0.5] * 3, [0.5] * 3])
        points = np.concatenate(corners)
        return np.stack([points.min(axis=0), points.max(axis=0)])

    def decimated(self, most: int) -> Scene:
        """Scene with at most about ``most`` visual triangles, shared out in the present proportions.

        Parameters
        ----------
        most : int

        Returns
        -------
        scene : Scene
        """
        total = sum(len(s.surface.faces) for s in self.shapes if s.layer == "looks")
        if total <= most:
            return self
        lighter: dict[int, Surface] = {}
        for shape in self.shapes:
            share = math.floor(most * len(shape.surface.faces) / total)
            lighter.setdefault(id(shape.surface), shape.surface.decimated(max(_MIN_TRIANGLES, share)))
        shapes = [replace(shape, surface=lighter[id(shape.surface)]) for shape in self.shapes]
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
    visuals, remarks = list[Visual](), list[str]()
    if meshes:
        visuals, remarks = read_visuals(model)
    shapes, dressed, own_frame = [], set(), np.eye(4)
    for visual in visuals:
        frame = model.frames[visual.link]
        if len(visual.surface.faces):
            shapes.append(Shape(frame.body, visual.surface, frame.pose @ visual.pose, visual.colour, "looks"))
            dressed.add(frame.body)
    bones = skeleton(model)
    for body, surface, colour in bones.looks:
        bare = body not in dressed
        if bare and (not dressed or (body != BASE and model.bodies[body].inertia.mass > 0)):
            shapes.append(Shape(body, surface, own_frame, colour, "looks"))
    shapes += [Shape(body, surface, own_frame, colour, "inertia") for body, surface, colour in bones.ellipsoids]
    for name, inertia in model.payloads:
        if inertia.mass > 0:  # steel ball of the same mass
            frame, ball = model.all_frames[name], sphere(_ball(inertia.mass)).placed(se3.pose(np.eye(3), inertia.com))
            shapes.append(Shape(frame.body, ball, frame.pose, PAYLOAD, "looks"))
    if remarks:
        warnings.warn(f"robot {robot.name!r}: {'. '.join(remarks)}.", ModelWarning, stacklevel=2)
    scene = Scene(robot, tuple(shapes), tuple(remarks), bones.size, bool(dressed))
    return replace(scene, size=float(np.linalg.norm(np.ptp(scene.bounds(model.neutral), axis=0))) or 1.0)
