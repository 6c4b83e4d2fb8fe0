"""What a robot file says, link by link and joint by joint, with the places where its numbers stand."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ..bodies.inertia import SpatialInertia
from ..core.printed_numbers import in_file
from ..formats.inertia_entries import ENTRIES
from ..model.model import BASE, Model
from ..typing import Array
from .effects import Effects
from .findings import Edit, Place
from .problems import FileProblem
from .shapes import LinkShapes


def about_com(mass: float, com: Array, tensor: Array) -> SpatialInertia:
    """About the origin, from a tensor (3, 3) about the centre of mass whose rounding need not be symmetric."""
    return SpatialInertia.from_com(mass, com, 0.5 * (tensor + tensor.T))


@dataclass(frozen=True, eq=False)
class WrittenInertia:
    """The inertia of a link as its file has it: about the centre of mass, along axes of its own."""

    mass: float
    com: Array
    """(3,) in the link's frame [m]."""
    R: Array
    """(3, 3) the axes that the tensor is along, in the link's frame."""
    tensor: Array
    """(3, 3) about the centre of mass, along these axes [kg m²]."""
    places: Mapping[str, Place] = field(default_factory=dict)
    """Where mass and ixx, ixy, … stand; empty where nothing can be written."""
    line: int = 0
    file: str = ""

    @cached_property
    def inertia(self) -> SpatialInertia:
        """About the link's origin, in its axes."""
        return self.with_tensor(self.tensor)

    def with_tensor(self, tensor: Array) -> SpatialInertia:
        """About the link's origin, with another tensor about the centre of mass, along the written axes."""
        return about_com(self.mass, self.com, self.R @ tensor @ self.R.T)

    def edits(self, tensor: Array) -> tuple[tuple[Edit, ...], Array]:
        """The edits that make another tensor of it, only of entries that change; and the tensor as written then.

        No edits where an entry would have to change that has no place.
        """
        wanted = {
            name: Edit(self.places[name], in_file(tensor[ENTRIES[name]])) for name in self.places if name in ENTRIES
        }
        found, written = [], self.tensor.copy()
        scale = float(np.abs(tensor).max())
        for name, (i, j) in ENTRIES.items():
            if abs(tensor[i, j] - self.tensor[i, j]) <= 1e-12 * scale:
                continue
            if name not in wanted:
                return (), tensor
            found.append(wanted[name])
            written[i, j] = written[j, i] = float(wanted[name].text)
        return tuple(found), written

    def edits_to(self, inertia: SpatialInertia) -> tuple[Edit, ...]:
        """The edits that make another inertia of it, mass and centre of mass too; none where a number has no place."""
        moments = self.R.T @ inertia.moment_about_com @ self.R
        size = float(np.abs(moments).max())
        moments[np.abs(moments) < 1e-9 * size] = 0.0
        found, _ = self.edits(moments)
        if not found and np.abs(moments - self.tensor).max() > 1e-12 * size:
            return ()
        wanted = {"mass": inertia.mass, **dict(zip("xyz", inertia.com.tolist(), strict=True))}
        given = {"mass": self.mass, **dict(zip("xyz", self.com.tolist(), strict=True))}
        more = [name for name in wanted if abs(wanted[name] - given[name]) > 1e-12 * max(1.0, abs(given[name]))]
        if any(name not in self.places for name in more):
            return ()
        return (*found, *(Edit(self.places[name], in_file(wanted[name])) for name in more))


@dataclass(frozen=True, eq=False)
class DescribedLink:
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
class DescribedJoint:
    """One joint: its numbers as they are written, None where they are not."""

    name: str
    line: int
    file: str = ""
    single: bool = False
    """Whether it has one degree of freedom."""
    turns: bool = False
    """Whether it is one that turns between limits."""
    numbers: Mapping[str, float] = field(default_factory=dict)
    """lower, upper, velocity, effort, damping, friction."""
    axis: Array | None = None
    """As written, in any length."""
    places: Mapping[str, Place] = field(default_factory=dict)
    child: str = ""


@dataclass(frozen=True, eq=False)
class DescribedRobot:
    """A robot file beside the model that was made of it, its impossible bodies accepted."""

    model: Model
    format: str
    """"urdf", "mjcf", "sdf", or empty for a robot that has no file."""
    links: Mapping[str, DescribedLink]
    joints: Mapping[str, DescribedJoint] = field(default_factory=dict)
    settings: tuple[str, ...] = ()
    """What settings of the file did to its inertias, a sentence each."""
    problems: tuple[FileProblem, ...] = ()
    """What the loader refuses, and could be left out here."""

    @cached_property
    def effects(self) -> Effects:
        """Of changes to its inertias."""
        return Effects(self.model)

    @cached_property
    def neutral_poses(self) -> Mapping[str, Array]:
        """Of the links in the base frame, all joints at zero: (4, 4) each."""
        model, q = self.model, self.model.neutral
        bodies: list[Array] = []
        for body in model.bodies:
            own = body.ratio * q[body.places[0]] + body.offset
            T = body.placement @ body.joint.pose(own)
            bodies.append(T if body.parent == BASE else bodies[body.parent] @ T)
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

    def heavy(self, link: DescribedLink, share: float = 0.01) -> bool:
        """Whether it is of that share of the mass at least."""
        return link.written is not None and link.written.mass >= share * self.mass > 0
