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
        unfelt = _unfelt(body.joint, inertias[i])
        if unfelt is None:
            continue
        inertias[i] = _cleaned(inertias[i] - unfelt, inertias[i])
        if body.parent != BASE:
            inertias[body.parent] = inertias[body.parent] + unfelt.in_frame(body.placement)
    bodies = tuple(replace(body, inertia=G) for body, G in zip(model.bodies, inertias, strict=True))
    return replace(model, bodies=bodies)


def _unfelt(joint: Joint, G: SpatialInertia) -> SpatialInertia | None:
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


def _cleaned(G: SpatialInertia, before: SpatialInertia) -> SpatialInertia:
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

_OF_LINKS = ("mass", "com_x", "com_y", "com_z", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
_OF_JOINTS = ("x", "y", "z")
_OF_DRIVES = ("armature", "rotor_inertia", "stiffness")


def nominal(model: Model) -> dict[str, float]:
    """All parameters by name, with the model's values."""
    values: dict[str, float] = {}
    for link, frame in model.frames.items():
        if frame.body != BASE:
            values.update(zip((f"{link}.{what}" for what in _OF_LINKS), _of_link(model, link), strict=True))
    for body in model.bodies:
        for what, x in zip(_OF_JOINTS, body.placement[:3, 3], strict=True):
            values[f"{body.joint.name}.{what}"] = float(x)
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
    """Place in the armature of each drive of one degree of freedom without a rotor, whose inertia would count twice."""
    rotors = {a.joint for a in model.actuators.values() if a.rotor is not None}
    leaders = [body for body in model.leaders if body.joint.nv == 1]
    drives = {model.drive_names[body.v_index]: body.v_index for body in leaders}
    return {drive: k for drive, k in drives.items() if drive.removesuffix(".motor") not in rotors}


def _rotors(model: Model) -> dict[str, tuple[Rotor, float, int | None]]:
    """Rotor, gear ratio and body by driven joint or motor; rotors of coupled motors have no body."""
    bodies = {body.joint.name: i for i, body in enumerate(model.bodies) if not body.joint.moves_body}
    found: dict[str, tuple[Rotor, float, int | None]] = {}
    for name, actuator in model.actuators.items():
        if actuator.rotor is not None:
            body = bodies.get(f"{actuator.joint}.rotor", bodies.get(name))
            found[actuator.joint] = actuator.rotor, actuator.ratio, body
    return found


def _springs(model: Model) -> dict[str, int]:
    """Index of the spring at each joint, or between it and its motor; of several, the first."""
    found: dict[str, int] = {}
    for k, spring in enumerate(model.springs):
        joints = [joint for joint, _ in spring.terms]
        if len(joints) == 1 or joints[1:] == [f"{joints[0]}.motor"]:
            found.setdefault(joints[0], k)
    return found


def moves_joints(model: Model, names: Sequence[str]) -> bool:
    """True if lengths are among them. Without lengths, a quantity linear in the parameters stays so after regrouping."""
    places = {f"{body.joint.name}.{what}" for body in model.bodies for what in _OF_JOINTS}
    return any(name in places for name in names)


def _of_link(model: Model, link: str) -> list[float]:
    G = model.link_inertias.get(link, SpatialInertia.zero())
    I = G.moment_about_com
    return [float(x) for x in ten_parameters(G.mass, G.com, I)]


def matching(model: Model, patterns: Sequence[str]) -> tuple[str, ...]:
    """Names that match patterns such as ``*.mass``, each once, in the order of the patterns.

    Raises :class:`~twistwrench.UnknownNameError` for a pattern without a match.
    """
    known = nominal(model)
    found: dict[str, None] = {}
    for pattern in patterns:
        mine = fnmatch.filter(known, pattern)
        if not mine:
            raise UnknownNameError.from_choices("parameter", pattern, known)
        found.update(dict.fromkeys(mine))
    return tuple(found)


def with_symbolic_parameters(model: Model, names: Sequence[str], values: Sequence[Any]) -> Model:
    """Model with these numbers or symbols in place of its own parameters."""
    new = dict(zip(names, values, strict=True))
    bodies = [_body_moved(body, new) for body in model.bodies]
    for link, frame in model.frames.items():
        if any(f"{link}.{what}" in new for what in _OF_LINKS):
            old = model.link_inertias.get(link, SpatialInertia.zero())
            mine = [new.get(f"{link}.{what}", x) for what, x in zip(_OF_LINKS, _of_link(model, link), strict=True)]
            body = bodies[frame.body]
            rest = body.inertia - old.in_frame(frame.pose)
            bodies[frame.body] = replace(body, inertia=rest + _inertia(mine).in_frame(frame.pose))
    armature = _driven(model, bodies, new)
    return replace(
        model, bodies=tuple(bodies), friction=_friction(model, new), armature=armature, springs=_sprung(model, new)
    )


def _driven(model: Model, bodies: list[Any], new: dict[str, Any]) -> Array:
    """Armature with the numbers of drives; those of rotors change the ``bodies`` of rotors and of links that hold them."""
    armature = model.armature.astype(object)
    given = {k: new[f"{drive}.armature"] for drive, k in _armatures(model).items() if f"{drive}.armature" in new}
    for drive, (rotor, ratio, i) in _rotors(model).items():
        if (name := f"{drive}.rotor_inertia") not in new:
            continue
        if i is None:  # a coupled motor
            given[model.drive_index(drive)] = ratio**2 * new[name]
            continue
        body = bodies[i]
        change = _spinning(body.joint.axes[0, :3], new[name] - rotor.inertia)
        bodies[i] = replace(body, inertia=body.inertia + change)
        if body.parent != BASE and not rotor.extra:
            carrier = bodies[body.parent]
            bodies[body.parent] = replace(carrier, inertia=carrier.inertia - change.in_frame(body.placement))
    for k, x in given.items():
        armature[k] = x
    return armature if given else model.armature


def _spinning(axis: Array, J: Any) -> SpatialInertia:
    """Inertia of a thin ring of moment J about an axis, without mass."""
    spin = np.outer(axis, axis)
    return SpatialInertia.from_parameters(
        np.array(ten_parameters(0.0, np.zeros(3), J * (0.5 * (np.eye(3) + spin))), object)
    )


def _sprung(model: Model, new: dict[str, Any]) -> tuple[Spring, ...]:
    springs = list(model.springs)
    for joint, k in _springs(model).items():
        if (name := f"{joint}.stiffness") in new:
            springs[k] = replace(springs[k], stiffness=new[name])
    return tuple(springs)


def _body_moved(body: Any, new: dict[str, Any]) -> Any:
    mine = {
        k: new[f"{body.joint.name}.{what}"] for k, what in enumerate(_OF_JOINTS) if f"{body.joint.name}.{what}" in new
    }
    if not mine:
        return body
    placement = body.placement.astype(object)
    for k, x in mine.items():
        placement[k, 3] = x
    return replace(body, placement=placement)


def _inertia(numbers: Sequence[Any]) -> SpatialInertia:
    """Inertia from mass, centre of mass, and moments about the centre of mass."""
    m, c, I = numbers[0], np.array(numbers[1:4], object), numbers[4:]
    about_com = np.array([[I[0], I[1], I[3]], [I[1], I[2], I[4]], [I[3], I[4], I[5]]], object)
    J = about_com - m * (so3.hat(c) @ so3.hat(c))  # parallel-axis theorem
    return SpatialInertia.from_parameters(np.array(ten_parameters(m, m * c, J), object))


def _friction(model: Model, new: dict[str, Any]) -> Friction:
    columns = {law: getattr(model.friction, law).astype(object) for law in LAWS}
    changed = False
    for i, drive in enumerate(model.drive_names):
        for law in LAWS:
            if (name := f"{drive}.{law}") in new:
                columns[law][i], changed = new[name], True
        coulomb, static = (f"{drive}.{law}" for law in ("coulomb", "static"))
        if coulomb in new and static not in new and model.friction.static[i] == model.friction.coulomb[i]:
            columns["static"][i] = new[coulomb]
    return Friction(**columns) if changed else model.friction


# ── Validation of parameters given by sample, with the criteria of loading

_TENSOR = ("Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
_SLACK = 1e-6
"""Tolerance relative to the sum of the principal moments, as for a single body."""


def refuse_impossible(model: Model, given: Mapping[str, Array]) -> None:
    """Raise an error for negative masses or friction, and for physically impossible moments of inertia; NaN passes.

    ``given``: numbers of any shape by the names of :func:`~twistwrench.mechanics.model.parameters.nominal`. An inertia tensor
    is checked together with its fixed links, unless its body was already inconsistent when loaded. Raises InertiaError and
    ValueRangeError, naming the link or joint and the sample.
    """
    links = {link for link, frame in model.frames.items() if frame.body != BASE}
    for name, values in given.items():
        owner, _, what = name.rpartition(".")
        if what == "mass" and (values < 0).any():
            raise InertiaError(
                f"parameters: {_at(name, values, values < 0, ' kg')}: link {owner!r} cannot have a negative mass. "
                "Give 0 or more."
            )
        if what in _OF_DRIVES and (values < 0).any():
            raise ValueRangeError(
                f"parameters: {_at(name, values, values < 0)}, and {what.replace('_', ' ')} is at least 0. Give 0 or more."
            )
        if what in LAWS:
            bad, wanted = values < 0, "at least 0"
            if what == "stribeck":
                bad, wanted = values <= 0, "above 0"
            if what == "load":
                bad, wanted = bad | (values >= 1), "at least 0 and below 1"
            if bad.any():
                raise ValueRangeError(
                    f"parameters: {_at(name, values, bad)}, and friction of a joint is {wanted} there."
                )
    for link in sorted(links & {name.rpartition(".")[0] for name in given if name.rpartition(".")[2] in _TENSOR}):
        _refuse_tensor(model, link, given)


def _refuse_tensor(model: Model, link: str, given: Mapping[str, Array]) -> None:
    body, usual = model.frames[link].body, nominal(model)
    if reasons(model.bodies[body].inertia, moved_moments(model, body)):
        return
    xx, xy, yy, xz, yz, zz = np.broadcast_arrays(
        *(np.asarray(given.get(f"{link}.{what}", usual[f"{link}.{what}"]), float) for what in _TENSOR)
    )
    I = np.stack([xx, xy, xz, xy, yy, yz, xz, yz, zz], axis=-1).reshape(*xx.shape, 3, 3)
    known = np.isfinite(I).all(axis=(-2, -1))
    A, B, C = np.moveaxis(np.linalg.eigvalsh(np.where(known[..., None, None], I, np.eye(3))), -1, 0)
    slack = _SLACK * np.abs(A + B + C)
    bad = (-slack > A) | (A + B + slack < C)
    if not bad.any():
        return
    members = {f"{name}.": name for name, frame in model.frames.items() if frame.body == body}
    mine = {n: x for n, x in given.items() if n[: n.rfind(".") + 1] in members}
    whole = np.broadcast_shapes(*(x.shape for x in mine.values()))
    for sample in map(tuple, np.argwhere(np.broadcast_to(bad, whole))):
        values = [float(np.broadcast_to(x, whole)[sample]) for x in mine.values()]
        with np.errstate(all="ignore"):
            numbers = with_symbolic_parameters(model, list(mine), values).bodies[body].inertia.parameters.astype(float)
        G = SpatialInertia.from_parameters(numbers)
        if np.isfinite(numbers).all() and (found := reasons(G, moved_moments(model, body))):
            place = f" in sample {_index(sample)}" if sample else ""
            raise InertiaError(
                f"parameters: link {link!r}{place} cannot exist: {'; '.join(found)}. Give moments of a body that can: "
                "tw.SpatialInertia(…).nearest_consistent() finds them."
            )


def _at(name: str, values: Array, bad: Array, unit: str = "") -> str:
    sample = tuple(np.argwhere(bad)[0])
    place = f" in sample {_index(sample)}" if sample else ""
    return f"{name!r} is {printed(float(values[sample]))}{unit}{place}"


def _index(sample: tuple[int, ...]) -> str:
    return str(int(sample[0])) if len(sample) == 1 else str(tuple(map(int, sample)))
