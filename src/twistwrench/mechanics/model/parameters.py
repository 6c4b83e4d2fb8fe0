"""Parameters of a model: base-parameter regrouping, and parameters that vary from sample to sample.

Let G_s be a part of a body's inertia that does not change with the joint's motion along its screw axis A, and that has no
momentum in this motion (G_s A = 0). Such a part acts as if it were fixed to the parent. For a revolute joint about w through
the origin, G_s comprises the mass, the first moment along w, and a rotational inertia J (1 - w w'). For a prismatic joint, it
is the whole rotational inertia. The remaining inertia has zeros instead, which cost nothing in traced programs.

Source: Gautier and Khalil, "Direct calculation of minimum set of inertial parameters of serial robots", IEEE T-RA 6(3),
1990. The regrouped model has the same torques and mass matrix, but other energies, momenta and joint wrenches.
"""

from __future__ import annotations

import fnmatch
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...core.errors import InertiaError, UnknownNameError, ValueRangeError
from ...core.numbers import printed
from ...core.typing import Array
from ..bodies.inertia import SpatialInertia
from ..bodies.solids import ten_parameters
from ..joints import Joint
from ..lie import so3
from .actuators import Rotor
from .inertia_checks import moved_moments, reasons
from .limits import LAWS, Friction
from .model import BASE, Model, Spring


def regrouped(model: Model) -> Model:
    """Model with the same joint-space dynamics and as many zero inertial parameters as regrouping can achieve."""
    inertias = [body.inertia for body in model.bodies]
    for i in reversed(range(len(model.bodies))):
        body = model.bodies[i]
        fixed_part = _part_without_effect(body.joint, inertias[i])
        if fixed_part is None:
            continue
        inertias[i] = _clear_rounding(inertias[i] - fixed_part, inertias[i])
        if body.parent != BASE:
            inertias[body.parent] = inertias[body.parent] + fixed_part.in_frame(body.placement)
    bodies = tuple(replace(body, inertia=G) for body, G in zip(model.bodies, inertias, strict=True))
    return replace(model, bodies=bodies)


def _part_without_effect(joint: Joint, G: SpatialInertia) -> SpatialInertia | None:
    """Part of a body's inertia that acts as if it were fixed to the parent; None if no such part is known."""
    if joint.nv != 1:
        return None
    w, v = joint.axes[0, :3], joint.axes[0, 3:]  # of the screw axis
    I = G.moment_about_origin
    if not w.any():  # prismatic
        return SpatialInertia.from_parameters(ten_parameters(0, (0, 0, 0), I))
    if v.any():  # the axis misses the origin, or the joint is helical
        return None
    w = w / np.linalg.norm(w)
    largest_component = int(np.argmax(np.abs(w)))
    coordinate_axis = np.eye(3)[(largest_component + 1) % 3]  # not parallel to w
    normal = coordinate_axis - (coordinate_axis @ w) * w
    J = (normal @ I @ normal) / (normal @ normal)  # moment about an axis at a right angle to w
    h = (G.first_moment @ w) * w
    J_without_axis = J * (np.eye(3) - np.outer(w, w))
    return SpatialInertia.from_parameters(ten_parameters(G.mass, h, J_without_axis))


_MAX_ROUNDING = 4e-16
"""Rounding error of a difference, as a share of its first operand: about two units in the last place."""


def _clear_rounding(G: SpatialInertia, before: SpatialInertia) -> SpatialInertia:
    """Inertia G, a difference from ``before``, with parameters that are rounding errors set to zero."""
    parameters = G.parameters.copy()
    mass = abs(before.mass)
    first_moment = np.abs(before.first_moment).max()
    moment = np.abs(before.parameters[4:]).max()  # after the mass and three first moments
    scales = np.repeat([mass, first_moment, moment], [1, 3, 6])  # for each of the ten parameters
    is_rounding_error = np.abs(parameters) <= _MAX_ROUNDING * scales
    parameters[is_rounding_error] = 0.0
    return SpatialInertia.from_parameters(parameters)


# ── Parameters that may vary by sample: masses, centres of mass, moments, lengths, friction, drives and springs

# A name is ``<link>.mass``, ``<link>.com_x`` …, ``<link>.Ixx`` … (about the link's centre of mass, in its axes),
# ``<joint>.x`` … (position in the parent body), ``<joint>.viscous`` and the other friction parameters,
# ``<joint>.armature``, ``<joint>.rotor_inertia`` (about the rotor's axis, before the gear), or ``<joint>.stiffness`` of
# the spring at the joint or in its gear. Coupled motors have names of their own. The link may be massless: ``tool0.mass``
# is a payload. If only ``<joint>.coulomb`` is given and static friction equals Coulomb friction, both change.

_LINK_PARAMETERS = ("mass", "com_x", "com_y", "com_z", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
"""Parameters of a link, in the order of :func:`ten_parameters`."""
_JOINT_PARAMETERS = ("x", "y", "z")
_DRIVE_PARAMETERS = ("armature", "rotor_inertia", "stiffness")


def nominal(model: Model) -> dict[str, float]:
    """All parameters by name, with the model's values."""
    values: dict[str, float] = {}
    for link, frame in model.frames.items():
        if frame.body != BASE:
            values |= _link_values(model, link)
    for body in model.bodies:
        position = body.placement[:3, 3]
        for parameter, coordinate in zip(_JOINT_PARAMETERS, position, strict=True):
            values[f"{body.joint.name}.{parameter}"] = float(coordinate)
        if not body.follows and body.joint.nv == 1:
            drive = model.drive_names[body.v_index]
            for law in LAWS:
                values[f"{drive}.{law}"] = float(getattr(model.friction, law)[body.v_index])
    for drive, k in _armatures(model).items():
        values[f"{drive}.armature"] = float(model.armature[k])
    for drive, (rotor, _, _) in _rotors(model).items():
        values[f"{drive}.rotor_inertia"] = rotor.inertia
    for joint, k in _springs(model).items():
        values[f"{joint}.stiffness"] = model.springs[k].stiffness
    return values


def _armatures(model: Model) -> dict[str, int]:
    """Index in ``model.armature`` of each drive of one degree of freedom. Drives with a rotor have no armature."""
    joints_with_rotor = {actuator.joint for actuator in model.actuators.values() if actuator.rotor is not None}
    indices: dict[str, int] = {}
    for body in model.leaders:
        drive = model.drive_names[body.v_index]
        if body.joint.nv == 1 and drive.removesuffix(".motor") not in joints_with_rotor:
            indices[drive] = body.v_index
    return indices


def _rotors(model: Model) -> dict[str, tuple[Rotor, float, int | None]]:
    """Rotor, gear ratio and index of the rotor's body, by driven joint or motor.

    The index is None for rotors of coupled motors, which have no body.
    """
    rotor_bodies = {body.joint.name: i for i, body in enumerate(model.bodies) if not body.joint.moves_body}  # indices
    rotors: dict[str, tuple[Rotor, float, int | None]] = {}
    for name, actuator in model.actuators.items():
        if actuator.rotor is not None:
            body_index = rotor_bodies.get(f"{actuator.joint}.rotor")
            if body_index is None:
                body_index = rotor_bodies.get(name)
            rotors[actuator.joint] = actuator.rotor, actuator.ratio, body_index
    return rotors


def _springs(model: Model) -> dict[str, int]:
    """Index in the model of the first spring at each joint, or between the joint and its motor; by joint."""
    indices: dict[str, int] = {}
    for k, spring in enumerate(model.springs):
        joint, *other_joints = spring.joints
        is_in_gear = other_joints == [f"{joint}.motor"]
        if not other_joints or is_in_gear:
            indices.setdefault(joint, k)
    return indices


def moves_joints(model: Model, names: Sequence[str]) -> bool:
    """True if ``names`` contains positions of joints.

    If not, regrouping keeps quantities linear that are linear in the parameters.
    """
    lengths = {f"{body.joint.name}.{parameter}" for body in model.bodies for parameter in _JOINT_PARAMETERS}
    return not lengths.isdisjoint(names)


def _link_values(model: Model, link: str) -> dict[str, float]:
    """Mass, centre of mass, and moments about the centre of mass of a link, by name; zeros for a massless link."""
    G = model.link_inertias.get(link, SpatialInertia.zero())
    values = ten_parameters(G.mass, G.com, G.moment_about_com)
    return {f"{link}.{parameter}": float(x) for parameter, x in zip(_LINK_PARAMETERS, values, strict=True)}


def matching(model: Model, patterns: Sequence[str]) -> tuple[str, ...]:
    """Names that match patterns such as ``*.mass``, each once, in the order of the patterns.

    Raises :class:`~twistwrench.UnknownNameError` for a pattern without a match.
    """
    all_names = nominal(model)
    names: dict[str, None] = {}  # an ordered set
    for pattern in patterns:
        matches = fnmatch.filter(all_names, pattern)
        if not matches:
            raise UnknownNameError.from_choices("parameter", pattern, all_names)
        names.update(dict.fromkeys(matches))
    return tuple(names)


def with_symbolic_parameters(model: Model, names: Sequence[str], values: Sequence[Any]) -> Model:
    """Model with the values, numbers or symbols, in place of its own parameters of these names."""
    new_values = dict(zip(names, values, strict=True))
    bodies = [_moved_body(body, new_values) for body in model.bodies]
    changed_links: set[str] = set()
    for name in names:
        owner, _, parameter = name.rpartition(".")
        if parameter in _LINK_PARAMETERS:
            changed_links.add(owner)
    for link, frame in model.frames.items():
        if link not in changed_links:
            continue
        values_by_name = _link_values(model, link)
        link_values = [new_values.get(name, nominal_value) for name, nominal_value in values_by_name.items()]
        body = bodies[frame.body]
        old_inertia = model.link_inertias.get(link, SpatialInertia.zero())
        without_link = body.inertia - old_inertia.in_frame(frame.pose)
        new_inertia = _inertia(link_values)
        bodies[frame.body] = replace(body, inertia=without_link + new_inertia.in_frame(frame.pose))
    armature = _change_drive_inertias(model, bodies, new_values)
    friction = _friction_with_parameters(model, new_values)
    springs = _springs_with_parameters(model, new_values)
    return replace(model, bodies=tuple(bodies), friction=friction, armature=armature, springs=springs)


def _change_drive_inertias(model: Model, bodies: list[Any], new_values: dict[str, Any]) -> Array:
    """Armature (nv,) with new values; also changes the rotors in the list ``bodies``, and the links that hold them."""
    armature_values: dict[int, Any] = {}
    for drive, k in _armatures(model).items():
        name = f"{drive}.armature"
        if name in new_values:
            armature_values[k] = new_values[name]
    for drive, (rotor, ratio, body_index) in _rotors(model).items():
        name = f"{drive}.rotor_inertia"
        if name not in new_values:
            continue
        if body_index is None:  # a coupled motor
            armature_values[model.drive_index(drive)] = ratio**2 * new_values[name]
            continue
        body = bodies[body_index]
        rotor_axis = body.joint.axes[0, :3]
        change = _ring_inertia(rotor_axis, new_values[name] - rotor.inertia)
        bodies[body_index] = replace(body, inertia=body.inertia + change)
        if body.parent != BASE and not rotor.extra:  # the rotor is a part of the link, whose rest decreases by as much
            carrier = bodies[body.parent]
            bodies[body.parent] = replace(carrier, inertia=carrier.inertia - change.in_frame(body.placement))
    if not armature_values:
        return model.armature
    armature = model.armature.astype(object)
    for k, value in armature_values.items():
        armature[k] = value
    return armature


def _ring_inertia(axis: Array, J: Any) -> SpatialInertia:
    """Inertia ½ J (1 + axis axis') of a thin ring without mass: J about the unit vector ``axis``, J/2 about its diameters."""
    moments = J * (0.5 * (np.eye(3) + np.outer(axis, axis)))
    parameters = ten_parameters(0.0, np.zeros(3), moments)
    return SpatialInertia.from_parameters(np.array(parameters, object))


def _springs_with_parameters(model: Model, new_values: dict[str, Any]) -> tuple[Spring, ...]:
    """Springs of the model, with new stiffnesses where these are given."""
    springs = list(model.springs)
    for joint, k in _springs(model).items():
        name = f"{joint}.stiffness"
        if name in new_values:
            springs[k] = replace(springs[k], stiffness=new_values[name])
    return tuple(springs)


def _moved_body(body: Any, new_values: dict[str, Any]) -> Any:
    """Body with the new position of its joint; the body itself if no position is given."""
    names = [f"{body.joint.name}.{parameter}" for parameter in _JOINT_PARAMETERS]
    if new_values.keys().isdisjoint(names):
        return body
    placement = body.placement.astype(object)
    for k, name in enumerate(names):
        placement[k, 3] = new_values.get(name, placement[k, 3])
    return replace(body, placement=placement)


def _inertia(numbers: Sequence[Any]) -> SpatialInertia:
    """Inertia from mass, centre of mass, and moments about the centre of mass."""
    m, x, y, z, xx, xy, yy, xz, yz, zz = numbers
    c = np.array([x, y, z], object)
    I_com = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], object)
    I_origin = I_com - m * (so3.hat(c) @ so3.hat(c))  # parallel-axis theorem
    parameters = ten_parameters(m, m * c, I_origin)
    return SpatialInertia.from_parameters(np.array(parameters, object))


def _friction_with_parameters(model: Model, new_values: dict[str, Any]) -> Friction:
    """Friction of the model, with new values of the friction laws where these are given."""
    values_by_law = {law: getattr(model.friction, law).astype(object) for law in LAWS}
    is_changed = False
    for i, drive in enumerate(model.drive_names):
        for law in LAWS:
            name = f"{drive}.{law}"
            if name in new_values:
                values_by_law[law][i] = new_values[name]
                is_changed = True
        coulomb_name, static_name = f"{drive}.coulomb", f"{drive}.static"
        only_coulomb_is_new = coulomb_name in new_values and static_name not in new_values
        if only_coulomb_is_new and model.friction.static[i] == model.friction.coulomb[i]:
            values_by_law["static"][i] = new_values[coulomb_name]
    if not is_changed:
        return model.friction
    return Friction(**values_by_law)


# ── Validation of parameters given by sample, with the criteria of loading

_TENSOR = ("Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
"""Parameters of a link's inertia tensor."""
_MOMENT_TOLERANCE = 1e-6
"""Tolerance of the triangle inequality as a share of the sum of the principal moments, as for a single body."""


def refuse_impossible(model: Model, parameters: Mapping[str, Array]) -> None:
    """Raise InertiaError or ValueRangeError for values that no body, friction or drive can have; NaN passes.

    ``parameters`` are numbers of any shape by the names of :func:`~twistwrench.mechanics.model.parameters.nominal`. The inertia
    tensor of a link is checked as a part of its body, unless the body was already inconsistent when loaded. The message names
    the link or joint and the sample.
    """
    tensor_links = set[str]()
    for name, values in parameters.items():
        owner, _, parameter = name.rpartition(".")
        if parameter == "mass" and (values < 0).any():
            raise InertiaError(
                f"parameters: {_value_text(name, values, values < 0, ' kg')}: link {owner!r} cannot have a negative mass. "
                "Give 0 or more."
            )
        if parameter in _DRIVE_PARAMETERS and (values < 0).any():
            noun = parameter.replace("_", " ")
            raise ValueRangeError(
                f"parameters: {_value_text(name, values, values < 0)}, and {noun} is at least 0. Give 0 or more."
            )
        if parameter in LAWS:
            _refuse_friction(name, parameter, values)
        if parameter in _TENSOR:
            tensor_links.add(owner)
    for link in sorted(tensor_links):
        if link in model.frames and model.frames[link].body != BASE:
            _refuse_tensor(model, link, parameters)


def _refuse_friction(name: str, law: str, values: Array) -> None:
    """Raise ValueRangeError if values of a friction parameter, by name such as ``j1.load``, are out of its range."""
    if law == "stribeck":
        is_impossible = values <= 0
        bounds = "above 0"
    elif law == "load":
        is_impossible = (values < 0) | (values >= 1)
        bounds = "at least 0 and below 1"
    else:  # viscous, coulomb, static
        is_impossible = values < 0
        bounds = "at least 0"
    if is_impossible.any():
        raise ValueRangeError(
            f"parameters: {_value_text(name, values, is_impossible)}, and friction of a joint is {bounds} there."
        )


def _refuse_tensor(model: Model, link: str, parameters: Mapping[str, Array]) -> None:
    """Raise InertiaError for the first sample with a tensor of the link that makes the link's body impossible.

    A tensor that is impossible for the link alone may be possible for the body, which can have other links.
    """
    body_index = model.frames[link].body
    moments = moved_moments(model, body_index)
    is_inconsistent_when_loaded = bool(reasons(model.bodies[body_index].inertia, moments))
    if is_inconsistent_when_loaded:
        return
    is_suspect = _impossible_samples(model, link, parameters)
    if not is_suspect.any():
        return
    parameters_of_body: dict[str, Array] = {}
    for name, samples in parameters.items():
        owner, _, _ = name.rpartition(".")
        if owner in model.frames and model.frames[owner].body == body_index:
            parameters_of_body[name] = samples
    shape = np.broadcast_shapes(*(samples.shape for samples in parameters_of_body.values()))
    suspect_samples = np.argwhere(np.broadcast_to(is_suspect, shape))
    for sample in map(tuple, suspect_samples):
        values = []
        for samples in parameters_of_body.values():
            value = np.broadcast_to(samples, shape)[sample]
            values.append(float(value))
        with np.errstate(all="ignore"):  # of NaN and infinite values, which pass below
            changed_model = with_symbolic_parameters(model, list(parameters_of_body), values)
        inertial_parameters = changed_model.bodies[body_index].inertia.parameters.astype(float)
        if not np.isfinite(inertial_parameters).all():
            continue
        violations = reasons(SpatialInertia.from_parameters(inertial_parameters), moments)
        if violations:
            sample_phrase = f" in sample {_sample_text(sample)}" if sample else ""
            raise InertiaError(
                f"parameters: link {link!r}{sample_phrase} cannot exist: {'; '.join(violations)}. "
                "Give moments of a body that can: tw.SpatialInertia(…).nearest_consistent() finds them."
            )


def _impossible_samples(model: Model, link: str, parameters: Mapping[str, Array]) -> Array:
    """Mask (...) of the samples whose principal moments about the link's centre of mass violate the triangle inequality."""
    nominal_values = nominal(model)
    names = [f"{link}.{entry}" for entry in _TENSOR]
    entries = [np.asarray(parameters.get(name, nominal_values[name]), float) for name in names]
    xx, xy, yy, xz, yz, zz = np.broadcast_arrays(*entries)
    I = np.stack([xx, xy, xz, xy, yy, yz, xz, yz, zz], axis=-1).reshape(*xx.shape, 3, 3)
    is_finite = np.isfinite(I).all(axis=(-2, -1))
    finite_I = np.where(is_finite[..., None, None], I, np.eye(3))  # NaN passes, as a ball does
    A, B, C = np.moveaxis(np.linalg.eigvalsh(finite_I), -1, 0)  # principal moments, ascending
    tolerance = _MOMENT_TOLERANCE * np.abs(A + B + C)
    is_negative = -tolerance > A
    violates_triangle = A + B + tolerance < C
    return np.asarray(is_negative | violates_triangle)


def _value_text(name: str, values: Array, mask: Array, unit: str = "") -> str:
    """Parameter with the first value for which the mask is true, and the number of its sample."""
    first_sample = np.argwhere(mask)[0]
    sample = tuple(first_sample)
    sample_phrase = f" in sample {_sample_text(sample)}" if sample else ""
    value = float(values[sample])
    return f"{name!r} is {printed(value)}{unit}{sample_phrase}"


def _sample_text(sample: tuple[int, ...]) -> str:
    """Index of a sample: a number for one axis of samples, otherwise a tuple."""
    if len(sample) == 1:
        return str(int(sample[0]))
    return str(tuple(map(int, sample)))
