"""What the actuators of a file say of the joints: the most that they can give, and what of them moves along."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from ...errors import RobotFileError
from ...model.remark import Remark
from ..element import Element
from .defaults import ACTUATORS, SHORTCUT, Defaults
from .joints import MjcfJoint, limited
from .settings import Settings


@dataclass(frozen=True)
class Drives:
    """What actuators do at joints of one degree, by joint; and remarks."""

    efforts: dict[str, float]
    """N m or N, the most that they can give, where it is known."""
    armature: dict[str, float]
    """kg m² or kg."""
    damping: dict[str, float]
    """N m s/rad or N s/m."""
    remarks: list[str]


def drives_of(root: Element, joints: Mapping[str, MjcfJoint], settings: Settings, defaults: Defaults) -> Drives:
    """The actuators of a file, seen at its joints.

    Of the effort a joint's own ``actuatorfrcrange`` comes first; else what its actuators give together, each by gear times
    ``forcerange``, or, of a motor, gear times ``ctrlrange``. Their armature and damping count gear squared.
    """
    totals: dict[str, float] = {}
    drives = Drives({}, {}, {}, [])
    for section in root.all("actuator"):
        for child in section.children:
            if child.tag not in ACTUATORS:
                raise RobotFileError(f"{child} is no actuator. Known: {', '.join(ACTUATORS)}.")
            one = defaults.apply(child)
            name = one.attributes.get("joint", one.attributes.get("jointinparent", "")).strip()
            if name and name not in joints:
                raise RobotFileError(f"{child} drives the joint {name!r}, which is not there.")
            _add_losses(drives, one, joints.get(name))
            if name:
                totals[name] = totals.get(name, 0.0) + _effort(one, settings)
    for name, joint in joints.items():
        most = math.inf
        if joint.single and limited(joint.element, "actuatorfrclimited", "actuatorfrcrange", settings):
            most = _largest(joint.element, "actuatorfrcrange")
        elif joint.single and name in totals:
            most = totals[name]
            if most == math.inf:
                who = f"joint {name!r} ({joint.element.place})"
                drives.remarks.append(Remark(who, "has an actuator whose largest force is not given"))
        if 0 < most < math.inf:
            drives.efforts[name] = most
    return drives


def _add_losses(drives: Drives, one: Element, joint: MjcfJoint | None) -> None:
    """Armature and damping of an actuator, as its joint feels them."""
    gear = one.floats("gear", (1.0, 0.0, 0.0, 0.0, 0.0, 0.0))[0]
    for what, at in (("armature", drives.armature), ("damping", drives.damping)):
        value, *more = one.floats(what, (0.0, 0.0, 0.0))
        if not value and not any(more):
            continue
        if any(more) or joint is None or not joint.single:
            drives.remarks.append(Remark(str(one), f"has a {what} that is left out"))
        else:
            at[joint.name] = at.get(joint.name, 0.0) + gear**2 * value


def _effort(one: Element, settings: Settings) -> float:
    """The most that an actuator gives at its joint, infinite where that is not said."""
    gear = abs(one.floats("gear", (1.0, 0.0, 0.0, 0.0, 0.0, 0.0))[0])
    force = _largest(one, "forcerange") if limited(one, "forcelimited", "forcerange", settings) else math.inf
    kind = one.attributes[SHORTCUT]
    plain = kind == "motor" or (
        kind == "general"
        and one.attributes.get("gaintype", "fixed") == "fixed"
        and one.attributes.get("biastype", "none") == "none"
        and one.attributes.get("dyntype", "none") == "none"
    )
    if plain and limited(one, "ctrllimited", "ctrlrange", settings):
        gain = 1.0 if kind == "motor" else abs(_gain(one))
        force = min(force, gain * _largest(one, "ctrlrange"))
    return gear * force


def _gain(one: Element) -> float:
    return one.floats("gainprm", (1.0, *([0.0] * 9)))[0]


def _largest(element: Element, attribute: str) -> float:
    return max(abs(x) for x in element.floats(attribute, (0.0, 0.0)))
