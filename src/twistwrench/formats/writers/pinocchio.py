"""Pinocchio model from a model, joint by joint."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...bodies.inertia import SpatialInertia
from ...errors import MissingExtraError
from ...joints import Joint
from ...model.model import BASE, Body, Model
from ...model.parts import disassemble
from ...typing import Array
from .written import Losses, configurations_of, drive_of, moved, screw_of

_WHOLE = {"floating": "JointModelFreeFlyer", "ball": "JointModelSpherical", "planar": "JointModelPlanar"}


def pinocchio_of(model: Model) -> tuple[Any, tuple[str, ...]]:
    """A ``pinocchio.Model`` and its losses. Mimic joints become independent joints there.

    Raises :class:`~twistwrench.MissingExtraError`, and :class:`~twistwrench.ModelError` for a joint that Pinocchio lacks.
    """
    try:
        import pinocchio
    except ImportError:
        raise MissingExtraError.from_extra("pin", "peers", "A model of Pinocchio's") from None
    found, losses = disassemble(model), Losses()
    theirs = pinocchio.Model()
    theirs.name = model.name
    theirs.gravity.linear = np.array(model.gravity)
    turned = {joint.name: joint for joint in found.joints}
    at: dict[int, tuple[int, Array]] = {BASE: (0, np.eye(4))}
    """Number of each body's joint there, and the pose of its frame in that joint's."""
    numbers: dict[str, int] = {}
    for i, body in enumerate(model.bodies):
        if not body.joint.moves_body:
            continue
        entry = turned.get(body.joint.name)
        made, point = _joint(
            pinocchio, body.joint, None if entry is None else screw_of(entry) if body.joint.nv == 1 else None
        )
        parent, T_parent = at[body.parent]
        placement = T_parent @ body.placement @ moved(point)
        j = theirs.addJoint(parent, made, _se3(pinocchio, placement), body.joint.name)
        theirs.addJointFrame(j)
        numbers[body.joint.name] = j
        at[i] = j, moved(-point)
        G = found.whole[body.link].in_frame(at[i][1])
        theirs.appendBodyToJoint(j, _inertia(pinocchio, G), pinocchio.SE3.Identity())
        if body.joint.nv > 1 and model.armature[body.places[1]].any():
            losses.of_joint(body.joint.name, "has an armature, whose products of velocities Pinocchio leaves out")
        if body.follows:
            losses.of_joint(body.joint.name, "follows another one here, and is a joint like any other there")
    for name, frame in model.frames.items():
        j, T = at[frame.body]
        theirs.addBodyFrame(name, j, _se3(pinocchio, T @ frame.pose), 0)
    for name, frame in model.sites.items():
        j, T = at[frame.body]
        kind = pinocchio.FrameType.OP_FRAME
        theirs.addFrame(pinocchio.Frame(name.removeprefix("site:"), j, 0, _se3(pinocchio, T @ frame.pose), kind))
    _add_numbers(theirs, model, numbers)
    for name in model.joint_names:
        if name in numbers:
            _add_losses(theirs, numbers[name], drive_of(found, name, losses))
    for name, positions in configurations_of(found).items():
        theirs.referenceConfigurations[name] = _configuration(theirs, model, numbers, positions)
    for what, several in (("spring", found.additions.springs), ("closure", found.additions.closures)):
        if several:
            losses.say(f"{len(several)} {what}{'s' * (len(several) > 1)} of the robot: Pinocchio's models have none")
    return theirs, tuple(losses.found)


def _joint(pinocchio: Any, joint: Joint, axis: Any) -> tuple[Any, Array]:
    """Pinocchio's joint, and the position of its axis in the frame of the model's joint."""
    joint.require_pinocchio()
    if joint.kind in _WHOLE:
        return getattr(pinocchio, _WHOLE[joint.kind])(), np.zeros(3)
    letter = next((x for x, e in zip("XYZ", np.eye(3), strict=True) if np.array_equal(e, axis.direction)), None)
    if axis.pitch:
        if letter is not None:
            return getattr(pinocchio, f"JointModelH{letter}")(axis.pitch), axis.point
        return pinocchio.JointModelHelicalUnaligned(axis.direction, axis.pitch), axis.point
    if not axis.turns:
        short, long = "P", "JointModelPrismaticUnaligned"
    elif joint.wraps:
        short, long = "RUB", "JointModelRevoluteUnaligned"  # the unbounded one takes no axis from Python
    else:
        short, long = "R", "JointModelRevoluteUnaligned"
    if letter is not None:
        return getattr(pinocchio, f"JointModel{short}{letter}")(), axis.point
    return getattr(pinocchio, long)(axis.direction), axis.point


def _se3(pinocchio: Any, T: Array) -> Any:
    return pinocchio.SE3(np.array(T[:3, :3]), np.array(T[:3, 3]))


def _inertia(pinocchio: Any, G: SpatialInertia) -> Any:
    return pinocchio.Inertia(float(G.mass), np.array(G.com), np.array(G.moment_about_com))


def _add_numbers(theirs: Any, model: Model, numbers: dict[str, int]) -> None:
    """Limits of position, velocity and effort; those of free bodies stay infinite."""
    limits = model.limits
    q = {"lowerPositionLimit": limits.lower, "upperPositionLimit": limits.upper}
    v = {"velocityLimit": limits.velocity, "effortLimit": limits.effort}
    arrays = {name: np.array(getattr(theirs, name), float) for name in (*q, *v)}
    for body in model.leaders:
        if body.joint.name not in numbers:
            continue
        joint = theirs.joints[numbers[body.joint.name]]
        for name, values in v.items():
            arrays[name][joint.idx_v : joint.idx_v + joint.nv] = values[body.places[1]][
                list(body.joint.pinocchio_order)
            ]
        if joint.nq == 1:
            for name, values in q.items():
                arrays[name][joint.idx_q] = values[body.v_index]
    for name, array in arrays.items():
        setattr(theirs, name, array)


def _add_losses(theirs: Any, j: int, drive: Any) -> None:
    at = slice(theirs.joints[j].idx_v, theirs.joints[j].idx_v + theirs.joints[j].nv)
    for name, value in (("damping", drive.damping), ("friction", drive.friction), ("armature", drive.armature)):
        array = np.array(getattr(theirs, name), float)
        array[at] = value
        setattr(theirs, name, array)


def _configuration(theirs: Any, model: Model, numbers: dict[str, int], positions: dict[str, Array]) -> Array:
    found = np.zeros(theirs.nq)
    leaders = {body.v_index: body for body in model.leaders}
    for body in model.bodies:
        if body.joint.name not in numbers:
            continue
        joint = theirs.joints[numbers[body.joint.name]]
        mine = (
            body.ratio * positions[_leader(leaders, body)] + body.offset if body.follows else positions[body.joint.name]
        )
        if body.joint.quaternion is not None:
            mine = body.joint.to_pinocchio(mine)
        elif joint.nq > joint.nv:
            mine = np.append(mine[:-1], [np.cos(mine[-1]), np.sin(mine[-1])])
        found[joint.idx_q : joint.idx_q + joint.nq] = mine
    return found


def _leader(leaders: dict[int, Body], body: Body) -> str:
    return leaders[body.v_index].joint.name
