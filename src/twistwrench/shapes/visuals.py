"""Visuals of a robot file: its ``<visual>`` elements and their meshes. Files are not downloaded."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..core.errors import MissingExtraError, ModelError, NotFoundError
from ..core.typing import Array
from ..formats.source import find_resource, read_robot_text
from ..formats.urdf import origin_of
from ..formats.xacro import EXPAND, xacro_in
from ..formats.xml import Element, parse
from .surface import Surface, box, cylinder, read_mesh, sphere

if TYPE_CHECKING:
    from ..mechanics.model.model import Model

# ── ``<visual>`` elements of URDF

# https://wiki.ros.org/urdf/XML/link
# Unreadable visuals never prevent a robot from being shown: they are left out and listed in the remarks.

Colour = tuple[float, float, float]

GREY: Colour = (0.72, 0.75, 0.78)
"""Colour of shapes without a colour."""


@dataclass(frozen=True, eq=False)
class Visual:
    """Surface of one colour at a pose (4, 4) in a link frame. Links with the same mesh share one surface."""

    link: str
    surface: Surface
    pose: Array
    colour: Colour


def read_visuals(model: Model, tag: str = "visual") -> tuple[list[Visual], list[str]]:
    """Surfaces of the model's file by link, and remarks on missing ones; empty for robots without a file.

    Parameters
    ----------
    tag : "visual" or "collision"
    """
    path = Path(model.source) if model.source else None
    try:
        if path is None or not path.is_file():
            return [], []
        text = read_robot_text(path)[0]
        robot = parse(text)
    except (ModelError, NotFoundError, OSError, ValueError):  # the file has changed since the robot was loaded
        return [], [f"{model.source} cannot be read again, so the robot is drawn from its inertia"]
    if xacro_in(text, robot):
        return [], [
            f"{model.source} is xacro, so the robot is drawn from its inertia: {EXPAND} makes a file with its looks"
        ]
    return _Reader(robot, path, model).read(tag)


class _Reader:
    def __init__(self, robot: Element, path: Path, model: Model) -> None:
        self.robot, self.path, self.model = robot, path, model
        self.colours = {m.attributes.get("name", ""): _colour(m) for m in robot.all("material")}
        self.meshes: dict[str, list[tuple[Surface, Colour | None]]] = {}
        self.scaled: dict[tuple[str, bytes], list[tuple[Surface, Colour | None]]] = {}
        self.wanted: Counter[str] = Counter()
        self.problems: dict[str, str] = {}
        """Reasons, by mesh name or element."""

    def read(self, tag: str) -> tuple[list[Visual], list[str]]:
        found: list[Visual] = []
        for link in self.robot.all("link"):
            name = link.attributes.get("name", "").strip()
            if name in self.model.frames:
                for visual in link.all(tag):
                    found += self._visual(name, visual)
        return found, self._remarks()

    def _visual(self, link: str, visual: Element) -> list[Visual]:
        try:
            geometry = visual.required("geometry", '<geometry><box size="1 1 1"/></geometry>')
            shape = geometry.children[0] if geometry.children else None
            parts = [] if shape is None else self._shape(shape)
            T = origin_of(visual)
            own = self._material(visual)
        except ModelError as problem:
            self.problems[str(visual)] = str(problem)
            return []
        return [Visual(link, s, T, colour or own or GREY) for s, colour in parts]

    def _shape(self, shape: Element) -> list[tuple[Surface, Colour | None]]:
        if shape.tag == "box":
            return [(box(shape.numbers("size", 3)), None)]
        if shape.tag == "sphere":
            return [(sphere(shape.number("radius")), None)]
        if shape.tag in ("cylinder", "capsule"):
            return [(cylinder(shape.number("radius"), shape.number("length"), round_ends=shape.tag == "capsule"), None)]
        if shape.tag != "mesh":
            self.problems[str(shape)] = f"{shape} cannot be drawn"
            return []
        scale = shape.numbers("scale", 3) if "scale" in shape.attributes else np.ones(3)
        key = shape.text("filename"), scale.tobytes()
        if key not in self.scaled:
            self.scaled[key] = [(s.scaled(scale), colour) for s, colour in self._mesh(key[0])]
        return self.scaled[key]

    def _mesh(self, uri: str) -> list[tuple[Surface, Colour | None]]:
        self.wanted[uri] += 1
        if uri not in self.meshes:
            self.meshes[uri] = []
            try:
                if (path := find_resource(uri, self.path)) is None:
                    self.problems[uri] = "is not in its package, nor in ROS_PACKAGE_PATH"
                else:
                    self.meshes[uri] = read_mesh(path)
            except MissingExtraError:
                self.problems[uri] = f"needs 'trimesh', which is not installed: {MissingExtraError.advice('viz')}"
            except ModelError as problem:
                self.problems[uri] = str(problem)
        return self.meshes[uri]

    def _material(self, visual: Element) -> Colour | None:
        material = visual.child("material")
        if material is None:
            return None
        return _colour(material) or self.colours.get(material.attributes.get("name", ""))

    def _remarks(self) -> list[str]:
        """One sentence about meshes, one about other problems."""
        lost = [uri for uri in self.problems if uri in self.wanted]
        rest = [text for what, text in self.problems.items() if what not in self.wanted]
        remarks = []
        if lost:
            remarks.append(
                f"{len(lost)} of {len(self.wanted)} meshes cannot be drawn, for example {lost[0]}: it "
                f"{self.problems[lost[0]]}. Bodies left without one are drawn from their inertia"
            )
        if rest:
            more = f", and {len(rest) - 1} more" if len(rest) > 1 else ""
            remarks.append(f"Not shown of the file's appearance: {rest[0].rstrip('.')}{more}")
        return remarks


def _colour(material: Element) -> Colour | None:
    try:
        colour = material.child("color")
        if colour is None:
            return None
        r, g, b, _ = np.clip(colour.numbers("rgba", 4), 0.0, 1.0).tolist()
    except ModelError:
        return None
    return r, g, b
