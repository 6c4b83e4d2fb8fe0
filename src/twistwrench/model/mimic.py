"""Mimic joints: which joint each one follows in the end, and how; the limits of leaders that followers keep theirs in."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..core.printed_numbers import number
from ..errors import ModelError, UnknownNameError
from ..listing import listed
from ..typing import Array
from .description import JointEntry, Mimic
from .limits import TOLERANCE, Limits
from .model import Model

MIMIC_POLICIES = ("follow", "independent")
"""``follow``: mimic joints share their leader's coordinate. ``independent``: they are joints like any other."""


@dataclass(frozen=True)
class Drive:
    """A follower's coordinate is ``ratio`` times its leader's, plus ``offset``; the leader follows nobody."""

    leader: str
    ratio: float
    offset: float


def find_drives(joints: Iterable[JointEntry]) -> dict[str, Drive]:
    """The drive of each follower by name, chains resolved; a mimic on a fixed joint is ignored.

    Raises :class:`~twistwrench.ModelError` for cycles, missing leaders, and joints with several coordinates.
    """
    by_name = {joint.name: joint for joint in joints}
    found: dict[str, Drive] = {}
    for joint in by_name.values():
        path: dict[str, tuple[JointEntry, Mimic]] = {}  # followers up to one that is resolved, or that follows nobody
        while joint.mimic is not None and not joint.fixed and joint.name not in found:
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
        drive = found.get(joint.name, Drive(joint.name, 1.0, 0.0))
        for name, (_, (_, ratio, offset)) in reversed(path.items()):
            found[name] = drive = Drive(drive.leader, ratio * drive.ratio, offset + ratio * drive.offset)
    return found


def _check_pair(joint: JointEntry, leader: str, by_name: Mapping[str, JointEntry]) -> None:
    if leader not in by_name:
        found = UnknownNameError.of("joint", leader, by_name)
        raise ModelError(f"the mimic leader of {joint} is not there: {found} Or load with mimic='independent'.")
    for one in (joint, by_name[leader]):
        if one.joint.nv > 1:
            raise ModelError(
                f"{joint} mimics {by_name[leader]}, but a {one.joint.kind} joint has several coordinates and can "
                "neither mimic nor be mimicked. Load with mimic='independent', or remove the <mimic>."
            )


def shared_limits(
    leader: JointEntry, followers: Iterable[JointEntry], drives: Mapping[str, Drive]
) -> tuple[Limits, list[str]]:
    """The limits of a leader in which its followers keep theirs, and a remark on each follower that none would suit.

    Limits of position and velocity are shared. A limit of effort stays the follower's own: see :func:`follower_torques`.
    """
    limits, remarks = leader.limits, []
    for joint in followers:
        drive = drives[joint.name]
        if not drive.ratio:
            continue
        slack = limits.tolerance
        least, most = np.sort((np.stack([joint.limits.lower, joint.limits.upper]) - drive.offset) / drive.ratio, axis=0)
        lower = np.where(least > limits.lower + slack, least, limits.lower)
        upper = np.where(most < limits.upper - slack, most, limits.upper)
        if (upper - lower <= slack).any() and (limits.upper - limits.lower > slack).all():
            own = f"{number(float(joint.limits.lower[0]))} to {number(float(joint.limits.upper[0]))}"
            remarks.append(
                f"{joint} follows {leader} by {number(drive.ratio)} and cannot keep to its limits, {own}, wherever that "
                "moves within its own; they are left out"
            )
        else:
            limits = replace(limits, lower=lower, upper=upper)
        speed = joint.limits.velocity / abs(drive.ratio)
        limits = replace(limits, velocity=np.where(speed < (1 - TOLERANCE) * limits.velocity, speed, limits.velocity))
    return limits, remarks


def follower_torques(model: Model, F: Array) -> Array:
    """What followers that have a limit of effort bear, (..., k) [N m or N], of wrenches across the joints (..., nbodies, 6).

    τ = S' F for each of ``model.limited_followers``: the torque that a motor in its place would give, friction left out.
    """
    which = model.limited_followers
    return np.stack([F[..., i, :] @ model.bodies[i].joint.axes[0] for i in which], axis=-1)
