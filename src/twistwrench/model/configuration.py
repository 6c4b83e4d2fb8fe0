"""Configurations of a robot: by names, at random, and the two ways along the manifold they form."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import ShapeError, UnknownNameError
from .model import Body, Model

Array = NDArray[Any]

__all__ = ["add", "from_names", "random_configuration", "subtract"]

_ENDLESS = 1e3
"""rad or m: at an angle of 1e16 neighbouring doubles are two apart, and nothing can be said of the pose."""


def from_names(model: Model, joints: Mapping[str, ArrayLike]) -> Array:
    """q (nq,) with the named joints as given and the others neutral."""
    q = model.neutral
    by_name = {body.joint.name: body for body in model.leaders}
    for name, value in joints.items():
        if name not in by_name:
            raise UnknownNameError.of("joint", name, by_name)
        body = by_name[name]
        try:
            given = np.atleast_1d(np.asarray(value, float))
        except (TypeError, ValueError):
            raise ShapeError(f"the coordinate of joint {name!r} is {value!r}, expected a number.") from None
        if given.shape != (body.joint.nq,):
            raise ShapeError(
                f"joint {name!r} ({body.joint.kind}) takes {body.joint.nq} numbers, got shape {given.shape}."
            )
        _coordinates(q, body)[...] = given
    return q


def random_configuration(model: Model, rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
    """Random q (*shape, nq): inside the limits, unbounded joints within ±π or ±1 m, quaternions uniform.

    A limit of more than 1000 rad or m says that there is none, as ±1e16 does in files of propellers.
    """
    parts = [_random(model, body, rng, shape) for body in model.leaders]
    return np.concatenate([np.zeros((*shape, 0)), *parts], axis=-1)


def _random(model: Model, body: Body, rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
    joint, mine = body.joint, slice(body.v_index, body.v_index + body.joint.nv)
    if joint.kind == "floating":
        quat = rng.standard_normal((*shape, 4))
        quat /= np.linalg.norm(quat, axis=-1, keepdims=True)
        return np.concatenate([quat, rng.uniform(-1.0, 1.0, (*shape, 3))], axis=-1)
    reach = np.where(np.any(joint.axes[:, :3] != 0, axis=1), np.pi, 1.0)
    lower, upper = model.limits.lower[mine], model.limits.upper[mine]
    lower, upper = np.where(lower < -_ENDLESS, -np.inf, lower), np.where(upper > _ENDLESS, np.inf, upper)
    # Where one side alone is given, the other stays at least a reach away from it.
    free_lower = np.minimum(-reach, np.where(np.isfinite(upper), upper - reach, -reach))
    free_upper = np.maximum(reach, np.where(np.isfinite(lower), lower + reach, reach))
    lower, upper = np.where(np.isfinite(lower), lower, free_lower), np.where(np.isfinite(upper), upper, free_upper)
    if joint.kind == "planar":  # limits are in the order of the axes, (omega, v, v); coordinates are (x, y, theta)
        lower, upper = np.roll(lower, -1), np.roll(upper, -1)
    return rng.uniform(lower, upper, (*shape, joint.nv))


def add(model: Model, q: Array, dv: Array) -> Array:
    """q ⊕ dv: each joint along its constant twist for unit time; (..., nq), (..., nv) → (..., nq)."""
    _check("add", model, q=(q, model.nq), dv=(dv, model.nv))
    batch = np.broadcast_shapes(q.shape[:-1], dv.shape[:-1])
    q, dv = np.broadcast_to(q, (*batch, model.nq)), np.broadcast_to(dv, (*batch, model.nv))
    parts = [body.joint.integrate(_coordinates(q, body), _rates(dv, body)) for body in model.leaders]
    return np.concatenate([np.zeros((*batch, 0)), *parts], axis=-1)


def subtract(model: Model, q1: Array, q0: Array) -> Array:
    """q1 ⊖ q0: the dv with q0 ⊕ dv at the pose of q1; (..., nq), (..., nq) → (..., nv)."""
    _check("subtract", model, q1=(q1, model.nq), q0=(q0, model.nq))
    q1, q0 = np.broadcast_arrays(q1, q0)
    parts = [body.joint.difference(_coordinates(q1, body), _coordinates(q0, body)) for body in model.leaders]
    return np.concatenate([np.zeros((*q1.shape[:-1], 0)), *parts], axis=-1)


def _coordinates(q: Array, body: Body) -> Array:
    return q[..., body.q_index : body.q_index + body.joint.nq]


def _rates(dv: Array, body: Body) -> Array:
    return dv[..., body.v_index : body.v_index + body.joint.nv]


def _check(name: str, model: Model, **arrays: tuple[Array, int]) -> None:
    for label, (array, size) in arrays.items():
        if array.ndim < 1 or array.shape[-1] != size:
            raise ShapeError(
                f"{name}: {label} has shape {array.shape}, but robot {model.name!r} wants {size} in the last axis."
            )
    try:
        np.broadcast_shapes(*(array.shape[:-1] for array, _ in arrays.values()))
    except ValueError:
        listed = ", ".join(f"{label} {array.shape[:-1]}" for label, (array, _) in arrays.items())
        raise ShapeError(f"{name}: the batch shapes do not broadcast: {listed}.") from None
