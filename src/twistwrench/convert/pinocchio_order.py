"""States in Pinocchio's order, and from it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..errors import ModelError
from ..model.model import Body
from ..robot import Robot
from ..typing import Array
from .matched_joints import check_names, positions, require_pair


def to_pinocchio(robot: Robot, model: Any, q: ArrayLike, *rates: ArrayLike) -> tuple[Array, ...]:
    """Configuration and velocities in Pinocchio's order.

    Parameters
    ----------
    robot : Robot
    model : the other library's model of the same robot
    q : (nq,) array_like, configuration
    *rates : (..., nv) array_like, any number of dq, ddq

    Returns
    -------
    arrays : tuple, q and the rates as ``model`` takes them

    Raises
    ------
    UnknownNameError
        A joint is in one of the two only.
    ShapeError
        The last axes are not the robot's sizes, or batch shapes do not broadcast.
    """
    require_pair(robot, model, "Pinocchio")
    q = arguments.real(q, "to_pinocchio: q", robot.nq, names=robot.coordinate_names).astype(float)
    theirs = np.zeros((*q.shape[:-1], model.nq))
    for body, joint in _joints(robot, model):
        mine = positions(body, q)
        if body.joint.quaternion is not None:
            mine = body.joint.to_pinocchio(mine)
        elif joint.nq > joint.nv:  # planar and unbounded: the angle comes last, as its cosine and sine
            mine = np.concatenate([mine[..., :-1], np.cos(mine[..., -1:]), np.sin(mine[..., -1:])], axis=-1)
        theirs[..., joint.idx_q : joint.idx_q + joint.nq] = mine
    P = pinocchio_rates(robot, model)
    names = robot.velocity_names
    return theirs, *(
        arguments.real(x, "to_pinocchio: a rate", robot.nv, names=names).astype(float) @ P.T for x in rates
    )


def from_pinocchio(robot: Robot, model: Any, q: ArrayLike, *rates: ArrayLike) -> tuple[Array, ...]:
    """Configuration and velocities from Pinocchio's order.

    Parameters
    ----------
    robot : Robot
    model : the other library's model of the same robot
    q : (..., model.nq) array_like, configuration there
    *rates : (..., model.nv) array_like, any number of dq, ddq there

    Returns
    -------
    arrays : tuple, q (..., nq) and the rates (..., nv)

    Raises
    ------
    UnknownNameError
        A joint is in one of the two only.
    ShapeError
        An array is of another size.

    Notes
    -----
    Angles kept there as (cos, sin) come out within ±π; mimic joints are taken to follow.
    """
    require_pair(robot, model, "Pinocchio")
    q = arguments.real(q, "from_pinocchio: q", model.nq).astype(float)
    ours = np.zeros((*q.shape[:-1], robot.nq))
    for body, joint in _joints(robot, model):
        if body.follows:
            continue
        theirs = q[..., joint.idx_q : joint.idx_q + joint.nq]
        if body.joint.quaternion is not None:
            theirs = body.joint.from_pinocchio(theirs)
        elif joint.nq > joint.nv:
            angle = np.arctan2(theirs[..., -1:], theirs[..., -2:-1])
            theirs = np.concatenate([theirs[..., :-2], angle], axis=-1)
        ours[..., body.places[0]] = theirs
    P = np.linalg.pinv(pinocchio_rates(robot, model))
    return ours, *(arguments.real(rate, "from_pinocchio: a rate", model.nv).astype(float) @ P.T for rate in rates)


def pinocchio_rates(robot: Robot, model: Any) -> Array:
    """Matrix between the velocities of robot and Pinocchio model: P with dq* = P dq, dq* Pinocchio's.

    Parameters
    ----------
    robot : Robot
    model : the other library's model of the same robot

    Returns
    -------
    P : (model.nv, nv) array

    Raises
    ------
    UnknownNameError
        A joint is in one of the two only.

    Notes
    -----
    It is constant: both take the twist of a joint in the moving frame.
    """
    require_pair(robot, model, "Pinocchio")
    P = np.zeros((model.nv, robot.nv))
    for body, joint in _joints(robot, model):
        turn = np.eye(joint.nv)[list(body.joint.pinocchio_order)]
        P[joint.idx_v : joint.idx_v + joint.nv, body.places[1]] = body.ratio * turn
    return P


def _joints(robot: Robot, model: Any) -> Iterator[tuple[Body, Any]]:
    """Each body with Pinocchio's joint of the same name."""
    names = list(model.names)[1:]
    check_names(robot, names, "Pinocchio")
    for body in robot.model.bodies:
        joint = model.joints[model.getJointId(body.joint.name)]
        if joint.nv != body.joint.nv:
            raise ModelError(
                f"joint {body.joint.name!r} is {body.joint.kind} here and {joint.shortname()} in Pinocchio."
            )
        body.joint.require_pinocchio()
        yield body, joint
