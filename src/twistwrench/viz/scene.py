"""What is drawn of a robot, whatever draws it: surfaces fixed to its bodies, from its file or from its inertia."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..algorithms.recursion import base_poses, joint_poses
from ..errors import ModelWarning
from ..model.model import BASE
from ..typing import Array
from .skeleton import PAYLOAD, payload_ball, skeleton
from .surface import Surface
from .visuals import Colour, read_visuals

if TYPE_CHECKING:
    from ..robot import Robot

_LEAST = 60
"""Triangles left to the smallest shape when a scene is thinned."""


@dataclass(frozen=True, eq=False)
class Shape:
    """Surface of one colour, fixed to a body."""

    body: int
    """The body's number; ``BASE`` for what does not move."""
    surface: Surface
    """Vertices and triangles."""
    pose: Array
    """Pose (4, 4) in the frame of the body."""
    colour: Colour
    """Red, green, blue, 0 to 1."""
    layer: str
    """``looks``, how the robot is meant to look; ``inertia``, the ellipsoid with each body's mass and moments."""


@dataclass(frozen=True, eq=False)
class Scene:
    """Scene: a robot and its shapes."""

    robot: Robot
    """The robot."""
    shapes: tuple[Shape, ...]
    """What is drawn of it."""
    remarks: tuple[str, ...]
    """What could not be drawn as the file says."""
    size: float
    """The length that marks and cameras go by [m]: the diagonal of the neutral robot's box."""
    dressed: bool
    """Whether the file's looks were found for any body."""

    @property
    def doubtful(self) -> tuple[str, ...]:
        """Links whose ellipsoid of inertia is about as long as the robot, and longer than that of any body of their own shape.

        Mass within a distance ρ of its centre has semi-axes of at most √5 ρ: all of it at both ends of a rod. A slender uniform
        rod has 1.29 ρ.
        """
        long = {s.body: float(np.ptp(s.surface.vertices, axis=0).max()) for s in self.shapes if s.layer == "inertia"}
        bodies, reach = self.robot.model.bodies, dict[int, float]()
        for s in self.shapes:
            if s.layer == "looks" and s.body in long and s.body != BASE:
                out = s.surface.vertices @ s.pose[:3, :3].T + s.pose[:3, 3] - bodies[s.body].inertia.com
                reach[s.body] = max(reach.get(s.body, 0.0), float(np.linalg.norm(out, axis=1).max()))
        return tuple(
            bodies[k].link
            for k, length in long.items()
            if k != BASE and length > max(0.8 * self.size, 2.0 * math.sqrt(5.0) * reach.get(k, 0.0))
        )

    @property
    def notes(self) -> tuple[str, ...]:
        """What a viewer should be told: the remarks, and the ellipsoids that look impossible."""
        if not self.doubtful or len(self.robot.model.bodies) < 2:
            return self.remarks
        few = ", ".join(self.doubtful[:4]) + (", …" if len(self.doubtful) > 4 else "")
        size = "a body" if len(self.doubtful) == 1 else "bodies"
        return *self.remarks, f"Inertia of {few}: the file gives that of {size} about as long as the whole robot."

    def body_poses(self, q: ArrayLike) -> Array:
        """Poses of the moving bodies, T_s,body, for any batch of q.

        Parameters
        ----------
        q : (nq,) array_like, configuration

        Returns
        -------
        T : (nbodies, 4, 4) array; those of rotors, never drawn, are NaN

        Examples
        --------
        >>> import twistwrench as tw
        >>> scene_of(tw.robots.planar_2r()).body_poses([0.0, 0.0]).shape
        (2, 4, 4)
        """
        poses = np.asarray(self.robot.link_poses(q), float)
        place = {link: k for k, link in enumerate(self.robot.link_names)}
        found = np.full((*poses.shape[:-3], len(self.robot.model.bodies), 4, 4), np.nan)
        model, hidden = self.robot.model, []
        for k, body in enumerate(model.bodies):
            if body.link in place:
                found[..., k, :, :] = poses[..., place[body.link], :, :]
            elif body.joint.moves_body:  # between the joints of one link, and no frame itself
                hidden.append(k)
        if hidden:
            q = np.asarray(q, float)
            for at in np.ndindex(q.shape[:-1]):
                T = base_poses(model, joint_poses(model, q[at]))
                for k in hidden:
                    found[(*at, k)] = T[k]
        return found

    def bounds(self, q: ArrayLike, layer: str = "looks") -> Array:
        """Bounding box of the shapes at a configuration.

        Parameters
        ----------
        q : (nq,) array_like, configuration
        layer : "looks" or "inertia"

        Returns
        -------
        corners : (2, 3) array, the lowest and the highest corner in the base frame [m]

        Examples
        --------
        >>> import twistwrench as tw
        >>> scene_of(tw.robots.planar_2r()).bounds([0.0, 0.0]).shape
        (2, 3)
        """
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
        """Scene with at most about so many triangles that show the looks, shared out as they are now.

        Parameters
        ----------
        most : int

        Returns
        -------
        scene : Scene

        Examples
        --------
        >>> import twistwrench as tw
        >>> scene = scene_of(tw.robots.planar_2r())
        >>> len(scene.thinned(100).shapes) == len(scene.shapes)
        True
        """
        total = sum(len(s.surface.faces) for s in self.shapes if s.layer == "looks")
        if total <= most:
            return self
        lighter: dict[int, Surface] = {}
        for shape in self.shapes:
            share = math.floor(most * len(shape.surface.faces) / total)
            lighter.setdefault(id(shape.surface), shape.surface.thinned(max(_LEAST, share)))
        return replace(self, shapes=tuple(replace(s, surface=lighter[id(s.surface)]) for s in self.shapes))


def scene_of(robot: Robot, *, meshes: bool = True) -> Scene:
    """Scene of a robot: its file's looks where they are found, and joints, tubes and ellipsoids of inertia where not.

    Parameters
    ----------
    robot : Robot
    meshes : bool, take the file's looks

    Returns
    -------
    scene : Scene

    Warns
    -----
    ModelWarning
        The file shows what is not there; once.

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
        frame = model.all_frames[name]
        shapes += [Shape(frame.body, s, frame.pose, PAYLOAD, "looks") for s in payload_ball(inertia)]
    if remarks:
        warnings.warn(f"robot {robot.name!r}: {'. '.join(remarks)}.", ModelWarning, stacklevel=2)
    found = Scene(robot, tuple(shapes), tuple(remarks), bones.size, bool(dressed))
    return replace(found, size=float(np.linalg.norm(np.ptp(found.bounds(model.neutral), axis=0))) or 1.0)
