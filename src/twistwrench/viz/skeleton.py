"""A robot drawn from its numbers alone: joints along their axes, tubes between them, and ellipsoids of inertia."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InertiaError
from ..lie import se3, so3
from ..model.model import BASE
from ..typing import Array
from .surface import Surface, box, cylinder, ellipsoid, sphere

if TYPE_CHECKING:
    from ..bodies.inertia import SpatialInertia
    from ..joints import Joint
    from ..model.model import Body, Model

Part = tuple[int, Surface, tuple[float, float, float]]

TUBE, JOINT, GROUND, ELLIPSOID = (0.86, 0.88, 0.90), (0.23, 0.27, 0.33), (0.55, 0.59, 0.64), (0.20, 0.46, 0.72)
PAYLOAD = (0.84, 0.37, 0.0)
"""Colours of what is drawn, as red, green, blue from 0 to 1."""
_THICKNESS = 0.022
"""Radius of a tube, as a share of the robot's size."""
_STEEL = 7850.0
"""kg/m³: points of mass, which have no size, are drawn as balls of it."""


@dataclass(frozen=True, eq=False)
class Skeleton:
    """Parts (body, surface in its frame, colour)."""

    looks: list[Part]
    ellipsoids: list[Part]
    size: float
    """Diagonal of the box around joints, frames and masses [m]."""


def skeleton(model: Model) -> Skeleton:
    """The parts of all bodies but rotors, and of the base where it stands still."""
    bodies = {k: b for k, b in enumerate(model.bodies) if b.joint.moves_body}
    points = _points(model)
    every = np.concatenate([np.zeros((1, 3)), *points.values()])
    size = float(np.linalg.norm(np.ptp(every, axis=0)))
    if size < 1e-6:  # one body that floats: as large as its inertia says
        size = max([4.0 * _semi_axes(b.inertia).max() for b in bodies.values() if b.inertia.mass > 0] or [1.0])
    r = _THICKNESS * size
    looks: list[Part] = []
    ends: dict[int, list[Array]] = {k: [] for k in (BASE, *bodies)}
    for k, b in bodies.items():
        start = _axis_point(b.joint)
        ends[b.parent].append(b.placement[:3, :3] @ start + b.placement[:3, 3])
        looks += [(k, s, JOINT) for s in _joint(b.joint, start, r)]
        looks += [(b.parent, s, TUBE) for s in _rail(model, b, size, r)]
    for k, b in bodies.items():
        start = _axis_point(b.joint)
        if b.joint.nv > 1:
            start = np.array(b.inertia.com, float) if b.inertia.mass > 0 else start
        for end in ends[k] or _far_ends(model, k, start):
            looks += [(k, s, TUBE) for s in _tube(start, end, r)]
    if not any(not b.joint.driven and b.parent == BASE for b in bodies.values()):
        looks.append((BASE, cylinder(2.6 * r, 0.5 * r).placed(se3.pose(np.eye(3), [0, 0, -0.25 * r])), GROUND))
        looks += [(BASE, s, GROUND) for end in ends[BASE] for s in _tube(np.zeros(3), end, r)]
    ellipsoids = [(k, e, ELLIPSOID) for k, b in bodies.items() for e in equal_inertia_ellipsoid(b.inertia)]
    shown = {k for k, *_ in looks}
    looks += [(k, s, TUBE) for k, s, _ in ellipsoids if k not in shown]  # a body that floats alone has no other shape
    return Skeleton(looks, ellipsoids, size)


def equal_inertia_ellipsoid(G: SpatialInertia) -> list[Surface]:
    """The uniform ellipsoid with the mass, centre and moments of G, in its frame; none without mass.

    Of principal moments I: a² = 5 (I_b + I_c - I_a) / (2 m). Of points and rods, which have no such ellipsoid, no semi-axis
    is thinner than a steel ball of the mass is.
    """
    if not G.mass > 0:
        return []
    try:
        _, R = G.principal()
    except (InertiaError, ValueError):
        return []
    return [ellipsoid(_semi_axes(G)).placed(se3.pose(R, G.com))]


def payload_ball(G: SpatialInertia) -> list[Surface]:
    """A steel ball of the payload's mass at its centre, in the frame of G."""
    return [sphere(_ball(G.mass)).placed(se3.pose(np.eye(3), G.com))] if G.mass > 0 else []


def _semi_axes(G: SpatialInertia) -> Array:
    I, _ = G.principal()
    squares = 5.0 * (I.sum() - 2.0 * I) / (2.0 * G.mass)
    return np.asarray(np.sqrt(np.maximum(squares, _ball(G.mass) ** 2)))


def _ball(mass: float) -> float:
    return float((3.0 * mass / (4.0 * math.pi * _STEEL)) ** (1 / 3))


def _points(model: Model) -> dict[int, Array]:
    """Of each body: its joint, frames and mass, in the base frame with all joints at zero; (k, 3)."""
    poses: dict[int, Array] = {BASE: np.eye(4)}
    found: dict[int, list[Array]] = {BASE: []}
    q = model.neutral
    for k, b in enumerate(model.bodies):
        at = b.joint.neutral if b.joint.nq > 1 else b.ratio * q[b.places[0]] + b.offset
        poses[k] = poses[b.parent] @ b.placement @ np.asarray(b.joint.pose(at), float)
        found[k] = [_axis_point(b.joint)] + ([np.array(b.inertia.com, float)] if b.inertia.mass > 0 else [])
    for frame in model.frames.values():
        found[frame.body].append(frame.pose[:3, 3])
    return {
        k: np.reshape(np.stack(at) @ poses[k][:3, :3].T + poses[k][:3, 3], (-1, 3)) for k, at in found.items() if at
    }


def _axis_point(joint: Joint) -> Array:
    """The point of a turning joint's axis nearest to the child's origin; the origin for other joints."""
    w, v = joint.axes[0, :3], joint.axes[0, 3:]
    if joint.nv != 1 or not w.any():
        return np.zeros(3)
    return np.asarray(so3.cross(w, v) / (w @ w))


def _far_ends(model: Model, k: int, start: Array) -> list[Array]:
    """Where the tube of a last body ends: at its farthest frame, else at its mass."""
    frames = [f.pose[:3, 3] for f in model.frames.values() if f.body == k]
    G = model.bodies[k].inertia
    places = frames + ([np.array(G.com, float)] if G.mass > 0 else [])
    return [max(places, key=lambda p: float(np.linalg.norm(p - start)))] if places else []


def _joint(joint: Joint, point: Array, r: float) -> list[Surface]:
    """A short cylinder along the axis of a joint that turns, a box around one that slides."""
    if joint.nv != 1:
        return []
    w, v = joint.axes[0, :3], joint.axes[0, 3:]
    T = se3.pose(turned_z(w if w.any() else v), point)
    solid = cylinder(1.45 * r, 3.4 * r) if w.any() else box((2.6 * r, 2.6 * r, 4.0 * r))
    return [solid.placed(T)]


def _rail(model: Model, body: Body, size: float, r: float) -> list[Surface]:
    """What a sliding body slides on, in its parent's frame: from one limit to the other, or half the robot's size."""
    axis = body.joint.axes[0]
    if body.joint.nv != 1 or axis[:3].any():
        return []
    ends = np.array([model.limits.lower[body.v_index], model.limits.upper[body.v_index]]) * body.ratio + body.offset
    ends = np.where(np.isfinite(ends), np.clip(ends, -size, size), [-size / 4, size / 4])
    low, high = (body.placement[:3, :3] @ (x * axis[3:]) + body.placement[:3, 3] for x in ends)
    return _tube(low, high, 0.5 * r)


def _tube(start: Array, end: Array, r: float) -> list[Surface]:
    length = float(np.linalg.norm(end - start))
    if length < 0.5 * r:
        return []
    T = se3.pose(turned_z(end - start), (start + end) / 2)
    return [cylinder(0.8 * r, length, round_ends=True).placed(T)]


def turned_z(direction: Array) -> Array:
    """A rotation (3, 3) that takes z to ``direction`` (3,), of any length but zero."""
    z = np.asarray(direction, float) / np.linalg.norm(direction)
    x = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = x - z * (z @ x)
    x = x / np.linalg.norm(x)
    return np.stack([x, so3.cross(z, x), z], axis=1)
