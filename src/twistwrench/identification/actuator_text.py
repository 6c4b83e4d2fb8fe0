"""Actuator files with identified friction and motor inertias."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ..core.numbers import number
from ..core.typing import Array
from ..mechanics.joints.units import unit_of
from ..mechanics.model.model import Model
from ..robot import Robot
from .consistent import ConsistentRobot
from .parameters import DRIVE, parameter_unit

OF_COUPLED_MOTORS = (
    "coupled motors have friction beside that of their joints here, which actuator files do not represent"
)
"""Reason why no actuator file is written for coupled motors."""
SIGNATURE = "twistwrench identify"
"""Beginning of comments in written files."""


def actuator_text(
    model: Model,
    found: ConsistentRobot,
    given: Mapping[str, object] | None = None,
    load: Mapping[str, float] | None = None,
) -> str:
    """Text of an actuator file with identified friction and motor inertias, and other entries of the file ``given``.

    ``load`` is the load friction by joint, as a share of the carried torque. Motor inertias are written as reflected
    inertias, and replace the rotors of ``given``.
    """
    import yaml

    content: dict[str, Any] = {"robot": model.name, **dict(given or {})}
    given_entries = content.get("actuators") or {}
    entries: dict[str, dict[str, Any]] = {name: dict(entry) for name, entry in given_entries.items()}
    values = {kind: found.of_joints(kind) for kind in DRIVE}  # by kind and joint
    for body in model.leaders:
        name = body.joint.name
        turns = bool(body.joint.turning[0])
        entry = entries.setdefault(name, {})
        if name in values["motor_inertia"]:
            entry.pop("rotor", None)
            inertia = values["motor_inertia"][name]
            entry["reflected_inertia"] = f"{inertia!r} {parameter_unit('motor_inertia', turning=turns)}"
        friction = _friction_entry(name, values, found.base.unknown.stribeck_speed, turning=turns)
        if load and name in load:
            friction["load"] = repr(load[name])
        if friction:
            entry["friction"] = friction
    content["actuators"] = entries
    comments = f"# {SIGNATURE}: friction and motor inertias, reflected to the joints\n"
    for name, value in values["offset"].items():
        comments += f"# offset of the measured torque of {name}, not read: {number(value, 6)}\n"
    for name, value in found.of_several_joints.items():
        comments += f"# of several joints, not read: {name} {value!r}\n"
    return comments + yaml.safe_dump(content, sort_keys=False, allow_unicode=True)


def _friction_entry(
    joint: str, values: Mapping[str, Mapping[str, float]], stribeck_speed: float, *, turning: bool
) -> dict[str, str]:
    """Entry ``friction:`` of a joint, from ``values`` by kind and joint."""
    viscous, coulomb, stribeck = values["viscous"], values["coulomb"], values["stribeck"]
    torque_unit = unit_of("tau", turning)
    friction: dict[str, str] = {}
    if joint in viscous:
        friction["viscous"] = f"{viscous[joint]!r} {parameter_unit('viscous', turning=turning)}"
    if joint in coulomb:
        friction["coulomb"] = f"{coulomb[joint]!r} {torque_unit}"
    if joint in stribeck:
        static = coulomb.get(joint, 0.0) + stribeck[joint]
        friction["static"] = f"{static!r} {torque_unit}"
        friction["stribeck"] = f"{stribeck_speed!r} {unit_of('dq', turning)}"
    return friction


def same_actuators(text: str, found: ConsistentRobot) -> float:
    """Largest difference of friction and armature after an actuator file is read back, as a share of the largest value."""
    import yaml

    model = found.base.unknown.model
    robot_without_armature = Robot(replace(model, armature=np.zeros(model.nv)))
    read_robot = robot_without_armature.with_actuators(yaml.safe_load(text))
    read_values = _drive_values(read_robot.model)
    values = _drive_values(found.robot.model)
    largest_value = max(np.abs(values).max(), 1e-300)  # not zero
    return float(np.abs(read_values - values).max() / largest_value)


def _drive_values(model: Model) -> Array:
    """Armatures, viscous, Coulomb and static friction of the joints (4 nv,)."""
    return np.concatenate([model.armature, model.friction.viscous, model.friction.coulomb, model.friction.static])
