"""Log of a robot on the ground: with the pose of its base, read from the file or computed from the foot that stands."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.errors import ValueRangeError
from ...core.text import Argument, ReadingNote, listed
from ...core.typing import Array
from ...mechanics.model import edit
from ...motion.column_names import time_column
from ...motion.columns import absent_joints
from ...motion.coordinates import Coordinates
from ...motion.motion_log import MotionLog
from ...motion.readers.array_files import ArrayFile
from ...robot import Robot
from ...statics.feet import base_poses, level_pose, pose_coordinates, resting_points, stance_rates, upward
from ...statics.torque_limits import floating_entries
from .contact_schedule import with_schedule
from .ground import Ground, GroundGiven, ground_of, with_base_free
from .standing import StandingCase

if TYPE_CHECKING:
    from ...motion.motion_file import MotionFile


def standing_case(
    robot: Robot, log: MotionLog, given: GroundGiven, loads: Mapping[str, Any]
) -> tuple[StandingCase, MotionLog]:
    """Load case of a robot on the ground, and the log with its base, from a log of the robot as it was loaded."""
    free, first = with_base_free(robot), log.motion(log.table[:1]).q[0]
    if free is robot:
        return StandingCase(
            free, **loads, ground=with_schedule(ground_of(free, given, first), given.in_contact, log)
        ), log
    if has_base_columns(log.file, free):
        raise ValueRangeError(
            f"{log.path}: the file has the pose of the base, and the base of robot {robot.name!r} is fixed. Load it with a "
            "floating base, {0}, so that these columns are read.",
            Argument("floating_base", True),
        )
    ground = with_schedule(ground_of(free, given, np.concatenate([free.neutral[:7], first])), given.in_contact, log)
    return StandingCase(free, **loads, ground=ground), standing_log(log, robot, free, ground)


def has_base_columns(file: MotionFile, free: Robot, columns: Mapping[str, str] | None = None) -> bool:
    """True if a file has the pose of the base, under the names that a robot with a free base has, or by ``columns``."""
    root = next(body.joint.name for body in free.model.leaders if not body.joint.driven)
    return not absent_joints(file.header, Coordinates.from_model(free.model), [root], columns or {}, file.path)


def robot_of_log(robot: Robot, file: MotionFile, columns: Mapping[str, str] | None = None) -> Robot:
    """Robot whose coordinates a file has: with its free base held, if the file has the joints alone."""
    if floating_entries(robot).sum() != _FREE or has_base_columns(file, robot, columns):
        return robot
    return with_base_held(robot)


def with_base_held(robot: Robot) -> Robot:
    """Robot whose free base is held, so that its coordinates are those of the joints; a robot without one as it is."""
    if floating_entries(robot).sum() != _FREE:
        return robot
    root = next(body for body in robot.model.leaders if not body.joint.driven)
    held = edit.lock(robot.model, {root.joint.name: robot.neutral[root.places[0]]})
    return Robot(replace(held, mounted=False, locked=robot.model.locked))


_FREE = 6
"""Velocities of a free base."""


def standing_log(log: MotionLog, held: Robot, free: Robot, ground: Ground) -> MotionLog:
    """Log of a robot with a free base from one of its joints alone: feet that stand, and wheels, stay where they are."""
    rows = log.motion(log.table)
    soles = resting_points(ground.feet)
    if soles:
        poses, standing = base_poses(held, rows.time, rows.q, soles, normal=ground.normal)
    else:
        below = upward(held)
        wheels = [
            (np.asarray(held.forward_kinematics(rows.q[0], c.frame)) @ np.r_[c.point, 1.0])[:3] - c.radius * below
            for c in ground.contacts
        ]
        poses = np.tile(level_pose(held, np.array(wheels), ground.normal), (len(rows.time), 1, 1))
        standing = np.zeros((len(rows.time), 0), bool)
    parts: dict[str, Array] = {"q": np.column_stack([pose_coordinates(poses), rows.q])}
    if rows.dq is not None:
        joint_rates = rows.dq, np.zeros_like(rows.dq) if rows.ddq is None else rows.ddq
        dq, ddq = stance_rates(free, parts["q"], *joint_rates, soles, standing)
        parts["dq"] = dq
        if rows.ddq is not None:
            parts["ddq"] = ddq
    if rows.tau is not None:
        parts["tau"] = np.column_stack([np.zeros((len(rows.q), 6)), rows.tau])
    names = Coordinates.from_model(free.model)
    header = [time_column(names.names)]
    for part in parts:
        header += names.headers(part)
    table = np.column_stack([rows.time, *parts.values()])
    file = ArrayFile.from_table(log.path, header, table, table.nbytes)
    found = MotionLog.open(file, free.model, plan=log.plan)
    stood = listed([frame for k, frame in enumerate(soles) if standing[:, k].any()], 4)
    note = ReadingNote(f"The pose of the base is that in which these stay where they are: {stood or 'wheels'}.")
    columns = replace(found.columns, notes=(*log.notes, note))
    read = tuple(doubt for doubt in log.doubts() if doubt.kind not in {own.kind for own in found.doubts()})
    return replace(found, columns=columns, of_source=read, locked=log.locked, unused=log.unused)
