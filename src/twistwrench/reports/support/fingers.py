"""Drives of a gripper's fingers. A grip force loads them, but no file describes how."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ...core.numbers import TOLERANCE, number
from ...core.text import listed
from ...core.typing import Array
from ...mechanics.joints.units import unit_of
from ...mechanics.model.model import BASE, Model


@dataclass(frozen=True)
class FingerDrives:
    """Drives of fingers that have effort limits, and that no wrench of the user loads."""

    joints: tuple[str, ...] = ()
    """Names of the joints."""
    efforts: tuple[float, ...] = ()
    """Effort limits [N m, sliding joints: N]."""
    turning: tuple[bool, ...] = ()
    """True for joints that turn, False for those that slide."""

    def remark(self, force: float) -> str:
        """Sentence on drives that are not judged for a grip force [N]; empty without any."""
        if not self.joints:
            return ""
        limits = [
            f"{number(effort)} {unit_of('tau', turning)}"
            for effort, turning in zip(self.efforts, self.turning, strict=True)
        ]
        if len(set(limits)) == 1:
            limits = limits[:1]
        drives = f"{listed(self.joints)} ({listed(limits)})"  # limits in the order of the joints
        clause = f"not judged for the grip force of {number(force)} N"
        if len(self.joints) == 1:
            return f"the drive of {drives} is {clause}"
        return f"the drives of {drives} are {clause}"

    def are_weaker(self, force: float) -> bool:
        """True if a sliding finger's drive gives less than a grip force [N]."""
        slides = np.logical_not(self.turning)
        is_weaker = np.array(self.efforts) < (1 - TOLERANCE) * force
        return bool((slides & is_weaker).any())


NO_FINGERS = FingerDrives()
"""Drives of a holder without fingers."""


def finger_drives(model: Model, frame: str, efforts: Array, pushed: Iterable[str]) -> FingerDrives:
    """Drives of a gripper's fingers with effort limits; see :func:`_finger_bodies` for the fingers of a frame.

    ``efforts`` (nv,) are the limits of the drives. ``pushed`` are the frames of given wrenches; fingers that carry one of them
    are left out, since the wrench loads their drives.
    """
    loaded_bodies: set[int] = set()
    for name in pushed:
        loaded_bodies.update(model.ancestors(model.frame(name).body))
    joints = []
    limits = []
    turning = []
    for i in _finger_bodies(model, model.frame(frame).body):
        body = model.bodies[i]
        if body.joint.nv != 1 or i in loaded_bodies:
            continue
        effort = body.effort if body.follows else float(efforts[body.v_index])  # a mimic joint has its own limit
        if np.isfinite(effort):
            joints.append(body.joint.name)
            limits.append(effort)
            turning.append(bool(body.joint.turning[0]))
    return FingerDrives(tuple(joints), tuple(limits), tuple(turning))


def _finger_bodies(model: Model, palm: int) -> list[int]:
    """Indices of the moving bodies beyond the palm, the body of the gripping frame.

    If there are none, the palm itself is a finger: then the fingers are the palm and its siblings.
    """
    moving_bodies = [i for i, body in enumerate(model.bodies) if body.joint.moves_body]
    bodies_beyond = [i for i in moving_bodies if i != palm and palm in model.ancestors(i)]
    if bodies_beyond or palm == BASE:
        return bodies_beyond
    parent = model.bodies[palm].parent
    siblings = [i for i in moving_bodies if model.bodies[i].parent == parent]  # the palm is one of them
    if parent == BASE or len(siblings) == 1:
        return []
    return siblings
