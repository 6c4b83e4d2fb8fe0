"""Parameters of a model: base-parameter regrouping, and parameters that vary from sample to sample.

A part G_s of a body's inertia that is invariant under the joint's motion and has no momentum in it (G_s A = 0) acts as
if it were fixed to the parent. For a revolute joint about w through the origin, G_s comprises the mass, the first
moment along w, and a rotational inertia J (1 - w w'); for a prismatic joint, the whole rotational inertia. The
remaining inertia has zeros in their places, which cost nothing in traced programs.

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
    """Part of a body's inertia without effect on its joint (base-parameter regrouping); None if none is known."""
    if joint.nv != 1:
        return None
    w, v = joint.axes[0, :3], joint.axes[0, 3:]
    I = G.moment_about_origin
    if not w.any():
        return SpatialInertia.from_parameters(ten_parameters(0, (0, 0, 0), I))
    if v.any():  # the axis misses the origin, or the joint is helical
        return None
    w = w / np.linalg.norm(w)
    across = np.eye(3)[(int(np.argmax(np.abs(w))) + 1) % 3]
    across = across - (across @ w) * w
    J = (across @ I @ across) / (across @ across) * (np.eye(3) - np.outer(w, w))
    h = (G.first_moment @ w) * w
    return SpatialInertia.from_parameters(ten_parameters(G.mass, h, J))


def _clear_rounding(G: SpatialInertia, before: SpatialInertia) -> SpatialInertia:
    """Parameters with differences due to rounding errors set to zero."""
    p = G.parameters.copy()
    scale = np.repeat(
        [abs(before.mass), np.abs(before.first_moment).max(), np.abs(before.parameters[4:]).max()], [1, 3, 6]
    )
    p[np.abs(p) <= 4e-16 * scale] = 0.0
    return SpatialInertia.from_parameters(p)


# ── Parameters that may vary by sample: masses, centres of mass, moments, lengths, friction, drives and springs

# A name is ``<link>.mass``, ``<link>.com_x`` …, ``<link>.Ixx`` … (about the link's centre of mass, in its axes),
# ``<joint>.x`` … (position in the parent body), ``<joint>.viscous`` and the other friction parameters,
# ``<joint>.armature``, ``<joint>.rotor_inertia`` (about the rotor's axis, before the gear), or ``<joint>.stiffness`` of
# the spring at the joint or in its gear. Coupled motors have names of their own. The link may be massless: ``tool0.mass``
# is a payload. Static friction equal to Coulomb friction follows if only ``<joint>.coulomb`` is given.

_LINK_PARAMETERS = ("mass", "com_x", "com_y", "com_z", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
_JOINT_PARAMETERS = ("x", "y", "z")
_DRIVE_PARAMETERS = ("armature", "rotor_inertia", "stiffness")


def nominal(model: Model) -> dict[str, float]:
    """All parameters by name, with the model's values."""
    values: dict[str, float] = {}
    for link, frame in model.frames.items():
        if frame.body != BASE:
            values |= _link_values(model, link)
    for body in model.bodies:
        for parameter, x in zip(_JOINT_PARAMETERS, body.placement[:3, 3], strict=True):
            values[f"{body.joint.name}.{parameter}"] = float(x)
        if not body.follows and body.joint.nv == 1:
            for law in LAWS:
                values[f"{model.drive_names[body.v_index]}.{law}"] = float(getattr(model.friction, law)[body.v_index])
    for drive, k in _armatures(model).items():
        values[f"{drive}.armature"] = float(model.armature[k])
    for drive, (rotor, _, _) in _rotors(model).items():
        values[f"{drive}.rotor_inertia"] = rotor.inertia
    for joint, k in _springs(model).items():
        values[f"{joint}.stiffness"] = model.springs[k].stiffness
    return values


def _armatures(model: Model) -> dict[str, int]:
    """Index in the armature of each drive of one degree of freedom without a rotor, whose inertia would count twice."""
    rotors = {a.joint for a in model.actuators.values() if a.rotor is not None}
    indices: dict[str, int] = {}
    for body in model.leaders:
        drive = model.drive_names[body.v_index]
        if body.joint.nv == 1 and drive.removesuffix(".motor") not in rotors:
            indices[drive] = body.v_index
    return indices


def _rotors(model: Model) -> dict[str, tuple[Rotor, float, int | None]]:
    """Rotor, gear ratio and body by driven joint or motor; rotors of coupled motors have no body."""
    bodies = {body.joint.name: i for i, body in enumerate(model.bodies) if not body.joint.moves_body}
    rotors: dict[str, tuple[Rotor, float, int | None]] = {}
    for name, actuator in model.actuators.items():
        if actuator.rotor is not None:
            body = bodies.get(f"{actuator.joint}.rotor", bodies.get(name))
            rotors[actuator.joint] = actuator.rotor, actuator.ratio, body
    return rotors


def _springs(model: Model) -> dict[str, int]:
    """Index of the spring at each joint, or between it and its motor; of several, the first."""
    indices: dict[str, int] = {}
    for k, spring in enumerate(model.springs):
        first, *others = spring.joints
        if others in ([], [f"{first}.motor"]):
            indices.setdefault(first, k)
    return indices


def moves_joints(model: Model, names: Sequence[str]) -> bool:
    """True if lengths are among them. Without lengths, a quantity linear in the parameters stays so after regrouping."""
    lengths = {f"{body.joint.name}.{parameter}" for body in model.bodies for parameter in _JOINT_PARAMETERS}
    return not lengths.isdisjoint(names)


def _link_values(model: Model, link: str) -> dict[str, float]:
    """Mass, centre of mass, and moments about the centre of mass of a link, by name."""
    G = model.link_inertias.get(link, SpatialInertia.zero())
    numbers = ten_parameters(G.mass, G.com, G.moment_about_com)
    return {f"{link}.{parameter}": float(x) for parameter, x in zip(_LINK_PARAMETERS, numbers, strict=True)}


def matching(model: Model, patterns: Sequence[str]) -> tuple[str, ...]:
    """Names that match patterns such as ``*.mass``, each once, in the order of the patterns.

    Raises :class:`~twistwrench.UnknownNameError` for a pattern without a match.
    """
    known = nominal(model)
    names: dict[str, None] = {}
    for pattern in patterns:
        matches = fnmatch.filter(known, pattern)
        if not matches:
            raise UnknownNameError.from_choices("parameter", pattern, known)
        names.update(dict.fromkeys(matches))
    return tuple(names)


def with_symbolic_parameters(model: Model, names: Sequence[str], values: Sequence[Any]) -> Model:
    """Model with these numbers or symbols in place of its own parameters."""
    new = dict(zip(names, values, strict=True))
    bodies = [_moved_body(body, new) for body in model.bodies]
    owners: set[str] = set()
    for name in names:
        owner, _, parameter = name.rpartition(".")
        if parameter in _LINK_PARAMETERS:
            owners.add(owner)
    for link, frame in model.frames.items():
        if link not in owners:
            continue
        numbers = [new.get(name, x) for name, x in _link_values(model, link).items()]
        body = bodies[frame.body]
        without_link = body.inertia - model.link_inertias.get(link, SpatialInertia.zero()).in_frame(frame.pose)
        bodies[frame.body] = replace(body, inertia=without_link + _inertia(numbers).in_frame(frame.pose))
    armature = _armature_with_parameters(model, bodies, new)
    friction, springs = _friction_with_parameters(model, new), _springs_with_parameters(model, new)
    return replace(model, bodies=tuple(bodies), friction=friction, armature=armature, springs=springs)


def _armature_with_parameters(model: Model, bodies: list[Any], new: dict[str, Any]) -> Array:
    """Armature with the numbers of drives; those of rotors change the ``bodies`` of rotors and of links that hold them."""
    values: dict[int, Any] = {}
    for drive, k in _armatures(model).items():
        name = f"{drive}.armature"
        if name in new:
            values[k] = new[name]
    for drive, (rotor, ratio, i) in _rotors(model).items():
        name = f"{drive}.rotor_inertia"
        if name not in new:
            continue
        if i is None:  # a coupled motor
            values[model.drive_index(drive)] = ratio**2 * new[name]
            continue
        body = bodies[i]
        change = _ring_inertia(body.joint.axes[0, :3], new[name] - rotor.inertia)
        bodies[i] = replace(body, inertia=body.inertia + change)
        if body.parent != BASE and not rotor.extra:
            carrier = bodies[body.parent]
            bodies[body.parent] = replace(carrier, inertia=carrier.inertia - change.in_frame(body.placement))
    if not values:
        return model.armature
    armature = model.armature.astype(object)
    for k, x in values.items():
        armature[k] = x
    return armature


def _ring_inertia(axis: Array, J: Any) -> SpatialInertia:
    """Inertia of a thin ring of moment J about an axis, without mass."""
    spin = np.outer(axis, axis)
    return SpatialInertia.from_parameters(
        np.array(ten_parameters(0.0, np.zeros(3), J * (0.5 * (np.eye(3) + spin))), object)
    )


def _springs_with_parameters(model: Model, new: dict[str, Any]) -> tuple[Spring, ...]:
    springs = list(model.springs)
    for joint, k in _springs(model).items():
        name = f"{joint}.stiffness"
        if name in new:
            springs[k] = replace(springs[k], stiffness=new[name])
    return tuple(springs)


def _moved_body(body: Any, new: dict[str, Any]) -> Any:
    names = [f"{body.joint.name}.{parameter}" for parameter in _JOINT_PARAMETERS]
    if new.keys().isdisjoint(names):
        return body
    placement = body.placement.astype(object)
    for k, name in enumerate(names):
        placement[k, 3] = new.get(name, placement[k, 3])
    return replace(body, placement=placement)


def _inertia(numbers: Sequence[Any]) -> SpatialInertia:
    """Inertia from mass, centre of mass, and moments about the centre of mass."""
    m, c, I = numbers[0], np.array(numbers[1:4], object), numbers[4:]
    about_com = np.array([[I[0], I[1], I[3]], [I[1], I[2], I[4]], [I[3], I[4], I[5]]], object)
    J = about_com - m * (so3.hat(c) @ so3.hat(c))  # parallel-axis theorem
    return SpatialInertia.from_parameters(np.array(ten_parameters(m, m * c, J), object))


def _friction_with_parameters(model: Model, new: dict[str, Any]) -> Friction:
    columns = {law: getattr(model.friction, law).astype(object) for law in LAWS}
    changed = False
    for i, drive in enumerate(model.drive_names):
        for law in LAWS:
            name = f"{drive}.{law}"
            if name in new:
                columns[law][i] = new[name]
                changed = True
        coulomb, static = f"{drive}.coulomb", f"{drive}.static"
        if coulomb in new and static not in new and model.friction.static[i] == model.friction.coulomb[i]:
            columns["static"][i] = new[coulomb]
    if not changed:
        return model.friction
    return Friction(**columns)


# ── Validation of parameters given by sample, with the criteria of loading

_TENSOR = ("Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
_MOMENT_TOLERANCE = 1e-6
"""Tolerance relative to the sum of the principal moments, as for a single body."""


def refuse_impossible(model: Model, parameters: Mapping[str, Array]) -> None:
    """Raise an error for negative masses or friction, and for physically impossible moments of inertia; NaN passes.

    ``parameters``: numbers of any shape by the names of :func:`~twistwrench.mechanics.model.parameters.nominal`. An inertia
    tensor is checked together with its fixed links, unless its body was already inconsistent when loaded. Raises
    InertiaError and ValueRangeError, naming the link or joint and the sample.
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
    impossible, bounds = values < 0, "at least 0"
    if law == "stribeck":
        impossible, bounds = values <= 0, "above 0"
    if law == "load":
        impossible, bounds = impossible | (values >= 1), "at least 0 and below 1"
    if impossible.any():
        raise ValueRangeError(
            f"parameters: {_value_text(name, values, impossible)}, and friction of a joint is {bounds} there."
        )


def _refuse_tensor(model: Model, link: str, parameters: Mapping[str, Array]) -> None:
    body = model.frames[link].body
    if reasons(model.bodies[body].inertia, moved_moments(model, body)):
        return
    impossible = _impossible_samples(model, link, parameters)
    if not impossible.any():
        return
    parameters_of_body: dict[str, Array] = {}
    for name, samples in parameters.items():
        owner = name.rpartition(".")[0]
        if owner in model.frames and model.frames[owner].body == body:
            parameters_of_body[name] = samples
    shape = np.broadcast_shapes(*(samples.shape for samples in parameters_of_body.values()))
    for sample in map(tuple, np.argwhere(np.broadcast_to(impossible, shape))):
        values = [float(np.broadcast_to(samples, shape)[sample]) for samples in parameters_of_body.values()]
        with np.errstate(all="ignore"):
            changed = with_symbolic_parameters(model, list(parameters_of_body), values)
        numbers = changed.bodies[body].inertia.parameters.astype(float)
        if not np.isfinite(numbers).all():
            continue
        violations = reasons(SpatialInertia.from_parameters(numbers), moved_moments(model, body))
        if violations:
            where = f" in sample {_sample_text(sample)}" if sample else ""
            raise InertiaError(
                f"parameters: link {link!r}{where} cannot exist: {'; '.join(violations)}. Give moments of a body that can: "
                "tw.SpatialInertia(…).nearest_consistent() finds them."
            )


def _impossible_samples(model: Model, link: str, parameters: Mapping[str, Array]) -> Array:
    """True for samples whose principal moments about the link's centre of mass violate the triangle inequality; (...,)."""
    default = nominal(model)
    names = [f"{link}.{entry}" for entry in _TENSOR]
    moments = [np.asarray(parameters.get(name, default[name]), float) for name in names]
    xx, xy, yy, xz, yz, zz = np.broadcast_arrays(*moments)
    I = np.stack([xx, xy, xz, xy, yy, yz, xz, yz, zz], axis=-1).reshape(*xx.shape, 3, 3)
    known = np.isfinite(I).all(axis=(-2, -1))
    A, B, C = np.moveaxis(np.linalg.eigvalsh(np.where(known[..., None, None], I, np.eye(3))), -1, 0)
    slack = _MOMENT_TOLERANCE * np.abs(A + B + C)
    return np.asarray((-slack > A) | (A + B + slack < C))


def _value_text(name: str, values: Array, mask: Array, unit: str = "") -> str:
    """First value in a mask, with its sample."""
    sample = tuple(np.argwhere(mask)[0])
    where = f" in sample {_sample_text(sample)}" if sample else ""
    return f"{name!r} is {printed(float(values[sample]))}{unit}{where}"


def _sample_text(sample: tuple[int, ...]) -> str:
    if len(sample) == 1:
        return str(int(sample[0]))
    return str(tuple(map(int, sample)))
