"""Conversion of states between this library and MuJoCo, Pinocchio, and SciPy's quaternions."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import ModelError, ShapeError, UnknownNameError, ValueRangeError
from ..core.glossary import complete
from ..core.typing import Array
from ..mechanics.model.model import BASE, Body
from . import Robot
from .base import require_robot

__all__ = [
    "from_mujoco",
    "from_pinocchio",
    "from_scipy_quaternion",
    "mujoco_rates",
    "pinocchio_rates",
    "swap_halves",
    "to_mujoco",
    "to_pinocchio",
    "to_scipy_quaternion",
]

# Throughout this module, dq* = P dq are the velocities of the other library, and dq those of this one.

AccelerationOffset = Callable[[Robot, Array], Array]
"""Function of a robot and dq that returns ddq* - P ddq, transformed to this library's axes (nv,)."""


_IDENTIFYING_ATTRIBUTES = {"Pinocchio": "getJointId", "MuJoCo": "njnt"}
"""Attribute by which the models of a library are recognised."""


def require_pair(robot: Robot, model: object, library: str) -> None:
    """Raise ValueRangeError unless the arguments are a robot and a model of that library."""
    require_robot(robot, "tw.convert")
    if not hasattr(model, _IDENTIFYING_ATTRIBUTES[library]):
        raise ValueRangeError(
            f"tw.convert: the model is {arguments.value_text(model)}, and one of {library}'s is wanted."
        )


def check_names(robot: Robot, library_names: list[str], library: str) -> None:
    """Raise UnknownNameError or ModelError for a joint that exists in only one of the two models."""
    robot_names = [body.joint.name for body in robot.model.bodies]
    for name in robot_names:
        if name not in library_names:
            raise UnknownNameError.from_choices(f"joint of {library}'s model", name, library_names)
    for name in library_names:
        if name not in robot_names:
            raise ModelError(
                f"joint {name!r} moves in {library}'s model and not here: is it locked, or the base floating?"
            )


def positions(body: Body, q: Array) -> Array:
    """Coordinates of a body's joint; coordinates of a mimic joint follow from its leader's."""
    q_entries, _ = body.places  # of a mimic joint, entries of its leader
    q_of_joint = q[..., q_entries]
    if body.follows:
        return body.ratio * q_of_joint + body.offset
    return q_of_joint


def rates_to(
    robot: Robot,
    P: Array,
    caller: str,
    dq: ArrayLike | None,
    ddq: ArrayLike | None,
    *,
    acceleration_offset: AccelerationOffset,
) -> Iterator[Array]:
    """Velocities dq* if dq is given, then accelerations ddq* if both are given; ``caller`` is named in messages."""
    if dq is None:
        return
    names = robot.velocity_names
    dq = arguments.one(dq, f"{caller}: dq", robot.nv, names=names)
    yield P @ dq
    if ddq is not None:
        ddq = arguments.one(ddq, f"{caller}: ddq", robot.nv, names=names)
        yield P @ (ddq + acceleration_offset(robot, dq))


def rates_from(
    robot: Robot,
    P: Array,
    caller: str,
    dq: ArrayLike | None,
    ddq: ArrayLike | None,
    *,
    acceleration_offset: AccelerationOffset,
) -> Iterator[Array]:
    """Velocities dq from dq* of the other library if given, then accelerations ddq if both are given.

    The arguments ``dq`` and ``ddq`` are dq* and ddq*.
    """
    if dq is None:
        return
    P_inverse = np.linalg.pinv(P)
    robot_dq = P_inverse @ arguments.one(dq, f"{caller}: dq", len(P))
    yield robot_dq
    if ddq is not None:
        library_ddq = arguments.one(ddq, f"{caller}: ddq", len(P))
        yield P_inverse @ library_ddq - acceleration_offset(robot, robot_dq)


def to_mujoco(
    robot: Robot, model: Any, q: ArrayLike, dq: ArrayLike | None = None, ddq: ArrayLike | None = None
) -> tuple[Array, ...]:
    """Configuration, velocities and accelerations in MuJoCo's order; one state per call.

    Parameters
    ----------
    dq : (nv,) array_like, optional, joint velocities [rad/s, m/s]
    ddq : (nv,) array_like, optional, joint accelerations [rad/s², m/s²]

    Returns
    -------
    arrays : tuple, q, and dq and ddq if given, in the order of ``model``
    """
    require_pair(robot, model, "MuJoCo")
    q = arguments.one(q, "to_mujoco: q", robot.nq, names=robot.coordinate_names)
    qpos = np.zeros(model.nq)
    for body, joint in _bodies_with_mujoco_joints(robot, model):
        coordinates = body.joint.to_mujoco(positions(body, q))
        begin = int(joint.qposadr[0])
        qpos[begin : begin + len(coordinates)] = coordinates
    P = mujoco_rates(robot, model, q)
    return qpos, *rates_to(robot, P, "to_mujoco", dq, ddq, acceleration_offset=_acceleration_offset)


def from_mujoco(
    robot: Robot, model: Any, q: ArrayLike, dq: ArrayLike | None = None, ddq: ArrayLike | None = None
) -> tuple[Array, ...]:
    """Configuration, velocities and accelerations from MuJoCo's order; one state per call.

    Parameters
    ----------
    q : (model.nq,) array_like, qpos
    dq : (model.nv,) array_like, optional, qvel
    ddq : (model.nv,) array_like, optional, qacc

    Returns
    -------
    arrays : tuple, q (nq,), and dq and ddq (nv,) if given

    Notes
    -----
    Values of mimic joints are ignored, since they follow their leaders.
    """
    require_pair(robot, model, "MuJoCo")
    qpos = arguments.one(q, "from_mujoco: q", model.nq)
    robot_q = np.zeros(robot.nq)
    for body, joint in _bodies_with_mujoco_joints(robot, model):
        if not body.follows:
            begin = int(joint.qposadr[0])
            coordinates = qpos[begin : begin + body.joint.nq]
            q_entries, _ = body.places
            robot_q[q_entries] = body.joint.from_mujoco(coordinates)
    P = mujoco_rates(robot, model, robot_q)
    return robot_q, *rates_from(robot, P, "from_mujoco", dq, ddq, acceleration_offset=_acceleration_offset)


def mujoco_rates(robot: Robot, model: Any, q: ArrayLike) -> Array:
    """Matrix between the velocities of robot and MuJoCo model: P with dq* = P dq at q, dq* MuJoCo's.

    Returns
    -------
    P : (model.nv, nv) array

    Notes
    -----
    MuJoCo uses the linear velocity of floating joints along the world axes.
    """
    require_pair(robot, model, "MuJoCo")
    q = arguments.one(q, "mujoco_rates: q", robot.nq, names=robot.coordinate_names)
    P = np.zeros((model.nv, robot.nv))
    for body, joint in _bodies_with_mujoco_joints(robot, model):
        q_entries, v_entries = body.places
        block = body.joint.mujoco_rates(q[..., q_entries])
        begin = int(joint.dofadr[0])
        P[begin : begin + body.joint.nv, v_entries] = body.ratio * block
    return P


def _acceleration_offset(robot: Robot, dq: Array) -> Array:
    """d(P dq)/dt - P ddq in this library's axes: omega × v of each floating joint."""
    offset = np.zeros(robot.nv)
    for body in robot.model.leaders:
        _, v_entries = body.places
        offset[v_entries] = body.joint.mujoco_turning(dq[v_entries])
    return offset


def _bodies_with_mujoco_joints(robot: Robot, model: Any) -> Iterator[tuple[Body, Any]]:
    """Pairs of a body and MuJoCo's joint of the same name."""
    names = [_joint_name(model, joint_index) for joint_index in range(model.njnt)]
    check_names(robot, names, "MuJoCo")
    joint_index_by_name = {name: joint_index for joint_index, name in enumerate(names)}
    for body in robot.model.bodies:
        is_at_origin = body.parent == BASE and np.array_equal(body.placement, np.eye(4))
        if not body.joint.driven and not is_at_origin:
            raise ModelError(
                f"joint {body.joint.name!r} floats away from the world's origin; MuJoCo has no joint for that."
            )
        yield body, model.joint(joint_index_by_name[body.joint.name])


def _joint_name(model: Any, joint_index: int) -> str:
    """Name of a joint; without one, the default name of the MJCF reader, such as ``body3.hinge`` or ``body3.slide1``."""
    if model.joint(joint_index).name:
        return str(model.joint(joint_index).name)
    body_index = int(model.jnt_bodyid[joint_index])
    body_name = model.body(body_index).name or f"body{body_index}"
    kinds = ("free", "ball", "slide", "hinge")  # in the order of MuJoCo's mjtJoint
    kind = kinds[int(model.jnt_type[joint_index])]
    number_in_body = ""
    if model.body_jntnum[body_index] > 1:
        number_in_body = str(joint_index - int(model.body_jntadr[body_index]))
    return f"{body_name}.{kind}{number_in_body}"


def to_pinocchio(robot: Robot, model: Any, q: ArrayLike, *rates: ArrayLike) -> tuple[Array, ...]:
    """Configuration and velocities in Pinocchio's order.

    Parameters
    ----------
    *rates : (..., nv) array_like, any number of dq, ddq

    Returns
    -------
    arrays : tuple, q and the rates in the order of ``model``
    """
    require_pair(robot, model, "Pinocchio")
    q = arguments.real(q, "to_pinocchio: q", robot.nq, names=robot.coordinate_names).astype(float)
    pinocchio_q = np.zeros((*q.shape[:-1], model.nq))
    for body, joint in _bodies_with_pinocchio_joints(robot, model):
        coordinates = positions(body, q)
        if body.joint.quaternion is not None:
            coordinates = body.joint.to_pinocchio(coordinates)
        elif joint.nq > joint.nv:  # planar and unbounded joints: the angle is last, as its cosine and sine
            angle = coordinates[..., -1:]
            coordinates = np.concatenate([coordinates[..., :-1], np.cos(angle), np.sin(angle)], axis=-1)
        pinocchio_q[..., joint.idx_q : joint.idx_q + joint.nq] = coordinates
    P = pinocchio_rates(robot, model)
    names = robot.velocity_names
    robot_rates = [arguments.real(rate, "to_pinocchio: a rate", robot.nv, names=names).astype(float) for rate in rates]
    return pinocchio_q, *(rate @ P.T for rate in robot_rates)


def from_pinocchio(robot: Robot, model: Any, q: ArrayLike, *rates: ArrayLike) -> tuple[Array, ...]:
    """Configuration and velocities from Pinocchio's order.

    Parameters
    ----------
    q : (..., model.nq) array_like, configuration in Pinocchio's order
    *rates : (..., model.nv) array_like, any number of dq, ddq in Pinocchio's order

    Returns
    -------
    arrays : tuple, q (..., nq) and the rates (..., nv)

    Notes
    -----
    Angles stored as (cos, sin) are returned within ±π. Values of mimic joints are ignored.
    """
    require_pair(robot, model, "Pinocchio")
    q = arguments.real(q, "from_pinocchio: q", model.nq).astype(float)
    robot_q = np.zeros((*q.shape[:-1], robot.nq))
    for body, joint in _bodies_with_pinocchio_joints(robot, model):
        if body.follows:
            continue
        coordinates = q[..., joint.idx_q : joint.idx_q + joint.nq]
        if body.joint.quaternion is not None:
            coordinates = body.joint.from_pinocchio(coordinates)
        elif joint.nq > joint.nv:  # the angle is last, as its cosine and sine
            angle = np.arctan2(coordinates[..., -1:], coordinates[..., -2:-1])
            coordinates = np.concatenate([coordinates[..., :-2], angle], axis=-1)
        q_entries, _ = body.places
        robot_q[..., q_entries] = coordinates
    P_inverse = np.linalg.pinv(pinocchio_rates(robot, model))
    library_rates = [arguments.real(rate, "from_pinocchio: a rate", model.nv).astype(float) for rate in rates]
    return robot_q, *(rate @ P_inverse.T for rate in library_rates)


def pinocchio_rates(robot: Robot, model: Any) -> Array:
    """Matrix between the velocities of robot and Pinocchio model: P with dq* = P dq, dq* Pinocchio's.

    Returns
    -------
    P : (model.nv, nv) array

    Notes
    -----
    The matrix is constant: both libraries use the joint twist in the moving frame.
    """
    require_pair(robot, model, "Pinocchio")
    P = np.zeros((model.nv, robot.nv))
    for body, joint in _bodies_with_pinocchio_joints(robot, model):
        permutation = np.eye(joint.nv)[list(body.joint.pinocchio_order)]  # rows of the identity in Pinocchio's order
        _, v_entries = body.places
        P[joint.idx_v : joint.idx_v + joint.nv, v_entries] = body.ratio * permutation
    return P


def _bodies_with_pinocchio_joints(robot: Robot, model: Any) -> Iterator[tuple[Body, Any]]:
    """Pairs of a body and Pinocchio's joint of the same name."""
    names = list(model.names)[1:]  # the first one is the universe
    check_names(robot, names, "Pinocchio")
    for body in robot.model.bodies:
        joint = model.joints[model.getJointId(body.joint.name)]
        if joint.nv != body.joint.nv:
            raise ModelError(
                f"joint {body.joint.name!r} is {body.joint.kind} here and {joint.shortname()} in Pinocchio."
            )
        body.joint.require_pinocchio()
        yield body, joint


def to_scipy_quaternion(Q: ArrayLike) -> Array:
    """Quaternions in the order of SciPy's ``Rotation.from_quat``, scalar last.

    Parameters
    ----------
    Q : (..., 4) array_like, (w, x, y, z)

    Returns
    -------
    Q : (..., 4) array, (x, y, z, w)

    Examples
    --------
    >>> to_scipy_quaternion([1, 0, 0, 0]).tolist()
    [0.0, 0.0, 0.0, 1.0]
    """
    scalar_first = np.asarray(arguments.real(Q, "to_scipy_quaternion: Q", 4), float)
    return np.roll(scalar_first, -1, axis=-1)


def from_scipy_quaternion(Q: ArrayLike) -> Array:
    """Quaternions from the order of SciPy's ``Rotation.as_quat``, converted to scalar first.

    Parameters
    ----------
    Q : (..., 4) array_like, (x, y, z, w)

    Returns
    -------
    Q : (..., 4) array, (w, x, y, z)

    Examples
    --------
    >>> from_scipy_quaternion([0, 0, 0, 1]).tolist()
    [1.0, 0.0, 0.0, 0.0]
    """
    scalar_last = np.asarray(arguments.real(Q, "from_scipy_quaternion: Q", 4), float)
    return np.roll(scalar_last, 1, axis=-1)


# Joints are matched by name, so the other library must have read the same file. Quantities of the other library have a star.
# For each library there is one matrix P with
#
#     dq* = P dq        and so        τ = P' τ*,    M = P' M* P,    J = J* P.
#
# P also has rows for joints that are mimic joints here and independent joints there.
#
# Pinocchio: children of one link in alphabetical order; floating joints ``(x, y, z, qx, qy, qz, qw)`` and body twists
# ``(v, omega)``; unbounded angles as (cos, sin). MuJoCo: children in document order; floating joints
# ``(x, y, z, qw, qx, qy, qz)``, their velocity the origin's along world axes, then omega in the body.


def swap_halves(rows: ArrayLike, axis: int | None = None) -> Array:
    """Convert twists, wrenches or Jacobians from linear part first to angular part first, or back.

    Parameters
    ----------
    rows : (..., 6) array_like twists or wrenches, (..., 6, n) array_like Jacobians
    axis : int, optional, axis with the six rows; None: the only one of the last two axes of length 6

    Returns
    -------
    rows : array of the same shape

    Examples
    --------
    >>> swap_halves([1, 2, 3, 4, 5, 6]).tolist()
    [4, 5, 6, 1, 2, 3]
    >>> import numpy as np
    >>> swap_halves(np.eye(6), axis=-2)[0].tolist()  # a Jacobian of six joints
    [0.0, 0.0, 0.0, 1.0, 0.0, 0.0]
    """
    array = arguments.plain(rows, "swap_halves: rows")
    if axis is None:
        candidate_axes = [-2, -1]
    else:
        candidate_axes = [axis]
    existing_axes = [k for k in candidate_axes if -array.ndim <= k < array.ndim]  # axes may be negative
    axes_of_6 = [k for k in existing_axes if array.shape[k] == 6]
    if not axes_of_6:
        raise ShapeError(f"swap_halves: rows has shape {array.shape}, and no axis of 6 where they are wanted.")
    if len(axes_of_6) > 1:
        raise ShapeError(
            f"swap_halves: rows has shape {array.shape}, and both of the last two axes are 6 long: pass axis=-1 for "
            "twists, axis=-2 for a Jacobian."
        )
    (axis_of_6,) = axes_of_6
    return np.roll(array, 3, axis=axis_of_6)


complete(globals())
