"""The joints of one body, one after the other: n joints make n bodies, all but the last hidden between them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ...joints.screw_joint import screw_motion
from ...lie import se3
from ...lie.identity import IDENTITY, product
from ...typing import Array
from .joints import MjcfJoint, screw


@dataclass(frozen=True, eq=False)
class ChainLink:
    """A joint, or None for one that is fixed, from a link to the next."""

    joint: MjcfJoint | None
    parent: str
    child: str
    placement: Array
    """(4, 4) of the child in the parent, the coordinate at zero."""


def chain(joints: Sequence[MjcfJoint], parent: str, body: str, T: Array) -> Iterator[ChainLink]:
    """The joints from the parent's link to the body's, whose pose there is T (4, 4) with every joint at its reference.

    T_parent,body = T Π exp([S_i] (q_i - ref_i)) with screw axes S_i in the body's frame; a free joint says where the body is.
    """
    if joints and joints[0].kind == "floating":
        T = IDENTITY
    for n, joint in enumerate(joints):
        last = n == len(joints) - 1
        before, after = IDENTITY, IDENTITY
        if joint.kind == "ball" and joint.point.any():  # turns about its point, and the body's frame goes with it
            before, after = (se3.pose(np.eye(3), sign * joint.point) for sign in (1.0, -1.0))
            last = False
        elif joint.single and joint.reference:
            before = np.asarray(screw_motion(screw(joint), -joint.reference), float)
        child = body if last else f"{body}:{joint.name}"
        yield ChainLink(joint, parent, child, product(T, before))
        parent, T = child, after
    if parent != body:
        yield ChainLink(None, parent, body, T)
