"""From a model to the text of an MJCF file."""

from __future__ import annotations

import numpy as np

from ...bodies.inertia import SpatialInertia
from ...errors import ModelError
from ...lie import quaternion
from ...model.description import JointEntry
from ...model.model import Model
from ...model.outline import Outline, outline
from ...model.remark import Remark
from ...typing import Array
from ..element import Element
from ..inertia_entries import ENTRIES, IN_MJCF
from ..mjcf.equality import ALL, POINT
from ..xml_text import figures, new, xml_text
from .mjcf_joints import MjcfJoints
from .written import Losses, Written, configurations_of, unused

WORLD = "world"
_LEAST = 1e-14
"""MuJoCo's least moment of a body, and mass of one that moves."""
_ROUNDING = 4e-15
"""Of principal moments, relative to the largest."""


def write_mjcf(model: Model) -> Written:
    """The MJCF file of a model. Each moving body has the inertia of all that is fixed to it.

    >>> import twistwrench as tw
    >>> write_mjcf(tw.robots.planar_3r().model).lost
    ()
    """
    return _MjcfWriter(outline(model)).write()


class _MjcfWriter:
    """One model on its way into a file."""

    def __init__(self, found: Outline) -> None:
        self.found, self.losses = found, Losses()
        self.root = new("mujoco", model=found.name)
        new("compiler", self.root, angle="radian", inertiafromgeom="false")
        new("option", self.root, gravity=figures(found.gravity))
        self.world = new("worldbody", self.root)
        self.equality, self.tendon, self.keyframe = (
            Element(tag, {}, 0, self.root) for tag in ("equality", "tendon", "keyframe")
        )
        self.joints = MjcfJoints(found, self.equality, self.losses)
        self.bodies: dict[str, Element] = {}
        self.children: dict[str, list[JointEntry]] = {}
        for joint in found.joints:
            self.children.setdefault(joint.parent, []).append(joint)
        closed = (frame for c in found.additions.closures.values() for frame in (c.frame_a, c.frame_b))
        self.named = {*(site.link for site in found.additions.sites.values()), *closed}
        """Links that sites and closures are at."""
        self.standing: set[str] = set()
        """Links that do not move, each with an inertia of its own: where the base is the world, which has none."""

    def write(self) -> Written:
        """Bodies in each other, then what holds between them."""
        found = self.found
        if found.floating:
            self.bodies[found.root] = self._body(found.root, self.world, np.eye(4), found.whole[found.root])
            self.joints.add_free(self.bodies[found.root])
        elif found.root == WORLD:
            self.bodies[WORLD] = self.world
            self.standing.add(WORLD)
            if found.links[WORLD].inertia.mass:
                self.losses.say("the mass of what stands still is left out, where the base is the world itself")
        else:
            self.bodies[found.root] = self._body(found.root, self.world, np.eye(4), found.whole[found.root])
        pending: dict[str, tuple[JointEntry, ...]] = {}
        for entry in found.joints:
            before = pending.pop(entry.parent, ())
            if (before or not entry.fixed) and self._is_between(entry):
                pending[entry.child] = (*before, entry)
            else:
                self._add((*before, entry))
        self._add_sites()
        self._add_springs()
        self._add_configurations()
        self._add_closures()
        for part in (self.tendon, self.equality, self.keyframe):
            if part.children:
                self.root.add(part)
        return Written(xml_text(self.root), tuple(self.losses.found))

    def _is_between(self, entry: JointEntry) -> bool:
        """True if the child of a joint only stands between two joints, which then are joints of one body."""
        link = self.found.links[entry.child]
        while entry.joint.nv == int(not entry.fixed) and entry.child not in self.named:
            following = self.children.get(entry.child, [])
            if self.found.links[entry.child].inertia.parameters.any() or len(following) != 1:
                return False
            (entry,) = following
            if not entry.fixed:
                break
        else:
            return False
        if entry.joint.nv == 1 and not link.hidden:
            self.losses.found.append(
                Remark(
                    f"link {link.name!r}",
                    "has no mass; its joint moves the next body with mass, and its frame is lost",
                )
            )
        return entry.joint.nv == 1

    def _body(self, name: str, parent: Element, T: Array, inertia: SpatialInertia | None) -> Element:
        called = name if name != WORLD else unused(name, {WORLD, *self.found.links})
        if called != name:
            self.losses.say(f"link {name!r} is written as {called!r}, for the world itself has its name")
        body = new("body", parent, name=called)
        body.attributes |= _pose(T)
        moves = self.found.floating or (name != self.found.root and name not in self.standing)
        if inertia is not None and (moves or inertia.parameters.any()):
            self._add_inertial(body, f"link {name!r}", inertia, moves)
        return body

    def _add_inertial(self, body: Element, who: str, inertia: SpatialInertia, moves: bool) -> None:
        """The inertial of a body; a loss where MuJoCo does not compile it."""
        I = inertia.moment_about_com
        small, middle, large = np.linalg.eigvalsh(I)
        flat = small + middle - large
        if abs(flat) <= _ROUNDING * large:  # exactly flat in exact numbers, but perhaps not to MuJoCo's last digit
            I = I + _ROUNDING * large * np.eye(3)
        refused = (
            "has no mass" if inertia.mass < _LEAST
            else "has a mass without inertia about some axis" if small < _LEAST
            else "has moments of inertia that no body can have" if flat < -_ROUNDING * large
            else ""
        )  # fmt: skip
        if refused and moves:
            self.losses.found.append(Remark(who, f"moves and {refused}: MuJoCo does not compile the file"))
        elif refused:
            self.losses.found.append(Remark(who, f"stands still and {refused}: its inertia is left out"))
            return
        if inertia.parameters.any():
            full = [I[ENTRIES[name]] for name in IN_MJCF]
            new("inertial", body, pos=figures(inertia.com), mass=figures(inertia.mass), fullinertia=figures(full))

    def _add(self, entries: tuple[JointEntry, ...]) -> None:
        """A body with its joints, the last of which is that of its link."""
        first, last = entries[0], entries[-1]
        parent, kind = self.bodies[first.parent], last.joint.kind
        after = [np.eye(4)]  # of the body's frame in each joint's child, all coordinates at zero
        for entry in reversed(entries):
            after.insert(0, np.asarray(entry.placement @ after[0]))
        inertia = self._inertia(last)
        if kind == "floating":
            if parent is not self.world or not np.array_equal(after[0], np.eye(4)):
                raise ModelError(
                    f"joint {last.name!r} floats away from the world's origin, and MJCF has no joint for that. Lock it."
                )
            self.bodies[last.child] = self._body(last.child, parent, np.eye(4), inertia)
            self.joints.add_free(self.bodies[last.child], last)
            return
        body = self.bodies[last.child] = self._body(last.child, parent, after[0], inertia)
        for entry, T in zip(entries, after[1:], strict=True):
            if entry.fixed:
                continue
            if entry.joint.kind == "ball":
                self.joints.add_ball(entry, body)
            elif entry.joint.kind == "planar":
                self.joints.add_planar(entry, body)
            else:
                self.joints.add_screw(entry, body, T)

    def _inertia(self, entry: JointEntry) -> SpatialInertia | None:
        """Of the body that a joint carries: whole of what moves, and one by one of what stands in the world."""
        if not entry.fixed:
            return self.found.whole[entry.child]
        if entry.parent in self.standing:
            self.standing.add(entry.child)
            return self.found.links[entry.child].inertia
        return None

    def _add_sites(self) -> None:
        for site in self.found.additions.sites.values():
            body = self.bodies[site.link]
            element = new("site", body, name=site.name.removeprefix("site:"))
            element.attributes |= _pose(site.pose)

    def _add_springs(self) -> None:
        for spring in self.found.additions.springs:
            (first, weight), *others = spring.terms
            joint = self.joints.elements[first]
            if not others and "stiffness" not in joint.attributes:
                joint.attributes["stiffness"] = figures(spring.stiffness * weight**2)
                if spring.rest:
                    joint.attributes["springref"] = figures(spring.rest / weight)
                continue
            sign = -1.0 if spring.rest < 0 else 1.0  # a length is not negative
            tendon = new(
                "fixed", self.tendon, stiffness=figures(spring.stiffness), springlength=figures(sign * spring.rest)
            )
            for name, coefficient in spring.terms:
                new("joint", tendon, joint=name, coef=figures(sign * coefficient))

    def _add_configurations(self) -> None:
        for name, positions in configurations_of(self.found).items():
            new(
                "key",
                self.keyframe,
                name=name,
                qpos=figures(np.concatenate([np.zeros(0), *self.joints.qpos(positions)])),
            )

    def _add_closures(self) -> None:
        sites = self.found.additions.sites
        for name, closure in self.found.additions.closures.items():
            tags = {POINT: "connect", ALL: "weld"}
            if closure.rows not in tags:
                self.losses.found.append(
                    Remark(f"closure {name!r}", f"holds {closure.rows}, which the format cannot say")
                )
                continue
            ends = [
                frame.removeprefix("site:") if frame in sites else self._site(frame)
                for frame in (closure.frame_a, closure.frame_b)
            ]
            new(tags[closure.rows], self.equality, name=name, site1=ends[0], site2=ends[1])

    def _site(self, link: str) -> str:
        """A site at a link, for what can be said of sites only."""
        name = unused(f"{link}.site", {site.removeprefix("site:") for site in self.found.additions.sites})
        new("site", self.bodies[link], name=name)
        return name


def _pose(T: Array) -> dict[str, str]:
    """Position and orientation of an element, each where it is not nothing."""
    found = {"pos": figures(T[:3, 3])} if T[:3, 3].any() else {}
    if not np.array_equal(T[:3, :3], np.eye(3)):
        found["quat"] = figures(quaternion.from_matrix(T[:3, :3]))
    return found
