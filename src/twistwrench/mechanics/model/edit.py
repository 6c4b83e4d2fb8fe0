"""Edits of a model: payload, gravity, locked joints. Each edit returns a new model; the original is unchanged."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from ...core.errors import InertiaError, ShapeError, UnknownNameError, ValueRangeError
from ...core.glossary import complete
from ...core.gravity import gravity_vector
from ...core.text import argument
from ...core.typing import Array
from ..bodies.inertia import SpatialInertia
from ..joints import Joint
from .assembly import default_tip, fuse
from .couplings import refuse_coupled
from .inertia_checks import moved_moments, reasons
from .model import BASE, Model


def with_payload(model: Model, inertia: SpatialInertia, frame: str | None = None) -> Model:
    """Model with a body fixed to a frame.

    Parameters
    ----------
    inertia : SpatialInertia, about the frame's origin, in the frame's axes

    Raises
    ------
    InertiaError
        The inertia is physically impossible, or the inertia of the carrying body becomes impossible.

    Examples
    --------
    >>> import twistwrench as tw
    >>> with_payload(tw.robots.planar_2r().model, SpatialInertia.from_com(1.0)).payloads[0][0]
    'tip'
    """
    carrier = model.frame(frame)
    name = frame if frame is not None else model.tip
    defects = inertia.defects()
    if defects:
        raise InertiaError(f"a payload at {name!r} cannot exist: {'; '.join(defects)}. Correct its numbers.")
    inertia_in_body = inertia.in_frame(carrier.pose)
    link_inertias = model.link_inertias
    if name in link_inertias:
        link_inertias = {**link_inertias, name: link_inertias[name] + inertia}
    model = replace(model, link_inertias=link_inertias, payloads=(*model.payloads, (str(name), inertia)))
    if carrier.body == BASE:
        return replace(model, base_inertia=model.base_inertia + inertia_in_body)
    body = model.bodies[carrier.body]
    loaded_body = replace(body, inertia=body.inertia + inertia_in_body)
    payload_moments = abs(float(inertia_in_body.moment_about_origin.trace()))
    size_of_moments = moved_moments(model, carrier.body) + payload_moments  # their rounding errors are tolerated
    if not reasons(body.inertia, size_of_moments):  # an inconsistent body that was accepted at loading stays accepted
        defects = loaded_body.inertia.defects(size=size_of_moments)
        if defects:
            raise InertiaError(
                f"with a payload at {name!r}, the body of joint {body.joint.name!r} cannot exist: {'; '.join(defects)}."
            )
    bodies = (*model.bodies[: carrier.body], loaded_body, *model.bodies[carrier.body + 1 :])
    return replace(model, bodies=bodies)


def with_gravity(model: Model, g: ArrayLike) -> Model:
    """Model with another gravity.

    Examples
    --------
    >>> import twistwrench as tw
    >>> with_gravity(tw.robots.planar_2r().model, [0, 0, 0]).gravity.tolist()
    [0.0, 0.0, 0.0]
    """
    return replace(model, gravity=gravity_vector(g))


def with_armature(model: Model, joints: Mapping[str, ArrayLike]) -> Model:
    """Model with other armature (reflected inertia of the drives) at some joints.

    Parameters
    ----------
    joints : {joint: armature} [kg m², sliding joints: kg]; a number, or one for each velocity of the joint

    Examples
    --------
    >>> import twistwrench as tw
    >>> with_armature(tw.robots.planar_2r().model, {"joint2": 0.5}).armature.tolist()
    [0.0, 0.5]
    """
    joints_with_rotor = {actuator.joint for actuator in model.actuators.values() if actuator.rotor is not None}
    armature = model.armature.copy()
    for name, value in joints.items():
        columns = _armature_columns(model, name)
        try:
            values = np.broadcast_to(np.asarray(value, float), armature[columns].shape)
        except (TypeError, ValueError):
            raise ShapeError(
                f"the armature of joint {name!r} is {value!r}, expected a number, or {len(armature[columns])} of them."
            ) from None
        is_valid = np.isfinite(values) & (values >= 0)
        if not is_valid.all():
            raise ValueRangeError(
                f"the armature of joint {name!r} is {np.asarray(value).tolist()}; it must be finite and not negative."
            )
        if values.any() and name in joints_with_rotor:
            raise ValueRangeError(
                f"joint {name!r} has an actuator with a rotor: with an armature too, the inertia of the drive would count "
                "twice. Leave one of them out."
            )
        armature[columns] = values
    return replace(model, armature=armature)


def _armature_columns(model: Model, name: str) -> slice:
    """Columns of a joint, or of a coupled motor, in the armature (nv,)."""
    coupled_joints = {joint for coupling in model.couplings for joint in coupling.joints}
    if name in model.coupled_motors or name in coupled_joints:
        k = model.drive_index(name)
        return slice(k, k + 1)
    leaders = model.leaders_by_name
    if name not in leaders:
        raise UnknownNameError.from_choices("joint", name, (*leaders, *model.coupled_motors))
    _, columns = leaders[name].places
    return columns


def lock(model: Model, positions: Mapping[str, ArrayLike]) -> Model:
    """Model with some joints fixed at given positions.

    Parameters
    ----------
    positions : {joint: position}, a number each, (x, y, theta) for planar, 7 for floating [rad, m]

    Notes
    -----
    The bodies of locked joints become part of their parents, and joints that mimic locked joints are fixed too. Rotations
    are snapped as in loading.

    Examples
    --------
    >>> import twistwrench as tw
    >>> lock(tw.robots.planar_3r().model, {"joint2": 0.5}).joint_names
    ('joint1', 'joint3')
    """
    leaders = {body.joint.name: body for body in model.bodies if not body.follows}
    followers = {body.joint.name: body for body in model.bodies if body.follows}
    poses: dict[int, Array] = {}  # of fixed bodies in their joints' frames, by index of the body
    coordinates: dict[str, float] = {}  # first coordinate of each locked joint
    followers_of: dict[str, tuple[str, ...]] = {}  # names of mimic joints, by locked joint
    for name, value in positions.items():
        if name in followers:
            v_index = followers[name].v_index
            leader = next(body.joint.name for body in leaders.values() if body.v_index == v_index)
            raise ValueRangeError(
                f"joint {name!r} mimics {leader!r} and moves with it. "
                f"Lock {leader!r}, or load with {argument('mimic', 'independent')}."
            )
        if name not in leaders:
            raise UnknownNameError.from_choices("moving joint", name, leaders)
        q = _coordinates(leaders[name].joint, value)
        coordinates[name] = float(q[0])
        followers_of[name] = ()
        for i, body in enumerate(model.bodies):
            if body.v_index != leaders[name].v_index:
                continue
            poses[i] = body.joint.pose(body.ratio * q + body.offset)
            if body.follows:
                followers_of[name] = (*followers_of[name], body.joint.name)
    locked_joints = set(coordinates)
    # A coupling goes if all of its joints are locked.
    couplings = tuple(coupling for coupling in model.couplings if not set(coupling.joints) <= locked_joints)
    partly_locked_model = replace(model, couplings=couplings)
    refuse_coupled(partly_locked_model, locked_joints, "cannot be locked alone. Lock all of them, or none")
    undriven_names = set(locked_joints)  # joints and motors that lose their actuators
    for coupling in model.couplings:
        if coupling not in couplings:
            undriven_names.update(coupling.motors)
    springs = [spring.with_fixed(coordinates) for spring in model.springs]
    fixed_bodies = [model.bodies[i] for i in poses]
    fixes_base = any(body.parent == BASE and not body.joint.driven for body in fixed_bodies)
    fused = replace(
        fuse(model, poses),
        springs=tuple(spring for spring in springs if spring.terms),
        actuators={name: actuator for name, actuator in model.actuators.items() if name not in undriven_names},
        couplings=couplings,
        mounted=model.mounted or fixes_base,
        locked=_in_file_order(model, {**model.locked, **followers_of}),
    )
    if fused.tip is None:
        return replace(fused, tip=default_tip(fused))
    return fused


def _in_file_order(model: Model, locked: dict[str, tuple[str, ...]]) -> dict[str, tuple[str, ...]]:
    """Locked joints with their mimic joints, in the order of the file, so that the order of locking does not matter."""
    number_by_joint = {joint: number for number, (_, joint) in enumerate(model.mounts.values())}
    count = len(number_by_joint)
    joints = sorted(locked, key=lambda joint: number_by_joint.get(joint, count))  # others last
    return {joint: locked[joint] for joint in joints}


def _coordinates(joint: Joint, value: ArrayLike) -> Array:
    """Coordinates (nq,) of a joint's position; raises an error if they are not a configuration."""
    try:
        q = np.atleast_1d(np.array(value, float))
    except (TypeError, ValueError):
        raise ShapeError(f"the position of joint {joint.name!r} is {value!r}, expected a number.") from None
    if q.shape != (joint.nq,):
        names = ", ".join(joint.name + suffix for suffix in joint.coordinate_suffixes)
        raise ShapeError(
            f"the position of {joint.kind} joint {joint.name!r} has shape {q.shape}, expected ({joint.nq},): {names}."
        )
    if not np.isfinite(q).all() or not joint.is_configuration(q):
        raise ValueRangeError(
            f"joint {joint.name!r} cannot be locked at {q.tolist()}: numbers must be finite, and a quaternion nonzero."
        )
    return q


complete(globals())
