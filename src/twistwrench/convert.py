"""States in the words of other libraries: the orders, signs and frames of Pinocchio, MuJoCo and Drake; SciPy's quaternions.

Joints are matched by name, so the other library must have read the same file. Theirs marked with a star, there is one
matrix P for each library with

    dq* = P dq        and so        τ = P' τ*,    M = P' M* P,    J = J* P.

Where a joint mimics another here and is independent there, P has a row for it all the same.

Pinocchio: children of one link in alphabetical order; floating joints ``(x, y, z, qx, qy, qz, qw)`` and body twists
``(v, omega)``; unbounded angles as (cos, sin). MuJoCo: children in document order; floating joints
``(x, y, z, qw, qx, qy, qz)``, their velocity the origin's along world axes, then omega in the body. Drake: its joints say where
they begin; velocities of ball, planar and floating joints along the parent's axes, ball joints as roll, pitch, yaw.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .core import arguments
from .errors import ModelError, ShapeError, UnknownNameError, ValueRangeError
from .formats.urdf import rotation_of_rpy, rpy_of_rotation
from .lie import quaternion
from .model.model import BASE, Body
from .robot import Robot
from .robot.robot_argument import require_robot
from .typing import Array

__all__ = [
    "drake_rates",
    "from_drake",
    "from_mujoco",
    "from_pinocchio",
    "from_scipy_quaternion",
    "mujoco_rates",
    "pinocchio_rates",
    "swap_halves",
    "to_drake",
    "to_mujoco",
    "to_pinocchio",
    "to_scipy_quaternion",
]


def swap_halves(rows: ArrayLike, axis: int | None = None) -> Array:
    """Twists, wrenches or Jacobians from linear part first to angular part first, or back.

    Parameters
    ----------
    rows : (..., 6) array_like twists or wrenches, (..., 6, n) array_like Jacobians
    axis : int, optional; which axis has the six rows; None: the only one of the last two that is 6 long

    Returns
    -------
    rows : array of the same shape

    Raises
    ------
    ShapeError
        No axis is 6 long, or two are and ``axis`` does not say which one.

    Examples
    --------
    >>> swap_halves([1, 2, 3, 4, 5, 6]).tolist()
    [4, 5, 6, 1, 2, 3]
    >>> import numpy as np
    >>> swap_halves(np.eye(6), axis=-2)[0].tolist()  # a Jacobian of six joints
    [0.0, 0.0, 0.0, 1.0, 0.0, 0.0]
    """
    x = arguments.plain(rows, "swap_halves: rows")
    allowed = range(-min(x.ndim, 2), 0) if axis is None else (axis,)
    found = [k for k in allowed if -x.ndim <= k < x.ndim and x.shape[k] == 6]
    if len(found) != 1:
        several = "both of the last two axes are 6 long: say axis=-1 for twists, axis=-2 for a Jacobian"
        raise ShapeError(
            f"swap_halves: rows has shape {x.shape}, and {several if found else 'no axis of 6 where they are wanted'}."
        )
    return np.roll(x, 3, axis=found[0])


# ── Pinocchio ──


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
    require_robot(robot, "to_pinocchio")
    q = arguments.real(q, "to_pinocchio: q", robot.nq, names=robot.coordinate_names).astype(float)
    joints = list(_pinocchio_joints(robot, model))
    theirs = np.zeros((*q.shape[:-1], model.nq))
    for body, joint in joints:
        mine = body.ratio * _part(body, q) + body.offset if body.follows else _part(body, q)
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
    joints = list(_pinocchio_joints(robot, model))
    q = arguments.real(q, "from_pinocchio: q", model.nq).astype(float)
    ours = np.zeros((*q.shape[:-1], robot.nq))
    for body, joint in joints:
        if body.follows:
            continue
        theirs = q[..., joint.idx_q : joint.idx_q + joint.nq]
        if body.joint.quaternion is not None:
            theirs = body.joint.from_pinocchio(theirs)
        elif joint.nq > joint.nv:
            angle = np.arctan2(theirs[..., -1:], theirs[..., -2:-1])
            theirs = np.concatenate([theirs[..., :-2], angle], axis=-1)
        ours[..., body.q_index : body.q_index + body.joint.nq] = theirs
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
    P = np.zeros((model.nv, robot.nv))
    for body, joint in _pinocchio_joints(robot, model):
        turn = np.eye(joint.nv)[list(body.joint.pinocchio_order)]
        P[joint.idx_v : joint.idx_v + joint.nv, _columns(body)] = body.ratio * turn
    return P


def _pinocchio_joints(robot: Robot, model: Any) -> Iterator[tuple[Body, Any]]:
    """Each body with Pinocchio's joint of the same name."""
    require_robot(robot, "tw.convert")
    if not hasattr(model, "names"):
        raise ValueRangeError(f"tw.convert: the model is {arguments.shown(model)}, and a pinocchio.Model is wanted.")
    names = list(model.names)[1:]
    _check_names(robot, names, "Pinocchio")
    for body in robot.model.bodies:
        joint = model.joints[model.getJointId(body.joint.name)]
        if joint.nv != body.joint.nv:
            raise ModelError(
                f"joint {body.joint.name!r} is {body.joint.kind} here and {joint.shortname()} in Pinocchio."
            )
        body.joint.require_pinocchio()
        yield body, joint


# ── MuJoCo ──


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
    q = arguments.one(q, "to_mujoco: q", robot.nq, names=robot.coordinate_names)
    theirs = np.zeros(model.nq)
    for body, joint in _mujoco_joints(robot, model):
        mine = body.ratio * _part(body, q) + body.offset if body.follows else _part(body, q)
        mine = body.joint.to_mujoco(mine)
        theirs[int(joint.qposadr[0]) :][: len(mine)] = mine
    P = mujoco_rates(robot, model, q)
    found, names = [theirs], robot.model.velocity_names
    if dq is not None:
        dq = arguments.one(dq, "to_mujoco: dq", robot.nv, names=names)
        found.append(P @ dq)
    if dq is not None and ddq is not None:
        ddq = arguments.one(ddq, "to_mujoco: ddq", robot.nv, names=names)
        found.append(P @ (ddq + _turning(robot, dq)))
    return tuple(found)


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
    theirs = arguments.one(q, "from_mujoco: q", model.nq)
    ours = np.zeros(robot.nq)
    for body, joint in _mujoco_joints(robot, model):
        if not body.follows:
            part = theirs[int(joint.qposadr[0]) :][: body.joint.nq]
            ours[body.places[0]] = body.joint.from_mujoco(part)
    P = np.linalg.pinv(mujoco_rates(robot, model, ours))
    found = [ours]
    if dq is not None:
        found.append(P @ arguments.one(dq, "from_mujoco: dq", model.nv))
    if ddq is not None and dq is not None:
        found.append(P @ arguments.one(ddq, "from_mujoco: ddq", model.nv) - _turning(robot, found[1]))
    return tuple(found)


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
    q = arguments.one(q, "mujoco_rates: q", robot.nq, names=robot.coordinate_names)
    P = np.zeros((model.nv, robot.nv))
    for body, joint in _mujoco_joints(robot, model):
        turn = body.joint.mujoco_rates(_part(body, q))
        start = int(joint.dofadr[0])
        P[start : start + body.joint.nv, _columns(body)] = body.ratio * turn
    return P


def _turning(robot: Robot, dq: Array) -> Array:
    """What P ddq lacks of d(P dq)/dt, in our axes: omega × v of each floating joint."""
    extra = np.zeros(robot.nv)
    for body in robot.model.leaders:
        extra[body.places[1]] = body.joint.mujoco_turning(dq[body.places[1]])
    return extra


def _mujoco_joints(robot: Robot, model: Any) -> Iterator[tuple[Body, Any]]:
    """Each body with MuJoCo's joint of the same name."""
    names = [_mujoco_name(model, i) for i in range(model.njnt)]
    _check_names(robot, names, "MuJoCo")
    numbers = {name: i for i, name in enumerate(names)}
    for body in robot.model.bodies:
        if not body.joint.driven and (body.parent != BASE or not np.array_equal(body.placement, np.eye(4))):
            raise ModelError(
                f"joint {body.joint.name!r} floats away from the world's origin; MuJoCo has no joint for that."
            )
        yield body, model.joint(numbers[body.joint.name])


def _mujoco_name(model: Any, i: int) -> str:
    """The joint's name; of one without, that which reading its MJCF file gives it: ``body3.hinge``, ``body3.slide1``."""
    if model.joint(i).name:
        return str(model.joint(i).name)
    b = int(model.jnt_bodyid[i])
    place = str(i - int(model.body_jntadr[b])) if model.body_jntnum[b] > 1 else ""
    return f"{model.body(b).name or f'body{b}'}.{('free', 'ball', 'slide', 'hinge')[int(model.jnt_type[i])]}{place}"


# ── Drake ──


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
    q = arguments.one(q, "to_drake: q", robot.nq, names=robot.coordinate_names)
    theirs = np.zeros(plant.num_positions())
    for body, joint, k in _drake_joints(robot, plant):
        mine = body.ratio * _part(body, q) + body.offset if body.follows else _part(body, q)
        if "rpy" in joint.type_name():
            R = body.joint.pose(mine)[:3, :3]
            mine = np.concatenate([rpy_of_rotation(np.asarray(R, float)), mine[4:]])
        elif body.joint.quaternion is not None:
            mine = np.concatenate([mine[:4] / np.linalg.norm(mine[:4]), mine[4:]])
        at = joint.position_start() + k
        theirs[at : at + len(mine)] = mine
    P, found, names = drake_rates(robot, plant, q), [theirs], robot.model.velocity_names
    if dq is not None:
        dq = arguments.one(dq, "to_drake: dq", robot.nv, names=names)
        found.append(P @ dq)
    if dq is not None and ddq is not None:
        ddq = arguments.one(ddq, "to_drake: ddq", robot.nv, names=names)
        found.append(P @ (ddq + _drake_turning(robot, dq)))
    return tuple(found)


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
    theirs = arguments.one(q, "from_drake: q", plant.num_positions())
    ours = robot.neutral
    for body, joint, k in _drake_joints(robot, plant):
        if body.follows:
            continue
        part = theirs[joint.position_start() + k :]
        if "rpy" in joint.type_name():
            part = np.concatenate([quaternion.from_matrix(rotation_of_rpy(part[:3])), part[3:]])
        ours[body.places[0]] = part[: body.joint.nq]
    P, found = np.linalg.pinv(drake_rates(robot, plant, ours)), [ours]
    if dq is not None:
        found.append(P @ arguments.one(dq, "from_drake: dq", plant.num_velocities()))
    if ddq is not None and dq is not None:
        found.append(
            P @ arguments.one(ddq, "from_drake: ddq", plant.num_velocities()) - _drake_turning(robot, found[1])
        )
    return tuple(found)


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
    q = arguments.one(q, "drake_rates: q", robot.nq, names=robot.coordinate_names)
    P = np.zeros((plant.num_velocities(), robot.nv))
    for body, joint, k in _drake_joints(robot, plant):
        mine, nv = _part(body, q), body.joint.nv
        turn = np.eye(nv)
        if body.joint.quaternion is not None:
            turn = np.kron(np.eye(nv // 3), np.asarray(body.joint.pose(mine)[:3, :3], float))
        elif not body.joint.plain_rates:
            turn = np.asarray(body.joint.rates(mine), float)
        at = joint.velocity_start() + k
        P[at : at + nv, _columns(body)] = body.ratio * turn
    return P


def _drake_turning(robot: Robot, dq: Array) -> Array:
    """What P ddq lacks of d(P dq)/dt, in our axes: ω × v of joints that turn and slide at once."""
    extra = np.zeros(robot.nv)
    for body in robot.model.leaders:
        if not body.joint.plain_rates:
            V = body.joint.axes.T @ dq[body.places[1]]
            extra[body.places[1]] = body.joint.axes[:, 3:] @ np.cross(V[:3], V[3:])
    return extra


def _drake_joints(robot: Robot, plant: Any) -> Iterator[tuple[Body, Any, int]]:
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


# ── SciPy ──


def to_scipy_quaternion(Q: ArrayLike) -> Array:
    """Quaternions as SciPy's ``Rotation.from_quat`` takes them, scalar last.

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
    return np.roll(np.asarray(arguments.real(Q, "to_scipy_quaternion: Q", 4), float), -1, axis=-1)


def from_scipy_quaternion(Q: ArrayLike) -> Array:
    """Quaternions as SciPy's ``Rotation.as_quat`` gives them, scalar first then.

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
    return np.roll(np.asarray(arguments.real(Q, "from_scipy_quaternion: Q", 4), float), 1, axis=-1)


# ── both ──


def _check_names(robot: Robot, theirs: list[str], library: str) -> None:
    ours = [body.joint.name for body in robot.model.bodies]
    for name in ours:
        if name not in theirs:
            raise UnknownNameError.of(f"joint of {library}'s model", name, theirs)
    for name in theirs:
        if name not in ours:
            raise ModelError(
                f"joint {name!r} moves in {library}'s model and not here: is it locked, or the base floating?"
            )


def _part(body: Body, q: Array) -> Array:
    return q[..., body.q_index : body.q_index + body.joint.nq]


def _columns(body: Body) -> slice:
    return slice(body.v_index, body.v_index + body.joint.nv)
