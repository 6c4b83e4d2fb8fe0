"""Random trees for the tests of laws, and the tolerances they argue with."""

from __future__ import annotations

import numpy as np
from shared_robots import shared

from twistwrench.mechanics.joints import JOINT_TYPES
from twistwrench.mechanics.model.model import BASE
from twistwrench.testing import random_robot

ROUNDING = 1e-11
"""Both sides are some thousand float64 operations on numbers of one size, 1e-16 each, so they agree to 1e-13 or better; this
leaves room for unlucky cancellation and is far below any wrong term, which is of order 1."""
DIFFERENCES = 1e-9
"""One side is a derivative by differences of order six (see `twistwrench.testing`), good to some 1e-12 of the
function; this leaves the same room."""

ONE_DEGREE = ("revolute", "continuous", "prismatic", "helical", "mimic", "fixed")

TREES = {f"tree{seed}": {"rng": seed, "floating_base": seed % 3 == 0} for seed in range(12)}
TREES |= {kind: {"rng": 100, "joints": 4, "kinds": (kind,)} for kind in JOINT_TYPES}
SIMPLE_TREES = {f"one_degree{seed}": {"rng": seed, "joints": 6, "kinds": ONE_DEGREE} for seed in range(8)}


DRIVEN = {f"driven{seed}": {"rng": seed, "joints": 5, "floating_base": seed == 0} for seed in range(3)}
UNDRIVEN = tuple(TREES)
"""Those all of whose bodies are links: where a test looks for bodies by their links, or by how their frames turn."""
TREES |= DRIVEN


@shared
def tree(name):
    robot = random_robot(**(TREES | SIMPLE_TREES)[name])
    return driven(robot, TREES[name]["rng"]) if name in DRIVEN else robot


def driven(robot, seed, **more):
    """The robot with a rotor for every one-degree joint, on a link and an axis of any kind; ``more`` is in each entry."""
    rng = np.random.default_rng(seed)
    entries = {}
    for body in robot.model.leaders:
        if body.joint.nv == 1:
            rotor = {
                "inertia": f"{rng.uniform(1, 10):.3f} kg cm^2",
                "extra": True,
                "mass": f"{rng.uniform(0.1, 1):.3f} kg",
            }
            rotor |= {"place": [f"{x:.3f} m" for x in rng.uniform(-0.2, 0.2, 3)]}
            if rng.random() < 0.5:
                rotor |= {"link": str(rng.choice(robot.link_names)), "axis": rng.normal(size=3).tolist()}
            entries[body.joint.name] = {"ratio": float(rng.uniform(-100, 100)), "rotor": rotor, **more}
    return robot.with_actuators({"actuators": entries})


def frames(robot, count=3):
    """A few frames, the deepest among them."""
    return robot.frame_names[:: -max(1, len(robot.frame_names) // count)]


def body_poses(robot, q):
    """T_s,body for each body: its frame is that of the link its joint carries."""
    names = {f.body: n for n, f in robot.model.frames.items() if f.body != BASE and np.array_equal(f.pose, np.eye(4))}
    poses = [robot.forward_kinematics(q, names[i]) for i in range(len(robot.model.bodies)) if i in names]
    for body in robot.model.bodies[len(poses) :]:  # rotors, which come last and do not turn their frames
        poses.append((poses[body.parent] if body.parent != BASE else np.eye(4)) @ body.placement)
    return poses
