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
    """Coordinate of a follower: ``ratio`` times its leader's coordinate, plus ``offset``."""

    leader: str
    """Name of the leader, which is not a follower itself."""
    ratio: float
    offset: float


def find_drives(joints: Iterable[JointEntry]) -> dict[str, Drive]:
    """Drive of each follower by name, with chains resolved; a mimic entry of a fixed joint is ignored.

    Raises :class:`~twistwrench.ModelError` for cycles, missing leaders, and joints with several coordinates.
    """
    joint_by_name = {joint.name: joint for joint in joints}
    drives: dict[str, Drive] = {}
    for first_joint in joint_by_name.values():
        joint = first_joint
        chain: dict[str, Mimic] = {}  # entries of followers up to a resolved or independent joint
        while joint.mimic is not None and not joint.fixed and joint.name not in drives:
            leader, _, _ = joint.mimic
            _check_pair(joint, leader, joint_by_name)
            chain[joint.name] = joint.mimic
            if leader in chain:
                chain_names = [*chain]
                cycle = [*chain_names[chain_names.index(leader) :], leader]
                cycle_text = listed(map(repr, cycle), between=" → ")
                raise ModelError(
                    f"{first_joint} is part of a mimic cycle, {cycle_text}. Remove the <mimic> of one of them."
                )
            joint = joint_by_name[leader]
        drive = drives.get(joint.name, Drive(joint.name, 1.0, 0.0))
        for name, (_, ratio, offset) in reversed(chain.items()):
            # q = ratio q_next + offset, where q_next = drive.ratio q_leader + drive.offset
            drive = Drive(drive.leader, ratio * drive.ratio, offset + ratio * drive.offset)
            drives[name] = drive
    return drives


def _check_pair(joint: JointEntry, leader: str, joint_by_name: Mapping[str, JointEntry]) -> None:
    """Raise ModelError if the leader of a mimic joint does not exist, or if a joint of the pair has several coordinates."""
    if leader not in joint_by_name:
        error = UnknownNameError.from_choices("joint", leader, joint_by_name)
        raise ModelError(
            f"the mimic leader of {joint} is not there: {error} Or load with {argument('mimic', 'independent')}."
        )
    for entry in (joint, joint_by_name[leader]):
        if entry.joint.nv > 1:
            raise ModelError(
                f"{joint} mimics {joint_by_name[leader]}, but a {entry.joint.kind} joint has several coordinates and can "
                f"neither mimic nor be mimicked. Load with {argument('mimic', 'independent')}, or remove the <mimic>."
            )


def shared_limits(
    leader: JointEntry, followers: Iterable[JointEntry], drives: Mapping[str, Drive]
) -> tuple[Limits, list[str]]:
    """Limits of a leader within which its followers keep their limits, and remarks on followers for which there are none.

    Limits of position, velocity, acceleration, deceleration and jerk are shared. A follower keeps its own effort limit: see
    :func:`follower_torques`.
    """
    limits = leader.limits
    remarks: list[str] = []
    for follower in followers:
        drive = drives[follower.name]
        if not drive.ratio:  # the follower does not move
            continue
        tolerance = limits.tolerance
        lower_and_upper = np.stack([follower.limits.lower, follower.limits.upper])
        # As values of the leader's coordinate. They are sorted because a negative ratio exchanges lower and upper limits.
        lower, upper = np.sort((lower_and_upper - drive.offset) / drive.ratio, axis=0)
        # A limit of the follower counts only if it is narrower by more than the tolerance.
        lower = np.where(lower > limits.lower + tolerance, lower, limits.lower)
        upper = np.where(upper < limits.upper - tolerance, upper, limits.upper)
        leaves_no_range = (upper - lower <= tolerance).any()
        leader_has_range = (limits.upper - limits.lower > tolerance).all()
        if leaves_no_range and leader_has_range:
            limits_text = f"{number(float(follower.limits.lower[0]))} to {number(float(follower.limits.upper[0]))}"
            remarks.append(
                f"{follower} follows {leader} by {number(drive.ratio)} and cannot keep to its limits, {limits_text}, wherever "
                "that moves within its own; they are left out"
            )
        else:
            limits = replace(limits, lower=lower, upper=upper)
        for name in ("velocity", "acceleration", "deceleration", "jerk"):
            leader_limit = getattr(limits, name)
            follower_limit = getattr(follower.limits, name) / abs(drive.ratio)
            shared_limit = np.where(follower_limit < (1 - TOLERANCE) * leader_limit, follower_limit, leader_limit)
            limits = replace(limits, **{name: shared_limit})
    return limits, remarks
