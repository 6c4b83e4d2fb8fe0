"""What is drawn of a robot, whatever draws it: surfaces fixed to its bodies, from its file or from its inertia."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import ModelWarning
from ..model.model import BASE
from .skeleton import PAYLOAD, payload_ball, skeleton
from .surface import Surface
from .visuals import Colour, read_visuals

if TYPE_CHECKING:
    from ..robot import Robot

Array = NDArray[Any]

__all__ = ["Scene", "Shape", "scene_of"]

_LEAST = 60
"""Triangles left to the smallest shape when a scene is thinned."""


@dataclass(frozen=True, eq=False)
class Shape:
    """A surface of one colour at a ``pose`` (4, 4) in the frame of a body (``BASE`` for what does not move)."""

    body: int
    surface: Surface
    pose: Array
    colour: Colour
    layer: str
    """``looks``, how the robot is meant to look; ``inertia``, the ellipsoid with each body's mass and moments."""


@dataclass(frozen=True, eq=False)
class Scene:
    """A robot and its shapes."""

    robot: Robot
    shapes: tuple[Shape, ...]
    remarks: tuple[str, ...]
    """What could not be drawn as the file says."""
    size: float
    """The length that marks and cameras go by [m]: the diagonal of the neutral robot's box."""
    dressed: bool
    """Whether the file's looks were found for any body."""

    @property
    def doubtful(self) -> tuple[str, ...]:
        """Links whose ellipsoid is about as long as the robot is: no body in it has such an inertia."""
        long = {s.body: float(np.ptp(s.surface.vertices, axis=0).max()) for s in self.shapes if s.layer == "inertia"}
        return tuple(self.robot.model.bodies[k].link for k, length in long.items() if length > 0.8 * self.size)

    @property
    def notes(self) -> tuple[str, ...]:
        """What a viewer should be told: the remarks, and the ellipsoids that look impossible."""
        if not self.doubtful or len(self.robot.model.bodies) < 2:
            return self.remarks
        few = ", ".join(self.doubtful[:4]) + (", …" if len(self.doubtful) > 4 else "")
        size = "a body" if len(self.doubtful) == 1 else "bodies"
        return *self.remarks, f"Inertia of {few}: the file gives that of {size} about as long as the whole robot."

    def body_poses(self, q: ArrayLike) -> Array:
        """T_s,body of the moving bodies; (nq) → (nbodies, 4, 4), for any batch of q. Those of rotors, never drawn, are NaN."""
        poses = np.asarray(self.robot.link_poses(q), float)
        place = {link: k for k, link in enumerate(self.robot.link_names)}
        found = np.full((*poses.shape[:-3], len(self.robot.model.bodies), 4, 4), np.nan)
        for k, body in enumerate(self.robot.model.bodies):
            if body.link in place:
                found[..., k, :, :] = poses[..., place[body.link], :, :]
        return found

    def bounds(self, q: ArrayLike, layer: str = "looks") -> Array:
        """The lowest and the highest corner (2, 3) of the box around the shapes at q (nq,)."""
        poses = self.body_poses(q)
        corners = []
        for shape in self.shapes:
            if shape.layer == layer:
                T = shape.pose if shape.body == BASE else poses[shape.body] @ shape.pose
                corners.append(shape.surface.placed(T).vertices)
        if not corners:
            return np.array([[-0.5] * 3, [0.5] * 3])
        every = np.concatenate(corners)
        return np.stack([every.min(axis=0), every.max(axis=0)])

    def thinned(self, most: int) -> Scene:
        """The same with at most about ``most`` triangles that show the looks, shared out as they are now."""
        total = sum(len(s.surface.faces) for s in self.shapes if s.layer == "looks")
        if total <= most:
            return self
        lighter: dict[int, Surface] = {}
        for shape in self.shapes:
            share = math.floor(most * len(shape.surface.faces) / total)
            lighter.setdefault(id(shape.surface), shape.surface.thinned(max(_LEAST, share)))
        return replace(self, shapes=tuple(replace(s, surface=lighter[id(s.surface)]) for s in self.shapes))


def scene_of(robot: Robot, *, meshes: bool = True) -> Scene:
    """The robot's scene: its file's looks where they are found, and joints, tubes and ellipsoids of inertia where not.

    ``meshes=False`` leaves the file's looks alone. Warns once, with a :class:`~twistwrench.ModelWarning`, of what the file
    shows and is not there.

    >>> import twistwrench as tw
    >>> scene = scene_of(tw.robots.planar_2r())
    >>> {shape.layer for shape in scene.shapes} == {"looks", "inertia"}
    True
    >>> scene.body_poses([0.0, 0.0]).shape
    (2, 4, 4)
    """
    model = robot.model
    visuals, remarks = read_visuals(model) if meshes else ([], [])
    shapes, dressed, here = [], set(), np.eye(4)
    for visual in visuals:
        frame = model.frames[visual.link]
        if len(visual.surface.faces):
            shapes.append(Shape(frame.body, visual.surface, frame.pose @ visual.pose, visual.colour, "looks"))
            dressed.add(frame.body)
    bones = skeleton(model)
    for body, surface, colour in bones.looks:
        bare = body not in dressed
        if bare and (not dressed or (body != BASE and model.bodies[body].inertia.mass > 0)):
            shapes.append(Shape(body, surface, here, colour, "looks"))
    shapes += [Shape(body, surface, here, colour, "inertia") for body, surface, colour in bones.ellipsoids]
    for name, inertia in model.payloads:
        frame = model.frames[name]
        shapes += [Shape(frame.body, s, frame.pose, PAYLOAD, "looks") for s in payload_ball(inertia)]
    if remarks:
        warnings.warn(f"robot {robot.name!r}: {'. '.join(remarks)}.", ModelWarning, stacklevel=2)
    found = Scene(robot, tuple(shapes), tuple(remarks), bones.size, bool(dressed))
    return replace(found, size=float(np.linalg.norm(np.ptp(found.bounds(model.neutral), axis=0))) or 1.0)
