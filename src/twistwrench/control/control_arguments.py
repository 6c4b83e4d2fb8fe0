"""Argument checks of ``control``: robots, states and gains as they must be, or an error that says what is wrong."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ..algorithms.control_laws import undriven
from ..core import arguments
from ..core.printed_numbers import printed
from ..errors import ShapeError, ValueRangeError
from ..robot import Robot
from ..robot.robot_argument import require_robot
from ..typing import Array

_SYMMETRIC = 1e-9


def require_driven(robot: object, what: str) -> Robot:
    """A robot that has a torque for every velocity. Raises ValueRangeError."""
    found = require_robot(robot, what)
    if names := undriven(found.model):
        raise ValueRangeError(
            f"{what} wants a torque for every velocity, and {', '.join(names)} of robot {found.name!r} is no joint of one "
            "degree of freedom. Lock it (robot.lock), or load the robot on a fixed base."
        )
    return found


def one_state(robot: Robot, what: str, q: ArrayLike, dq: ArrayLike) -> tuple[Array, Array]:
    """q (nq,) and dq (nv,) of one state. Raises ShapeError, ValueRangeError."""
    rates = robot.model.velocity_names
    return (
        arguments.one(q, f"{what}: q", robot.nq, names=robot.coordinate_names),
        arguments.one(dq, f"{what}: dq", robot.nv, names=rates),
    )


def gain(K: ArrayLike, what: str, names: Sequence[str], *, definite: bool = False) -> Array:
    """A gain as a symmetric matrix (n, n), n the number of names: from one number for all, one each (n,), or the matrix.

    Raises ShapeError, and ValueRangeError for one that is not positive semidefinite, or not definite where it must be.
    """
    n, given = len(names), arguments.finite(K, what, names=names)
    if given.shape not in ((), (n,), (n, n)):
        raise ShapeError(
            f"{what} has shape {given.shape}: give one number, {n} of them (for {', '.join(names)}), or a symmetric "
            f"matrix ({n}, {n})."
        )
    full = np.array(given if given.ndim == 2 else given * np.eye(n), float)
    scale = float(np.abs(full).max(initial=0.0))
    if np.abs(full - full.T).max(initial=0.0) > _SYMMETRIC * scale:
        raise ValueRangeError(
            f"{what} is not symmetric, so it could feed energy in. Give a symmetric matrix ({n}, {n})."
        )
    least = float(np.linalg.eigvalsh(full).min(initial=np.inf))
    if least < -_SYMMETRIC * scale or (definite and not least > 0.0):
        wanted = "be above zero" if definite else "not be negative"
        raise ValueRangeError(
            f"{what} has the eigenvalue {printed(least, 4)}, and must {wanted}: a gain holds back, never pushes on."
        )
    full.setflags(write=False)
    return full
