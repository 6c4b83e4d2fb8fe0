"""Surfaces of a robot's visuals or collision shapes, as its URDF file describes them. Files are not downloaded."""

# Unreadable visuals never prevent a robot from being shown: they are left out and listed in the remarks.

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.errors import MissingExtraError, ModelError, NotFoundError
from ..core.typing import Array
from ..formats.robot_file import file_of
from ..formats.xacro import EXPAND
from .meshes import MeshFiles
from .reader import Role, ShapeSpec, read_shapes
from .surface import SIMPLE, Colour, Surface

if TYPE_CHECKING:
    from ..mechanics.model.model import Model

GREY: Colour = (0.72, 0.75, 0.78)
"""Colour of shapes without a colour."""
_Parts = list[tuple[Surface, Colour | None]]
"""Surfaces of a shape, each with its own colour; None: the colour of the shape."""


@dataclass(frozen=True, eq=False)
class Visual:
    """Surface of one colour at a pose (4, 4) in a link frame. Links with the same mesh share one surface."""

    link: str
    surface: Surface
    pose: Array
    colour: Colour


def read_visuals(model: Model, role: Role = "visual") -> tuple[list[Visual], list[str]]:
    """Surfaces of the model's URDF file, and remarks on missing ones; both are empty for robots of other files."""
    try:
        file = file_of(model)
        if file is None:
            return [], []
        is_urdf = file.root.tag == "robot"
        if not is_urdf and not file.xacro:
            return [], []
        if file.xacro:
            return [], [
                f"{file} is xacro, so the robot is drawn from its inertia: {EXPAND} makes a file with its looks"
            ]
        link_shapes = read_shapes(model, role)
    except (ModelError, NotFoundError, OSError, ValueError):  # the file has changed since the robot was loaded
        return [], [f"{model.source} cannot be read again, so the robot is drawn from its inertia"]
    reader = _SurfaceReader(MeshFiles(Path(file)))
    visuals = []
    for link in link_shapes:
        for shape in link.parts:
            for surface, surface_colour in reader.read(shape):
                colour = surface_colour or shape.colour or GREY
                visuals.append(Visual(link.link, surface, shape.pose, colour))
    return visuals, reader.remarks()


class _SurfaceReader:
    """Reader of surfaces of shapes, which keeps the problems for the remarks."""

    def __init__(self, meshes: MeshFiles) -> None:
        self.meshes = meshes
        self.scaled_meshes: dict[tuple[str, tuple[float, ...]], _Parts] = {}
        """Surfaces by the name and the scale of a mesh."""
        self.mesh_problems: dict[str, str] = {}
        """Verb phrase about the problem, by the name of the mesh."""
        self.shape_problems: dict[str, str] = {}
        """Sentence about the problem, by the element of the shape."""

    def read(self, shape: ShapeSpec) -> _Parts:
        """Surfaces of one shape, in its own frame; empty if it cannot be drawn."""
        # A mesh is read even if the shape is not drawn, since the remarks count all meshes.
        mesh_parts = self._scaled_mesh(shape) if shape.kind == "mesh" else []
        if shape.problem:
            self.shape_problems[shape.element] = shape.problem
            return []
        if shape.kind == "mesh":
            return mesh_parts
        return [(SIMPLE[shape.kind](*shape.sizes), None)]

    def _scaled_mesh(self, shape: ShapeSpec) -> _Parts:
        """Surfaces of a mesh under the scale of the shape; shapes with equal mesh and scale share them."""
        key = (shape.mesh, shape.sizes)
        if key not in self.scaled_meshes:
            parts = self._mesh(shape.mesh)
            self.scaled_meshes[key] = [(surface.scaled(shape.sizes), colour) for surface, colour in parts]
        return self.scaled_meshes[key]

    def _mesh(self, name: str) -> _Parts:
        """Surfaces of a mesh file; empty if it cannot be read, which is noted."""
        try:
            return self.meshes.read(name)
        except MissingExtraError:
            self.mesh_problems[name] = f"needs 'trimesh', which is not installed: {MissingExtraError.advice('viz')}"
        except ModelError as problem:
            self.mesh_problems[name] = str(problem)
        return []

    def remarks(self) -> list[str]:
        """At most two sentences: one about meshes, one about other problems."""
        remarks = []
        if self.mesh_problems:
            first_mesh, problem = next(iter(self.mesh_problems.items()))
            mesh_count = len({mesh for mesh, _ in self.scaled_meshes})
            remarks.append(
                f"{len(self.mesh_problems)} of {mesh_count} meshes cannot be drawn, for example {first_mesh}: it {problem}. "
                "Bodies left without one are drawn from their inertia"
            )
        if self.shape_problems:
            first_problem, *others = self.shape_problems.values()
            remark = f"Not shown of the file's appearance: {first_problem.rstrip('.')}"
            if others:
                remark += f", and {len(others)} more"
            remarks.append(remark)
        return remarks
