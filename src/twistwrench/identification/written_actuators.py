"""What was identified of drives, as an actuator file: friction and motor inertias as the joints feel them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ..core.printed_numbers import number
from ..joints.units import unit_of
from ..model.model import Model
from ..robot import Robot
from ..typing import Array
from .consistent_robot import ConsistentRobot

SIGNATURE = "twistwrench identify"
"""What comments of files begin with."""


def actuator_text(model: Model, found: ConsistentRobot, given: Mapping[str, object] | None = None) -> str:
    """An actuator file with friction and motor inertias; entries that were ``given`` stay, but for these.

    With a known ratio the motor's inertia is that of an extra rotor, Ia / ratio²; without, the reflected one.
    """
    import yaml

    content: dict[str, object] = {"robot": model.name, **dict(given or {})}
    entries = {name: dict(entry) for name, entry in dict(content.get("actuators", {}) or {}).items()}  # type: ignore[call-overload]
    sliding = {b.joint.name for b in model.leaders if not b.joint.turning[0]}
    inertia, viscous = found.of_joints("motor_inertia"), found.of_joints("viscous")
    coulomb, stribeck, offset = (found.of_joints(kind) for kind in ("coulomb", "stribeck", "offset"))
    for name in model.velocity_names:
        entry = entries.setdefault(name, {})
        slides = name in sliding
        if name in inertia:
            entry.pop("rotor", None)
            entry["reflected_inertia"] = f"{inertia[name]!r} {'kg' if slides else 'kg m^2'}"
        law = {}
        if name in viscous:
            law["viscous"] = f"{viscous[name]!r} {'N s/m' if slides else 'N m s/rad'}"
        if name in coulomb:
            law["coulomb"] = f"{coulomb[name]!r} {unit_of('tau', not slides)}"
        if name in stribeck:
            law["static"] = f"{coulomb.get(name, 0.0) + stribeck[name]!r} {unit_of('tau', not slides)}"
            law["stribeck"] = f"{found.base.unknown.stribeck_speed!r} {unit_of('dq', not slides)}"
        if law:
            entry["friction"] = law
    content["actuators"] = entries
    head = f"# {SIGNATURE}: friction and motor inertias as the joints feel them\n"
    if offset:
        head += "".join(f"# offset of the torque of {name}: {number(value, 6)}\n" for name, value in offset.items())
    head += "".join(
        f"# of several joints, not read: {name} {value!r}\n" for name, value in found.of_several_joints.items()
    )
    return head + yaml.safe_dump(content, sort_keys=False, allow_unicode=True)


def same_actuators(text: str, found: ConsistentRobot) -> float:
    """Largest difference of friction and armature of an actuator file read again, as a share of the largest."""
    import yaml

    model = found.base.unknown.model
    bare = replace(model, armature=np.zeros(model.nv))
    again = Robot(bare).with_actuators(yaml.safe_load(text)).model
    right = found.robot.model
    pairs: list[tuple[Array, Array]] = [
        (again.armature, right.armature),
        (again.friction.viscous, right.friction.viscous),
        (again.friction.coulomb, right.friction.coulomb),
        (again.friction.static, right.friction.static),
    ]
    size = max(float(np.abs(b).max()) for _, b in pairs)
    return max(float(np.abs(a - b).max()) for a, b in pairs) / max(size, 1e-300)
