"""Equality constraints: joints that follow others, and loops that are offered to be closed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ...core.printed_numbers import printed
from ...errors import RobotFileError
from ...lie import quaternion, se3
from ...model.builder import ModelBuilder
from ...model.closure import OfferedClosure
from ...model.description import Mimic
from ...model.remark import Remark
from ...typing import Array
from ..element import Element
from .bodies import WORLD, MjcfBody
from .defaults import Defaults
from .joints import MjcfJoint

POINT = "vx vy vz"
"""The rows that ``connect`` holds."""
ALL = "wx wy wz vx vy vz"
"""The rows that ``weld`` holds."""


def constraints_of(root: Element, defaults: Defaults) -> list[Element]:
    """The active ones, in the file's order."""
    found = [defaults.apply(one, kind="equality") for section in root.all("equality") for one in section.children]
    return [one for one in found if one.flag("active", default=True)]


def mimics(
    constraints: Sequence[Element], joints: Mapping[str, MjcfJoint], kept: set[str]
) -> tuple[dict[str, Mimic], list[str]]:
    """Joints that follow another by a constant ratio, q1 - q1_ref = c0 + c1 (q2 - q2_ref); and remarks on the others."""
    found: dict[str, Mimic] = {}
    remarks: list[str] = []
    for one in constraints:
        if one.tag != "joint":
            continue
        follower, leader = one.text("joint1"), one.attributes.get("joint2", "").strip()
        for name in (follower, leader):
            if name and (name not in joints or not joints[name].single):
                raise RobotFileError(f"{one} names {name!r}, which is no hinge or slide.")
        if not {follower, leader or follower} <= kept:
            continue
        c0, c1, *more = one.floats("polycoef", (0.0, 1.0, 0.0, 0.0, 0.0))
        if not leader:
            remarks.append(
                Remark(
                    str(one),
                    f"holds joint {follower!r} at {printed(joints[follower].reference + c0)}, which is left out: lock it",
                )
            )
        elif any(more) or c1 == 0:
            remarks.append(Remark(str(one), "makes a joint follow another by a polynomial, which is left out"))
        elif follower in found or follower in leaders_of(leader, found):
            remarks.append(Remark(str(one), "is a second rule for its joints, which is left out"))
        else:
            offset = joints[follower].reference + c0 - c1 * joints[leader].reference
            found[follower] = (leader, c1, offset)
    return found, remarks


def leaders_of(name: str, found: Mapping[str, Mimic]) -> set[str]:
    """The joint itself, and all that it follows."""
    met = {name}
    while name in found:
        name = found[name][0]
        met.add(name)
    return met


def add_closures(
    builder: ModelBuilder,
    constraints: Sequence[Element],
    bodies: Sequence[MjcfBody],
    poses: Sequence[Array],
    kept: set[int],
) -> None:
    """Offer each loop as two frames on each other; ``poses`` are those of the bodies where the file puts them."""
    numbers = {body.name: k for k, body in enumerate(bodies)}
    for k, one in enumerate(constraints):
        if one.tag == "joint":
            continue
        if one.tag not in ("connect", "weld"):
            builder.remark(Remark(str(one), f"is an equality of kind {one.tag}, which is left out"))
            continue
        name = one.attributes.get("name", "").strip() or f"{one.tag}{k}"
        rows = POINT if one.tag == "connect" else ALL
        if "site1" in one.attributes:
            frames = [_site(builder, one, which) for which in ("site1", "site2")]
        else:
            first, second = (_body(one, which, numbers) for which in ("body1", "body2"))
            if not {first, second} <= kept:
                continue
            T1, T2 = _ends(one, poses[first], poses[second])
            frames = [
                builder.add_site(f"{name}:{bodies[i].name}", bodies[i].name, T, where=one.place)
                for i, T in ((first, T1), (second, T2))
            ]
        if None in frames:
            continue
        a, b = (str(frame) for frame in frames)
        builder.add_closure(name, OfferedClosure(a, b, rows))
        builder.remark(f"{one} is left open: robot.close({a!r}, {b!r}, {rows!r}) closes it")


def _site(builder: ModelBuilder, one: Element, which: str) -> str | None:
    name = one.text(which)
    return next((known for known in (f"site:{name}", name) if known in builder.site_names), None)


def _body(one: Element, which: str, numbers: Mapping[str, int]) -> int:
    name = one.attributes.get(which, WORLD).strip()
    if name not in numbers:
        raise RobotFileError(f"{one} names the body {name!r}, which is not there.")
    return numbers[name]


def _ends(one: Element, T_1: Array, T_2: Array) -> tuple[Array, Array]:
    """The frames in the two bodies that are to lie on each other."""
    between = se3.inverse(T_1) @ T_2
    if one.tag == "connect":
        anchor = se3.pose(np.eye(3), one.numbers("anchor", 3))
        return anchor, se3.inverse(between) @ anchor
    *place, w, x, y, z = one.floats("relpose", (0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    anchor = se3.pose(np.eye(3), one.floats("anchor", (0.0, 0.0, 0.0)))
    if any((w, x, y, z)):  # where the anchor is in the first body, and how the second one is turned
        return se3.pose(quaternion.rotation([w, x, y, z]), place), anchor
    return between @ anchor, anchor
