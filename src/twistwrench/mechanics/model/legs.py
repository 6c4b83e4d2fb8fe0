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
"""Least outward distance from the hip to the end of a leg that lies flat, as a share of the robot's size."""
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
    free_roots = _bodies_on_free_roots(model)
    if free_roots:
        positions: dict[str, Array] = {}
        for body in free_roots:
            coordinate_slice, _ = body.places
            positions[body.joint.name] = model.neutral[coordinate_slice]
        model = lock(model, positions)
    if not model.gravity.any():
        model = with_gravity(model, GRAVITY)
    hanging = _base_on_legs(model)
    if hanging is None:
        return ()
    links_of_chain = _chains(model)
    return tuple(tuple(links_of_chain[leg]) for leg in hanging.legs)


def _bodies_on_free_roots(model: Model) -> list[Body]:
    """Bodies connected to the base frame by a joint without a drive, such as a floating joint."""
    return [body for body in model.bodies if body.parent == BASE and not body.joint.driven]


def _base_on_legs(model: Model) -> HangingBase | None:
    """Base and legs by the rules of :func:`hanging_base`, whatever holds the base; None for robots without legs."""
    stance = _Stance(model)
    up = vertical_axis(model.gravity)
    if model.gravity @ up > 0.0:  # the axis points down
        up = -up
    # the first rule that finds legs
    legs = stance.lowest_branches(up) or stance.sideways_branches(up) or stance.flat_branches(up)
    if not legs:
        return None
    heaviest_link = max(stance.base, key=lambda name: model.link_inertias[name].mass)
    return HangingBase(heaviest_link, tuple(sorted(legs)))


class _Stance:
    """Positions of bodies and links in the neutral configuration, in the base frame."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self.poses = _body_poses(model, model.neutral)
        self.positions = {name: pose[:3, 3] for name, pose in frame_poses(model, model.neutral).items()}
        """Positions (3,) of the frames of links [m]."""
        self.base = _base_links(model)
        """Links of the base."""
        self.chains = _chains(model)
        """Links on each branch."""
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
        foot_heights = {chain: float(self.heights(names, up).min()) for chain, names in self.chains.items()}
        ground_height = min(foot_heights.values())
        base_height = self.heights(self.base, up).min() - ground_height
        if base_height <= MIN_BASE_HEIGHT * self.size:
            return set()
        max_height = ground_height + MAX_HEIGHT_DIFFERENCE * self.size
        branches_on_ground = [branch for branch, height in foot_heights.items() if height <= max_height]
        legs = set[Chain]()
        for pair in combinations(branches_on_ground, 2):
            if _are_legs(self.model, *pair):
                legs.update(pair)
        if not legs or self._fall_over(legs, up):
            return set()
        return legs

    def _fall_over(self, legs: set[Chain], up: Array) -> bool:
        """True if feet stand in one line, and the robot falls over that line.

        Three legs or more then fall. Two legs fall if all their joints turn about the horizontal normal of the line.
        """
        feet = np.array([self._foot(leg, up) for leg in sorted(legs)])
        horizontal_positions = feet - np.outer(feet @ up, up)
        _, _, directions = np.linalg.svd(horizontal_positions - horizontal_positions.mean(axis=0))
        line_direction = directions[0]  # of the line of best fit
        normal = np.cross(up, line_direction)
        if _hip_count(legs) > 2:
            polygon_width = np.ptp(horizontal_positions @ normal)
            return bool(polygon_width < MIN_POLYGON_WIDTH * self.size)
        for leg in legs:
            for body in leg:
                axis = self._axis(body)
                if axis is None or abs(axis @ normal) <= MIN_PARALLEL_COSINE:
                    return False  # this joint moves its leg out of the plane in which the robot falls
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
        """Long legs of a robot whose height is not along gravity; a heavier branch, as trunk and arm, reaches the other way.

        The six directions of the base's axes are tried as the height.
        """
        for height_axis in (*np.eye(3), *-np.eye(3)):
            if abs(height_axis @ up) >= MIN_PARALLEL_COSINE:
                continue
            legs = self.lowest_branches(height_axis)
            if _hip_count(legs) < 2:
                continue
            leg_lengths = [(self._hip(leg) - self._foot(leg, height_axis)) @ height_axis for leg in legs]
            if min(leg_lengths) <= MIN_BASE_HEIGHT * self.size:
                continue
            base_height = float(self.heights(self.base, height_axis).max())
            min_height = base_height + MIN_BASE_HEIGHT * self.size
            upper_masses: list[float] = []
            for branch, names in self.chains.items():
                if branch not in legs and self.heights(names, height_axis).max() > min_height:
                    upper_masses.append(self._mass(branch))
            heaviest_leg_mass = max(map(self._mass, legs))
            if max(upper_masses, default=0.0) > heaviest_leg_mass:
                return legs
        return set()

    def _hip(self, chain: Chain) -> Array:
        """Position of a branch's first joint."""
        return np.asarray(self.poses[chain[0]][:3, 3])

    def _mass(self, chain: Chain) -> float:
        """Mass of a branch's bodies [kg]."""
        return sum(self.model.bodies[body].inertia.mass for body in chain)

    def flat_branches(self, up: Array) -> set[Chain]:
        """Four branches or more that are alike and lie around the base, outward from their hips and no higher than it."""
        if not self.base:
            return set()
        max_height = float(self.heights(self.base, up).max()) + MAX_HEIGHT_DIFFERENCE * self.size
        min_reach = MIN_OUTWARD_REACH * self.size
        outward_branches = list[Chain]()
        for chain, names in self.chains.items():
            is_long = len(chain) >= MIN_JOINTS_OF_LEG
            is_low = self.heights(names, up).max() <= max_height
            if is_long and is_low and self._outward_reach(chain, up) > min_reach:
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
        is_as_heavy = mass_difference <= MAX_MASS_DIFFERENCE * reference_mass
        return len(chain) == len(reference) and is_as_heavy

    def _hip_offset(self, chain: Chain, up: Array) -> Array:
        """Horizontal vector from the base's centre to a branch's first joint."""
        horizontal_projector = np.eye(3) - np.outer(up, up)
        return np.asarray(horizontal_projector @ (self._hip(chain) - self._centre()))

    def _outward_reach(self, chain: Chain, up: Array) -> float:
        """Difference of horizontal distances from the base's centre: of a branch's farthest frame and its first joint [m]."""
        horizontal_projector = np.eye(3) - np.outer(up, up)
        offsets = (self.positions_of(self.chains[chain]) - self._centre()) @ horizontal_projector
        farthest_distance = np.linalg.norm(offsets, axis=1).max()
        hip_distance = np.linalg.norm(self._hip_offset(chain, up))
        return float(farthest_distance - hip_distance)

    def _centre(self) -> Array:
        """Centre of the base's mass, or of its frames if it has none."""
        base = self.model.base_inertia
        if base.mass > 0.0:
            return np.asarray(base.com)
        return np.asarray(np.mean(self.positions_of(self.base), axis=0))

    def _surround(self, legs: set[Chain], up: Array) -> bool:
        """True if the base's centre is inside the polygon of the hips.

        Seen from the centre, neighbouring hips are then less than 180° apart.
        """
        hips = np.array([self._hip_offset(leg, up) for leg in sorted(legs)])
        _, _, directions = np.linalg.svd(up[None])
        x_axis = directions[1]  # some horizontal unit vector; directions[0] is along ``up``
        y_axis = np.cross(up, x_axis)
        angles = np.sort(np.arctan2(hips @ y_axis, hips @ x_axis))
        angles_between_neighbours = np.diff(angles, append=angles[0] + 2 * np.pi)
        return bool(angles_between_neighbours.max() < np.pi)


def _hip_count(legs: set[Chain]) -> int:
    """Number of different first joints; branches that part further out have one in common."""
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
    body_poses = _body_poses(model, q)
    poses: dict[str, Array] = {}
    for name, frame in model.frames.items():
        T = frame.pose
        if frame.body != BASE:
            T = body_poses[frame.body] @ T
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


def _chains(model: Model) -> Mapping[Chain, list[str]]:
    """Names of the links on each branch, from the base to a last body; branches without links are left out."""
    moving_bodies = [i for i, body in enumerate(model.bodies) if body.joint.moves_body]
    last_bodies = set(moving_bodies) - {model.bodies[i].parent for i in moving_bodies}
    links_of_body: dict[int, list[str]] = {}
    for name, frame in model.frames.items():
        links_of_body.setdefault(frame.body, []).append(name)
    links_of_chain: dict[Chain, list[str]] = {}
    for last_body in sorted(last_bodies):
        inward_chain = tuple(_inward_chain(model, last_body))
        chain = inward_chain[::-1]
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


def _are_legs(model: Model, first_chain: Chain, second_chain: Chain) -> bool:
    """True if two chains part near the base, have enough joints of their own, and no loop joins them."""
    shared_count = len(set(first_chain) & set(second_chain))
    first_leg = set(first_chain[shared_count:])
    second_leg = set(second_chain[shared_count:])
    fewest_joints = min(len(first_leg), len(second_leg))
    if fewest_joints < MIN_JOINTS_OF_LEG or fewest_joints < shared_count:  # too short; or they part far from the base
        return False
    return not _loops_join(model, first_leg, second_leg)


def _loops_join(model: Model, first_leg: set[int], second_leg: set[int]) -> bool:
    """True if loop closures join two branches, directly or by other bodies, or hold one of them to the base."""
    child_counts = Counter(body.parent for body in model.bodies if body.joint.moves_body)
    loops = []
    for closure in model.closures.values():
        side_a = _tail(model, closure.frame_a, child_counts)
        side_b = _tail(model, closure.frame_b, child_counts)
        loops.append(side_a | side_b)
    joined_to_first = _bodies_joined_to(first_leg, loops)
    joined_to_second = _bodies_joined_to(second_leg, loops)
    if joined_to_first & second_leg:  # then joined_to_second contains bodies of the first leg, too
        return True
    return BASE in joined_to_first | joined_to_second


def _bodies_joined_to(start: set[int], loops: Sequence[set[int]]) -> set[int]:
    """Bodies of ``start``, and those that loop closures join to them, directly or by other bodies."""
    joined = set(start)
    previous_count = 0
    while previous_count != len(joined):
        previous_count = len(joined)
        for loop in loops:
            if loop & joined:
                joined |= loop
    return joined


def _tail(model: Model, frame: str, child_counts: Mapping[int, int]) -> set[int]:
    """Bodies from a frame's own body inward, before the next one that carries several bodies; {BASE} for a frame on the base.

    The frame's own body always belongs to them.
    """
    bodies = set[int]()
    for body in _inward_chain(model, model.all_frames[frame].body):
        carries_several = child_counts[body] > 1
        if bodies and carries_several:
            break
        bodies.add(body)
    return bodies or {BASE}
