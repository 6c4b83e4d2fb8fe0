"""Models as plain values for answers on record: every field, without those that are empty or at their defaults."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import fields

import numpy as np
from recorded_answers import Records, plain_values

from twistwrench.mechanics.model.limits import Friction, Limits
from twistwrench.mechanics.model.snapping import DEFAULT_SNAP

_ROUND_OFF = 1e-13
"""What rounding may leave of zero."""


class ShortRecords(Records):
    """Records with numbers of eight digits, so that files of many models stay short."""

    def of(self, call=None, *, relative=2e-7):
        """Add a call; the tolerance is two units of the last digit, where rounding may turn."""
        return super().of(call, relative=relative)

    def _result(self, name, folder):
        return _short(super()._result(name, folder))


def _short(value):
    if isinstance(value, float):
        number = float(f"{value:.8g}") if abs(value) > _ROUND_OFF else 0.0
        return int(number) if number.is_integer() and abs(number) < 1e9 else number
    if isinstance(value, list):
        return [_short(entry) for entry in value]
    if isinstance(value, dict):
        return {key: _short(entry) for key, entry in value.items()}
    return value


def described(model):
    """All fields of a model that are not empty. A link has an inertia, and a frame a pose, if they are not those of a body."""
    velocities = model.velocity_names
    bodies = {body.link: body for body in model.bodies}
    frames = {
        name: [frame.body, pose(frame.pose)]
        for name, frame in model.frames.items()
        if name not in bodies
        or bodies[name] is not model.bodies[frame.body]
        or not np.array_equal(frame.pose, np.eye(4))
    }
    links = {
        name: G.parameters
        for name, G in model.link_inertias.items()
        if G.parameters.any() and not (name in bodies and np.array_equal(G.parameters, bodies[name].inertia.parameters))
    }
    description = {
        "name": model.name,
        "tip": model.tip,
        "joints": " ".join(model.joint_names),
        "leaves": " ".join(model.leaves),
        "bodies": [described_body(body) for body in model.bodies],
        "frames": frames,
        "frame names": " ".join(model.frames),
        "sites": {name: [frame.body, pose(frame.pose)] for name, frame in model.sites.items()},
        "limits": by_velocity(model.limits, Limits, velocities),
        "friction": described_friction(model.friction, velocities),
        "gravity": model.gravity,
        "base": model.base_inertia.parameters,
        "links": links,
        "springs": [[dict(spring.terms), spring.stiffness, spring.rest] for spring in model.springs],
        "actuators": {name: described_actuator(actuator) for name, actuator in model.actuators.items()},
        "couplings": list(model.couplings),
        "configurations": dict(model.configurations),
        "closures": {name: [c.frame_a, c.frame_b, c.rows] for name, c in model.closures.items()},
        "shaped": sorted(model.shaped),
        "snap": 0.0 if model.snap == DEFAULT_SNAP else model.snap or "off",
        "armature": {name: value for name, value in zip(velocities, model.armature, strict=True) if value},
        "motor joints": sorted(model.motor_joints),
        "mounted": model.mounted,
        "mounts": {link: " ".join(mount) for link, mount in model.mounts.items()},
        "locked": dict(model.locked),
        "notes": list(map(str, model.defects)),
    }
    return without_empty(description)


def described_body(body):
    """Fields of one body."""
    description = {
        "joint": f"{body.joint.kind} {body.joint.name} {type(body.joint).__name__}",
        "axes": None if body.joint.kind in ("ball", "floating") else body.joint.axes,
        "link": body.link,
        "parent": body.parent,
        "placement": pose(body.placement),
        "inertia": body.inertia.parameters,
        "at": [body.q_index, body.v_index],
    }
    if body.follows:
        description |= {"law": [body.ratio, body.offset], "effort": body.effort}
    return without_empty(description)


def described_actuator(actuator):
    """Fields of an actuator, its motor and its rotor that are given."""
    description = without_empty({field.name: plain_values(getattr(actuator, field.name)) for field in fields(actuator)})
    return {key: _given(value) if isinstance(value, dict) else value for key, value in description.items()}


def _given(fields_of_part):
    return {
        key: value for key, value in without_empty(fields_of_part).items() if value not in ("inf", "Motor", "Rotor")
    }


def pose(T):
    """Position, and the rotation row by row unless it is the identity."""
    T = np.asarray(T)
    if np.allclose(T[:3, :3], np.eye(3), rtol=0, atol=1e-12):
        return T[:3, 3]
    return np.concatenate([T[:3, 3], T[:3, :3].ravel()])


def described_friction(friction, velocities):
    """Coefficients that are not at the values of viscous and Coulomb friction alone."""
    coefficients = by_velocity(friction, Friction, velocities)
    if np.array_equal(friction.static, friction.coulomb):
        coefficients.pop("static", None)
    if (np.asarray(friction.stribeck) == 1.0).all():
        coefficients.pop("stribeck", None)
    return coefficients


def by_velocity(values, kind, velocities):
    """Limits or friction by name of the velocity, without what is infinite, and friction without zeros."""
    tables = {}
    for field in fields(kind):
        array = np.asarray(getattr(values, field.name), float)
        is_limit = kind is Limits
        given = {
            name: x for name, x in zip(velocities, array.tolist(), strict=True) if np.isfinite(x) and (x or is_limit)
        }
        if given:
            tables[field.name] = given
    return tables


def without_empty(description):
    """Entries that are neither None nor False, nor zero, infinite or empty."""
    return {key: value for key, value in description.items() if not _is_empty(value)}


def _is_empty(value):
    if value is None or value is False:
        return True
    if isinstance(value, str | Mapping | list | tuple):
        return not len(value)
    if isinstance(value, int | float | np.ndarray):
        array = np.asarray(value, float)
        return not array.size or not (array.any() and np.isfinite(array).any())
    return False


_SHOWN_WHOLE = 10
"""Number of characters of a number up to which it stays as it is."""
_NUMBER = re.compile(r"-?\d+\.\d+(?:e[+-]?\d+)?|-?\d+e[+-]?\d+")


def rounded(text):
    """Text with its long numbers to nine digits, and zero for what rounding leaves of zero."""

    def shorter(match):
        number = float(match[0])
        if abs(number) < _ROUND_OFF:
            return "0"
        return f"{number:.9g}" if len(match[0]) > _SHOWN_WHOLE else match[0]

    return _NUMBER.sub(shorter, text)
