"""Configurations of a robot: by names, and at random."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from ..errors import ShapeError, UnknownNameError
from ..typing import Array
from .model import Body, Model

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
    joint, mine = body.joint, body.places[1]
    reach = np.where(np.any(joint.axes[:, :3] != 0, axis=1), np.pi, 1.0)
    lower, upper = model.limits.lower[mine], model.limits.upper[mine]
    lower, upper = np.where(lower < -_ENDLESS, -np.inf, lower), np.where(upper > _ENDLESS, np.inf, upper)
    # Where one side alone is given, the other stays at least a reach away from it.
    free_lower = np.minimum(-reach, np.where(np.isfinite(upper), upper - reach, -reach))
    free_upper = np.maximum(reach, np.where(np.isfinite(lower), lower + reach, reach))
    lower, upper = np.where(np.isfinite(lower), lower, free_lower), np.where(np.isfinite(upper), upper, free_upper)
    return joint.random(rng, shape, lower, upper)


def _coordinates(q: Array, body: Body) -> Array:
    return q[..., body.places[0]]
