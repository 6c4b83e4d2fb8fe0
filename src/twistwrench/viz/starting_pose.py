"""Initial poses of a page: working poses for arms, near neutral within limits for other robots."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..core.typing import Array
from ..mechanics.model.model import BASE, Body, Model

if TYPE_CHECKING:
    from ..robot import Robot

STOP_CLEARANCE = 0.1
"""Distance of a joint from its stops, as a share of its range."""
_SAMPLES = 1024
"""Number of configurations that are compared in a round."""
_ROUNDS = 8
"""Number of rounds; each searches half the range of the previous round."""
# Values above which a pose is not rated better:
_ENOUGH_CONDITIONING = 0.8  # smallest singular value, as a share of the best pose's
_ENOUGH_ELBOW_HEIGHT = 0.2  # above the line to the tip, as a share of the reach
_ENOUGH_DISTANCE_AHEAD = 0.5  # of the tip, as a share of the reach
_ELBOW_WEIGHT = 2
_PENALTY_WEIGHT = 20  # of poses that are too low
_MIN_SINGULAR_VALUE = 1e-6
"""Singular value of the scaled Jacobian below which a direction does not count for the rank."""
_MIN_TIP_HEIGHT = 0.25
"""Height of the tip over the base below which a pose is penalised, as a share of the reach."""


def starting_pose(robot: Robot, tip: str | None = None) -> Array:
    """Initial configuration of a page; (nq,).

    An arm has its elbow up, its joints clear of their stops by a tenth of their range, and its tip in the upper half of
    its reach, far from singular poses. Joints that none of this determines are near neutral. Other robots are neutral, clear
    of their stops; so are robots without a chain that has most of the joints or of the moving mass.

    Parameters
    ----------
    tip : str, optional, the robot's own if None
    """
    if tip is None:
        tip = robot.model.tip
    joints = single_joints(robot.model)
    low, high = clear_of_stops(robot)
    neutral = robot.neutral.copy()
    coordinates = [body.q_index for body in joints]  # indices in q
    neutral[coordinates] = np.clip(neutral[coordinates], low, high)
    if tip is None or robot.model.frame(tip).body < 0 or not is_arm(robot.model):
        return neutral
    has_other_joints = len(joints) != robot.nv
    if has_other_joints or not np.any(robot.model.gravity):
        return neutral
    rng = np.random.default_rng(0)
    best = neutral
    for round_number in range(_ROUNDS):  # first over the whole range, then closer to the best
        spread = (high - low) * 0.5**round_number
        samples = best[coordinates] + spread * rng.uniform(-1, 1, (_SAMPLES, len(coordinates)))
        Q = np.repeat(neutral[None], _SAMPLES, axis=0)
        Q[:, coordinates] = np.clip(samples, low, high)
        Q[0] = best  # a round never makes it worse
        best = Q[np.argmax(_merit(robot, Q, tip, neutral))]
    return np.asarray(best)


def single_joints(model: Model) -> list[Body]:
    """Bodies of the joints with one degree of freedom that follow no other."""
    return [body for body in model.leaders if body.joint.nv == 1]


def is_arm(model: Model) -> bool:
    """True if one chain of the tree has more than half of the joints or of the moving mass.

    >>> import twistwrench as tw
    >>> is_arm(tw.robots.panda().model), is_arm(tw.load(tw.robots.path_of("quadruped")).model)
    (True, False)
    """
    masses = [float(body.inertia.mass) for body in model.bodies]
    freedoms = [0 if body.follows else body.joint.nv for body in model.bodies]
    max_mass = 0.0  # of a chain
    max_freedom = 0  # of a chain
    for k in range(len(model.bodies)):
        chain = chain_to_base(model, k)
        max_mass = max(max_mass, sum(masses[j] for j in chain))
        max_freedom = max(max_freedom, sum(freedoms[j] for j in chain))
    return 2 * max_mass > sum(masses) or 2 * max_freedom > sum(freedoms)


def chain_to_base(model: Model, body: int) -> list[int]:
    """Indices of the bodies from a body to the base, which is left out."""
    chain = []
    while body != BASE:
        chain.append(body)
        body = model.bodies[body].parent
    return chain


def clear_of_stops(robot: Robot) -> tuple[Array, Array]:
    """Lower and upper ends of the ranges of the single joints (n,), reduced by a tenth of the range at each end.

    An end is at most half a turn, π rad or m, from the position that is nearest to zero.
    """
    velocities = [body.v_index for body in single_joints(robot.model)]
    lower, upper = robot.limits.lower[velocities], robot.limits.upper[velocities]
    joint_range = upper - lower
    clearance = np.where(np.isfinite(joint_range), STOP_CLEARANCE * joint_range, 0.0)
    low = lower + clearance
    high = upper - clearance
    nearest_to_zero = np.clip(0.0, low, high)
    low = np.maximum(low, nearest_to_zero - np.pi)
    high = np.minimum(high, nearest_to_zero + np.pi)
    return low, high


def _merit(robot: Robot, Q: Array, tip: str, neutral: Array) -> Array:
    """Merit (n,) of each configuration of Q (n, nq) as a working pose of an arm."""
    up = -robot.model.gravity / np.linalg.norm(robot.model.gravity)
    link_poses = np.asarray(robot.link_poses(Q))
    tip_poses = np.asarray(robot.forward_kinematics(Q, tip))
    origins = link_poses[..., :3, 3]  # of all links (n, k, 3)
    tips = tip_poses[:, :3, 3]
    base = origins[:, 0]
    base_to_tip = tips - base
    distances = np.linalg.norm(base_to_tip, axis=1, keepdims=True)
    reach = float(distances.max())
    if reach == 0.0:
        reach = 1.0  # [m], not divided by zero
    tip_directions = base_to_tip / np.maximum(distances, 1e-9)  # not divided by zero
    base_to_links = origins - base[:, None]
    lengths_to_tip = np.einsum("nki,ni->nk", base_to_links, tip_directions)  # components along the line to the tip
    offsets = base_to_links - lengths_to_tip[..., None] * tip_directions[:, None]  # from this line
    elbow_height = (offsets @ up).max(axis=1) / reach
    lowest_link = (origins @ up).min(axis=1)
    lowest_height = np.minimum(lowest_link, tips @ up) - base @ up  # [m], of a link or the tip
    tip_height = (base_to_tip @ up) / reach
    x_axis = np.array([1.0, 0.0, 0.0])
    distance_ahead = base_to_tip @ x_axis / reach
    J = np.asarray(robot.jacobian(Q, tip, "world_aligned")).copy()
    J[:, 3:] /= reach  # so that all rows have one unit
    sigma = np.linalg.svd(J, compute_uv=False)
    ranks = (sigma > _MIN_SINGULAR_VALUE).sum(axis=1)
    rank = int(ranks.max())
    min_sigma = sigma[:, rank - 1] if rank else np.zeros(len(Q))  # singular values are in descending order
    conditioning = min_sigma / max(float(min_sigma.max()), 1e-9)  # not divided by zero
    excursion = np.abs(Q - neutral).mean(axis=1) / np.pi  # in half turns, or π m
    below_base = np.minimum(lowest_height / reach + 1e-6, 0.0)  # with a margin for rounding
    below_min_height = np.minimum(tip_height - _MIN_TIP_HEIGHT, 0.0)
    penalty = below_base + below_min_height  # negative
    merit = (
        np.minimum(conditioning, _ENOUGH_CONDITIONING)
        + _ELBOW_WEIGHT * np.minimum(elbow_height, _ENOUGH_ELBOW_HEIGHT)
        + np.minimum(distance_ahead, _ENOUGH_DISTANCE_AHEAD)
    )
    return np.asarray(merit - excursion + _PENALTY_WEIGHT * penalty)
