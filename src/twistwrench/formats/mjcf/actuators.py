"""What the actuators of a file say of the joints: the most that they can give, and what of them moves along."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...core.printed_numbers import number
from ...errors import RobotFileError
from ...model.remark import Remark
from ...typing import Array
from ..element import Element
from ..known_elements import LEFT_OUT
from .defaults import ACTUATORS, SHORTCUT, Defaults
from .joints import MjcfJoint, limited
from .settings import Settings


@dataclass(frozen=True)
class Drives:
    """What actuators do at joints of one degree, by joint; and remarks."""

    efforts: dict[str, float]
    """N m or N, the most that they can give to either side, where it is known."""
    armature: dict[str, float]
    """kg m² or kg."""
    damping: dict[str, float]
    """N m s/rad or N s/m."""
    remarks: list[str]


def drives_of(root: Element, joints: Mapping[str, MjcfJoint], settings: Settings, defaults: Defaults) -> Drives:
    """The actuators of a file, seen at its joints.

    What the actuators of a joint give together, each gear times ``forcerange``, or, of a motor, gear times ``ctrlrange``, lies
    within the joint's own ``actuatorfrcrange``. Their armature and damping count gear squared.
    """
    totals: dict[str, Array] = {}
    drives = Drives({}, {}, {}, [])
    for section in root.all("actuator"):
        for child in section.children:
            if child.tag not in ACTUATORS:
                drives.remarks.append(Remark(str(child), LEFT_OUT["actuator/unknown"]))
            one = defaults.apply(child)
            name = one.attributes.get("joint", one.attributes.get("jointinparent", "")).strip()
            if name and name not in joints:
                raise RobotFileError(f"{child} drives the joint {name!r}, which is not there.")
            if child.tag in ACTUATORS:
                _add_losses(drives, one, joints.get(name))
            if name:
                totals[name] = totals.get(name, np.zeros(2)) + _forces(one, settings)
                if child.tag == "orientation":
                    drives.remarks.append(Remark(str(one), LEFT_OUT["actuator/joint"]))
    for name, joint in joints.items():
        if not joint.single:
            continue
        given = totals.get(name, ANY)
        if limited(joint.element, "actuatorfrclimited", "actuatorfrcrange", settings):
            given = np.clip(given, *_range(joint.element, "actuatorfrcrange"))
        effort, remark = effort_of(given)
        if remark and (name in totals or effort is not None):
            drives.remarks.append(Remark(f"joint {name!r} ({joint.element.place})", remark))
        if effort is not None:
            drives.efforts[name] = effort
    return drives


ANY = np.array([-math.inf, math.inf])
"""Forces of which nothing is said."""
_UNEQUAL = 1e-3
"""Share of the larger force by which that of the other side is less, from which it is told."""


def effort_of(forces: Array) -> tuple[float | None, str]:
    """The most that a joint gives to either side, None where that is not said; and what to remark.

    ``forces`` are the least and the most that its actuators give, (2,).
    """
    one, other = sorted((max(-float(forces[0]), 0.0), max(float(forces[1]), 0.0)))
    if other == math.inf:
        return None, "has an actuator whose largest force is not given"
    if one == 0.0 < other:
        return other, f"is driven to one side only, by up to {number(other)}, and its limit is that of both"
    if one < (1 - _UNEQUAL) * other:
        return (
            one,
            f"gives {number(one)} to one side and {number(other)} to the other, and the less is its limit of both",
        )
    return one or None, ""


def _add_losses(drives: Drives, one: Element, joint: MjcfJoint | None) -> None:
    """Armature and damping of an actuator, as its joint feels them."""
    gear = one.floats("gear", (1.0, 0.0, 0.0, 0.0, 0.0, 0.0))[0]
    for what, at in (("armature", drives.armature), ("damping", drives.damping)):
        value, *more = one.floats(what, (0.0, 0.0, 0.0))
        if not value and not any(more):
            continue
        if joint is None or not joint.single:
            drives.remarks.append(Remark(str(one), f"has a {what} that is left out"))
        else:
            if any(more):
                drives.remarks.append(Remark(str(one), LEFT_OUT["actuator/damping"]))
            at[joint.name] = at.get(joint.name, 0.0) + gear**2 * value


def _forces(one: Element, settings: Settings) -> Array:
    """The least and the most that an actuator gives at its joint, infinite where that is not said."""
    gear = one.floats("gear", (1.0, 0.0, 0.0, 0.0, 0.0, 0.0))[0]
    force = ANY
    kind = one.attributes.get(SHORTCUT)
    if kind in (None, "orientation"):
        return ANY
    plain = kind == "motor" or (
        kind == "general"
        and one.attributes.get("gaintype", "fixed") == "fixed"
        and one.attributes.get("biastype", "none") == "none"
        and one.attributes.get("dyntype", "none") == "none"
    )
    if plain and limited(one, "ctrllimited", "ctrlrange", settings):
        force = np.sort((1.0 if kind == "motor" else _gain(one)) * _range(one, "ctrlrange"))
    if kind == "dcmotor" and "saturation" in one.attributes:  # which stands for a range of forces
        force = _saturation(one)
    elif limited(one, "forcelimited", "forcerange", settings):
        force = np.clip(force, *_range(one, "forcerange"))
    return at_joint(force, gear)


def at_joint(force: Array, gear: float) -> Array:
    """The least and the most force of an actuator, (2,), behind its gear; a gear of zero lets nothing through."""
    return np.sort(gear * force) if gear else np.zeros(2)


def _saturation(one: Element) -> Array:
    """The largest torque of a ``dcmotor`` to both sides: as given, or its constant times the largest current."""
    torque, current, _ = one.floats("saturation", (0.0, 0.0, 0.0))
    of_torque, of_speed = one.floats("motorconst", (0.0, 0.0))
    voltage, _, speed = one.floats("nominal", (0.0, 0.0, 0.0))
    given = [x for x in (of_torque, of_speed or (voltage / speed if speed else 0.0)) if x > 0]
    constant = math.prod(given) ** (1.0 / len(given)) if given else 0.0
    most = torque or constant * current
    return np.array([-most, most]) if most else ANY


def _gain(one: Element) -> float:
    return one.floats("gainprm", (1.0, *([0.0] * 9)))[0]


def _range(element: Element, attribute: str) -> Array:
    return np.array(element.floats(attribute, (0.0, 0.0)))
