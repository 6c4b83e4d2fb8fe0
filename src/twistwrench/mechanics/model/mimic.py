"""Mimic joints: leaders, ratios and offsets with chains resolved, and limits that leaders share with their followers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ...core.errors import ModelError, UnknownNameError
from ...core.numbers import TOLERANCE, number
from ...core.text import argument, listed
from .description import JointEntry, Mimic
from .limits import Limits

MIMIC_POLICIES = ("follow", "independent")
"""``follow``: mimic joints share their leader's coordinate. ``independent``: mimic joints are ordinary joints."""


@dataclass(frozen=True)
class Drive:
    """Coordinate of a follower: ``ratio`` times its leader's, plus ``offset``; the leader is not a follower itself."""

    leader: str
    ratio: float
    offset: float


def find_drives(joints: Iterable[JointEntry]) -> dict[str, Drive]:
    """Drive of each follower by name, with chains resolved; a mimic entry of a fixed joint is ignored.

    Raises :class:`~twistwrench.ModelError` for cycles, missing leaders, and joints with several coordinates.
    """
    by_name = {joint.name: joint for joint in joints}
    drives: dict[str, Drive] = {}
    for joint in by_name.values():
        path: dict[str, tuple[JointEntry, Mimic]] = {}  # followers up to a resolved or independent joint
        while joint.mimic is not None and not joint.fixed and joint.name not in drives:
            leader = joint.mimic[0]
            _check_pair(joint, leader, by_name)
            path[joint.name] = joint, joint.mimic
            if leader in path:
                names = [*path]
                loop = listed(map(repr, [*names[names.index(leader) :], leader]), between=" → ")
                raise ModelError(
                    f"{path[names[0]][0]} is part of a mimic cycle, {loop}. Remove the <mimic> of one of them."
                )
            joint = by_name[leader]
        drive = drives.get(joint.name, Drive(joint.name, 1.0, 0.0))
        for name, (_, (_, ratio, offset)) in reversed(path.items()):
            drive = Drive(drive.leader, ratio * drive.ratio, offset + ratio * drive.offset)
            drives[name] = drive
    return drives


def _check_pair(joint: JointEntry, leader: str, by_name: Mapping[str, JointEntry]) -> None:
    if leader not in by_name:
        error = UnknownNameError.from_choices("joint", leader, by_name)
        raise ModelError(
            f"the mimic leader of {joint} is not there: {error} Or load with {argument('mimic', 'independent')}."
        )
    for entry in (joint, by_name[leader]):
        if entry.joint.nv > 1:
            raise ModelError(
                f"{joint} mimics {by_name[leader]}, but a {entry.joint.kind} joint has several coordinates and can "
                f"neither mimic nor be mimicked. Load with {argument('mimic', 'independent')}, or remove the <mimic>."
            )


def shared_limits(
    leader: JointEntry, followers: Iterable[JointEntry], drives: Mapping[str, Drive]
) -> tuple[Limits, list[str]]:
    """Limits of a leader within which its followers keep theirs, and a note on each follower for which none exist.

    Limits of position and velocity are shared. A follower keeps its own effort limit: see :func:`follower_torques`.
    """
    limits, remarks = leader.limits, []
    for joint in followers:
        drive = drives[joint.name]
        if not drive.ratio:
            continue
        slack = limits.tolerance
        ends = np.stack([joint.limits.lower, joint.limits.upper])  # of the follower
        lower, upper = np.sort((ends - drive.offset) / drive.ratio, axis=0)  # as the leader's coordinate
        lower = np.where(lower > limits.lower + slack, lower, limits.lower)
        upper = np.where(upper < limits.upper - slack, upper, limits.upper)
        if (upper - lower <= slack).any() and (limits.upper - limits.lower > slack).all():
            limits_text = f"{number(float(joint.limits.lower[0]))} to {number(float(joint.limits.upper[0]))}"
            remarks.append(
                f"{joint} follows {leader} by {number(drive.ratio)} and cannot keep to its limits, {limits_text}, wherever "
                "that moves within its own; they are left out"
            )
        else:
            limits = replace(limits, lower=lower, upper=upper)
        for name in ("velocity", "acceleration", "deceleration", "jerk"):
            follower_limit, limit = getattr(joint.limits, name) / abs(drive.ratio), getattr(limits, name)
            shared = np.where(follower_limit < (1 - TOLERANCE) * limit, follower_limit, limit)
            limits = replace(limits, **{name: shared})
    return limits, remarks
