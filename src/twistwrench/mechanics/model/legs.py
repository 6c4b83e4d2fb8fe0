"""Robots on legs whose base is held in the air: a rule on the geometry of the neutral configuration.

A file without a statement about its base fixes it. Torques of a legged robot are then those of a robot that hangs, which differ
from those of one that stands.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ...core.typing import Array
from .model import BASE, Frame, Model

LEVEL = 0.05
"""Height difference of the lowest frames of two legs, as a share of the robot's size."""
DROP = 0.3
"""Least height of the base above the lowest frames of the legs, as a share of the robot's size. Among 140 files, the least of
legged robots is 0.41, and the largest of others with two such branches, an upper body on a stand, 0.23."""
FEWEST = 2
"""Least number of joints of a leg."""
HEAVY = 0.01
"""Share of the robot's mass from which a link counts for its size; lighter ones may be parked anywhere."""
_WORLD = "world"
"""Link that stands for the world; it is not a part of the robot."""


@dataclass(frozen=True)
class HangingBase:
    """Base of a legged robot that nothing is stated to hold."""

    link: str
    """Heaviest link of the base."""
    legs: tuple[tuple[int, ...], ...]
    """Indices of the bodies of each leg, from the base outward."""


def hanging_base(model: Model) -> HangingBase | None:
    """Base held in the air by nothing that the file or the user states; None for other robots.

    At least two branches of two or more joints reach the lowest frames of the robot, well below everything that is fixed to
    the root. Branches joined by loop closures are one mechanism, such as a parallel robot; fingers of a hand at the end of an
    arm have fewer joints than lead to them.

    Examples
    --------
    >>> import twistwrench as tw
    >>> hanging_base(tw.robots.ur5().model), hanging_base(tw.robots.quadruped().model)
    (None, None)
    >>> file = tw.robots.path_of("quadruped")
    >>> hanging_base(tw.load(file).model).link, hanging_base(tw.load(file, floating_base=False).model)
    ('trunk', None)
    """
    strength = float(np.linalg.norm(model.gravity))
    if model.mounted or not strength or any(b.parent == BASE and not b.joint.driven for b in model.bodies):
        return None
    heights, size = _heights_and_size(model, -model.gravity / strength)
    base = _base_links(model)
    chains = {chain: min(heights[name] for name in names) for chain, names in _chains(model).items()}
    lowest = min(chains.values(), default=np.inf)
    if not base or not min(heights[name] for name in base) - lowest > DROP * size:
        return None
    near = [chain for chain, low in chains.items() if low <= lowest + LEVEL * size]
    legs = {leg for pair in combinations(near, 2) if _are_legs(model, *pair) for leg in pair}
    if not legs:
        return None
    heaviest = max(base, key=lambda name: model.link_inertias[name].mass)
    return HangingBase(heaviest, tuple(sorted(legs)))


def _base_links(model: Model) -> list[str]:
    """Links fixed to the root that have mass or a shape; all of them if none has."""
    still = [name for name, frame in model.frames.items() if frame.body == BASE and name != _WORLD]
    return [name for name in still if name in model.shaped or model.link_inertias[name].mass > 0] or still


def _heights_and_size(model: Model, up: Array) -> tuple[dict[str, float], float]:
    """Height of each link frame in the neutral configuration, and diagonal of the box around the frames of heavy links."""
    poses = _body_poses(model)
    places = {name: _placed(poses, frame) for name, frame in model.frames.items()}
    whole = model.moving_mass + model.base_inertia.mass
    heavy = [place for name, place in places.items() if model.link_inertias[name].mass > HEAVY * whole]
    size = float(np.linalg.norm(np.ptp(heavy or list(places.values()), axis=0)))
    return {name: float(place @ up) for name, place in places.items()}, size


def _body_poses(model: Model) -> list[Array]:
    """Pose of each body in the base frame, in the neutral configuration."""
    q, poses = model.neutral, list[Array]()
    for body in model.bodies:
        mine = q[body.places[0]]
        mine = body.ratio * mine + body.offset if body.follows else mine
        T = np.asarray(body.placement @ body.joint.pose(mine), float)
        poses.append(T if body.parent == BASE else poses[body.parent] @ T)
    return poses


def _placed(poses: Sequence[Array], frame: Frame) -> Array:
    T = frame.pose if frame.body == BASE else poses[frame.body] @ frame.pose
    return np.asarray(T[:3, 3])


def _chains(model: Model) -> Mapping[tuple[int, ...], list[str]]:
    """Bodies from the base to each last body, with the links on them."""
    moving = [i for i, body in enumerate(model.bodies) if body.joint.moves_body]
    last = set(moving) - {model.bodies[i].parent for i in moving}
    chains = [tuple(_chain(model, i))[::-1] for i in sorted(last)]
    links: dict[int, list[str]] = {}
    for name, frame in model.frames.items():
        links.setdefault(frame.body, []).append(name)
    named = {chain: [name for body in chain for name in links.get(body, ())] for chain in chains}
    return {chain: names for chain, names in named.items() if names}


def _chain(model: Model, body: int) -> Iterator[int]:
    while body != BASE:
        yield body
        body = model.bodies[body].parent


def _are_legs(model: Model, one: tuple[int, ...], other: tuple[int, ...]) -> bool:
    """True if two chains part near the base, have enough joints of their own, and no loop joins them."""
    shared = len(set(one) & set(other))
    least = max(FEWEST, shared)
    own = set(one[shared:]), set(other[shared:])
    return min(map(len, own)) >= least and not _joined(model, *own)


def _joined(model: Model, one: set[int], other: set[int]) -> bool:
    """True if loop closures of the file join two branches, directly or by others, or hold one of them to the base."""
    children = Counter(body.parent for body in model.bodies if body.joint.moves_body)
    loops = [_tail(model, c.frame_a, children) | _tail(model, c.frame_b, children) for c in model.closures.values()]
    first, second = _reached(one, loops), _reached(other, loops)
    return bool(first & other) or BASE in first | second


def _reached(start: set[int], loops: Sequence[set[int]]) -> set[int]:
    """Bodies that loop closures join to those of ``start``, directly or by others."""
    reached, before = set(start), 0
    while before != len(reached):
        before = len(reached)
        for loop in loops:
            reached |= loop if loop & reached else set()
    return reached


def _tail(model: Model, frame: str, children: Mapping[int, int]) -> set[int]:
    """Bodies from a frame's body inward, up to the first that carries several; the base for a frame on it."""
    found = set[int]()
    for body in _chain(model, model.all_frames[frame].body):
        if found and children[body] > 1:
            break
        found.add(body)
    return found or {BASE}
