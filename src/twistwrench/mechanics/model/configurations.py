"""Configurations of a robot: by joint names, and random."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from ...core.errors import ShapeError, UnknownNameError
from ...core.typing import Array
from .model import Body, Model

_MAX_POSITION_LIMIT = 1e3
"""rad or m: limits beyond it count as none; at an angle of 1e16 neighbouring doubles differ by 2 rad."""


def from_names(model: Model, joints: Mapping[str, ArrayLike]) -> Array:
    """q (nq,) with the named joints as given and the others neutral."""
    q = model.neutral
    for name, value in joints.items():
        if name not in model.leaders_by_name:
            raise UnknownNameError.from_choices("joint", name, model.leaders_by_name)
        body = model.leaders_by_name[name]
        try:
            coordinates = np.atleast_1d(np.asarray(value, float))
        except (TypeError, ValueError):
            raise ShapeError(f"the coordinate of joint {name!r} is {value!r}, expected a number.") from None
        if coordinates.shape != (body.joint.nq,):
            raise ShapeError(
                f"joint {name!r} ({body.joint.kind}) takes {body.joint.nq} numbers, got shape {coordinates.shape}."
            )
        q[body.places[0]] = coordinates
    return q


def random_configuration(model: Model, rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
    """Random q (*shape, nq): inside the limits, unbounded joints within ±π or ±1 m, quaternions uniform.

    Limits above 1000 rad or m, such as ±1e16 in files of propellers, count as none.
    """
    parts = [_random(model, body, rng, shape) for body in model.leaders]
    return np.concatenate([np.zeros((*shape, 0)), *parts], axis=-1)


def _random(model: Model, body: Body, rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
    joint, columns = body.joint, body.places[1]
    reach = np.where(np.any(joint.axes[:, :3] != 0, axis=1), np.pi, 1.0)
    lower, upper = model.limits.lower[columns], model.limits.upper[columns]
    has_lower = np.isfinite(lower) & (lower >= -_MAX_POSITION_LIMIT)
    has_upper = np.isfinite(upper) & (upper <= _MAX_POSITION_LIMIT)
    # If only one limit is given, the other bound is at least the default range away from it.
    free_lower = np.minimum(-reach, np.where(has_upper, upper - reach, -reach))
    free_upper = np.maximum(reach, np.where(has_lower, lower + reach, reach))
    return joint.random(rng, shape, np.where(has_lower, lower, free_lower), np.where(has_upper, upper, free_upper))
