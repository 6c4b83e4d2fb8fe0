"""Actuation as an edit of the model: rotors become bodies, elastic gears become springs and one more coordinate.

A rotor is a body on a joint that shares the coordinate of the driven joint, at ``ratio`` times its rate. Every
recursion therefore includes reflected inertia and gyroscopic terms without special code. MR section 8.9.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields, replace

import numpy as np

from ...core.errors import InertiaError, ModelError, UnknownNameError, ValueRangeError
from ...core.numbers import printed
from ...core.typing import Array
from ..bodies.inertia import SpatialInertia
from ..joints import Joint, RotorJoint
from ..lie import se3
from .actuators import MAX_DRIVE_NUMBER, Actuator, Rotor, check_actuator
from .limits import LAWS, Limits
from .model import BASE, Body, Model, Spring


def with_actuators(model: Model, actuators: Iterable[Actuator]) -> Model:
    """Model with joints driven by these actuators. They replace a joint's motors without a rotor, as in robot files.

    Raises :class:`~twistwrench.UnknownNameError` for unknown joints and links, :class:`~twistwrench.ModelError` if a
    joint cannot be driven this way or has an actuator, and :class:`~twistwrench.InertiaError` if a link cannot contain
    its rotor.
    """
    new_actuators = list(actuators)
    new_joints = {actuator.joint for actuator in new_actuators}
    remaining_actuators = {
        name: actuator
        for name, actuator in model.actuators.items()
        if actuator.rotor is not None or actuator.joint not in new_joints
    }
    model = replace(model, actuators=remaining_actuators)
    for actuator in new_actuators:
        model = _with_actuator(model, actuator)
    return model


def with_friction(model: Model, laws: Mapping[str, Mapping[str, float]]) -> Model:
    """Model with the friction of some joints replaced: ``{joint: {"coulomb": 2.0, …}}``; omitted parameters are 0."""
    friction = model.friction
    for joint, law in laws.items():
        friction = friction.replaced(model.drive_index(joint), **_full_law(joint, law))
    return replace(model, friction=friction)


def with_link_friction(model: Model, laws: Mapping[str, Mapping[str, float]]) -> Model:
    """Model with additional friction behind the gears; for elastic joints it acts on the joint's own coordinate.

    A rigid gear turns with its joint, so the friction is added to the friction of the gear. Raises ModelError if the sum of
    two laws is not a law, for example with two Stribeck speeds.
    """
    friction = model.friction
    for joint, law in laws.items():
        k = model.drive_index(joint)
        link_law = _full_law(joint, law)
        gear_law = {name: float(getattr(friction, name)[k]) for name in LAWS}
        # A Stribeck speed has an effect only in a law with static friction above Coulomb friction.
        stribeck_speeds = [part["stribeck"] for part in (gear_law, link_law) if part["static"] > part["coulomb"]]
        if len(set(stribeck_speeds)) > 1:
            raise ModelError(
                f"the friction and the link_friction of joint {joint!r}, on one coordinate as its gear is rigid, have two "
                "Stribeck speeds. Give both the same one, or one of them no static friction."
            )
        sums = {name: gear_law[name] + link_law[name] for name in LAWS if name != "stribeck"}
        load_friction = sums["load"]
        if load_friction >= 1:
            raise ValueRangeError(
                f"load friction of joint {joint!r} adds up to {printed(load_friction)}; it must be below 1."
            )
        stribeck = stribeck_speeds[0] if stribeck_speeds else gear_law["stribeck"]
        friction = friction.replaced(k, **sums, stribeck=stribeck)
    return replace(model, friction=friction)


def _full_law(joint: str, law: Mapping[str, float]) -> dict[str, float]:
    """All parameters of a friction law, validated; omitted ones have their defaults."""
    for name in law:
        if name not in LAWS:
            raise UnknownNameError.from_choices("friction law", name, LAWS)
    coulomb = law.get("coulomb", 0.0)
    if law.get("static", coulomb) > coulomb and "stribeck" not in law:
        raise ValueRangeError(
            f"the static friction of joint {joint!r} is above its Coulomb friction, so there is a speed at which the one "
            "goes over into the other: give stribeck, such as 0.05 rad/s."
        )
    no_effect = 1.0  # any Stribeck speed, as static equals Coulomb friction
    full_law = {"viscous": 0.0, "coulomb": coulomb, "static": coulomb, "stribeck": no_effect, "load": 0.0, **law}
    for name, value in full_law.items():
        if not 0 <= value <= MAX_DRIVE_NUMBER:
            raise ValueRangeError(
                f"{name} friction of joint {joint!r} is {printed(value)}; it must be at least 0 and at most "
                f"{printed(MAX_DRIVE_NUMBER)}."
            )
    is_law = full_law["static"] >= coulomb and full_law["stribeck"] > 0 and full_law["load"] < 1
    if not is_law:
        raise ValueRangeError(
            f"the friction of joint {joint!r} cannot be meant: static {printed(full_law['static'])} must be at least coulomb "
            f"{printed(coulomb)}, the Stribeck speed {printed(full_law['stribeck'])} above 0, and load "
            f"{printed(full_law['load'])} below 1."
        )
    return full_law


def _with_actuator(model: Model, actuator: Actuator) -> Model:
    """Model with one more actuator: its rotor becomes a body, and its elastic gear a spring."""
    k = model.drive_index(actuator.joint)
    driven_body = next(body for body in model.leaders if body.v_index == k)
    driven_joints = {other.joint for other in model.actuators.values()}
    if actuator.joint in model.actuators or actuator.joint in driven_joints:  # as a motor's name, or as its joint
        raise ModelError(f"joint {actuator.joint!r} has an actuator already. Describe it once.")
    check_actuator(actuator)
    is_coupled_motor = actuator.joint in model.drive_names and actuator.joint != driven_body.joint.name
    if is_coupled_motor:
        return _with_coupled_motor(model, actuator, k)
    is_elastic = np.isfinite(actuator.stiffness)
    name = f"{actuator.joint}.motor" if is_elastic else actuator.joint
    armature = model.armature[k]
    if actuator.rotor is not None and armature:
        raise ModelError(
            f"joint {actuator.joint!r} has an armature of {printed(armature)}, and its actuator a "
            f"rotor: the inertia of the drive would count twice. Keep one: robot.with_armature({{{actuator.joint!r}: 0}}), "
            "or leave out the rotor."
        )
    if actuator.rotor is None:
        if is_elastic:
            raise ModelError(
                f"the actuator of joint {actuator.joint!r} is elastic, so its rotor moves by itself and needs an inertia."
            )
        return replace(model, actuators={**model.actuators, name: actuator})
    model, rotor_body = _with_rotor_mounted(model, driven_body, actuator, actuator.rotor)
    if is_elastic:
        motor_joint = replace(rotor_body.joint, name=name)
        rotor_body = replace(rotor_body, joint=motor_joint)
        model, rotor_body = _with_motor_coordinate(model, driven_body, actuator, rotor_body)
    return replace(model, bodies=(*model.bodies, rotor_body), actuators={**model.actuators, name: actuator})


_NOTE_ON_COUPLES = (
    "rotors of coupled motors count by their inertia about their axes; their gyroscopic couples are left out"
)
"""Note on a model with such a rotor."""


def _with_coupled_motor(model: Model, actuator: Actuator, k: int) -> Model:
    """Model with the actuator of coupled motor ``k``; its rotor becomes an armature, since it turns with several joints."""
    armature = model.armature.copy()
    rotor = actuator.rotor
    motor_text = f"motor {actuator.joint!r}, which moves several joints,"
    if np.isfinite(actuator.stiffness):
        raise ModelError(f"{motor_text} is elastic, and couplings are rigid. Leave out its stiffness.")
    if rotor is not None:
        if rotor.extra or rotor.link is not None or rotor.axis is not None or rotor.place.any():
            raise ModelError(
                f"{motor_text} has a rotor with a place, axis, link or mass. It counts by its inertia about its axis alone: "
                "leave out the rest."
            )
        reflected_inertia = actuator.ratio**2 * rotor.inertia
        if armature[k] not in (0.0, reflected_inertia):
            raise ModelError(
                f"{motor_text} has a rotor and an armature: its inertia would count twice. Keep one of them."
            )
        armature[k] = reflected_inertia
        if _NOTE_ON_COUPLES not in model.defects:
            model = replace(model, defects=(*model.defects, _NOTE_ON_COUPLES))
    return replace(model, armature=armature, actuators={**model.actuators, actuator.joint: actuator})


def _with_rotor_mounted(model: Model, driven: Body, actuator: Actuator, rotor: Rotor) -> tuple[Model, Body]:
    """Model in which the carrying link does not include the rotor's inertia any more; and the rotor as a body."""
    carrier, reference, axis = _rotor_mount(model, driven, rotor)
    placement = reference @ se3.pose(np.eye(3), np.asarray(rotor.place, float))
    # A thin ring: moment J about the axis, J/2 about transverse axes. The link loses these moments and carries the ring as a
    # rotor, so the transverse moments have no effect.
    axial = rotor.inertia * np.outer(axis, axis)
    transverse = 0.5 * (rotor.inertia * np.eye(3) - axial)
    G = SpatialInertia.from_com(rotor.mass, np.zeros(3), axial + transverse)
    if carrier != BASE and not rotor.extra:
        link = model.bodies[carrier]
        axis_in_link = placement[:3, :3] @ axis
        _check_contained(model, carrier, axis_in_link, actuator.joint, rotor.inertia)
        link_alone = replace(link, inertia=link.inertia - G.in_frame(placement))
        bodies = (*model.bodies[:carrier], link_alone, *model.bodies[carrier + 1 :])
        model = replace(model, bodies=bodies)
    screw_axis = np.concatenate([axis, np.zeros(3)])
    rotor_joint = RotorJoint(f"{actuator.joint}.rotor", screw_axis[None, :])
    rotor_body = Body(
        rotor_joint, rotor_joint.name, carrier, placement, G,
        driven.q_index, driven.v_index, ratio=actuator.ratio, follows=True,
    )  # fmt: skip
    return model, rotor_body


def _check_contained(model: Model, carrier: int, axis: Array, joint: str, J: float) -> None:
    """Raise an error if a link has less inertia than its rotors about their axes: M would not be positive definite.

    ``axis`` (3,) in the link's frame and J [kg m²] are of the new rotor. The inertias of earlier rotors, which were subtracted
    from the link, are added back. Moments of rotors about other axes are unknown and have no effect.
    """
    body = model.bodies[carrier]
    whole_inertia = body.inertia  # of the link with its rotors
    axial_moments = J * np.outer(axis, axis)  # of all rotors, as a tensor in the link's frame
    for rotor in model.bodies:
        if not rotor.joint.moves_body and rotor.parent == carrier and is_in_link_mass(model, rotor):
            whole_inertia = whole_inertia + rotor.inertia.in_frame(rotor.placement)
            rotor_axis = rotor.joint.axes[0, :3]
            axis_in_link = rotor.placement[:3, :3] @ rotor_axis
            rotor_moment = rotor_axis @ rotor.inertia.moment_about_origin @ rotor_axis
            axial_moments = axial_moments + rotor_moment * np.outer(axis_in_link, axis_in_link)
    I = whole_inertia.moment_about_com
    least_remaining_moment = np.linalg.eigvalsh(I - axial_moments).min()
    if least_remaining_moment < -_MAX_ROUNDING * np.abs(I).max():
        raise InertiaError(
            f"link {body.link!r} cannot contain the rotor of joint {joint!r}, {printed(J)} kg m² about its axis: all of "
            f"the link has {printed(axis @ I @ axis, 3)} kg m² about that direction. Check the unit; if the link was weighed "
            "without its motor, write extra: true."
        )


_MAX_ROUNDING = 1e-9
"""Rounding error of moments, relative to the largest."""


def is_in_link_mass(model: Model, rotor: Body) -> bool:
    """True if the mass of the carrying link in the file includes the rotor."""
    name = rotor.joint.name
    actuator = model.actuators.get(name)
    if actuator is None:
        actuator = model.actuators[name.removesuffix(".rotor")]
    return actuator.rotor is not None and not actuator.rotor.extra


def _rotor_mount(model: Model, driven: Body, rotor: Rotor) -> tuple[int, Array, Array]:
    """Index of the body that carries the rotor, reference frame (4, 4) of its position, and its axis (3,) in that frame."""
    if rotor.link is None:
        return driven.parent, driven.placement, _axis(driven.joint, rotor)
    frame = model.frame(rotor.link)
    if rotor.axis is None and frame.body != driven.parent:
        raise ModelError(
            f"the rotor of joint {driven.joint.name!r} is on link {rotor.link!r}, which does not carry the "
            "joint, so the joint's axis does not determine the rotor's. Give its axis in that link's frame."
        )
    axis = _axis(driven.joint, rotor)
    if rotor.axis is None:  # axis of the joint, in the link's frame
        R = frame.pose[:3, :3].T @ driven.placement[:3, :3]
        axis = R @ axis
    return frame.body, frame.pose, axis


def _axis(joint: Joint, rotor: Rotor) -> Array:
    """Unit vector along the rotor's own axis; if it has none, along the joint's axis."""
    omega, v = joint.axes[0, :3], joint.axes[0, 3:]
    joint_axis = omega if omega.any() else v
    axis = np.asarray(joint_axis if rotor.axis is None else rotor.axis, float)
    length = 0.0  # not a direction
    if axis.shape == (3,):
        length = float(np.linalg.norm(axis))
    if not 0 < length < np.inf:
        raise ModelError(
            f"the axis of the rotor of joint {joint.name!r} is {axis.tolist()}; give a direction such as 0, 0, 1."
        )
    return axis / length


def _with_motor_coordinate(model: Model, driven: Body, actuator: Actuator, rotor: Body) -> tuple[Model, Body]:
    """Model with one more coordinate at the end, the motor's angle referred to the joint, and with the gear's spring.

    The second result is the rotor, which moves by the new coordinate. The motor takes over the limits of speed and effort, and
    the friction of motor and gear. Only the spring drives the joint.
    """
    k = driven.v_index
    inf = np.inf
    old_limits = model.limits
    effort_without_joint = np.where(np.arange(model.nv) == k, inf, old_limits.effort)
    # The motor has no limits except those that it takes over.
    arrays = {field.name: np.append(getattr(old_limits, field.name), inf) for field in fields(Limits)}
    arrays |= {
        "lower": np.append(old_limits.lower, -inf),
        "velocity": np.append(old_limits.velocity, old_limits.velocity[k]),
        "effort": np.append(effort_without_joint, old_limits.effort[k]),
    }
    limits = Limits(**arrays)
    stretch = ((actuator.joint, 1.0), (rotor.joint.name, -1.0))  # joint minus motor
    spring = Spring(stretch, actuator.stiffness)
    rotor = replace(rotor, q_index=model.nq, v_index=model.nv, follows=False)
    friction = model.friction.extended().moved(k, model.nv)
    configurations = {name: np.append(q, q[driven.q_index]) for name, q in model.configurations.items()}
    extended_model = replace(
        model, limits=limits, friction=friction, springs=(*model.springs, spring),
        armature=np.append(model.armature, 0.0), configurations=configurations,
    )  # fmt: skip
    return extended_model, rotor
