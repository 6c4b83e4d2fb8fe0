"""Drives of a gripper's fingers, which a grip force loads in a way that no file describes."""

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
    """Drives of fingers with effort limits, which no wrench of the user loads."""

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
        limits: set[str] = set()
        for effort, turning in zip(self.efforts, self.turning, strict=True):
            limits.add(f"{number(effort)} {unit_of('tau', turning)}")
        noun, verb = "drives", "are"
        if len(self.joints) == 1:
            noun, verb = "drive", "is"
        return (
            f"the {noun} of {listed(self.joints)} ({', '.join(sorted(limits))}) {verb} not "
            f"judged for the grip force of {number(force)} N"
        )

    def are_weaker(self, force: float) -> bool:
        """True if a sliding finger's drive gives less than a grip force [N]."""
        slides = np.logical_not(self.turning)
        is_weaker = np.array(self.efforts) < (1 - TOLERANCE) * force
        return bool((slides & is_weaker).any())


NO_FINGERS = FingerDrives()
"""Drives of a holder without fingers."""


def finger_drives(model: Model, frame: str, efforts: Array, pushed: Iterable[str]) -> FingerDrives:
    """Drives of the joints beyond the body of a gripping frame, or beside that body if it is a finger itself.

    ``efforts`` (nv,) are the limits of the drives. Fingers with one of the ``pushed`` frames are left out, since the
    wrench there loads them.
    """
    loaded_bodies: set[int] = set()
    for name in pushed:
        loaded_bodies.update(model.ancestors(model.frame(name).body))
    joints, limits, turning = [], [], []
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
    """Moving bodies beyond the palm. If there are none, the palm itself is a finger: it and the bodies beside it."""
    moving = [i for i, body in enumerate(model.bodies) if body.joint.moves_body]
    beyond = [i for i in moving if i != palm and palm in model.ancestors(i)]
    if beyond or palm == BASE:
        return beyond
    parent = model.bodies[palm].parent
    siblings = [i for i in moving if model.bodies[i].parent == parent]  # the palm among them
    if parent == BASE or len(siblings) == 1:
        return []
    return siblings
