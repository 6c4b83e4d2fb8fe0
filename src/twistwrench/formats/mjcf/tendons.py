"""Fixed tendons: a spring over several joints at once. Spatial ones are left out."""

from __future__ import annotations

from collections.abc import Mapping

from ...errors import RobotFileError
from ...model.builder import ModelBuilder
from ...model.remark import Remark
from ..element import Element
from ..known_elements import LEFT_OUT
from .defaults import Defaults
from .joints import MjcfJoint

_LOSSES = ("damping", "frictionloss", "armature")
"""What tendons have that has no place in the model."""


def add_tendons(
    builder: ModelBuilder, root: Element, joints: Mapping[str, MjcfJoint], kept: set[str], defaults: Defaults
) -> None:
    """Springs of the tendons that have a stiffness, and a remark on whatever acts and is left out."""
    for section in root.all("tendon"):
        for child in section.children:
            one = defaults.apply(child, kind="tendon")
            if child.tag == "spatial":
                if any(any(one.floats(what, (0.0, 0.0, 0.0))) for what in ("stiffness", *_LOSSES)):
                    builder.remark(Remark(str(child), "is a spatial tendon, whose forces and inertia are left out"))
            elif child.tag == "fixed":
                _add_fixed(builder, one, joints, kept)
            else:
                raise RobotFileError(f"{child} is no tendon. Known: fixed, spatial.")


def _add_fixed(builder: ModelBuilder, one: Element, joints: Mapping[str, MjcfJoint], kept: set[str]) -> None:
    terms: dict[str, float] = {}
    for child in one.all("joint"):
        name = child.text("joint")
        if name not in joints or not joints[name].single:
            raise RobotFileError(f"{child} in {one} names {name!r}, which is no hinge or slide.")
        terms[name] = terms.get(name, 0.0) + child.number("coef")
    for what in _LOSSES:
        if any(one.floats(what, (0.0, 0.0, 0.0))):
            builder.remark(Remark(str(one), f"has a {what}, which is left out"))
    stiffness, *more = one.floats("stiffness", (0.0, 0.0, 0.0))
    if not stiffness and not any(more):
        return
    if any(more):
        builder.remark(Remark(str(one), LEFT_OUT["tendon/stiffness"]))
        return
    if one.floats("springyield", (0.0,))[0]:
        builder.remark(Remark(str(one), LEFT_OUT["tendon/springyield"]))
    first, last = one.floats("springlength", (-1.0, -1.0))
    if "springlength" in one.attributes and len(one.attributes["springlength"].split()) == 1:
        last = first
    if first == -1.0:
        first = last = sum(weight * joints[name].rest for name, weight in terms.items())
    if first != last:
        builder.remark(Remark(str(one), "is a spring that is slack over a range of lengths, and is left out"))
    elif terms.keys() <= kept:
        builder.add_spring(terms, stiffness, first, where=one.place)
