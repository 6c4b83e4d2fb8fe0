"""Numbers of a model that may differ from sample to sample: masses, centres of mass, moments, lengths, friction.

A name is ``<link>.mass``, ``<link>.com_x`` …, ``<link>.Ixx`` … (about the link's centre of mass, in its own axes),
``<joint>.x`` … (where the joint sits in the body that carries it), or ``<joint>.viscous`` and the other laws of
friction. A link may be one without mass: ``tool0.mass`` is a payload. Static friction that is Coulomb's stays so where only
``<joint>.coulomb`` is given.
"""

from __future__ import annotations

import fnmatch
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..bodies.inertia import SpatialInertia
from ..errors import UnknownNameError
from ..lie import so3
from .friction import LAWS, Friction
from .model import BASE, Model

_OF_LINKS = ("mass", "com_x", "com_y", "com_z", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
_OF_JOINTS = ("x", "y", "z")


def nominal(model: Model) -> dict[str, float]:
    """Every name, and the number the model has there."""
    values: dict[str, float] = {}
    for link, frame in model.frames.items():
        if frame.body != BASE:
            values.update(zip((f"{link}.{what}" for what in _OF_LINKS), _of_link(model, link), strict=True))
    for body in model.bodies:
        for what, x in zip(_OF_JOINTS, body.placement[:3, 3], strict=True):
            values[f"{body.joint.name}.{what}"] = float(x)
        if not body.follows and body.joint.nv == 1:
            for law in LAWS:
                values[f"{body.joint.name}.{law}"] = float(getattr(model.friction, law)[body.v_index])
    return values


def moves_joints(model: Model, names: Sequence[str]) -> bool:
    """Whether lengths are among them. What is linear in the rest stays so when inertias are regrouped."""
    places = {f"{body.joint.name}.{what}" for body in model.bodies for what in _OF_JOINTS}
    return any(name in places for name in names)


def _of_link(model: Model, link: str) -> list[float]:
    G = model.link_inertias.get(link, SpatialInertia.zero())
    I = G.moment_about_com
    return [float(x) for x in (G.mass, *G.com, I[0, 0], I[0, 1], I[1, 1], I[0, 2], I[1, 2], I[2, 2])]


def matching(model: Model, patterns: Sequence[str]) -> tuple[str, ...]:
    """The names that patterns such as ``*.mass`` mean, each once, in the order of the patterns.

    Raises :class:`~twistwrench.UnknownNameError` for a pattern that means none.
    """
    known = nominal(model)
    found: dict[str, None] = {}
    for pattern in patterns:
        mine = fnmatch.filter(known, pattern)
        if not mine:
            raise UnknownNameError.of("parameter", pattern, known)
        found.update(dict.fromkeys(mine))
    return tuple(found)


def varied(model: Model, names: Sequence[str], values: Sequence[Any]) -> Model:
    """The model with these numbers, or symbols, in place of its own."""
    new = dict(zip(names, values, strict=True))
    bodies = [_body_moved(body, new) for body in model.bodies]
    for link, frame in model.frames.items():
        if any(f"{link}.{what}" in new for what in _OF_LINKS):
            old = model.link_inertias.get(link, SpatialInertia.zero())
            mine = [new.get(f"{link}.{what}", x) for what, x in zip(_OF_LINKS, _of_link(model, link), strict=True)]
            body = bodies[frame.body]
            rest = body.inertia - old.in_frame(frame.pose)
            bodies[frame.body] = replace(body, inertia=rest + _inertia(mine).in_frame(frame.pose))
    return replace(model, bodies=tuple(bodies), friction=_friction(model, new))


def _body_moved(body: Any, new: dict[str, Any]) -> Any:
    mine = {
        k: new[f"{body.joint.name}.{what}"] for k, what in enumerate(_OF_JOINTS) if f"{body.joint.name}.{what}" in new
    }
    if not mine:
        return body
    placement = body.placement.astype(object)
    for k, x in mine.items():
        placement[k, 3] = x
    return replace(body, placement=placement)


def _inertia(numbers: Sequence[Any]) -> SpatialInertia:
    """From mass, centre of mass, and moments about it."""
    m, c, I = numbers[0], np.array(numbers[1:4], object), numbers[4:]
    about_com = np.array([[I[0], I[1], I[3]], [I[1], I[2], I[4]], [I[3], I[4], I[5]]], object)
    J = about_com - m * (so3.hat(c) @ so3.hat(c))  # Steiner
    return SpatialInertia.from_parameters(
        np.array([m, *(m * c), J[0, 0], J[0, 1], J[1, 1], J[0, 2], J[1, 2], J[2, 2]], object)
    )


def _friction(model: Model, new: dict[str, Any]) -> Friction:
    columns = {law: getattr(model.friction, law).astype(object) for law in LAWS}
    changed = False
    for body in model.leaders:
        for law in LAWS:
            if (name := f"{body.joint.name}.{law}") in new:
                columns[law][body.v_index], changed = new[name], True
        coulomb, static = (f"{body.joint.name}.{law}" for law in ("coulomb", "static"))
        if coulomb in new and static not in new:
            i = body.v_index
            if model.friction.static[i] == model.friction.coulomb[i]:
                columns["static"][i] = new[coulomb]
    return Friction(**columns) if changed else model.friction
