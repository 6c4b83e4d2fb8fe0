"""States in the words of other libraries: the orders, signs and frames of Pinocchio and MuJoCo.

Joints are matched by name, so the other library must have read the same file. Theirs marked with a star, there is one
matrix P for each library with

    dq* = P dq        and so        τ = P' τ*,    M = P' M* P,    J = J* P.

Where a joint mimics another here and is independent there, P has a row for it all the same.

Pinocchio: children of one link in alphabetical order; floating joints ``(x, y, z, qx, qy, qz, qw)`` and body twists
``(v, omega)``; unbounded angles as (cos, sin). MuJoCo: children in document order; floating joints
``(x, y, z, qw, qx, qy, qz)``, their velocity the origin's along world axes, then omega in the body.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .core import arguments
from .errors import ModelError, UnknownNameError
from .lie import quaternion
from .model.model import BASE, Body
from .robot import Robot

Array = NDArray[Any]

__all__ = [
    "from_mujoco",
    "from_pinocchio",
    "mujoco_rates",
    "pinocchio_rates",
    "swap_halves",
    "to_mujoco",
    "to_pinocchio",
]

_LINEAR_FIRST = np.roll(np.eye(6), 3, axis=0)


def swap_halves(rows: ArrayLike) -> Array:
    """Twists, wrenches or Jacobians (6, ...) from linear part first to angular part first, or back."""
    return np.roll(arguments.plain(rows, "swap_halves: rows"), 3, axis=0)


# ── Pinocchio ──


def to_pinocchio(robot: Robot, model: Any, q: ArrayLike, *rates: ArrayLike) -> tuple[Array, ...]:
    """q and any number of dq, ddq as Pinocchio's ``model`` takes them; (..., nq), (..., nv) each."""
    q = arguments.real(q, "to_pinocchio: q", robot.nq, names=robot.coordinate_names).astype(float)
    theirs = np.zeros((*q.shape[:-1], model.nq))
    for body, joint in _pinocchio_joints(robot, model):
        mine = body.ratio * _part(body, q) + body.offset if body.follows else _part(body, q)
        if body.joint.kind == "floating":
            mine = np.concatenate([mine[..., 4:], np.roll(_unit(mine[..., :4]), -1, axis=-1)], axis=-1)
        elif joint.nq > joint.nv:  # planar and unbounded: the angle comes last, as its cosine and sine
            mine = np.concatenate([mine[..., :-1], np.cos(mine[..., -1:]), np.sin(mine[..., -1:])], axis=-1)
        theirs[..., joint.idx_q : joint.idx_q + joint.nq] = mine
    P = pinocchio_rates(robot, model)
    names = robot.model.velocity_names
    return theirs, *(
        arguments.real(x, "to_pinocchio: a rate", robot.nv, names=names).astype(float) @ P.T for x in rates
    )


def from_pinocchio(robot: Robot, model: Any, q: ArrayLike, *rates: ArrayLike) -> tuple[Array, ...]:
    """The way back. Angles kept there as (cos, sin) come out within ±π; mimic joints are taken to follow."""
    q = arguments.real(q, "from_pinocchio: q", model.nq).astype(float)
    ours = np.zeros((*q.shape[:-1], robot.nq))
    for body, joint in _pinocchio_joints(robot, model):
        if body.follows:
            continue
        theirs = q[..., joint.idx_q : joint.idx_q + joint.nq]
        if body.joint.kind == "floating":
            theirs = np.concatenate([np.roll(theirs[..., 3:], 1, axis=-1), theirs[..., :3]], axis=-1)
        elif joint.nq > joint.nv:
            angle = np.arctan2(theirs[..., -1:], theirs[..., -2:-1])
            theirs = np.concatenate([theirs[..., :-2], angle], axis=-1)
        ours[..., body.q_index : body.q_index + body.joint.nq] = theirs
    P = np.linalg.pinv(pinocchio_rates(robot, model))
    return ours, *(arguments.real(rate, "from_pinocchio: a rate", model.nv).astype(float) @ P.T for rate in rates)


def pinocchio_rates(robot: Robot, model: Any) -> Array:
    """P with dq* = P dq; (nv*, nv). It is constant: both take the twist of a joint in the moving frame."""
    P = np.zeros((model.nv, robot.nv))
    for body, joint in _pinocchio_joints(robot, model):
        turn = {"floating": _LINEAR_FIRST, "planar": np.roll(np.eye(3), 2, axis=0)}.get(
            body.joint.kind, np.eye(joint.nv)
        )
        P[joint.idx_v : joint.idx_v + joint.nv, _columns(body)] = body.ratio * turn
    return P


def _pinocchio_joints(robot: Robot, model: Any) -> Iterator[tuple[Body, Any]]:
    """Each body with Pinocchio's joint of the same name."""
    names = list(model.names)[1:]
    _check_names(robot, names, "Pinocchio")
    for body in robot.model.bodies:
        joint = model.joints[model.getJointId(body.joint.name)]
        if joint.nv != body.joint.nv:
            raise ModelError(
                f"joint {body.joint.name!r} is {body.joint.kind} here and {joint.shortname()} in Pinocchio."
            )
        if body.joint.kind == "planar" and body.joint.axes[0, 2] != 1.0:
            raise ModelError(
                f"planar joint {body.joint.name!r} is not normal to z, and Pinocchio's planar joints all are."
            )
        yield body, joint


# ── MuJoCo ──


def to_mujoco(
    robot: Robot, model: Any, q: ArrayLike, dq: ArrayLike | None = None, ddq: ArrayLike | None = None
) -> tuple[Array, ...]:
    """q, and dq and ddq where given, as MuJoCo's ``model`` takes them; one state."""
    q = arguments.one(q, "to_mujoco: q", robot.nq, names=robot.coordinate_names)
    theirs = np.zeros(model.nq)
    for body, joint in _mujoco_joints(robot, model):
        mine = body.ratio * _part(body, q) + body.offset if body.follows else _part(body, q)
        if body.joint.kind == "floating":
            mine = np.concatenate([mine[4:], _unit(mine[:4])])
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
    """The way back; mimic joints are taken to follow. One state."""
    theirs = arguments.one(q, "from_mujoco: q", model.nq)
    ours = np.zeros(robot.nq)
    for body, joint in _mujoco_joints(robot, model):
        if not body.follows:
            part = theirs[int(joint.qposadr[0]) :][: body.joint.nq]
            part = np.concatenate([part[3:], part[:3]]) if body.joint.kind == "floating" else part
            ours[body.q_index : body.q_index + body.joint.nq] = part
    P = np.linalg.pinv(mujoco_rates(robot, model, ours))
    found = [ours]
    if dq is not None:
        found.append(P @ arguments.one(dq, "from_mujoco: dq", model.nv))
    if ddq is not None and dq is not None:
        found.append(P @ arguments.one(ddq, "from_mujoco: ddq", model.nv) - _turning(robot, found[1]))
    return tuple(found)


def mujoco_rates(robot: Robot, model: Any, q: ArrayLike) -> Array:
    """P with dq* = P dq at q; (nv*, nv). MuJoCo takes the linear velocity of floating joints along the world's axes."""
    q = arguments.one(q, "mujoco_rates: q", robot.nq, names=robot.coordinate_names)
    P = np.zeros((model.nv, robot.nv))
    for body, joint in _mujoco_joints(robot, model):
        turn = np.eye(body.joint.nv)
        if body.joint.kind == "floating":
            turn = np.zeros((6, 6))
            turn[:3, 3:], turn[3:, :3] = quaternion.rotation(_part(body, q)[:4]), np.eye(3)
        start = int(joint.dofadr[0])
        P[start : start + body.joint.nv, _columns(body)] = body.ratio * turn
    return P


def _turning(robot: Robot, dq: Array) -> Array:
    """What P ddq lacks of d(P dq)/dt, in our axes: omega × v of each floating joint."""
    extra = np.zeros(robot.nv)
    for body in robot.model.bodies:
        if body.joint.kind == "floating":
            V = dq[_columns(body)]
            extra[body.v_index + 3 : body.v_index + 6] = np.cross(V[:3], V[3:])
    return extra


def _mujoco_joints(robot: Robot, model: Any) -> Iterator[tuple[Body, Any]]:
    """Each body with MuJoCo's joint of the same name."""
    _check_names(robot, [model.joint(i).name for i in range(model.njnt)], "MuJoCo")
    for body in robot.model.bodies:
        if body.joint.kind == "floating" and (body.parent != BASE or not np.array_equal(body.placement, np.eye(4))):
            raise ModelError(
                f"joint {body.joint.name!r} floats away from the world's origin; MuJoCo has no joint for that."
            )
        yield body, model.joint(body.joint.name)


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


def _unit(quat: Array) -> Array:
    return np.asarray(quat / np.linalg.norm(quat, axis=-1, keepdims=True))
