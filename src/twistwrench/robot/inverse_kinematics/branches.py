"""All branches of inverse kinematics: configurations of one pose, up to full turns."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ...core import arguments
from ...core.errors import ModelWarning, ValueRangeError
from ...core.typing import Array
from ...mechanics.algorithms.kinematics import row_numbers
from ...mechanics.joints.screw_joint import ScrewJoint
from ...mechanics.model.description import frames_to_user
from .solve import IKResult, select_poses

if TYPE_CHECKING:
    from ..robot import Robot

IDENTICAL_BELOW = 1e-6
"""rad or m: configurations that differ by less than this in all joints are identical."""
MAX_EQUAL_DISPLACEMENT = 10.0
"""Largest displacement of the frame, in tolerances and to first order, between two configurations that count as equal.

Such configurations are farther apart than ``IDENTICAL_BELOW`` only near a singular configuration, where the tolerance cannot
separate them."""
SINGULAR_VALUE_SHARE = 1e-9
"""Singular values of J below this fraction of the largest are zero."""


def branches(
    robot: Robot,
    T: ArrayLike,
    frame: str | None,
    rows: str | Iterable[int | str] | None,
    starts: int,
    rng: np.random.Generator | int | None,
    angle: float,
    distance: float,
) -> IKResult:
    """Branches of inverse kinematics; see :meth:`twistwrench.Robot.inverse_kinematics_branches`."""
    finite_T = arguments.finite(T, "inverse_kinematics_branches: T", 4, 4)
    target = arguments.one(finite_T, "T", 4, 4)
    starts = arguments.integer(starts, "starts")
    row_indices = row_numbers(rows)
    if robot.nv > len(row_indices) or robot.nq != robot.nv:
        raise ValueRangeError(
            f"robot {robot.name!r} has {robot.nv} velocities for {len(row_indices)} rows, and branches need at most as many "
            "joints of one degree as rows; otherwise a pose has curves of configurations. Lock joints (robot.lock), or use "
            "inverse_kinematics for one."
        )
    random_starts = robot.random_configuration(rng, starts - 1)  # the neutral configuration is a start, too
    q0 = np.concatenate([robot.neutral[None], random_starts])
    result = robot.inverse_kinematics(target, frame, q0, rows=rows, restarts=0, angle=angle, distance=distance)
    solutions = np.flatnonzero(result.converged)
    q = _without_full_turns(robot, result.q[solutions])
    J = robot.jacobian(q, frame)[:, row_indices, :]
    is_angular = np.array(row_indices) < 3  # rows 0 to 2 of a twist
    column_lengths = np.linalg.norm(J[:, ~is_angular], axis=1)
    lever_arms = column_lengths.max(axis=-1, initial=1.0)
    branch_indices: list[int] = []  # of the first configuration of each branch
    for k in range(len(q)):
        difference = _difference_without_turns(robot, q[k], q[branch_indices])
        V = (J[branch_indices] @ difference[..., None])[..., 0]
        is_identical = np.abs(difference).max(axis=-1, initial=0.0) < IDENTICAL_BELOW
        max_distance = MAX_EQUAL_DISPLACEMENT * distance * lever_arms[branch_indices]
        is_equal = np.linalg.norm(V[:, is_angular], axis=1) <= MAX_EQUAL_DISPLACEMENT * angle
        is_equal &= np.linalg.norm(V[:, ~is_angular], axis=1) <= max_distance
        is_on_known_branch = (is_identical | is_equal).any()
        if not is_on_known_branch:
            branch_indices.append(k)
    singular_values = np.ones((0, 1))  # of no branch
    if branch_indices:
        singular_values = np.linalg.svd(J[branch_indices], compute_uv=False)
    is_singular = singular_values[:, -1] <= SINGULAR_VALUE_SHARE * singular_values[:, 0]
    singular_count = int(is_singular.sum())
    if singular_count > 1:
        warnings.warn(
            f"inverse_kinematics_branches: {singular_count} of the {len(branch_indices)} configurations are singular, so they "
            "may be points of curves on which the frame stays, and not branches. Turn or move the pose a little.",
            ModelWarning,
            stacklevel=frames_to_user(),
        )
    smallest_angles_first = sorted(branch_indices, key=lambda k: (float(np.abs(q[k]).max(initial=0.0)), k))
    return select_poses(result, solutions[smallest_angles_first], q[smallest_angles_first])


def _full_turn_mask(robot: Robot) -> Array:
    """Mask (nv,) of revolute joints that repeat after a full turn. Joints with pitch or with mimic joints do not."""
    leader_indices = {body.v_index for body in robot.model.bodies if body.follows}
    mask = np.zeros(robot.nv, bool)
    for body in robot.model.leaders:
        joint = body.joint
        turns = isinstance(joint, ScrewJoint) and joint.turns and not joint.has_pitch
        mask[body.v_index] = turns and body.v_index not in leader_indices
    return mask


def _without_full_turns(robot: Robot, q: Array) -> Array:
    """Configurations q without full turns, where the limits allow the smaller angle."""
    period = 2.0 * np.pi * _full_turn_mask(robot)  # 0 for joints without
    smaller_q = q - period * np.round(q / (2.0 * np.pi))
    is_inside = (smaller_q >= robot.limits.lower) & (smaller_q <= robot.limits.upper)
    return np.where(is_inside, smaller_q, q)


def _difference_without_turns(robot: Robot, q1: Array, q0: Array) -> Array:
    """Difference q1 - q0 of two configurations modulo full turns."""
    period = 2.0 * np.pi * _full_turn_mask(robot)
    return (q1 - q0) - period * np.round((q1 - q0) / (2.0 * np.pi))
