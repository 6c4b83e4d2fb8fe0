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


_COORDINATES_OF_FREE_BASE = 7  # position and quaternion
_VELOCITIES_OF_FREE_BASE = 6
_MAX_LISTED_FRAMES = 4
"""Largest number of standing feet that the note on the base lists."""


def standing_case(
    robot: Robot, log: MotionLog, given: GroundGiven, loads: Mapping[str, Any]
) -> tuple[StandingCase, MotionLog]:
    """Load case of a robot on the ground, and its log with the pose of the base, from a log of the loaded ``robot``."""
    free_robot = with_base_free(robot)
    first_row = log.motion(log.table[:1])
    q = first_row.q[0]
    if free_robot is not robot:
        if has_base_columns(log.file, free_robot):
            raise ValueRangeError(
                f"{log.path}: the file has the pose of the base, and the base of robot {robot.name!r} is fixed. Load it with a "
                "floating base, {0}, so that these columns are read.",
                Argument("floating_base", True),
            )
        q = np.concatenate([free_robot.neutral[:_COORDINATES_OF_FREE_BASE], q])
    ground = with_schedule(ground_of(free_robot, given, q), given.in_contact, log)
    case = StandingCase(free_robot, **loads, ground=ground)
    if free_robot is robot:
        return case, log
    return case, standing_log(log, robot, free_robot, ground)


def has_base_columns(file: MotionFile, free_robot: Robot, columns: Mapping[str, str] | None = None) -> bool:
    """True if a file has the pose of the base; its columns have the names of the robot's coordinates, or of ``columns``."""
    base_joint = next(body.joint.name for body in free_robot.model.leaders if not body.joint.driven)
    coordinates = Coordinates.from_model(free_robot.model)
    absent = absent_joints(file.header, coordinates, [base_joint], columns or {}, file.path)
    return not absent


def robot_of_log(robot: Robot, file: MotionFile, columns: Mapping[str, str] | None = None) -> Robot:
    """Robot with the coordinates of a file: a free base is held if the file has only the joints."""
    if floating_entries(robot).sum() != _VELOCITIES_OF_FREE_BASE or has_base_columns(file, robot, columns):
        return robot
    return with_base_held(robot)


def with_base_held(robot: Robot) -> Robot:
    """Robot with its free base held, so that only the joints have coordinates; the robot itself if no base is free."""
    if floating_entries(robot).sum() != _VELOCITIES_OF_FREE_BASE:
        return robot
    root = next(body for body in robot.model.leaders if not body.joint.driven)  # on the free joint
    q_indices, _ = root.places
    held_model = edit.lock(robot.model, {root.joint.name: robot.neutral[q_indices]})
    return Robot(replace(held_model, mounted=False, locked=robot.model.locked))


def standing_log(log: MotionLog, held_robot: Robot, free_robot: Robot, ground: Ground) -> MotionLog:
    """Log of a robot with a free base, from a log of its joints alone: standing feet and wheels stay where they are."""
    motion = log.motion(log.table)
    n = len(motion.time)
    soles = resting_points(ground.feet)
    if soles:
        poses, is_standing = base_poses(held_robot, motion.time, motion.q, soles, normal=ground.normal)
    else:
        pose = _pose_on_wheels(held_robot, motion.q[0], ground)
        poses = np.tile(pose, (n, 1, 1))
        is_standing = np.zeros((n, 0), bool)
    quantities: dict[str, Array] = {"q": np.column_stack([pose_coordinates(poses), motion.q])}
    if motion.dq is not None:
        joint_ddq = np.zeros_like(motion.dq) if motion.ddq is None else motion.ddq
        dq, ddq = stance_rates(free_robot, quantities["q"], motion.dq, joint_ddq, soles, is_standing)
        quantities["dq"] = dq
        if motion.ddq is not None:
            quantities["ddq"] = ddq
    if motion.tau is not None:
        base_tau = np.zeros((n, _VELOCITIES_OF_FREE_BASE))
        quantities["tau"] = np.column_stack([base_tau, motion.tau])
    coordinates = Coordinates.from_model(free_robot.model)
    header = [time_column(coordinates.names)]
    for quantity in quantities:
        header += coordinates.headers(quantity)
    table = np.column_stack([motion.time, *quantities.values()])
    file = ArrayFile.from_table(log.path, header, table, table.nbytes)
    log_with_base = MotionLog.open(file, free_robot.model, plan=log.plan)
    standing_frames = [frame for k, frame in enumerate(soles) if is_standing[:, k].any()]
    base_note = "The pose of the base is constant, as no foot shows how it moves."
    if standing_frames:
        resting_frames = listed(standing_frames, _MAX_LISTED_FRAMES)
        base_note = f"The pose of the base is that in which these stay where they are: {resting_frames}."
    columns = replace(log_with_base.columns, notes=(*log.notes, ReadingNote(base_note)))
    kinds_with_base = {doubt.kind for doubt in log_with_base.doubts()}
    doubts_of_source = tuple(doubt for doubt in log.doubts() if doubt.kind not in kinds_with_base)
    return replace(log_with_base, columns=columns, of_source=doubts_of_source, locked=log.locked, unused=log.unused)


def _pose_on_wheels(held_robot: Robot, q: Array, ground: Ground) -> Array:
    """Pose (4, 4) of the base in which the lowest points of the wheels are on the ground."""
    up = upward(held_robot)
    lowest_points = []
    for contact in ground.contacts:
        T = np.asarray(held_robot.forward_kinematics(q, contact.frame))
        homogeneous_hub = T @ np.r_[contact.point, 1.0]
        lowest_points.append(homogeneous_hub[:3] - contact.radius * up)
    return level_pose(held_robot, np.array(lowest_points), ground.normal)
