"""Random trees for the tests of laws, and the tolerances they argue with."""

from __future__ import annotations

from functools import cache

import numpy as np

from twistwrench.model.joint import JOINT_KINDS
from twistwrench.model.model import BASE
from twistwrench.testing import random_robot

ROUNDING = 1e-11
"""Both sides are some thousand float64 operations on numbers of one size, 1e-16 each, so they agree to 1e-13 or better; this
leaves room for unlucky cancellation and is far below any wrong term, which is of order 1."""
DIFFERENCES = 1e-9
"""One side is a derivative by differences of order six (see `twistwrench.testing.differences`), good to some 1e-12 of the
function; this leaves the same room."""

ONE_DEGREE = ("revolute", "continuous", "prismatic", "helical", "mimic", "fixed")

TREES = {f"tree{seed}": {"rng": seed, "floating_base": seed % 3 == 0} for seed in range(12)}
TREES |= {kind: {"rng": 100, "joints": 4, "kinds": (kind,)} for kind in JOINT_KINDS}
SIMPLE_TREES = {f"one_degree{seed}": {"rng": seed, "joints": 6, "kinds": ONE_DEGREE} for seed in range(8)}


@cache
def tree(name):
    return random_robot(**(TREES | SIMPLE_TREES)[name])


def frames(robot, count=3):
    """A few frames, the deepest among them."""
    return robot.frame_names[:: -max(1, len(robot.frame_names) // count)]


def body_poses(robot, q):
    """T_s,body for each body: its frame is that of the link its joint carries."""
    names = {f.body: n for n, f in robot.model.frames.items() if f.body != BASE and np.array_equal(f.pose, np.eye(4))}
    return [robot.forward_kinematics(q, names[i]) for i in range(len(robot.model.bodies))]
