"""Fusing: bodies held rigidly by their parents become part of them. The one place where links are joined."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ..bodies.inertia import SpatialInertia
from ..lie.identity import IDENTITY, is_identity, product
from ..typing import Array
from .limits import Limits
from .model import BASE, Body, Frame, Model
from .rounding import snap_pose


def fuse(model: Model, held: Mapping[int, Array]) -> Model:
    """The model with the joints of some bodies held rigid: ``held[i]`` is the pose T_joint,child (4, 4) of body i.

    Each such body's inertia is added to the body that carries it, its frames and children move over, and its
    coordinates and limits go. Whoever holds a leader holds its followers too.
    """
    if not held:
        return model
    snap = model.snap
    carriers = _carriers(model, held)
    kept = [body for i, body in enumerate(model.bodies) if i not in held]
    inertias = {BASE: model.base_inertia, **{i: body.inertia for i, body in enumerate(kept)}}
    for i in sorted(held):
        carrier, T = carriers[i]
        if model.bodies[i].inertia.parameters.any():
            inertias[carrier] = inertias[carrier] + _seen_from(T, model.bodies[i].inertia)
    columns = _Columns(model, held)
    carriers[BASE] = (BASE, IDENTITY)
    bodies = tuple(
        replace(
            body,
            parent=carriers[body.parent][0],
            placement=snap_pose(product(carriers[body.parent][1], body.placement), snap),
            inertia=inertias[i],
            q_index=columns.q[body.v_index] if body.joint.nv else 0,
            v_index=columns.v[body.v_index] if body.joint.nv else 0,
        )
        for i, body in enumerate(kept)
    )

    def carried(frames: Mapping[str, Frame]) -> dict[str, Frame]:
        return {
            name: Frame(carriers[f.body][0], snap_pose(product(carriers[f.body][1], f.pose), snap))
            for name, f in frames.items()
        }

    return replace(
        model,
        bodies=bodies,
        frames=carried(model.frames),
        sites=carried(model.sites),
        base_inertia=inertias[BASE],
        **columns.kept(model),
    )


def _carriers(model: Model, held: Mapping[int, Array]) -> dict[int, tuple[int, Array]]:
    """For each body, the new index of the body that carries it, and its pose there."""
    carriers: dict[int, tuple[int, Array]] = {}
    count = 0
    for i, body in enumerate(model.bodies):
        if i in held:
            carrier, T = (BASE, IDENTITY) if body.parent == BASE else carriers[body.parent]
            T_body = snap_pose(product(body.placement, held[i]), model.snap)
            carriers[i] = carrier, snap_pose(product(T, T_body), model.snap)
        else:
            carriers[i] = count, IDENTITY
            count += 1
    return carriers


def _seen_from(T: Array, inertia: SpatialInertia) -> SpatialInertia:
    # A body seen from its own frame keeps its numbers to the last bit.
    return inertia if is_identity(T) else inertia.in_frame(T)


class _Columns:
    """Where the coordinates of the joints that still move were and will be."""

    def __init__(self, model: Model, held: Mapping[int, Array]) -> None:
        self.q: dict[int, int] = {}  # new q_index by old v_index
        self.v: dict[int, int] = {}
        self._order: list[int] = []
        self._q_order: list[int] = []
        moving = [b for i, b in enumerate(model.bodies) if i not in held and not b.follows and b.joint.nv]
        nq = 0
        for body in sorted(moving, key=_v_index):
            self.q[body.v_index], self.v[body.v_index] = nq, len(self._order)
            self._order.extend(range(body.v_index, body.v_index + body.joint.nv))
            self._q_order.extend(range(body.q_index, body.q_index + body.joint.nq))
            nq += body.joint.nq

    def kept(self, model: Model) -> dict[str, Any]:
        """The per-velocity data of the model, without the columns that went."""
        pick, old = np.array(self._order, int), model.limits
        limits = Limits(old.lower[pick], old.upper[pick], old.velocity[pick], old.effort[pick])
        q_pick = np.array(self._q_order, int)
        configurations = {name: q[q_pick] for name, q in model.configurations.items()}
        return {
            "limits": limits,
            "friction": model.friction.at(pick),
            "armature": model.armature[pick],
            "configurations": configurations,
        }


def _v_index(body: Body) -> int:
    return body.v_index
