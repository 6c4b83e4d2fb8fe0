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
    """Fingers whose drives have effort limits, and that no wrench of the user loads."""

    joints: tuple[str, ...] = ()
    efforts: tuple[float, ...] = ()
    """Effort limits [N m, sliding joints: N]."""
    turning: tuple[bool, ...] = ()

    def remark(self, force: float) -> str:
        """Sentence on drives that are not judged for a grip force [N]; empty without any."""
        if not self.joints:
            return ""
        units = [unit_of("tau", turning) for turning in self.turning]
        limits = {f"{number(effort)} {unit}" for effort, unit in zip(self.efforts, units, strict=True)}
        drives = "drive" if len(self.joints) == 1 else "drives"
        return (
            f"the {drives} of {listed(self.joints)} ({', '.join(sorted(limits))}) {'is' if drives == 'drive' else 'are'} not "
            f"judged for the grip force of {number(force)} N"
        )

    def are_weaker(self, force: float) -> bool:
        """True if a sliding finger's drive gives less than a grip force [N]."""
        slides = np.logical_not(self.turning)
        return bool((slides & (np.array(self.efforts) < (1 - TOLERANCE) * force)).any())


NO_FINGERS = FingerDrives()


def finger_drives(model: Model, frame: str, efforts: Array, pushed: Iterable[str]) -> FingerDrives:
    """Drives of the joints beyond the body of a gripping frame, or beside that body if it is a finger itself.

    ``efforts`` (nv,) are the limits of the comparison. Fingers with one of the ``pushed`` frames are left out: the
    wrench there loads them.
    """
    palm = model.frame(frame).body
    beyond = [i for i, body in enumerate(model.bodies) if body.joint.moves_body and palm in model.ancestors(i) - {i}]
    if not beyond and palm != BASE:
        parent = model.bodies[palm].parent
        beside = [i for i, body in enumerate(model.bodies) if body.parent == parent and body.joint.moves_body]
        beyond = beside if parent != BASE and len(beside) > 1 else []
    loaded = {i for name in pushed for i in model.ancestors(model.frame(name).body)}
    found = list[tuple[str, float, bool]]()
    for i in beyond:
        body = model.bodies[i]
        if body.joint.nv != 1 or i in loaded:
            continue
        effort = body.effort if body.follows else float(efforts[body.v_index])
        if np.isfinite(effort):
            found.append((body.joint.name, effort, bool(body.joint.turning[0])))
    joints, limits, turning = zip(*found, strict=True) if found else ((), (), ())
    return FingerDrives(joints, limits, turning)
