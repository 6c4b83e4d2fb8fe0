"""Editing: a payload, another gravity, joints locked. Each edit returns a new model and leaves the old one alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..bodies.inertia import SpatialInertia
from ..errors import InertiaError, ShapeError, UnknownNameError, ValueRangeError
from .fusing import fuse
from .joint import Joint
from .judgement import moved_moments, reasons
from .model import BASE, Model
from .tip import default_tip

Array = NDArray[Any]

__all__ = ["gravity_vector", "lock", "with_gravity", "with_payload"]


def with_payload(model: Model, inertia: SpatialInertia, frame: str | None = None) -> Model:
    """The model with a body fixed to a frame (None: the tip); ``inertia`` is about the frame's origin, in its axes.

    Raises :class:`~twistwrench.InertiaError` if no body has that inertia, or if the body that carries it becomes one
    that cannot exist; :class:`~twistwrench.UnknownNameError` for an unknown frame.
    """
    at = model.frame(frame)
    name = frame if frame is not None else model.tip
    if found := inertia.defects():
        raise InertiaError(f"a payload at {name!r} cannot exist: {'; '.join(found)}. Correct its numbers.")
    moved = inertia.in_frame(at.pose)
    links = model.link_inertias
    if name in links:
        links = {**links, name: links[name] + inertia}
    model = replace(model, link_inertias=links, payloads=(*model.payloads, (str(name), inertia)))
    if at.body == BASE:
        return replace(model, base_inertia=model.base_inertia + moved)
    body = model.bodies[at.body]
    loaded = replace(body, inertia=body.inertia + moved)
    # A body that was accepted as impossible when the robot was loaded may stay so.
    size = moved_moments(model, at.body) + abs(float(moved.moment_about_origin.trace()))
    if not reasons(body.inertia, size) and (found := loaded.inertia.defects(size=size)):
        raise InertiaError(
            f"with a payload at {name!r}, the body of joint {body.joint.name!r} cannot exist: {'; '.join(found)}."
        )
    bodies = (*model.bodies[: at.body], loaded, *model.bodies[at.body + 1 :])
    return replace(model, bodies=bodies)


def with_gravity(model: Model, g: ArrayLike) -> Model:
    """The model in the gravity ``g`` (3,) [m/s²], in the base frame."""
    return replace(model, gravity=gravity_vector(g))


def gravity_vector(g: ArrayLike) -> Array:
    """``g`` as a read-only (3,) array of finite numbers [m/s²]."""
    try:
        vector = np.array(g, float)
    except (TypeError, ValueError):
        raise ShapeError(f"gravity is {g!r}, expected three numbers, such as (0, 0, -9.81).") from None
    if vector.shape != (3,):
        raise ShapeError(f"gravity has shape {vector.shape}, expected (3,): an acceleration such as (0, 0, -9.81).")
    if not np.isfinite(vector).all():
        raise ValueRangeError(f"gravity is {vector.tolist()}; its components must be finite.")
    vector.setflags(write=False)
    return vector


def lock(model: Model, positions: Mapping[str, ArrayLike]) -> Model:
    """The model with some joints held at given positions: a number each, (x, y, theta) for planar, 7 for floating.

    The bodies they carried become part of their parents, and what mimics them is held too. Rotations are snapped as
    on loading. Raises :class:`~twistwrench.UnknownNameError` for names that are no moving joint's.
    """
    moving = {body.joint.name: body for body in model.bodies if not body.follows}
    followers = {body.joint.name: body for body in model.bodies if body.follows}
    held: dict[int, Array] = {}
    at: dict[str, float] = {}
    for name, value in positions.items():
        if name in followers:
            leader = next(b.joint.name for b in moving.values() if b.v_index == followers[name].v_index)
            raise ValueRangeError(
                f"joint {name!r} mimics {leader!r} and moves with it. "
                f"Lock {leader!r}, or load with mimic='independent'."
            )
        if name not in moving:
            raise UnknownNameError.of("moving joint", name, moving)
        q = _coordinates(moving[name].joint, value)
        at[name] = float(q[0])
        for i, body in enumerate(model.bodies):
            if body.v_index == moving[name].v_index:
                held[i] = body.joint.pose(body.ratio * q + body.offset)
    fused = fuse(model, held)
    springs = tuple(s for s in (spring.held(at) for spring in model.springs) if s.terms)
    actuators = {joint: actuator for joint, actuator in model.actuators.items() if joint not in at}
    fused = replace(fused, springs=springs, actuators=actuators)
    return fused if fused.tip is not None else replace(fused, tip=default_tip(fused))


def _coordinates(joint: Joint, value: ArrayLike) -> Array:
    try:
        q = np.atleast_1d(np.array(value, float))
    except (TypeError, ValueError):
        raise ShapeError(f"the position of joint {joint.name!r} is {value!r}, expected a number.") from None
    if q.shape != (joint.nq,):
        names = ", ".join(joint.name + suffix for suffix in joint.coordinate_suffixes)
        raise ShapeError(
            f"the position of {joint.kind} joint {joint.name!r} has shape {q.shape}, expected ({joint.nq},): {names}."
        )
    if not np.isfinite(q).all() or (joint.kind == "floating" and not q[:4].any()):
        raise ValueRangeError(
            f"joint {joint.name!r} cannot be locked at {q.tolist()}: numbers must be finite, and a quaternion nonzero."
        )
    return q
