"""The graph of frames of a model: which frame each pose is given in, and which link each frame is fixed to."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ...errors import RobotFileError
from ...lie import se3
from ...listing import listed
from ...typing import Array
from ..element import Element
from .values import pose, word

MODEL = "__model__"
WORLD = "world"
_JOINTS = ("joint", "{drake}joint")


@dataclass(eq=False)
class SdfFrame:
    """A link, joint, frame or nested model, by its name with those of the models around it."""

    element: Element
    scope: str
    """The models around it, each with ``::`` behind."""
    T: Array
    """(4, 4) in the frame that ``relative_to`` names."""
    relative_to: str
    attached_to: str
    """The frame it is fixed to; its own name of a link."""


@dataclass(eq=False)
class SdfModel:
    """All that a model holds, nested models unpacked."""

    frames: dict[str, SdfFrame] = field(default_factory=dict)
    links: dict[str, Element] = field(default_factory=dict)
    joints: dict[str, Element] = field(default_factory=dict)
    named: dict[str, Element] = field(default_factory=dict)
    """The elements ``<frame>``."""
    _poses: dict[str, Array] = field(default_factory=dict)
    _carriers: dict[str, str] = field(default_factory=dict)
    """Links of the frames that were followed to them."""

    def pose(self, name: str, asked: Element) -> Array:
        """The pose (4, 4) of a frame in the model's own; raises for frames that are not there, and that refer to themselves."""
        path: dict[str, None] = {}
        at = name
        while at not in self._poses and at != MODEL:
            if at in path:
                raise RobotFileError(
                    f"{asked}: the frames {listed([*path, at], between=' → ')} are given relative to each other."
                )
            path[at] = None
            at = self.frame(at, asked).relative_to
        T = self._poses.get(at, np.eye(4))
        for one in reversed(path):
            T = T @ self.frames[one].T
            self._poses[one] = T
        return T

    def link_of(self, name: str, asked: Element) -> str:
        """The link that a frame is fixed to."""
        path: dict[str, None] = {}
        while name not in self.links and name not in self._carriers:
            if name in path:
                raise RobotFileError(
                    f"{asked}: the frames {listed([*path, name], between=' → ')} are attached to each other."
                )
            path[name] = None
            name = self.frame(name, asked).attached_to
        link = self._carriers.get(name, name)
        self._carriers |= dict.fromkeys(path, link)
        return link

    def frame(self, name: str, asked: Element) -> SdfFrame:
        """The frame of that name."""
        if name not in self.frames:
            known = ", ".join(repr(one) for one in list(self.frames)[:12])
            raise RobotFileError(
                f"{asked} names {name!r}, which is no link, joint, frame or model there. Known: {known}."
            )
        return self.frames[name]

    def between(self, a: str, b: str, asked: Element) -> Array:
        """T_ab of two frames."""
        return np.asarray(se3.inverse(self.pose(a, asked)) @ self.pose(b, asked))


def unpacked(model: Element) -> SdfModel:
    """The frames of a model and of all models in it, their names joined by ``::``."""
    found = SdfModel()
    stack = [(model, "")]
    while stack:
        element, scope = stack.pop()
        if element.all("include"):
            raise RobotFileError(f"{element.all('include')[0]} is not read. Put the model that it names in its place.")
        own = scope[:-2] if scope else MODEL
        for child in element.children:
            if child.tag not in ("link", "joint", "frame", "model"):
                continue
            name = scope + child.text("name")
            if name in found.frames:
                raise RobotFileError(f"{child} has the name of {found.frames[name].element}. Rename one.")
            place = child.child("pose")
            default = own
            attached = name
            if child.tag == "joint":
                default = scope + _end(child, "child")
                attached = default
                found.joints[name] = child
            elif child.tag == "frame":
                said = child.attributes.get("attached_to", "").strip()
                default = scope + said if said and said != MODEL else own
                attached = default
                found.named[name] = child
            elif child.tag == "link":
                found.links[name] = child
            else:
                stack.append((child, f"{name}::"))
                attached = f"{name}::{_canonical_link(child)}"
            relative = place.attributes.get("relative_to", "").strip() if place is not None else ""
            relative = (own if relative == MODEL else scope + relative) if relative else default
            found.frames[name] = SdfFrame(child, scope, pose(place), relative, attached)
        if not scope:
            found.frames[MODEL] = SdfFrame(element, "", np.eye(4), MODEL, _canonical_link(element))
    return found


def _canonical_link(model: Element) -> str:
    """Name of the link that the model's own frame is fixed to."""
    named = model.attributes.get("canonical_link", "").strip()
    return named or next((link.text("name") for link in model.all("link")), "")


def _end(joint: Element, which: str) -> str:
    name = word(joint, which)
    if not name:
        raise RobotFileError(f"{joint} has no <{which}>. Name the link.")
    return name
