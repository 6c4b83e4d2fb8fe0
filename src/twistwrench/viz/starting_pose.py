"""Initial poses of a page: working poses for arms, near neutral within limits for other robots."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..core.typing import Array
from ..mechanics.model.model import BASE, Body, Model

if TYPE_CHECKING:
    from ..robot import Robot

STOP_CLEARANCE = 0.1
"""Share of its range that a joint keeps from its stops."""
_SAMPLES, _ROUNDS = 1024, 8


def starting_pose(robot: Robot, tip: str | None = None) -> Array:
    """Initial configuration of a page; (nq,).

    An arm has its elbow up, its joints clear of their stops by a tenth of their range, and its tip in the upper half of
    its reach, far from singular poses. Remaining freedom is near neutral. Other robots, and those without a chain that
    has most of the joints or of the moving mass, are neutral, clear of their stops.

    Parameters
    ----------
    tip : str, optional, the robot's own if None
    """
    if tip is None:
        tip = robot.model.tip
    joints = single_joints(robot.model)
    low, high = clear_of_stops(robot)
    neutral = robot.neutral.copy()
    coordinates = [body.q_index for body in joints]
    neutral[coordinates] = np.clip(neutral[coordinates], low, high)
    if tip is None or robot.model.frame(tip).body < 0 or not is_arm(robot.model):
        return neutral
    if len(joints) != robot.nv or not np.any(robot.model.gravity):
        return neutral
    rng, best = np.random.default_rng(0), neutral
    for k in range(_ROUNDS):  # first over the whole range, then closer to the best
        spread = (high - low) * 0.5**k
        samples = best[coordinates] + spread * rng.uniform(-1, 1, (_SAMPLES, len(coordinates)))
        Q = np.repeat(neutral[None], _SAMPLES, axis=0)
        Q[:, coordinates] = np.clip(samples, low, high)
        Q[0] = best
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
    degrees = [body.joint.nv * (not body.follows) for body in model.bodies]
    max_mass, max_degrees = 0.0, 0
    for k in range(len(model.bodies)):
        chain = chain_to_base(model, k)
        max_mass = max(max_mass, sum(masses[j] for j in chain))
        max_degrees = max(max_degrees, sum(degrees[j] for j in chain))
    return 2 * max_mass > sum(masses) or 2 * max_degrees > sum(degrees)


def chain_to_base(model: Model, body: int) -> list[int]:
    """The body and those between it and the base, from the body on."""
    chain = []
    while body != BASE:
        chain.append(body)
        body = model.bodies[body].parent
    return chain


def clear_of_stops(robot: Robot) -> tuple[Array, Array]:
    """Ends of the joint ranges reduced by a tenth of the range, at most ± half a turn; (joints of one degree,) each."""
    at = [body.v_index for body in single_joints(robot.model)]
    low, high = robot.limits.lower[at], robot.limits.upper[at]
    room = np.where(np.isfinite(high - low), STOP_CLEARANCE * (high - low), 0.0)
    low, high = low + room, high - room
    middle = np.clip(0.0, low, high)
    return np.maximum(low, middle - np.pi), np.minimum(high, middle + np.pi)


def _merit(robot: Robot, Q: Array, tip: str, neutral: Array) -> Array:
    """Merit (n,) of each configuration of Q (n, nq) as a working pose of an arm."""
    up = -robot.model.gravity / np.linalg.norm(robot.model.gravity)
    origins = np.asarray(robot.link_poses(Q))[..., :3, 3]
    end = np.asarray(robot.forward_kinematics(Q, tip))[:, :3, 3]
    base = origins[:, :1]
    reach = float(np.linalg.norm(end - base[:, 0], axis=1).max()) or 1.0
    along = (end - base[:, 0]) / np.maximum(np.linalg.norm(end - base[:, 0], axis=1, keepdims=True), 1e-9)
    offset = origins - base
    offset = offset - np.einsum("nki,ni->nk", offset, along)[..., None] * along[:, None]
    elbow = (offset @ up).max(axis=1) / reach
    low = np.minimum((origins @ up).min(axis=1), end @ up) - base[:, 0] @ up
    height = ((end - base[:, 0]) @ up) / reach
    ahead = (end - base[:, 0]) @ np.array([1.0, 0.0, 0.0]) / reach
    J = np.asarray(robot.jacobian(Q, tip, "world_aligned")).copy()
    J[:, 3:] /= reach
    sigma = np.linalg.svd(J, compute_uv=False)
    rank = int((sigma > 1e-6).sum(axis=1).max())
    min_sigma = sigma[:, rank - 1] if rank else np.zeros(len(Q))
    excursion = np.abs(Q - neutral).mean(axis=1) / np.pi
    below = np.minimum(low / reach + 1e-6, 0.0) + np.minimum(height - 0.25, 0.0)
    conditioning = min_sigma / max(float(min_sigma.max()), 1e-9)
    merit = np.minimum(conditioning, 0.8) + 2 * np.minimum(elbow, 0.2) + np.minimum(ahead, 0.5)
    return np.asarray(merit - excursion + 20 * below)
