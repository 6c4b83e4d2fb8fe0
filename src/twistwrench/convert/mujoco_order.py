"""States in MuJoCo's order, and from it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..errors import ModelError
from ..model.model import BASE, Body
from ..robot import Robot
from ..typing import Array
from .matched_joints import check_names, positions, rates_from, rates_to, require_pair


def to_mujoco(
    robot: Robot, model: Any, q: ArrayLike, dq: ArrayLike | None = None, ddq: ArrayLike | None = None
) -> tuple[Array, ...]:
    """Configuration, velocities and accelerations in MuJoCo's order; one state.

    Parameters
    ----------
    robot : Robot
    model : the other library's model of the same robot
    q : (nq,) array_like, configuration
    dq : (nv,) array_like, optional, joint velocities [rad/s, m/s]
    ddq : (nv,) array_like, optional, joint accelerations [rad/s², m/s²]

    Returns
    -------
    arrays : tuple, q, and dq and ddq where given, as ``model`` takes them

    Raises
    ------
    UnknownNameError
        A joint is in one of the two only.
    ShapeError
        The last axes are not the robot's sizes, or batch shapes do not broadcast.
    """
    require_pair(robot, model, "MuJoCo")
    q = arguments.one(q, "to_mujoco: q", robot.nq, names=robot.coordinate_names)
    theirs = np.zeros(model.nq)
    for body, joint in _joints(robot, model):
        mine = body.joint.to_mujoco(positions(body, q))
        theirs[int(joint.qposadr[0]) :][: len(mine)] = mine
    return theirs, *rates_to(robot, mujoco_rates(robot, model, q), "to_mujoco", dq, ddq, turning=_turning)


def from_mujoco(
    robot: Robot, model: Any, q: ArrayLike, dq: ArrayLike | None = None, ddq: ArrayLike | None = None
) -> tuple[Array, ...]:
    """Configuration, velocities and accelerations from MuJoCo's order; one state.

    Parameters
    ----------
    robot : Robot
    model : the other library's model of the same robot
    q : (model.nq,) array_like, qpos
    dq : (model.nv,) array_like, optional, qvel
    ddq : (model.nv,) array_like, optional, qacc

    Returns
    -------
    arrays : tuple, q (nq,), and dq and ddq (nv,) where given

    Raises
    ------
    UnknownNameError
        A joint is in one of the two only.
    ShapeError
        An array is of another size.

    Notes
    -----
    Mimic joints are taken to follow.
    """
    require_pair(robot, model, "MuJoCo")
    theirs = arguments.one(q, "from_mujoco: q", model.nq)
    ours = np.zeros(robot.nq)
    for body, joint in _joints(robot, model):
        if not body.follows:
            part = theirs[int(joint.qposadr[0]) :][: body.joint.nq]
            ours[body.places[0]] = body.joint.from_mujoco(part)
    P = mujoco_rates(robot, model, ours)
    return ours, *rates_from(robot, P, "from_mujoco", dq, ddq, turning=_turning)


def mujoco_rates(robot: Robot, model: Any, q: ArrayLike) -> Array:
    """Matrix between the velocities of robot and MuJoCo model: P with dq* = P dq at q, dq* MuJoCo's.

    Parameters
    ----------
    robot : Robot
    model : the other library's model of the same robot
    q : (nq,) array_like, configuration

    Returns
    -------
    P : (model.nv, nv) array

    Raises
    ------
    UnknownNameError
        A joint is in one of the two only.

    Notes
    -----
    MuJoCo takes the linear velocity of floating joints along the world's axes.
    """
    require_pair(robot, model, "MuJoCo")
    q = arguments.one(q, "mujoco_rates: q", robot.nq, names=robot.coordinate_names)
    P = np.zeros((model.nv, robot.nv))
    for body, joint in _joints(robot, model):
        turn = body.joint.mujoco_rates(q[..., body.places[0]])
        start = int(joint.dofadr[0])
        P[start : start + body.joint.nv, body.places[1]] = body.ratio * turn
    return P


def _turning(robot: Robot, dq: Array) -> Array:
    """What P ddq lacks of d(P dq)/dt, in our axes: omega × v of each floating joint."""
    extra = np.zeros(robot.nv)
    for body in robot.model.leaders:
        extra[body.places[1]] = body.joint.mujoco_turning(dq[body.places[1]])
    return extra


def _joints(robot: Robot, model: Any) -> Iterator[tuple[Body, Any]]:
    """Each body with MuJoCo's joint of the same name."""
    names = [_name(model, i) for i in range(model.njnt)]
    check_names(robot, names, "MuJoCo")
    numbers = {name: i for i, name in enumerate(names)}
    for body in robot.model.bodies:
        if not body.joint.driven and (body.parent != BASE or not np.array_equal(body.placement, np.eye(4))):
            raise ModelError(
                f"joint {body.joint.name!r} floats away from the world's origin; MuJoCo has no joint for that."
            )
        yield body, model.joint(numbers[body.joint.name])


def _name(model: Any, i: int) -> str:
    """The joint's name; of one without, that which reading its MJCF file gives it: ``body3.hinge``, ``body3.slide1``."""
    if model.joint(i).name:
        return str(model.joint(i).name)
    b = int(model.jnt_bodyid[i])
    place = str(i - int(model.body_jntadr[b])) if model.body_jntnum[b] > 1 else ""
    return f"{model.body(b).name or f'body{b}'}.{('free', 'ball', 'slide', 'hinge')[int(model.jnt_type[i])]}{place}"
