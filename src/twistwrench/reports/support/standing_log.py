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
from ...motion.readers.columnar_file import ArrayFile
from ...robot import Robot
from ...statics.feet import upward
from ...statics.stance import base_poses, level_pose, pose_coordinates, resting_points, stance_rates
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
    free = with_base_free(robot)
    q = log.motion(log.table[:1]).q[0]
    if free is not robot:
        if has_base_columns(log.file, free):
            raise ValueRangeError(
                f"{log.path}: the file has the pose of the base, and the base of robot {robot.name!r} is fixed. Load it with a "
                "floating base, {0}, so that these columns are read.",
                Argument("floating_base", True),
            )
        q = np.concatenate([free.neutral[:7], q])
    ground = with_schedule(ground_of(free, given, q), given.in_contact, log)
    case = StandingCase(free, **loads, ground=ground)
    if free is robot:
        return case, log
    return case, standing_log(log, robot, free, ground)


def has_base_columns(file: MotionFile, free: Robot, columns: Mapping[str, str] | None = None) -> bool:
    """True if a file has the pose of the base, under the names that a robot with a free base has, or by ``columns``."""
    base_joint = next(body.joint.name for body in free.model.leaders if not body.joint.driven)
    return not absent_joints(file.header, Coordinates.from_model(free.model), [base_joint], columns or {}, file.path)


def robot_of_log(robot: Robot, file: MotionFile, columns: Mapping[str, str] | None = None) -> Robot:
    """Robot whose coordinates a file has: with its free base held if the file has only the joints."""
    if floating_entries(robot).sum() != _VELOCITIES_OF_FREE_BASE or has_base_columns(file, robot, columns):
        return robot
    return with_base_held(robot)


def with_base_held(robot: Robot) -> Robot:
    """Robot whose free base is held, so that its coordinates are those of the joints; the same robot if it has none."""
    if floating_entries(robot).sum() != _VELOCITIES_OF_FREE_BASE:
        return robot
    root = next(body for body in robot.model.leaders if not body.joint.driven)
    q_indices, _ = root.places
    held = edit.lock(robot.model, {root.joint.name: robot.neutral[q_indices]})
    return Robot(replace(held, mounted=False, locked=robot.model.locked))


_VELOCITIES_OF_FREE_BASE = 6
"""Number of velocities of a free base."""


def standing_log(log: MotionLog, held: Robot, free: Robot, ground: Ground) -> MotionLog:
    """Log of a robot with a free base, from a log of its joints alone: feet that stand, and wheels, do not move."""
    motion = log.motion(log.table)
    n = len(motion.time)
    soles = resting_points(ground.feet)
    if soles:
        poses, standing = base_poses(held, motion.time, motion.q, soles, normal=ground.normal)
    else:
        poses = np.tile(_pose_on_wheels(held, motion.q[0], ground), (n, 1, 1))
        standing = np.zeros((n, 0), bool)
    quantities: dict[str, Array] = {"q": np.column_stack([pose_coordinates(poses), motion.q])}
    if motion.dq is not None:
        joint_ddq = np.zeros_like(motion.dq) if motion.ddq is None else motion.ddq
        dq, ddq = stance_rates(free, quantities["q"], motion.dq, joint_ddq, soles, standing)
        quantities["dq"] = dq
        if motion.ddq is not None:
            quantities["ddq"] = ddq
    if motion.tau is not None:
        quantities["tau"] = np.column_stack([np.zeros((n, _VELOCITIES_OF_FREE_BASE)), motion.tau])
    coordinates = Coordinates.from_model(free.model)
    header = [time_column(coordinates.names)]
    for quantity in quantities:
        header += coordinates.headers(quantity)
    table = np.column_stack([motion.time, *quantities.values()])
    file = ArrayFile.from_table(log.path, header, table, table.nbytes)
    with_base = MotionLog.open(file, free.model, plan=log.plan)
    standing_frames = [frame for k, frame in enumerate(soles) if standing[:, k].any()]
    resting_frames = listed(standing_frames, 4) or "wheels"
    note = ReadingNote(f"The pose of the base is that in which these stay where they are: {resting_frames}.")
    columns = replace(with_base.columns, notes=(*log.notes, note))
    kinds_with_base = {doubt.kind for doubt in with_base.doubts()}
    doubts_of_source = tuple(doubt for doubt in log.doubts() if doubt.kind not in kinds_with_base)
    return replace(with_base, columns=columns, of_source=doubts_of_source, locked=log.locked, unused=log.unused)


def _pose_on_wheels(held: Robot, q: Array, ground: Ground) -> Array:
    """Pose (4, 4) of the base in which the lowest points of the wheels are on the ground."""
    up = upward(held)
    lowest_points = []
    for contact in ground.contacts:
        T = np.asarray(held.forward_kinematics(q, contact.frame))
        lowest_points.append((T @ np.r_[contact.point, 1.0])[:3] - contact.radius * up)
    return level_pose(held, np.array(lowest_points), ground.normal)
