"""Mechanisms with several branches, legged and others: what the rule on hanging bases must tell apart."""

from __future__ import annotations

import numpy as np

import twistwrench as tw
from twistwrench.mechanics.lie import so3
from twistwrench.mechanics.model.builder import ModelBuilder
from twistwrench.mechanics.model.model import OfferedClosure
from twistwrench.robot import Robot


def turned(angle, axis=(0.0, 1.0, 0.0)):
    """Rotation about an axis."""
    return so3.exp(np.asarray(axis, float) * angle)


def placed(R=None, p=(0.0, 0.0, 0.0)):
    """Pose of a rotation and a position."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = np.eye(3) if R is None else R, p
    return T


def branched(branches, *, base=5.0, turn=None, world=False, mass=1.0, closed=()):
    """Robot of a base and branches ``(place, heading, steps)``: a joint about y at each step (dx, dz) along the heading.

    ``turn`` rotates the whole, ``world`` fixes it to the world by a joint, ``closed`` pairs of branches share their last point.
    """
    builder = ModelBuilder("made")
    builder.gravity = (turned(0.0) if turn is None else turn).T @ [0.0, 0.0, -9.81]
    builder.add_link("base", tw.SpatialInertia.box([0.2, 0.2, 0.1], mass=base), shaped=True)
    for k, (place, heading, steps) in enumerate(branches):
        carrier, T = "base", placed(turned(heading, (0, 0, 1)), place)
        for n, (dx, dz) in enumerate(steps):
            name = f"branch{k}_{n}"
            builder.add_link(name, tw.SpatialInertia.from_com(mass, [dx / 2, 0, dz / 2], np.eye(3) * 0.01 * mass))
            builder.add_joint(f"joint{k}_{n}", "revolute", carrier, name, axis=(0, 1, 0), placement=T)
            carrier, T = name, placed(p=(dx, 0.0, dz))
        builder.add_link(f"end{k}", shaped=not steps)
        builder.add_joint(f"to_end{k}", "fixed", carrier, f"end{k}", placement=T)
    for a, b in closed:
        builder.add_closure(f"loop{a}{b}", OfferedClosure(f"end{a}", f"end{b}", "vx vy vz"))
    if world:
        builder.mount()
    return Robot(builder.build(quiet=True))


def around(count, radius, steps):
    """Branches spread evenly around the vertical, pointing outward."""
    angles = 2 * np.pi * np.arange(count) / count
    return [((radius * np.cos(a), radius * np.sin(a), 0.0), a, steps) for a in angles]


DOWN = [(0.0, -0.02), (0.0, -0.4), (0.0, -0.4)]
KNEE = [(0.0, -0.02), (-0.1, -0.2), (0.1, -0.2)]
FINGER = [(0.04, 0.0), (0.03, 0.0), (0.03, 0.0)]
HAND = [((0.05, y, 0.0), 0.0, FINGER) for y in (-0.03, 0.0, 0.03)] + [((0.0, 0.05, 0.0), 0.6, FINGER)]
ARM = [(0.0, -0.1), (0.0, -0.3), (0.0, -0.3), (0.0, -0.1)]
SIX_WAYS = {
    "forward": turned(0.0), "back": turned(np.pi), "up": turned(-np.pi / 2), "down": turned(np.pi / 2),
    "left": turned(np.pi / 2, (0, 0, 1)), "right": turned(-np.pi / 2, (0, 0, 1)),
}  # fmt: skip
"""Headings of a hand's fingers."""
POST = ((0.0, 0.0, -0.9), 0.0, [])


def sprawling(angle):
    """A hexapod whose legs go down by an angle."""
    leg = [(0.05, 0.0), (0.15 * np.cos(angle), -0.15 * np.sin(angle)), (0.1 * np.cos(angle), -0.2 * np.sin(angle))]
    return branched(around(6, 0.1, leg), mass=0.2)


def gripper_arm():
    """An arm that hangs down, with two fingers of two joints."""
    builder = ModelBuilder("arm")
    builder.add_link("base", tw.SpatialInertia.from_com(5.0, moment_about_com=np.eye(3)), shaped=True)
    body = tw.SpatialInertia.from_com(1.0, moment_about_com=np.eye(3) * 0.01)
    carrier = "base"
    for n in range(5):
        builder.add_link(f"link{n}", body)
        builder.add_joint(
            f"joint{n}", "revolute", carrier, f"link{n}", axis=(0, 1, 0), placement=placed(p=(0, 0, -0.2))
        )
        carrier = f"link{n}"
    for side in (-1, 1):
        above = carrier
        for n in range(2):
            name = f"finger{side}{n}"
            builder.add_link(name, body)
            builder.add_joint(
                f"to_{name}", "revolute", above, name, axis=(1, 0, 0), placement=placed(p=(0, side * 0.05, -0.1))
            )
            above = name
    return Robot(builder.build(quiet=True))


LEGGED = {
    "biped": lambda: branched([((0, y, 0), 0.0, DOWN) for y in (-0.1, 0.1)]),
    "dog with knees": lambda: branched([((x, y, 0), 0.0, KNEE) for x in (-0.25, 0.25) for y in (-0.1, 0.1)]),
    "tripod": lambda: branched(around(3, 0.2, DOWN)),
    "biped lying in its file": lambda: branched(
        [((0, y, 0), 0.0, [(0.02, 0.0), (0.4, 0.0), (0.4, 0.0)]) for y in (-0.1, 0.1)], turn=turned(np.pi / 2)
    ),
    "spider at 45 degrees": lambda: sprawling(np.pi / 4),
    "spider at 70 degrees": lambda: sprawling(np.radians(70)),
    "spider with its legs flat": lambda: sprawling(0.0),
    "humanoid lying in its file": lambda: branched(
        [((0, y, 0), 0.0, [(0.02, 0.0), (0.4, 0.0), (0.4, 0.0)]) for y in (-0.1, 0.1)]
        + [((0, y, 0), np.pi, [(0.3, 0.0), (0.3, 0.0), (0.3, 0.0), (0.3, 0.0)]) for y in (-0.2, 0.2)]
    ),
    "centaur with arms": lambda: branched(
        [((x, y, 0), 0.0, DOWN) for x in (-0.3, 0.3) for y in (-0.1, 0.1)]
        + [((0.4, y, 0.4), 0.0, [(0.3, 0.0), (0.3, 0.0)]) for y in (-0.2, 0.2)]
    ),
    "ostrich with toes at one height": lambda: branched(
        [((0, y, 0), 0.0, [(0.0, -0.02), (0.2, -0.3), (-0.3, -0.4), (0.1, -0.02)]) for y in (-0.15, 0.15)]
    ),
}
"""Robots that stand on their branches."""
OTHERS = {
    "delta, closed": lambda: branched(
        around(3, 0.2, [(0.2, -0.05), (-0.3, -0.6)]), closed=((0, 1), (0, 2))
    ),
    "delta under a joint to the world": lambda: branched(around(3, 0.2, [(0.2, -0.05), (-0.3, -0.6)]), world=True),
    "hexapod table, closed": lambda: branched(
        around(6, 0.3, [(0.0, 0.0), (0.0, 0.5)]), closed=tuple((0, k) for k in range(1, 6))
    ),
    "hexapod table upside down, closed": lambda: branched(
        around(6, 0.3, [(0.0, 0.0), (0.0, -0.5)]), closed=tuple((k, k + 1) for k in range(5))
    ),
    "pair of arms on a post": lambda: branched([((0, y, 0), 0.0, ARM) for y in (-0.3, 0.3)] + [POST]),
    "pair of arms on a ceiling, mounted": lambda: branched([((0, y, 0), 0.0, ARM) for y in (-0.3, 0.3)], world=True),
    "arm on a ceiling": lambda: branched([((0, 0, 0), 0.0, [*ARM, *DOWN])]),
    "arm on a ceiling with fingers": gripper_arm,
    "one leg": lambda: branched([((0, 0, 0), 0.0, DOWN)]),
    "swerve cart": lambda: branched([((x, y, -0.05), 0.0, [(0.0, -0.05), (0.0, 0.0)]) for x in (-0.4, 0.4) for y in (-0.3, 0.3)]),
    "excavator": lambda: branched([((0.5, 0, 0.5), 0.0, [(2.0, 1.0), (1.5, -1.0), (0.3, -0.5)]), ((0, 0, -0.8), 0.0, [])]),
    "pair of cranes": lambda: branched([((x, 0, 0.2), 0.0, [(0.5, 2.0), (1.0, -1.9)]) for x in (-1.0, 1.0)] + [((0, 0, -0.5), 0, [])]),
    "tree of arms": lambda: branched(around(3, 0.2, [(0.1, 0.3), (0.1, 0.3), (0.1, 0.1)])),
    "lamps on a ceiling, mounted": lambda: branched(around(4, 0.2, DOWN), world=True),
} | {
    f"hand, fingers {way}": lambda R=R: branched(HAND, base=0.4, mass=0.05, turn=R)
    for way, R in SIX_WAYS.items()
} | {
    "three fingers of one length, down": lambda: branched(
        [((0.05, y, 0.0), 0.0, FINGER) for y in (-0.03, 0.0, 0.03)], base=0.4, mass=0.05, turn=SIX_WAYS["down"]
    ),
    "planar gripper of two fingers": lambda: branched([((x, 0, 0), 0.0, DOWN) for x in (-0.2, 0.2)]),
    "planar gripper of three fingers": lambda: branched([((x, 0, 0), 0.0, DOWN) for x in (-0.2, 0.0, 0.2)]),
    "four arms on a post": lambda: branched(around(4, 0.2, [(0.1, 0.3), (0.1, 0.3), (0.1, 0.1)])),
    "four-armed carrier of rotors": lambda: branched(around(4, 0.1, [(0.2, 0.0)])),
}  # fmt: skip
"""Mechanisms that do not stand on their branches."""
ALIKE = {
    "delta, its loops cut open": lambda: branched(around(3, 0.2, [(0.2, -0.05), (-0.3, -0.6)])),
    "pair of arms on a ceiling": lambda: branched([((0, y, 0), 0.0, ARM) for y in (-0.3, 0.3)]),
}
"""Mechanisms with the geometry of a legged robot, and without a statement about their base."""
