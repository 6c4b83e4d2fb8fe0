"""What the orders of all libraries share: joints of one name, those that follow, and rates through P."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..errors import ModelError, UnknownNameError, ValueRangeError
from ..model.model import Body
from ..robot import Robot
from ..robot.robot_argument import require_robot
from ..typing import Array

Turning = Callable[[Robot, Array], Array]
"""What P ddq lacks of d(P dq)/dt, in our axes (nv,), of a robot and dq."""


_MARKS = {"Pinocchio": "getJointId", "MuJoCo": "njnt"}
"""What the models of each library have."""


def require_pair(robot: Robot, model: object, library: str) -> None:
    """Raise ValueRangeError unless the first is a robot and the second a model of that library."""
    require_robot(robot, "tw.convert")
    if not hasattr(model, _MARKS[library]):
        raise ValueRangeError(f"tw.convert: the model is {arguments.shown(model)}, and one of {library}'s is wanted.")


def check_names(robot: Robot, theirs: list[str], library: str) -> None:
    """Raise UnknownNameError or ModelError for a joint that is in one of the two only."""
    ours = [body.joint.name for body in robot.model.bodies]
    for name in ours:
        if name not in theirs:
            raise UnknownNameError.of(f"joint of {library}'s model", name, theirs)
    for name in theirs:
        if name not in ours:
            raise ModelError(
                f"joint {name!r} moves in {library}'s model and not here: is it locked, or the base floating?"
            )


def positions(body: Body, q: Array) -> Array:
    """The joint's own coordinates, of one that follows another too."""
    q = q[..., body.places[0]]
    return body.ratio * q + body.offset if body.follows else q


def rates_to(
    robot: Robot, P: Array, caller: str, dq: ArrayLike | None, ddq: ArrayLike | None, *, turning: Turning
) -> Iterator[Array]:
    """Velocities and accelerations there, where they are given: dq* = P dq."""
    if dq is None:
        return
    names = robot.velocity_names
    dq = arguments.one(dq, f"{caller}: dq", robot.nv, names=names)
    yield P @ dq
    if ddq is not None:
        yield P @ (arguments.one(ddq, f"{caller}: ddq", robot.nv, names=names) + turning(robot, dq))


def rates_from(
    robot: Robot, P: Array, caller: str, dq: ArrayLike | None, ddq: ArrayLike | None, *, turning: Turning
) -> Iterator[Array]:
    """Velocities and accelerations here, where they are given there."""
    if dq is None:
        return
    back = np.linalg.pinv(P)
    found = back @ arguments.one(dq, f"{caller}: dq", len(P))
    yield found
    if ddq is not None:
        yield back @ arguments.one(ddq, f"{caller}: ddq", len(P)) - turning(robot, found)
