"""Models as plain values for answers on record: every field, without those that are empty or at their defaults."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import fields

import numpy as np
from recorded_answers import Records, plain_values

from twistwrench.mechanics.model.limits import Friction, Limits

_ROUND_OFF = 1e-13
"""What rounding may leave of zero."""


class ShortRecords(Records):
    """Records with numbers of eight digits, a tenth of the tolerance: files of many models stay short."""

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
    """All fields of a model that are not empty."""
    description = {
        "name": model.name,
        "tip": model.tip,
        "joints": " ".join(model.joint_names),
        "leaves": " ".join(model.leaves),
        "bodies": [described_body(body) for body in model.bodies],
        "frames": {name: [frame.body, pose(frame.pose)] for name, frame in model.frames.items()},
        "sites": {name: [frame.body, pose(frame.pose)] for name, frame in model.sites.items()},
        "limits": finite_fields(model.limits, Limits),
        "friction": described_friction(model.friction),
        "gravity": model.gravity,
        "base": model.base_inertia.parameters,
        "links": {name: G.parameters for name, G in model.link_inertias.items() if G.parameters.any()},
        "springs": [[dict(spring.terms), spring.stiffness, spring.rest] for spring in model.springs],
        "actuators": {name: described_actuator(actuator) for name, actuator in model.actuators.items()},
        "couplings": list(model.couplings),
        "configurations": dict(model.configurations),
        "closures": {name: [c.frame_a, c.frame_b, c.rows] for name, c in model.closures.items()},
        "shaped": sorted(model.shaped),
        "snap": model.snap,
        "armature": model.armature,
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
        "axes": body.joint.axes,
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
    return without_empty({field.name: plain_values(getattr(actuator, field.name)) for field in fields(actuator)})


def pose(T):
    """Position, and the rotation row by row unless it is the identity."""
    T = np.asarray(T)
    if np.allclose(T[:3, :3], np.eye(3), rtol=0, atol=1e-12):
        return T[:3, 3]
    return np.concatenate([T[:3, 3], T[:3, :3].ravel()])


def described_friction(friction):
    """Coefficients that are not at the values of viscous and Coulomb friction alone."""
    coefficients = finite_fields(friction, Friction)
    if np.array_equal(friction.static, friction.coulomb):
        coefficients.pop("static", None)
    if (np.asarray(friction.stribeck) == 1.0).all():
        coefficients.pop("stribeck", None)
    return coefficients


def finite_fields(values, kind):
    """Arrays of limits or of friction that are not all infinite or all zero."""
    arrays = {field.name: np.asarray(getattr(values, field.name), float) for field in fields(kind)}
    return {name: array for name, array in arrays.items() if np.isfinite(array).any() and array.any()}


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


_NUMBER = re.compile(r"-?\d+\.\d+(?:e[+-]?\d+)?|-?\d+e[+-]?\d+")


def rounded(text):
    """Text with its numbers to nine digits, and zero for what rounding leaves of zero."""

    def shorter(match):
        number = float(match[0])
        return f"{number:.9g}" if abs(number) > _ROUND_OFF else "0"

    return _NUMBER.sub(shorter, text)
