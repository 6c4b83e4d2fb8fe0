"""All branches of inverse kinematics: the configurations, apart from full turns, at which a frame has one pose."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..algorithms.operational_space import row_numbers
from ..core import arguments
from ..errors import ModelWarning, ValueRangeError
from ..joints.screw_joint import ScrewJoint
from ..model.remark import frames_to_user
from ..typing import Array
from .reached_poses import InverseKinematics, selected

if TYPE_CHECKING:
    from .robot import Robot

SAME = 1e-6
"""rad or m: configurations nearer than this in all joints are one."""
ALIKE = 10.0
"""So are those on whose straight way the frame moves no more than so many times what may be left, to first order: only near a
singular configuration is that far, and what is left tells them no better apart."""
SINGULAR = 1e-9
"""Singular values of J below this part of the largest are zero."""


def branches(
    robot: Robot,
    T: ArrayLike,
    frame: str | None,
    rows: str | Iterable[int | str] | None,
    starts: int,
    rng: np.random.Generator | int | None,
    angle: float,
    distance: float,
) -> InverseKinematics:
    """See :meth:`twistwrench.Robot.inverse_kinematics_branches`."""
    target = arguments.one(arguments.finite(T, "inverse_kinematics_branches: T", 4, 4), "T", 4, 4)
    if type(starts) is not int or starts < 1:
        raise ValueRangeError(f"starts={arguments.shown(starts)}: give a whole number of at least 1.")
    chosen = row_numbers(rows)
    if robot.nv > len(chosen) or robot.nq != robot.nv:
        raise ValueRangeError(
            f"robot {robot.name!r} has {robot.nv} velocities for {len(chosen)} rows, and branches are of as many joints of one "
            "degree as there are rows, or fewer: else a pose has curves of configurations. Lock joints (robot.lock), or ask "
            "inverse_kinematics for one."
        )
    q0 = np.concatenate([robot.neutral[None], robot.random_configuration(rng, starts - 1)])
    found = robot.inverse_kinematics(target, frame, q0, rows=rows, restarts=0, angle=angle, distance=distance)
    there = np.flatnonzero(found.converged)
    q = _unwound(robot, found.q[there])
    J = robot.jacobian(q, frame)[:, chosen, :]
    turning = np.array(chosen) < 3
    levers = np.linalg.norm(J[:, ~turning], axis=1).max(axis=-1, initial=1.0)
    kept: list[int] = []
    for k in range(len(q)):
        way = _apart(robot, q[k], q[kept])
        V = (J[kept] @ way[..., None])[..., 0]
        near = np.abs(way).max(axis=-1, initial=0.0) < SAME
        still = np.linalg.norm(V[:, turning], axis=1) <= ALIKE * angle
        still &= np.linalg.norm(V[:, ~turning], axis=1) <= ALIKE * distance * levers[kept]
        if not (near | still).any():
            kept.append(k)
    sizes = np.linalg.svd(J[kept], compute_uv=False) if kept else np.ones((0, 1))
    singular = int((sizes[:, -1] <= SINGULAR * sizes[:, 0]).sum())
    if singular > 1:
        warnings.warn(
            f"inverse_kinematics_branches: {singular} of the {len(kept)} configurations are singular, so they may be points of "
            "curves on which the frame stays, and not branches. Turn or move the pose a little.",
            ModelWarning,
            stacklevel=frames_to_user(),
        )
    order = sorted(kept, key=lambda k: (float(np.abs(q[k]).max(initial=0.0)), k))
    return selected(found, there[order], q[order])


def _turning(robot: Robot) -> Array:
    """Which joints are the same after a full turn: those that only turn, and that nothing follows in another ratio."""
    followed = {body.v_index for body in robot.model.bodies if body.follows}
    found = np.zeros(robot.nv, bool)
    for body in robot.model.leaders:
        joint = body.joint
        turns = isinstance(joint, ScrewJoint) and joint.turns and not joint.has_pitch
        found[body.v_index] = turns and body.v_index not in followed
    return found


def _unwound(robot: Robot, q: Array) -> Array:
    """q with full turns taken off, where the limits allow the smaller angle."""
    turn = 2.0 * np.pi * _turning(robot)
    smaller = q - turn * np.round(q / (2.0 * np.pi))
    fits = (smaller >= robot.limits.lower) & (smaller <= robot.limits.upper)
    return np.where(fits, smaller, q)


def _apart(robot: Robot, a: Array, b: Array) -> Array:
    """How far two configurations are apart, full turns taken off."""
    return (a - b) - 2.0 * np.pi * _turning(robot) * np.round((a - b) / (2.0 * np.pi))
