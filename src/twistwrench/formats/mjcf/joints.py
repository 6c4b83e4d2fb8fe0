"""Joints of a body: what each one is called, how it moves, and the numbers that go with it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...errors import RobotFileError
from ...lie import so3
from ...typing import Array
from ..element import Element
from ..known_elements import LEFT_OUT
from .bodies import MjcfBody, PlacedElement, unused
from .placement import direction
from .settings import Settings

KINDS = {"hinge": "revolute", "slide": "prismatic", "ball": "ball", "free": "floating"}
"""MJCF's types, and ours."""
COORDINATES = {"revolute": 1, "prismatic": 1, "ball": 4, "floating": 7}


@dataclass(eq=False)
class MjcfJoint:
    """One joint, in SI units and radians, in the frame of its body."""

    element: Element
    name: str
    kind: str
    point: Array
    axis: Array
    reference: float
    """The coordinate at which the body is where the file puts it."""
    rest: float
    """Of its spring."""
    stiffness: float
    options: dict[str, Any] = field(default_factory=dict)
    """Of :meth:`ModelBuilder.add_joint`: limits, damping, friction, armature."""
    remarks: list[str] = field(default_factory=list)
    """What it says that is left out."""

    @property
    def single(self) -> bool:
        """Whether it has one degree of freedom."""
        return COORDINATES[self.kind] == 1


def names_given(bodies: list[MjcfBody]) -> set[str]:
    """The names that joints have in the file."""
    found = (part.element.attributes.get("name", "").strip() for body in bodies for part in body.joints)
    return {name for name in found if name}


def joints_of(body: MjcfBody, settings: Settings, taken: set[str]) -> list[MjcfJoint]:
    """The joints of a body in the file's order; ``taken`` are names that unnamed ones must not get."""
    joints = [_joint(body, k, part, settings, taken) for k, part in enumerate(body.joints)]
    free = [joint for joint in joints if joint.kind == "floating"]
    if free and body.parent != 0:
        raise RobotFileError(
            f"{free[0].element} is free, and its body {body.name!r} does not stand in the worldbody. Move it there."
        )
    if free and len(joints) > 1:
        raise RobotFileError(
            f"{free[0].element} is free and has other joints beside it in body {body.name!r}. Keep one."
        )
    return joints


def _joint(body: MjcfBody, k: int, part: PlacedElement, settings: Settings, taken: set[str]) -> MjcfJoint:
    e = part.element
    said = "free" if e.tag == "freejoint" else e.word("type", tuple(KINDS), "hinge")
    kind = KINDS[said]
    given = e.attributes.get("name", "").strip()
    name = given or unused(f"{body.name}.{said}" + (str(k) if len(body.joints) > 1 else ""), taken)
    unit = settings.angle if kind in ("revolute", "ball") else 1.0
    joint = MjcfJoint(
        element=e,
        name=name,
        kind=kind,
        point=part.moved(np.array(e.floats("pos", (0.0, 0.0, 0.0)))),
        axis=part.turned(direction(e, "axis", e.floats("axis", (0.0, 0.0, 1.0)))),
        reference=unit * e.floats("ref", (0.0,))[0],
        rest=unit * e.floats("springref", (0.0,))[0],
        stiffness=e.floats("stiffness", (0.0, 0.0, 0.0))[0],
    )
    if e.tag == "freejoint":
        if e.word("align", ("true", "false", "auto"), "auto") == "true" or settings.align_free:
            joint.remarks.append("moves its body's frame to the centre of mass in MuJoCo (align), and not here")
        return joint
    for attribute in ("stiffness", "damping"):
        if any(e.floats(attribute, (0.0, 0.0, 0.0))[1:]):
            joint.remarks.append(LEFT_OUT[f"joint/{attribute}"])
    if e.floats("springyield", (0.0,))[0]:
        joint.remarks.append(LEFT_OUT["joint/springyield"])
    joint.options = {
        "damping": e.floats("damping", (0.0, 0.0, 0.0))[0],
        "friction": e.floats("frictionloss", (0.0,))[0],
        "armature": e.floats("armature", (0.0,))[0],
    }
    if joint.single:
        lower, upper = (unit * x for x in e.floats("range", (0.0, 0.0)))
        if limited(e, "limited", "range", settings):
            joint.options |= {"lower": lower, "upper": upper}
    elif kind == "ball" and limited(e, "limited", "range", settings):
        joint.remarks.append(LEFT_OUT["ball/range"])
    if not joint.single and joint.stiffness:
        joint.remarks.append(LEFT_OUT["ball/stiffness"])
    if any(e.floats("springdamper", (0.0, 0.0))):
        joint.remarks.append("has a springdamper, which is left out. Give its stiffness and damping")
    return joint


def limited(element: Element, flag: str, values: str, settings: Settings) -> bool:
    """Whether a range counts: where the flag says so, or, left to itself, where there is a range."""
    said = element.word(flag, ("true", "false", "auto"), "auto")
    return said == "true" or (said == "auto" and settings.auto_limits and values in element.attributes)


def screw(joint: MjcfJoint) -> Array:
    """The screw axis (6,) of a joint of one degree in its body's frame: (ω, -ω × p) or (0, v)."""
    if joint.kind == "prismatic":
        return np.concatenate([np.zeros(3), joint.axis])
    return np.concatenate([joint.axis, so3.cross(joint.point, joint.axis) + 0.0])
