"""Robots on legs whose base is held in the air: a rule on the geometry of the neutral configuration.

If a file states nothing about its base, the base is fixed. A legged robot then has the torques of a robot that hangs, which
differ from the torques of a robot that stands.

Geometry cannot tell two arms under a ceiling from two legs, so the rule holds for both. Their torques are right only if the
user states that something holds the base.
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
from .model import BASE, Body, Model

MAX_HEIGHT_DIFFERENCE = 0.05
"""Largest height difference of the lowest frames of two legs, as a share of the robot's size."""
MIN_BASE_HEIGHT = 0.3
"""Least height of the base above the lowest frames of the legs, as a share of the robot's size.

Among 140 files, the legged robots have at least 0.41. Other robots with two such branches have at most 0.23, an upper body on a
stand.
"""
MIN_POLYGON_WIDTH = 0.05
"""Least width of the support polygon of three legs or more, as a share of the robot's size; fingers in a row have less."""
MIN_JOINTS_OF_LEG = 2
"""Least number of joints of a leg."""
MIN_FLAT_LEGS = 4
"""Least number of legs that lie flat around the base."""
MAX_MASS_DIFFERENCE = 0.1
"""Largest relative difference of the masses of legs that lie flat: fingers differ from their thumb by more."""
MIN_OUTWARD_REACH = 0.05
"""Least distance by which the end of a leg that lies flat is farther out than its hip, as a share of the robot's size."""
MIN_PARALLEL_COSINE = 0.99
"""Least cosine of the angle between two axes that count as parallel."""
MIN_SHARE_OF_MASS = 0.01
"""Least mass of a link that counts for the robot's size, as a share of the robot's mass; files place lighter links anywhere."""
_WORLD = "world"
"""Link that stands for the world; it is not a part of the robot."""

Chain = tuple[int, ...]
"""Indices of the bodies of a branch, from the base outward."""


@dataclass(frozen=True)
class HangingBase:
    """Base of a legged robot without a statement that something holds it."""

    link: str
    """Heaviest link of the base."""
    legs: tuple[Chain, ...]
    """Indices of the bodies of each leg, from the base outward."""


def hanging_base(model: Model) -> HangingBase | None:
    """Base of a robot on legs if neither the file nor the user states what holds it; None for other robots.

    Legs are branches of two or more joints for which one of these rules holds:

    * At least two branches reach the lowest frames of the robot, well below everything that is fixed to the root. Their support
      polygon is not a line: fingers in a row, and branches that move in one common vertical plane, fall over.
    * The first rule holds along another axis of the base, because the file's height is not along gravity. A heavier branch must
      reach the other way, as trunk and arm do.
    * At least four branches are alike and lie flat around the base, outward from their hips.

    Branches joined by loop closures are one mechanism, such as a parallel robot. Fingers of a hand on an arm are not legs: a
    finger has fewer joints than the arm before it.

    Examples
    --------
    >>> import twistwrench as tw
    >>> hanging_base(tw.robots.ur5().model), hanging_base(tw.robots.quadruped().model)
    (None, None)
    >>> file = tw.robots.path_of("quadruped")
    >>> hanging_base(tw.load(file).model).link, hanging_base(tw.load(file, floating_base=False).model)
    ('trunk', None)
    """
    if model.mounted or not model.gravity.any() or _bodies_on_free_roots(model):
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
    roots = _bodies_on_free_roots(model)
    if roots:
        positions: dict[str, Array] = {}
        for body in roots:
            coordinates, _ = body.places
            positions[body.joint.name] = model.neutral[coordinates]
        model = lock(model, positions)
    if not model.gravity.any():
        model = with_gravity(model, GRAVITY)
    hanging = _base_on_legs(model)
    if hanging is None:
        return ()
    links = _chains(model)
    return tuple(tuple(links[leg]) for leg in hanging.legs)


def _bodies_on_free_roots(model: Model) -> list[Body]:
    """Bodies that a joint without a drive, such as a floating one, connects to the base frame."""
    return [body for body in model.bodies if body.parent == BASE and not body.joint.driven]


def _base_on_legs(model: Model) -> HangingBase | None:
    """Base and legs by the rules of :func:`hanging_base`, whatever holds the base; None for robots without legs."""
    stance = _Stance(model)
    up = vertical_axis(model.gravity)
    if model.gravity @ up > 0.0:  # the axis points down
        up = -up
    legs = stance.lowest_branches(up) or stance.sideways_branches(up) or stance.flat_branches(up)
    if not legs:
        return None
    heaviest = max(stance.base, key=lambda name: model.link_inertias[name].mass)
    return HangingBase(heaviest, tuple(sorted(legs)))


class _Stance:
    """Positions of bodies and links in the neutral configuration, in the base frame."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self.poses = _body_poses(model, model.neutral)
        self.positions = {name: pose[:3, 3] for name, pose in frame_poses(model, model.neutral).items()}
        """Positions (3,) of the frames of links [m]."""
        self.base = _base_links(model)
        self.chains = _chains(model)
        min_mass = MIN_SHARE_OF_MASS * (model.moving_mass + model.base_inertia.mass)
        heavy_links = [name for name in self.positions if model.link_inertias[name].mass > min_mass]
        sized_links = heavy_links or list(self.positions)
        box_edges = np.ptp(self.positions_of(sized_links), axis=0)
        self.size = float(np.linalg.norm(box_edges))
        """Diagonal of the box around the frames of heavy links [m]."""

    def positions_of(self, names: Sequence[str]) -> Array:
        """Positions (k, 3) of link frames."""
        return np.array([self.positions[name] for name in names]).reshape(-1, 3)

    def heights(self, names: Sequence[str], up: Array) -> Array:
        """Heights (k,) of link frames along ``up``."""
        return np.array([self.positions[name] @ up for name in names])

    def lowest_branches(self, up: Array) -> set[Chain]:
        """Branches that reach the lowest frames, well below the base, with a support polygon that is not a line."""
        if not self.base or not self.chains:
            return set()
        lowest_heights = {chain: float(self.heights(names, up).min()) for chain, names in self.chains.items()}
        ground_height = min(lowest_heights.values())
        base_height = self.heights(self.base, up).min() - ground_height
        if base_height <= MIN_BASE_HEIGHT * self.size:
            return set()
        max_height = ground_height + MAX_HEIGHT_DIFFERENCE * self.size
        on_ground = [branch for branch, height in lowest_heights.items() if height <= max_height]
        legs = set[Chain]()
        for pair in combinations(on_ground, 2):
            if _are_legs(self.model, *pair):
                legs.update(pair)
        if not legs or self._fall_over(legs, up):
            return set()
        return legs

    def _fall_over(self, legs: set[Chain], up: Array) -> bool:
        """True if feet stand in one line, and nothing keeps the robot from falling over that line.

        Three legs or more cannot keep it. Two legs cannot if all their joints turn about the horizontal normal of the line.
        """
        feet = np.array([self._foot(leg, up) for leg in sorted(legs)])
        footprint = feet - np.outer(feet @ up, up)  # horizontal positions
        _, _, directions = np.linalg.svd(footprint - footprint.mean(axis=0))
        along_feet = directions[0]  # direction of the line of best fit
        normal = np.cross(up, along_feet)
        if _hip_count(legs) > 2:
            polygon_width = np.ptp(footprint @ normal)
            return bool(polygon_width < MIN_POLYGON_WIDTH * self.size)
        for leg in legs:
            for body in leg:
                axis = self._axis(body)
                if axis is None or abs(axis @ normal) <= MIN_PARALLEL_COSINE:
                    return False
        return True

    def _foot(self, leg: Chain, up: Array) -> Array:
        """Position of the lowest frame of a leg."""
        names = self.chains[leg]
        lowest = int(self.heights(names, up).argmin())
        return self.positions[names[lowest]]

    def _axis(self, body: int) -> Array | None:
        """Unit vector along the axis of a body's hinge; None for other joints."""
        joint = self.model.bodies[body].joint
        if joint.nv != 1 or not joint.turning[0]:
            return None
        axis = self.poses[body][:3, :3] @ joint.axes[0, :3]
        return np.asarray(axis / np.linalg.norm(axis))

    def sideways_branches(self, up: Array) -> set[Chain]:
        """Long legs of a robot whose height is not along gravity; a heavier branch, as trunk and arm, reaches the other way."""
        for height_axis in (*np.eye(3), *-np.eye(3)):
            if abs(height_axis @ up) >= MIN_PARALLEL_COSINE:
                continue
            legs = self.lowest_branches(height_axis)
            if _hip_count(legs) < 2:
                continue
            lengths = [(self._hip(leg) - self._foot(leg, height_axis)) @ height_axis for leg in legs]
            if min(lengths) <= MIN_BASE_HEIGHT * self.size:
                continue
            base_height = float(self.heights(self.base, height_axis).max())
            min_height = base_height + MIN_BASE_HEIGHT * self.size
            upper_masses: list[float] = []
            for branch, names in self.chains.items():
                if branch not in legs and self.heights(names, height_axis).max() > min_height:
                    upper_masses.append(self._mass(branch))
            if max(upper_masses, default=0.0) > max(map(self._mass, legs)):
                return legs
        return set()

    def _hip(self, chain: Chain) -> Array:
        """Position of a branch's first joint."""
        return np.asarray(self.poses[chain[0]][:3, 3])

    def _mass(self, chain: Chain) -> float:
        return sum(self.model.bodies[body].inertia.mass for body in chain)

    def flat_branches(self, up: Array) -> set[Chain]:
        """Four branches or more that are alike and lie around the base, outward from their hips and no higher than it."""
        if not self.base:
            return set()
        max_height = float(self.heights(self.base, up).max()) + MAX_HEIGHT_DIFFERENCE * self.size
        outward_branches = list[Chain]()
        for chain, names in self.chains.items():
            is_long = len(chain) >= MIN_JOINTS_OF_LEG
            is_low = self.heights(names, up).max() <= max_height
            if is_long and is_low and self._outward_reach(chain, up) > MIN_OUTWARD_REACH * self.size:
                outward_branches.append(chain)
        for branch in outward_branches:
            alike = {other for other in outward_branches if self._are_alike(other, branch)}
            if _hip_count(alike) < MIN_FLAT_LEGS or not self._surround(alike, up):
                continue
            for pair in combinations(sorted(alike), 2):
                if not _are_legs(self.model, *pair):
                    return set()  # these branches surround the base and are one mechanism, so no others are legs
            return alike
        return set()

    def _are_alike(self, chain: Chain, reference: Chain) -> bool:
        """True if two branches have equally many joints and nearly the same mass."""
        reference_mass = self._mass(reference)
        mass_difference = abs(self._mass(chain) - reference_mass)
        return len(chain) == len(reference) and mass_difference <= MAX_MASS_DIFFERENCE * reference_mass

    def _hip_offset(self, chain: Chain, up: Array) -> Array:
        """Horizontal vector from the base's centre to a branch's first joint."""
        horizontal_part = np.eye(3) - np.outer(up, up)
        return np.asarray(horizontal_part @ (self._hip(chain) - self._centre()))

    def _outward_reach(self, chain: Chain, up: Array) -> float:
        """Horizontal distance from the base's centre of a branch's farthest frame, less that of its first joint [m]."""
        horizontal_part = np.eye(3) - np.outer(up, up)
        offsets = (self.positions_of(self.chains[chain]) - self._centre()) @ horizontal_part
        farthest = np.linalg.norm(offsets, axis=1).max()
        return float(farthest - np.linalg.norm(self._hip_offset(chain, up)))

    def _centre(self) -> Array:
        """Centre of the base's mass, or of its frames if it has none."""
        base = self.model.base_inertia
        if base.mass > 0.0:
            return np.asarray(base.com)
        return np.asarray(np.mean(self.positions_of(self.base), axis=0))

    def _surround(self, legs: set[Chain], up: Array) -> bool:
        """True if the base's centre is inside the polygon of the hips: seen from it, neighbours are less than 180° apart."""
        hips = np.array([self._hip_offset(leg, up) for leg in sorted(legs)])
        _, _, directions = np.linalg.svd(up[None])
        x_axis = directions[1]  # some horizontal unit vector; directions[0] is along ``up``
        y_axis = np.cross(up, x_axis)
        angles = np.sort(np.arctan2(hips @ y_axis, hips @ x_axis))
        angles_between_neighbours = np.diff(angles, append=angles[0] + 2 * np.pi)
        return bool(angles_between_neighbours.max() < np.pi)


def _hip_count(legs: set[Chain]) -> int:
    """Number of first joints; branches that part further out share theirs."""
    return len({leg[0] for leg in legs})


def _base_links(model: Model) -> list[str]:
    """Links fixed to the root that have mass or a shape; all of them if none has."""
    fixed_links = [name for name, frame in model.frames.items() if frame.body == BASE and name != _WORLD]
    real_links = [name for name in fixed_links if name in model.shaped or model.link_inertias[name].mass > 0]
    return real_links or fixed_links


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
    poses: dict[str, Array] = {}
    for name, frame in model.frames.items():
        T = frame.pose
        if frame.body != BASE:
            T = bodies[frame.body] @ T
        poses[name] = np.asarray(T)
    return poses


def _body_poses(model: Model, q: Array) -> list[Array]:
    """Pose of each body in the base frame."""
    poses = list[Array]()
    for body in model.bodies:
        T = np.asarray(body.placement @ body.joint.pose(body.coordinates(q)), float)
        if body.parent != BASE:
            T = poses[body.parent] @ T
        poses.append(T)
    return poses


def _chains(model: Model) -> Mapping[tuple[int, ...], list[str]]:
    """Bodies from the base to each last body, with the links on them; branches without links are left out."""
    moving = [i for i, body in enumerate(model.bodies) if body.joint.moves_body]
    last_bodies = set(moving) - {model.bodies[i].parent for i in moving}
    links_of_body: dict[int, list[str]] = {}
    for name, frame in model.frames.items():
        links_of_body.setdefault(frame.body, []).append(name)
    links_of_chain: dict[Chain, list[str]] = {}
    for last_body in sorted(last_bodies):
        chain = tuple(_inward_chain(model, last_body))[::-1]
        names: list[str] = []
        for body in chain:
            names += links_of_body.get(body, [])
        if names:
            links_of_chain[chain] = names
    return links_of_chain


def _inward_chain(model: Model, body: int) -> Iterator[int]:
    """A body and all bodies that carry it, from the body inward."""
    while body != BASE:
        yield body
        body = model.bodies[body].parent


def _are_legs(model: Model, first_chain: tuple[int, ...], second_chain: tuple[int, ...]) -> bool:
    """True if two chains part near the base, have enough joints of their own, and no loop joins them."""
    shared_joints = len(set(first_chain) & set(second_chain))
    first, second = set(first_chain[shared_joints:]), set(second_chain[shared_joints:])
    fewest_joints = min(len(first), len(second))
    if fewest_joints < MIN_JOINTS_OF_LEG or fewest_joints < shared_joints:  # too short; or they part far from the base
        return False
    return not _loops_join(model, first, second)


def _loops_join(model: Model, first: set[int], second: set[int]) -> bool:
    """True if loop closures join two branches, directly or by other bodies, or hold one of them to the base."""
    child_counts = Counter(body.parent for body in model.bodies if body.joint.moves_body)
    loops = []
    for closure in model.closures.values():
        side_a, side_b = _tail(model, closure.frame_a, child_counts), _tail(model, closure.frame_b, child_counts)
        loops.append(side_a | side_b)
    joined_to_first, joined_to_second = _bodies_joined_to(first, loops), _bodies_joined_to(second, loops)
    if joined_to_first & second:  # then joined_to_second contains bodies of the first, too
        return True
    return BASE in joined_to_first | joined_to_second


def _bodies_joined_to(start: set[int], loops: Sequence[set[int]]) -> set[int]:
    """Bodies of ``start``, and those that loop closures join to them, directly or by other bodies."""
    joined, previous_count = set(start), 0
    while previous_count != len(joined):
        previous_count = len(joined)
        for loop in loops:
            if loop & joined:
                joined |= loop
    return joined


def _tail(model: Model, frame: str, child_counts: Mapping[int, int]) -> set[int]:
    """Bodies from a frame's own body inward, up to the first that carries several bodies; {BASE} for a frame on the base."""
    bodies = set[int]()
    for body in _inward_chain(model, model.all_frames[frame].body):
        carries_several = child_counts[body] > 1
        if bodies and carries_several:  # the frame's own body belongs to the loop, whatever it carries
            break
        bodies.add(body)
    return bodies or {BASE}
