"""States in Drake's order, and from it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..errors import ModelError, UnknownNameError
from ..formats.urdf import rotation_of_rpy, rpy_of_rotation
from ..lie import quaternion
from ..model.model import Body
from ..robot import Robot
from ..typing import Array
from .matched_joints import positions, rates_from, rates_to, require_pair


def to_drake(
    robot: Robot, plant: Any, q: ArrayLike, dq: ArrayLike | None = None, ddq: ArrayLike | None = None
) -> tuple[Array, ...]:
    """Positions, velocities and accelerations in the order of a plant of Drake's; one state.

    Parameters
    ----------
    robot : Robot, as :func:`twistwrench.from_drake` makes it, or one with joints of the same names
    plant : pydrake MultibodyPlant, finalised
    q : (nq,) array_like, configuration
    dq : (nv,) array_like, optional, joint velocities [rad/s, m/s]
    ddq : (nv,) array_like, optional, joint accelerations [rad/s², m/s²]

    Returns
    -------
    arrays : tuple, q, and dq and ddq where given, as the plant takes them

    Raises
    ------
    UnknownNameError
        A joint of the robot is not in the plant.
    ModelError
        A joint moves in the plant and not in the robot.
    ShapeError
        An array is of another size.
    """
    require_pair(robot, plant, "Drake")
    q = arguments.one(q, "to_drake: q", robot.nq, names=robot.coordinate_names)
    theirs = np.zeros(plant.num_positions())
    for body, joint, k in _joints(robot, plant):
        mine = positions(body, q)
        if "rpy" in joint.type_name():
            R = body.joint.pose(mine)[:3, :3]
            mine = np.concatenate([rpy_of_rotation(np.asarray(R, float)), mine[4:]])
        elif body.joint.quaternion is not None:
            mine = np.concatenate([mine[:4] / np.linalg.norm(mine[:4]), mine[4:]])
        at = joint.position_start() + k
        theirs[at : at + len(mine)] = mine
    return theirs, *rates_to(robot, drake_rates(robot, plant, q), "to_drake", dq, ddq, turning=_turning)


def from_drake(
    robot: Robot, plant: Any, q: ArrayLike, dq: ArrayLike | None = None, ddq: ArrayLike | None = None
) -> tuple[Array, ...]:
    """Configuration, velocities and accelerations from the order of a plant of Drake's; one state.

    Parameters
    ----------
    robot : Robot
    plant : pydrake MultibodyPlant, finalised
    q : (plant.num_positions(),) array_like
    dq : (plant.num_velocities(),) array_like, optional
    ddq : (plant.num_velocities(),) array_like, optional

    Returns
    -------
    arrays : tuple, q (nq,), and dq and ddq (nv,) where given

    Raises
    ------
    UnknownNameError
        A joint of the robot is not in the plant.
    ModelError
        A joint moves in the plant and not in the robot.
    ShapeError
        An array is of another size.
    """
    require_pair(robot, plant, "Drake")
    theirs = arguments.one(q, "from_drake: q", plant.num_positions())
    ours = robot.neutral
    for body, joint, k in _joints(robot, plant):
        if body.follows:
            continue
        part = theirs[joint.position_start() + k :]
        if "rpy" in joint.type_name():
            part = np.concatenate([quaternion.from_matrix(rotation_of_rpy(part[:3])), part[3:]])
        ours[body.places[0]] = part[: body.joint.nq]
    P = drake_rates(robot, plant, ours)
    return ours, *rates_from(robot, P, "from_drake", dq, ddq, turning=_turning)


def drake_rates(robot: Robot, plant: Any, q: ArrayLike) -> Array:
    """Matrix between the velocities of robot and plant: P with dq* = P dq at q, dq* Drake's.

    Parameters
    ----------
    robot : Robot
    plant : pydrake MultibodyPlant, finalised
    q : (nq,) array_like, configuration

    Returns
    -------
    P : (plant.num_velocities(), nv) array

    Raises
    ------
    UnknownNameError
        A joint of the robot is not in the plant.
    ModelError
        A joint moves in the plant and not in the robot.

    Notes
    -----
    Drake takes velocities of ball, planar and floating joints along the parent's axes, angular part first.
    """
    require_pair(robot, plant, "Drake")
    q = arguments.one(q, "drake_rates: q", robot.nq, names=robot.coordinate_names)
    P = np.zeros((plant.num_velocities(), robot.nv))
    for body, joint, k in _joints(robot, plant):
        mine, nv = q[..., body.places[0]], body.joint.nv
        turn = np.eye(nv)
        if body.joint.quaternion is not None:
            turn = np.kron(np.eye(nv // 3), np.asarray(body.joint.pose(mine)[:3, :3], float))
        elif not body.joint.plain_rates:
            turn = np.asarray(body.joint.rates(mine), float)
        at = joint.velocity_start() + k
        P[at : at + nv, body.places[1]] = body.ratio * turn
    return P


def _turning(robot: Robot, dq: Array) -> Array:
    """What P ddq lacks of d(P dq)/dt, in our axes: ω × v of joints that turn and slide at once."""
    extra = np.zeros(robot.nv)
    for body in robot.model.leaders:
        if not body.joint.plain_rates:
            V = body.joint.axes.T @ dq[body.places[1]]
            extra[body.places[1]] = body.joint.axes[:, 3:] @ np.cross(V[:3], V[3:])
    return extra


def _joints(robot: Robot, plant: Any) -> Iterator[tuple[Body, Any, int]]:
    """Each body with Drake's joint of the same name, and which of its axes it is: ``NAME.1`` is the second of two."""
    theirs = {}
    for joint in (plant.get_joint(i) for i in plant.GetJointIndices()):
        if joint.num_velocities():
            label = f"{plant.GetModelInstanceName(joint.model_instance())}::{joint.name()}"
            theirs[label] = theirs[joint.name()] = joint
    met = set()
    for body in robot.model.bodies:
        name, k = body.joint.name, 0
        if name not in theirs and name.endswith((".0", ".1")):
            name, k = name[:-2], int(name[-1])
        if name not in theirs:
            raise UnknownNameError.of("joint of Drake's plant", body.joint.name, theirs)
        met.add(theirs[name].index())
        yield body, theirs[name], k
    for name, joint in theirs.items():
        if joint.index() not in met:
            raise ModelError(f"joint {name!r} moves in Drake's plant and not here: is it locked, or the base floating?")
