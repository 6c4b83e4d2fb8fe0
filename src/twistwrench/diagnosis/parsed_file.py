"""A robot file as data of the doctor: links, joints, load errors, symmetric links, and the effect of changed inertias.

With the pseudo-inertia J of a body in the base frame and the twist [A] that a velocity gives it, both (4, 4),
M_jj = Σ tr([A] J [A]') and g_j = -Σ g . ([A] J)_4: linear in J, so that a change needs the changed bodies alone.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ..algorithms.recursion import ancestors, base_poses, joint_poses
from ..bodies.inertia import SpatialInertia
from ..errors import ModelError, TwistWrenchError, UnknownNameError
from ..formats.element import Element
from ..formats.robot_text import WrittenInertia
from ..formats.urdf import add_joint, add_link
from ..lie import se3
from ..model.assembly import random_configuration
from ..model.builder import ModelBuilder
from ..model.model import BASE, Body, Model
from ..typing import Array
from .findings import Effect
from .shapes import LinkShapes

CONFIGURATIONS = 200
"""Random configurations that effects are the largest over."""
_STEPS = 3_000_000
"""Bodies times configurations times depth that are walked; with more, there are fewer configurations."""
_TINY = 1e-9
"""Changes of this share are rounding."""


class Effects:
    """Effects on one model at seeded configurations."""

    def __init__(self, model: Model, seed: int = 0, count: int = CONFIGURATIONS) -> None:
        self.model = model
        depths: list[int] = []
        for body in model.bodies:
            depths.append(1 + (depths[body.parent] if body.parent != BASE else 0))
        self.count = int(np.clip(_STEPS // max(1, sum(depths)), 1, count))
        self.q = random_configuration(model, np.random.default_rng(seed), (self.count,))
        self._screws: list[list[tuple[int, Array]] | None] = [None] * len(model.bodies)

    def evaluate(self, changes: Mapping[str, SpatialInertia]) -> Effect:
        """The effect of links having other inertias, each about its link's origin: what they would be, not by how much."""
        deltas: dict[int, Array] = {}
        for link, wanted in changes.items():
            frame = self.model.frames[link]
            if frame.body == BASE:
                continue
            change = (wanted - self.model.link_inertias[link]).in_frame(frame.pose)
            deltas[frame.body] = deltas.get(frame.body, 0.0) + change.pseudo_inertia
        if not deltas:
            return Effect()
        columns, dM, dg = self._sums(deltas)
        return self._largest(columns, dM, dg)

    def _largest(self, columns: Array, dM: Array, dg: Array) -> Effect:
        """Of changes (count, k) in some columns."""
        if not len(columns):
            return Effect()
        names = [self.model.velocity_names[k] for k in columns]
        M, limit = self.diagonal[:, columns], self.model.limits.effort[columns]
        new = np.maximum(M + dM, _TINY * np.maximum(np.abs(M), np.abs(dM)) + 1e-300)
        share = 100.0 * (np.abs(dM) / new).max(axis=0)
        torque = np.abs(dg).max(axis=0)
        effort = np.where(np.isfinite(limit) & (limit > 0), 100.0 * torque / np.where(limit > 0, limit, 1.0), 0.0)
        j, k, l = int(share.argmax()), int(torque.argmax()), int(effort.argmax())
        loads = torque[k] > _TINY * self._largest_torque
        return Effect(
            float(share[j]) if share[j] > 100.0 * _TINY else 0.0,
            names[j] if share[j] > 100.0 * _TINY else "",
            float(torque[k]) if loads else 0.0,
            names[k] if loads else "",
            float(effort[l]) if loads else 0.0,
            names[l] if loads and effort[l] > 0 else "",
        )

    @cached_property
    def _largest_torque(self) -> float:
        return float(np.abs(self.gravity_torques).max(initial=0.0))

    @cached_property
    def diagonal(self) -> Array:
        """The diagonal of M with armature, (count, nv)."""
        return self._totals[0] + self.model.armature

    @cached_property
    def gravity_torques(self) -> Array:
        """(count, nv), without springs."""
        return self._totals[1]

    @cached_property
    def _totals(self) -> tuple[Array, Array]:
        M, g = np.zeros((self.count, self.model.nv)), np.zeros((self.count, self.model.nv))
        columns, some, torques = self._sums({i: b.inertia.pseudo_inertia for i, b in enumerate(self.model.bodies)})
        M[:, columns], g[:, columns] = some, torques
        return M, g

    def _sums(self, inertias: Mapping[int, Array]) -> tuple[Array, Array, Array]:
        """Σ over bodies of tr([A] J [A]') and -g . ([A] J)_4, J in the bodies' frames: columns (k,), and (count, k) of each."""
        found: dict[int, tuple[Array, Array]] = {}
        zero = np.zeros(self.count)
        for i, inertia in inertias.items():
            T = self.poses[i]
            J = T @ inertia @ np.swapaxes(T, -1, -2)
            for column, A in self._twists(i):
                AJ = A @ J
                M, g = found.get(column, (zero, zero))
                found[column] = M + np.einsum("cij,cij->c", AJ, A), g - AJ[:, :3, 3] @ self.model.gravity
        columns = np.array(list(found), int)
        M, g = (np.reshape([pair[k] for pair in found.values()], (-1, self.count)).T for k in (0, 1))
        return columns, M, g

    def _twists(self, body: int) -> Iterator[tuple[int, Array]]:
        """Of each velocity that moves a body: its column, and the twist (count, 4, 4) that a unit of it gives the body."""
        found: dict[int, Array] = {}
        for i in ancestors(self.model, body):
            if self._screws[i] is None:
                b, T = self.model.bodies[i], self.poses[i]
                back = se3.inverse(T)
                axes = enumerate(b.joint.axes, start=b.v_index)
                self._screws[i] = [(column, T @ se3.hat(b.ratio * axis) @ back) for column, axis in axes]
            for column, A in self._screws[i] or ():
                found[column] = found[column] + A if column in found else A
        yield from found.items()

    @cached_property
    def poses(self) -> list[Array]:
        """Poses (count, 4, 4) of the bodies in the base frame."""
        return base_poses(
            self.model, [np.asarray(body.placement @ self._joint_poses(body)) for body in self.model.bodies]
        )

    def _joint_poses(self, body: Body) -> Array:
        q = body.ratio * self.q[:, body.places[0]] + body.offset
        if body.joint.nq == 1:
            return np.asarray(se3.exp(q * body.joint.axes[0]))
        return np.stack([body.joint.pose(one) for one in q])


# ── Load errors of a URDF, all of them

_MOST = 20


@dataclass(frozen=True)
class LoadError:
    """One reason to refuse a file."""

    where: str
    line: int
    sentence: str
    mimic: bool = False
    """Whether it is only a leader that is not there: the robot can be read with such joints independent."""

    def __str__(self) -> str:
        return self.sentence


def load_errors(root: Element) -> list[LoadError]:
    """All reasons to refuse a ``<robot>``, link by link and joint by joint; none for other formats."""
    if root.tag != "robot":
        return []
    found = [*_each_by_itself(root), *_ends(root), *_leaders(root)]
    return found[:_MOST]


def _each_by_itself(root: Element) -> Iterator[LoadError]:
    builder = ModelBuilder("robot")
    for add, tag in ((add_link, "link"), (add_joint, "joint")):
        for element in root.all(tag):
            try:
                add(builder, element)
            except TwistWrenchError as error:
                yield LoadError(f"{tag} {element.attributes.get('name', '')!r}", element.line, str(error))


def _ends(root: Element) -> Iterator[LoadError]:
    """Parents and children that are not there, and links with two parents."""
    links = [link.attributes.get("name", "").strip() for link in root.all("link")]
    children: Counter[str] = Counter()
    for joint in root.all("joint"):
        for end in ("parent", "child"):
            try:
                element = joint.child(end)
            except ModelError:
                continue
            name = element.attributes.get("link", "").strip() if element is not None else ""
            if not name:
                continue
            where = f"joint {joint.attributes.get('name', '')!r}"
            if name not in links:
                missing = UnknownNameError.of("link", name, links)
                yield LoadError(where, joint.line, f"the {end} of {joint} is not there: {missing}")
            children[name] += end == "child"
            if end == "child" and children[name] == 2:
                yield LoadError(
                    where, joint.line, f"{joint} gives link {name!r} a second parent. A robot must be a tree."
                )


def _leaders(root: Element) -> Iterator[LoadError]:
    joints = [joint.attributes.get("name", "").strip() for joint in root.all("joint")]
    for joint in root.all("joint"):
        for mimic in joint.all("mimic") if joint.attributes.get("type") != "fixed" else ():
            leader = mimic.attributes.get("joint", "").strip()
            if leader and leader not in joints:
                missing = str(UnknownNameError.of("joint", leader, joints)).partition(" Known:")[0]
                said = f"it mimics a joint that is not there: {missing}"
                yield LoadError(f"joint {joint.attributes.get('name', '')!r}", joint.line, said, mimic=True)


# ── Links and joints, with the places of their numbers


@dataclass(frozen=True, eq=False)
class ParsedLink:
    """One link."""

    name: str
    line: int
    file: str = ""
    written: WrittenInertia | None = None
    assumed: tuple[str, ...] = ()
    """What of its inertia the file leaves out, so that the format's own numbers stand for it: mass, inertia."""
    read_shapes: Callable[[], LinkShapes] = LinkShapes

    @cached_property
    def shapes(self) -> LinkShapes:
        """What it looks like; meshes are opened when this is first asked for."""
        return self.read_shapes()


@dataclass(frozen=True, eq=False)
class ParsedFile:
    """A robot file beside the model that was made of it, its impossible bodies accepted."""

    model: Model
    format: str
    """"urdf", "mjcf", "sdf", or empty for a robot that has no file."""
    links: Mapping[str, ParsedLink]
    joints: Mapping[str, Element] = field(default_factory=dict)
    settings: tuple[str, ...] = ()
    """What settings of the file did to its inertias, a sentence each."""
    load_errors: tuple[LoadError, ...] = ()
    """What the loader refuses, and could be left out here."""

    @cached_property
    def effects(self) -> Effects:
        """Of changes to its inertias."""
        return Effects(self.model)

    @cached_property
    def neutral_poses(self) -> Mapping[str, Array]:
        """Of the links in the base frame, all joints at zero: (4, 4) each."""
        model = self.model
        bodies = base_poses(model, joint_poses(model, model.neutral))
        return {
            name: np.asarray(frame.pose if frame.body == BASE else bodies[frame.body] @ frame.pose)
            for name, frame in model.frames.items()
        }

    @cached_property
    def span(self) -> float:
        """The diagonal of the box of all links' frames with the joints at zero [m]."""
        places = np.array([T[:3, 3] for T in self.neutral_poses.values()])
        return float(np.linalg.norm(np.ptp(places, axis=0)))

    @cached_property
    def mass(self) -> float:
        """Of all links [kg]."""
        return float(sum(inertia.mass for inertia in self.model.link_inertias.values()))

    def moves(self, link: str) -> bool:
        """Whether a joint carries the link."""
        return link in self.model.frames and self.model.frames[link].body != BASE

    def heavy(self, link: ParsedLink, share: float = 0.01) -> bool:
        """Whether it is of that share of the mass at least."""
        return link.written is not None and link.written.mass >= share * self.mass > 0


# ── Symmetric links: pairs that mirror each other with the joints at zero

_SIDES = {"left": "right", "l": "r", "fl": "fr", "rl": "rr", "hl": "hr", "bl": "br", "lf": "rf", "lh": "rh", "lr": "rr"}
_WORDS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[0-9]+|[^A-Za-z0-9]+")
_PLANES = (np.diag([1.0, -1.0, 1.0]), np.diag([-1.0, 1.0, 1.0]))
"""Reflections of the base frame: left and right along y, and along x."""
_ALIKE = 1e-3
"""m, and entries of rotations: how far from mirrored frames may be."""


@dataclass(frozen=True, eq=False)
class SymmetricLinks:
    """Two links that mirror each other."""

    left: ParsedLink
    right: ParsedLink
    D: Array
    """(3, 3) what a point of the left link, in its frame, is multiplied by to be its image in the right one's."""


def right_side_names(name: str) -> Iterator[str]:
    """What the other side of a left link may be called: one word for the side, exchanged.

    >>> list(right_side_names("arm_left_4_link")), list(right_side_names("LElbow")), list(right_side_names("tool"))
    (['arm_right_4_link'], ['RElbow'], [])
    """
    words = _WORDS.findall(name)
    for k, word in enumerate(words):
        other = _SIDES.get(word.lower())
        if other is not None:
            cased = other.upper() if word.isupper() else other.capitalize() if word[0].isupper() else other
            yield "".join([*words[:k], cased, *words[k + 1 :]])
    # One letter in front of a word in small letters, as in lshoulder.
    if re.match(r"l[a-z]{3}", name) and not name.startswith("left"):
        yield "r" + name[1:]


def symmetric_links(robot: ParsedFile) -> Iterator[SymmetricLinks]:
    """All pairs of links by their names whose frames are mirror images of each other in one plane of the base."""
    poses = robot.neutral_poses
    for left in robot.links.values():
        right = next((robot.links[name] for name in right_side_names(left.name) if name in robot.links), None)
        if right is None or left.name not in poses or right.name not in poses:
            continue
        D = _mirrored(poses[left.name], poses[right.name])
        if D is not None:
            yield SymmetricLinks(left, right, D)


def _mirrored(T_a: Array, T_b: Array) -> Array | None:
    """R_b' Y R_a where it is a signed permutation and the places are mirrored; None elsewhere."""
    for Y in _PLANES:
        gap = T_b[:3, 3] - Y @ T_a[:3, 3]
        if np.linalg.norm(gap) > _ALIKE or abs(T_a[:3, 3] @ (np.eye(3) - Y).diagonal()) < 0.02:
            continue
        D = T_b[:3, :3].T @ Y @ T_a[:3, :3]
        rounded = np.round(D)
        if np.abs(D - rounded).max() < _ALIKE and np.allclose(rounded @ rounded.T, np.eye(3)):
            return np.asarray(rounded)
    return None
