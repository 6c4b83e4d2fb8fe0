"""Robots on legs whose base is held in the air: a rule on the geometry of the neutral configuration.

A file without a statement about its base fixes it. Torques of a legged robot are then those of a robot that hangs, which differ
from those of one that stands.

Geometry cannot tell two arms under a ceiling from two legs, so that both are held in the air: their torques are right only if
something holds the base, which the user states.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ...core.gravity import GRAVITY, vertical_axis
from ...core.typing import Array
from .edit import lock, with_gravity
from .model import BASE, Model

LEVEL = 0.05
"""Height difference of the lowest frames of two legs, as a share of the robot's size."""
DROP = 0.3
"""Least height of the base above the lowest frames of the legs, as a share of the robot's size. Among 140 files, the least of
legged robots is 0.41, and the largest of others with two such branches, an upper body on a stand, 0.23."""
WIDTH = 0.05
"""Least width of the support polygon of three legs or more, as a share of the robot's size; fingers in a row have less."""
FEWEST, FEWEST_FLAT = 2, 4
"""Least number of joints of a leg, and of legs that lie flat around the base."""
ALIKE = 0.1
"""Relative difference of the masses of legs that lie flat: fingers differ from their thumb by more."""
OUTWARD = 0.05
"""Least distance by which the end of a leg that lies flat is farther out than its hip, as a share of the robot's size."""
PARALLEL = 0.99
"""Cosine from which two axes are parallel."""
HEAVY = 0.01
"""Share of the robot's mass from which a link counts for its size; lighter ones may be parked anywhere."""
_WORLD = "world"
"""Link that stands for the world; it is not a part of the robot."""

Chain = tuple[int, ...]


@dataclass(frozen=True)
class HangingBase:
    """Base of a legged robot that nothing is stated to hold."""

    link: str
    """Heaviest link of the base."""
    legs: tuple[Chain, ...]
    """Indices of the bodies of each leg, from the base outward."""


def hanging_base(model: Model) -> HangingBase | None:
    """Base held in the air by nothing that the file or the user states; None for other robots.

    Legs are branches of two or more joints, and one of these holds:

    * At least two reach the lowest frames of the robot, well below everything that is fixed to the root. Their support polygon
      is not a line: fingers in a row, and branches that move in one common vertical plane, fall over.
    * The same along another axis of the base, in a file whose height is not along gravity, if a heavier branch reaches the
      other way, as trunk and arm do.
    * At least four are alike and lie flat around the base, outward from their hips.

    Branches joined by loop closures are one mechanism, such as a parallel robot; fingers of a hand at the end of an arm have
    fewer joints than lead to them.

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
    return _base_on_legs(model)


def legs_of(model: Model) -> tuple[tuple[str, ...], ...]:
    """Links of each leg, from the base outward; empty if the robot does not look legged, whatever holds its base.

    Examples
    --------
    >>> import twistwrench as tw
    >>> legs_of(tw.robots.ur5().model), [leg[-1] for leg in legs_of(tw.robots.quadruped().model)]
    ((), ['FL_foot', 'FR_foot', 'RL_foot', 'RR_foot'])
    """
    roots = [body.joint.name for body in model.bodies if body.parent == BASE and not body.joint.driven]
    if roots:
        model = lock(model, {name: _neutral(model, name) for name in roots})
    if not model.gravity.any():
        model = with_gravity(model, GRAVITY)
    found = _base_on_legs(model)
    if found is None:
        return ()
    links = _chains(model)
    return tuple(tuple(links[leg]) for leg in found.legs)


def _neutral(model: Model, joint: str) -> Array:
    body = next(body for body in model.leaders if body.joint.name == joint)
    return np.asarray(model.neutral[body.places[0]])


def _base_on_legs(model: Model) -> HangingBase | None:
    stance = _Stance(model)
    up = vertical_axis(model.gravity)
    up = up if model.gravity @ up <= 0.0 else -up
    legs = stance.lowest(up) or stance.lying(up) or stance.flat(up)
    if not legs:
        return None
    heaviest = max(stance.base, key=lambda name: model.link_inertias[name].mass)
    return HangingBase(heaviest, tuple(sorted(legs)))


class _Stance:
    """Places of bodies and links in the neutral configuration, in the base frame."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self.poses = _body_poses(model, model.neutral)
        self.places = {name: pose[:3, 3] for name, pose in frame_poses(model, model.neutral).items()}
        self.base = _base_links(model)
        self.chains = _chains(model)
        whole = model.moving_mass + model.base_inertia.mass
        heavy = [place for name, place in self.places.items() if model.link_inertias[name].mass > HEAVY * whole]
        self.size = float(np.linalg.norm(np.ptp(heavy or list(self.places.values()), axis=0)))
        """Diagonal of the box around the frames of heavy links [m]."""

    def heights(self, names: Sequence[str], up: Array) -> Array:
        """Heights (k,) of link frames along ``up``."""
        return np.array([self.places[name] @ up for name in names])

    def lowest(self, up: Array) -> set[Chain]:
        """Branches that reach the lowest frames, well below the base, with a support polygon that is not a line."""
        low = {chain: float(self.heights(names, up).min()) for chain, names in self.chains.items()}
        ground = min(low.values(), default=np.inf)
        if not self.base or not self.heights(self.base, up).min() - ground > DROP * self.size:
            return set()
        near = [chain for chain in low if low[chain] <= ground + LEVEL * self.size]
        legs = {leg for pair in combinations(near, 2) if _are_legs(self.model, *pair) for leg in pair}
        return set() if not legs or self._fall_over(legs, up) else legs

    def _fall_over(self, legs: set[Chain], up: Array) -> bool:
        """True if three legs or more end in one line, or all joints of two turn about the normal of the plane through both."""
        ends = np.array([self._end(leg, up) for leg in sorted(legs)])
        flat = ends - np.outer(ends @ up, up)
        _, _, directions = np.linalg.svd(flat - flat.mean(axis=0))
        normal = np.cross(up, directions[0])
        if len({leg[0] for leg in legs}) > FEWEST:
            return bool(np.ptp(flat @ normal) < WIDTH * self.size)
        axes = [self._axis(body) for leg in legs for body in leg]
        return all(axis is not None and abs(axis @ normal) > PARALLEL for axis in axes)

    def _end(self, leg: Chain, up: Array) -> Array:
        names = self.chains[leg]
        return self.places[names[int(self.heights(names, up).argmin())]]

    def _axis(self, body: int) -> Array | None:
        """Unit vector along the axis of a body's hinge; None for other joints."""
        joint = self.model.bodies[body].joint
        if joint.nv != 1 or not joint.turning[0]:
            return None
        axis = self.poses[body][:3, :3] @ joint.axes[0, :3]
        return np.asarray(axis / np.linalg.norm(axis))

    def lying(self, up: Array) -> set[Chain]:
        """Long legs of a robot whose height is not along gravity; a heavier branch, as trunk and arm, reaches the other way."""
        for way in (*np.eye(3), *-np.eye(3)):
            legs = self.lowest(way) if abs(way @ up) < PARALLEL else set()
            if len({leg[0] for leg in legs}) < FEWEST:
                continue
            length = min(float((self.poses[leg[0]][:3, 3] - self._end(leg, way)) @ way) for leg in legs)
            top = float(self.heights(self.base, way).max()) + DROP * self.size
            others = [c for c, names in self.chains.items() if c not in legs and self.heights(names, way).max() > top]
            if length > DROP * self.size and max(map(self._mass, others), default=0.0) > max(map(self._mass, legs)):
                return legs
        return set()

    def _mass(self, chain: Chain) -> float:
        return sum(self.model.bodies[body].inertia.mass for body in chain)

    def flat(self, up: Array) -> set[Chain]:
        """Four branches or more that are alike and lie around the base, outward from their hips and no higher than it."""
        if not self.base:
            return set()
        top = float(self.heights(self.base, up).max()) + LEVEL * self.size
        outward = [c for c, names in self.chains.items() if len(c) >= FEWEST and self.heights(names, up).max() <= top]
        outward = [chain for chain in outward if self._reach(chain, up)[1] > OUTWARD * self.size]
        masses = {chain: self._mass(chain) for chain in outward}
        for first in outward:
            same = {
                c for c in outward if len(c) == len(first) and abs(masses[c] - masses[first]) <= ALIKE * masses[first]
            }
            if len({chain[0] for chain in same}) >= FEWEST_FLAT and self._surround(same, up):
                pairs = combinations(sorted(same), 2)
                return same if all(_are_legs(self.model, *pair) for pair in pairs) else set()
        return set()

    def _reach(self, chain: Chain, up: Array) -> tuple[Array, float]:
        """Horizontal vector from the base to a branch's first joint, and how much farther out its farthest frame is."""
        centre = self._centre()
        across = np.eye(3) - np.outer(up, up)
        hip = across @ (self.poses[chain[0]][:3, 3] - centre)
        ends = [float(np.linalg.norm(across @ (self.places[name] - centre))) for name in self.chains[chain]]
        return hip, max(ends) - float(np.linalg.norm(hip))

    def _centre(self) -> Array:
        """Centre of the base's mass, or of its frames if it has none."""
        base = self.model.base_inertia
        return np.asarray(base.com) if base.mass > 0.0 else np.mean([self.places[name] for name in self.base], axis=0)

    def _surround(self, legs: set[Chain], up: Array) -> bool:
        """True if the base's centre is inside the polygon of the hips: no half-plane through it is without one."""
        hips = np.array([self._reach(leg, up)[0] for leg in sorted(legs)])
        one = np.linalg.svd(up[None])[2][1]
        angles = np.sort(np.arctan2(hips @ np.cross(up, one), hips @ one))
        return bool(np.diff(angles, append=angles[0] + 2 * np.pi).max() < np.pi)


def _base_links(model: Model) -> list[str]:
    """Links fixed to the root that have mass or a shape; all of them if none has."""
    still = [name for name, frame in model.frames.items() if frame.body == BASE and name != _WORLD]
    return [name for name in still if name in model.shaped or model.link_inertias[name].mass > 0] or still


def frame_poses(model: Model, q: Array) -> dict[str, Array]:
    """Poses (4, 4) of all links in the base frame at one configuration, without a compiled kernel.

    Examples
    --------
    >>> import twistwrench as tw
    >>> arm = tw.robots.planar_2r()
    >>> bool(np.allclose(frame_poses(arm.model, np.array([0.3, 0.4]))["tip"], arm.forward_kinematics([0.3, 0.4])))
    True
    """
    bodies = _body_poses(model, q)
    return {
        name: np.asarray(frame.pose if frame.body == BASE else bodies[frame.body] @ frame.pose)
        for name, frame in model.frames.items()
    }


def _body_poses(model: Model, q: Array) -> list[Array]:
    """Pose of each body in the base frame."""
    poses = list[Array]()
    for body in model.bodies:
        mine = q[body.places[0]]
        mine = body.ratio * mine + body.offset if body.follows else mine
        T = np.asarray(body.placement @ body.joint.pose(mine), float)
        poses.append(T if body.parent == BASE else poses[body.parent] @ T)
    return poses


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
